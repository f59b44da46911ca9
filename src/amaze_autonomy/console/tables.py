"""The console's three tables: missions, pre-flight checks, what is wrong now."""

from __future__ import annotations

from math import ceil, floor
from typing import Tuple

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from amaze_autonomy.engine.checks import Check
from amaze_autonomy.engine.checks import Verdict as CheckVerdict

from .model import MissionRow, PendingFailure, Snapshot
from .style import Style, Tone, tone_of_check, tone_of_code
from .words import age, duration, fraction, quantity, seconds

__all__ = ["checks_table", "failures_table", "missions_table", "verb_words"]

_NARROW = 80


def _table(style: Style, *headings: str) -> Table:
    table = Table(box=style.box, expand=True, show_edge=False, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in headings:
        table.add_column(style.text(heading, Tone.STRONG), overflow="fold")
    return table


def _right(table: Table, *columns: int) -> None:
    for column in columns:
        table.columns[column].justify = "right"
        table.columns[column].no_wrap = True


def missions_table(missions: Tuple[MissionRow, ...], style: Style) -> Table:
    """Return the table of missions: id, description, duration, battery; an error in place of the numbers."""
    table = _table(style, "id", "mission", "duration", "battery")
    _right(table, 2, 3)
    table.columns[1].ratio = 1
    for row in missions:
        about = style.text(row.description or "no description")
        files = [f"{row.files} files"] if row.files > 1 else []
        times = [f"flown {row.repetitions} times"] if row.repetitions > 1 else []
        if files or times:
            about.append(f" ({', '.join([*files, *times])})")
        if row.error:
            about = Text.assemble(style.label("CANNOT BE FLOWN", Tone.BAD), " ", style.text(row.error))
        numbers = (style.text(duration(row.duration_s)), style.text(fraction(row.battery_needed)))
        table.add_row(style.text(row.id, Tone.STRONG), about, *numbers)
    return table


def checks_table(checks: Tuple[Check, ...], width: int, rows: int, style: Style) -> RenderableType:
    """Return the pre-flight table. With too little room the last of the passed rows are left out, never another.

    Args:
        checks: the rows.
        width: of the screen, in cells; below 80 the advice stands under its row, and the age is left out.
        rows: how many lines there are for them, heading included.
        style: how it looks.
    """
    wide = width >= _NARROW
    shown = _fitting(checks, rows, width)
    table = _table(style, "check", "verdict", "value", "limit", *(("age", "advice") if wide else ()))
    _right(table, 2, 3, *((4,) if wide else ()))
    table.columns[5 if wide else 0].ratio = 1
    for check in shown:
        table.add_row(*(_wide_row(check, style) if wide else _narrow_row(check, style)))
    left_out = len(checks) - len(shown)
    return table if left_out == 0 else Group(table, style.text(f"and {left_out} more that passed"))


def _wide_row(check: Check, style: Style) -> Tuple[RenderableType, ...]:
    advice = style.text(check.advice, Tone.STRONG)
    return (style.text(check.name), *_judgement(check, style), style.text(age(check.age_s)), advice)


def _narrow_row(check: Check, style: Style) -> Tuple[RenderableType, ...]:
    name: RenderableType = style.text(check.name)
    if check.advice:
        name = Group(name, Padding(style.text(f"{style.arrow} {check.advice}", Tone.STRONG), (0, 0, 0, 2)))
    return (name, *_judgement(check, style))


def _judgement(check: Check, style: Style) -> Tuple[RenderableType, ...]:
    verdict = style.label(check.verdict.value.upper(), tone_of_check(check.verdict))
    return verdict, style.text(quantity(check.value, check.unit)), style.text(quantity(check.limit, check.unit))


def _fitting(checks: Tuple[Check, ...], rows: int, width: int) -> Tuple[Check, ...]:
    """Leave out passed rows, the last ones first, until the others fit."""
    if sum(_lines(each, width) for each in checks) <= rows - 2:
        return checks
    shown = list(checks)
    for check in reversed(checks):
        if check.verdict is CheckVerdict.PASS and sum(_lines(each, width) for each in shown) > rows - 3:
            shown.remove(check)
    return tuple(shown)


def _lines(check: Check, width: int) -> int:
    """Return about how many lines a row takes."""
    under = 0 if width >= _NARROW else 1
    beside = max(20, width - 62) if width >= _NARROW else max(20, width - 32)
    return max(1, under + ceil(len(check.advice) / beside)) if check.advice else 1


def verb_words(failure: PendingFailure, passed_s: float) -> str:
    """Return what is done about a failure, e.g. "waits 12 s, then LAND"."""
    if failure.verb == "wait":
        then = f", then {failure.then.upper() or '?'}"
        if failure.time_left_s is None:
            return f"waits{then}"
        return f"waits {seconds(failure.time_left_s - passed_s)}{then}"
    return {"continue": "flies on without it", "land": "LAND", "pilot": "PILOT"}.get(failure.verb, failure.verb)


def failures_table(snapshot: Snapshot, passed_s: float, style: Style) -> Table:
    """Return what is wrong, the worst and most urgent first; `passed_s` since the snapshot came.

    The verbs are those of a flight: on the ground nothing is done about a failure but to refuse the takeoff.
    """
    table = _table(style, "wrong now", "code", "what is done", "why")
    table.columns[0].no_wrap = True
    _right(table, 1)
    table.columns[2].ratio, table.columns[3].ratio = 2, 3
    for failure in sorted(snapshot.failures, key=_urgency):
        table.add_row(
            style.label(failure.name, tone_of_code(failure.code, failure.verb)),
            style.text(str(failure.code) if failure.code else "-"),
            style.text(verb_words(failure, passed_s) if snapshot.in_flight else "-", Tone.STRONG),
            style.text(failure.reason),
        )
    return table


def _urgency(failure: PendingFailure) -> Tuple[int, float, str]:
    order = ("pilot", "land", "wait", "continue")
    rank = order.index(failure.verb) if failure.verb in order else 0
    left = failure.time_left_s
    return rank, float("inf") if left is None else floor(left), failure.name
