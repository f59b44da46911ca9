"""STATUSTEXT as PX4 sends it: in chunks of 50 bytes; most texts once more as an event, which the trailing tab tells."""

from __future__ import annotations

import zlib
from typing import Any, List

from pymavlink.dialects.v20 import common as mavlink

from .wire import event

__all__ = ["Texts"]

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
