"""Tables of keys: what a group may hold, what is filled in, what is said of an unknown key; and keys of a dataclass."""

from __future__ import annotations

import dataclasses
import difflib
import enum
import re
from dataclasses import dataclass
from math import degrees, radians
from typing import Any, Dict, Mapping, NoReturn, Tuple, Type, TypeVar

from amaze_autonomy.monitoring.errors import SpecError

from .document import Entry, Scalar, Table, entry_of
from .errors import ConfigError, Place
from .kinds import Address, Kind, Places, converted, described, dotted, refuse, split_unit, unit_words

# --- groups and keys --------------------------------------------------------------------------------------------------


class _Required:
    """Default of a key that must be given."""


REQUIRED = _Required()


@dataclass(frozen=True)
class Key:
    """One row of the schema.

    Args:
        name: with its unit as the last part.
        kind: what it may be given.
        meaning: one line.
        reason: why there is such a thing, or why the default is what it is; one line.
        default: REQUIRED; None: may be left out and is then not there; else the value, as it would be written.
    """

    name: str
    kind: Kind
    meaning: str
    reason: str = ""
    default: Any = REQUIRED


def is_required(key: Key) -> bool:
    """Return whether a key must be given."""
    return isinstance(key.default, _Required)


@dataclass(frozen=True)
class Group(Kind):
    """A group of known keys.

    Args:
        said: what it is, in words.
        keys: its rows.
    """

    said: str
    keys: Tuple[Key, ...]

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say what it is."""
        return f"a group of keys: {', '.join(key.name for key in self.keys)}"

    def read(self, entry: Entry, address: Address, places: Places) -> Dict[str, Any]:
        """Return every key of the group: given, default, or None; in the order of the schema."""
        places[address] = entry.place
        if not isinstance(entry, Table):
            refuse(entry, address, described(entry), "must be " + self.words())
        known = {key.name: key for key in self.keys}
        given: Dict[str, Any] = {}
        for name, (place, value) in entry.entries.items():
            if name not in known:
                self._unknown(place, address, name, value)
            given[name] = known[name].kind.read(value, (*address, name), places)
            places[(*address, name)] = place
        return {
            key.name: given[key.name] if key.name in given else self._absent(key, entry, address) for key in self.keys
        }

    def _absent(self, key: Key, entry: Entry, address: Address) -> Any:
        if is_required(key):
            right = f"must be given: {key.kind.words(unit_words(key.name))}"
            refuse(entry, (*address, key.name), "is missing", right)
        if key.default is None:
            return None
        return key.kind.read(entry_of(key.default, entry.place), (*address, key.name), {})

    def _unknown(self, place: Place, address: Address, name: str, value: Entry) -> NoReturn:
        right = _meant(name, value, tuple(key.name for key in self.keys))
        raise ConfigError(place, dotted((*address, name)), "is an unknown key", right)


_RENAMED: Mapping[str, str] = {"losses": "failsafe"}
"""Keys of before, and what they are called now."""


def _meant(name: str, value: Entry, known: Tuple[str, ...]) -> str:
    """Say which key was probably meant: the same with another unit, one that is spelled alike, or any of these."""
    if _RENAMED.get(name) in known:
        return f"it is called {_RENAMED[name]} now"
    stem, unit = split_unit(name)
    same = [each for each in known if split_unit(each)[0] in (stem, name) and split_unit(each)[1]]
    if same:
        measured_alike = (each for each in same if converted(1.0, unit, split_unit(each)[1]))
        candidate = next(measured_alike, same[0])
        return f"did you mean {candidate}{_in_other_unit(value, unit, split_unit(candidate)[1])}?"
    close = difflib.get_close_matches(name, known, n=1)
    if close:
        return f"did you mean {close[0]}?"
    return f"known here: {', '.join(known)}"


def _in_other_unit(value: Entry, given: str, wanted: str) -> str:
    try:
        words = converted(float(value.text), given, wanted) if isinstance(value, Scalar) else None
    except ValueError:
        words = None
    return f" ({words})" if words else f" ({unit_words('x_' + wanted)})"


@dataclass(frozen=True)
class Named(Kind):
    """A group whose keys are names that the user gives.

    Args:
        said: what the names are, in words.
        pattern: regular expression that a whole name matches.
        kind: of each value.
        at_least: so many.
    """

    said: str
    pattern: str
    kind: Kind
    at_least: int = 0

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say what the names are."""
        size = f", at least {self.at_least}" if self.at_least else ""
        return f"a group with a key for each of the {self.said}{size}"

    def read(self, entry: Entry, address: Address, places: Places) -> Dict[str, Any]:
        """Return the values by name, in the order of the file."""
        places[address] = entry.place
        if not isinstance(entry, Table) or len(entry.entries) < self.at_least:
            refuse(
                entry, address, "is empty" if isinstance(entry, Table) else described(entry), "must be " + self.words()
            )
        values: Dict[str, Any] = {}
        for name, (place, value) in entry.entries.items():
            here = (*address, name)
            if re.fullmatch(self.pattern, name) is None:
                raise ConfigError(place, dotted(here), "is not a good name", f"must match {self.pattern}")
            values[name] = self.kind.read(value, here, places)
            places[here] = place
        return values


# --- keys of a dataclass ----------------------------------------------------------------------------------------------
# A field in nanoseconds is a key in seconds, a field in radians a key in degrees; an enumeration is written by its
# value. So a default stands in one place, the dataclass, and a key cannot drift from its field.


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
