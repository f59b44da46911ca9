"""All colour and all unicode of the console, with an ASCII fallback. No other module names either.

A colour that carries a warning is a background: it is read in sunlight, and on dark and light terminals alike. None
carries a meaning alone: the word always stands beside it. Only texts go in, never markup.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Mapping

from rich import box
from rich.text import Text

from ...engine.events import Verdict as CheckVerdict
from ...engine.rules import Code
from ..model import Verdict


class Tone(enum.Enum):
    """How something is meant."""

    PLAIN = "plain"
    STRONG = "strong"
    QUIET = "quiet"
    INFO = "info"
    GOOD = "good"
    WARN = "warn"
    BAD = "bad"
    PILOT = "pilot"


_BANDS: Mapping[Tone, str] = {
    Tone.PLAIN: "",
    Tone.STRONG: "bold",
    Tone.QUIET: "",
    Tone.INFO: "bold #ffffff on #005f9f",
    Tone.GOOD: "bold #000000 on #5fd75f",
    Tone.WARN: "bold #000000 on #ffd700",
    Tone.BAD: "bold #ffffff on #c00000",
    Tone.PILOT: "bold #ffffff on #8700af",
}

_STATES: Mapping[str, Tone] = {
    "MISSION_INPUT": Tone.INFO,
    "PREFLIGHT": Tone.INFO,
    "OUTREACH": Tone.WARN,
    "READY": Tone.GOOD,
    "START_RECORDING": Tone.INFO,
    "LOAD_MISSION": Tone.INFO,
    "TAKEOFF": Tone.GOOD,
    "MISSION": Tone.GOOD,
    "HOLD": Tone.WARN,
    "LAND": Tone.BAD,
    "PILOT": Tone.PILOT,
    "DATA_CLEANUP": Tone.INFO,
}

_RESULTS: Mapping[str, Tone] = {"COMPLETE": Tone.GOOD}

_CHECKS: Mapping[CheckVerdict, Tone] = {
    CheckVerdict.PASS: Tone.GOOD,
    CheckVerdict.WARN: Tone.WARN,
    CheckVerdict.FAIL: Tone.BAD,
    CheckVerdict.UNKNOWN: Tone.BAD,
}

_ANSWERS: Mapping[Verdict, Tone] = {
    Verdict.DONE: Tone.GOOD,
    Verdict.ALREADY: Tone.INFO,
    Verdict.REFUSED: Tone.BAD,
    Verdict.NO_ANSWER: Tone.BAD,
}


def tone_of_state(state: str, result: str, data_result: str = "") -> Tone:
    """Return the tone of a state; one that nobody knows warns."""
    if state == "MISSION_ENDED" and data_result == "INCOMPLETE":
        return Tone.BAD
    if state == "MISSION_ENDED":
        return _RESULTS.get(result, Tone.WARN)
    return _STATES.get(state, Tone.WARN)


def tone_of_check(verdict: CheckVerdict) -> Tone:
    """Return the tone of a row of the pre-flight table."""
    return _CHECKS[verdict]


def tone_of_answer(verdict: Verdict) -> Tone:
    """Return the tone of an answer."""
    return _ANSWERS[verdict]


def tone_of_level(level: int) -> Tone:
    """Return the tone of a message: 0 OK, 1 warning, 2 error, 3 and above alarm."""
    return Tone.INFO if level <= 0 else Tone.WARN if level == 1 else Tone.BAD


def tone_of_code(code: int, action: str) -> Tone:
    """Return the tone of a failure: what is done about it first, then how severe it is."""
    if action == "pilot":
        return Tone.PILOT
    if action == "land" or code >= Code.ABORT:
        return Tone.BAD
    return Tone.WARN if action == "wait" or code >= Code.INCONVENIENT else Tone.INFO


@dataclass(frozen=True)
class Style:
    """How things look.

    Args:
        box: of tables.
        rule: the line above the keys.
        full, empty: of a progress bar.
        arrow: before advice.
        cursor: where is typed.
        blocks: (neither, lower, upper, both) halves of a cell, for large letters; empty: there are none.
    """

    box: box.Box
    rule: str
    full: str
    empty: str
    arrow: str
    cursor: str
    blocks: str

    def text(self, words: str, tone: Tone = Tone.PLAIN) -> Text:
        """Return words in a tone: backgrounds where the tone warns. Never read as markup."""
        return Text(words, style=_BANDS[tone], overflow="fold")

    def label(self, words: str, tone: Tone) -> Text:
        """Return a short word on the background of its tone, with a blank on either side."""
        return self.text(f" {words} ", tone)

    def band(self, tone: Tone) -> str:
        """Return rich's style for a whole line in a tone."""
        return _BANDS[tone]

    def bar(self, fraction: float, width: int) -> str:
        """Return a progress bar of a width in cells."""
        done = round(min(1.0, max(0.0, fraction)) * width)
        return self.full * done + self.empty * (width - done)


_ASCII_TABLE = box.Box("    \n    \n -- \n    \n    \n    \n    \n    \n", ascii=True)
_UNICODE_TABLE = box.Box("    \n    \n ── \n    \n    \n    \n    \n    \n")

UNICODE = Style(box=_UNICODE_TABLE, rule="─", full="█", empty="░", arrow="→", cursor="▏", blocks=" ▄▀█")
ASCII = Style(box=_ASCII_TABLE, rule="-", full="#", empty=".", arrow="->", cursor="_", blocks="")
