"""MAVLink frames of the simulated vehicle: bytes to messages and back; messages that the dialect does not know."""

from __future__ import annotations

import struct
import zlib
from typing import Any, List

from pymavlink.dialects.v20 import common as mavlink

__all__ = ["Framing", "Texts", "current_mode", "event", "sequence"]


class Framing:
    """The two directions of one connection; damaged and foreign bytes are passed over.

    Args:
        system: whose frames go out.
        component: likewise.
    """

    def __init__(self, system: int, component: int) -> None:
        self._mav: Any = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._mav.robust_parsing = True

    def encode(self, message: Any) -> bytes:
        """Return the frame of a message; each takes the next sequence number."""
        frame = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return bytes(frame)

    def decode(self, data: bytes) -> List[Any]:
        """Return the messages that are complete with these bytes."""
        messages = self._mav.parse_buffer(data) or []
        return [message for message in messages if message.get_type() != "BAD_DATA"]


class _Raw:
    """A message that the dialect has no class for.

    Args:
        number: of the message.
        name: of the message.
        payload: its bytes.
        extra: that its checksum ends with.
    """

    def __init__(self, number: int, name: str, payload: bytes, extra: int) -> None:
        self._number, self._name, self._extra = number, name, extra
        self._payload = payload.rstrip(b"\0") or b"\0"

    def get_type(self) -> str:
        """Return the name, as pymavlink's messages do."""
        return self._name

    def pack(self, mav: Any) -> bytes:
        """Return the frame, as pymavlink's messages do."""
        head = struct.pack("<BBBBBB", len(self._payload), 0, 0, mav.seq, mav.srcSystem, mav.srcComponent)
        body = head + self._number.to_bytes(3, "little") + self._payload
        checksum = mavlink.x25crc(body)
        checksum.accumulate(bytes((self._extra,)))
        return b"\xfd" + body + struct.pack("<H", checksum.crc)


def event(number: int, t_ms: int, sequence: int, log_level: int) -> Any:
    """Make an EVENT: what PX4 sends beside a STATUSTEXT that ends with a tab."""
    payload = struct.pack("<IIHBBB40s", number, t_ms, sequence & 0xFFFF, 0, 0, log_level, b"")
    return _Raw(410, "EVENT", payload, 160)


def current_mode(custom_mode: int, intended_mode: int, standard_mode: int = 0) -> Any:
    """Make a CURRENT_MODE."""
    return _Raw(436, "CURRENT_MODE", struct.pack("<IIB", custom_mode, intended_mode, standard_mode), 193)


def sequence(number: int) -> Any:
    """Make a CURRENT_EVENT_SEQUENCE."""
    return _Raw(411, "CURRENT_EVENT_SEQUENCE", struct.pack("<HB", number & 0xFFFF, 0), 106)


# --- texts ------------------------------------------------------------------------------------------------------------
# STATUSTEXT as PX4 sends it: in chunks of 50 bytes; most texts once more as an event, which the trailing tab tells.


_CHUNK = 50


class Texts:
    """Numbers what is told."""

    def __init__(self) -> None:
        self._number = 0
        self.events = 0

    def chunks(self, severity: int, text: str) -> List[Any]:
        """Make the messages of a text."""
        data = text.encode("ascii", "replace")
        self._number = self._number % 65535 + 1
        parts = [data[start : start + _CHUNK] for start in range(0, len(data), _CHUNK)] or [b""]
        return [mavlink.MAVLink_statustext_message(severity, part, self._number, n) for n, part in enumerate(parts)]

    def event(self, t_ms: int, severity: int, text: str) -> List[Any]:
        """Make the event of a text that has one."""
        if not text.endswith("\t"):
            return []
        self.events += 1
        return [event(zlib.crc32(text.encode("ascii", "replace")), t_ms, self.events, severity << 4 | severity)]
