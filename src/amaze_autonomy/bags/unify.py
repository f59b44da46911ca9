"""Which connections of several bags are one connection of the merged bag."""

from __future__ import annotations

from typing import Any, Dict, List, NamedTuple, Sequence, Set, Tuple

import numpy as np

from .connections import Connection, Identity
from .index import Index

__all__ = ["Unified", "unify"]


class Unified(NamedTuple):
    """Connections of the merged bag.

    Args:
        connections: by number.
        targets: for each input, an array from its numbers to ours.
        comparable: numbers that several inputs have on the same topic; the same value for those whose messages may be
            the same ones.
        warnings: topics with more than one definition.
    """

    connections: Dict[int, Connection]
    targets: List[Any]
    comparable: Dict[int, int]
    warnings: Tuple[str, ...]


def unify(inputs: Sequence[Index], *, publishers_apart: bool) -> Unified:
    """Give the same number to connections that are the same; keep the numbers of the first input."""
    numbers: Dict[Identity, int] = {}
    connections: Dict[int, Connection] = {}
    targets = []
    sources: Dict[int, Set[int]] = {}
    for place, index in enumerate(inputs):
        target: Any = np.zeros(max(index.connections, default=0) + 1, np.int64)
        for number, connection in sorted(index.connections.items()):
            identity = connection.identity(publishers_apart=publishers_apart)
            if identity not in numbers:
                numbers[identity] = number if number not in connections else _free(connections)
                connections[numbers[identity]] = connection._replace(number=numbers[identity])
            target[number] = numbers[identity]
            sources.setdefault(numbers[identity], set()).add(place)
        targets.append(target)
    return Unified(connections, targets, _comparable(connections, sources), _warnings(connections))


def _free(taken: Dict[int, Connection]) -> int:
    return max(taken) + 1


def _comparable(connections: Dict[int, Connection], sources: Dict[int, Set[int]]) -> Dict[int, int]:
    """Group connections of one topic and definition, by publisher where every input knows it."""
    topics: Dict[Tuple[str, str, str], List[int]] = {}
    for number, each in connections.items():
        topics.setdefault((each.topic, each.kind, each.md5), []).append(number)
    groups: List[List[int]] = []
    for members in topics.values():
        callers: Dict[str, List[int]] = {}
        for number in members:
            callers.setdefault(connections[number].caller, []).append(number)
        groups.extend([members] if "" in callers else callers.values())
    several = [group for group in groups if len(set().union(*(sources[number] for number in group))) > 1]
    return {number: min(group) for group in several for number in group}


def _warnings(connections: Dict[int, Connection]) -> Tuple[str, ...]:
    definitions: Dict[str, Set[Tuple[str, str]]] = {}
    for each in connections.values():
        definitions.setdefault(each.topic, set()).add((each.kind, each.md5))
    return tuple(
        f"{topic} has {len(found)} definitions, which stay apart: "
        + ", ".join(f"{kind} ({md5})" for kind, md5 in sorted(found))
        for topic, found in sorted(definitions.items())
        if len(found) > 1
    )
