"""The folder of one run: journal, report, result; and the journal that an unfinished run left behind."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List, Optional

import rospkg

from amaze_autonomy.engine import journal as codec
from amaze_autonomy.engine.events import Event
from amaze_autonomy.whole_file import write_whole

from .errors import StartError
from .journal_file import JOURNAL_NAME

__all__ = ["REPORT_NAME", "RESULT_NAME", "Unfinished", "boot_id", "find_unfinished", "make_folder", "write_result"]

RESULT_NAME = "result.json"
REPORT_NAME = "report.txt"


@dataclass(frozen=True)
class Unfinished:
    """A journal whose run did not end: the process was killed, or ended in flight.

    Args:
        path: of the journal.
        header: its first line.
        events: all events in it, in order.
    """

    path: Path
    header: Dict[str, Any]
    events: List[Event]

    @property
    def last_ns(self) -> int:
        """Return the time of its last event; 0 when it has none."""
        return self.events[-1].t_ns if self.events else 0


def boot_id() -> str:
    """Return what tells one start of the system from the next; the monotonic clock is worth nothing beyond it."""
    return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()


def default_parent() -> Path:
    """Return the folder that the runs' folders are made in when none is named."""
    return Path(rospkg.get_ros_home()) / "amaze_autonomy"


def make_folder(output: str, label: str) -> Path:
    """Return an empty place for a new run; what an earlier run left in a named folder is kept under its own name.

    Raises:
        StartError: It cannot be made.
    """
    try:
        if output:
            folder = Path(output).expanduser()
            folder.mkdir(parents=True, exist_ok=True)
            _keep_earlier(folder)
            return folder
        return _fresh(default_parent(), label)
    except OSError as error:
        raise StartError(f"cannot make the output folder: {error}; name another one with ~output") from error


def _fresh(parent: Path, label: str) -> Path:
    parent.mkdir(parents=True, exist_ok=True)
    number = 1
    while True:
        folder = parent / (label if number == 1 else f"{label}-{number}")
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
        else:
            return folder


def _keep_earlier(folder: Path) -> None:
    """Move an earlier run's files into a folder of their own beside the new ones."""
    names = [name for name in (JOURNAL_NAME, REPORT_NAME, RESULT_NAME) if (folder / name).exists()]
    if not names:
        return
    earlier = _fresh(folder, "earlier")
    for name in names:
        (folder / name).rename(earlier / name)


def find_unfinished(output: str) -> Optional[Unfinished]:
    """Return the journal to go on with: of this boot, in the named folder or the newest of the default ones.

    Raises:
        StartError: There is one, and it is damaged.
    """
    folder = Path(output).expanduser() if output else _newest(default_parent())
    if folder is None or not (folder / JOURNAL_NAME).is_file() or _ended(folder / RESULT_NAME):
        return None
    path = folder / JOURNAL_NAME
    try:
        data = path.read_bytes()
        first = codec.decode(data.split(b"\n", 1)[0].decode())
        if first.kind != "header" or not isinstance(first.payload, dict) or first.payload.get("boot_id") != boot_id():
            return None
        journal = codec.read(data[: codec.whole_lines(data)].decode())
    except (OSError, UnicodeDecodeError, codec.JournalError) as error:
        raise StartError(f"{path} is of a run that did not end, and cannot be read: {error}") from error
    events = [line.payload for line in journal.lines if isinstance(line.payload, Event)]
    return Unfinished(path, first.payload, events)


def _newest(parent: Path) -> Optional[Path]:
    journals = sorted(parent.glob(f"*/{JOURNAL_NAME}"), key=lambda path: path.stat().st_mtime)
    return journals[-1].parent if journals else None


def _ended(result: Path) -> bool:
    try:
        return not json.loads(result.read_text(encoding="utf-8"))["in_flight"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


def write_result(folder: Path, result: Dict[str, Any]) -> None:
    """Write result.json whole or not at all.

    Raises:
        OSError: It cannot be written.
    """
    write_whole(folder / RESULT_NAME, json.dumps(result, indent=2, sort_keys=True) + "\n")
