"""Is another node alive, and which process is it: one XML-RPC call within a limit for all of it.

`xmlrpc.client` limits each read only, so that a peer that dribbles keeps its caller for ever.
"""

from __future__ import annotations

import os
import signal
import socket
import time
import xmlrpc.client
from contextlib import suppress
from pathlib import Path
from typing import Any, List, NamedTuple, Optional, Set, Tuple, cast
from urllib.parse import urlparse

import rosgraph.network

from .errors import BrokenCallError, CallError, CallTimeoutError, UnavailableError

# --- the node ---------------------------------------------------------------------------------------------------------


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


# --- its process ------------------------------------------------------------------------------------------------------
# A node tells its process number itself, but that may be another computer's or another container's, and a number may be
# given to somebody else. So the process must hold the very socket at which the node's API listens (proc(5)), and it is
# known by its number and the time of its start from then on.


_LISTENS = "0A"
_START_FIELD = 19  # of /proc/PID/stat, counted after the name
_POLL_S = 0.02


class LocalProcess:
    """One process.

    Args:
        pid: its number.
        start: time of its start, in ticks since the start of the system.
    """

    def __init__(self, pid: int, start: int) -> None:
        self.pid, self.start = pid, start

    @classmethod
    def of(cls, pid: int) -> Optional[LocalProcess]:
        """Return the process that has a number now; None when there is none."""
        fields = _stat(pid)
        return None if fields is None else cls(pid, int(fields[_START_FIELD]))

    @property
    def alive(self) -> bool:
        """False when it has ended."""
        fields = _stat(self.pid)
        return fields is not None and fields[0] not in "ZX" and int(fields[_START_FIELD]) == self.start

    @property
    def halted(self) -> bool:
        """True while it is stopped (SIGSTOP, or a debugger)."""
        fields = _stat(self.pid)
        return fields is not None and fields[0] in "Tt" and int(fields[_START_FIELD]) == self.start

    @property
    def age_s(self) -> float:
        """Return the time since its start."""
        return time.clock_gettime(time.CLOCK_BOOTTIME) - self.start / os.sysconf("SC_CLK_TCK")

    def kill(self) -> None:
        """End it by SIGKILL, which a stopped process does not survive either."""
        if self.alive:
            os.kill(self.pid, signal.SIGKILL)

    def wait(self, limit_s: float) -> bool:
        """Wait for its end; return whether it came."""
        deadline_s = time.monotonic() + limit_s
        while self.alive:
            if time.monotonic() >= deadline_s:
                return False
            time.sleep(_POLL_S)
        return True


def find(uri: str, pid: int) -> Optional[LocalProcess]:
    """Return the process behind the API of a node; None when it is not of this computer, or not ours to look at."""
    place = urlparse(uri)
    if pid in (0, 1, os.getpid()) or not place.port or not _is_here(place.hostname or ""):
        return None
    fields = _stat(pid)
    if fields is None or not _sockets(pid) & _listening(place.port):
        return None
    return LocalProcess(pid, int(fields[_START_FIELD]))


def _is_here(host: str) -> bool:
    try:
        address = socket.gethostbyname(host)
    except OSError:
        return False
    return address.startswith("127.") or address in rosgraph.network.get_local_addresses()


def _stat(pid: int) -> Optional[List[str]]:
    """Return the fields of /proc/PID/stat from the state on; None when there is no such process."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    return text.rpartition(")")[2].split()


def _sockets(pid: int) -> Set[str]:
    """Return the inodes of the sockets that a process holds; none when that is not ours to see."""
    found: Set[str] = set()
    with suppress(OSError):  # it has ended, or is not ours
        for link in Path(f"/proc/{pid}/fd").iterdir():
            target = os.readlink(link)
            if target.startswith("socket:["):
                found.add(target[len("socket:[") : -1])
    return found


def _listening(port: int) -> Set[str]:
    """Return the inodes of the sockets that listen at a port."""
    found: Set[str] = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        try:
            lines = Path(table).read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            if fields[3] == _LISTENS and int(fields[1].rpartition(":")[2], 16) == port:
                found.add(fields[9])
    return found
