"""Call a ROS service within a time limit, over connections that stay open.

`rospy.ServiceProxy` has no time limit anywhere: a peer that accepts a connection and then says nothing stops its
caller for ever. This client speaks the same protocol (TCPROS, http://wiki.ros.org/ROS/TCPROS) with a limit on every
step, sends a request without blocking when a connection is open, and notices that a restarted peer has left a
connection dead before it sends anything on it. A request is never sent twice.

Giving up takes nothing back: what was sent while the network was away is delivered when it returns, minutes later. A
request that must not come so late expires: with its connection it is discarded, also when this process is killed.
"""

from __future__ import annotations

import io
import select
import socket
import struct
import threading
import time
from typing import Any, List, Optional, Type
from urllib.parse import urlparse

from rosgraph.network import ROSHandshakeException, decode_ros_handshake_header, encode_ros_handshake_header

from .errors import BrokenCallError, CallTimeoutError, UnavailableError
from .liveness import call

Serialized = bytes
_LONGEST = 16 * 1024 * 1024  # bytes; a longer answer is nonsense
_MOST_IDLE = 4  # connections to one service that wait for a request
_DISCARD, _DELIVER = struct.pack("ii", 1, 0), struct.pack("ii", 0, 0)  # what closing does to what is under way


class Connection:
    """One open connection to one service; carries one request at a time.

    Args:
        sock: connected, handshake done.
    """

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock

    @property
    def alive(self) -> bool:
        """False when the peer has closed it, or has said something without being asked."""
        watch = select.poll()  # select knows no descriptor above 1,023
        try:
            watch.register(self._sock, select.POLLIN)
            return not watch.poll(0)
        except (OSError, ValueError):
            return False

    def send(self, data: Serialized, *, expires: bool = False) -> bool:
        """Send a whole request without waiting; False when it cannot go out at once: the connection is then useless.

        Args:
            data: the request.
            expires: when the connection is closed, it is not to arrive any more.
        """
        try:
            self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _DISCARD if expires else _DELIVER)
            return self._sock.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL) == len(data)
        except OSError:
            return False

    def receive(self, deadline_s: float) -> bytes:
        """Return the body of the answer.

        Args:
            deadline_s: on `time.monotonic()`.

        Raises:
            CallTimeoutError: The answer is not complete by then.
            BrokenCallError: The peer died, failed, or answered nonsense.
        """
        good, length = struct.unpack("<BI", self._read(5, deadline_s))
        if length > _LONGEST:
            raise BrokenCallError(f"answered {length} bytes, more than any answer has")
        body = self._read(length, deadline_s)
        if good != 1:
            raise BrokenCallError(f"failed: {body.decode('utf-8', 'replace')}")
        return body

    def _read(self, length: int, deadline_s: float) -> bytes:
        return _read(self._sock, length, deadline_s)

    def close(self) -> None:
        """Close it; a late answer then reaches nobody."""
        self._sock.close()


def _left_s(deadline_s: float) -> float:
    left_s = deadline_s - time.monotonic()
    if left_s <= 0.0:
        raise CallTimeoutError("did not answer within the limit")
    return left_s


def _read(sock: socket.socket, length: int, deadline_s: float) -> bytes:
    parts: List[bytes] = []
    while length > 0:
        sock.settimeout(max(0.0, deadline_s - time.monotonic()))  # 0: what has come by then counts
        try:
            part = sock.recv(min(length, 65536))
        except (socket.timeout, BlockingIOError) as error:
            raise CallTimeoutError("did not answer within the limit") from error
        except OSError as error:
            raise BrokenCallError(f"died in mid-call: {error}") from error
        if not part:
            raise BrokenCallError("died in mid-call")
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


