"""A service that does not do what a service does: it hangs, dies, answers late, or answers nonsense."""

from __future__ import annotations

import socket
import struct
import threading
from typing import Any, List

import rosgraph
from rosgraph.network import decode_ros_handshake_header, encode_ros_handshake_header


class NastyPeer:
    """Speaks the protocol of services as badly as it is told to.

    Args:
        name: resolved name of the service.
        service: its class.
        manner: one of MANNERS.
    """

    MANNERS = ("hangs", "hangs_in_handshake", "dies", "dies_in_handshake", "nonsense", "endless", "half_an_answer")

    def __init__(self, name: str, service: Any, manner: str) -> None:
        self._name, self._service, self._manner = name, service, manner
        self._open: List[socket.socket] = []
        self._ended = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._uri = f"rosrpc://127.0.0.1:{self._listener.getsockname()[1]}"
        self._master = rosgraph.Master("/nasty_peer")
        self._master.registerService(name, self._uri, "http://127.0.0.1:1/")
        threading.Thread(target=self._accept, daemon=True).start()

    def end(self) -> None:
        """Unregister and close everything."""
        self._ended.set()
        self._master.unregisterService(self._name, self._uri)
        self._listener.shutdown(socket.SHUT_RDWR)  # closing alone does not wake the thread that accepts
        self._listener.close()
        for connection in self._open:
            connection.close()

    def _accept(self) -> None:
        while not self._ended.is_set():
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            self._open.append(connection)
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        if self._manner == "hangs_in_handshake":
            return
        size = connection.recv(4)
        decode_ros_handshake_header(size + connection.recv(struct.unpack("<I", size)[0]))
        if self._manner == "dies_in_handshake":
            connection.close()
            return
        header = {"callerid": "/nasty_peer", "md5sum": self._service._md5sum, "type": self._service._type}
        connection.sendall(encode_ros_handshake_header(header))
        connection.recv(65536)
        answers = {
            "nonsense": struct.pack("<BI", 1, 5) + b"\xff\xff\xff\xff\x7f",
            "endless": struct.pack("<BI", 1, 0xFFFFFFFF) + b"x" * 1000,
            "half_an_answer": struct.pack("<BI", 1, 500) + b"x" * 20,
        }
        if self._manner == "dies":
            connection.close()
        elif self._manner in answers:
            connection.sendall(answers[self._manner])
