"""Where bytes go in and out: serial devices, UDP and TCP sockets, all without waiting.

A port belongs to one thread. Its methods raise OSError when the other end is gone; the link closes it then and opens it
again later.
"""

from __future__ import annotations

import abc
import contextlib
import fcntl
import os
import select
import socket
import struct
import termios
import time
from collections import deque
from typing import Any, Callable, Deque, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from amaze_autonomy.config.kinds import Endpoint, EndpointKind

from .dialect import LATE_NS

_CHUNK = 65536
_PENDING_LIMIT = 65536
_CONNECT_LIMIT_S = 0.5
_BURST = 64
_PEERS_KEPT = 8
_HOLDS = 1 << 20  # bytes that wait while this process stands still: by default it is a second of what a PX4 says
_STAMPS = 35  # SO_TIMESTAMPNS of Linux (asm-generic/socket.h), for which Python has no name
_STAMP = struct.Struct("@ll")  # timespec: seconds, nanoseconds
_S = 1_000_000_000
_NOTHING_IS_SENT = struct.pack("@ii", 1, 0)  # SO_LINGER: closing resets the connection


class Chunk(NamedTuple):
    """What has come in.

    Args:
        source: whom from; None: there is only one.
        data: as it came.
        waited_ns: for how long it lay in the socket before it was read; 0: not known.
    """

    source: Any
    data: bytes
    waited_ns: int = 0


class Port(abc.ABC):
    """A way in and out for bytes.

    Args:
        endpoint: where the other end is.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint

    @property
    def silence_is_loss(self) -> bool:
        """Whether a long silence is a reason to open it again."""
        return False

    @abc.abstractmethod
    def open(self) -> None:
        """Open it; nothing when it is open."""

    @abc.abstractmethod
    def close(self) -> None:
        """Close it; nothing when it is closed."""

    @abc.abstractmethod
    def fileno(self) -> Optional[int]:
        """Return what to wait for, None while it is closed."""

    @property
    def blocked(self) -> bool:
        """Whether something still waits to be written."""
        return False

    @abc.abstractmethod
    def read(self) -> List[Chunk]:
        """Return what has come in, and whom from."""

    @abc.abstractmethod
    def write(self, data: bytes, *, flies: bool = False) -> bool:
        """Send what can be sent now, keep the rest; return False when there is no room or nobody to send to.

        Args:
            data: a message.
            flies: it changes what the vehicle does, and must not come later than `LATE_NS`.
        """

    def flush(self) -> None:
        """Send what was kept."""

    def discard(self) -> None:
        """Have nothing of what waits, here and in the system, sent any more: at once, or when it is closed."""

    def prefer(self, source: Any) -> None:
        """Send to this source from now on: the vehicle speaks from there."""


class _Stream(Port):
    """What serial devices and TCP have in common: bytes that must be written in their order.

    They wait here, and in the system. What must not come late and has waited for too long is not sent any more.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        super().__init__(endpoint)
        self._fd: Optional[int] = None
        self._pending = bytearray()
        self._given = 0  # bytes that were to be written
        self._flying: Deque[Tuple[int, int]] = deque()  # what must not come late: up to which of them, and since when

    def fileno(self) -> Optional[int]:
        return self._fd

    @property
    def blocked(self) -> bool:
        return bool(self._pending)

    def close(self) -> None:
        if self._fd is not None:
            os.close(self._fd)
        self._fd = None
        self._forget()

    def _forget(self) -> None:
        self._pending.clear()
        self._flying.clear()

    @abc.abstractmethod
    def _give_up(self) -> None:
        """Have nothing sent of what waits; raise OSError where that takes another connection."""

    def read(self) -> List[Chunk]:
        if self._fd is None:
            return []
        try:
            data = os.read(self._fd, _CHUNK)
        except BlockingIOError:
            return []
        if not data:
            raise ConnectionResetError("the other end has closed")
        return [Chunk(None, data)]

    def write(self, data: bytes, *, flies: bool = False) -> bool:
        self.flush()
        if self._fd is None or len(self._pending) + len(data) > _PENDING_LIMIT:
            return False
        self._pending += data
        self._given += len(data)
        if flies:
            self._flying.append((self._given, time.monotonic_ns()))
        self._push(self._fd)
        return True

    def flush(self) -> None:
        if self._fd is not None:
            if self._is_late(self._fd):
                self._give_up()
            self._push(self._fd)

    def _push(self, fd: int) -> None:
        if self._pending:
            with contextlib.suppress(BlockingIOError):
                del self._pending[: os.write(fd, self._pending)]

    def _is_late(self, fd: int) -> bool:
        if not self._flying:
            return False
        held = bytes(4)
        with contextlib.suppress(OSError):  # a driver that does not tell
            held = fcntl.ioctl(fd, termios.TIOCOUTQ, held)  # of TCP: what was not acknowledged
        gone = self._given - len(self._pending) - int(struct.unpack("@i", held)[0])
        while self._flying and self._flying[0][0] <= gone:
            self._flying.popleft()
        return bool(self._flying) and time.monotonic_ns() - self._flying[0][1] > LATE_NS


