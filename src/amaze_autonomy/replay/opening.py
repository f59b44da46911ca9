"""Files as recordings: bags, and MAVLink in a file of its own or inside a bag, whose code is loaded only for that."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Iterable, List, Optional, Tuple

from amaze_autonomy.bags import BagError, Recording
from amaze_autonomy.bags.index import Index

__all__ = ["MAVLINK_KIND", "recordings_of", "topics_of"]

MAVLINK_KIND = "mavros_msgs/Mavlink"
_LOG = ".tlog"


def recordings_of(path: Path) -> List[Any]:
    """Return a file as recordings: a telemetry log, or a bag and, where it carries MAVLink, that as another one.

    Raises:
        BagError: It cannot be read.
    """
    if path.suffix == _LOG:
        from .telemetry import Telemetry  # noqa: PLC0415

        return [Telemetry.of_log(path)]
    bag = Recording(path)
    topics = [topic.name for topic in bag.topics if topic.kind == MAVLINK_KIND]
    if not topics:
        return [bag]
    from .telemetry import Telemetry  # noqa: PLC0415

    return [bag, Telemetry.of_bag(bag, topics)]


def topics_of(paths: Iterable[Path]) -> Tuple[str, ...]:
    """Return every topic of some files, each once.

    Raises:
        BagError: One cannot be read.
    """
    return tuple(dict.fromkeys(name for path in paths for name in _topics(path)))


def _topics(path: Path) -> Iterable[str]:
    if path.suffix == _LOG:
        from .telemetry import topics_of_log  # noqa: PLC0415

        return topics_of_log(path)
    named = _named(path)
    if named is not None:
        return named
    names: List[str] = []
    for recording in recordings_of(path):
        names += [topic.name for topic in recording.topics]
        recording.close()
    return names


def _named(path: Path) -> Optional[List[str]]:
    """Return the topics that a bag names, without a look at its messages; None when they must be looked at."""
    try:
        with Index(path) as index:
            connections = list(index.connections.values())
    except BagError:
        return None
    if any(connection.kind == MAVLINK_KIND for connection in connections):
        return None
    return sorted({connection.topic for connection in connections})
