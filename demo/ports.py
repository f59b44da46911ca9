"""Ports for a demo: free, and kept for it until whoever reads its answer has ended.

The programs of a demo take their ports seconds after they were chosen. Two demos that are started together would find
the same ones free, also those of two folders or of two users: so each is reserved by a name that the kernel gives to
one process of the computer, or of the network namespace that the ports are of, until that ends (unix(7), abstract).
"""

from __future__ import annotations

import random
import select
import socket
import sys
from contextlib import ExitStack, suppress
from itertools import chain
from typing import Iterable

MASTER, WEB, MAVLINK = 11311, 8080, 14540
_OTHERS = range(20000, 30000, 2)  # below those that the kernel gives to anybody
_TRIES = 500


def free_ports(kept: ExitStack, usual: int, count: int, kind: socket.SocketKind, host: str) -> int:
    """Return the first of so many ports in a row that are free and reserved for us: the usual ones, or others.

    Args:
        kept: holds the reservation.
        usual: the first of those that are wanted.
        count: how many.
        kind: stream for TCP, datagram for UDP.
        host: at which they must be free; empty: at all addresses.

    Raises:
        OSError: There are none.
    """
    others: Iterable[int] = random.sample(_OTHERS, _TRIES)
    for first in chain([usual], others):
        with ExitStack() as tried, suppress(OSError):
            for port in range(first, first + count):
                reserve(tried, port)
                _try(port, kind, host)
            kept.push(tried.pop_all())
            return first
    raise OSError(f"no free ports between {_OTHERS.start} and {_OTHERS.stop}")


def reserve(kept: ExitStack, port: int) -> None:
    """Reserve a port among demos.

    Raises:
        OSError: It is another's.
    """
    name = socket.socket(socket.AF_UNIX)
    kept.callback(name.close)
    name.bind(f"\0amaze_autonomy demo port {port}")


def _try(port: int, kind: socket.SocketKind, host: str) -> None:
    with socket.socket(type=kind) as there:
        if kind is socket.SOCK_STREAM:
            there.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        there.bind((host, port))


def main() -> int:
    """Print the master's port, the first of two of the vehicle, the page's; keep them while somebody reads."""
    with ExitStack() as kept:
        try:
            ports = [
                free_ports(kept, MASTER, 1, socket.SOCK_STREAM, ""),
                free_ports(kept, MAVLINK, 2, socket.SOCK_DGRAM, "127.0.0.1"),
                free_ports(kept, WEB, 1, socket.SOCK_STREAM, ""),
            ]
        except OSError as error:
            sys.stderr.write(f"run: {error}\n")
            return 1
        sys.stdout.write(" ".join(map(str, ports)) + "\n")
        sys.stdout.flush()
        reader = select.poll()
        reader.register(sys.stdout.fileno(), 0)  # that there is none any more is told whatever one asks for
        reader.poll()
    return 0


if __name__ == "__main__":
    sys.exit(main())
