"""Modes of what nodes write: whoever starts them, it is for their user and group (docs/security.md)."""

from __future__ import annotations

from pathlib import Path
from typing import List, Sequence

PERMISSIVE, DEFAULT = 0o000, 0o022  # umasks of who starts a node
_FOLDER, _FILE = 0o750, 0o640


def started_under(umask: int, command: Sequence[str]) -> List[str]:
    """Return a command that begins with this umask; its process becomes the command."""
    return ["sh", "-c", f'umask {umask:04o}; exec "$@"', "sh", *command]


def assert_modes(folder: Path) -> List[Path]:
    """Assert that a folder and all below it have the modes that are promised; return the files."""
    found = [each for each in (folder, *sorted(folder.rglob("*"))) if each.exists() and not each.is_symlink()]
    wrong = {}
    for path in found:
        mode = path.stat().st_mode & 0o7777
        if mode != (_FOLDER if path.is_dir() else _FILE):
            wrong[str(path.relative_to(folder))] = f"{mode:04o}"
    assert not wrong, f"{folder} is for others, too, or not for the group: {wrong}"
    return [path for path in found if path.is_file()]
