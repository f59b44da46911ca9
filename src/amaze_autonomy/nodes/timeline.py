"""The report of a run: one line per decision and message, readable by a person."""

from __future__ import annotations

from typing import List, Optional

from amaze_autonomy.engine.commands import Decision, Notify, Value

__all__ = ["Timeline"]

_NS = 1_000_000_000


class Timeline:
    """Collects lines; times are seconds since the first."""

    def __init__(self) -> None:
        self._start_ns: Optional[int] = None
        self.lines: List[str] = []

    def decision(self, decision: Decision) -> None:
        """Add a decision."""
        where = decision.after + (f"/{decision.step}" if decision.step else "")
        moved = where if decision.before == decision.after else f"{decision.before} -> {where}"
        values = "; ".join(_value(value) for value in decision.values)
        parts = [moved, f"rule {decision.rule} on {decision.event}"]
        if values:
            parts.append(values)
        if decision.commands:
            parts.append("=> " + ", ".join(decision.commands))
        self._add(decision.t_ns, " | ".join(parts))

    def message(self, t_ns: int, notify: Notify) -> None:
        """Add a message to the user."""
        advice = f" {notify.advice}" if notify.advice else ""
        self._add(t_ns, f"{notify.level.name}: {notify.text}{advice}")

    def note(self, t_ns: int, text: str) -> None:
        """Add a remark of the node itself."""
        self._add(t_ns, f"NODE: {text}")

    def _add(self, t_ns: int, text: str) -> None:
        if self._start_ns is None:
            self._start_ns = t_ns
        self.lines.append(f"{(t_ns - self._start_ns) / _NS:10.3f} s  {text}")

    def text(self) -> str:
        """Return the whole report."""
        return "".join(line + "\n" for line in self.lines)


def _value(value: Value) -> str:
    unit = f" {value.unit}" if value.unit else ""
    limit = "" if value.limit is None else f" (limit {value.limit}{unit})"
    return f"{value.name} {value.value}{unit}{limit}"
