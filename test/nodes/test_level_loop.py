"""The loop of the autopilot node and the planner: it tells at its rate, at once when something changes, and ends."""

from __future__ import annotations

import threading
from queue import SimpleQueue

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.nodes.vehicle.vehicle_link import LevelLoop
from amaze_autonomy.ros.clock import MonotonicClock

LIMIT_S = 30.0  # of what comes at once; for a machine under load
LONG_NS = 3_600_000_000_000


class Observed:
    """A link that has nothing but an observer."""

    def observe(self, key, on_change):
        self.key, self.change = key, on_change


@pytest.fixture
def make_loop():
    """Return a function that runs a loop on a thread; return loop, link, what is told, thread."""
    begun = []

    def make(period_ns):
        link, told = Observed(), SimpleQueue()
        loop = LevelLoop(link, MonotonicClock(), period_ns, lambda t_ns: t_ns, told.put)
        thread = threading.Thread(target=loop.run, daemon=True)
        thread.start()
        begun.append((loop, thread))
        return loop, link, told, thread

    yield make
    for loop, thread in begun:
        loop.end()
        thread.join(LIMIT_S)


def test_the_first_is_told_at_once_and_then_each_change(make_loop):
    _, link, told, _ = make_loop(LONG_NS)
    told.get(timeout=LIMIT_S)
    for _ in range(3):
        link.change()
        told.get(timeout=LIMIT_S)
    assert told.empty()


def test_without_a_change_it_is_told_at_its_rate(make_loop):
    period_ns = 20_000_000
    _, _, told, _ = make_loop(period_ns)
    first_ns, _, third_ns = (told.get(timeout=LIMIT_S) for _ in range(3))
    assert third_ns - first_ns >= 2 * period_ns


def test_changes_that_come_while_it_tells_are_told_as_one():
    link, told, go_on = Observed(), SimpleQueue(), threading.Event()

    def tell(t_ns):
        told.put(t_ns)
        assert go_on.wait(LIMIT_S)

    loop = LevelLoop(link, MonotonicClock(), LONG_NS, lambda t_ns: t_ns, tell)
    thread = threading.Thread(target=loop.run, daemon=True)
    thread.start()
    told.get(timeout=LIMIT_S)
    for _ in range(1000):
        link.change()
    go_on.set()
    told.get(timeout=LIMIT_S)
    loop.end()
    thread.join(LIMIT_S)
    assert told.qsize() <= 1, "the end may be told"


def test_it_ends_at_once(make_loop):
    loop, _, told, thread = make_loop(LONG_NS)
    told.get(timeout=LIMIT_S)
    loop.end()
    thread.join(LIMIT_S)
    assert not thread.is_alive()
