"""The console's three tables: missions, pre-flight checks, active faults."""

from __future__ import annotations

from textwrap import wrap
from typing import Tuple

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ...engine.events import Check
from ...engine.events import Verdict as CheckVerdict
from ..model import MissionRow, PendingFailure, Snapshot
from ..words import age, duration, fraction, limits, quantity, seconds
from .style import Style, Tone, tone_of_check, tone_of_code

_LEAST_ADVICE = 24


def _table(style: Style, *headings: str) -> Table:
    table = Table(box=style.box, expand=True, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
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
        width: of the screen, in cells; where the advice has no room beside its row it stands under it, without the age.
        rows: how many lines there are for them, heading included.
        style: how it looks.
    """
    wide = _advice_width(checks, width) >= _LEAST_ADVICE
    shown = _fitting(checks, rows, _lines(checks, width, wide=wide))
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
    return verdict, style.text(quantity(check.value, check.unit)), style.text(limits(check))


def _fitting(checks: Tuple[Check, ...], rows: int, lines: Tuple[int, ...]) -> Tuple[Check, ...]:
    """Leave out passed rows, the last ones first, until the others fit; `lines` is what each takes."""
    needed = sum(lines)
    if needed <= rows - 2:
        return checks
    shown = list(checks)
    for at in reversed(range(len(checks))):
        if checks[at].verdict is CheckVerdict.PASS and needed > rows - 3:
            del shown[at]
            needed -= lines[at]
    return tuple(shown)


def _lines(checks: Tuple[Check, ...], width: int, *, wide: bool) -> Tuple[int, ...]:
    """Return how many lines each row takes."""
    if wide:
        beside = _advice_width(checks, width)
        return tuple(max(1, len(wrap(each.advice, beside))) for each in checks)
    beside = max(3, width - _judgement_width(checks))
    advice = [len(wrap(f"-> {each.advice}", beside - 2)) if each.advice else 0 for each in checks]
    return tuple(len(wrap(each.name, beside)) + more for each, more in zip(checks, advice))


def _advice_width(checks: Tuple[Check, ...], width: int) -> int:
    """Return how many cells are left for the advice beside its row."""
    ages = max(len(age(each.age_s)) for each in checks)
    return width - max(len(each.name) for each in checks) - _judgement_width(checks) - 2 - max(3, ages) - 2


def _judgement_width(checks: Tuple[Check, ...]) -> int:
    """Return how many cells verdict, value and limit take, with the gaps before them."""
    values = max(len(quantity(each.value, each.unit)) for each in checks)
    bounds = max(len(limits(each)) for each in checks)
    verdicts = max(len(each.verdict.value) + 2 for each in checks)
    return 2 + max(7, verdicts) + 2 + max(5, values) + 2 + max(5, bounds)


def action_words(failure: PendingFailure, passed_s: float) -> str:
    """Return what is done about a fault, e.g. "waits 12 s (wait limit), then LAND"."""
    if failure.action == "wait":
        then = f", then {failure.fallback.upper() or '?'}"
        if failure.time_left_s is None:
            return f"waits{then}"
        limit = f" ({failure.limit})" if failure.limit else ""
        return f"waits {seconds(failure.time_left_s - passed_s)}{limit}{then}"
    return {"continue": "flies on without it", "land": "LAND", "pilot": "PILOT"}.get(failure.action, failure.action)


def failures_table(snapshot: Snapshot, passed_s: float, style: Style) -> Table:
    """Return the active faults, what has one cause on one row; `passed_s` since the snapshot came.

    The actions are those of a flight: on the ground nothing is done about a fault but to refuse the takeoff.
    """
    table = _table(style, "active faults", "code", "action", "why")
    table.columns[0].no_wrap = True
    _right(table, 1)
    table.columns[2].ratio, table.columns[3].ratio = 2, 3
    for group in snapshot.fault_groups():
        worst, alone = group[0], len(group) == 1
        why = worst.reason if alone else f"{worst.cause}: {', '.join(each.name for each in group)}"
        table.add_row(
            style.label(worst.name if alone else f"{len(group)} faults", tone_of_code(worst.code, worst.action)),
            style.text(str(worst.code) if worst.code else "-"),
            style.text(action_words(worst, passed_s) if snapshot.in_flight else "-", Tone.STRONG),
            style.text(why),
        )
    return table
