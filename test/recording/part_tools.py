"""Parts of platforms as their recorders leave them, made of small bags."""

from __future__ import annotations

import os
import subprocess
from contextlib import contextmanager
from pathlib import Path

import pytest
from bag_tools import bag, rows, unclosed

from amaze_autonomy.recording.job import Plan, Source
from amaze_autonomy.recording.parts import close_parts

MEASURED = {when: {"offset_ns": 0, "error_ns": 1000, "at_ns": 1} for when in ("start", "stop")}
FACTS = {"session_id": "s1", "platform": "main", "gaps": [], "dropped": 0}


def part(folder, *bags, **facts):
    """Close a part that has these bags: (name, messages per topic, how)."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, streams in bags:
        bag(folder / name, *streams)
    close_parts(folder, {**FACTS, **facts})
    return folder


def two_platforms(folder, count=300):
    """Return a session with a part of main and a fetched one of second."""
    session = folder / "s1_m"
    part(session / "main", ("states-01.bag", [rows("/a", count), rows("/b", count, 7)]))
    part(session / "second", ("realsense-01.bag", [rows("/c", count, 11)]), platform="second")
    return session


def plan(session, **options):
    sources = (
        Source("main", session / "main"),
        Source("second", session / "second", fetched=True, far=True, clock=MEASURED),
    )
    return Plan(session / "s1_m.bag", sources, **options)


def killed(folder, name, *streams, cut=None):
    """Leave what is on the disk when a recorder is killed."""
    folder.mkdir(parents=True, exist_ok=True)
    whole = bag(folder / "whole", *streams)
    unclosed(whole, folder / name, cut)
    whole.unlink()
    return folder / name


def modes(folder):
    """Return the mode of a folder and of all below it, by name."""
    found = (folder, *sorted(folder.rglob("*")))
    return {str(path.relative_to(folder)): f"{path.stat().st_mode & 0o777:04o}" for path in found}


def open_to_others(folder, umask):
    """Give a folder and all below it the modes that they have from who has this umask; their content stays."""
    for path in (folder, *folder.rglob("*")):
        path.chmod((0o777 if path.is_dir() else 0o666) & ~umask)


@contextmanager
def small_storage(folder: Path, megabytes: int):
    """Mount a small storage that can become full; root only."""
    if os.geteuid() != 0:
        pytest.skip("NOT TESTED: only root can mount a small storage")
    folder.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    if done.returncode:
        pytest.skip(f"NOT TESTED: a small storage cannot be mounted here: {done.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True, timeout=60)
