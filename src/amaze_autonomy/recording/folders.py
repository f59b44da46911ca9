"""Where everything of a session lies, and files that are whole or not there.

FOLDER/SESSION_MISSION/             one per session, on each platform
    PLATFORM/                       what a platform recorded; on the collector also what was fetched
        GROUP-01.bag  GROUP.log     one bag per recorder, a further one where it had to be started again
        parts.json                  the bags, with bytes, messages and sha256; losses
    journal.jsonl  configuration/   of the engine
    SESSION_MISSION.bag             the complete recording, and SESSION_MISSION.manifest.json
"""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any, Dict, Optional

from .errors import FolderError
from .sight import Space

__all__ = ["PARTS", "STATE", "read_json", "session_name", "space_of", "write_json"]

PARTS = "parts.json"
STATE = ".recorder-{platform}.json"


def session_name(session_id: str, mission_id: str) -> str:
    """Return the name of a session's folder: time and mission are in it."""
    name = f"{session_id}_{mission_id}" if mission_id else session_id
    return re.sub(r"[^A-Za-z0-9_.+-]", "-", name).lstrip(".")[:200] or "session"


def write_json(path: Path, value: Any) -> None:
    """Write a file so that a reader finds the old one or the new one.

    Raises:
        FolderError: It cannot be written.
    """
    half = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with half.open("w", encoding="utf-8") as file:
            json.dump(value, file, indent=1, sort_keys=True)
            file.write("\n")
            file.flush()
            os.fsync(file.fileno())
        half.replace(path)
    except OSError as error:
        raise FolderError(
            f"{path}: cannot be written ({error.strerror}); make space, or choose another folder"
        ) from error


def read_json(path: Path) -> Optional[Dict[str, Any]]:
    """Return what a file holds; None when there is none, or it is no object of JSON."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return value if isinstance(value, dict) else None


def space_of(folder: Path) -> Optional[Space]:
    """Return the space of the storage that a folder lies on, or will lie on; None when nobody can say."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        usage = shutil.disk_usage(folder)
    except OSError:
        return None
    return Space(usage.free, usage.free / usage.total if usage.total else 0.0)
