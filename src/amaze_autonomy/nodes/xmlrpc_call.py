"""One XML-RPC call within a time limit for all of it: connecting, asking, every byte of the answer.

`xmlrpc.client` limits each read only, so that a peer that dribbles keeps its caller for ever.
"""

from __future__ import annotations

import socket
import time
import xmlrpc.client
from typing import Any, Tuple
from urllib.parse import urlparse

from .errors import BrokenCallError, CallTimeoutError, UnavailableError

__all__ = ["call"]

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
        ((code, message, value),), _ = xmlrpc.client.loads(answer)
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
