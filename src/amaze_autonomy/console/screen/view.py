"""The screen: a desk and the time made into what rich draws. Pure.

From top to bottom: the band (state and time left, large), the message with its advice, what is wrong, progress, the
table that the state is about, the log of messages; at the bottom, always visible: answer, question, keys. What does not
fit is cut from the middle, and is there when one scrolls; of a terminal that has no room for that the lower part of the
band is cut, never its first line, nor the question or the keys.
"""

from __future__ import annotations

from typing import Iterator, List, Optional

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.padding import Padding
from rich.segment import Segment, Segments
from rich.table import Table
from rich.text import Text

from ..dialog import oldest_open
from ..keys import QUIT_KEY, offered
from ..model import Desk, Snapshot
from ..words import fraction, level, readings, seconds, waypoint_words, waypoints_reached
from .band import band
from .style import Style, Tone, tone_of_answer, tone_of_level
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
            bottom = bottom[-max(1, self._height - 1) :]
            top = top[: max(1, self._height - len(bottom))]
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
        return shown[: room - 1] + self._lines(console, options, hint)

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
        yes = "Y or Enter = yes" if desk.question.enter_is_yes else "Y = yes"
        parts.append(style.text(f"{desk.question.text}  {yes}, any other key = no", Tone.WARN))
    elif desk.interactive:
        parts.append(_keys(desk, now_s, style))
    return Group(style.text(style.rule * width), Padding(Group(*parts), (0, 1)))


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
