"""One XML-RPC call within a time limit for all of it: connecting, asking, every byte of the answer.

`xmlrpc.client` limits each read only, so that a peer that dribbles keeps its caller for ever.
"""

from __future__ import annotations

import socket
import time
import xmlrpc.client
from typing import Any, NamedTuple, Optional, Tuple, cast
from urllib.parse import urlparse

from .errors import BrokenCallError, CallError, CallTimeoutError, UnavailableError

__all__ = ["Answer", "NodeLiveness", "Place", "call"]

_MOST_BYTES = 1 << 16
_END_OF_HEAD = b"\r\n\r\n"
_DEFAULT_PORT = 80


def call(uri: str, method: str, arguments: Tuple[Any, ...], limit_s: float) -> Any:
    """Call a method of the API of a node or of the master; return the value of its answer (code, message, value).

    Raises:
        UnavailableError: Nobody listens there.
        CallTimeoutError: No whole answer within the limit.
        BrokenCallError: The peer died, answered nonsense, or said that it failed.
    """
    deadline_s = time.monotonic() + limit_s
    try:
        answer = _exchange(uri, xmlrpc.client.dumps(arguments, method).encode(), deadline_s)
        ((told,), _) = xmlrpc.client.loads(answer)
        code, message, value = cast(Tuple[Any, Any, Any], told)
    except socket.timeout as error:
        raise CallTimeoutError(f"no answer within {limit_s:g} s") from error
    except ConnectionRefusedError as error:
        raise UnavailableError("connection refused") from error
    except OSError as error:
        raise BrokenCallError(str(error)) from error
    except (BrokenCallError, CallTimeoutError):
        raise
    except Exception as error:  # expat, Fault, ValueError: whatever a stranger may answer
        raise BrokenCallError(f"answered nonsense: {error}") from error
    if code != 1:
        raise BrokenCallError(str(message))
    return value


def _exchange(uri: str, body: bytes, deadline_s: float) -> bytes:
    """Post a body; return that of the answer."""
    place = urlparse(uri)
    host, port = place.hostname or "", place.port or _DEFAULT_PORT
    head = (
        f"POST /RPC2 HTTP/1.0\r\nHost: {host}:{port}\r\nContent-Type: text/xml\r\nContent-Length: {len(body)}\r\n\r\n"
    )
    with socket.create_connection((host, port), timeout=_left_s(deadline_s)) as sock:
        sock.settimeout(_left_s(deadline_s))
        sock.sendall(head.encode() + body)
        return _answer(sock, deadline_s)


def _answer(sock: socket.socket, deadline_s: float) -> bytes:
    data = b""
    while True:
        head, found, body = data.partition(_END_OF_HEAD)
        length = _content_length(head) if found else None
        if length is not None and len(body) >= length:
            return body[:length]
        sock.settimeout(_left_s(deadline_s))
        part = sock.recv(_MOST_BYTES)
        if not part:
            if found:
                return body
            raise BrokenCallError("closed the connection without an answer")
        data += part
        if len(data) > _MOST_BYTES:
            raise BrokenCallError("answered more than any answer has")


def _content_length(head: bytes) -> Any:
    for line in head.split(b"\r\n")[1:]:
        name, _, value = line.partition(b":")
        if name.strip().lower() == b"content-length":
            return int(value)
    return None


def _left_s(deadline_s: float) -> float:
    left_s = deadline_s - time.monotonic()
    if left_s <= 0.0:
        raise CallTimeoutError("no answer within the limit")
    return left_s


# --- node liveness ----------------------------------------------------------------------------------------------------
# Does a node live? Asked of the node itself (XML-RPC getPid, http://wiki.ros.org/ROS/Slave_API).
#  The master only says where a node was when it registered; one that was killed stays on its list. So the master is
# asked for the address alone, and again whenever nobody answers there: a node that was restarted has another one.


class Answer(NamedTuple):
    """What came of asking.

    Args:
        alive: True: it answered; False: nobody is where it was; None: no answer in time, or it has not come up yet.
        message: why not.
    """

    alive: Optional[bool]
    message: str = ""


class Place(NamedTuple):
    """Where a node answered last.

    Args:
        uri: of its API.
        pid: as it said itself, on its own computer.
    """

    uri: str
    pid: int


class NodeLiveness:
    """One node; used by one thread at a time, except `place`.

    Args:
        node: its resolved name.
        master_uri: of the ROS master.
        caller_id: name of the node that asks.
        limit_s: time for each question, to the node and to the master.
    """

    def __init__(self, node: str, master_uri: str, caller_id: str, limit_s: float) -> None:
        self.node = node
        self.place: Optional[Place] = None
        self._master_uri, self._caller_id, self._limit_s = master_uri, caller_id, limit_s

    def ask(self) -> Answer:
        """Ask where it answered last, and where the master says it is when nobody answers there."""
        known = self.place
        if known is None:
            return self._ask_anew("")
        try:
            pid = self._pid(known.uri)
        except (UnavailableError, BrokenCallError) as error:
            return self._ask_anew(str(error))
        except CallTimeoutError as error:
            moved = self._look_up()
            return Answer(None, str(error)) if moved in (None, known.uri) else self._ask_anew(str(error))
        if pid != known.pid:  # somebody else may have got its port
            return self._ask_anew(f"process {known.pid} is gone")
        return Answer(alive=True)

    def _ask_anew(self, problem: str) -> Answer:
        """Ask where the master says it is; what never answered may still be coming up."""
        uri = self._look_up()
        silent = None if self.place is None else False
        if uri is None:
            return Answer(silent, problem or "not registered at the master")
        try:
            self.place = Place(uri, self._pid(uri))
        except CallTimeoutError as error:
            return Answer(None, str(error))
        except CallError as error:
            return Answer(silent, str(error))
        return Answer(alive=True)

    def _pid(self, uri: str) -> int:
        return int(call(uri, "getPid", (self._caller_id,), self._limit_s))

    def _look_up(self) -> Optional[str]:
        """Return the address that the master knows; None when it knows none, or does not answer."""
        try:
            return str(call(self._master_uri, "lookupNode", (self._caller_id, self.node), self._limit_s))
        except CallError:
            return None
