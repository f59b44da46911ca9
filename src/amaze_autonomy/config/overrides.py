"""Overrides: single values given on top of the files, e.g. by a launch file or a scenario. Checked like the files.

autonomy.require_go=true
sensors.components.gps.severity=high
missions.missions.1.repetitions=3
"""

from __future__ import annotations

from typing import Any, Dict, Iterable, List, Mapping, Tuple, Union

from .document import Entry, entry_of, parse, replace
from .errors import ConfigError, Place

__all__ = ["Overrides", "apply_overrides"]

Overrides = Union[Iterable[str], Mapping[str, Any]]


def apply_overrides(trees: Mapping[str, Entry], overrides: Overrides) -> Dict[str, Entry]:
    """Return the trees of the files with the overrides in them; a later one wins over an earlier one.

    Raises:
        ConfigError: an override is not `file.key=value`, or addresses what cannot be.
    """
    changed = dict(trees)
    for place, address, value in _pairs(overrides):
        name, path = address[0], address[1:]
        if name not in changed or not path or not all(path):
            right = f"must be file.key.key=value with the file one of {', '.join(trees)}"
            raise ConfigError(place, "", "addresses no key", right)
        new = replace(changed[name], path, value)
        if new is None:
            raise ConfigError(place, "", "leads through a single value", "must address a key of a group")
        changed[name] = new
    return changed


def _pairs(overrides: Overrides) -> List[Tuple[Place, Tuple[str, ...], Entry]]:
    if isinstance(overrides, Mapping):
        pairs = []
        for key, value in overrides.items():
            place = Place(f"override {key}")
            pairs.append((place, tuple(str(key).split(".")), entry_of(value, place)))
        return pairs
    return [_parsed(text) for text in ([overrides] if isinstance(overrides, str) else overrides)]


def _parsed(text: str) -> Tuple[Place, Tuple[str, ...], Entry]:
    place = Place(f"override {text}")
    key, equals, value = text.partition("=")
    if not equals:
        raise ConfigError(place, "", "has no value", "must be file.key.key=value")
    return place, tuple(key.strip().split(".")), parse(value, place.source, lines=False)
