"""The one thread that decides: requests first, time from events, and a landing when it cannot decide."""

from __future__ import annotations

import time
from queue import SimpleQueue

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.engine.commands import (
    Answer,
    AnswerKind,
    AutopilotLand,
    Level,
    MissionAction,
    MissionCommand,
    Notify,
)
from amaze_autonomy.engine.events import EngineStarted, Tick, UserCommand, UserRequest
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, Flight, Session, evolve
from amaze_autonomy.nodes.autonomy.engine_thread import EngineThread, Inbox
from amaze_autonomy.ros.clock import MonotonicClock

LAND = MissionCommand(id=1, limit_ns=1, session_id="s", action=MissionAction.LAND)
ANSWER = Answer(request_id=7, answer=AnswerKind.DONE)
NOTE = Notify(level=Level.INFO, key="x", text="x")


class Run:
    """An engine thread around a decide of the test; everything that it does is in `done`, in order."""

    def __init__(self, decide, next_deadline=lambda _state, _rules: None, state=None):
        self.done = SimpleQueue()
        clock = MonotonicClock()
        self.inbox = Inbox(clock)
        self.thread = EngineThread(
            decide,
            next_deadline,
            Rules(),
            clock,
            self.inbox,
            lambda request: self.done.put(("send", request)),
            lambda answer: self.done.put(("answer", answer)),
            lambda event, state, commands: self.done.put(("record", event, state, commands)),
            state,
        )

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.thread.stop()

    def next(self):
        return self.done.get(timeout=2.0)


def started(t_ns=5):
    return EngineStarted(t_ns=t_ns)


def test_requests_go_out_before_answers_and_both_before_the_record():
    def decide(state, event, _rules):
        return evolve(state, t_ns=event.t_ns), (NOTE, ANSWER, LAND)

    with Run(decide) as run:
        run.inbox.put(started())
        assert run.next() == ("send", LAND)
        assert run.next() == ("answer", ANSWER)
        assert run.next() == ("record", started(), EngineState(t_ns=5), (NOTE, ANSWER, LAND))


def test_events_are_decided_in_the_order_of_their_arrival():
    def decide(state, event, _rules):
        return evolve(state, t_ns=event.t_ns), ()

    with Run(decide) as run:
        for t_ns in (5, 6, 7):
            run.inbox.put(started(t_ns))
        assert [run.next()[1].t_ns for _ in range(3)] == [5, 6, 7]


def test_an_event_that_was_stamped_before_the_last_one_counts_as_happening_with_it():
    def decide(state, event, _rules):
        return evolve(state, t_ns=event.t_ns), ()

    with Run(decide) as run:
        run.inbox.put(started(9))
        run.inbox.put(started(3))
        assert [run.next()[1].t_ns for _ in range(2)] == [9, 9]


def test_it_ticks_at_the_deadline_and_not_before():
    clock = MonotonicClock()
    deadline_ns = clock.now_ns() + 100_000_000

    def next_deadline(state, _rules):
        return deadline_ns if state.t_ns < deadline_ns else None

    with Run(lambda state, event, _: (evolve(state, t_ns=event.t_ns), ()), next_deadline) as run:
        _, event, _, _ = run.next()
        assert isinstance(event, Tick)
        assert deadline_ns <= event.t_ns <= deadline_ns + 50_000_000
        assert run.done.empty(), "it ticked again without a deadline"


def test_what_has_come_is_decided_about_before_a_deadline_that_has_passed():
    """On waking late, a tick before the reading would call lost whatever was said meanwhile."""
    inbox = Inbox(MonotonicClock())
    inbox.put(started(7))
    seen = []

    def decide(state, event, _rules):
        seen.append(type(event))
        return evolve(state, t_ns=event.t_ns), ()

    def overdue(_state, _rules):
        return 1 if len(seen) < 2 else None

    engine = EngineThread(decide, overdue, Rules(), MonotonicClock(), inbox, print, print, lambda *_: None)
    engine.start()
    while len(seen) < 2:
        time.sleep(0.001)
    engine.stop()
    assert seen == [EngineStarted, Tick]


def test_what_is_in_the_queue_is_decided_before_it_ends():
    seen = []

    def decide(state, event, _rules):
        seen.append(event.t_ns)
        return state, ()

    with Run(decide) as run:
        for t_ns in range(50):
            run.inbox.put(started(t_ns))
    assert seen == list(range(50))


def test_a_defect_of_the_reading_ends_as_silence_and_not_as_the_end_of_deciding():
    class Broken(Inbox):
        def wait(self, _limit_s):
            raise OSError("a defect")

    seen = []

    def decide(state, event, _rules):
        seen.append(type(event))
        return evolve(state, t_ns=event.t_ns), ()

    clock = MonotonicClock()
    engine = EngineThread(
        decide, lambda *_: None if seen else 1, Rules(), clock, Broken(clock), print, print, lambda *_: None
    )
    engine.start()
    while not seen:
        time.sleep(0.001)
    engine.stop()
    assert seen == [Tick]


def failing(_state, event, _rules):
    raise RuntimeError(f"a defect: {type(event).__name__}")


def test_a_defect_on_the_ground_changes_nothing_and_is_said(caplog):
    def decide(state, event, rules):
        return failing(state, event, rules) if event.t_ns == 1 else (evolve(state, t_ns=event.t_ns), ())

    with Run(decide) as run:
        run.inbox.put(started(1))
        run.inbox.put(started(2))
        assert run.next()[1] == started(2)
    assert "the engine could not decide about EngineStarted" in caplog.text


def test_a_defect_in_flight_is_a_wish_to_land():
    def decide(state, event, rules):
        if isinstance(event, UserRequest):
            return evolve(state, t_ns=event.t_ns), (LAND,)
        return failing(state, event, rules)

    with Run(decide, state=EngineState(flight=Flight(active=True), t_ns=1)) as run:
        run.inbox.put(started(2))
        assert run.next() == ("send", LAND)
        assert run.next()[1] == UserRequest(t_ns=1, command=UserCommand.LAND)


def test_an_engine_that_cannot_even_decide_to_land_is_landed_by_both_routes():
    with Run(failing, state=EngineState(flight=Flight(active=True), session=Session(id="s"), t_ns=1)) as run:
        run.inbox.put(started(2))
        limit_ns = Rules().limits.command_reply_limit_ns
        assert run.next() == (
            "send",
            MissionCommand(id=0, limit_ns=limit_ns, session_id="s", action=MissionAction.LAND),
        )
        assert run.next() == ("send", AutopilotLand(id=0, limit_ns=limit_ns))
