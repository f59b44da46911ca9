"""The journal as text: JSON Lines, one line per header, event or decision. Pure: the shells write and read the files.

Every input event of the engine is a line, each decision a line after the event that led to it, so that a journal alone
can be decided again. A line is canonical: keys sorted, no spaces, ASCII, floats by `repr`, no NaN; the same event is
the same bytes on every Python. Wall time stands in the header only.

    {"configuration":{...},"hash":"...","kind":"header","rules":{...},"version":1}
    {"command":"GO","event":"UserRequest","kind":"event","request_id":0,"t_ns":12}
    {"after":"...","before":"...","commands":[],"event":"UserRequest","kind":"decision",...}

Adding a field with a default keeps old journals readable; any other change needs a new `VERSION`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from json.encoder import c_make_encoder, encode_basestring_ascii  # type: ignore[attr-defined]
from math import isfinite
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Tuple, Union

from ..engine import events as _events
from ..engine.commands import Decision
from ..engine.events import Event
from ..engine.rules import Rules
from .codec import CodecError, Form, form_of, from_plain, to_plain

__all__ = [
    "VERSION",
    "Journal",
    "JournalError",
    "JournalLine",
    "decode",
    "encode_decision",
    "encode_event",
    "encode_header",
    "make_header",
    "read",
    "rules_of",
    "whole_lines",
]

VERSION = 1

Payload = Union[Event, Decision, Dict[str, Any]]

_JSON = json.JSONEncoder(separators=(",", ":"), sort_keys=True, allow_nan=False)


def _made_encoder() -> Callable[[Any], str]:
    """Return the encoder's `encode`, without the work that it does anew for each value where Python has it in C."""
    if c_make_encoder is None:
        return _JSON.encode
    pieces = c_make_encoder(None, _JSON.default, encode_basestring_ascii, None, ":", ",", True, False, False)
    return lambda value: "".join(pieces(value, 0))


_encode_json = _made_encoder()
_EVENTS: Mapping[str, type] = {
    name: kind
    for name, kind in sorted(vars(_events).items())
    if isinstance(kind, type) and issubclass(kind, Event) and kind is not Event
}

_forms: Dict[type, Form] = {}


class JournalError(ValueError):
    """A journal cannot be written or read.

    Args:
        what: what is wrong, in words.
        line_number: of the line, from 1; None when it is not about one line.
        remedy: what would be right, or what to do.
    """

    def __init__(self, what: str, line_number: Optional[int] = None, remedy: str = "") -> None:
        place = "" if line_number is None else f"line {line_number}: "
        super().__init__(f"{place}{what}" + (f" ({remedy})" if remedy else ""))
        self.what, self.line_number, self.remedy = what, line_number, remedy


@dataclass(frozen=True)
class JournalLine:
    """One line of a journal: `kind` is header, event or decision, `payload` a dict, an Event or a Decision."""

    kind: str
    payload: Payload
    line_number: int = 0


@dataclass(frozen=True)
class Journal:
    """A whole journal.

    Args:
        lines: every line that is whole, in order.
        truncated: the last line is not whole: the process was killed while it wrote.
    """

    lines: Tuple[JournalLine, ...]
    truncated: bool


def encode_event(event: Event) -> str:
    """Return the line of an event, without its end of line.

    Raises:
        JournalError: It is not an event of `events.py`, or a field holds what its annotation forbids.
    """
    form = _forms.get(type(event))
    if form is None:
        form = _forms[type(event)] = _form(type(event))
    try:
        line = form(event)
    except (KeyError, ValueError):  # of another type than annotated
        return _encode_event(event)
    return _encode_event(event) if "nan" in line or "inf" in line else line


def _form(kind: type) -> Form:
    if _EVENTS.get(kind.__name__) is not kind:
        raise JournalError(f"{kind.__name__} is no event of the engine")
    return form_of(kind, (("event", kind.__name__), ("kind", "event"))) or _encode_event


def _encode_event(event: Event) -> str:
    return _encode(event, {"event": type(event).__name__, "kind": "event"})


def encode_decision(decision: Decision) -> str:
    """Return the line of a decision, without its end of line.

    Raises:
        JournalError: A field holds what its annotation forbids.
    """
    return _encode(decision, {"kind": "decision"})


def encode_header(header: Mapping[str, Any]) -> str:
    """Return the line of a header, without its end of line.

    Raises:
        JournalError: It holds what JSON cannot.
    """
    try:
        return _encode_json({"version": VERSION, **header, "kind": "header"})
    except (TypeError, ValueError) as error:
        raise JournalError(f"the header cannot be written: {error}") from error


