"""Many events of one kind as one text and back, none of them checked again: for caches of what was checked before.

A bundle is JSON: for each field the values of all events, in their order, as the journal has them. Values that are no
numbers, words or None are texts of JSON themselves, and decoded once for each that is different.
"""

from __future__ import annotations

import json
from typing import Any, Callable, Dict, List, Sequence

from .codec import decoder_of, plain_fields, to_plain

__all__ = ["bundled", "unbundled"]


def bundled(events: Sequence[Any]) -> str:
    """Return events, all of one class, as a bundle.

    Raises:
        ValueError: A number is not finite.
    """
    plain = plain_fields(type(events[0])) if events else {}
    columns: Dict[str, List[Any]] = {name: [] for name in plain}
    for event in events:
        for name, value in to_plain(event).items():
            columns[name].append(value if plain[name] else json.dumps(value, allow_nan=False))
    return json.dumps(columns, allow_nan=False, separators=(",", ":"))


def unbundled(kind: type, text: str) -> List[Any]:
    """Return the events of a bundle.

    Raises:
        ValueError: It is none, or of another class, or of another version of it.
    """
    columns = json.loads(text)
    plain = plain_fields(kind)
    if not isinstance(columns, dict) or (columns and columns.keys() != plain.keys()):
        raise ValueError(f"no bundle of {kind.__name__}")
    values = [columns[name] if plain[name] else _decoded(decoder_of(kind, name), columns[name]) for name in columns]
    return [_made(kind, dict(zip(columns, each))) for each in zip(*values)]


def _decoded(decode: Callable[[Any, str], Any], texts: Sequence[str]) -> List[Any]:
    known = {text: decode(json.loads(text), "") for text in set(texts)}
    return [known[text] for text in texts]


def _made(kind: type, fields: Dict[str, Any]) -> Any:
    event: Any = object.__new__(kind)
    event.__dict__.update(fields)
    return event
