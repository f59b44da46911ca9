"""A process of this computer, found by the port that it listens at: the only one that a node's restart may kill.

A node tells its process number itself, but that may be another computer's or another container's, and a number may be
given to somebody else. So the process must hold the very socket at which the node's API listens (proc(5)), and it is
known by its number and the time of its start from then on.
"""

from __future__ import annotations

import os
import signal
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import List, Optional, Set
from urllib.parse import urlparse

import rosgraph.network

__all__ = ["LocalProcess", "find"]

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
