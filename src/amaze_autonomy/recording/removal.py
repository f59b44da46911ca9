"""A platform's part removed, when the complete recording is verified and the configuration permits it."""

from __future__ import annotations

import logging
from pathlib import Path

from .folders import PARTS, read_json

__all__ = ["remove_part"]

_NAMES = ("file", "recovered_from", "undo")
_log = logging.getLogger(__name__)


def remove_part(folder: Path, recordings: Path) -> None:
    """Remove what the list of a part names, what that was recovered from, and how to undo that, in the recordings."""
    content = read_json(folder / PARTS)
    if content is None or folder.parent.parent != recordings:
        _log.warning("%s is no part of a session here; nothing is removed", folder)
        return
    names = [str(entry[key]) for entry in content["files"] for key in _NAMES if key in entry]
    for name in names:
        path = folder / name
        if path.parent == folder and path.is_file():
            path.unlink()
