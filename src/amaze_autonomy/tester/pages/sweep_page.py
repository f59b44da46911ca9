"""A sweep as one HTML page: the state over flight time for each time of the fault, with the boundaries drawn.

Across: the time of the fault. Down: the flight, in the colours of its states. The line is the fault itself. Nothing is
loaded, nothing runs: the page is a picture and two tables.
"""

from __future__ import annotations

from html import escape
from math import ceil
from pathlib import Path
from typing import Dict, List, Sequence, Tuple

from amaze_autonomy.whole_file import write_whole

from ..sweep import Flight, Sweep
from .page import STATE_COLOURS

__all__ = ["sweep_page", "write_sweep_page"]

_LEFT, _TOP, _WIDE, _HIGH = 60, 64, 1080, 460
_TICKS = 10
_LETTER = 6.6
_BANDS = ("#dbe4ff", "#ffe8cc", "#d3f9d8", "#ffe3e3", "#eebefa", "#c5f6fa", "#fff3bf", "#e9ecef")
_STYLE = """body { font: 14px/1.4 system-ui, sans-serif; color: #1c2430; margin: 1.2rem; }
svg { display: block; max-width: 100%; } svg text { font: 12px system-ui, sans-serif; fill: #1c2430; }
table { border-collapse: collapse; margin: 0.4rem 0 1rem; }
td, th { text-align: left; padding: 0.15rem 0.9rem 0.15rem 0.3rem; border-bottom: 1px solid #e6e9ee; }
.key { display: inline-block; padding: 0 0.5rem; margin: 0 0.3rem 0.3rem 0; }"""


def write_sweep_page(path: Path, title: str, result: Sweep) -> None:
    """Write the page.

    Args:
        path: of the file.
        title: what was swept: the scenario.
        result: of the sweep.

    Raises:
        OSError: it cannot be written.
    """
    write_whole(path, sweep_page(title, result))


