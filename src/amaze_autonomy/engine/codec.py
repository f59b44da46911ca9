"""Frozen dataclasses to plain JSON values and back, from their annotations alone: nothing to keep in step by hand.

An enum is its name, an Optional is null, a tuple is a list, a nested dataclass is an object. A field that is annotated
`object` holds what JSON can hold. Plans are made once per class; encoding in flight only walks them.
"""

from __future__ import annotations

import enum
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import lru_cache
from math import isfinite
from operator import attrgetter
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Union, get_type_hints

__all__ = [
    "CodecError",
    "decoder_of",
    "field_types",
    "from_plain",
    "optional_item",
    "plain_fields",
    "to_plain",
    "tuple_items",
]

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
