"""The undo file of a bag that was changed in place: the bytes that were changed, as they were."""

from __future__ import annotations

import json
import os
import struct
import zlib
from pathlib import Path
from typing import List, NamedTuple, Optional

from .errors import BagError
from .index import Index
from .layout import FIRST_RECORD
from .output import sync_folder

__all__ = ["Undo", "is_interrupted", "read_undo", "restore", "undo_path", "write_undo"]

_MAGIC = b"#AMAZE BAG UNDO 1\n"
_SUFFIX = ".undo"
_BEFORE = 4096  # bytes before the end that show that it is the same file
_LENGTH = struct.Struct("<L")


class Undo(NamedTuple):
    """What a file was like.

    Args:
        name: of it.
        size: of it.
        place: from where on its end was changed.
        before: CRC-32 of the last bytes before that, which were not.
        head: its first bytes.
        end: all from that place on.
        lost: messages that the recovery could not keep; None when nobody knows how many.
    """

    name: str
    size: int
    place: int
    before: int
    head: bytes
    end: bytes
    lost: Optional[int] = None

    @classmethod
    def of(cls, file: int, name: str, place: int) -> Undo:
        """Return what an open file is like."""
        size = os.fstat(file).st_size
        head, end = os.pread(file, FIRST_RECORD, 0), os.pread(file, size - place, place)
        if len(head) + len(end) != FIRST_RECORD + size - place:
            raise OSError(5, "it could not be read as a whole")
        return cls(name, size, place, _before(file, place), head, end)


def _before(file: int, place: int) -> int:
    begin = max(FIRST_RECORD, place - _BEFORE)
    return zlib.crc32(os.pread(file, place - begin, begin))


def undo_path(bag: Path) -> Path:
    """Return where the undo file of a bag lies; `x.bag.active` has that of `x.bag`."""
    name = bag.name
    for suffix in (".active", _SUFFIX):
        name = name[: -len(suffix)] if name.endswith(suffix) else name
    return bag.with_name(name + _SUFFIX)


def is_interrupted(bag: Path) -> bool:
    """Return whether a recovery of this bag in place was begun and not finished.

    Raises:
        BagError: Its undo file is damaged.
    """
    path = undo_path(bag)
    if not path.exists() or read_undo(path).name != bag.name:
        return False
    try:
        Index(bag).close()
    except BagError:
        return True
    return bag.name.endswith(".active")


def write_undo(bag: Path, undo: Undo) -> None:
    """Put an undo file on the disk: whole, or not there."""
    path = undo_path(bag)
    part = path.with_name(f".{path.name}.part")
    facts = {"file": undo.name, "size": undo.size, "place": undo.place, "before": undo.before, "lost": undo.lost}
    text = json.dumps({**facts, "crc": zlib.crc32(undo.end, zlib.crc32(undo.head))}).encode()
    try:
        with part.open("wb") as file:
            file.writelines([_MAGIC, _LENGTH.pack(len(text)), text, undo.head, undo.end])
            file.flush()
            os.fsync(file.fileno())
    except OSError:
        part.unlink()
        raise
    part.replace(path)
    sync_folder(path.parent)


def read_undo(path: Path) -> Undo:
    """Read an undo file.

    Raises:
        BagError: It is none, or damaged.
    """
    try:
        raw = path.read_bytes()
        start = len(_MAGIC) + _LENGTH.size
        length = _LENGTH.unpack_from(raw, len(_MAGIC))[0]
        facts = json.loads(raw[start : start + length])
        begin = start + length + FIRST_RECORD
        undo = Undo(
            str(facts["file"]),
            int(facts["size"]),
            int(facts["place"]),
            int(facts["before"]),
            raw[start + length : begin],
            raw[begin:],
            facts.get("lost"),
        )
        good = raw.startswith(_MAGIC) and zlib.crc32(undo.end, zlib.crc32(undo.head)) == facts["crc"]
        good = good and len(undo.end) == undo.size - undo.place and Path(undo.name).name == undo.name != ""
    except OSError as error:
        wrong = f"is no undo file, it cannot be read ({error.strerror})"
        raise BagError(str(path), wrong, "name the bag that was recovered in place") from error
    except (ValueError, KeyError, TypeError, struct.error) as error:
        raise BagError(str(path), f"is no undo file ({error})", "name the bag that was recovered in place") from error
    if not good:
        raise BagError(str(path), "is damaged", "the bag was recovered as far as it could be; keep it")
    return undo


def restore(bag: Path) -> Path:
    """Make the original of a bag that was recovered in place, or was about to be; return its path.

    Args:
        bag: the recovered bag, the original's name, or the undo file.

    Raises:
        BagError: There is no undo file, or it belongs to another bag, or the bag cannot be written.
    """
    path = undo_path(bag)
    undo = read_undo(path)
    original = path.with_name(undo.name)
    current = _current(path, original)
    try:
        file = os.open(current, os.O_RDWR | os.O_CLOEXEC)
        try:
            _write_back(file, undo, path)
        finally:
            os.close(file)
        if current != original:
            current.rename(original)
        sync_folder(path.parent)
        path.unlink()
        sync_folder(path.parent)
    except OSError as error:
        wrong = f"cannot be written ({error.strerror})"
        raise BagError(str(current), wrong, f"try again, all that is needed is in {path.name}") from error
    return original


def _current(path: Path, original: Path) -> Path:
    recovered = path.with_name(path.name[: -len(_SUFFIX)])
    there: List[Path] = [each for each in dict.fromkeys((original, recovered)) if each.exists()]
    if len(there) != 1:
        wrong = f"is for {original.name}, of which there is {'more than one' if there else 'nothing'} here"
        raise BagError(str(path), wrong, f"put {original.name} or {recovered.name} beside it")
    return there[0]


def _write_back(file: int, undo: Undo, path: Path) -> None:
    if os.fstat(file).st_size < undo.place or _before(file, undo.place) != undo.before:
        raise BagError(str(path), "belongs to another bag", "put the bag beside it that was recovered in place")
    for place, data in ((undo.place, undo.end), (0, undo.head)):
        view = memoryview(data)
        while view:
            done = os.pwrite(file, view, place)
            view, place = view[done:], place + done  # noqa: PLW2901  (a short write)
    os.ftruncate(file, undo.size)
    os.fsync(file)
