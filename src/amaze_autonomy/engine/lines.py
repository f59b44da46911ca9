"""Values as lines of the journal, by a form that is made once for each class: twice as fast as a JSON encoder.

A form is the line with a place for each field, and for each place the types that may stand there with what writes them.
Whatever is of another type has no line here and is left to the journal's encoder, which says the same of all others.
"""

from __future__ import annotations

import enum
from dataclasses import is_dataclass
from functools import lru_cache
from json.encoder import encode_basestring_ascii
from operator import itemgetter
from typing import Any, Callable, Dict, Mapping, Optional, Sequence, Tuple

from .codec import field_types, optional_item, tuple_items

__all__ = ["Form", "form_of"]

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
