"""The journal as text: JSON Lines, one line per header, event or decision. Pure: the shells write and read the files.

Every input event of the engine is a line, each decision a line after the event that led to it, so that a journal alone
can be decided again. A line is canonical: keys sorted, no spaces, ASCII, floats by `repr`, no NaN; the same event is
the same bytes on every Python. Wall time stands in the header only.

    {"configuration":{...},"hash":"...","kind":"header","rules":{...},"version":1}
    {"command":"GO","event":"UserRequest","kind":"event","request_id":0,"t_ns":12}
    {"after":"...","before":"...","commands":[],"event":"UserRequest","kind":"decision",...}

The engine writes statuses as delta lines where nothing but numbers has changed (below); `read`, which reads a whole
journal, makes full lines of them again.

Adding a field with a default keeps old journals readable; any other change needs a new `VERSION`.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, fields, replace
from json.encoder import c_make_encoder, encode_basestring_ascii  # type: ignore[attr-defined]
from math import isfinite
from struct import pack, unpack
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Tuple, Union
from zlib import crc32

from ..engine import events as _events
from ..engine.commands import Decision
from ..engine.events import Event, checks_of
from ..engine.rules import Rules
from .codec import CodecError, Form, form_of, from_plain, to_plain

VERSION = 1
_RENAMED = {
    "verb": "action",
    "ready_taken_back": "ready_revoked",
    "unfit_for_takeoff": "not_ready_to_take_off",
}
"""Rules and values of decisions, as older journals have them."""

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
        file: in which; empty: who reads it says so.
    """

    def __init__(self, what: str, line_number: Optional[int] = None, remedy: str = "", file: str = "") -> None:
        place = (f"{file}: " if file else "") + ("" if line_number is None else f"line {line_number}: ")
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
    told = replace(rules, checks=tuple(check.value for check in checks_of(rules)))
    return {**about, "configuration": dict(configuration), "hash": configuration_hash, "rules": to_plain(told)}


def rules_of(line: JournalLine, given: Optional[Rules] = None) -> Rules:
    """Return the rules that a journal is decided again by.

    Args:
        line: its header.
        given: those of another configuration; None: those that the header carries. Which checks there were when it was
            written is no matter of configuration, and the header's in any case.

    Raises:
        JournalError: None are given, and it carries none, or what it carries are no rules of this version.
    """
    header = line.payload
    known = header.get("rules") if line.kind == "header" and isinstance(header, dict) else None
    if known is None:
        if given is not None:
            return given
        raise JournalError("no rules here", line.line_number, "name a configuration to decide with")
    try:
        carried: Rules = from_plain(Rules, known, "rules")
        rules = replace(given or carried, checks=_known(carried.checks or _CHECKS_AT_FIRST))
    except CodecError as error:
        if given is not None:
            return given
        raise JournalError(str(error), line.line_number, "written by another version") from error
    return rules


def _known(checks: Tuple[str, ...]) -> Tuple[str, ...]:
    unknown = set(checks) - {check.value for check in _events.CheckName}
    if unknown:
        raise CodecError("rules.checks", f"there is no check {', '.join(sorted(unknown))}")
    return checks


_CHECKS_AT_FIRST = ("watchdog", "battery", "autopilot", "on_ground", "state_estimation")
"""Those of every journal that does not name its checks."""


def decode(line: str, line_number: int = 1) -> JournalLine:
    """Read one full line of a journal.

    Raises:
        JournalError: It is not a line that this module writes, or a delta line.
    """
    if _DELTA_LINE.fullmatch(line):
        raise JournalError("a delta line, which says nothing alone", line_number, "read the whole journal")
    data = _parse(line, line_number)
    kind = data.pop("kind", None)
    try:
        if kind == "event":
            return JournalLine(kind, from_plain(_event_class(data.pop("event", None)), data), line_number)
        if kind == "decision":
            return JournalLine(kind, from_plain(Decision, _renamed(data)), line_number)
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
    full = DeltaDecoder().full
    lines: List[JournalLine] = [
        decode(full(part, number), number) for number, part in enumerate(parts, 1) if part.strip()
    ]
    if not last:
        return _with_header(lines, truncated=False)
    try:
        lines.append(decode(full(last, len(parts) + 1), len(parts) + 1))
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
        data = _decode_json(line)
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


_decode_json = json.JSONDecoder(parse_constant=_no_constant, object_pairs_hook=_no_duplicates).decode


def _renamed(decision: Dict[str, Any]) -> Dict[str, Any]:
    """Give a decision that was written before a rule or a value was renamed the names of today."""
    values = decision.get("values")
    for part, key in ((decision, "rule"), *((value, "name") for value in (values if isinstance(values, list) else ()))):
        name = part.get(key) if isinstance(part, dict) else None
        if isinstance(name, str):
            part[key] = _RENAMED.get(name, name)
    return decision


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


# --- delta lines ------------------------------------------------------------------------------------------------------
# Most of a flight is statuses that say the same again. Where nothing but numbers differs from the last status of its
# kind, a delta line says which, by their places in the line, and how much: exactly the full line can be made of it.
#
# An example: {"W":"1=431809 11+32 4+1 2+199826809 1906"}
#
# W is WatchdogAction. Each number stands so many values behind the last one: `=` it is this, `+` and `-` it is an
# integer and grew by this, `~` it is the float that is nearest to this in single precision. At the end four digits of
# the CRC of the full line: a delta line behind a gap, or behind a line that was changed, is noticed. What changes in
# words stands in full, and so does a status now and then, so that a gap does not take all that follows.


