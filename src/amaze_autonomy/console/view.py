"""The screen: a desk and the time made into what rich draws. Pure.

From top to bottom: the band (state and time left, large), the message with its advice, what is wrong, progress, the
table that the state is about, the log of messages; at the bottom, always visible: answer, question, keys. What does not
fit is cut from the middle, never from the band or the keys.
"""

from __future__ import annotations

from typing import Iterator, List, Optional

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.padding import Padding
from rich.segment import Segment, Segments
from rich.table import Table

from .band import band
from .footer import footer
from .model import Desk, Snapshot
from .progress import progress
from .style import Style, Tone, tone_of_level
from .tables import checks_table, failures_table, missions_table
from .words import level

__all__ = ["Screen"]

_ALL = 10_000
_LEAST_LOG = 3
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
        room = _ALL if self._height is None else max(0, self._height - len(top) - len(bottom))
        middle: List[List[Segment]] = []
        for part in (self._news, self._checks, self._missions, self._log):
            for piece in part(width, room - len(middle)):
                middle += self._lines(console, options, piece)
        if self._height is not None:
            middle = middle[:room] + [[Segment(" " * width)]] * (room - len(middle))
        return [Segments([*line, Segment.line()]) for line in [*top, *middle, *bottom]]

    def _lines(self, console: Console, options: ConsoleOptions, part: RenderableType) -> List[List[Segment]]:
        return console.render_lines(part, options.update(height=None), pad=True)

    def _news(self, width: int, _room: int) -> Iterator[RenderableType]:
        """Return the message, what is wrong, and how far things are."""
        snapshot = self._desk.snapshot
        if snapshot is None:
            return
        yield ""
        yield _message(snapshot, self._style)
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
            yield checks_table(snapshot.checks, width, room - 1, self._style)

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
        for note in reversed(notes[-8:]):
            words = level(note.level) if note.level > 0 else "info"
            tone = tone_of_level(note.level) if note.level > 0 else Tone.PLAIN
            table.add_row(self._style.text(note.clock), self._style.label(words, tone), self._style.text(note.text))
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
