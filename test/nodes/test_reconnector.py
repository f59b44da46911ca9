"""A subscription that rospy has missed is connected; one that nobody publishes, or that is connected, is left alone."""

from __future__ import annotations

import socket
import threading
from types import SimpleNamespace
from xmlrpc.server import SimpleXMLRPCServer

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.engine.commands import Level, Notify
from amaze_autonomy.nodes.autonomy.node import AutonomyNode
from amaze_autonomy.nodes.autonomy.outbox import Timeline
from amaze_autonomy.ros import reconnector

TOPIC, KIND, MD5 = "/planner/status", "amaze_autonomy/MissionStatus", "0" * 32


class Api:
    """A node, or the master: answers every call with 1 and what it was told, and writes the call down."""

    def __init__(self, **values):
        self.calls = []
        self.server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        self.uri = f"http://127.0.0.1:{self.server.server_address[1]}/"
        for name, value in values.items():
            self.server.register_function(self._answer(name, value), name)
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()

    def _answer(self, name, value):
        def answer(*arguments):
            self.calls.append((name, *arguments))
            return [1, "", value]

        return answer

    def end(self):
        self.server.shutdown()
        self.server.server_close()


@pytest.fixture
def graph(monkeypatch):
    """Return a graph of a publisher that answers, one that is gone, the master, and this node."""
    publisher, gone, mine = Api(getPid=42), Api(), Api(publisherUpdate=0)
    gone.end()
    master = Api(registerSubscriber=[gone.uri, publisher.uri])
    monkeypatch.setattr(reconnector.rosgraph, "get_master_uri", lambda: master.uri)
    monkeypatch.setattr(reconnector.rospy, "get_name", lambda: "/me")
    monkeypatch.setattr(reconnector.rospy, "get_node_uri", lambda: mine.uri)
    yield SimpleNamespace(publisher=publisher, mine=mine, master=master)
    for api in (publisher, mine, master):
        api.end()


@pytest.fixture
def look(monkeypatch):
    """Return a look at one subscription with a number of connections."""

    def at(connections, times=1):
        subscription = SimpleNamespace(
            resolved_name=TOPIC,
            data_class=SimpleNamespace(_type=KIND, _md5sum=MD5),
            get_num_connections=lambda: connections,
            connections=[],
        )
        monkeypatch.setattr(reconnector, "subscriptions", lambda: [subscription])
        found = reconnector.Reconnector()
        for _ in range(times):
            found.look()
        return found

    return at


def test_rospy_is_told_of_the_publishers_that_answer(graph, look):
    look(connections=0)
    assert graph.master.calls == [("registerSubscriber", "/me", TOPIC, KIND, graph.mine.uri)]
    assert graph.mine.calls == [("publisherUpdate", "/me", TOPIC, [graph.publisher.uri])]


def test_what_is_connected_is_left_alone(graph, look):
    look(connections=1)
    assert graph.master.calls == graph.mine.calls == []


def test_the_lost_one_of_two_publishers_is_connected_again(graph, look, monkeypatch):
    """A cable was pulled for a moment; both nodes go on publishing, and rospy has one connection left."""
    other = Api(getPid=43)
    master = Api(registerSubscriber=[other.uri, graph.publisher.uri])
    monkeypatch.setattr(reconnector.rosgraph, "get_master_uri", lambda: master.uri)
    look(connections=1, times=reconnector._ALL_EVERY)
    other.end()
    master.end()
    assert ("publisherUpdate", "/me", TOPIC, [other.uri, graph.publisher.uri]) in graph.mine.calls


def test_nobody_is_told_when_nobody_publishes(graph, look, monkeypatch):
    master = Api(registerSubscriber=[])
    monkeypatch.setattr(reconnector.rosgraph, "get_master_uri", lambda: master.uri)
    look(connections=0)
    master.end()
    assert len(master.calls) == 1
    assert graph.mine.calls == []


def test_a_master_that_is_gone_is_no_error(graph, look):
    graph.master.end()
    look(connections=0)
    assert graph.mine.calls == []


# --- publishers of another type ---------------------------------------------------------------------------------------


class Port:
    """Where a publisher is connected to: answers each handshake with a header, and keeps what it was asked."""

    def __init__(self, **header):
        self.asked = []
        self._header = reconnector.encode_ros_handshake_header(header)
        self._sock = socket.create_server(("127.0.0.1", 0))
        self.port = self._sock.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self):
        while True:
            try:
                sock, _ = self._sock.accept()
            except OSError:
                return
            with sock:
                self.asked.append(reconnector.decode_ros_handshake_header(sock.recv(4096)))
                sock.sendall(self._header[:9])
                sock.sendall(self._header[9:])

    def end(self):
        self._sock.close()


