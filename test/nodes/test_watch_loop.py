"""The watchdog's thread notices that it did not run, wherever it was stopped."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip("rospy", reason="needs ROS")

from amaze_autonomy.nodes.watchdog.watch_loop import WatchLoop

MS = 1_000_000
PERIOD_NS = 200 * MS


class World:
    """A clock that goes on while the loop waits, and a stop of the process in one of its steps."""

    def __init__(self, stopped_in: str, at_turn: int = 5) -> None:
        self.now, self.turns, self.stopped_in, self.at_turn = 0, 0, stopped_in, at_turn
        self.excused, self.judged = [], []
        self.loop = WatchLoop(
            SimpleNamespace(started=True, restart_requests=tuple),
            self,
            SimpleNamespace(wait=self.wait, wake=lambda: None),
            (),
            SimpleNamespace(next_ns=1 << 62, turn=lambda _: self.step("answer")),
            self,
            lambda *_: None,
            lambda _: None,
            lambda stall_ns, now_ns: self.excused.append((stall_ns, now_ns)),
        )

    def step(self, name: str) -> None:
        if name == self.stopped_in and self.turns == self.at_turn:
            self.now += 2000 * MS

    # the clock
    def now_ns(self) -> int:
        return self.now

    def wall_wait_s(self, until_ns: int) -> float:
        self.step("look at the clock")
        return max(0, until_ns - self.now) * 1e-9

    # the streams
    @property
    def next_ns(self) -> int:
        return (self.now // PERIOD_NS + 1) * PERIOD_NS

    def poll(self, now_ns: int):
        self.judged.append(now_ns)
        self.step("judge")
        return None, None

    # the reader
    def wait(self, limit_s: float) -> None:
        self.turns += 1
        self.now += round(limit_s * 1e9)
        self.step("wait")
        if self.turns > 10:
            self.loop.stop()


@pytest.mark.parametrize("stopped_in", ["wait", "judge", "answer", "look at the clock"])
def test_a_stop_is_excused_before_anything_is_judged_wherever_it_came(stopped_in):
    world = World(stopped_in)
    world.loop.run()
    assert len(world.excused) == 1
    stall_ns, now_ns = world.excused[0]
    assert 2000 * MS - PERIOD_NS <= stall_ns <= 2000 * MS
    assert now_ns in world.judged
    assert not any(now_ns - 1900 * MS < judged < now_ns for judged in world.judged)


def test_a_loop_that_runs_excuses_nothing():
    world = World("")
    world.loop.run()
    assert world.excused == []
