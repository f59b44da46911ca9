"""Frozen dataclasses to JSON and back, from their annotations alone: nothing to keep in step by hand.

An enum is its name, an Optional is null, a tuple is a list, a nested dataclass is an object. A field that is annotated
`object` holds what JSON can hold. Plans are made once per class; encoding in flight only walks them.
"""

from __future__ import annotations

import enum
import json
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import lru_cache
from json.encoder import encode_basestring_ascii
from math import isfinite
from operator import attrgetter, itemgetter
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union, get_type_hints

Encoder = Callable[[Any], Any]
Decoder = Callable[[Any, str], Any]


class CodecError(ValueError):
    """A JSON value does not fit the annotation of the field it is for; `where` is the path of the field."""

    def __init__(self, where: str, problem: str) -> None:
        super().__init__(f"{where}: {problem}" if where else problem)
        self.where, self.problem = where, problem


def to_plain(value: Any) -> Dict[str, Any]:
    """Return a dataclass as a dict of JSON values, its keys sorted."""
    data = value.__dict__
    return {
        name: data[name] if encoder is None else encoder(data[name])
        for name, encoder in _encoding_plan(value.__class__)
    }


def from_plain(kind: type, data: Any, where: str = "") -> Any:
    """Make a dataclass of a dict of JSON values.

    Fields that are absent take their defaults, so that journals from before a field existed can still be read.

    Raises:
        CodecError: An unknown or missing field, a value of a wrong type, or one that the class itself refuses.
    """
    if not isinstance(data, dict):
        raise CodecError(where, f"is {_shown(data)}, must be an object ({kind.__name__})")
    plan = _decoding_plan(kind)
    for key in data:
        if key not in plan:
            raise CodecError(_path(where, key), f"{kind.__name__} has no such field")
    values: Dict[str, Any] = {}
    for name, (decoder, required) in plan.items():
        if name in data:
            values[name] = decoder(data[name], _path(where, name))
        elif required:
            raise CodecError(_path(where, name), f"is missing, {kind.__name__} needs it")
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise CodecError(where, str(error)) from error


def plain_fields(kind: type) -> Dict[str, bool]:
    """Return the names of a dataclass' fields, sorted, and for each whether its values are JSON's as they are."""
    return {name: encoder is None for name, encoder in _encoding_plan(kind)}


def field_types(kind: Any) -> Dict[str, Any]:
    """Return the fields of a dataclass with their annotations."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}


def decoder_of(kind: type, name: str) -> Decoder:
    """Return what makes a field's value of its JSON value; it takes that and a path for errors."""
    return _decoding_plan(kind)[name][0]