class ServiceClient:
    """All connections to one service. Thread-safe.

    Args:
        name: resolved name of the service.
        service: its class.
        master_uri: of the ROS master.
        caller_id: resolved name of this node.
        spare: how many idle connections `keep` holds open.
    """

    def __init__(self, name: str, service: Type[Any], master_uri: str, caller_id: str, spare: int = 1) -> None:
        self.name, self.service, self.spare = name, service, spare
        self._master_uri, self._caller_id = master_uri, caller_id
        self._idle: List[Connection] = []
        self._lock = threading.Lock()

    def serialize(self, request: Any) -> Serialized:
        """Return a request as it goes over the wire."""
        buffer = io.BytesIO()
        request.serialize(buffer)
        body = buffer.getvalue()
        return struct.pack("<I", len(body)) + body

    def ask(self, limit_s: float, *, expires: bool = False, **fields: Any) -> Any:
        """Make a request of its fields, send it, and wait for its answer.

        Args:
            limit_s: how long.
            expires: what has not arrived by then is not to arrive any more.
            fields: of the request.

        Raises:
            CallError: There was no good answer within the limit.
        """
        data = self.serialize(self.service._request_class(**fields))
        return self.call(data, time.monotonic() + limit_s, expires=expires)

    def parse(self, body: bytes) -> Any:
        """Return the answer that a body holds.

        Raises:
            BrokenCallError: It holds none.
            MemoryError: There is no room for it.
        """
        try:
            response = self.service._response_class().deserialize(body)
            again = io.BytesIO()
            response.serialize(again)
        except MemoryError:
            raise
        except Exception as error:  # genpy raises whatever struct, codecs and its own code raise
            raise BrokenCallError(f"answered nonsense: {error}") from error
        if again.getvalue() != body:  # genpy takes a text that is cut off for a whole one, and any byte for a bool
            raise BrokenCallError(f"answered nonsense: {len(body)} bytes are no {response._type}")
        return response

    def send_now(self, data: Serialized, *, expires: bool = False) -> Optional[Connection]:
        """Send a request on an idle connection without waiting for anything; None when there is no live one."""
        while True:
            with self._lock:
                connection = self._idle.pop() if self._idle else None
            if connection is None:
                return None
            if connection.alive and connection.send(data, expires=expires):
                return connection
            connection.close()

    def finish(self, connection: Connection, deadline_s: float) -> Any:
        """Wait for the answer to what was sent on a connection; keep the connection when it is still good.

        Raises:
            CallError: There was no good answer by the deadline.
        """
        try:
            body = connection.receive(deadline_s)
        except Exception:
            connection.close()
            raise
        self._give_back(connection)
        return self.parse(body)

    def call(self, data: Serialized, deadline_s: float, *, expires: bool = False) -> Any:
        """Send a request and wait for its answer, connecting first if need be.

        Raises:
            CallError: There was no good answer by the deadline.
        """
        connection = self.send_now(data, expires=expires)
        if connection is None:
            connection = self.connect(deadline_s)
            if not connection.send(data, expires=expires):
                connection.close()
                raise BrokenCallError("the connection broke before the request was sent")
        return self.finish(connection, deadline_s)

    def keep(self, limit_s: float) -> None:
        """Drop idle connections that died; open new ones until there are `spare`. Gives up silently."""
        with self._lock:
            dead = [each for each in self._idle if not each.alive]
            self._idle = [each for each in self._idle if each not in dead]
            missing = self.spare - len(self._idle)
        for connection in dead:
            connection.close()
        try:
            for _ in range(missing):
                self._give_back(self.connect(time.monotonic() + limit_s))
        except (UnavailableError, CallTimeoutError, BrokenCallError):
            return

    def is_offered(self, limit_s: float) -> bool:
        """Tell whether the master knows the service."""
        try:
            self._look_up(time.monotonic() + limit_s)
        except (UnavailableError, CallTimeoutError):
            return False
        return True

    def connect(self, deadline_s: float) -> Connection:
        """Look the service up and connect to it.

        Raises:
            UnavailableError: There is no such service, or nobody behind it.
            CallTimeoutError: It did not come about by the deadline.
            BrokenCallError: What is there is another service, or none at all.
        """
        host, port = self._look_up(deadline_s)
        try:
            sock = socket.create_connection((host, port), timeout=_left_s(deadline_s))
        except socket.timeout as error:
            raise CallTimeoutError(f"{host}:{port} did not accept a connection within the limit") from error
        except OSError as error:
            raise UnavailableError(f"nobody at {host}:{port}: {error}") from error
        try:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._shake_hands(sock, deadline_s)
        except Exception:
            sock.close()
            raise
        return Connection(sock)

    def _look_up(self, deadline_s: float) -> Any:
        try:
            uri = call(self._master_uri, "lookupService", (self._caller_id, self.name), _left_s(deadline_s))
        except BrokenCallError as error:
            raise UnavailableError(f"no such service: {error}") from error
        except (CallTimeoutError, UnavailableError) as error:
            raise type(error)(f"the ROS master: {error}") from error
        try:
            place = urlparse(str(uri))
            host, port = place.hostname, place.port
        except ValueError:
            host = port = None
        if not host or not port:
            raise UnavailableError(f"the ROS master names a place that is none: {uri!r}")
        return host, port

    def _shake_hands(self, sock: socket.socket, deadline_s: float) -> None:
        header = {
            "callerid": self._caller_id,
            "md5sum": self.service._md5sum,
            "persistent": "1",
            "service": self.name,
            "type": self.service._type,
        }
        sock.settimeout(_left_s(deadline_s))
        try:
            sock.sendall(encode_ros_handshake_header(header))
        except OSError as error:
            raise BrokenCallError(f"died in the handshake: {error}") from error
        prefix = _read(sock, 4, deadline_s)
        (length,) = struct.unpack("<I", prefix)
        if length > _LONGEST:
            raise BrokenCallError("is no ROS service")
        try:
            answer = decode_ros_handshake_header(prefix + _read(sock, length, deadline_s))
        except (ROSHandshakeException, ValueError, struct.error) as error:
            raise BrokenCallError(f"is no ROS service: {error}") from error
        if "error" in answer:
            raise BrokenCallError(f"is another service: {answer['error']}")

    def _give_back(self, connection: Connection) -> None:
        with self._lock:
            if len(self._idle) < _MOST_IDLE:
                self._idle.append(connection)
                return
        connection.close()

    def close(self) -> None:
        """Close all idle connections."""
        with self._lock:
            idle, self._idle = self._idle, []
        for connection in idle:
            connection.close()
