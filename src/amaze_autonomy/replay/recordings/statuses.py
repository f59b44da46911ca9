"""Statuses of our own nodes that a recording carries, as events of the engine: by the rows of `interface.STATUSES`."""

from __future__ import annotations

import hashlib
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.engine.events import Event, InvalidEventError
from amaze_autonomy.interface import STATUSES, InvalidMessageError, Status, fields, tables

from ...engine import events, rules
from ...journal import codec
from ...journal.codec import bundled, unbundled

_S = 1_000_000_000
_SENDER = "published_by"
_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
_ROWS: Mapping[str, Status] = {status.name: status for status in STATUSES}

EVENT_OF: Mapping[str, Callable[[Any, int], Event]] = {
    name: lambda message, t_ns, row=row: _event(row, message, t_ns)  # type: ignore[misc]
    for name, row in _ROWS.items()
}
"""By the name of the status in a topic map: message and time of recording to event."""

FLAT: Mapping[str, Tuple[str, ...]] = {
    name: (*_STAMP, *row.shape.flat) for name, row in _ROWS.items() if row.shape.flat
}
"""Every field of a status that is looked at, for those that have no list in them: such are read as columns."""


def sent_by(message: Any, caller: str) -> Any:
    """Note on a message which node has published it; that is a fact of its connection, not of the message."""
    setattr(message, _SENDER, caller)
    return message


def _event(row: Status, message: Any, t_ns: int) -> Event:
    stamp = message if message.__class__ is Flat else message.header.stamp
    age_ns = t_ns - (int(stamp.sec) * _S + int(stamp.nanosec))
    return row.read(message, t_ns, age_ns, str(getattr(message, _SENDER, "")))


class Flat:
    """A message by its fields alone, with the face of a whole one; the stamp is in the message itself."""

    def __init__(self, fields: Dict[str, Any]) -> None:
        self.__dict__.update(fields)

    @property
    def header(self) -> Flat:
        """The header, in which only the stamp is."""
        return self

    @property
    def stamp(self) -> Flat:
        """The stamp, `sec` and `nanosec`."""
        return self


# --- status tapes -----------------------------------------------------------------------------------------------------
# The recorded statuses of a bag as events, many at once: out of columns of their messages, and out of tapes.


_KIND = "statuses"


def taped_statuses(bag: Recording, topic: str, name: str) -> Optional[List[Event]]:
    """Return all statuses of a topic in the order of its entries, each with the session that was recorded.

    Returns:
        None without tapes, and when a message is damaged or holds what cannot be: then each is asked by itself.
    """
    tapes = bag.tapes
    if tapes is None or name not in _ROWS:
        return None
    what = [topic, name, _code()]
    found = _unbundled(_ROWS[name].event, tapes.text(_KIND, what))
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
        except (InvalidMessageError, InvalidEventError, AttributeError, TypeError):  # of another type than the map says
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
    except (MessageError, InvalidMessageError, InvalidEventError, AttributeError, TypeError):
        return None


@lru_cache(maxsize=None)
def _code() -> str:
    """Return a digest of the code that makes the events: a tape of another version is another tape."""
    digest = hashlib.sha256()
    modules: Sequence[object] = (codec, events, fields, rules, tables, sys.modules[__name__])
    for module in modules:
        digest.update(Path(str(getattr(module, "__file__", ""))).read_bytes())
    return digest.hexdigest()
