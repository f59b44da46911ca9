"""Bytes of a terminal made into keys. Pure.

A key is the letter itself, or one of "enter", "escape", "backspace", "clear" (Ctrl-U), "quit" (Ctrl-C, Ctrl-D), "up",
"down", "page up", "page down". Other function keys, mouse reports and everything that is pasted are nothing: pasted
text must never land a vehicle.
"""

from __future__ import annotations

import codecs
import re
import unicodedata
from typing import List, Mapping, Optional

__all__ = ["KeyDecoder"]

_CONTROLS: Mapping[str, str] = {
    "\r": "enter",
    "\n": "enter",
    "\x7f": "backspace",
    "\x08": "backspace",
    "\x15": "clear",
    "\x03": "quit",
    "\x04": "quit",
}
_SCROLLS: Mapping[str, str] = {
    "\x1b[A": "up",
    "\x1bOA": "up",
    "\x1b[B": "down",
    "\x1bOB": "down",
    "\x1b[5~": "page up",
    "\x1b[6~": "page down",
}
_NO_LETTERS = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
_PASTE, _PASTE_END = "\x1b[200~", "\x1b[201~"
_SEQUENCE = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|O[ -~]|[^\[O\x1b])")
_LONGEST_SEQUENCE = 40


class KeyDecoder:
    """Remembers what has come of a sequence that is not complete."""

    def __init__(self) -> None:
        self._decode = codecs.getincrementaldecoder("utf-8")("replace")
        self._rest = ""
        self._pasting = False

    def feed(self, data: bytes) -> List[str]:
        """Return the keys that are complete with these bytes."""
        self._rest += self._decode.decode(data)
        keys: List[str] = []
        while self._rest:
            if self._pasting:
                if not self._skip_paste():
                    break
            elif self._rest[0] != "\x1b":
                keys += _key(self._rest[0])
                self._rest = self._rest[1:]
            else:
                found = self._take_sequence()
                if found is None:
                    break
                keys += found
        return keys

    def flush(self) -> List[str]:
        """Return "escape" when nothing followed an ESC: to be called after a pause."""
        if self._pasting or not self._rest:
            return []
        lone, self._rest = self._rest == "\x1b", ""
        return ["escape"] if lone else []

    def _skip_paste(self) -> bool:
        """Drop what is pasted up to its end mark; return False when the mark has not come yet."""
        at = self._rest.find(_PASTE_END)
        if at < 0:
            self._rest = self._rest[-len(_PASTE_END) + 1 :]
            return False
        self._rest, self._pasting = self._rest[at + len(_PASTE_END) :], False
        return True

    def _take_sequence(self) -> Optional[List[str]]:
        """Take one escape sequence and return its key, mostly none; None when it is not complete."""
        found = _SEQUENCE.match(self._rest)
        if found is None:
            if len(self._rest) > _LONGEST_SEQUENCE:
                self._rest = ""
            return None
        self._rest = self._rest[found.end() :]
        self._pasting = found.group() == _PASTE
        return [_SCROLLS[found.group()]] if found.group() in _SCROLLS else []


def _key(letter: str) -> List[str]:
    if letter in _CONTROLS:
        return [_CONTROLS[letter]]
    return [letter] if letter != "\ufffd" and unicodedata.category(letter) not in _NO_LETTERS else []
