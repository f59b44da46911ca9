"""JSON in which every object knows its line, read strictly: no key twice, no NaN."""

from __future__ import annotations

import json
import json.decoder
import json.scanner
from typing import Any, Dict, List, NoReturn, Tuple

from .errors import WaypointError

__all__ = ["Object", "read_json"]


class Object(Dict[str, Any]):
    """An object of a document, with its line from 1."""

    line = 0


class _Decoder(json.JSONDecoder):
    """Notes where each object begins; the scanner in Python asks `parse_object` for every one."""

    def __init__(self) -> None:
        super().__init__(object_pairs_hook=_object, parse_constant=_refuse)
        self._parse = json.decoder.JSONObject  # type: ignore[attr-defined]
        self.parse_object = self._located
        self.scan_once = json.scanner.py_make_scanner(self)  # type: ignore[attr-defined]

    def _located(self, s_and_end: Tuple[str, int], *rest: Any) -> Tuple[Object, int]:
        found, end = self._parse(s_and_end, *rest)
        found.line = s_and_end[0].count("\n", 0, s_and_end[1]) + 1
        return found, end


def _object(pairs: List[Tuple[str, Any]]) -> Object:
    found = Object(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"has the key {next(name for name in names if names.count(name) > 1)[:40]!r} twice")
    return found


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"holds {name}, which is no number")


def read_json(text: str, file: str) -> Object:
    """Read a document that is one object.

    Raises:
        WaypointError: it is none, with the line where that shows.
    """
    try:
        found = _Decoder().decode(text)
    except json.JSONDecodeError as error:
        raise WaypointError(file, error.lineno, "", f"is not JSON: {error.msg}", "must be a whole plan") from None
    except (ValueError, RecursionError) as error:
        wrong = "is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise WaypointError(file, 0, "", wrong, "must be a plan as QGroundControl saves it") from None
    if not isinstance(found, Object):
        raise WaypointError(file, 1, "", "is no JSON object", "must be a plan as QGroundControl saves it")
    return found
