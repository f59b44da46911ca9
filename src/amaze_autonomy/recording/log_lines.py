"""What the lines of a recorder's log mean: dropped messages, a full storage, errors.

The texts are those of rosbag (tools/rosbag/src/recorder.cpp). It warns of dropped messages at most every five seconds,
so each warning stands for one message or more.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

__all__ = ["LogState", "read_line"]

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_DROPPED = re.compile(r"buffer exceeded", re.IGNORECASE)
_FULL = re.compile(r"disabling recording|logging disabled|no space left|error writing", re.IGNORECASE)
_ERROR = re.compile(r"^\[ ?(ERROR|FATAL)\]|^terminate called|^ +what\(\):", re.IGNORECASE)
_LONGEST = 160


@dataclass(frozen=True)
class LogState:
    """What a log has said so far.

    Args:
        dropped: warnings that messages were dropped.
        full: it stopped writing because the storage is full.
        error: its last error, in its words.
    """

    dropped: int = 0
    full: bool = False
    error: str = ""


def read_line(state: LogState, line: str) -> LogState:
    """Return what is known after one more line."""
    line = _COLOUR.sub("", line).rstrip()
    if _DROPPED.search(line):
        return replace(state, dropped=state.dropped + 1)
    if _FULL.search(line):
        state = replace(state, full=True)
    if _FULL.search(line) or _ERROR.search(line):
        return replace(state, error=line.strip()[:_LONGEST])
    return state
