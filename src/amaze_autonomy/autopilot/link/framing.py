"""Finds MAVLink frames in bytes, of version 1 and 2, however they are cut and whatever lies between them.

A frame whose checksum fits is one. A frame of an id that the dialect does not know cannot be checked: it is believed to
be one when the next frame, or the end of the bytes, follows it directly. Anything else is stepped over byte by byte, so
that a damaged length costs no good frame. What is kept is never longer than a frame.
"""

from __future__ import annotations

import binascii
from pathlib import Path
from typing import Iterator, List, Mapping, NamedTuple, Optional, Tuple, Union

from .dialect import mavlink

V1, V2 = 0xFE, 0xFD
_HEADER = {V1: 6, V2: 10}
_MAGICS = (V1, V2)
_SIGNED = 0x01
_SIGNATURE = 13
_CHECKSUM = 2
LONGEST = 10 + 255 + _CHECKSUM + _SIGNATURE
_CRC_EXTRA: Mapping[int, int] = {number: kind.crc_extra for number, kind in mavlink.mavlink_map.items()}


class Frame(NamedTuple):
    """One frame whose checksum fits.

    Args:
        number: id of the message.
        sequence: of its sender, 0..255.
        system: that sent it.
        component: that sent it.
        payload: without trailing zeros (version 2).
        raw: the whole frame.
        signed: a signature is its end.
    """

    number: int
    sequence: int
    system: int
    component: int
    payload: bytes
    raw: bytes
    signed: bool


class Found(NamedTuple):
    """What lies where a frame may begin: its length, the frame when its checksum fits, whether its id is known."""

    length: int
    frame: Optional[Frame]
    known: bool


class FrameTally:
    """What became of the bytes: frames, bytes that were in none, frames of unknown ids."""

    def __init__(self) -> None:
        self.good = self.damaged_bytes = self.unknown = 0


class FrameReader:
    """Takes bytes as they come, gives frames.

    Args:
        tally: to count in; shared by the readers of one link.
    """

    def __init__(self, tally: Optional[FrameTally] = None) -> None:
        self.tally = tally or FrameTally()
        self._rest = b""

    @property
    def kept(self) -> int:
        """How many bytes wait for the rest of their frame."""
        return len(self._rest)

    def feed(self, data: bytes) -> List[Frame]:
        """Return the frames that these bytes complete."""
        buffer = self._rest + data if self._rest else data
        frames: List[Frame] = []
        at, end = 0, len(buffer)
        while at < end:
            if buffer[at] not in _MAGICS:
                at = self._skip(buffer, at)
                continue
            length = _length(buffer, at)
            if length is None or at + length > end:
                break
            frame, known = _frame(buffer, at, length)
            if frame is not None:
                frames.append(frame)
            elif known or not _plausible(buffer, at, length):
                self.tally.damaged_bytes += 1
                at += 1
                continue
            else:
                self.tally.unknown += 1
            at += length
        self.tally.good += len(frames)
        self._rest = buffer[at:]
        return frames

    def _skip(self, buffer: bytes, at: int) -> int:
        """Return where the next frame may begin."""
        starts = [found for found in (buffer.find(magic, at) for magic in _MAGICS) if found >= 0]
        start = min(starts) if starts else len(buffer)
        self.tally.damaged_bytes += start - at
        return start


def frame_at(buffer: bytes, at: int) -> Optional[Found]:
    """Return what begins here; None: nothing that could be a frame, or not all of it."""
    if at >= len(buffer) or buffer[at] not in _MAGICS:
        return None
    length = _length(buffer, at)
    if length is None or at + length > len(buffer):
        return None
    frame, known = _frame(buffer, at, length)
    return Found(length, frame, known)


def _length(buffer: bytes, at: int) -> Optional[int]:
    """Return the length of the frame that would begin here; None: its header is not complete."""
    magic = buffer[at]
    if len(buffer) - at < _HEADER[magic]:
        return None
    signature = _SIGNATURE if magic == V2 and buffer[at + 2] & _SIGNED else 0
    return _HEADER[magic] + buffer[at + 1] + _CHECKSUM + signature


