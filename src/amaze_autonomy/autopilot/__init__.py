"""The link to an autopilot over MAVLink: a connection that keeps itself up, and pure clients that live on it.

No ROS. `connection.py` has the one thread; all else takes times and messages and returns state or messages to send.
"""

from __future__ import annotations

from .errors import AutopilotError, KeyFileError
from .link.connection import Client, Connection, LinkState
from .link.peers import Identity
from .link.wire import read_key

__all__ = [
    "AutopilotError",
    "Client",
    "Connection",
    "Identity",
    "KeyFileError",
    "LinkState",
    "read_key",
]
