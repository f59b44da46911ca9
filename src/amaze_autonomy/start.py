"""Starts commands and nodes: Ctrl-C ends one quietly also while what it needs is still being loaded.

That takes from a tenth of a second to several on a small computer, and Python would end it with a traceback.
"""

from __future__ import annotations

import os
import signal
from importlib import import_module

_INTERRUPTED = 130  # as `command_line.INTERRUPTED`, which is not loaded yet
_TOLD_TO_END = 0


def start_command(module: str) -> int:
    """Run the `main` of a module; return its exit status, after Ctrl-C 130."""
    return _start(module, _INTERRUPTED)


def start_node(module: str) -> int:
    """Run the `main` of a node; return its exit status, 0 when it was told to end before it was one."""
    return _start(module, _TOLD_TO_END)


def amaze_autonomy() -> int:
    """Run the command `amaze-autonomy`."""
    return start_command("amaze_autonomy.cli")


def amaze_bag() -> int:
    """Run the command `amaze-bag`."""
    return start_command("amaze_autonomy.bags.cli")


def amaze_replay() -> int:
    """Run the command `amaze-replay`."""
    return start_command("amaze_autonomy.tester.command")


def _start(module: str, interrupted: int) -> int:
    heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # it is ignored in a shell's background
    if heard:
        signal.signal(signal.SIGINT, lambda *_: os._exit(interrupted))  # an exception could be lost in what is loaded
    main = import_module(module).main
    try:
        if heard:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        return int(main())
    except KeyboardInterrupt:
        return interrupted
