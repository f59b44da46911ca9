"""What rospy does wrong, and does right once it is mended. A silent connection: test/ros/launches.py."""

from __future__ import annotations

import contextlib
import socket
import threading
from types import SimpleNamespace

import pytest

rospy = pytest.importorskip("rospy", reason="a node is a matter of ROS")
core = pytest.importorskip("rospy.core")

rosout = pytest.importorskip("rospy.impl.rosout")

from rospy.impl.registration import RegManager  # noqa: E402
from rospy.impl.tcpros_base import TCPServer  # noqa: E402

from amaze_autonomy.ros import rospy_flaws  # noqa: E402
from amaze_autonomy.ros.rospy_flaws import mend_rospy  # noqa: E402


class ShutDownMeanwhile:
    """rospy's lock, which a shutdown has held; when it is given back, the flag stands and all hooks were called."""

    def __init__(self, monkeypatch):
        self._lock, self._monkeypatch = threading.RLock(), monkeypatch

    def __enter__(self):
        self._monkeypatch.setattr(core, "_shutdown_flag", True)
        return self._lock.__enter__()

    def __exit__(self, *error):
        return self._lock.__exit__(*error)


@pytest.fixture(autouse=True)
def mended(monkeypatch):
    mend_rospy()
    for name in ("_shutdown_flag", "_in_shutdown"):
        monkeypatch.setattr(core, name, False)
    for name in ("_client_shutdown_hooks", "_preshutdown_hooks", "_shutdown_hooks"):
        monkeypatch.setattr(core, name, [])


ADD = {
    "client": lambda hook: rospy.on_shutdown(lambda: hook("")),
    "before": core.add_preshutdown_hook,
    "after": core.add_shutdown_hook,
}


@pytest.mark.parametrize("kind", ADD)
def test_a_hook_that_comes_while_the_others_are_called_is_called(kind, monkeypatch):
    """Else a node that the master ends while it starts runs on for ever, and nobody can reach it."""
    monkeypatch.setattr(core, "_shutdown_lock", ShutDownMeanwhile(monkeypatch))
    called = []
    ADD[kind](called.append)
    assert len(called) == 1


@pytest.mark.parametrize("kind", ADD)
def test_a_hook_is_called_once_and_not_before_the_end(kind):
    called = []
    ADD[kind](called.append)
    assert called == []
    core.signal_shutdown("a test")
    assert len(called) == 1


@pytest.mark.parametrize("kind", ADD)
def test_a_hook_that_comes_after_the_end_is_called(kind, monkeypatch):
    monkeypatch.setattr(core, "_shutdown_flag", True)
    called = []
    ADD[kind](called.append)
    assert len(called) == 1


def test_who_logs_asks_the_master_once(monkeypatch):
    asked = []
    monkeypatch.setattr(rospy_flaws, "_ask", lambda name, default: asked.append(name) or default)
    monkeypatch.setattr(rospy_flaws, "_answers", {})
    said = []
    monkeypatch.setattr(rosout, "_rosout_pub", SimpleNamespace(publish=said.append))
    monkeypatch.setattr(rosout.Time, "now", lambda: rospy.Time())
    rospy_flaws.ask_master()
    for word in ("one", "two"):
        rosout._rosout(20, word, "file.py", 1, "function")
    assert [message.msg for message in said] == ["one", "two"]
    assert asked == ["/rosout_disable_topics_generation"]


LIMIT_S = 30.0


@pytest.fixture
def served():
    """Return a server of rospy's, and what it has served."""
    heard = SimpleNamespace(fails=[], served=threading.Semaphore(0))

    def serve(sock, _address):
        sock.close()
        if heard.fails:
            raise heard.fails.pop()
        heard.served.release()

    server = TCPServer(serve)
    server.start()
    yield server, heard
    server.shutdown()


def is_served(server, heard):
    with socket.create_connection(("127.0.0.1", server.port), timeout=LIMIT_S):
        return heard.served.acquire(timeout=LIMIT_S)


@pytest.mark.live
@pytest.mark.parametrize("error", [RuntimeError("can't start new thread"), MemoryError(), OSError(24, "no more")])
def test_a_connection_that_cannot_be_served_is_not_the_last_one(served, error):
    server, heard = served
    heard.fails.append(error)
    with socket.create_connection(("127.0.0.1", server.port), timeout=LIMIT_S):
        assert is_served(server, heard)


@pytest.mark.live
def test_a_descriptor_that_cannot_be_had_once_does_not_close_a_node_to_all(served):
    server, heard = served
    assert is_served(server, heard)

    class Short:
        """The socket, of which a descriptor cannot be had twice."""

        def __init__(self, real):
            self.real, self.left = real, 2

        def accept(self):
            if self.left:
                self.left -= 1
                raise OSError(24, "Too many open files")
            return self.real.accept()

        def close(self):
            self.real.close()

    server.server_sock = Short(server.server_sock)
    assert all(is_served(server, heard) for _ in range(2))


@pytest.mark.live
def test_of_too_many_that_say_nothing_the_oldest_is_closed(monkeypatch):
    def read(_server, sock, _address):
        with contextlib.suppress(OSError):  # the test may be over by then
            sock.recv(1)

    monkeypatch.setattr(rospy_flaws, "_MOST_SILENT", 2)
    monkeypatch.setattr(rospy_flaws, "_read", read)
    with contextlib.ExitStack() as opened:
        pairs = [socket.socketpair() for _ in range(3)]
        for ours, theirs in pairs:
            opened.enter_context(ours)
            opened.enter_context(theirs)
            theirs.settimeout(LIMIT_S)
            rospy_flaws._accept(None, ours, "somebody")
        assert pairs[0][1].recv(1) == b"", "the oldest is closed"
        for ours, theirs in pairs[1:]:
            assert id(ours) in rospy_flaws._silent
            theirs.send(b"x")


@pytest.mark.parametrize("error", [RuntimeError("can't start new thread"), MemoryError()])
def test_who_can_have_no_thread_is_forgotten(monkeypatch, error):
    def start(_thread):
        raise error

    monkeypatch.setattr(threading.Thread, "start", start)
    with socket.socket() as sock:
        with pytest.raises(type(error)):
            rospy_flaws._accept(None, sock, "somebody")
        assert id(sock) not in rospy_flaws._silent


def test_a_publisher_that_cannot_be_connected_is_not_the_last_one(monkeypatch):
    """Without a thread, once, whoever publishes later was never heard: a driver that was started again, a planner."""
    manager, shortages = SimpleNamespace(handler=SimpleNamespace(done=False)), [RuntimeError("can't start new thread")]

    def connect(_manager):
        if shortages:
            raise shortages.pop()
        manager.handler.done = True

    monkeypatch.setattr(rospy_flaws, "_connect_publishers", connect)
    RegManager.run(manager)
    assert (manager.handler.done, shortages) == (True, [])
