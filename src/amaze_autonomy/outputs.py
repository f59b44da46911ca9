"""What a command may write where its user says: nothing that somebody else wrote is replaced without a question.

A name that is completed by the keyboard is soon that of a recording, or of the journal of a flight, which are nowhere
else. What the same command wrote before is replaced, since runs are repeated.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Callable, Iterable, NamedTuple, Optional

from amaze_autonomy.whole_file import is_stream

_HEAD_BYTES = 1000


class OutputError(Exception):
    """An output would take the place of something else; the text says of what, and what would help."""


class Kind(NamedTuple):
    """What a command writes into one of its outputs.

    Args:
        words: what it is, behind "is no".
        is_own: tells whether a file, which is not empty, is of this kind.
    """

    words: str
    is_own: Callable[[Path], bool]


def beginning(pattern: str) -> Callable[[Path], bool]:
    """Return what tells whether the text of a file begins so."""

    def is_own(path: Path) -> bool:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES).decode("utf-8", "replace")
        return re.match(pattern, head) is not None

    return is_own


def journal_of(field: str, program: str) -> Callable[[Path], bool]:
    """Return what tells whether a file is a journal whose header names a program in a field."""

    def is_own(path: Path) -> bool:
        with path.open("rb") as file:
            first = file.readline()
        try:
            header = json.loads(first)
        except ValueError:
            return False
        return isinstance(header, dict) and header.get(field) == program

    return is_own


def check_output(path: Optional[Path], option: str, kind: Kind, inputs: Iterable[Path] = ()) -> None:
    """Refuse an output that would replace an input, or a file of another kind; call it before the work begins.

    Args:
        path: of the file to write; None: it was not asked for.
        option: that names it, e.g. "--html".
        kind: of what will be written.
        inputs: files that the command reads.

    Raises:
        OutputError: It is an input, a folder, or a file of another kind. An empty file is of each.
        OSError: What is there cannot be read.
    """
    if path is None or not path.exists() or is_stream(path):
        return
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; name a file with {option}")
    if any(each.exists() and path.samefile(each) for each in inputs):
        raise OutputError(f"{path}: is one of the inputs, which are never changed; name another file with {option}")
    if not path.is_file() or (path.stat().st_size > 0 and not kind.is_own(path)):
        raise OutputError(f"{path}: is no {kind.words}, and would be replaced; name another file with {option}")