def make_header(
    rules: Rules, configuration: Mapping[str, Any], configuration_hash: str, **about: Any
) -> Dict[str, Any]:
    """Return a header that a journal can be decided again with.

    Args:
        rules: the engine decides by.
        configuration: the effective configuration, JSON values only.
        configuration_hash: of it.
        about: anything else, e.g. who wrote it, the wall time, the recordings it was made from.
    """
    return {**about, "configuration": dict(configuration), "hash": configuration_hash, "rules": to_plain(rules)}


def rules_of(line: JournalLine) -> Rules:
    """Return the rules that a header carries.

    Raises:
        JournalError: It carries none, or what it carries are no rules.
    """
    header = line.payload
    if line.kind != "header" or not isinstance(header, dict) or "rules" not in header:
        raise JournalError("no rules here", line.line_number, "name a configuration to decide with")
    try:
        rules: Rules = from_plain(Rules, header["rules"], "rules")
    except CodecError as error:
        raise JournalError(str(error), line.line_number, "written by another version") from error
    return rules


def decode(line: str, line_number: int = 1) -> JournalLine:
    """Read one line of a journal.

    Raises:
        JournalError: It is not a line that this module writes.
    """
    data = _parse(line, line_number)
    kind = data.pop("kind", None)
    try:
        if kind == "event":
            return JournalLine(kind, from_plain(_event_class(data.pop("event", None)), data), line_number)
        if kind == "decision":
            return JournalLine(kind, from_plain(Decision, data), line_number)
    except CodecError as error:
        raise JournalError(str(error), line_number, "written by another version, or damaged") from error
    if kind == "header":
        return JournalLine(kind, _checked_header(data, line_number), line_number)
    raise JournalError(f"kind is {kind!r}", line_number, "must be header, event or decision")


def read(text: str) -> Journal:
    """Read a whole journal; a last line that is not whole is left out and said.

    Raises:
        JournalError: A line that is not the last is damaged, or the journal is empty or has no header.
    """
    parts = text.split("\n")
    last = parts.pop()
    lines: List[JournalLine] = [decode(part, number) for number, part in enumerate(parts, 1) if part.strip()]
    if not last:
        return _with_header(lines, truncated=False)
    try:
        lines.append(decode(last, len(parts) + 1))
    except JournalError:
        return _with_header(lines, truncated=True)
    return _with_header(lines, truncated=False)


def whole_lines(data: bytes) -> int:
    """Return how many bytes of a journal are whole lines: cut it there before writing on after a crash."""
    return data.rfind(b"\n") + 1


def _with_header(lines: Iterable[JournalLine], *, truncated: bool) -> Journal:
    journal = Journal(tuple(lines), truncated)
    if not journal.lines:
        raise JournalError("the journal is empty", remedy="nothing was decided, or the file is no journal")
    if journal.lines[0].kind != "header":
        raise JournalError("the first line is no header", journal.lines[0].line_number, "the beginning is missing")
    return journal


def _encode(value: Any, more: Dict[str, Any]) -> str:
    try:
        data = to_plain(value)
        data.update(more)
        try:
            return _encode_json(data)
        except ValueError:  # a number that is not finite is unknown
            return _encode_json(_finite(data))
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise JournalError(f"{type(value).__name__} cannot be written: {error}") from error


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def _parse(line: str, line_number: int) -> Dict[str, Any]:
    try:
        data = json.loads(line, parse_constant=_no_constant, object_pairs_hook=_no_duplicates)
    except (ValueError, RecursionError) as error:
        raise JournalError(f"not JSON: {error}", line_number, "truncated or damaged") from error
    if not isinstance(data, dict):
        raise JournalError(f"is {type(data).__name__}, must be an object", line_number)
    return data


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number")


def _no_duplicates(pairs: List[Tuple[str, Any]]) -> Dict[str, Any]:
    data = dict(pairs)
    if len(data) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"{twice} stands there twice")
    return data


def _event_class(name: Any) -> type:
    kind = _EVENTS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise CodecError("event", f"is {name!r}, must be one of {', '.join(_EVENTS)}")
    return kind


def _checked_header(data: Dict[str, Any], line_number: int) -> Dict[str, Any]:
    version = data.get("version")
    if version != VERSION:
        raise JournalError(f"version is {version!r}", line_number, f"this program reads version {VERSION}")
    return data


for _kind in _EVENTS.values():
    if {"kind", "event"} & {field.name for field in fields(_kind)}:
        raise TypeError(f"{_kind.__name__}: no field may be called kind or event, the journal's lines use them")
