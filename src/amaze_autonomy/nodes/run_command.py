"""Run a command of the configuration: program and arguments, no shell, a time limit, its exit status."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import time
from contextlib import suppress
from typing import NamedTuple, Sequence

__all__ = ["Outcome", "run_command"]

_TAIL_BYTES = 400
_LOOK_S = 0.02


class Outcome(NamedTuple):
    """How a command ended.

    Args:
        good: with status 0, in time.
        message: why not: its last line, its status, or that it took too long.
    """

    good: bool
    message: str


def run_command(command: Sequence[str], limit_s: float) -> Outcome:
    """Run a command in a session of its own; when it takes too long, it ends with everything that it started."""
    try:
        process = subprocess.Popen(
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    except (OSError, ValueError) as error:
        return Outcome(good=False, message=f"{command[0]} cannot be run: {getattr(error, 'strerror', '') or error}")
    with process:
        said = _listen(process, time.monotonic() + limit_s)
        if process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            return Outcome(good=False, message=f"{command[0]} took longer than {limit_s:g} s")
    if process.returncode == 0:
        return Outcome(good=True, message=said)
    how = f"status {process.returncode}" if process.returncode > 0 else f"signal {-process.returncode}"
    return Outcome(good=False, message=f"{command[0]} ended with {how}{': ' if said else ''}{said}")


def _listen(process: subprocess.Popen[bytes], deadline_s: float) -> str:
    """Read until the process ends or a time comes; return its last line. What it starts may keep the pipe open."""
    assert process.stdout is not None  # noqa: S101
    pipe, tail, ended = process.stdout.fileno(), b"", False
    while not ended and time.monotonic() < deadline_s:
        ended = process.poll() is not None
        while select.select([pipe], [], [], 0.0 if ended else _LOOK_S)[0] and time.monotonic() < deadline_s:
            part = os.read(pipe, 65536)
            tail = (tail + part)[-_TAIL_BYTES:]
            if not part:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, deadline_s - time.monotonic()))
                ended = True
                break
    lines = tail.decode("utf-8", "replace").strip().splitlines()
    return lines[-1].strip() if lines else ""
