"""The one thread that decides: requests first, time from events, and a landing when it cannot decide."""

from __future__ import annotations

import threading
from dataclasses import replace
from queue import SimpleQueue

import pytest
from waiting import wait_for

pytest.importorskip("rospy")

from amaze_autonomy.engine.commands import (
    Answer,
    AnswerKind,
    AutopilotLand,
    Level,
    MissionAction,
    MissionCommand,
    Notify,
    Request,
    RunCheck,
)
from amaze_autonomy.engine.events import (
    CheckName,
    CheckReply,
    EngineStarted,
    Event,
    Outcome,
    Reply,
    Tick,
    UserCommand,
    UserRequest,
)
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import Agreement, EngineState, Flight, Session, State, Vehicle, evolve
from amaze_autonomy.nodes.autonomy.engine_thread import EngineThread, Inbox
from amaze_autonomy.ros.clock import MonotonicClock

LAND = MissionCommand(id=1, limit_ns=1, session_id="s", action=MissionAction.LAND)
ANSWER = Answer(request_id=7, answer=AnswerKind.DONE)
NOTE = Notify(level=Level.INFO, key="x", text="x")


class Run:
    """An engine thread around a decide of the test; everything that it does is in `done`, in order.

    What `fails` names raises the error that stands there: "send" and "answer" by a command, "record" by an event.
    """

    def __init__(self, decide, next_deadline=lambda _state, _rules: None, state=None, fails=None):
        self.done, self.fails = SimpleQueue(), fails or {}
        clock = MonotonicClock()
        self.inbox = Inbox(clock)
        self.thread = EngineThread(
            decide,
            next_deadline,
            Rules(),
            clock,
            self.inbox,
            lambda request: self._do("send", request),
            lambda answer: self._do("answer", answer),
            lambda event, state, commands: self._do("record", event, state, commands),
            state,
            lambda: self._do("keep", ""),
        )

    def _do(self, what, *values):
        self.done.put((what, *values))
        error = self.fails.get((what, values[0]))
        if error is not None:
            raise error

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.thread.stop()

    def next(self):
        return self.done.get(timeout=2.0)


def started(t_ns=5):
    return EngineStarted(t_ns=t_ns)


S = 1_000_000_000


def test_requests_go_out_before_answers_and_both_before_the_record():
    def decide(state, event, _rules):
        return evolve(state, t_ns=event.t_ns), (NOTE, ANSWER, LAND)

    with Run(decide) as run:
        run.inbox.put(started())
        assert run.next() == ("send", LAND)
        assert run.next() == ("answer", ANSWER)
        assert run.next() == ("record", started(), EngineState(t_ns=5), (NOTE, ANSWER, LAND))


@pytest.mark.parametrize("action", [MissionAction.TAKEOFF, MissionAction.HOLD, MissionAction.RESUME])
def test_what_changes_the_flight_mode_goes_out_after_it_was_written(action):
    """Killed in between, an engine that is started again would take its own vehicle for somebody else's."""
    moves = replace(LAND, action=action)

    def decide(state, event, _rules):
        return evolve(state, t_ns=event.t_ns), (NOTE, moves)

    with Run(decide) as run:
        run.inbox.put(started())
        assert [run.next()[0] for _ in range(3)] == ["record", "keep", "send"]
    with Run(decide, fails={("record", started()): OSError("x"), ("keep", ""): OSError("x")}) as run:
        run.inbox.put(started())
        assert [run.next()[0] for _ in range(3)] == ["record", "keep", "send"], "whatever becomes of that"


@pytest.mark.parametrize("action", [MissionAction.LAND, MissionAction.ABORT])
def test_a_landing_waits_for_nothing_to_be_written(action):
    def decide(state, event, _rules):
        return evolve(state, t_ns=event.t_ns), (replace(LAND, action=action), replace(LAND, action=MissionAction.LAND))

    with Run(decide) as run:
        run.inbox.put(started())
        assert [run.next()[0] for _ in range(3)] == ["send", "send", "record"]


def test_nor_does_a_hold_that_is_landed_at_once():
    hold = replace(LAND, action=MissionAction.HOLD)

    def decide(state, event, _rules):
        return evolve(state, t_ns=event.t_ns), (LAND, hold)

    with Run(decide) as run:
        run.inbox.put(started())
        assert [run.next()[0] for _ in range(3)] == ["send", "send", "record"]


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
        assert deadline_ns <= event.t_ns  # how late is a matter of the computer; `next` waits for 2 s
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
    wait_for(lambda: len(seen) >= 2)
    engine.stop()
    assert seen == [EngineStarted, Tick]


