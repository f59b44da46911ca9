"""What a scenario can say, as Markdown for docs/: generated from the tables that decide it."""

from __future__ import annotations

from typing import Callable, Iterable, List, Mapping, Sequence

from amaze_autonomy import paths
from amaze_autonomy.interface import PEERS, SERVICES

from .scenario import EVENTS, KINDS, FaultKind, Parameter, Subject
from .scenario_file import load_scenario

__all__ = ["DOCUMENTS", "kinds_table"]

_SUBJECTS = {
    Subject.COMPONENT: "### `component:` a component of sensors.yaml",
    Subject.PROCESS: f"### `process:` a peer of the engine\n\nOne of {', '.join(f'`{name}`' for name in PEERS)}.",
    Subject.SERVICE: f"### `service:` a service of a peer\n\nOne of {', '.join(f'`{name}`' for name in SERVICES)}.",
    Subject.WORLD: "### Vehicle, battery, pilot, recording: no target",
}


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _parameter(parameter: Parameter) -> str:
    """Return a parameter in words: name, what it means, default or what it must be."""
    said = f"`{parameter.name}`: {parameter.words}"
    if parameter.choices:
        said += f" ({', '.join(parameter.choices)})"
    if parameter.default is None:
        return f"{said}; must be given"
    return said if parameter.default == "" else f"{said}; default {parameter.default}"


def _words(kind: FaultKind) -> str:
    """Return what a kind of fault does, and to whom when not to all."""
    return f"{kind.words} ({', '.join(kind.targets)} only)" if kind.targets else kind.words


def kinds_of_faults() -> str:
    """Return every kind of fault, by subject."""
    parts: List[str] = []
    for subject, head in _SUBJECTS.items():
        parts.append(f"{head}\n\n{kinds_table(kind for kind in KINDS.values() if kind.subject == subject)}")
    return "\n".join(parts)


def kinds_table(kinds: Iterable[FaultKind]) -> str:
    """Return some kinds of faults as a table."""
    rows = [
        (f"`{kind.name}`", _words(kind), "<br>".join(_parameter(each) for each in kind.parameters)) for kind in kinds
    ]
    return _table(("fault", "what it does", "parameters"), rows)


def events() -> str:
    """Return every event that a trigger can wait for."""
    return _table(("event", "when"), ((f"`{name}`", words) for name, words in EVENTS.items()))


def shipped_scenarios() -> str:
    """Return every scenario that ships with the package."""
    files = sorted((paths.config_folder() / "faults").glob("*.yaml"))
    return _table(("name", "what happens"), ((f"`{file.stem}`", load_scenario(file).description) for file in files))


DOCUMENTS: Mapping[str, Callable[[], str]] = {
    "fault-kinds": kinds_of_faults,
    "fault-events": events,
    "scenarios": shipped_scenarios,
}
