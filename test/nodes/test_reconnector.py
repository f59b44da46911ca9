"""A subscription that rospy has missed is connected; one that nobody publishes, or that is connected, is left alone."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from xmlrpc.server import SimpleXMLRPCServer

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.ros import reconnector

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
    monkeypatch.setattr(reconnector.rosgraph, "get_master_uri", lambda: master.uri)
    monkeypatch.setattr(reconnector.rospy, "get_name", lambda: "/me")
    monkeypatch.setattr(reconnector.rospy, "get_node_uri", lambda: mine.uri)
    yield SimpleNamespace(publisher=publisher, mine=mine, master=master)
    for api in (publisher, mine, master):
        api.end()


@pytest.fixture
def look(monkeypatch):
    """Return a look at one subscription with a number of connections."""

    def at(connections):
        subscription = SimpleNamespace(
            resolved_name=TOPIC, data_class=SimpleNamespace(_type=KIND), get_num_connections=lambda: connections
        )
        monkeypatch.setattr(reconnector, "subscriptions", lambda: [subscription])
        reconnector.Reconnector().look()

    return at


def test_rospy_is_told_of_the_publishers_that_answer(graph, look):
    look(connections=0)
    assert graph.master.calls == [("registerSubscriber", "/me", TOPIC, KIND, graph.mine.uri)]
    assert graph.mine.calls == [("publisherUpdate", "/me", TOPIC, [graph.publisher.uri])]


def test_what_is_connected_is_left_alone(graph, look):
    look(connections=1)
    assert graph.master.calls == graph.mine.calls == []


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
