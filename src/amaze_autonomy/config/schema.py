"""Tables of keys: what a group may hold, what is filled in, and what is said about a key that nobody knows."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from typing import Any, Dict, NoReturn, Tuple

from .document import Entry, Scalar, Table, entry_of
from .errors import ConfigError, Place
from .kinds import Address, Kind, Places, converted, described, dotted, refuse, split_unit, unit_words

__all__ = ["REQUIRED", "Group", "Key", "Named", "is_required"]


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


def _meant(name: str, value: Entry, known: Tuple[str, ...]) -> str:
    """Say which key was probably meant: the same with another unit, one that is spelled alike, or any of these."""
    stem, unit = split_unit(name)
    for candidate in known:
        if split_unit(candidate)[0] in (stem, name) and split_unit(candidate)[1]:
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
