"""Connects a frozen dataclass with its group of keys: names, units, defaults and conversion come from the dataclass.

A field in nanoseconds is a key in seconds, a field in radians a key in degrees; an enumeration is written by its value.
So a default stands in one place, the dataclass, and a key cannot drift from its field.
"""

from __future__ import annotations

import dataclasses
import enum
import re
from math import degrees, radians
from typing import Any, Dict, Mapping, NoReturn, Tuple, Type, TypeVar

from amaze_autonomy.monitoring.errors import SpecError

from .errors import ConfigError, Place
from .kinds import Address, Kind, Places, dotted
from .schema import REQUIRED, Group, Key

__all__ = ["Row", "bind", "field_value", "group_of", "key_name", "key_value", "make", "place_of", "refuse_at"]

T = TypeVar("T")
Row = Tuple[str, Kind, str, str]  # field, what it may be given, meaning, reason
_S = 1_000_000_000


def key_name(field: str) -> str:
    """Return the key of a field: `age_limit_ns` is `age_limit_s`, `max_tilt_rad` is `max_tilt_deg`."""
    if field.endswith("_ns"):
        return field[:-3] + "_s"
    return field[:-4] + "_deg" if field.endswith("_rad") else field


def key_value(field: str, value: Any) -> Any:
    """Return a field's value as it is written under its key."""
    if value is None:
        return None
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, tuple):
        return [key_value(field, item) for item in value]
    if field.endswith("_ns"):
        return value / _S
    return round(degrees(value), 9) if field.endswith("_rad") else value


def field_value(field: str, value: Any) -> Any:
    """Return a key's value as its field takes it; enumerations are made by the caller."""
    if isinstance(value, list):
        return tuple(field_value(field, item) for item in value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return value
    if field.endswith("_ns"):
        return round(value * _S)
    return radians(value) if field.endswith("_rad") else value


def bind(cls: Type[Any], field: str, kind: Kind, meaning: str, reason: str = "") -> Key:
    """Return the key of a field of a dataclass, with the field's default."""
    found = {entry.name: entry for entry in dataclasses.fields(cls)}[field]
    default: Any = REQUIRED
    if found.default is not dataclasses.MISSING:
        default = key_value(field, found.default)
    return Key(key_name(field), kind, meaning, reason, default)


def group_of(cls: Type[Any], said: str, rows: Tuple[Row, ...]) -> Group:
    """Return the group of keys of a dataclass, one per row."""
    return Group(said, tuple(bind(cls, field, kind, meaning, reason) for field, kind, meaning, reason in rows))


def make(cls: Type[T], values: Mapping[str, Any], address: Address, places: Places, **given: Any) -> T:
    """Build a dataclass from the values of its keys; fields in `given` are taken from there.

    Raises:
        ConfigError: the dataclass refuses the values; it names the key, or the group where the key is not known.
    """
    taken: Dict[str, Any] = dict(given)
    for entry in dataclasses.fields(cls):  # type: ignore[arg-type]
        key = key_name(entry.name)
        if entry.name not in taken and key in values:
            taken[entry.name] = field_value(entry.name, values[key])
    try:
        return cls(**taken)
    except SpecError as error:
        here = (*address, key_name(error.field))
        wrong = f"is {key_value(error.field, error.value)!r}"
        raise ConfigError(place_of(here, places), dotted(here), wrong, "must be " + _in_keys(error.expected)) from None
    except ValueError as error:
        raise ConfigError(place_of(address, places), dotted(address), str(error), "must be possible") from None


def _in_keys(words: str) -> str:
    """Return the words of a specification with the names of its fields as keys."""
    return re.sub(r"[a-z_]+_(ns|rad)\b", lambda found: key_name(found.group()), words)


def place_of(address: Address, places: Places) -> Place:
    """Return where a key stands; for one that was left out, where the group stands that could hold it."""
    for length in range(len(address), -1, -1):
        if address[:length] in places:
            return places[address[:length]]
    return Place("configuration")


def refuse_at(address: Address, places: Places, wrong: str, right: str) -> NoReturn:
    """Raise the error about a key, with the place where it stands."""
    raise ConfigError(place_of(address, places), dotted(address), wrong, right)
