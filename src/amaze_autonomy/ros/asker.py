"""Who asks a service, since when, and whether he still waits: rospy tells its handlers nothing of it.

A request may lie in a socket while the process that serves it does not run. And who gives up closes his connection,
which takes back nothing that he has sent: the kernel delivers it for minutes. So a handler that carries out what
surprises somebody who was told that there is no answer looks at the connection first.
"""

from __future__ import annotations

import select
import socket
import struct
import time
from contextlib import suppress
from typing import Any, Optional, Tuple
from weakref import WeakKeyDictionary

import rospy
from rospy.exceptions import TransportException, TransportTerminated

_KEY = "asker"
_AT_ONCE_S = 3.0  # a request that comes so soon was meant when its connection was opened
_GRACE_S, _LONGEST_GRACE_S, _ROUND_TRIPS = 0.005, 0.5, 3
# Of `struct tcp_info` of the kernel: milliseconds since data came, microseconds of the shortest round trip.
_INFO_BYTES, _LAST_DATA_AT, _ROUND_TRIP_AT = 152, 52, 148
_accepted: WeakKeyDictionary[socket.socket, Tuple[float, float]] = WeakKeyDictionary()


class Asker:
    """Who waits at the other end of a connection for the answer to a request.

    Args:
        sock: the connection; None: it is not known, and he waits.
        lay_s: for how long the request has lain in it.
    """

    def __init__(self, sock: Optional[socket.socket] = None, lay_s: float = 0.0) -> None:
        self._sock = sock
        self._came_s = time.monotonic() - lay_s

    @property
    def age_s(self) -> float:
        """For how long the request has been on this computer."""
        return time.monotonic() - self._came_s

    def has_gone(self, limit_s: float = 0.0) -> bool:
        """Tell whether his end of the connection is closed, or is before the limit."""
        if self._sock is None:
            return False
        watch = select.poll()
        try:
            watch.register(self._sock, select.POLLRDHUP)
            return bool(watch.poll(limit_s * 1e3))
        except (OSError, ValueError):  # it is closed at our end
            return True

    def has_gone_behind_it(self) -> bool:
        """Tell whether he went when he had asked: a network that comes back brings the request alone, then the rest.

        The rest is sent when the request is acknowledged; a round trip of the connection is waited for it.
        """
        if self._sock is None:
            return False
        with suppress(OSError):
            self._sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)  # else the kernel takes 40 ms and more
        round_trip_s = _info(self._sock, _ROUND_TRIP_AT) / 1e6
        return self.has_gone(min(_GRACE_S + _ROUND_TRIPS * round_trip_s, _LONGEST_GRACE_S))


def asker_of(request: Any) -> Asker:
    """Return who makes a request that an `AskedService` has taken; somebody who waits where it is of no connection."""
    header = getattr(request, "_connection_header", None) or {}
    asker = header.get(_KEY)
    return asker if isinstance(asker, Asker) else Asker()


def note_accepted(sock: socket.socket) -> None:
    """Remember for how long a connection has lain there when it is accepted: its first request was meant then."""
    _accepted[sock] = (time.monotonic(), _info(sock, _LAST_DATA_AT) / 1e3)


class AskedService(rospy.Service):
    """A service whose handler can tell who asks, by `asker_of`. Who has gone without his answer is no error."""

    def _handle_request(self, transport: Any, request: Any) -> None:
        sock = transport.socket
        accepted_s, lay_s = _accepted.pop(sock, (0.0, 0.0))
        if time.monotonic() - accepted_s > _AT_ONCE_S:
            lay_s = 0.0
        asker = Asker(sock, lay_s + _info(sock, _LAST_DATA_AT) / 1e3)
        request._connection_header = {**transport.header, _KEY: asker}
        try:
            super()._handle_request(transport, request)
        except (OSError, TransportException) as error:
            raise TransportTerminated(f"the answer reached nobody: {error}") from error

    def error_handler(self, error: Any, kind: Any, value: Any, trace: Any) -> None:
        """Say what is a defect of ours."""
        if not isinstance(error, (OSError, TransportException)):
            super().error_handler(error, kind, value, trace)


def _info(sock: socket.socket, place: int) -> int:
    """Return a number of what the kernel knows of a connection; 0 where it does not."""
    try:
        (number,) = struct.unpack_from("=I", sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _INFO_BYTES), place)
    except (OSError, struct.error):
        return 0
    return int(number)
