"""The parts of docs/ that are generated from the replay's tables."""

from __future__ import annotations

from typing import Callable, Mapping

from amaze_autonomy.config.reference import group_reference

from .tester_documents import TESTER_DOCUMENTS
from .topic_map import SCHEMA, load_map, map_names

__all__ = ["DOCUMENTS"]


def _schema() -> str:
    return group_reference(SCHEMA)


def _maps() -> str:
    rows = "".join(f"| `{name}` | {load_map(name).about} |\n" for name in map_names())
    return f"| Map | Recording |\n|---|---|\n{rows}"


DOCUMENTS: Mapping[str, Callable[[], str]] = {"topic-map": _schema, "topic-maps": _maps, **TESTER_DOCUMENTS}
"""By the name of the marker in a page."""
