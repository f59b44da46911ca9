"""Tapes: what a replay takes out of a bag, kept so that the bag's data need not be read again.

A tape is found by the SHA-256 of the bag, what was taken, and the version of the code that took it; so it is never
stale, and can be deleted at any time. The hash of a bag is kept as well, by path, size and times of the file. What
cannot be read of a tape - it is damaged, or half written by a computer that lost power - is taken from the bag again.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.files import sha256_of

VARIABLE = "AMAZE_TAPES"
_VERSION = 1  # of what `columns` takes, and of the files here

Columns = Dict[int, Tuple[Any, List[Any]]]


def tapes_of(bag: Path) -> Optional[Tapes]:
    """Return the tapes of a bag; None when the environment names no folder for them."""
    folder = os.environ.get(VARIABLE, "")
    return Tapes(Path(folder), bag) if folder else None


class Tapes:
    """The tapes of one bag.

    Args:
        folder: of all tapes.
        bag: path of it.
    """

    def __init__(self, folder: Path, bag: Path) -> None:
        self._folder, self._bag = folder, bag
        self._hash = ""

    def columns(self, what: Mapping[int, Sequence[str]]) -> Optional[Columns]:
        """Return columns as `read_columns` does; None when there is no tape of them."""
        names = {number: [f"{number}.{place}" for place in range(len(paths))] for number, paths in what.items()}
        arrays = self._load("columns", _plain(what), (*map(str, names), *chain.from_iterable(names.values())))
        if arrays is None:
            return None
        return {number: (arrays[f"{number}"], [arrays[name] for name in each]) for number, each in names.items()}

    def keep_columns(self, what: Mapping[int, Sequence[str]], columns: Columns) -> None:
        """Keep columns."""
        arrays = {f"{number}": rows for number, (rows, _) in columns.items()}
        for number, (_, values) in columns.items():
            arrays.update({f"{number}.{place}": column for place, column in enumerate(values)})
        self._store("columns", _plain(what), arrays)

    def messages(self, topics: Sequence[str]) -> Optional[Dict[Tuple[int, int], bytes]]:
        """Return the bytes of all messages of topics, by chunk and offset; None when there is no tape of them."""
        arrays = self._load("messages", list(topics), ("chunk", "offset", "ends", "data"))
        if arrays is None:
            return None
        data, ends = arrays["data"].tobytes(), arrays["ends"].tolist()
        places = zip(arrays["chunk"].tolist(), arrays["offset"].tolist())
        return {place: data[begin:end] for place, begin, end in zip(places, [0, *ends], ends)}

    def keep_messages(self, topics: Sequence[str], messages: Dict[Tuple[int, int], bytes]) -> None:
        """Keep the bytes of messages."""
        places: Any = np.array(list(messages), np.int64).reshape(-1, 2)
        arrays = {
            "chunk": places[:, 0],
            "offset": places[:, 1],
            "ends": np.cumsum([len(data) for data in messages.values()], dtype=np.int64),
            "data": np.frombuffer(b"".join(messages.values()), np.uint8),
        }
        self._store("messages", list(topics), arrays)

    def text(self, kind: str, what: Any) -> Optional[str]:
        """Return a text that was kept; None when there is none. `what` says what it was made of, and by which code."""
        arrays = self._load(kind, what, ("text",))
        return None if arrays is None else arrays["text"].tobytes().decode()

    def keep_text(self, kind: str, what: Any, text: str) -> None:
        """Keep a text."""
        self._store(kind, what, {"text": np.frombuffer(text.encode(), np.uint8)})

    def _load(self, kind: str, what: Any, names: Iterable[str]) -> Optional[Dict[str, Any]]:
        """Return arrays that were kept; None when there are none, or a byte of them is another one.

        Each is read to its end before anything is made of it: only there zip compares its check sum.
        """
        with suppress(Exception), zipfile.ZipFile(self._path(kind, what)) as file:  # whatever they raise: it is a cache
            return {name: np.load(io.BytesIO(file.read(f"{name}.npy")), allow_pickle=False) for name in names}
        return None

    def _store(self, kind: str, what: Any, arrays: Dict[str, Any]) -> None:
        path = self._path(kind, what)
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with part.open("wb") as file:
                np.savez(file, **arrays)
            part.replace(path)
        except OSError:  # a full disk: it is only a cache
            _remove(part)

    def _path(self, kind: str, what: Any) -> Path:
        key = json.dumps([_VERSION, kind, self._bag_hash(), what], sort_keys=True)
        name = hashlib.sha256(key.encode()).hexdigest()
        return self._folder / name[:2] / f"{name}.npz"

    def _bag_hash(self) -> str:
        """Return the SHA-256 of the bag; read only when the file is another one than last time."""
        if self._hash:
            return self._hash
        about = self._bag.stat()
        own = [str(self._bag.resolve()), about.st_size, about.st_mtime_ns, about.st_ctime_ns, about.st_ino]
        note = self._folder / "bags" / hashlib.sha256(json.dumps(own).encode()).hexdigest()
        try:
            self._hash = note.read_text(encoding="ascii")
        except (OSError, ValueError):
            self._hash = ""
        if len(self._hash) != 64:  # noqa: PLR2004  (of SHA-256 in hexadecimal)
            self._hash = sha256_of(self._bag)
            self._note(note)
        return self._hash

    def _note(self, note: Path) -> None:
        part = note.with_name(f".{note.name}.{os.getpid()}.part")
        try:
            note.parent.mkdir(parents=True, exist_ok=True)
            part.write_text(self._hash, encoding="ascii")
            part.replace(note)
        except OSError:
            _remove(part)


def _remove(part: Path) -> None:
    with suppress(OSError):
        part.unlink()


def _plain(what: Mapping[int, Sequence[str]]) -> List[Any]:
    return [[number, list(paths)] for number, paths in sorted(what.items())]
