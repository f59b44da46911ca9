"""What is told of a simulated run: as a story for a person, as a summary for a program."""

from __future__ import annotations

from typing import Any, Dict, List, Sequence, Tuple

from amaze_autonomy.engine.commands import Command, Decision, Notify, Request, Value
from amaze_autonomy.engine.state import State

from .run import Run
from .scenario import Scenario

__all__ = ["story", "summary"]

_NS = 1e9


def story(scenario: Scenario, result: Run) -> str:
    """Return the story of a run: decisions, messages to the user, and what the scenario did, in order of time."""
    told: List[Tuple[int, int, str]] = [(t_ns, 0, f"* {text}") for t_ns, text in result.history]
    told += [(decision.t_ns, 1, text) for decision, text in _joined(result.decisions)]
    told += _messages(result.commands)
    lines = [f"scenario: {scenario.description}", ""]
    lines += [f"{t_ns / _NS:10.3f}  {text}" for t_ns, _, text in sorted(told, key=lambda line: line[:2])]
    lines += ["", *(f"mission {name}: {each.value}" for name, each in result.results)]
    if not result.finished:
        lines.append(f"{result.state.state.value}: not finished within the limit of simulated time")
    elif result.state.state is not State.MISSION_ENDED:
        lines.append(f"{result.state.state.value}: waits for a person")
    return "\n".join(lines)


def _joined(decisions: Sequence[Decision]) -> List[Tuple[Decision, str]]:
    """Return each decision with its text; the same rule over and over within a state is told once."""
    told: List[Tuple[Decision, str]] = []
    times = 0
    for number, decision in enumerate(decisions):
        following = decisions[number + 1] if number + 1 < len(decisions) else None
        last = decisions[number - 1] if number else None
        if last is None or not _same(last, decision):
            told.append((decision, _decision(decision)))
            times = 0
            continue
        times += 1
        if following is None or not _same(decision, following):
            told.append((decision, f"  ... {decision.rule}, {times} more times until here"))
    return told


def _same(one: Decision, other: Decision) -> bool:
    return one.rule == other.rule and (one.before, one.after) == (other.before, other.after) == (one.after, one.before)


def _decision(decision: Decision) -> str:
    after = f"{decision.after}/{decision.step}" if decision.step else decision.after
    moved = after if decision.before == decision.after else f"{decision.before} -> {after}"
    values = "; ".join(_value(value) for value in decision.values)
    commands = f"  => {', '.join(decision.commands)}" if decision.commands else ""
    return f"{moved}  by {decision.rule}" + (f" ({values})" if values else "") + commands


def _value(value: Value) -> str:
    said = f"{value.value:.6g}" if isinstance(value.value, float) else str(value.value)
    text = " ".join(part for part in (value.name, said, value.unit) if part)
    return text if value.limit is None else f"{text}, limit {value.limit}"


def _messages(commands: Sequence[Tuple[int, Command]]) -> List[Tuple[int, int, str]]:
    """Return the messages to the user; one that is said again and again is told once."""
    told: List[Tuple[int, int, str]] = []
    for t_ns, each in commands:
        if isinstance(each, Notify):
            text = f"  {each.level.name}: {each.text}" + (f" {each.advice}" if each.advice else "")
            if not told or told[-1][2] != text:
                told.append((t_ns, 2, text))
    return told


def summary(result: Run) -> Dict[str, Any]:
    """Return what came of a run as plain values."""
    return {
        "commands": [
            {"command": type(each).__name__, "t_s": t_ns / _NS, **_action(each)}
            for t_ns, each in result.commands
            if isinstance(each, Request)
        ],
        "decisions": [
            {
                "after": decision.after,
                "before": decision.before,
                "commands": list(decision.commands),
                "rule": decision.rule,
                "step": decision.step,
                "t_s": decision.t_ns / _NS,
            }
            for decision in result.decisions
        ],
        "finished": result.finished,
        "results": [{"mission": name, "result": each.value} for name, each in result.results],
        "simulated_s": result.state.t_ns / _NS,
        "state": result.state.state.value,
        "world": [{"t_s": t_ns / _NS, "text": text} for t_ns, text in result.history],
    }


def _action(request: Request) -> Dict[str, str]:
    """Return which of its kind a request is."""
    for name in ("action", "check"):
        if hasattr(request, name):
            return {name: getattr(request, name).name}
    return {}
