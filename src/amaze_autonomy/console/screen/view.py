"""The screen: a desk and the time made into what rich draws. Pure.

From top to bottom: the band (state and time left, large), the message with its advice, what is wrong, progress, the
table that the state is about, the log of messages; at the bottom, always visible: answer, question, keys. What does not
fit is cut from the middle, and is there when one scrolls; of a terminal that has no room for that the lower part of the
band is cut, and of one of a few lines all but the question and what answers it.
"""

from __future__ import annotations

from typing import Iterator, List, Mapping, Optional

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.padding import Padding
from rich.segment import Segment, Segments
from rich.table import Table
from rich.text import Text

from ..dialog import oldest_open
from ..keys import QUIT_KEY, offered
from ..model import Desk, Question, Snapshot
from ..words import clock, fraction, level, readings, seconds, waypoint_words, waypoints_reached
from .style import Style, Tone, tone_of_answer, tone_of_level, tone_of_state
from .tables import checks_table, failures_table, missions_table

_ALL = 10_000
_LEAST_LOG = 3
_NOTES = 8  # of the log, while nobody scrolls
_CHECK_STATES = ("PREFLIGHT", "OUTREACH", "READY", "START_RECORDING", "LOAD_MISSION")


class Screen:
    """Draws a desk as it is at one moment, into whatever size there is.

    Args:
        desk: what is shown.
        now_s: the time.
        style: how it looks.
        height: lines; None: as many as it takes.
    """

    def __init__(self, desk: Desk, now_s: float, style: Style, height: Optional[int] = None) -> None:
        self._desk, self._now_s, self._style, self._height = desk, now_s, style, height

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> List[Segments]:
        """Draw: the body gets the lines that band and footer leave."""
        width = options.max_width
        top = self._lines(console, options, band(self._desk, self._now_s, width, self._style))
        bottom = self._lines(console, options, footer(self._desk, self._now_s, width, self._style))
        middle = self._middle(console, options, _ALL)
        if self._height is not None:
            least = min(self._height, self._lines_asked(console, options))
            bottom = bottom[-max(1, self._height - 1, least) :]
            top = top[: self._height - len(bottom)]
            room = max(0, self._height - len(top) - len(bottom))
            middle = self._fitted(console, options, middle, room)
            middle += [[Segment(" " * width)]] * (room - len(middle))
        return [Segments([*line, Segment.line()]) for line in [*top, *middle, *bottom]]

    def _middle(self, console: Console, options: ConsoleOptions, room: int) -> List[List[Segment]]:
        middle: List[List[Segment]] = []
        for part in (self._news, self._checks, self._missions, self._log):
            for piece in part(options.max_width, room - len(middle)):
                middle += self._lines(console, options, piece)
        return middle

    def _fitted(
        self, console: Console, options: ConsoleOptions, whole: List[List[Segment]], room: int
    ) -> List[List[Segment]]:
        """Return what there is room for: the top, the least important left out, or from where it is scrolled to."""
        more = len(whole) > room or len(self._desk.notes) > _NOTES
        if not more or room < _LEAST_LOG:
            return whole[:room]
        start = min(self._desk.scroll, max(0, len(whole) - room + 1))
        shown = whole[start:] if start else self._middle(console, options, room - 1)
        if start and len(shown) < room:
            return shown
        hint = self._style.text(" Page Up, Page Down: the rest", Tone.QUIET)
        return shown[: room - 1] + self._lines(console, options, hint)[:1]

    def _lines_asked(self, console: Console, options: ConsoleOptions) -> int:
        question = self._desk.question
        if question is None:
            return 0
        return len(self._lines(console, options, Padding(_asked(question, self._style), (0, 1))))

    def _lines(self, console: Console, options: ConsoleOptions, part: RenderableType) -> List[List[Segment]]:
        return console.render_lines(part, options.update(height=None), pad=True)

    def _news(self, width: int, _room: int) -> Iterator[RenderableType]:
        """Return the message, what is wrong, and how far things are."""
        snapshot = self._desk.snapshot
        if snapshot is None:
            return
        yield ""
        yield _message(snapshot, self._style)
        yield from telemetry(snapshot, self._desk.age_s(self._now_s), self._style)
        if snapshot.failures:
            yield ""
            yield failures_table(snapshot, self._desk.age_s(self._now_s), self._style)
        yield from progress(self._desk, snapshot, self._now_s, width, self._style)

    def _checks(self, width: int, room: int) -> Iterator[RenderableType]:
        snapshot = self._desk.snapshot
        if snapshot is None or not snapshot.checks or snapshot.state not in _CHECK_STATES:
            return
        if snapshot.state != "OUTREACH" or not all(
            check.passed for check in snapshot.checks
        ):  # else it is not about them
            yield ""
            yield checks_table(self._desk.checks(self._now_s), width, room - 1, self._style)

    def _missions(self, _width: int, _room: int) -> Iterator[RenderableType]:
        if self._desk.snapshot is None or not self._desk.snapshot.takes_mission:
            return
        yield ""
        if self._desk.missions is None:
            yield self._style.text("Asking the engine for its missions ...")
        elif not self._desk.missions:
            yield self._style.text("The engine has no mission: look at its missions.yaml.", Tone.BAD)
        else:
            yield missions_table(self._desk.missions, self._style)

    def _log(self, _width: int, room: int) -> Iterator[RenderableType]:
        """Return the messages before the one that is shown large, the newest first; a heading alone is nothing."""
        notes = self._desk.notes
        if notes and self._desk.snapshot is not None and notes[-1].text == self._desk.snapshot.message:
            notes = notes[:-1]
        if not notes or room < _LEAST_LOG:
            return
        table = Table.grid(padding=(0, 2, 0, 0), expand=True)
        table.add_column(no_wrap=True)
        table.add_column(no_wrap=True)
        table.add_column(ratio=1, overflow="fold")
        for note in reversed(notes if self._desk.scroll else notes[-_NOTES:]):
            loud = self._style.label(level(note.level), tone_of_level(note.level)) if note.level > 0 else ""
            table.add_row(self._style.text(note.clock), loud, self._style.text(note.text))
        yield ""
        yield self._style.text("earlier messages", Tone.STRONG)
        yield table


