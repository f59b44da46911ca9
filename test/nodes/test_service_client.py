"""Calling services over real sockets, good ones and bad ones, with a master that only looks names up."""

from __future__ import annotations

import contextlib
import fcntl
import io
import resource
import socket
import struct
import threading
import time
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest

pytest.importorskip("rosgraph")

from rosgraph.network import decode_ros_handshake_header, encode_ros_handshake_header

from amaze_autonomy import srv
from amaze_autonomy.ros.errors import BrokenCallError, CallTimeoutError, UnavailableError
from amaze_autonomy.ros.service_client import Connection, ServiceClient

NAME = "/data_recorder/start"
SOON = 0.3


class Handler(SimpleXMLRPCRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture
def master():
    """A master that knows the services in a dict; `asked` counts."""
    server = SimpleXMLRPCServer(("127.0.0.1", 0), requestHandler=Handler, logRequests=False)
    server.known, server.asked, server.services = {}, 0, []

    def look_up(_caller, name):
        server.asked += 1
        uri = server.known.get(name)
        return (1, "", uri) if uri else (-1, "no provider", "")

    server.register_function(look_up, "lookupService")
    server.uri = f"http://127.0.0.1:{server.server_address[1]}"
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
    yield server
    for service in server.services:
        service.end()
    server.shutdown()
    server.server_close()


def answer_of(response):
    body = io.BytesIO()
    response.serialize(body)
    return struct.pack("<BI", 1, len(body.getvalue())) + body.getvalue()


GOOD = answer_of(srv.StartRecordingResponse(accepted=True, message="here we go"))


class Service:
    """Answers each request with the same bytes; None: not at all. Counts connections and requests."""

    def __init__(self, master, *, answer=GOOD, header=None, die=False):
        master.services.append(self)
        self._answer, self._header, self._die = answer, header, die
        self.connections, self.requests, self.ends = [], [], []
        self.changed = threading.Condition()
        self._listener = socket.create_server(("127.0.0.1", 0))
        master.known[NAME] = f"rosrpc://127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            self.connections.append(connection)
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection):
        size = connection.recv(4)
        asked = decode_ros_handshake_header(size + connection.recv(struct.unpack("<I", size)[0]))
        md5sum = srv.StartRecording._md5sum
        good = {"callerid": "/peer", "md5sum": md5sum, "type": "x"}
        wrong = {"error": f"md5sums differ: {asked['md5sum']}"}
        connection.sendall(encode_ros_handshake_header(good if self._header is None else wrong))
        while True:
            try:
                data = connection.recv(65536)
            except OSError as error:
                self._note(type(error))
                return
            if not data:
                self._note(None)
                return
            with self.changed:
                self.requests.append(srv.StartRecordingRequest().deserialize(data[4:]))
                self.changed.notify_all()
            if self._die:
                connection.close()
                return
            if self._answer is not None:
                with contextlib.suppress(OSError):
                    connection.sendall(self._answer)

    def _note(self, end):
        with self.changed:
            self.ends.append(end)
            self.changed.notify_all()

    def end(self):
        for each in (self._listener, *self.connections):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)  # closing alone does not wake the thread that waits for it
            each.close()


@pytest.fixture
def client(master):
    made = ServiceClient(NAME, srv.StartRecording, master.uri, "/test", spare=1)
    yield made
    made.close()


def call(client, limit_s=2.0):
    data = client.serialize(srv.StartRecordingRequest(session_id="s", mission_id="1"))
    return client.call(data, time.monotonic() + limit_s)


def test_a_call_brings_the_answer(master, client):
    service = Service(master)
    assert call(client) == srv.StartRecordingResponse(accepted=True, message="here we go")
    assert service.requests == [srv.StartRecordingRequest(session_id="s", mission_id="1")]


def test_the_connection_is_used_again(master, client):
    service = Service(master)
    for _ in range(3):
        call(client)
    assert (len(service.connections), len(service.requests), master.asked) == (1, 3, 1)


def test_a_request_goes_out_at_once_on_an_open_connection(master, client):
    service = Service(master)
    client.keep(1.0)
    connection = client.send_now(client.serialize(srv.StartRecordingRequest(session_id="now")))
    assert connection is not None
    assert client.finish(connection, time.monotonic() + 2.0).accepted
    assert [request.session_id for request in service.requests] == ["now"]


def test_without_an_open_connection_nothing_goes_out_at_once(client):
    assert client.send_now(client.serialize(srv.StartRecordingRequest())) is None


def test_a_restarted_peer_is_found_again_before_anything_is_sent_to_the_old_one(master, client):
    old = Service(master)
    call(client)
    old.end()
    new = Service(master)
    assert call(client).accepted
    assert (len(old.requests), len(new.requests)) == (1, 1)


def test_keep_replaces_a_connection_that_died(master, client):
    service = Service(master)
    client.keep(1.0)
    client.keep(1.0)
    assert len(service.connections) == 1
    service.end()
    new = Service(master)
    client.keep(1.0)
    assert client.send_now(client.serialize(srv.StartRecordingRequest())) is not None
    assert len(new.connections) == 1


def test_two_requests_at_once_have_two_connections(master, client):
    service = Service(master, answer=None)
    with pytest.raises(CallTimeoutError):
        call(client, SOON)
    with pytest.raises(CallTimeoutError):
        call(client, SOON)
    assert len(service.connections) == 2, "the second request waited behind one that hangs"