DELTA_LETTERS: Mapping[str, str] = {
    "A": "AutopilotStatus",
    "I": "WatchdogInfo",
    "L": "LandedStatus",
    "M": "MissionStatus",
    "R": "RecordingStatus",
    "W": "WatchdogAction",
}
"""The kinds of event that come all the time, and their letters in delta lines."""

_MOST_DELTAS = 300  # in a row: a minute at 5 Hz
_LETTERS = {_EVENTS[name]: letter for letter, name in DELTA_LETTERS.items()}
_LETTER_OF_NAME = {name: letter for letter, name in DELTA_LETTERS.items()}
_VALUES = re.compile(r'("(?:[^"\\]|\\.)*"|[^,:\[\]{}"]+)')  # every second part of a split
_NUMBER = re.compile(r"(-?\d+)(\.\d+)?(e[+-]?\d+)?|null")
_DELTA_LINE = re.compile(r'\{"([A-Z])":"((?:\d+[-+=~][^ "]+ )*)([0-9a-f]{4})"\}')
_DELTA = re.compile(r"(\d+)([-+=~])([^ ]+) ")
_EVENT_NAME = re.compile(r'"event":"(\w+)"')


class DeltaEncoder:
    """Writes the lines of events for one file, in their order."""

    def __init__(self) -> None:
        self._last: Dict[str, Tuple[List[str], int]] = {}

    def forget(self) -> None:
        """Write full lines next: what was written last is not in the file."""
        self._last.clear()

    def encode(self, event: Event) -> str:
        """Return the line of an event, a delta line where that will do.

        Raises:
            JournalError: It is not an event of `events.py`, or a field holds what its annotation forbids.
        """
        line = encode_event(event)
        letter = _LETTERS.get(type(event))
        if letter is None:
            return line
        parts = _VALUES.split(line)
        before, count = self._last.get(letter, ([], _MOST_DELTAS))
        deltas = _deltas(before, parts) if count < _MOST_DELTAS else None
        self._last[letter] = parts, 0 if deltas is None else count + 1
        return line if deltas is None else f'{{"{letter}":"{deltas}{_check(line)}"}}'


class DeltaDecoder:
    """Makes full lines of the lines of one file, in their order."""

    def __init__(self) -> None:
        self._last: Dict[str, List[str]] = {}

    def full(self, line: str, line_number: Optional[int] = None) -> str:
        """Return the full line of a line; one that is no delta line is full.

        Raises:
            JournalError: A delta line says what differs from a line that is not there.
        """
        found = _DELTA_LINE.fullmatch(line)
        if found is None:
            name = _EVENT_NAME.search(line) if '"kind":"event"' in line else None
            letter = "" if name is None else _LETTER_OF_NAME.get(name.group(1), "")
            if letter:
                self._last[letter] = _VALUES.split(line)
            return line
        letter, deltas, check = found.groups()
        parts = self._last.pop(letter, [])
        try:
            full = _applied(parts, deltas)
        except (IndexError, ValueError, OverflowError):
            full = ""
        if _check(full) != check or not full:
            raise JournalError("says what differs from a line that is not there", line_number, "a gap, or damaged")
        self._last[letter] = parts
        return full


def _deltas(before: List[str], parts: List[str]) -> Optional[str]:
    """Return what differs; None when more than numbers does."""
    if len(before) != len(parts):
        return None
    deltas, place = "", 0
    for index, (old, new) in enumerate(zip(before, parts)):
        if old != new:
            if not (index % 2 and _NUMBER.fullmatch(old) and _NUMBER.fullmatch(new)):
                return None
            deltas += f"{index // 2 - place}{_delta(old, new)} "
            place = index // 2
    return deltas


def _delta(old: str, new: str) -> str:
    """Return the shortest words for a number."""
    words = f"={new}"
    grown = f"{int(new) - int(old):+d}" if _is_integer(old) and _is_integer(new) else _single(new)
    return grown if grown and len(grown) < len(words) else words


def _is_integer(text: str) -> bool:
    return text.lstrip("-").isdigit()


def _single(text: str) -> str:
    """Return a number of single precision in as few digits as that takes; empty when it is not one."""
    if "." not in text:
        return ""
    for digits in (6, 7, 8, 9):
        short = f"{float(text):.{digits}g}"
        if _double(short) == text:
            return f"~{short}"
    return ""


def _double(short: str) -> str:
    """Return the number of single precision that is nearest, in all its digits."""
    try:
        return repr(unpack("f", pack("f", float(short)))[0])
    except OverflowError:
        return ""


def _applied(parts: List[str], deltas: str) -> str:
    place = 0
    for step, kind, words in _DELTA.findall(deltas):
        place += int(step)
        index = 2 * place + 1
        if kind == "=":
            parts[index] = words
        else:
            parts[index] = _double(words) if kind == "~" else str(int(parts[index]) + int(kind + words))
    return "".join(parts)


def _check(line: str) -> str:
    return f"{crc32(line.encode()) & 0xFFFF:04x}"
