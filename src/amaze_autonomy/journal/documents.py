"""The tables of the engine as Markdown: what docs/ shows is generated from what decides. Pure text."""

from __future__ import annotations

from typing import Callable, Iterable, List, Mapping, Sequence, Tuple

from ..engine.commands import MESSAGES, AnswerKind
from ..engine.context import MODES
from ..engine.decide import ANSWERS, OTHERWISE, SELECT
from ..engine.events import UserCommand
from ..engine.failsafe import FAILSAFE_CONDITIONS
from ..engine.rules import SEVERITIES, Rules
from ..engine.state import State, Step
from ..engine.timers import TIMERS
from ..engine.transitions import TRANSITIONS, Source, Transition, places_of

__all__ = ["DOCUMENTS", "decision_table", "state_diagram"]


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _place(source: Source) -> str:
    if isinstance(source, tuple):
        state, step = source
        return f"{state.value}.{step.value}" if step is not Step.NONE else state.value
    return source.value


def severity_table() -> str:
    """Return the table of severities."""
    rows = [
        (
            severity.value,
            int(row.code),
            int(row.code_given_up),
            f"`{row.action.name.lower()}`",
            f"`{row.fallback.name.lower()}`" if row.fallback else "",
        )
        for severity, row in SEVERITIES.items()
    ]
    return _table(("Severity", "Code when it fails", "Code when restarting has failed", "Action", "Fallback"), rows)


def loss_table() -> str:
    """Return the table of what else can be lost in flight."""
    rows = [
        (
            f"`{row.name}`",
            row.words,
            f"`{row.action.name.lower()}`",
            "yes" if row.both_routes else "",
            "yes" if row.alarm else "",
        )
        for row in FAILSAFE_CONDITIONS
    ]
    return _table(("Row", "In words", "Action", "Both routes at once", "Alarm to the pilot"), rows)


def decision_table(rules: Rules) -> str:
    """Return the decision table of a configuration."""
    rows = []
    for rule in rules.components:
        row = SEVERITIES[rule.severity]
        words = row.action.name.lower() + (
            f" up to {rule.wait_limit_ns / 1e9:g} s, then {row.fallback.name.lower()}" if row.fallback else ""
        )
        rows.append((f"`{rule.name}`", rule.group, "yes" if rule.restart else "never", rule.severity.value, words))
    return _table(("Component", "Group", "Restart", "Severity", "Result"), rows)


def transition_table() -> str:
    """Return the transition table, in its order."""
    rows = [
        (
            f"`{row.rule}`",
            ", ".join(_place(source) for source in row.sources),
            row.words,
            _place(row.target) if row.target is not None else "(stays)",
            f"`{row.message}`" if row.message else "",
        )
        for row in TRANSITIONS
    ]
    return _table(("Rule", "From", "When", "To", "Message"), rows)


def state_diagram() -> str:
    """Return the state diagram as Mermaid text: one arrow for each pair of states, with its rules."""
    arrows: List[Tuple[str, str, List[str]]] = []
    for row in TRANSITIONS:
        for source, target in _arrows(row):
            known = next((names for a, b, names in arrows if (a, b) == (source, target)), None)
            if known is None:
                arrows.append((source, target, [row.rule]))
            elif row.rule not in known:
                known.append(row.rule)
    order = [state.value for state in State]
    arrows.sort(key=lambda arrow: (order.index(arrow[0]), order.index(arrow[1])))
    lines = ["```mermaid", "stateDiagram-v2", "    [*] --> MISSION_INPUT"]
    lines += [f"    {a} --> {b}: {_label(names)}" for a, b, names in arrows]
    return "\n".join([*lines, "```"]) + "\n"


def _arrows(row: Transition) -> Tuple[Tuple[str, str], ...]:
    if row.target is None:
        return ()
    target = row.target[0]
    states: List[State] = []
    for source in row.sources:
        for place in places_of(source):
            if place[0] is not target and place[0] not in states:
                states.append(place[0])
    return tuple((state.value, target.value) for state in states)


def _label(names: List[str]) -> str:
    first, rest = names[:2], names[2:]
    return ", ".join([*first, f"and {len(rest)} more"] if len(rest) > 1 else names)


def answer_table() -> str:
    """Return what every command of the user is answered in every state."""
    rows = []
    for state in State:
        cells = [SELECT[state].answer.name.lower()]
        for command in UserCommand:
            cases = ANSWERS[command].get(state, ())
            texts = [
                f"{case.answer.name.lower()}" + ("" if case.when == "always" else f" ({case.when})") for case in cases
            ]
            if not cases or cases[-1].when != "always":
                texts.append(AnswerKind.REFUSED.name.lower())
            cells.append(", ".join(texts))
        rows.append((state.value, *cells))
    head = ("State", "select", *(command.value for command in UserCommand))
    reasons = "\n".join(f"* `{command.value}` otherwise: {text}" for command, text in OTHERWISE.items())
    return _table(head, rows) + "\n" + reasons + "\n"


def message_table() -> str:
    """Return every message to the user."""
    rows = [(f"`{key}`", entry.level.name, entry.text, entry.advice) for key, entry in MESSAGES.items()]
    return _table(("Message", "Level", "Text", "What you can do"), rows)


def timer_table() -> str:
    """Return every wait of the engine."""
    rows = [
        (f"`{timer.name}`", ", ".join(_place(place) for place in timer.places), "yes" if timer.ends_state else "")
        for timer in TIMERS
    ]
    return _table(("Timer", "Where", "Ends the state by itself"), rows)


def mode_table() -> str:
    """Return which flight modes answer which command."""
    return _table(
        ("Command", "Flight modes that are ours"), [(a.name, ", ".join(sorted(modes))) for a, modes in MODES.items()]
    )


DOCUMENTS: Mapping[str, Callable[[], str]] = {
    "severities": severity_table,
    "losses": loss_table,
    "transitions": transition_table,
    "state-diagram": state_diagram,
    "answers": answer_table,
    "messages": message_table,
    "timers": timer_table,
    "modes": mode_table,
}
"""What docs/ shows, by the name of its marker. The decision table is a configuration's: `decision_table(rules)`."""
