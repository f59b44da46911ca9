"""What can go wrong at the border to ROS.

NodeError
├── StartError              the node cannot start: one line for the user
└── CallError               a service call did not end with an answer
    ├── UnavailableError    there is no such service, or nobody behind it
    ├── CallTimeoutError    no answer within the limit
    └── BrokenCallError     it died in mid-call, or answered nonsense
"""

from __future__ import annotations

import logging
import os
from contextlib import suppress

_UNLOGGED = b"amaze_autonomy: an error could not be logged: memory is too short\n"
_STDERR = 2


class NodeError(Exception):
    """Base of all errors of the nodes."""


class StartError(NodeError):
    """The node cannot start; the text says why and what would be right."""


class CallError(NodeError):
    """A service call did not end with an answer."""


class UnavailableError(CallError):
    """There is no such service, or nobody behind it."""


class CallTimeoutError(CallError):
    """No answer came within the limit."""


class BrokenCallError(CallError):
    """The service died in mid-call, or answered nonsense."""


def report(log: logging.Logger, text: str, *values: object) -> None:
    """Log the exception that is being handled; never raises, so that who handles it can go on.

    Where memory is too short to log anything, which logging itself does not survive, a ready-made line says so.

    Args:
        log: of the module.
        text: what could not be done, with a place for each value.
        values: that go into it.
    """
    try:
        log.exception(text, *values)
    except Exception:
        with suppress(OSError):
            os.write(_STDERR, _UNLOGGED)
