"""A console as a process on a pseudo terminal, as a person at a keyboard has it."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path
from typing import Any, List

HERE = Path(__file__).parent
LIMIT_S = 20.0


class ConsoleProcess:
    """Starts fake_engine.py on a terminal of its own; `seen` is everything that it wrote.

    Args:
        folder: for the log of what the engine was asked.
        scene: that the engine shows.
        arguments: of the console.
    """

    def __init__(self, folder: Path, scene: str, *arguments: str, **environment: str) -> None:
        self.log = folder / "asked"
        self.log.touch()
        self.terminal, inside = pty.openpty()
        fcntl.ioctl(inside, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
        self.before = termios.tcgetattr(inside)
        self.inside = inside
        self.seen = ""
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "fake_engine.py"), str(self.log), scene, *arguments],
            stdin=inside,
            stdout=inside,
            stderr=inside,
            env={**os.environ, "TERM": "xterm-256color", "PYTHONIOENCODING": "utf-8", **environment},
            preexec_fn=_own_terminal,  # noqa: PLW1509 (a terminal of its own is what is tested)
        )

    def __enter__(self) -> ConsoleProcess:  # noqa: PYI034 (Self is not in Python 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(LIMIT_S)
        for descriptor in (self.terminal, self.inside):
            if descriptor >= 0:
                os.close(descriptor)

    def type(self, keys: str) -> None:
        """Type keys."""
        os.write(self.terminal, keys.encode())

    def wait_for(self, words: str) -> None:
        """Wait until words have been on the screen; colours do not count."""
        self._read_until(lambda: words in _plain(self.seen), words)

    def asked(self) -> List[str]:
        """Return what the engine was asked for so far."""
        return self.log.read_text(encoding="utf-8").splitlines()

    def end(self) -> int:
        """Wait for the end of the process and return its exit status; negative: killed by that signal."""
        self._read_until(lambda: self.process.poll() is not None, "the end of the console")
        self._drain()
        return self.process.returncode

    def after(self) -> List[Any]:
        """Return the terminal's attributes now."""
        return termios.tcgetattr(self.inside)

    def _read_until(self, holds: Any, what: str) -> None:
        deadline = time.monotonic() + LIMIT_S
        while not holds():
            assert time.monotonic() < deadline, f"no {what!r} in\n{_plain(self.seen)[-3000:]}"
            self._drain(0.05)

    def _drain(self, limit_s: float = 0.0) -> None:
        while self.terminal >= 0 and select.select([self.terminal], [], [], limit_s)[0]:
            try:
                data = os.read(self.terminal, 65536)
            except OSError:
                return
            self.seen += data.decode("utf-8", "replace")
            limit_s = 0.0

    def hang_up(self) -> None:
        """Close the terminal's window."""
        os.close(self.inside)
        os.close(self.terminal)
        self.terminal = self.inside = -1

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the console alone."""
        self.process.send_signal(number)


def _own_terminal() -> None:
    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def _plain(text: str) -> str:
    return re.sub(r"\x1b\[[0-?]*[ -/]*[@-~]", "", text)
