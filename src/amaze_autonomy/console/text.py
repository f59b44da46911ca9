"""Texts from elsewhere made harmless: nothing that comes over the wire or the keyboard may steer a terminal."""

from __future__ import annotations

import re
import unicodedata

__all__ = ["LIMIT", "clean"]

LIMIT = 500
"""Longest text that is shown, in characters."""

# Escape sequences as a terminal reads them (ECMA-48): CSI; the strings OSC, DCS, SOS, PM and APC; two-byte ones.
_SEQUENCE = re.compile(
    r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]?"
    r"|(?:\x1b[\]PX^_]|[\x9d\x90\x98\x9e\x9f])[^\x07\x1b\x9c]*(?:\x07|\x1b\\|\x9c)?"
    r"|\x1b[ -/]*[0-~]?"
)
_SPACE = re.compile(r"\s+")
# Cc: C0 and C1 controls. Cf: invisible ones, some turn the direction of writing. Cs, Co, Cn: not characters.
_HARMFUL = ("Cc", "Cf", "Cs", "Co", "Cn")


def clean(text: str, limit: int = LIMIT) -> str:
    """Return the text on one line, without what a terminal would obey or hide, cut to `limit` characters.

    Escape sequences vanish, white space of any kind becomes one blank, other controls become "?".
    """
    text = _SPACE.sub(" ", _SEQUENCE.sub("", text[: 4 * limit])).strip()
    text = "".join("?" if unicodedata.category(letter) in _HARMFUL else letter for letter in text)
    return text if len(text) <= limit else text[: limit - 3] + "..."