def sweep_page(title: str, result: Sweep) -> str:
    """Return the page."""
    outcomes = list(dict.fromkeys(flight.outcome for flight in result.flights))
    letters = {outcome: chr(ord("A") + number % 26) for number, outcome in enumerate(outcomes)}
    said = f"{result.runs} runs, {len(outcomes)} outcomes, {len(result.boundaries)} boundaries"
    parts = [
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
        f"<style>\n{_STYLE}\n</style></head><body>",
        f"<h1>{escape(title)}</h1>",
        f"<p>{escape(result.fault)}, its time {escape(result.clock)}. {said}.</p>",
        *_picture(result, letters),
        *_legend(result.flights),
        *_outcome_table(result, letters),
        *_boundary_table(result, letters),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


class _Frame:
    """Where things are: the time of the fault across, the flight down."""

    def __init__(self, flights: Sequence[Flight]) -> None:
        self.first_s, self.last_s = flights[0].t_s, flights[-1].t_s
        self.end_s = max((flight.states[-1][1] for flight in flights if flight.states), default=0.0) or 1.0

    def x(self, t_s: float) -> float:
        return _LEFT + _WIDE * (t_s - self.first_s) / (self.last_s - self.first_s)

    def y(self, t_s: float) -> float:
        return _TOP + _HIGH * t_s / self.end_s


def _picture(result: Sweep, letters: Dict[str, str]) -> List[str]:
    frame = _Frame(result.flights)
    wide, high = _LEFT + _WIDE + 20, _TOP + _HIGH + 44
    return [
        f'<svg viewBox="0 0 {wide} {high}" width="{wide}" height="{high}" role="img">',
        *_flights(result.flights, frame),
        *_bands(result, letters, frame),
        *_boundaries(result, frame),
        *_axes(result.clock, frame),
        "</svg>",
    ]


def _flights(flights: Sequence[Flight], frame: _Frame) -> List[str]:
    lines = [
        _rect(
            (frame.x(left), frame.y(begin_s), frame.x(right), frame.y(until_s)),
            STATE_COLOURS.get(state, "#adb5bd"),
            f"fault {flight.t_s:g} s: {state} from {begin_s:g} s to {until_s:g} s",
        )
        for flight, (left, right) in zip(flights, _columns(flights))
        for begin_s, until_s, state in flight.states
    ]
    began = [(flight.t_s, flight.began_s) for flight in flights if flight.began_s is not None]
    points = " ".join(f"{frame.x(t_s):.1f},{frame.y(at_s):.1f}" for t_s, at_s in began)
    return [*lines, f'<polyline points="{points}" fill="none" stroke="#1c2430" stroke-width="1.5"/>']


def _bands(result: Sweep, letters: Dict[str, str], frame: _Frame) -> List[str]:
    lines: List[str] = []
    for left_s, right_s, outcome in _regions(result):
        left, right = frame.x(left_s), frame.x(right_s)
        colour = _BANDS[list(letters).index(outcome) % len(_BANDS)]
        whole = f"{letters[outcome]}  {outcome}"
        said = whole if len(whole) * _LETTER < right - left else letters[outcome]
        lines += [
            _rect((left, _TOP - 26, right, _TOP - 6), colour, outcome),
            _text((left + right) / 2, _TOP - 11, said),
        ]
    return lines


def _boundaries(result: Sweep, frame: _Frame) -> List[str]:
    lines: List[str] = []
    for number, each in enumerate(result.boundaries):
        at = frame.x((each.after_s + each.before_s) / 2)
        place = f'x1="{at:.1f}" x2="{at:.1f}" y1="{_TOP - 28}" y2="{_TOP + _HIGH}"'
        lines.append(f'<line {place} stroke="#c92a2a" stroke-width="1.5" stroke-dasharray="5 3"/>')
        lines.append(_text(at, _TOP - 32 - 13 * (number % 2), f"{each.before_s:.2f} s"))
    return lines


def _axes(clock: str, frame: _Frame) -> List[str]:
    below = _TOP + _HIGH
    lines = [_text(frame.x(t_s), below + 16, f"{t_s:g}") for t_s in _ticks(frame.first_s, frame.last_s)]
    lines += [_text(_LEFT - 6, frame.y(at_s) + 4, f"{at_s:g}", "end") for at_s in _ticks(0.0, frame.end_s)]
    words = f"time of the fault, {clock} [s]; the line is the fault itself; down: the flight [s]"
    return [*lines, _text(_LEFT + _WIDE / 2, below + 36, words)]


def _text(x: float, y: float, words: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(words)}</text>'


def _rect(box: Tuple[float, float, float, float], colour: str, words: str) -> str:
    left, top, right, bottom = box
    size = f'width="{max(right - left, 0.5):.1f}" height="{max(bottom - top, 0.2):.1f}"'
    return f'<rect x="{left:.1f}" y="{top:.1f}" {size} fill="{colour}"><title>{escape(words)}</title></rect>'


def _ticks(low: float, high: float) -> List[float]:
    """Return round numbers between two, at most ten and one."""
    steps = (base * 10.0**power for power in range(-3, 6) for base in (1, 2, 5))
    step = next(each for each in steps if (high - low) / each <= _TICKS)
    return [round(number * step, 6) for number in range(ceil(low / step - 1e-9), int(high / step + 1e-9) + 1)]


def _columns(flights: Sequence[Flight]) -> List[Tuple[float, float]]:
    """Return from where to where each flight stands: half-way to its neighbours."""
    times = [flight.t_s for flight in flights]
    middles = [(one + other) / 2 for one, other in zip(times, times[1:])]
    return list(zip([times[0], *middles], [*middles, times[-1]]))


def _regions(result: Sweep) -> List[Tuple[float, float, str]]:
    """Return from where to where there is one outcome: from boundary to boundary."""
    marks = [(each.after_s + each.before_s) / 2 for each in result.boundaries]
    outcomes = [each.outcomes[0] for each in result.boundaries] + [result.flights[-1].outcome]
    return list(zip([result.flights[0].t_s, *marks], [*marks, result.flights[-1].t_s], outcomes))


def _legend(flights: Sequence[Flight]) -> List[str]:
    seen = dict.fromkeys(state for flight in flights for _, _, state in flight.states)
    keys = [f'<span class="key" style="background: {STATE_COLOURS[state]}">{state}</span>' for state in seen]
    return ["<p>", *keys, "</p>"]


def _outcome_table(result: Sweep, letters: Dict[str, str]) -> List[str]:
    rows = [(letter, outcome, sum(f.outcome == outcome for f in result.flights)) for outcome, letter in letters.items()]
    lines = [f"<tr><td>{a}</td><td>{escape(b)}</td><td>{c}</td></tr>" for a, b, c in rows]
    return ["<h2>What is commanded</h2><table><tr><th></th><th>Motions</th><th>Runs</th></tr>", *lines, "</table>"]


def _boundary_table(result: Sweep, letters: Dict[str, str]) -> List[str]:
    if not result.boundaries:
        return ["<p>There is no boundary: the moment of the fault does not matter.</p>"]
    rows = [
        f"<tr><td>{each.after_s:.3f} s</td><td>{each.before_s:.3f} s</td>"
        f"<td>{letters[each.outcomes[0]]} &rarr; {letters[each.outcomes[1]]}</td></tr>"
        for each in result.boundaries
    ]
    head = "<tr><th>Last before</th><th>First after</th><th>Outcome</th></tr>"
    return [f"<h2>Boundaries</h2><table>{head}", *rows, "</table>"]
