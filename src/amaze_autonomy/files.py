"""Files that are written: each is whole or not there; and what a command may write over."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import stat
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Callable, Iterable, Iterator, NamedTuple, Optional, Union

# --- whole or not there -----------------------------------------------------------------------------------------------
# A file, or a folder, is written beside its place, put on the disk, then put in place. Whoever reads it, at whatever
# moment, after whatever loss of power, finds the old one or the new one.


_PIECE = 1 << 20
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # said of what is written, and of no name


def temporary_name(path: Path) -> Path:
    """Return the name under which a file is written before it is whole."""
    return path.with_name(f".{path.name}.part")


def write_whole(path: Path, content: Union[str, bytes, Iterable[bytes]]) -> None:
    """Write a file; what was there is replaced when the new one is on the disk.

    Args:
        path: of the file; its folder exists. A stream takes the content as it comes.
        content: text is written as UTF-8, with lines as they are; of bytes there may be several pieces.

    Raises:
        OSError: It cannot be written; what was there still is, and nothing is left beside it.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        with path.open("wb") if is_stream(path) else whole(path) as file:
            file.writelines([data] if isinstance(data, bytes) else data)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error  # of the file that was asked for


def is_stream(path: Path) -> bool:
    """Tell whether a path is that of a pipe or a terminal, as /dev/stdout may be: nothing there can be replaced."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


@contextmanager
def whole(path: Path) -> Iterator[IO[bytes]]:
    """Open a file for writing that takes its place when it is whole; after an error nothing is left beside it.

    Its mode is that of a new file, whatever mode has what was there, or what a killed process left beside it.

    Raises:
        OSError: It cannot be written: of the file that was asked for, not of the one beside it.
    """
    part = temporary_name(path)
    try:
        with suppress(FileNotFoundError):
            part.unlink()
        with part.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
        sync_folder(path.parent)
    except BaseException as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError) and _is_of(error, part):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Make a folder to be filled, which takes its place when all in it is on the disk; after an error nothing is left.

    An empty folder that is there stays the same one: somebody may stand in it, or have mounted it.

    Raises:
        OSError: It cannot be written: of the folder that was asked for, not of the one beside it.
    """
    is_there = path.is_dir()
    part = path / ".part" if is_there else temporary_name(path)
    try:
        if part.exists():  # of a killed process
            shutil.rmtree(part)
        part.mkdir(parents=True)
        yield part
        for folder, _, names in os.walk(part):
            for name in names:
                _sync_file(Path(folder, name))
            sync_folder(Path(folder))
        if is_there:
            for each in list(part.iterdir()):
                each.rename(path / each.name)
            part.rmdir()
        else:
            part.rename(path)
        sync_folder(path if is_there else path.parent)
    except BaseException as error:
        shutil.rmtree(part, ignore_errors=True)
        if isinstance(error, OSError) and _is_of(error, part):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def is_unused(folder: Path) -> bool:
    """Tell whether `whole_folder` may make a folder: nothing is there, or a folder with nothing in it."""
    return not folder.exists() or (folder.is_dir() and all(each.name == ".part" for each in folder.iterdir()))


def _is_of(error: OSError, part: Path) -> bool:
    """Tell whether an error is of what is being written, not of something that was read meanwhile."""
    name = error.filename
    if not isinstance(name, (str, os.PathLike)):
        return error.errno in _FULL
    return Path(name) == part or part in Path(name).parents


def _sync_file(path: Path) -> None:
    with path.open("rb") as file:
        os.fsync(file.fileno())


def sha256_of(*paths: Path) -> str:
    """Return the checksum of a file, or of several as if they were one.

    Raises:
        OSError: One cannot be read; it is named.
    """
    from hashlib import sha256  # noqa: PLC0415  (slow to load, and seldom wanted)

    digest = sha256()
    for path in paths:
        try:
            with path.open("rb") as file:
                for piece in iter(lambda: file.read(_PIECE), b""):
                    digest.update(piece)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from error
    return digest.hexdigest()


def sync_folder(folder: Path) -> None:
    """Wait until names in a folder are on the disk."""
    file = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(file)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # said by file systems that cannot do that for a folder
            raise
    finally:
        os.close(file)


# --- what a command may write over ------------------------------------------------------------------------------------
# Where its user says, nothing that somebody else wrote is replaced without a question: a name that is completed by the
# keyboard is soon that of a recording, or of the journal of a flight, which are nowhere else. What the same command
# wrote before is replaced, since runs are repeated.


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
