"""The plain mode: prints what changes, reads lines where there are any, never waits for them. One thread."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from typing import List, Optional, TextIO

from .plain import changes
from .session import CLOSED, Session
from .terminal import Wake, read_if_ready

__all__ = ["run_plain"]

_LOOK_S = 0.25
_LONGEST_LINE = 4096
_QUIT_WORDS = ("q", "quit", "exit")


class _Lines:
    """Bytes made into lines; a line that is too long is dropped."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> List[str]:
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _LONGEST_LINE:
            self._rest = b""
        return [line[:_LONGEST_LINE].decode("utf-8", "replace") for line in lines]

    def close(self) -> List[str]:
        rest, self._rest = self._rest, b""
        return [rest.decode("utf-8", "replace")] if rest.strip() else []


class _Printer:
    """Prints what is different since the last time.

    Args:
        out: where to.
        session: that is looked at.
    """

    def __init__(self, out: TextIO, session: Session) -> None:
        self._out, self._session = out, session
        self._desk, self._seen_s = replace(session.desk), session.now()
        self.line(f"START     console of {session.desk.engine}, {time.strftime('%Y-%m-%d, local time %z')}")

    def look(self) -> None:
        desk, now_s = self._session.desk, self._session.now()
        for words in changes(self._desk, self._seen_s, desk, now_s):
            self.line(words)
        self._desk, self._seen_s = desk, now_s

    def line(self, words: str) -> None:
        """Print one line at once; a reader that has gone ends the console, nothing else."""
        try:
            self._out.write(f"{self._session.clock()} {words}\n")
            self._out.flush()
        except OSError:
            self._session.end(CLOSED)
            if self._out is sys.stdout:  # what is left in it would make the exit status 120
                os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def run_plain(session: Session, wake: Wake, source: Optional[int], out: Optional[TextIO] = None) -> None:
    """Run the console line by line until the session is over.

    Args:
        session: that is shown.
        wake: ends the wait for input.
        source: descriptor that lines are read from; None: nobody types.
        out: where to print; None: standard output.
    """
    session.desk = replace(session.desk, interactive=source is not None)
    printer = _Printer(out or sys.stdout, session)
    lines, waiting = _Lines(), []  # type: _Lines, List[str]
    while session.status is None:
        session.turn()
        waiting = _pass_on(session, waiting, printer)
        printer.look()
        if session.status is not None:
            break
        data = read_if_ready(source, wake, _LOOK_S)
        if data == b"":
            source = None
            session.desk = replace(session.desk, interactive=bool(waiting))
            waiting += lines.close()
        elif data is not None:
            waiting += lines.feed(data)
    printer.line(f"END       {session.farewell()}")


def _pass_on(session: Session, lines: List[str], printer: _Printer) -> List[str]:
    """Pass lines on as soon as they can mean something, and return the others: a script may be too early."""
    for number, line in enumerate(lines):
        desk = session.desk
        known = desk.snapshot is not None and (not desk.snapshot.takes_mission or desk.missions is not None)
        if not known and line.strip().lower() not in _QUIT_WORDS:
            return lines[number:]
        session.typed(line)
        printer.look()
    return []
