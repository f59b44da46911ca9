"""What must outlive its process: small JSON files that are whole or not there, and the origin of a session in one."""

from __future__ import annotations

import contextlib
import json
import threading
from math import isfinite
from pathlib import Path
from typing import Any, Dict, List, Optional

from amaze_autonomy.files import write_whole
from amaze_autonomy.missions import Home

from ..errors import KeyFileError
from ..planner.loading import Origin


def keep(path: Path, value: Dict[str, Any]) -> None:
    """Write a file so that a reader finds the old one or the new one.

    Raises:
        OSError: It cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps(value, sort_keys=True) + "\n")


def read_kept(path: Path) -> Dict[str, Any]:
    """Return what a file holds; nothing when there is none, or it is damaged."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return value if isinstance(value, dict) else {}


def origin_to(origin: Origin) -> Dict[str, Any]:
    """Return an origin as it is kept."""
    home = origin.home
    return {
        "session_id": origin.session_id,
        "home": None if home is None else [home.latitude_deg, home.longitude_deg],
        "local": None if origin.local is None else list(origin.local),
        "boot_ns": origin.boot_ns,
    }


def origin_from(kept: Dict[str, Any]) -> Optional[Origin]:
    """Return the origin that was kept; None when it is none.

    A local one without the time at which the autopilot was switched on is none: nobody can say that its frame still is.
    """
    session, home, local, boot_ns = (kept.get(name) for name in ("session_id", "home", "local", "boot_ns"))
    if not isinstance(session, str) or not session:
        return None
    place, position = _numbers(home), _numbers(local)
    if len(place) == len(("latitude", "longitude")):
        return Origin(session, home=Home(*place))
    if len(position) == len("xyz") and isinstance(boot_ns, int):
        return Origin(session, local=(position[0], position[1], position[2]), boot_ns=boot_ns)
    return None


def _numbers(value: Any) -> List[float]:
    """Return a list of finite numbers; empty when it is none."""
    good = isinstance(value, list) and all(isinstance(each, (int, float)) and isfinite(each) for each in value)
    return [float(each) for each in value] if good else []


# --- stamp file -------------------------------------------------------------------------------------------------------
# The time stamp of signatures in a file: https://mavlink.io/en/guide/message_signing.html#timestamp-handling.


_BLOCK = 30 * 100_000  # time stamps of 10 us that the file is ahead; it is written again when half of them are used up
_CLOSE_LIMIT_S = 2.0


class StampFile:
    """The time stamp of signatures, so that it never goes back: not over a restart, nor with a clock that was set back.

    The file is ahead of what was used, by 30 s at most: a process that was killed repeats none. Only the first time
    stamp of a process waits for the disk; from then on a thread writes ahead, since a disk that hangs must hold up no
    message. Where it does, signing goes on, and only the memory of it is at stake.

    Args:
        path: of the file, one for each address.

    Raises:
        KeyFileError: It cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._due, self._writer = threading.Event(), threading.Thread(target=self._run, name="stamps", daemon=True)
        self._began = self._ended = False
        kept = read_kept(path).get("time_stamp")
        self.newest = self._reserved = kept if isinstance(kept, int) and 0 <= kept < 1 << 48 else 0
        try:
            keep(path, {"time_stamp": self._reserved})
        except OSError as error:
            words = error.strerror or "cannot be written"
            raise KeyFileError(str(path), words, "the time stamp of signatures is kept there: permit it") from None
        self._writer.start()  # in flight there may be no thread for it

    def use(self, stamp: int) -> None:
        """Note that a time stamp is used."""
        self.newest = stamp
        if not self._began:
            self._began = True
            self._write(stamp + _BLOCK)
        elif stamp > self._reserved - _BLOCK // 2:
            self._due.set()

    def close(self) -> None:
        """Keep the last one that was used, unless the disk hangs."""
        self._ended = True
        self._due.set()
        self._writer.join(_CLOSE_LIMIT_S)
        if not self._writer.is_alive():
            self._write(self.newest)

    def _run(self) -> None:
        while not self._ended:
            self._due.wait()
            self._due.clear()
            if not self._ended:
                self._write(self.newest + _BLOCK)

    def _write(self, stamp: int) -> None:
        self._reserved = stamp
        with contextlib.suppress(OSError):  # a full disk costs the memory of it, not the link
            keep(self._path, {"time_stamp": stamp})