def _message(snapshot: Snapshot, style: Style) -> RenderableType:
    """Return the message with its level, what is waited for, and the advice."""
    parts: List[RenderableType] = []
    if snapshot.message:
        tone = tone_of_level(snapshot.message_level) if snapshot.message_level > 0 else Tone.STRONG
        word = f"{level(snapshot.message_level)}  " if snapshot.message_level > 0 else ""
        parts.append(style.text(f"{word}{snapshot.message}", tone))
    if snapshot.waiting_for:
        parts.append(style.text(f"Waiting for: {snapshot.waiting_for}"))
    if snapshot.advice:
        parts.append(style.text(f"{style.arrow} {snapshot.advice}", Tone.STRONG))
    return Padding(Group(*parts), (0, 1))


# --- footer -----------------------------------------------------------------------------------------------------------
# The foot of the screen, always visible: the answer, what was wrong with the input, the question, the keys.


_SLOW_S = 1.0


def footer(desk: Desk, now_s: float, width: int, style: Style) -> RenderableType:
    """Return the foot of the screen."""
    parts = _said(desk, now_s, style)
    if desk.page:
        parts.append(style.text(f"the same as a page: {desk.page}", Tone.QUIET))
    if desk.question is not None:
        parts.append(_asked(desk.question, style))
    elif desk.interactive:
        parts.append(_keys(desk, now_s, style))
    return Group(style.text(style.rule * width), Padding(Group(*parts), (0, 1)))


def _asked(question: Question, style: Style) -> Text:
    yes = "Y or Enter = yes" if question.enter_is_yes else "Y = yes"
    return style.text(f"{question.text}  {yes}, any other key = no", Tone.WARN)


def _said(desk: Desk, now_s: float, style: Style) -> List[RenderableType]:
    """Return what became of the last request, or that there is no answer yet, and what was wrong with the input."""
    parts: List[RenderableType] = []
    request = oldest_open(desk)
    if request is not None and now_s - request.sent_s >= _SLOW_S:
        parts.append(style.text(f"{request.words}: no answer for {now_s - request.sent_s:.0f} s", Tone.WARN))
    elif request is not None:
        parts.append(style.text(f"{request.words}: asked ..."))
    answer = desk.answer
    if answer is not None:
        verdict = style.label(answer.verdict.value, tone_of_answer(answer.verdict))
        parts.append(Text.assemble(f"{answer.request}: ", verdict, f" {answer.message}", overflow="fold"))
    if desk.error:
        parts.append(style.text(desk.error, Tone.BAD))
    return parts


