"""The time stamp of signatures in a file: https://mavlink.io/en/guide/message_signing.html#timestamp-handling."""

from __future__ import annotations

import contextlib
from pathlib import Path

from .errors import KeyFileError
from .keeping import keep, read_kept

__all__ = ["StampFile"]

_BLOCK = 30 * 100_000  # time stamps of 10 us that are used up before the file is written again


class StampFile:
    """The time stamp of signatures, so that it never goes back: not over a restart, nor with a clock that was set back.

    The file is ahead of what was used: so it is written every 30 s only, and a process that was killed repeats none.

    Args:
        path: of the file, one for each address.

    Raises:
        KeyFileError: It cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        kept = read_kept(path).get("time_stamp")
        self.newest = self._reserved = kept if isinstance(kept, int) and 0 <= kept < 1 << 48 else 0
        try:
            keep(path, {"time_stamp": self._reserved})
        except OSError as error:
            words = error.strerror or "cannot be written"
            raise KeyFileError(str(path), words, "the time stamp of signatures is kept there: permit it") from None

    def use(self, stamp: int) -> None:
        """Note that a time stamp is used."""
        self.newest = stamp
        if stamp >= self._reserved:
            self._write(stamp + _BLOCK)

    def close(self) -> None:
        """Keep the last one that was used."""
        self._write(self.newest)

    def _write(self, stamp: int) -> None:
        self._reserved = stamp
        with contextlib.suppress(OSError):  # a full disk costs the memory of it, not the link
            keep(self._path, {"time_stamp": stamp})
