"""Connection URLs as MAVLink people write them.

serial:/dev/ttyACM0:921600   a serial device and its baud rate
udpin:127.0.0.1:14540        wait there for the vehicle, answer where it speaks from (udp: means the same)
udpout:192.168.1.2:14550     speak there first
tcp:127.0.0.1:5760           connect there
tcpin:127.0.0.1:5760         wait there for one peer
"""

from __future__ import annotations

import enum
import re
from typing import Mapping, NamedTuple

from .errors import EndpointError

__all__ = ["Endpoint", "EndpointKind", "parse_endpoint"]

_DEFAULT_BAUD = 57600
_LAST_PORT = 65535
_FORMS = "serial:DEVICE:BAUD, udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or tcpin:HOST:PORT"


class EndpointKind(enum.Enum):
    """How bytes reach the peer."""

    SERIAL = "serial"
    UDP_IN = "udpin"
    UDP_OUT = "udpout"
    TCP = "tcp"
    TCP_IN = "tcpin"


_KINDS: Mapping[str, EndpointKind] = {**{kind.value: kind for kind in EndpointKind}, "udp": EndpointKind.UDP_IN}


class Endpoint(NamedTuple):
    """Where the other end of a link is.

    Args:
        kind: how bytes reach it.
        address: host or device.
        number: port or baud rate.
    """

    kind: EndpointKind
    address: str
    number: int

    def __str__(self) -> str:
        return f"{self.kind.value}:{self.address}:{self.number}"


def parse_endpoint(url: str) -> Endpoint:
    """Return what a connection URL names.

    Raises:
        EndpointError: It is none.
    """
    found = re.fullmatch(r"([a-z]+):(?://)?(.+)", url.strip())
    if found is None or found.group(1) not in _KINDS:
        raise EndpointError(repr(url), "is no connection URL", f"must be {_FORMS}")
    kind, rest = _KINDS[found.group(1)], found.group(2)
    if kind is EndpointKind.SERIAL:
        return _serial(url, rest)
    address, colon, number = rest.rpartition(":")
    if not colon or not address or not number.isdecimal() or not 0 < int(number) <= _LAST_PORT:
        raise EndpointError(repr(url), "names no host and port", f"must be {kind.value}:HOST:PORT, PORT 1 to 65535")
    return Endpoint(kind, address.strip("[]"), int(number))


def _serial(url: str, rest: str) -> Endpoint:
    device, _, number = rest.partition(":")
    if not number:
        return Endpoint(EndpointKind.SERIAL, device, _DEFAULT_BAUD)
    if not device.startswith("/") or not number.isdecimal() or not int(number):
        raise EndpointError(repr(url), "names no device and baud rate", "must be serial:/dev/ttyACM0:921600 or alike")
    return Endpoint(EndpointKind.SERIAL, device, int(number))
