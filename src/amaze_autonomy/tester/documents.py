"""The generated parts of docs/tester.md and docs/replay.md: scenarios, expectations, faults, and topic maps."""

from __future__ import annotations

from typing import Callable, List, Mapping

from amaze_autonomy.config.document import Items, Scalar, Table
from amaze_autonomy.config.errors import Place
from amaze_autonomy.config.reference import group_reference
from amaze_autonomy.simulation import Subject
from amaze_autonomy.simulation.documents import kinds_table

from ..replay.faults import RECORDED_KINDS, TOPIC
from ..replay.topic_map import SCHEMA, load_map, map_names
from .expect import EXPECTATIONS, ExpectationKind
from .scenario.schema import schema_of

__all__ = ["DOCUMENTS"]

_HEADS = {
    TOPIC: "### `topic:` a topic that the map reads",
    Subject.COMPONENT: "### `component:` all topics of a component",
    Subject.PROCESS: "### `process:` what a peer says, and the engine itself",
    Subject.SERVICE: "### `service:` what the scripted peers answer",
    Subject.WORLD: "### The whole recording: no target",
}


def _expectations() -> str:
    rows = ["| `expect` | Keys | Holds when |", "|---|---|---|"]
    rows += [f"| `{kind.name}` | {_keys(kind)} | {kind.words} |" for kind in EXPECTATIONS.values()]
    return "\n".join(rows) + "\n"


def _keys(kind: ExpectationKind) -> str:
    patterns = ", ".join(f"`{name}`{' (a list)' if kind.many else ''}" for name in kind.patterns)
    numbers = " or ".join(f"`{name}`" for name in kind.numbers)
    return f"{patterns}; {numbers}{'' if kind.needs else ' if wanted'}" if numbers else patterns


def _faults() -> str:
    parts: List[str] = []
    for subject, head in _HEADS.items():
        kinds = [kind for kind in RECORDED_KINDS.values() if kind.subject == subject]
        parts.append(f"{head}\n\n{kinds_table(kinds)}")
    return "\n".join(parts)


def _scenario() -> str:
    """Return the keys of a scenario on bags, which has the most."""
    place = Place("")
    tree = Table(place, {"bags": (place, Items(place, (Scalar(place, "", "str"),)))})
    return group_reference(schema_of(tree))


def _topic_map() -> str:
    return group_reference(SCHEMA)


def _topic_maps() -> str:
    rows = "".join(f"| `{name}` | {load_map(name).about} |\n" for name in map_names())
    return f"| Map | Recording |\n|---|---|\n{rows}"


DOCUMENTS: Mapping[str, Callable[[], str]] = {
    "topic-map": _topic_map,
    "topic-maps": _topic_maps,
    "scenario-keys": _scenario,
    "expectations": _expectations,
    "recorded-faults": _faults,
}
"""By the name of the marker in a page."""