def test_no_such_service(client):
    with pytest.raises(UnavailableError, match="no such service: no provider"):
        call(client)


def test_nobody_behind_the_name(master, client):
    service = Service(master)
    service.end()
    with pytest.raises(UnavailableError, match="nobody at"):
        call(client)


def test_no_master():
    lonely = ServiceClient(NAME, srv.StartRecording, "http://127.0.0.1:1", "/test")
    with pytest.raises(UnavailableError, match="the ROS master"):
        call(lonely)


def test_a_master_that_names_nonsense(master, client):
    for uri in ("nonsense", "rosrpc://here:there", "rosrpc://"):
        master.known[NAME] = uri
        with pytest.raises(UnavailableError, match="names a place that is none"):
            call(client)


def test_a_peer_that_hangs_ends_at_the_limit(master, client):
    Service(master, answer=None)
    began = time.monotonic()
    with pytest.raises(CallTimeoutError, match="did not answer within the limit"):
        call(client, SOON)
    assert SOON <= time.monotonic() - began < 5.0


@pytest.mark.parametrize("expires, end", [(True, ConnectionResetError), (False, None)])
def test_a_request_that_expires_is_discarded_with_its_connection_at_the_limit(master, client, expires, end):
    """A reset discards what the kernel has not yet delivered; an orderly end comes behind it."""
    service = Service(master, answer=None)
    with pytest.raises(CallTimeoutError):
        client.ask(SOON, expires=expires, session_id="s")
    with service.changed:
        assert service.changed.wait_for(lambda: service.ends, 5.0)
    assert service.ends == [end]


def test_a_connection_that_carried_what_expires_delivers_what_does_not(master, client):
    service = Service(master)
    client.ask(2.0, expires=True, session_id="s")
    service._answer = None
    with pytest.raises(CallTimeoutError):
        client.ask(SOON, session_id="s")
    with service.changed:
        assert service.changed.wait_for(lambda: service.ends, 5.0)
    assert (service.ends, len(service.connections)) == ([None], 1)


def test_a_late_answer_reaches_nobody(master, client):
    service = Service(master, answer=None)
    with pytest.raises(CallTimeoutError):
        call(client, SOON)
    with contextlib.suppress(OSError):  # the caller has closed it
        service.connections[0].sendall(answer_of(srv.StartRecordingResponse(message="late")))
    service._answer = GOOD
    assert call(client).message == "here we go"
    assert len(service.connections) == 2


def test_a_peer_that_dies_in_mid_call(master, client):
    service = Service(master, die=True)
    with pytest.raises(BrokenCallError, match="died in mid-call"):
        call(client)
    assert len(service.requests) == 1, "a request was sent twice"


def test_a_peer_of_another_type(master, client):
    Service(master, header="wrong")
    with pytest.raises(BrokenCallError, match="is another service: md5sums differ"):
        call(client)


NONSENSE = {
    "endless": (struct.pack("<BI", 1, 0xFFFFFFFF) + b"x", "more than any answer has"),
    "too short": (struct.pack("<BI", 1, 2) + b"\x01\x00", "answered nonsense"),
    "a text cut off": (struct.pack("<BI", 1, 9) + b"\x01" + struct.pack("<I", 100) + b"cut!", "answered nonsense"),
    "too long": (struct.pack("<BI", 1, 9) + b"\x01" + struct.pack("<I", 0) + b"more", "answered nonsense"),
    "no boolean": (struct.pack("<BI", 1, 5) + b"\x07" + struct.pack("<I", 0), "answered nonsense"),
    "a failure": (struct.pack("<BI", 0, 4) + b"oops", "failed: oops"),
}


@pytest.mark.parametrize("kind", NONSENSE)
def test_nonsense_is_named(master, client, kind):
    answer, words = NONSENSE[kind]
    Service(master, answer=answer)
    with pytest.raises(BrokenCallError, match=words):
        call(client)


def test_an_answer_that_there_is_no_memory_for_is_not_the_peers_fault(monkeypatch, client):
    def no_memory(*_):
        raise MemoryError

    monkeypatch.setattr(srv.StartRecordingResponse, "deserialize", no_memory)
    with pytest.raises(MemoryError):
        client.parse(b"\x01")


def test_an_answer_in_pieces_is_one(master, client):
    service = Service(master, answer=None)
    done = []
    worker = threading.Thread(target=lambda: done.append(call(client)), daemon=True)
    worker.start()
    with service.changed:
        assert service.changed.wait_for(lambda: service.requests, 2.0)
    for place in range(len(GOOD)):
        service.connections[0].sendall(GOOD[place : place + 1])
    worker.join(2.0)
    assert done == [srv.StartRecordingResponse(accepted=True, message="here we go")]


def test_whether_a_service_is_offered(master, client):
    assert not client.is_offered(1.0)
    Service(master)
    assert client.is_offered(1.0)


@pytest.mark.parametrize("closed", [False, True])
def test_a_connection_with_a_high_number_is_alive_until_its_peer_closes_it(closed):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 1200:
        pytest.skip(f"this process may have {hard} descriptors")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 1200), hard))
    try:
        ours, theirs = socket.socketpair()
        with ours, theirs, socket.socket(fileno=fcntl.fcntl(ours, fcntl.F_DUPFD_CLOEXEC, 1100)) as high:
            if closed:
                theirs.close()
            assert Connection(high).alive is not closed
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
