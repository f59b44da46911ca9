"""The command line of rosbag's recorder in C++, from a group of recording.yaml."""

from __future__ import annotations

import re
from pathlib import Path
from typing import List, Sequence

from amaze_autonomy.config.recording_schema import Storage, TopicGroup

__all__ = ["bag_name", "child_command", "files_of", "log_name"]

_CHUNK_KB = {"none": 768, "lz4": 64}  # of a compressed chunk that is open nothing is on the disk yet


def bag_name(group: str, number: int) -> str:
    """Return the name of a group's bag, without what splitting adds to it."""
    return f"{group}-{number:02d}.bag"


def log_name(group: str) -> str:
    """Return the name of the file that a group's recorders write their warnings to."""
    return f"{group}.log"


def files_of(group: str, names: Sequence[str]) -> List[str]:
    """Return those of a folder's files that a group's recorders wrote, split ones and open ones among them."""
    pattern = re.compile(rf"{re.escape(group)}-\d\d+(_\d+)?\.bag(\.active)?")
    return sorted(name for name in names if pattern.fullmatch(name))


def child_command(
    program: Sequence[str], node: str, group: TopicGroup, topics: Sequence[str], storage: Storage, output: Path
) -> List[str]:
    """Return the command for a recorder.

    Args:
        program: of the recorder.
        node: its name.
        group: what it records.
        topics: of the group, resolved.
        storage: settings where the group has none.
        output: of the bag.
    """
    compression = storage.compression if group.compression is None else group.compression
    chunk_kb = group.chunk_kb or storage.chunk_kb or _CHUNK_KB[compression]
    buffer_mb = storage.buffer_mb if group.buffer_mb is None else group.buffer_mb
    options = [f"--buffsize={buffer_mb}", f"--chunksize={chunk_kb}", f"--min-space={storage.reserve_mb}M"]
    options += ["--tcpnodelay", f"--output-name={output}"]
    if compression == "lz4":
        options.append("--lz4")
    if storage.split_mb:
        options += ["--split", f"--size={storage.split_mb}", "--repeat-latched"]
    if group.match and group.exclude:
        options.append(f"--exclude={group.exclude}")
    wanted = [*topics] if not group.match else ["--regex", *(re.escape(each) for each in topics), *group.match]
    return [*program, *options, *wanted, f"__name:={node}"]
