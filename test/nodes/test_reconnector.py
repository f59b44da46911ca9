"""A subscription that rospy has missed is connected; one that nobody publishes, or that is connected, is left alone."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from xmlrpc.server import SimpleXMLRPCServer

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.nodes import reconnector

TOPIC, KIND = "/planner/status", "amaze_autonomy/MissionStatus"


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
    monkeypatch.setattr(reconnector.rospy, "get_name", lambda: "/me")
    monkeypatch.setattr(reconnector.rospy, "get_node_uri", lambda: mine.uri)
    yield SimpleNamespace(publisher=publisher, mine=mine, master=master)
    for api in (publisher, mine, master):
        api.end()


def subscriber(connections):
    return SimpleNamespace(
        resolved_name=TOPIC, data_class=SimpleNamespace(_type=KIND), get_num_connections=lambda: connections
    )


def test_rospy_is_told_of_the_publishers_that_answer(graph):
    reconnector.Reconnector([subscriber(0)], graph.master.uri).look()
    assert graph.master.calls == [("registerSubscriber", "/me", TOPIC, KIND, graph.mine.uri)]
    assert graph.mine.calls == [("publisherUpdate", "/me", TOPIC, [graph.publisher.uri])]


def test_what_is_connected_is_left_alone(graph):
    reconnector.Reconnector([subscriber(1)], graph.master.uri).look()
    assert graph.master.calls == graph.mine.calls == []


def test_nobody_is_told_when_nobody_publishes(graph):
    master = Api(registerSubscriber=[])
    reconnector.Reconnector([subscriber(0)], master.uri).look()
    master.end()
    assert len(master.calls) == 1
    assert graph.mine.calls == []


def test_a_master_that_is_gone_is_no_error(graph):
    graph.master.end()
    reconnector.Reconnector([subscriber(0)], graph.master.uri).look()
    assert graph.mine.calls == []
