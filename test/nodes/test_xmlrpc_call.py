"""One call within a limit for all of it, whatever the peer does."""

from __future__ import annotations

import socket
import threading
import time
import xmlrpc.client
from contextlib import suppress

import pytest

pytest.importorskip("rosgraph")

from amaze_autonomy.ros.errors import BrokenCallError, CallTimeoutError, UnavailableError
from amaze_autonomy.ros.liveness import call

LIMIT_S = 0.3


def answer(value):
    body = xmlrpc.client.dumps((value,), methodresponse=True).encode()
    return b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n" % len(body) + body


@pytest.fixture
def peer():
    """Start a peer that does something with its first connection; return its address."""
    server = socket.create_server(("127.0.0.1", 0))
    opened = []

    def serve(act):
        def run():
            sock, _ = server.accept()
            opened.append(sock)
            sock.recv(65536)
            act(sock)

        threading.Thread(target=run, daemon=True).start()
        return f"http://127.0.0.1:{server.getsockname()[1]}/"

    yield serve
    for sock in (*opened, server):
        sock.close()


def test_the_value_of_a_good_answer(peer):
    assert call(peer(lambda sock: sock.sendall(answer([1, "", 42]))), "getPid", ("/me",), 5.0) == 42


def test_a_failure_is_its_message(peer):
    with pytest.raises(BrokenCallError, match="unknown node"):
        call(peer(lambda sock: sock.sendall(answer([-1, "unknown node", ""]))), "lookupNode", ("/me",), 5.0)


def test_nobody_there():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(UnavailableError):
        call(f"http://127.0.0.1:{port}/", "getPid", ("/me",), 5.0)


def dribble(sock):
    try:
        for byte in b"HTTP/1.1 200 OK\r\n" + b"X: y\r\n" * 1000:
            sock.sendall(bytes([byte]))
            time.sleep(0.02)
    except OSError:
        pass


@pytest.mark.parametrize("act", [lambda _: None, dribble])
def test_silence_and_dribbling_end_at_the_limit(peer, act):
    began_s = time.monotonic()
    with pytest.raises(CallTimeoutError):
        call(peer(act), "getPid", ("/me",), LIMIT_S)
    assert time.monotonic() - began_s < 5.0


@pytest.mark.parametrize("said", [b"", b"SSH-2.0-OpenSSH\r\n", b"HTTP/1.1 200 OK\r\n\r\n<xml>", answer("no triple")])
def test_nonsense_is_broken(peer, said):
    def act(sock):
        with suppress(OSError):  # the caller may have gone already
            sock.sendall(said)
            sock.shutdown(socket.SHUT_RDWR)

    with pytest.raises(BrokenCallError):
        call(peer(act), "getPid", ("/me",), 5.0)