@pytest.mark.parametrize("stopped_at", range(6))
def test_a_stop_between_reading_and_tick_makes_no_tick_of_what_had_come_meanwhile(stopped_at):
    """The process may be stopped whenever it looks at its clock: a status that came then is decided about before."""
    clock, inbox = HandClock(), StatusInbox()
    engine = EngineThread(heard, silent_after_a_second, Rules(), clock, inbox, print, print, lambda *_: None)
    clock.stops_at, inbox.clock = stopped_at, clock
    for _ in range(4):
        engine._turn(0.0)
        engine._tick()
    assert engine.state.decisions == 0, "a peer that spoke all the time was called silent"
    clock.ns += 2 * S
    inbox.speaks = False
    engine._tick()
    assert engine.state.decisions == 1


def heard(state, event, _rules):
    """An engine with one peer: a status is an EngineStarted, a tick a second later says that it is silent."""
    if isinstance(event, EngineStarted):
        return evolve(state, t_ns=event.t_ns, started_ns=event.t_ns), ()
    silent = state.started_ns is not None and event.t_ns - state.started_ns >= S
    return evolve(state, t_ns=event.t_ns, decisions=state.decisions + silent), ()


def silent_after_a_second(state, _rules):
    return None if state.started_ns is None else state.started_ns + S


class HandClock(MonotonicClock):
    """Time passes when a test says so: two seconds of it before the look of a number."""

    def __init__(self):
        self.ns, self.looks, self.stops_at = 100 * S, 0, -1

    def now_ns(self):
        self._look()
        return self.ns

    def wall_wait_s(self, until_ns):
        self._look()
        return max(0.0, (until_ns - self.ns) / S)

    def _look(self):
        self.looks += 1
        if self.looks == self.stops_at + 1:
            self.ns += 2 * S


class StatusInbox:
    """A peer that speaks ten times a second, also while the process is stopped: what comes is of when it came."""

    speaks, clock = True, None

    def wait(self, _limit_s):
        return [EngineStarted(t_ns=self.clock.ns)] if self.speaks else []


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
    wait_for(lambda: seen)
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
    assert run.done.empty()


def test_landings_beside_an_engine_that_cannot_decide_go_out_no_more_often_than_landings_do():
    """Each status that it cannot decide about would ask for two more, until no thread is left to wait for answers."""
    with Run(failing, state=EngineState(flight=Flight(active=True), session=Session(id="s"), t_ns=1)) as run:
        for t_ns in range(2, 60):
            run.inbox.put(started(t_ns))
        assert [type(run.next()[1]) for _ in range(2)] == [MissionCommand, AutopilotLand]
    assert run.done.empty()


@pytest.mark.parametrize(
    "state",
    [
        EngineState(flight=Flight(active=True), state=State.PILOT, t_ns=1),
        EngineState(flight=Flight(active=True), vehicle=Vehicle(takeover=Agreement(1, 1)), t_ns=1),
    ],
    ids=["PILOT", "suspected"],
)
def test_an_engine_that_cannot_decide_takes_nothing_from_a_pilot(state):
    with Run(failing, state=state) as run:
        for t_ns in (2, 3, 4):
            run.inbox.put(started(t_ns))
    assert run.done.empty()


# --- a part of a decision that fails ----------------------------------------------------------------------------------

SECOND = AutopilotLand(id=2, limit_ns=1)
CHECK = RunCheck(id=3, limit_ns=1, check=CheckName.BATTERY)
NO_THREAD = "can't start new thread"
ERRORS = [RuntimeError(NO_THREAD), MemoryError(NO_THREAD), OSError(NO_THREAD)]


def decides(*commands):
    """Return a decide that does this about the start, and takes what else comes."""

    def decide(state, event, _rules):
        return evolve(state, t_ns=event.t_ns), commands if isinstance(event, EngineStarted) else ()

    return decide


def told(run, kind):
    """Return the event of a kind that the engine decides about next."""
    while True:
        what, event, *_ = run.next()
        if what == "record" and isinstance(event, kind):
            return event


@pytest.mark.parametrize("error", ERRORS, ids=repr)
def test_a_landing_that_cannot_be_sent_leaves_the_other_route_and_comes_back_as_a_failure(error, caplog):
    with Run(decides(LAND, SECOND, ANSWER), fails={("send", LAND): error}) as run:
        run.inbox.put(started())
        assert [run.next()[:2] for _ in range(4)] == [
            ("send", LAND),
            ("send", SECOND),
            ("answer", ANSWER),
            ("record", started()),
        ]
        reply = told(run, Reply)
    assert (reply.command_id, reply.outcome) == (LAND.id, Outcome.BROKEN)
    assert reply.message == f"mission_planner/command: {type(error).__name__}: {NO_THREAD}"
    assert caplog.text.count("the engine could not send MissionCommand") == 1
    assert NO_THREAD in caplog.text


def test_a_check_that_cannot_be_asked_comes_back_as_a_failed_check():
    with Run(decides(CHECK), fails={("send", CHECK): ERRORS[0]}) as run:
        run.inbox.put(started())
        reply = told(run, CheckReply)
    assert (reply.command_id, reply.check, reply.outcome) == (CHECK.id, CheckName.BATTERY, Outcome.BROKEN)
    assert reply.message == f"autopilot/check_battery: RuntimeError: {NO_THREAD}"


