"""The full screen: draws the desk when it looks different, and passes keys on. One thread."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import List, Optional

from rich.console import Console
from rich.live import Live
from rich.segment import Segment, Segments

from ..session import Session
from ..terminal import Terminal
from .picture import svg
from .style import Style
from .view import Screen

__all__ = ["run_screen"]

_REDRAW_S = 0.25
_LEAST_WIDTH, _LEAST_HEIGHT = 30, 8


class _Frame:
    """Draws only what has changed since the last time: a slow radio link carries no frame twice."""

    def __init__(self, live: Live, console: Console, style: Style) -> None:
        self._live, self._console, self._style = live, console, style
        self._last: Optional[List[List[Segment]]] = None

    def draw(self, session: Session) -> None:
        width, height = self._console.size
        options = self._console.options.update(width=max(width, _LEAST_WIDTH), height=None)
        screen = Screen(session.desk, session.now(), self._style, max(height, _LEAST_HEIGHT))
        lines = self._console.render_lines(screen, options, pad=True)
        if lines != self._last:
            self._last = lines
            self._live.update(Segments([s for line in lines for s in [*line, Segment.line()]]), refresh=True)


class Album:
    """Saves one picture for each state that the engine enters.

    Args:
        folder: for the pictures; None: none are saved.
        style: how it looks.
    """

    def __init__(self, folder: Optional[Path], style: Style) -> None:
        self._folder, self._style = folder, style
        self._last, self._number = "", 0

    def add(self, session: Session) -> None:
        """Save the screen if the state is another than last time; what cannot be saved is said, and no more tried."""
        snapshot = session.desk.snapshot
        if self._folder is None or snapshot is None or snapshot.state == self._last:
            return
        self._last = snapshot.state
        self._number += 1
        try:
            self._save(self._folder, snapshot.state, session)
        except OSError as error:
            self._folder = None
            session.desk = replace(session.desk, error=f"Pictures are not saved: {error.strerror}.")

    def _save(self, folder: Path, state: str, session: Session) -> None:
        name = f"{self._number:02d}-{''.join(c for c in state.lower() if c.isalnum() or c == '_')}.svg"
        screen = Screen(session.desk, session.now(), self._style)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(svg(screen, 100, f"console in {state}"), encoding="utf-8")


def run_screen(session: Session, terminal: Terminal, style: Style, pictures: Optional[Path] = None) -> None:
    """Run the console on the full screen until the session is over; the terminal is left as it was."""
    console = Console(file=sys.stdout, legacy_windows=False)
    album = Album(pictures, style)
    with terminal, Live(console=console, screen=True, auto_refresh=False, redirect_stderr=False) as live:
        frame = _Frame(live, console, style)
        while session.status is None:
            session.turn()
            frame.draw(session)
            album.add(session)
            for key in terminal.keys(_REDRAW_S):
                session.press(key)
                if session.status is not None:
                    break
