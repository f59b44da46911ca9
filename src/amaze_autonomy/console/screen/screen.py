"""The full screen: draws the desk when it looks different, and passes keys on, in one thread; and its pictures."""

from __future__ import annotations

import io
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple
from xml.sax.saxutils import escape

from rich.cells import cell_len
from rich.color import Color
from rich.console import Console, ConsoleDimensions, RenderableType
from rich.live import Live
from rich.segment import Segment, Segments
from rich.style import Style as CellStyle
from rich.terminal_theme import DIMMED_MONOKAI

from ..session import Session
from ..terminal import Terminal
from .style import Style
from .view import Screen

_REDRAW_S = 0.25
_USUAL_SIZE = ConsoleDimensions(80, 24)  # of a terminal that does not know its own


class _Frame:
    """Draws only what has changed since the last time: a slow radio link carries no frame twice."""

    def __init__(self, live: Live, console: Console, style: Style) -> None:
        self._live, self._console, self._style = live, console, style
        self._last: Optional[List[List[Segment]]] = None

    def draw(self, session: Session) -> None:
        self._console.size = size = _own_size()
        options = self._console.options.update(width=size.width, height=None)
        screen = Screen(session.desk, session.now(), self._style, size.height)
        lines = self._console.render_lines(screen, options, pad=True)
        if lines != self._last:
            self._last = lines
            self._live.update(Segments([s for line in lines for s in [*line, Segment.line()]]), refresh=True)


def _own_size() -> ConsoleDimensions:
    """Return the terminal's own size; what the environment says (LINES, COLUMNS) may be that of another window."""
    width, height = os.get_terminal_size(sys.stdout.fileno())
    return ConsoleDimensions(width or _USUAL_SIZE.width, height or _USUAL_SIZE.height)


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


# --- picture ----------------------------------------------------------------------------------------------------------
# The screen as an SVG picture, still or moving: what the terminal would show, cell by cell. Block characters are drawn
# as rectangles, so that the large letters have no seams whatever font the viewer has.


_CELL_W, _CELL_H, _MARGIN = 9, 19, 12
BACK, FORE = "#101418", "#e8e8e8"
# Where in its cell a block character is set: from and to, as parts of the cell's width and height.
_BLOCKS: Mapping[str, Tuple[float, float, float, float]] = {
    "█": (0, 0, 1, 1),
    "▀": (0, 0, 1, 0.5),
    "▄": (0, 0.5, 1, 1),
    "─": (0, 0.47, 1, 0.53),
    "▏": (0, 0, 0.15, 1),
}


def svg(what: RenderableType, width: int, title: str) -> str:
    """Return a picture of what rich draws in `width` columns; `title` is for those who cannot see it."""
    rows = _rows(what, width)
    return _picture(rows, width, len(rows), title)


def moving_svg(frames: Sequence[RenderableType], width: int, title: str, frame_s: float) -> str:
    """Return one picture that shows others one after the other, for ever; what does not change is in it once."""
    drawn = [_rows(frame, width) for frame in frames]
    height = max(map(len, drawn))
    seen: Dict[str, List[int]] = {}  # of each row as it is drawn: the frames that have it
    for number, rows in enumerate(drawn):
        for row in filter(None, rows):
            seen.setdefault(row, []).append(number)
    body = [
        row if len(numbers) == len(drawn) else _at_times(row, numbers, len(drawn), frame_s)
        for row, numbers in seen.items()
    ]
    return _picture(body, width, height, title)


def _at_times(row: str, numbers: List[int], count: int, frame_s: float) -> str:
    """Return a row that is there in some of the frames."""
    shown = ["visible" if number in numbers else "hidden" for number in range(count)]
    changes = [number for number in range(count) if number == 0 or shown[number] != shown[number - 1]]
    values, times = (";".join(each) for each in zip(*((shown[number], f"{number / count:.4g}") for number in changes)))
    return (
        f'<g visibility="{shown[0]}"><animate attributeName="visibility" values="{values}" keyTimes="{times}" '
        f'calcMode="discrete" dur="{count * frame_s:g}s" repeatCount="indefinite"/>\n{row}\n</g>'
    )


def _rows(what: RenderableType, width: int) -> List[str]:
    console = Console(width=width, file=io.StringIO(), force_terminal=True, color_system="truecolor")
    lines = [list(Segment.simplify(line)) for line in console.render_lines(what, console.options.update(height=None))]
    return ["\n".join(_line(line, _MARGIN + row * _CELL_H)) for row, line in enumerate(lines)]


def _picture(body: List[str], width: int, height: int, title: str) -> str:
    size = (width * _CELL_W + 2 * _MARGIN, height * _CELL_H + 2 * _MARGIN)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]} {size[1]}" role="img" font-size="15" '
            'font-family="DejaVu Sans Mono, ui-monospace, Menlo, Consolas, monospace" xml:space="preserve">',
            f"<title>{escape(title)}</title>",
            f'<rect width="{size[0]}" height="{size[1]}" rx="8" fill="{BACK}"/>',
            *filter(None, body),
            "</svg>",
            "",
        ]
    )


def _line(line: List[Segment], top: int) -> Iterator[str]:
    column = 0
    for text, style, _ in line:
        width = cell_len(text)
        left = _MARGIN + column * _CELL_W
        fore, back = _colours(style or CellStyle.null())
        if back is not None:
            yield f'<rect x="{left}" y="{top}" width="{width * _CELL_W + 0.5}" height="{_CELL_H + 0.5}" fill="{back}"/>'
        yield from _text(text, left, top, fore, bold=bool(style and style.bold))
        column += width


def _text(text: str, left: int, top: int, fore: str, *, bold: bool) -> Iterator[str]:
    """Draw runs of letters as text, and block characters as rectangles."""
    start = 0
    for at, letter in enumerate([*text, " "]):
        block = _BLOCKS.get(letter)
        if block is None and not (letter == " " and text[at + 1 : at + 2] in ("", " ")):
            continue
        yield from _run(text[start:at], left + cell_len(text[:start]) * _CELL_W, top, fore, bold=bold)
        start = at + 1
        if block is not None:
            x, y = left + cell_len(text[:at]) * _CELL_W + block[0] * _CELL_W, top + block[1] * _CELL_H
            wide, high = (block[2] - block[0]) * _CELL_W, (block[3] - block[1]) * _CELL_H
            yield f'<rect x="{x:g}" y="{y:g}" width="{wide + 0.2:g}" height="{high + 0.2:g}" fill="{fore}"/>'


def _run(text: str, left: int, top: int, fore: str, *, bold: bool) -> Iterator[str]:
    words = text.strip(" ")
    if not words:
        return
    left += cell_len(text[: len(text) - len(text.lstrip(" "))]) * _CELL_W
    weight = ' font-weight="bold"' if bold else ""
    long = f' textLength="{cell_len(words) * _CELL_W}"'
    yield f'<text x="{left}" y="{top + 14.5:g}" fill="{fore}"{weight}{long}>{escape(words)}</text>'


def _colours(style: CellStyle) -> Tuple[str, Optional[str]]:
    fore, back = _hex(style.color), _hex(style.bgcolor)
    return (back or BACK, fore or FORE) if style.reverse else (fore or FORE, back)


def _hex(colour: Optional[Color]) -> Optional[str]:
    return None if colour is None or colour.is_default else colour.get_truecolor(DIMMED_MONOKAI).hex
