"""A file that is whole or not there: written beside its place, put on the disk, then put in place.

Whoever reads the file, at whatever moment, after whatever loss of power, finds the old one or the new one.
"""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path
from typing import Iterable, Union

__all__ = ["sync_folder", "temporary_name", "write_whole"]


def temporary_name(path: Path) -> Path:
    """Return the name under which a file is written before it is whole."""
    return path.with_name(f".{path.name}.part")


def write_whole(path: Path, content: Union[str, bytes, Iterable[bytes]]) -> None:
    """Write a file; what was there is replaced when the new one is on the disk.

    Args:
        path: of the file; its folder exists.
        content: text is written as UTF-8, with lines as they are; of bytes there may be several pieces.

    Raises:
        OSError: It cannot be written; what was there still is, and nothing is left beside it.
    """
    data = content.encode() if isinstance(content, str) else content
    part = temporary_name(path)
    try:
        with part.open("wb") as file:
            file.writelines([data] if isinstance(data, bytes) else data)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from error  # of the file that was asked for


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