@pytest.mark.parametrize("error", ERRORS, ids=repr)
@pytest.mark.parametrize("what", ["answer", "record"])
def test_an_answer_or_a_record_that_fails_keeps_nothing_else_from_being_done(what, error, caplog):
    fails = {(what, ANSWER if what == "answer" else started()): error}
    with Run(decides(LAND, ANSWER), fails=fails) as run:
        run.inbox.put(started())
        run.inbox.put(Tick(t_ns=6))
        done = [run.next()[:2] for _ in range(4)]
    assert done == [("send", LAND), ("answer", ANSWER), ("record", started()), ("record", Tick(t_ns=6))]
    assert caplog.text.count(f"the engine could not {what}") == 1


def test_what_fails_again_for_the_same_reason_is_said_once(caplog):
    with Run(decides(LAND, SECOND), fails={("send", LAND): ERRORS[0], ("send", SECOND): ERRORS[0]}) as run:
        for t_ns in (5, 6, 7):
            run.inbox.put(started(t_ns))
        told(run, Reply)
    assert caplog.text.count("the engine could not send") == 2, "once for each route"


def test_a_failure_that_cannot_even_be_said_keeps_nothing_from_being_done(monkeypatch, capfd):
    def no_memory(*_, **__):
        raise MemoryError

    monkeypatch.setattr("amaze_autonomy.nodes.autonomy.engine_thread._log.exception", no_memory)
    with Run(decides(LAND, SECOND), fails={("send", LAND): MemoryError()}) as run:
        run.inbox.put(started())
        assert [run.next()[:2] for _ in range(2)] == [("send", LAND), ("send", SECOND)]
        assert told(run, Reply).message == "mission_planner/command: MemoryError: "
    assert capfd.readouterr().err == "amaze_autonomy: an error could not be logged: memory is too short\n"


@pytest.mark.parametrize("error", ERRORS, ids=repr)
def test_without_knowing_what_is_due_next_it_lands_and_reads_on(error, caplog):
    def broken(_state, _rules):
        raise error

    state = EngineState(flight=Flight(active=True), session=Session(id="s"), t_ns=1)
    with Run(decides(), broken, state=state) as run:
        run.inbox.put(started(5))
        done = [run.next()[1] for _ in range(4)]
    assert [type(each) for each in done if isinstance(each, Request)] == [MissionCommand, AutopilotLand]
    assert {type(each) for each in done if isinstance(each, Event)} == {EngineStarted, UserRequest}
    assert "the engine could not decide about what is due next" in caplog.text


# --- the end of the thread --------------------------------------------------------------------------------------------


ENDS = pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")


def dying(state, event, _rules):
    """Decide, but for the first event, which ends the thread as nothing else does."""
    if event.t_ns == 1:
        raise SystemExit
    return evolve(state, t_ns=event.t_ns), (LAND,)


@ENDS
def test_who_waits_for_its_end_sees_it():
    with Run(dying) as run:
        assert run.thread.alive
        run.inbox.put(started(1))
        ends(run)


def ends(run):
    wait_for(lambda: not run.thread.alive)


@ENDS
def test_what_comes_after_its_end_is_decided_about_by_who_stands_in():
    with Run(dying) as run:
        run.inbox.put(started(1))
        ends(run)
        run.inbox.put(started(2))
        run.thread.stand_in()
        assert run.next() == ("send", LAND)
        assert run.next()[:2] == ("record", started(2))


def test_who_replaces_it_while_it_hangs_decides_alone_also_when_it_goes_on():
    hangs, goes_on = threading.Event(), threading.Event()

    def hanging(state, event, _rules):
        if event.t_ns == 1:
            hangs.set()
            goes_on.wait(60.0)
        return evolve(state, t_ns=event.t_ns), (LAND,)

    with Run(hanging) as run:
        run.inbox.put(started(1))
        assert hangs.wait(2.0)
        turns = run.thread.turns
        run.thread.replace()
        run.inbox.put(started(2))
        run.thread.stand_in()
        assert run.next() == ("send", LAND)
        assert run.next()[:2] == ("record", started(2))
        assert run.thread.turns == turns + 1
        goes_on.set()
        ends(run)
        assert run.thread.state.t_ns == 2
        assert run.done.empty()


def test_nobody_stands_in_while_it_lives():
    with Run(decides()) as run:
        run.thread.stand_in()
        run.inbox.put(started(2))
        assert run.next()[:2] == ("record", started(2))


def test_it_may_be_stopped_before_it_was_started():
    run = Run(decides())
    run.inbox.put(started(2))
    run.thread.stop()
    assert run.next()[:2] == ("record", started(2))
