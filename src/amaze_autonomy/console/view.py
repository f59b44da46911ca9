"""The screen: a desk and the time made into what rich draws. Pure.

From top to bottom: the band (state and time left, large), the message with its advice, what is wrong, progress, the
table that the state is about, the log of messages; at the bottom, always visible: answer, question, keys. What does not
fit is cut from the middle, never from the band or the keys.
"""

from __future__ import annotations

from typing import List, Optional, Tuple

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

__all__ = ["Screen"]

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
        room = None if self._height is None else max(0, self._height - len(top) - len(bottom))
        middle: List[List[Segment]] = []
        for part in self._body(width, room):
            middle += self._lines(console, options, part)
        if room is not None:
            middle = middle[:room] + [[Segment(" " * width)]] * (room - len(middle))
        return [Segments([*line, Segment.line()]) for line in [*top, *middle, *bottom]]

    def _lines(self, console: Console, options: ConsoleOptions, part: RenderableType) -> List[List[Segment]]:
        return console.render_lines(part, options.update(height=None), pad=True)

    def _body(self, width: int, room: Optional[int]) -> Tuple[RenderableType, ...]:
        snapshot = self._desk.snapshot
        if snapshot is None:
            return ()
        passed_s = self._desk.age_s(self._now_s)
        parts: List[RenderableType] = ["", _message(snapshot, self._style)]
        if snapshot.failures:
            parts += ["", failures_table(snapshot.failures, passed_s, self._style)]
        parts += progress(snapshot, width, self._style)
        if snapshot.checks and snapshot.state in _CHECK_STATES:
            rows = None if room is None else room - 7
            parts += ["", checks_table(snapshot.checks, width, rows, self._style)]
        if snapshot.takes_mission:
            parts += ["", self._missions()]
        return (*parts, *self._log(snapshot))

    def _missions(self) -> RenderableType:
        if self._desk.missions is None:
            return self._style.text("Asking the engine for its missions ...")
        if not self._desk.missions:
            return self._style.text("The engine has no mission: look at its missions.yaml.", Tone.BAD)
        return missions_table(self._desk.missions, self._style)

    def _log(self, snapshot: Snapshot) -> Tuple[RenderableType, ...]:
        """Return the messages before the one that is shown large, the newest first."""
        notes = self._desk.notes
        if notes and notes[-1].text == snapshot.message:
            notes = notes[:-1]
        if not notes:
            return ()
        table = Table.grid(padding=(0, 2, 0, 0), expand=True)
        table.add_column(no_wrap=True)
        table.add_column(no_wrap=True)
        table.add_column(ratio=1, overflow="fold")
        for note in reversed(notes[-8:]):
            words = ("info", "WARNING", "ERROR")[min(2, max(0, note.level))]
            tone = tone_of_level(note.level) if note.level > 0 else Tone.PLAIN
            table.add_row(self._style.text(note.clock), self._style.label(words, tone), self._style.text(note.text))
        return ("", self._style.text("earlier messages", Tone.STRONG), table)


def _message(snapshot: Snapshot, style: Style) -> RenderableType:
    """Return the message with its level, what is waited for, and the advice."""
    parts: List[RenderableType] = []
    if snapshot.message:
        tone = tone_of_level(snapshot.message_level) if snapshot.message_level > 0 else Tone.STRONG
        word = ("", "WARNING  ", "ERROR  ")[min(2, max(0, snapshot.message_level))]
        parts.append(style.text(f"{word}{snapshot.message}", tone))
    if snapshot.waiting_for:
        parts.append(style.text(f"Waiting for: {snapshot.waiting_for}"))
    if snapshot.advice:
        parts.append(style.text(f"{style.arrow} {snapshot.advice}", Tone.STRONG))
    return Padding(Group(*parts), (0, 1))