class _Serial(_Stream):
    """A serial device: 8 data bits, no parity, one stop bit, no flow control; nobody else may have it open."""

    def __init__(self, endpoint: Endpoint) -> None:
        super().__init__(endpoint)
        self._speed = getattr(termios, f"B{endpoint.number}")

    def write(self, data: bytes, *, flies: bool = False) -> bool:  # noqa: ARG002
        return super().write(data, flies=True)  # to give up costs nothing here: nothing at all comes late

    def _give_up(self) -> None:
        self.discard()  # half a message may have gone: whoever reads finds the next

    def discard(self) -> None:
        self._forget()
        if self._fd is not None:
            with contextlib.suppress(termios.error):
                termios.tcflush(self._fd, termios.TCOFLUSH)

    def open(self) -> None:
        if self._fd is not None:
            return
        fd = os.open(self.endpoint.address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            fcntl.ioctl(fd, termios.TIOCEXCL)
            attributes = termios.tcgetattr(fd)
            attributes[:4] = [0, 0, termios.CS8 | termios.CREAD | termios.CLOCAL, 0]
            attributes[4] = attributes[5] = self._speed
            attributes[6][termios.VMIN], attributes[6][termios.VTIME] = 1, 0  # nothing to read is no end of file
            termios.tcsetattr(fd, termios.TCSANOW, attributes)
            termios.tcflush(fd, termios.TCIOFLUSH)
        except termios.error as error:
            os.close(fd)
            raise OSError(*error.args) from None
        except OSError:
            os.close(fd)
            raise
        self._fd = fd


class _Tcp(_Stream):
    """A TCP connection that is made from here.

    What the system has taken it sends again and again until it is acknowledged; only a reset ends that. So it is reset
    for a command that comes late, and for nothing less: not every peer takes another connection at once.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        super().__init__(endpoint)
        self._heard = False  # somebody has spoken on this connection

    @property
    def silence_is_loss(self) -> bool:
        return self._fd is not None

    def open(self) -> None:
        if self._fd is None:
            address = (self.endpoint.address, self.endpoint.number)
            self._adopt(socket.create_connection(address, timeout=_CONNECT_LIMIT_S))

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._set(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, LATE_NS // 1_000_000)
        super().close()

    def write(self, data: bytes, *, flies: bool = False) -> bool:
        # a peer that has one connection at a time reads this one, late, when it knows that it has lost the last one
        return (self._heard or not flies) and super().write(data, flies=flies)

    def read(self) -> List[Chunk]:
        chunks = super().read()
        self._heard = self._heard or bool(chunks)
        return chunks

    def _give_up(self) -> None:
        raise TimeoutError(f"a command was not taken within {LATE_NS / _S:.1f} s")

    def discard(self) -> None:
        self._set(socket.SOL_SOCKET, socket.SO_LINGER, _NOTHING_IS_SENT)

    def _set(self, level: int, option: int, value: Union[int, bytes]) -> None:
        if self._fd is not None:
            same = socket.socket(fileno=self._fd)
            try:
                same.setsockopt(level, option, value)
            finally:
                same.detach()

    def _adopt(self, connected: socket.socket) -> None:
        connected.setblocking(False)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._fd, self._heard = connected.detach(), False


class _TcpIn(_Tcp):
    """A TCP socket that waits for one peer."""

    def __init__(self, endpoint: Endpoint) -> None:
        super().__init__(endpoint)
        self._listener: Optional[socket.socket] = None

    def open(self) -> None:
        if self._listener is None:
            self._listener = _bound(self.endpoint, socket.SOCK_STREAM)
            self._listener.listen(1)

    def close(self) -> None:
        super().close()
        if self._listener is not None:
            self._listener.close()
        self._listener = None

    def fileno(self) -> Optional[int]:
        if self._fd is None and self._listener is not None:
            return self._listener.fileno()
        return self._fd

    def read(self) -> List[Chunk]:
        if self._fd is None and self._listener is not None:
            with contextlib.suppress(BlockingIOError):
                self._adopt(self._listener.accept()[0])
            return []
        return super().read()


class _Udp(Port):
    """A UDP socket; it answers where the vehicle spoke from last, or all peers while it is not known which is one."""

    def __init__(self, endpoint: Endpoint) -> None:
        super().__init__(endpoint)
        self._socket: Optional[socket.socket] = None
        self._vehicle: Any = None
        self._peers: Dict[Any, None] = {}
        self._empty_ns = 0  # when nothing was left to be read, on the monotonic clock

    def open(self) -> None:
        if self._socket is None:
            self._adopt(_bound(self.endpoint, socket.SOCK_DGRAM))

    def _adopt(self, made: socket.socket) -> None:
        with contextlib.suppress(OSError):  # a system without stamps: it is not known how long something waited
            made.setsockopt(socket.SOL_SOCKET, _STAMPS, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _HOLDS)  # or what the system allows
        self._socket, self._empty_ns = made, time.monotonic_ns()

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._vehicle = None, None
        self._peers.clear()

    def fileno(self) -> Optional[int]:
        return None if self._socket is None else self._socket.fileno()

    def read(self) -> List[Chunk]:
        chunks: List[Chunk] = []
        while self._socket is not None and len(chunks) < _BURST:
            try:
                data, control, _, source = self._socket.recvmsg(_CHUNK, socket.CMSG_SPACE(_STAMP.size))
            except BlockingIOError:
                self._empty_ns = time.monotonic_ns()
                break
            except ConnectionError:
                continue
            self._remember(source)
            chunks.append(Chunk(source, data, self._waited_ns(control)))
        return chunks

    def _waited_ns(self, control: Sequence[Tuple[int, int, bytes]]) -> int:
        """Return for how long a datagram has waited: never since before nothing did, should the wall clock be set."""
        for level, kind, data in control:
            if (level, kind, len(data)) == (socket.SOL_SOCKET, _STAMPS, _STAMP.size):
                seconds, rest_ns = _STAMP.unpack(data)
                waited_ns: int = time.time_ns() - seconds * _S - rest_ns
                return max(0, min(waited_ns, time.monotonic_ns() - self._empty_ns))
        return 0

    def write(self, data: bytes, *, flies: bool = False) -> bool:  # noqa: ARG002 - nothing waits
        targets = list(self._peers) if self._vehicle is None else [self._vehicle]
        return bool([self._send(data, target) for target in targets].count(True))

    def prefer(self, source: Any) -> None:
        self._vehicle = source

    def _remember(self, source: Any) -> None:
        if source not in self._peers and len(self._peers) < _PEERS_KEPT:
            self._peers[source] = None

    def _send(self, data: bytes, target: Any) -> bool:
        with contextlib.suppress(BlockingIOError, ConnectionError):
            return self._socket is not None and self._socket.sendto(data, target) == len(data)
        return False


class _UdpOut(_Udp):
    """A UDP socket that speaks first, and listens to nobody but whom it speaks to."""

    def open(self) -> None:
        if self._socket is None:
            family, kind, _, _, address = _resolved(self.endpoint, socket.SOCK_DGRAM)
            made = socket.socket(family, kind)
            made.setblocking(False)
            made.connect(address)
            self._adopt(made)

    def write(self, data: bytes, *, flies: bool = False) -> bool:  # noqa: ARG002
        with contextlib.suppress(BlockingIOError, ConnectionError):
            return self._socket is not None and self._socket.send(data) == len(data)
        return False


def _resolved(endpoint: Endpoint, kind: int) -> Any:
    return socket.getaddrinfo(endpoint.address, endpoint.number, type=kind)[0]


def _bound(endpoint: Endpoint, kind: int) -> socket.socket:
    family, kind, _, _, address = _resolved(endpoint, kind)
    made = socket.socket(family, kind)
    made.setblocking(False)
    if kind == socket.SOCK_STREAM:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind(address)
    except OSError:
        made.close()
        raise
    return made


_PORTS: Mapping[EndpointKind, Callable[[Endpoint], Port]] = {
    EndpointKind.SERIAL: _Serial,
    EndpointKind.UDP_IN: _Udp,
    EndpointKind.UDP_OUT: _UdpOut,
    EndpointKind.TCP: _Tcp,
    EndpointKind.TCP_IN: _TcpIn,
}


def make_port(endpoint: Endpoint) -> Port:
    """Return a closed port."""
    return _PORTS[endpoint.kind](endpoint)


def wait_readable(fd: Optional[int], waker: int, limit_s: float, *, writes: bool) -> Tuple[bool, bool]:
    """Wait until a port or a pipe can be read, or a time has passed; return which of the two.

    Args:
        fd: of the port; None: it is closed.
        waker: of the pipe.
        limit_s: the time.
        writes: the port has something to send, and is waited for until it takes it.
    """
    poller = select.poll()
    poller.register(waker, select.POLLIN)
    if fd is not None:
        poller.register(fd, select.POLLIN | (select.POLLOUT if writes else 0))
    ready = [number for number, _ in poller.poll(max(0.0, limit_s) * 1e3)]
    return fd in ready, waker in ready
