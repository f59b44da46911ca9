"""What rospy does wrong, and does right once it is mended. A silent connection: test/ros/launches.py."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

rospy = pytest.importorskip("rospy", reason="a node is a matter of ROS")
core = pytest.importorskip("rospy.core")

rosout = pytest.importorskip("rospy.impl.rosout")

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