def _frame(buffer: bytes, at: int, length: int) -> Tuple[Optional[Frame], bool]:
    """Return the frame, or None, and whether its id is known."""
    head = _HEADER[buffer[at]]
    end = at + head + buffer[at + 1]
    raw = buffer[at : at + length]
    number, sequence, system, component, flags = _header(raw)
    extra = _CRC_EXTRA.get(number)
    if extra is None:
        return None, False
    body = raw[1 : end - at]
    if flags & ~_SIGNED or crc16(body + bytes((extra,))) != buffer[end] | buffer[end + 1] << 8:
        return None, True
    return Frame(number, sequence, system, component, raw[head : end - at], raw, bool(flags & _SIGNED)), True


def _header(raw: bytes) -> Tuple[int, int, int, int, int]:
    if raw[0] == V1:
        return raw[5], raw[2], raw[3], raw[4], 0
    return raw[7] | raw[8] << 8 | raw[9] << 16, raw[4], raw[5], raw[6], raw[2]


def _plausible(buffer: bytes, at: int, length: int) -> bool:
    """Tell whether a frame that cannot be checked ends where the next begins."""
    return at + length == len(buffer) or buffer[at + length] in _MAGICS


# --- crc --------------------------------------------------------------------------------------------------------------
# The checksum of MAVLink (CRC-16/MCRF4XX) at the speed of C.
#
# It is the CCITT polynomial of `binascii.crc_hqx` with all bits in the other order: so bytes go in reversed, and the
# result is reversed. https://mavlink.io/en/guide/serialization.html#checksum


_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_START = 0xFFFF


def crc16(data: bytes) -> int:
    """Return the checksum of bytes."""
    turned = binascii.crc_hqx(data.translate(_REVERSED), _START)
    return _REVERSED[turned & 0xFF] << 8 | _REVERSED[turned >> 8]


# --- tlog -------------------------------------------------------------------------------------------------------------
# Telemetry logs (.tlog): each frame with the time at which a ground station or pymavlink had it.
#
# A record is 8 bytes of microseconds since 1970, the most significant first, and a frame. There is no header and no
# checksum of its own. Where a record cannot be one, the reader steps on byte by byte until the next can.


_STAMP = 8
_FIRST_US, _LAST_US = 946_684_800_000_000, 4_102_444_800_000_000  # the years 2000 to 2100
_SHORTEST = _STAMP + 8


class TlogError(ValueError):
    """A telemetry log cannot be read, or is none. Its text is one line."""


class TlogCount(NamedTuple):
    """What was in a log.

    Args:
        good: frames.
        damaged: frames with a wrong checksum.
        unknown: frames of unknown ids.
        stray_bytes: that were in no record.
        cut_bytes: those of them behind the last record.
    """

    good: int
    damaged: int
    unknown: int
    stray_bytes: int
    cut_bytes: int = 0


class Counter:
    """Counts while a log is read."""

    def __init__(self) -> None:
        self.good = self.damaged = self.unknown = self.stray_bytes = self.cut_bytes = 0

    @property
    def count(self) -> TlogCount:
        """What was counted so far."""
        return TlogCount(self.good, self.damaged, self.unknown, self.stray_bytes, self.cut_bytes)


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
    at, last, end = 0, 0, len(data)
    while at + _SHORTEST <= end:
        stamp_us = int.from_bytes(data[at : at + _STAMP], "big")
        found = frame_at(data, at + _STAMP) if _FIRST_US <= stamp_us < _LAST_US else None
        if found is None:
            tally.stray_bytes += 1
            at += 1
            continue
        at = last = at + _STAMP + found.length
        if found.frame is not None:
            tally.good += 1
            yield stamp_us * 1000, found.frame
        elif found.known:
            tally.damaged += 1
        else:
            tally.unknown += 1
    tally.stray_bytes += max(0, end - at)
    tally.cut_bytes = end - last
