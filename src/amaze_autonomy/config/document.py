"""Reads YAML into a tree that knows its lines: `safe_load` without its silences.

What `safe_load` lets pass in silence is an error here: a key given twice, an alias, a merge key, a tag, a second
document. The tree is built from parser events, not by PyYAML's composer, which is recursive: a file of brackets alone
would end the process. Scalars are resolved as `safe_load` resolves them (YAML 1.1) and converted by the schema.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple, Union

import yaml

from .errors import ConfigError, Place

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the same parser, some ten times faster with libyaml
_RESOLVER: Any = yaml.resolver.Resolver()
_DEPTH = 12
_BYTES = 1_000_000
_TAGS = {f"tag:yaml.org,2002:{name}": name for name in ("bool", "float", "int", "null", "str", "timestamp")}


@dataclass(frozen=True)
class Entry:
    """A node of the tree.

    Args:
        place: where it stands.
    """

    place: Place


@dataclass(frozen=True)
class Scalar(Entry):
    """A single value, as written.

    Args:
        text: its characters, without quotes.
        tag: what YAML 1.1 takes it for: bool, float, int, null, str or timestamp.
    """

    text: str
    tag: str


@dataclass(frozen=True)
class Items(Entry):
    """A list."""

    items: Tuple[Entry, ...]


@dataclass(frozen=True)
class Table(Entry):
    """A mapping; the keys in the order of the file, each with its place."""

    entries: Mapping[str, Tuple[Place, Entry]]


def read(path: Path) -> Entry:
    """Read one YAML file.

    Raises:
        ConfigError: it cannot be read, or is not one plain YAML document.
    """
    place = Place(str(path))
    try:
        if path.exists() and not path.is_file():  # whoever opens a FIFO waits for ever, and a device never ends
            raise ConfigError(place, "", "is no file", "must be a readable file")
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(place, "", f"cannot be read ({error.strerror})", "must be a readable file") from None
    if len(content) > _BYTES:
        raise ConfigError(place, "", f"has {len(content)} bytes", f"must be a configuration of at most {_BYTES} bytes")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ConfigError(Place(str(path), line), "", "is not UTF-8", "must be saved as UTF-8 text") from None
    return parse(text, str(path))


def parse(text: str, source: str, *, lines: bool = True) -> Entry:
    """Build the tree of one YAML text.

    Args:
        text: the YAML.
        source: name of the file for errors.
        lines: count lines; False for a text that is not in a file.

    Raises:
        ConfigError: it is not one plain YAML document.
    """
    try:
        return _Builder(text, source, lines=lines).document()
    except yaml.MarkedYAMLError as error:
        mark = (_begins_at(error) and error.context_mark) or error.problem_mark or error.context_mark
        place = Place(source, mark.line + 1 if mark is not None and lines else 0)
        tab = "\t" in "".join(text.split("\n")[mark.line : mark.line + 1]) if mark is not None else False
        right = _PLAIN + (", indented with spaces: there is a tab" if tab else "")
        raise ConfigError(place, "", f"is not YAML ({error.problem or error.context})", right) from None
    except yaml.YAMLError as error:
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ConfigError(Place(source), "", f"is not YAML ({words})", _PLAIN) from None
    except ConfigError:
        raise
    except (ValueError, OverflowError) as error:  # PyYAML's own parser on escapes of characters that there are not
        raise ConfigError(Place(source), "", f"is not YAML ({error})", _PLAIN) from None


_PLAIN = "must be one YAML document"


def _begins_at(error: yaml.MarkedYAMLError) -> bool:
    """Return whether the mistake is where something begins, and shows further below: a missing colon or quote."""
    return error.context == "while scanning a simple key" or error.problem == "found unexpected end of stream"


class _Builder:
    """Turns the parser's events into the tree."""

    def __init__(self, text: str, source: str, *, lines: bool) -> None:
        self._events: Iterator[Any] = iter(yaml.parse(text, Loader=_LOADER))
        self._source, self._lines = source, lines

    def document(self) -> Entry:
        next(self._events)  # StreamStart
        start = next(self._events)
        if isinstance(start, yaml.StreamEndEvent):
            raise ConfigError(Place(self._source), "", "is empty", _PLAIN)
        tree = self._entry(next(self._events), ())
        next(self._events)  # DocumentEnd
        end = next(self._events)
        if not isinstance(end, yaml.StreamEndEvent):
            raise ConfigError(self._place(end), "", "a second document starts here", _PLAIN)
        return tree

    def _place(self, event: Any) -> Place:
        return Place(self._source, event.start_mark.line + 1 if self._lines else 0)

    def _entry(self, event: Any, path: Tuple[str, ...]) -> Entry:
        place, key = self._place(event), ".".join(path)
        if isinstance(event, yaml.AliasEvent):
            raise ConfigError(place, key, f"*{event.anchor} is an alias", "must be written out")
        if len(path) > _DEPTH:
            raise ConfigError(place, key, "is nested too deeply", f"must have at most {_DEPTH} levels")
        if isinstance(event, yaml.ScalarEvent):
            return self._scalar(event, place, key)
        if event.tag not in (None, "!"):
            raise ConfigError(place, key, f"has the tag {event.tag}", "must be written without a tag")
        if isinstance(event, yaml.SequenceStartEvent):
            return self._items(place, path)
        return self._table(place, path)

    def _scalar(self, event: Any, place: Place, key: str) -> Scalar:
        if event.tag not in (None, "!"):
            raise ConfigError(place, key, f"has the tag {event.tag}", "must be written without a tag")
        tag = _RESOLVER.resolve(yaml.ScalarNode, event.value, event.implicit)
        if event.tag == "!":
            tag = "tag:yaml.org,2002:str"
        return Scalar(place, event.value, _TAGS.get(tag, "str"))

    def _items(self, place: Place, path: Tuple[str, ...]) -> Items:
        items: List[Entry] = []
        while True:
            event = next(self._events)
            if isinstance(event, yaml.SequenceEndEvent):
                return Items(place, tuple(items))
            items.append(self._entry(event, (*path, str(len(items)))))

    def _table(self, place: Place, path: Tuple[str, ...]) -> Table:
        entries: Dict[str, Tuple[Place, Entry]] = {}
        while True:
            event = next(self._events)
            if isinstance(event, yaml.MappingEndEvent):
                return Table(place, entries)
            key, here = self._key(event, path), self._place(event)
            address = (*path, key)
            if key in entries:
                first = entries[key][0]
                where = f" (first in line {first.line})" if first.line else ""
                raise ConfigError(here, ".".join(address), f"is given twice{where}", "must be given once")
            entries[key] = here, self._entry(next(self._events), address)

    def _key(self, event: Any, path: Tuple[str, ...]) -> str:
        if not isinstance(event, yaml.ScalarEvent) or event.tag not in (None, "!"):
            raise ConfigError(
                self._place(event), ".".join(path), "has a key that is not a word", "must have plain keys"
            )
        if event.value == "<<" and event.implicit[0]:
            right = "must be written out: merge keys are not taken"
            raise ConfigError(self._place(event), ".".join((*path, "<<")), "is a merge key", right)
        return str(event.value)


