"""What can go wrong at the border to ROS.

NodeError
├── StartError              the node cannot start: one line for the user
└── CallError               a service call did not end with an answer
    ├── UnavailableError    there is no such service, or nobody behind it
    ├── CallTimeoutError    no answer within the limit
    └── BrokenCallError     it died in mid-call, or answered nonsense
"""

from __future__ import annotations

__all__ = [
    "BrokenCallError",
    "CallError",
    "CallTimeoutError",
    "NodeError",
    "StartError",
    "UnavailableError",
]


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