@pytest.fixture
def publishing(graph, monkeypatch):  # noqa: ARG001 - it names this node
    """Let the publisher of the graph answer that it publishes a type; return where it is connected to."""
    ports = []

    def publish(**header):
        port = Port(callerid="/foreign", **header)
        api = Api(getPid=42, requestTopic=["TCPROS", "127.0.0.1", port.port])
        master = Api(registerSubscriber=[api.uri])
        monkeypatch.setattr(reconnector.rosgraph, "get_master_uri", lambda: master.uri)
        ports.extend([port, api, master])
        return port

    yield publish
    for each in ports:
        each.end()


def test_a_publisher_of_another_type_is_named_once_with_both_types_and_md5_sums(publishing, look, monkeypatch):
    said = []
    monkeypatch.setattr(reconnector.rospy, "logwarn", lambda _, found: said.append(str(found)))
    port = publishing(type="std_msgs/String", md5sum="1" * 32)
    found = look(connections=0, times=3)
    line = (
        f"{TOPIC}: /foreign publishes std_msgs/String (md5 {'1' * 32}), read here is {KIND} (md5 {MD5}): "
        "rename or remap one of them"
    )
    assert ([str(each) for each in found.foreign], said) == ([line], [line])
    assert len(port.asked) == 1
    assert port.asked[0]["callerid"] == "/me_asks"  # under our own name it would drop the connection that we have


@pytest.mark.parametrize("md5", [MD5, "*"])
def test_a_publisher_of_our_type_or_of_any_is_none(publishing, look, md5):
    publishing(type=KIND, md5sum=md5)
    assert look(connections=0).foreign == ()


def test_a_topic_that_is_connected_is_looked_at_now_and_then(publishing, look):
    port = publishing(type="std_msgs/String", md5sum="1" * 32)
    assert look(connections=1, times=9).foreign == ()
    assert port.asked == []
    assert len(look(connections=1, times=10).foreign) == 1


def test_the_report_of_a_flight_has_each_publisher_of_another_type_once_when_it_is_first_seen():
    foreign = reconnector.Foreign(TOPIC, "/foreign", "std_msgs/String", "1" * 32, KIND, MD5)
    seen_it, nothing = (str(foreign),), ()
    timeline, seen = Timeline(), iter([nothing, seen_it, seen_it, nothing, seen_it])
    times = iter(range(0, 5_000_000_000, 1_000_000_000))
    node = SimpleNamespace(
        _timeline=timeline,
        _clock=SimpleNamespace(now_ns=lambda: next(times)),
        _remarks=lambda: next(seen),
        _diagnostics=SimpleNamespace(publish=lambda: None),
        _requests=SimpleNamespace(keep_connected=lambda: None),
    )
    timeline.take(0, [Notify(level=Level.INFO, key="", text="hello")])
    for _ in range(5):
        AutonomyNode._housekeeping(node)
    line = (
        f"     1.000 s  NODE: {TOPIC}: /foreign publishes std_msgs/String (md5 {'1' * 32}), read here is "
        f"{KIND} (md5 {MD5}): rename or remap one of them\n"
    )
    assert timeline.text() == "     0.000 s  INFO: hello\n" + line


class Connection:
    """One of rospy's; it has a socket once a thread has made one."""

    done, socket = False, None

    def close(self):
        self.done = True


@pytest.mark.usefixtures("graph")
@pytest.mark.parametrize("connecting", [False, True], ids=["without its thread", "while its thread connects it"])
def test_a_connection_that_nobody_makes_is_closed_and_asked_for_anew(monkeypatch, connecting):
    left, read = Connection(), Connection()
    read.socket = object()
    connections = [left, read]
    subscription = SimpleNamespace(
        resolved_name=TOPIC,
        data_class=SimpleNamespace(_type=KIND, _md5sum=MD5),
        get_num_connections=lambda: len([each for each in connections if not each.done]),
        connections=connections,
    )
    monkeypatch.setattr(reconnector, "subscriptions", lambda: [subscription])
    goes_on = threading.Event()
    if connecting:
        threading.Thread(target=goes_on.wait, args=(60.0,), name=TOPIC, daemon=True).start()
    found = reconnector.Reconnector()
    found.look()
    assert not left.done, "it may just begin"
    found.look()
    goes_on.set()
    assert (left.done, read.done) == (not connecting, False)