_Plain = Union[None, bool, int, float, str, List[Any], Tuple[Any, ...], Mapping[str, Any]]


def entry_of(value: _Plain, place: Place) -> Entry:
    """Build the tree of a Python value, as if it had been written in YAML.

    Raises:
        ConfigError: the value has a type that YAML's plain types do not know.
    """
    if isinstance(value, Mapping):
        return Table(place, {str(key): (place, entry_of(item, place)) for key, item in value.items()})
    if isinstance(value, (list, tuple)):
        return Items(place, tuple(entry_of(item, place) for item in value))
    if value is None:
        return Scalar(place, "null", "null")
    if isinstance(value, bool):
        return Scalar(place, "true" if value else "false", "bool")
    for kind, tag in ((int, "int"), (float, "float"), (str, "str")):
        if isinstance(value, kind):
            return Scalar(place, str(value), tag)
    raise ConfigError(place, "", f"is a {type(value).__name__}", "must be a plain value")


def replace(tree: Entry, path: Tuple[str, ...], value: Entry) -> Optional[Entry]:
    """Return the tree with the entry at `path` set to `value`; None when the path leads through a single value.

    A table on the way that is not there yet is made, so that an override can say what the file leaves to its default.
    An item of a list is addressed by its number from 0.
    """
    if not path:
        return value
    head, rest = path[0], path[1:]
    if isinstance(tree, Table):
        place, old = tree.entries.get(head, (value.place, Table(value.place, {})))
        new = replace(old, rest, value)
        return None if new is None else Table(tree.place, {**tree.entries, head: (place, new)})
    if isinstance(tree, Items) and head.isdecimal() and int(head) < len(tree.items):
        new = replace(tree.items[int(head)], rest, value)
        position = int(head)
        return None if new is None else Items(tree.place, (*tree.items[:position], new, *tree.items[position + 1 :]))
    return None
