"""The band on top of the screen: the state and its time left, large, on the colour of how things stand."""

from __future__ import annotations

from typing import List, Mapping, Optional

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from ..model import Desk, Snapshot
from ..words import clock, seconds
from .style import Style, Tone, tone_of_state

_ALARM = 3


def band(desk: Desk, now_s: float, width: int, style: Style) -> RenderableType:
    """Return the band. Lost contact and an alarm to the pilot come above it, then it is small itself."""
    snapshot = desk.snapshot
    if snapshot is None:
        return _waiting(desk, now_s, width, style)
    passed_s = desk.age_s(now_s)
    above = [_lost(desk, passed_s, width, style)] if desk.stale(now_s) else []
    if snapshot.message_level >= _ALARM:
        above.append(_fill([*_headline("TAKE OVER", "", width, style), snapshot.message], Tone.BAD, style))
    lines = _headline(_title(snapshot), _time_left(snapshot, passed_s), width, style, large=not above)
    state = _fill(
        [*lines, _situation(snapshot)], tone_of_state(snapshot.state, snapshot.result, snapshot.data_result), style
    )
    return Group(*above, state)


def _title(snapshot: Snapshot) -> str:
    return snapshot.state.replace("_", " ") or "UNKNOWN"


def _time_left(snapshot: Snapshot, passed_s: float) -> str:
    return "" if snapshot.time_left_s is None else clock(snapshot.time_left_s - passed_s)


def _headline(title: str, left: str, width: int, style: Style, *, large: bool = True) -> List[str]:
    """Return title and time in large letters, if they fit; else on one line."""
    letters, digits = banner(title, style.blocks), banner(left, style.blocks)
    inner = width - 2
    if large and letters is not None and digits is not None:
        gap = inner - len(letters[0]) - len(digits[0])
        if gap > 1:
            return [first + " " * gap + second for first, second in zip(letters, digits)]
        if len(letters[0]) <= inner:
            return [*letters, f"{left} left"] if left else letters
    words = f"{left} left" if left else ""
    return [f"{title:<{max(len(title) + 1, inner - len(words))}}{words}"]


def _situation(snapshot: Snapshot) -> str:
    """Return the line below the headline: step, flight, mission, file and repetition."""
    parts = [snapshot.step.replace("_", " ")] if snapshot.step else []
    if snapshot.result and snapshot.state == "MISSION_ENDED":
        parts.append(f"result {snapshot.result}")
        if snapshot.data_result:
            parts.append(f"data {snapshot.data_result}")
    parts.append("IN FLIGHT" if snapshot.in_flight else "not in flight")
    if snapshot.mission_id:
        parts.append(f"mission {snapshot.mission_id} {snapshot.mission_description}".strip())
    if snapshot.files > 1:
        parts.append(f"file {snapshot.file_index + 1} of {snapshot.files}")
    if snapshot.repetitions > 1:
        parts.append(f"repetition {snapshot.repetition + 1} of {snapshot.repetitions}")
    if snapshot.queue:
        parts.append(f"then mission {', '.join(snapshot.queue)}")
    if snapshot.limit:
        parts.append(f"time left: {snapshot.limit}")
    return " | ".join(parts)


def _lost(desk: Desk, passed_s: float, width: int, style: Style) -> RenderableType:
    lines = _headline("NO CONTACT", clock(passed_s), width, style)
    lines[-1] = lines[-1].replace(" left", " ago")
    words = (
        f"The engine ({desk.engine}) has been silent for {seconds(passed_s)}. Below is what it said last, it may have "
        "changed. If the vehicle flies, watch it and be ready to take over."
    )
    return _fill([*lines, words], Tone.BAD, style)


def _waiting(desk: Desk, now_s: float, width: int, style: Style) -> RenderableType:
    since = seconds(now_s - desk.started_s)
    what = desk.link or f"Waiting for the engine on {desk.engine}/state"
    words = [
        f"{what} ... {since}",
        "This goes on by itself once it is there. If it is not running: start the launch file.",
    ]
    return _fill([*_headline("WAITING", "", width, style), *words], Tone.WARN, style)


def _fill(lines: List[str], tone: Tone, style: Style, pad: Optional[int] = 1) -> RenderableType:
    text = Text("\n".join(line.rstrip() for line in lines), overflow="fold")
    return Padding(text, (0, pad or 0), style=style.band(tone), expand=True)


# --- banner -----------------------------------------------------------------------------------------------------------
# Large letters, three lines high, of half blocks: read across a field.


# Five rows of pixels a letter; "#" is set.
_FONT: Mapping[str, str] = {
    "A": ".##. #..# #### #..# #..#",
    "B": "###. #..# ###. #..# ###.",
    "C": ".### #... #... #... .###",
    "D": "###. #..# #..# #..# ###.",
    "E": "#### #... ###. #... ####",
    "F": "#### #... ###. #... #...",
    "G": ".### #... #.## #..# .###",
    "H": "#..# #..# #### #..# #..#",
    "I": "# # # # #",
    "J": "..# ..# ..# #.# .#.",
    "K": "#..# #.#. ##.. #.#. #..#",
    "L": "#... #... #... #... ####",
    "M": "#...# ##.## #.#.# #...# #...#",
    "N": "#..# ##.# #.## #..# #..#",
    "O": ".##. #..# #..# #..# .##.",
    "P": "###. #..# ###. #... #...",
    "Q": ".##. #..# #..# #.#. .#.#",
    "R": "###. #..# ###. #.#. #..#",
    "S": ".### #... .##. ...# ###.",
    "T": "##### ..#.. ..#.. ..#.. ..#..",
    "U": "#..# #..# #..# #..# .##.",
    "V": "#...# #...# .#.#. .#.#. ..#..",
    "W": "#...# #...# #.#.# ##.## #...#",
    "X": "#..# #..# .##. #..# #..#",
    "Y": "#...# .#.#. ..#.. ..#.. ..#..",
    "Z": "#### ..#. .#.. #... ####",
    "0": ".##. #..# #..# #..# .##.",
    "1": ".# ## .# .# .#",
    "2": "###. ...# .##. #... ####",
    "3": "###. ...# .##. ...# ###.",
    "4": "#..# #..# #### ...# ...#",
    "5": "#### #... ###. ...# ###.",
    "6": ".##. #... ###. #..# .##.",
    "7": "#### ...# ..#. .#.. .#..",
    "8": ".##. #..# .##. #..# .##.",
    "9": ".##. #..# .### ...# .##.",
    ":": ". # . # .",
    " ": ".. .. .. .. ..",
}


def banner(words: str, blocks: str) -> Optional[List[str]]:
    """Return the three lines of the words, all of the same width; None when a letter is not in the font.

    Args:
        words: capital letters, digits, ":" and blanks.
        blocks: the cells with neither half set, the lower, the upper, both; empty: there are no such characters.
    """
    if not blocks or any(letter not in _FONT for letter in words):
        return None
    letters = [_FONT[letter].split() for letter in words]
    pixels = [".".join(letter[row] for letter in letters) for row in range(5)]
    pixels.insert(0, "." * len(pixels[0]))
    return [
        "".join(blocks[2 * (upper == "#") + (lower == "#")] for upper, lower in zip(pixels[row], pixels[row + 1]))
        for row in (0, 2, 4)
    ]
