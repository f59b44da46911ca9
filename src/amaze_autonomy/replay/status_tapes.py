"""The recorded statuses of a bag as events, many at once: out of columns of their messages, and out of tapes."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Any, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.engine import bundle, checks, codec, events, severity
from amaze_autonomy.engine.bundle import bundled, unbundled
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    Event,
    LandedStatus,
    MissionStatus,
    RecordingStatus,
    WatchdogAction,
    WatchdogInfo,
)

from . import statuses
from .errors import InvalidStatusError
from .statuses import EVENT_OF, FLAT, Flat, sent_by

__all__ = ["status_rows", "taped_statuses"]

_KIND = "statuses"
_CLASSES: Mapping[str, type] = {
    "watchdog_action": WatchdogAction,
    "watchdog_info": WatchdogInfo,
    "mission_planner": MissionStatus,
    "autopilot": AutopilotStatus,
    "landing_detection": LandedStatus,
    "data_recorder": RecordingStatus,
}


def taped_statuses(bag: Recording, topic: str, name: str) -> Optional[List[Event]]:
    """Return all statuses of a topic in the order of its entries, each with the session that was recorded.

    Returns:
        None without tapes, and when a message is damaged or holds what cannot be: then each is asked by itself.
    """
    tapes = bag.tapes
    if tapes is None or name not in _CLASSES:
        return None
    what = [topic, name, _code()]
    found = _unbundled(_CLASSES[name], tapes.text(_KIND, what))
    if found is not None and len(found) == len(bag.table(topic).t_ns):
        return found
    found = _read(bag, topic, name)
    if found is not None:
        tapes.keep_text(_KIND, what, bundled(found))
    return found


def status_rows(
    name: str, times: Sequence[int], rows: Sequence[Optional[Tuple[Any, ...]]], callers: Sequence[str]
) -> List[Optional[Event]]:
    """Return statuses out of their messages, or the columns `FLAT`; None for what must be asked for by itself."""
    make, names = EVENT_OF[name], [path.rpartition(".")[2] for path in FLAT.get(name, ())]
    found: List[Optional[Event]] = []
    for t_ns, row, caller in zip(times, rows, callers):
        try:
            whole = None if row is None else Flat(dict(zip(names, row))) if names else row[0]
            found.append(None if whole is None else make(sent_by(whole, caller), t_ns))
        except (InvalidStatusError, AttributeError, TypeError):  # of another type than the map says
            found.append(None)
    return found


def _unbundled(kind: type, text: Optional[str]) -> Optional[List[Event]]:
    try:
        return None if text is None else unbundled(kind, text)
    except ValueError:  # damaged: made anew
        return None


def _read(bag: Recording, topic: str, name: str) -> Optional[List[Event]]:
    make = EVENT_OF[name]
    try:
        return [
            make(sent_by(bag.message(entry), bag.caller(entry.connection)), entry.t_ns) for entry in bag.entries(topic)
        ]
    except (MessageError, InvalidStatusError, AttributeError, TypeError):
        return None


@lru_cache(maxsize=None)
def _code() -> str:
    """Return a digest of the code that makes the events: a tape of another version is another tape."""
    digest = hashlib.sha256()
    modules: Sequence[object] = (bundle, checks, codec, events, severity, statuses)
    for module in modules:
        digest.update(Path(str(getattr(module, "__file__", ""))).read_bytes())
    return digest.hexdigest()