def _keys(desk: Desk, now_s: float, style: Style) -> Text:
    keys, heard = Text(overflow="fold"), desk.heard(now_s)
    if desk.snapshot is not None and desk.snapshot.takes_mission:
        what = "mission id, then Enter (several: 1 2 3)" if heard else "no contact: key, then Enter"
        keys.append(f"{what}: {desk.entry}{style.cursor}  ", style.band(Tone.STRONG))
        for binding in offered(desk.snapshot, heard=heard):
            keys.append_text(style.label(f"{binding.key.upper()} Enter", Tone.INFO)).append(f" {binding.words}  ")
        keys.append_text(style.label("Ctrl-C", Tone.INFO)).append(" close console only")
        return keys
    for binding in offered(desk.snapshot, heard=heard):
        keys.append_text(style.label(binding.key.upper(), Tone.INFO)).append(f" {binding.words}   ")
    keys.append_text(style.label(QUIT_KEY.upper(), Tone.INFO)).append(" close console only")
    return keys


# --- telemetry --------------------------------------------------------------------------------------------------------


def telemetry(snapshot: Snapshot, passed_s: float, style: Style) -> List[RenderableType]:
    """Return what the vehicle says of itself while it flies, what is to be looked at on a background.

    Args:
        snapshot: that says it.
        passed_s: since it was new.
        style: how it looks.
    """
    if not snapshot.in_flight or snapshot.telemetry.age is None:
        return []
    line = Text(overflow="fold")
    for each in readings(snapshot.telemetry, passed_s):
        limit = f" ({each.limit})" if each.warn and each.limit else ""
        value = style.text(f"{each.value}{limit}", Tone.WARN if each.warn else Tone.STRONG)
        line.append(f"{each.name} ").append_text(value).append("   ")
    return ["", Padding(line, (0, 1))]


# --- progress ---------------------------------------------------------------------------------------------------------
# How far things are: waypoints in flight, the recording while it is collected, the result at the end.


_COLLECTING = ("STOPPING", "RECOVERING", "TRANSFERRING", "MERGING", "VERIFYING", "COMPLETE")
_TROUBLE = "recorder   "
_FLYING = ("TAKEOFF", "MISSION", "HOLD", "LAND", "PILOT")


def progress(desk: Desk, snapshot: Snapshot, now_s: float, width: int, style: Style) -> List[RenderableType]:
    """Return the lines of progress that matter in the present state."""
    left_s = desk.remaining_s(now_s)
    bar = min(40, max(10, width - 45))
    lines: List[str] = []
    if snapshot.state in _FLYING and snapshot.waypoints > 0:
        done = min(1.0, waypoints_reached(snapshot) / snapshot.waypoints)
        lines.append(f"waypoint   {style.bar(done, bar)}  {waypoint_words(snapshot)}")
    if snapshot.recording_phase not in ("", "IDLE"):
        lines.append(f"recording  {_recording(snapshot, bar, style)}")
        if left_s is not None and snapshot.recording_phase in _COLLECTING:
            lines.append(f"time left  about {seconds(left_s)} of this step")
    lines.extend(f"{_TROUBLE}{trouble}" for trouble in desk.troubles(now_s))
    if snapshot.data_location:
        lines.append(f"data       {snapshot.data_location}")
    texts = [style.text(line, _tone(snapshot, line)) for line in lines]
    return ["", Padding(Group(*texts), (0, 1))] if lines else []


def _tone(snapshot: Snapshot, line: str) -> Tone:
    if line.startswith(_TROUBLE):
        return Tone.WARN
    return Tone.STRONG if snapshot.state == "MISSION_ENDED" and line.startswith("data") else Tone.PLAIN


def _recording(snapshot: Snapshot, bar: int, style: Style) -> str:
    phase, done = snapshot.recording_phase, snapshot.recording_progress
    place = _step(phase)
    if done is None or phase not in _COLLECTING:
        return f"{'running' if phase == 'RECORDING' else phase.lower()}{place}"
    return f"{style.bar(done, bar)}  {fraction(done)} {phase.lower()}{place}"


def _step(phase: str) -> str:
    number: Optional[int] = _COLLECTING.index(phase) + 1 if phase in _COLLECTING[:-1] else None
    return "" if number is None else f", step {number} of {len(_COLLECTING) - 1}"


# --- band -------------------------------------------------------------------------------------------------------------
# The band on top of the screen: the state and its time left, large, on the colour of how things stand.


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
