#!/usr/bin/env python3
"""The autonomy node with something wrong that no input brings about: a test of such an engine must fail, or shows what
becomes of it.

    --without-rule=RULE         a row is taken out of the transition table
    --thread-ends-at=FILE       the thread that decides ends once FILE is there; FILE is removed
    --thread-hangs-at=FILE      likewise, it hangs
    --all-hangs-at=FILE         likewise, and so does whoever decides in its place; FILE stays
    --writer-ends-at=FILE       the thread that writes journal and ~state ends, likewise; FILE is removed
    --no-threads-at=FILE        no thread can be started while FILE is there
"""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import Callable, List

from amaze_autonomy.engine import transitions
from amaze_autonomy.nodes.autonomy.engine_thread import EngineThread
from amaze_autonomy.nodes.autonomy.outbox import Outbox


def without_rule(rule: str) -> None:
    """Take a row out of the table that `decide` reads."""
    if rule not in {row.rule for row in transitions.TRANSITIONS}:
        raise SystemExit(f"no such rule: {rule}")
    for place, rows in transitions.ROWS_AT.items():
        transitions.ROWS_AT[place] = tuple(row for row in rows if row.rule != rule)


def thread_ends_at(file: str) -> None:
    """Have the thread that decides end as nothing that is known ends it."""
    _instead(file, sys.exit)


def thread_hangs_at(file: str) -> None:
    """Have the thread that decides wait for ever."""
    _instead(file, threading.Event().wait)


def all_hangs_at(file: str) -> None:
    """Have every thread that decides wait for ever."""
    _instead(file, threading.Event().wait, once=False)


def writer_ends_at(file: str) -> None:
    """Have the thread that writes end as nothing that is known ends it."""
    periodic = Outbox._keep

    def end_or_write(outbox: Outbox) -> None:
        if Path(file).exists():
            Path(file).unlink()
            raise SystemExit
        periodic(outbox)

    Outbox._keep = end_or_write  # type: ignore[method-assign]


def _instead(file: str, happens: Callable[[], object], *, once: bool = True) -> None:
    turn = EngineThread._turn

    def happen_or_turn(engine: EngineThread, limit_s: float) -> None:
        if Path(file).exists():
            if once:
                Path(file).unlink()
            happens()
        turn(engine, limit_s)

    EngineThread._turn = happen_or_turn  # type: ignore[method-assign]


def no_threads_at(file: str) -> None:
    """Have the system refuse new threads, as under a limit of processes."""
    start = threading.Thread.start

    def refuse_or_start(thread: threading.Thread) -> None:
        if Path(file).exists():
            raise RuntimeError("can't start new thread")
        start(thread)

    threading.Thread.start = refuse_or_start  # type: ignore[method-assign]


OPTIONS = {
    "--without-rule": without_rule,
    "--thread-ends-at": thread_ends_at,
    "--thread-hangs-at": thread_hangs_at,
    "--all-hangs-at": all_hangs_at,
    "--writer-ends-at": writer_ends_at,
    "--no-threads-at": no_threads_at,
}


def cripple(words: List[str]) -> List[str]:
    """Do what the words say; return those that are the node's."""
    rest = []
    for word in words:
        option, _, value = word.partition("=")
        if option in OPTIONS:
            OPTIONS[option](value)
        else:
            rest.append(word)
    return rest


if __name__ == "__main__":
    sys.argv = cripple(sys.argv)
    from amaze_autonomy.nodes.autonomy.node import main

    raise SystemExit(main())
