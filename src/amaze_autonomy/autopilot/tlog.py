"""Telemetry logs (.tlog): each frame with the time at which a ground station or pymavlink had it.

A record is 8 bytes of microseconds since 1970, the most significant first, and a frame. There is no header and no
checksum of its own. Where a record cannot be one, the reader steps on byte by byte until the next can.
"""

from __future__ import annotations

from pathlib import Path
from typing import Iterator, NamedTuple, Tuple, Union

from .framing import Frame, frame_at

__all__ = ["Counter", "TlogCount", "TlogError", "read_tlog"]

_STAMP = 8
_FIRST_US, _LAST_US = 946_684_800_000_000, 4_102_444_800_000_000  # the years 2000 to 2100
_SHORTEST = _STAMP + 8


class TlogError(ValueError):
    """A telemetry log cannot be read, or is none. Its text is one line."""


class TlogCount(NamedTuple):
    """What was in a log: good frames, frames with a wrong checksum, of unknown ids, bytes that were in no record."""

    good: int
    damaged: int
    unknown: int
    stray_bytes: int


class Counter:
    """Counts while a log is read."""

    def __init__(self) -> None:
        self.good = self.damaged = self.unknown = self.stray_bytes = 0

    @property
    def count(self) -> TlogCount:
        """What was counted so far."""
        return TlogCount(self.good, self.damaged, self.unknown, self.stray_bytes)


def read_tlog(path: Union[str, Path]) -> Tuple[Iterator[Tuple[int, Frame]], Counter]:
    """Return the frames of a log with their times in ns since 1970, in the order of the file, and what is counted.

    Raises:
        TlogError: It cannot be read, or no record is in its first part.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise TlogError(f"{path}: {error.strerror or 'cannot be read'}; must be a telemetry log") from None
    counter = Counter()
    if not any(True for _ in _records(data[:65536], Counter())):
        raise TlogError(f"{path}: has no MAVLink frame with a time; must be a telemetry log (.tlog)")
    return _records(data, counter), counter


def _records(data: bytes, tally: Counter) -> Iterator[Tuple[int, Frame]]:
    at, end = 0, len(data)
    while at + _SHORTEST <= end:
        stamp_us = int.from_bytes(data[at : at + _STAMP], "big")
        found = frame_at(data, at + _STAMP) if _FIRST_US <= stamp_us < _LAST_US else None
        if found is None:
            tally.stray_bytes += 1
            at += 1
            continue
        at += _STAMP + found.length
        if found.frame is not None:
            tally.good += 1
            yield stamp_us * 1000, found.frame
        elif found.known:
            tally.damaged += 1
        else:
            tally.unknown += 1
    tally.stray_bytes += max(0, end - at)