def _path(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."  # noqa: PLR2004


@lru_cache(maxsize=None)
def _encoding_plan(kind: Any) -> Tuple[Tuple[str, Optional[Encoder]], ...]:
    hints = get_type_hints(kind)
    return tuple((name, _encoder(hints[name])) for name in sorted(field.name for field in fields(kind)))


def _encoder(hint: Any) -> Optional[Encoder]:
    """Return what turns a value into JSON's; None when it is that already."""
    if hint is object:
        return _encode_object
    if _is_enum(hint):
        return attrgetter("_name_")
    if is_dataclass(hint):
        return to_plain
    item = optional_item(hint)
    if item is not None:
        inner = _encoder(item)
        return None if inner is None else _encode_optional(inner)
    items = tuple_items(hint)
    if items is None:
        return None
    encoders = [_encoder(each) for each in items]
    if len(encoders) == 2 and items[1] is ...:  # noqa: PLR2004
        return _encode_tuple(encoders[0])
    return _encode_fixed(encoders)


def _encode_optional(inner: Encoder) -> Encoder:
    return lambda value: None if value is None else inner(value)


def _encode_tuple(inner: Optional[Encoder]) -> Encoder:
    if inner is None:
        return list
    encode = inner
    return lambda value: [encode(item) for item in value]


def _encode_fixed(encoders: List[Optional[Encoder]]) -> Encoder:
    return lambda value: [item if inner is None else inner(item) for inner, item in zip(encoders, value)]


def _encode_object(value: Any) -> Any:
    """Return a value of unknown type as JSON's; what is not finite is said in words."""
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, float) and not isfinite(value):
        return str(float(value))
    if isinstance(value, (list, tuple)):
        return [_encode_object(item) for item in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{type(value).__name__} cannot be written, only numbers, strings, enums and tuples of them")


@lru_cache(maxsize=None)
def _decoding_plan(kind: type) -> Mapping[str, Tuple[Decoder, bool]]:
    hints = get_type_hints(kind)
    return {field.name: (_decoder(hints[field.name]), _required(field)) for field in fields(kind)}


def _required(field: Field[Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _decoder(hint: Any) -> Decoder:
    if hint is object:
        return _decode_object
    if hint in (bool, int, float, str):
        return _decode_scalar(hint)
    if _is_enum(hint):
        return _decode_enum(hint)
    if is_dataclass(hint):
        return _decode_structure(hint)
    item = optional_item(hint)
    if item is not None:
        inner = _decoder(item)
        return lambda value, where: None if value is None else inner(value, where)
    items = tuple_items(hint)
    if items is None:
        raise TypeError(f"no codec for {hint!r}")
    if len(items) == 2 and items[1] is ...:  # noqa: PLR2004
        return _decode_tuple(_decoder(items[0]))
    return _decode_fixed([_decoder(each) for each in items])


def _decode_structure(kind: Any) -> Decoder:
    return lambda value, where: from_plain(kind, value, where)


def _decode_scalar(kind: type) -> Decoder:
    words = {bool: "true or false", int: "a whole number", float: "a number", str: "a string"}[kind]
    accepted = (int, float) if kind is float else (kind,)

    def decode(value: Any, where: str) -> Any:
        if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
            raise CodecError(where, f"is {_shown(value)}, must be {words}")
        return value

    return decode


def _decode_enum(kind: Any) -> Decoder:
    names = {member.name: member for member in kind}

    def decode(value: Any, where: str) -> Any:
        member = names.get(value) if isinstance(value, str) else None
        if member is None:
            raise CodecError(where, f"is {_shown(value)}, must be one of {', '.join(names)}")
        return member

    return decode


def _decode_tuple(inner: Decoder) -> Decoder:
    def decode(value: Any, where: str) -> Any:
        if not isinstance(value, list):
            raise CodecError(where, f"is {_shown(value)}, must be a list")
        return tuple(inner(item, f"{where}[{index}]") for index, item in enumerate(value))

    return decode


def _decode_fixed(decoders: List[Decoder]) -> Decoder:
    def decode(value: Any, where: str) -> Any:
        if not isinstance(value, list) or len(value) != len(decoders):
            raise CodecError(where, f"is {_shown(value)}, must be a list of {len(decoders)}")
        pairs = enumerate(zip(decoders, value))
        return tuple(inner(item, f"{where}[{index}]") for index, (inner, item) in pairs)

    return decode


def _decode_object(value: Any, where: str) -> Any:
    if isinstance(value, list):
        return tuple(_decode_object(item, where) for item in value)
    if isinstance(value, dict):
        raise CodecError(where, f"is {_shown(value)}, must not be an object")
    return value


def _is_enum(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, enum.Enum)


def optional_item(hint: Any) -> Any:
    """Return X of Optional[X], else None."""
    if getattr(hint, "__origin__", None) is not Union:
        return None
    items = [item for item in hint.__args__ if item is not type(None)]
    return items[0] if len(items) == 1 and len(hint.__args__) == 2 else None  # noqa: PLR2004


def tuple_items(hint: Any) -> Optional[Tuple[Any, ...]]:
    """Return the items of Tuple[...], else None."""
    return hint.__args__ if getattr(hint, "__origin__", None) is tuple else None


# --- lines ------------------------------------------------------------------------------------------------------------
# Values as lines of the journal, by a form that is made once for each class: twice as fast as a JSON encoder.
#
# A form is the line with a place for each field, and for each place the types that may stand there with what writes
# them. Whatever is of another type has no line here and is left to the journal's encoder, which says the same of all
# others.


Form = Callable[[Any], str]
_Texts = Dict[type, Form]


@lru_cache(maxsize=None)
def form_of(kind: Any, more: Tuple[Tuple[str, str], ...] = ()) -> Optional[Form]:
    """Return what writes instances of a class as JSON objects, keys sorted; None when a field may hold anything.

    Args:
        kind: the dataclass.
        more: names and texts that are added to its fields.

    A number that is not finite is written as Python does, which is no JSON: whoever reads "nan" or "inf" in the object,
    perhaps in a text, must ask the encoder. The function raises:
        KeyError, ValueError: Something in the instance is not what its annotation says, or has too many digits.
    """
    hints = field_types(kind)
    names = sorted(hints)
    texts = [_texts(hints[name]) for name in names]
    if not names or not all(texts):
        return None
    fixed = {name: encode_basestring_ascii(text) for name, text in more}
    parts = (f'"{name}":{fixed.get(name, "%s")}' for name in sorted((*names, *fixed)))
    return _written("{" + ",".join(parts) + "}", itemgetter(*names, names[0]), texts)


def _written(form: str, values: Callable[[Mapping[str, Any]], Sequence[Any]], texts: Sequence[_Texts]) -> Form:
    return lambda value: form % tuple([text[each.__class__](each) for text, each in zip(texts, values(value.__dict__))])


def _texts(hint: Any) -> _Texts:
    """Return what writes the values of a field, by their type; nothing when the field may hold anything."""
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return {hint: _named({name: encode_basestring_ascii(name) for name in hint.__members__})}
    if isinstance(hint, type) and is_dataclass(hint):
        write = form_of(hint)
        return {} if write is None else {hint: write}
    item = optional_item(hint)
    if item is not None:
        return {**_texts(item), type(None): _SIMPLE[type(None)]} if _texts(item) else {}
    items = tuple_items(hint)
    if items is None:
        return _SIMPLE if hint in _SIMPLE else {}
    texts = _texts(items[0])
    return {tuple: _list(texts)} if len(items) == 2 and items[1] is ... and texts else {}  # noqa: PLR2004


def _named(names: Mapping[str, str]) -> Form:
    return lambda member: names[member._name_]


def _list(texts: _Texts) -> Form:
    """Return what writes tuples; very often it is the one that was written last."""
    last: Tuple[Tuple[Any, ...], str] = (), "[]"

    def write(values: Tuple[Any, ...]) -> str:
        nonlocal last
        known, text = last
        if values is not known:
            text = "[" + ",".join([texts[each.__class__](each) for each in values]) + "]"
            last = values, text
        return text

    return write


_SIMPLE: _Texts = {
    bool: {True: "true", False: "false"}.__getitem__,
    int: int.__repr__,
    float: float.__repr__,
    str: encode_basestring_ascii,
    type(None): lambda _: "null",
}


# --- bundle -----------------------------------------------------------------------------------------------------------
# Many events of one kind as one text and back, none of them checked again: for caches of what was checked before.
#
# A bundle is JSON: for each field the values of all events, in their order, as the journal has them. Values that are
# no numbers, words or None are texts of JSON themselves, and decoded once for each that is different.


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
