"""MAVLink 2 signing: who has the key is believed, a frame that was recorded and sent again is not.

https://mavlink.io/en/guide/message_signing.html: 6 bytes of SHA-256 over key, frame, link id and a time stamp of 10 us
since 2015 that must grow in each stream (system, component, link). The time of a stream that is heard for the first
time may lie at most a minute behind ours.
"""

from __future__ import annotations

import hashlib
import hmac
import stat
from pathlib import Path
from typing import Dict, Optional, Protocol, Tuple

from ..errors import KeyFileError
from .dialect import mavlink
from .framing import Frame

__all__ = ["KEY_BYTES", "SigningKey", "Stamps", "Verifier", "read_key"]

KEY_BYTES = 32
_EPOCH_2015_S = 1_420_070_400
_UNIT_NS = 10_000
_MINUTE = 60 * 100_000
_TAIL = 6
_STREAMS_KEPT = 64
_NEVER_SIGNED = (mavlink.MAVLINK_MSG_ID_RADIO_STATUS,)  # made by the radio, which has no key
_FORM = "must be 64 hexadecimal digits, or 32 bytes as they are"

SigningKey = bytes


def read_key(path: Path) -> SigningKey:
    """Return the key in a file of 64 hexadecimal digits or of exactly 32 bytes.

    Raises:
        KeyFileError: It cannot be read, is no key, or others may read it.
    """
    try:
        mode, content = path.stat().st_mode, path.read_bytes()
    except OSError as error:
        raise KeyFileError(str(path), error.strerror or "cannot be read", "must be a file with the key") from None
    if stat.S_IMODE(mode) & 0o077:
        raise KeyFileError(str(path), "others may read or write the key", f"do: chmod 600 {path}")
    if len(content) == KEY_BYTES:
        return content
    try:
        key = bytes.fromhex(content.decode("ascii").strip())
    except ValueError:
        raise KeyFileError(str(path), "holds no key", _FORM) from None
    if len(key) != KEY_BYTES:
        raise KeyFileError(str(path), f"holds {len(key)} bytes", _FORM)
    return key


def time_stamp(unix_ns: int) -> int:
    """Return a wall time as signatures have it."""
    return max(0, (unix_ns - _EPOCH_2015_S * 1_000_000_000) // _UNIT_NS)


class Stamps(Protocol):
    """Whoever keeps the time stamp over a restart."""

    newest: int

    def use(self, stamp: int) -> None:
        """Note that a time stamp is used."""

    def close(self) -> None:
        """Note that none will follow."""


class Verifier:
    """Judges the signatures of what comes in, and keeps the time stamp of what goes out.

    Args:
        key: shared with the vehicle.
        stamps: where the time stamp is kept; None: in memory.
    """

    def __init__(self, key: SigningKey, stamps: Optional[Stamps] = None) -> None:
        self.key = key
        self.refused = 0
        self._stamps = stamps
        self._newest = 0 if stamps is None else stamps.newest
        self._streams: Dict[Tuple[int, int, int], int] = {}

    def accepts(self, frame: Frame, unix_ns: int) -> bool:
        """Tell whether a frame is from somebody who has the key, and new."""
        good = frame.number in _NEVER_SIGNED or (frame.signed and self._verified(frame, unix_ns))
        self.refused += not good
        return good

    def stamp(self, unix_ns: int) -> int:
        """Return the time stamp of the next frame that goes out."""
        self._newest = max(self._newest + 1, time_stamp(unix_ns))
        if self._stamps is not None:
            self._stamps.use(self._newest)
        return self._newest

    def close(self) -> None:
        """Keep the time stamp; nothing more goes out."""
        if self._stamps is not None:
            self._stamps.close()

    def _verified(self, frame: Frame, unix_ns: int) -> bool:
        signed, tail = frame.raw[:-_TAIL], frame.raw[-_TAIL:]
        if not hmac.compare_digest(hashlib.sha256(self.key + signed).digest()[:_TAIL], tail):
            return False
        stamp = int.from_bytes(signed[-6:], "little")
        stream = (frame.system, frame.component, signed[-7])
        before = self._streams.get(stream)
        if not self._fresh(stamp, before, unix_ns) or (before is None and len(self._streams) >= _STREAMS_KEPT):
            return False
        self._streams[stream] = stamp
        self._newest = max(self._newest, stamp)
        return True

    def _fresh(self, stamp: int, before: Optional[int], unix_ns: int) -> bool:
        if before is not None:
            return stamp > before
        return stamp + _MINUTE >= max(self._newest, time_stamp(unix_ns))
