"""What rospy does wrong, and does right once it is mended. A silent connection: test/ros/launches.py."""

from __future__ import annotations

import threading

import pytest

rospy = pytest.importorskip("rospy", reason="a node is a matter of ROS")
core = pytest.importorskip("rospy.core")

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
