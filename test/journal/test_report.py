"""What a person is shown of the engine: faults with their cause and true time left, telemetry, numbered messages."""

from __future__ import annotations

from dataclasses import replace

import pytest

from amaze_autonomy.engine.commands import AnswerKind, Level, Notify
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    Check,
    CheckName,
    ComponentStatus,
    Mission,
    Outcome,
    PlatformRecording,
    RecordingPhase,
    RecordingStatus,
    Tick,
    UserCommand,
    VehicleLanded,
    Verdict,
)
from amaze_autonomy.engine.rules import Action, Code, Limits, Restart, Rules
from amaze_autonomy.engine.state import (
    CheckRecord,
    EngineState,
    Failure,
    FailureKind,
    Flight,
    Landing,
    Peers,
    Preflight,
    Result,
    Session,
    State,
    Step,
)
from amaze_autonomy.journal.report import (
    Fault,
    MessageLog,
    OperatorMessage,
    Telemetry,
    computer_rows,
    end_on_the_way,
    limit_words,
    mission_end,
    report,
)

S = 1_000_000_000
T = 100 * S


def component(name, reason="", since_ns=T, **changes):
    return Failure(name, FailureKind.COMPONENT, 4, Action.CONTINUE, since_ns=since_ns, reason=reason, **changes)


def loss(name):
    return Failure(name, FailureKind.LOSS, 0, Action.LAND, since_ns=T, reason="silent")


def shown(*failures, **changes):
    return report(EngineState(t_ns=T, failures=failures, **changes), Rules())


# --- faults ---


def held(until_ns, restart=Restart.TRYING):
    lrf = Failure("lrf", FailureKind.COMPONENT, 8, Action.WAIT, Action.LAND, T, T + 15 * S, "silent")
    status = ComponentStatus("lrf", Code.HOLD, restart, until_ns, "silent")
    flight = Flight(active=True, started_ns=T - 60 * S)
    return shown(lrf, state=State.HOLD, step=Step.HOLDING, flight=flight, peers=Peers(components=(status,)))


def test_a_wait_ends_by_the_limit_that_is_the_earlier_one_and_names_it():
    look = held(T + 12 * S)
    assert look.faults == (Fault("lrf", 8, Action.WAIT, Action.LAND, T + 12 * S, "restart limit", "", "silent"),)
    assert (look.deadline, look.deadline_ns) == ("restart limit", T + 12 * S)
    for later in (held(T + 20 * S), held(None), held(T + 12 * S, Restart.NONE)):
        assert [(fault.end_ns, fault.limit) for fault in later.faults] == [(T + 15 * S, "wait limit")]
        assert later.deadline_ns == T + 15 * S


def test_the_operators_own_hold_is_no_fault():
    hold = Failure("user_hold", FailureKind.USER, 0, Action.WAIT, Action.LAND, T, T + 120 * S, "the user asked")
    look = shown(hold, state=State.HOLD, step=Step.HOLDING, flight=Flight(active=True, user_hold_ns=T))
    assert (look.faults, look.waiting_for) == ((), "you: resume or land")


def test_what_goes_with_the_autopilots_link_has_one_cause():
    failures = (
        loss("autopilot_status"),
        loss("battery_unknown"),
        component("gps", "the autopilot's gps: no answer for longer than 1 s"),
        component("lrf", "no message on /lrf/range for longer than 0.3 s"),
    )
    link = "no link to the autopilot"
    assert [fault.cause for fault in shown(*failures).faults] == [link, link, link, ""]
    assert [fault.cause for fault in shown(failures[0], failures[3]).faults] == ["", ""]


def test_four_that_are_late_at_once_have_one_cause_and_three_have_none():
    late = [component(f"c{n}", f"no message on /c{n} for longer than 0.3 s", T + n * S // 2) for n in range(4)]
    words = "4 components late within 2 s: their computer is overloaded, or is cut off"
    assert {fault.cause for fault in shown(*late).faults} == {words}
    assert {fault.cause for fault in shown(*late[:3]).faults} == {""}
    apart = [replace(each, since_ns=T + 3 * n * S) for n, each in enumerate(late)]
    assert {fault.cause for fault in shown(*apart).faults} == {""}
    broken = [component(f"c{n}", "the self-test failed") for n in range(4)]
    assert {fault.cause for fault in shown(*broken).faults} == {""}


# --- commands ---


def test_land_while_it_lands_is_answered_already():
    landing = shown(state=State.LAND, step=Step.DESCENDING, flight=Flight(active=True), landing=Landing(since_ns=T))
    answers = {each.command: (each.answer, each.text) for each in landing.answers}
    assert set(answers) == set(UserCommand)
    assert answers[UserCommand.LAND] == (AnswerKind.ALREADY, "It is landing.")
    assert answers[UserCommand.HOLD] == (AnswerKind.REFUSED, "A hold never interrupts a landing.")


# --- telemetry ---


def test_telemetry_has_the_limits_that_count_for_the_mission():
    mission = Mission(id="1", max_height_m=12.0)
    autopilot = AutopilotStatus(
        t_ns=T,
        armed=True,
        landed=VehicleLanded.IN_AIR,
        mode="AUTO.MISSION",
        link_age_s=0.25,
        height_m=4.5,
        position_x_m=3.0,
        position_y_m=4.0,
        vertical_speed_m_s=-0.5,
        horizontal_speed_m_s=1.5,
        battery_fraction=0.75,
        battery_voltage_v=15.5,
        gps_fix="3D",
        satellites=14.0,
    )
    peers = Peers(autopilot=autopilot, autopilot_ns=T, components=(ComponentStatus("gps", Code.NOMINAL),))
    flight = Flight(active=True, started_ns=T - 42 * S)
    look = shown(peers=peers, flight=flight, session=Session(mission=mission), queue=(Mission(id="2"),))
    assert look.queue == ("2",)
    assert look.telemetry == Telemetry(
        heard_ns=T,
        link_age_s=0.25,
        mode="AUTO.MISSION",
        armed=True,
        landed="IN_AIR",
        gps="nominal",
        gps_fix="3D",
        satellites=14.0,
        battery_fraction=0.75,
        battery_limit=0.15,
        battery_voltage_v=15.5,
        altitude_m=4.5,
        altitude_limit_m=12.0,
        position_x_m=3.0,
        position_y_m=4.0,
        distance_m=5.0,
        distance_limit_m=100.0,
        speed_m_s=1.5,
        climb_m_s=-0.5,
        flight_time_s=42.0,
        flight_time_limit_s=900.0,
    )


@pytest.mark.parametrize(
    "flight", [Flight(), Flight(active=True), Flight(started_ns=T - 42 * S)], ids=["before", "not yet up", "down again"]
)
def test_a_flight_time_is_that_of_a_flight_under_way(flight):
    autopilot = AutopilotStatus(t_ns=T, armed=False, landed=VehicleLanded.ON_GROUND)
    assert shown(flight=flight, peers=Peers(autopilot=autopilot)).telemetry.flight_time_s is None


def test_nothing_heard_is_nothing_known_but_the_limits():
    look = shown()
    assert (look.waypoint, look.waypoints, look.recording_phase) == (0, 0, "")
    look = look.telemetry
    assert look == Telemetry(
        battery_limit=0.15, altitude_limit_m=30.0, distance_limit_m=100.0, flight_time_limit_s=900.0
    )


# --- limits ---


@pytest.mark.parametrize(
    "limit, other, words",
    [(3.5, 6.5, "3.5 ... 6.5 Hz"), (6.5, 3.5, "3.5 ... 6.5 Hz"), (8.0, None, "8 Hz"), (None, None, "")],
)
def test_a_limit_names_both_ends_where_there_are_two_and_its_unit_once(limit, other, words):
    row = Check("gps", Verdict.PASS, 5.0, limit, "Hz", other_limit=other)
    assert limit_words(row, lambda each: f"{each:g} {row.unit}") == words


def test_a_clock_may_be_behind_by_one_limit_and_ahead_by_another():
    limits = Limits(status_max_age_ns=S, clock_tolerance_ns=S // 5)
    checked = Preflight(checks=(CheckRecord(CheckName.BATTERY),))
    for age_ns, limit, other in ((S // 2, 1.0, -0.2), (-S // 10, -0.2, 1.0)):
        status = AutopilotStatus(t_ns=T, armed=False, landed=VehicleLanded.ON_GROUND, age_ns=age_ns)
        state = EngineState(t_ns=T, preflight=checked, peers=Peers(autopilot=status))
        (_, row) = report(state, Rules(limits=limits)).checks
        assert row == Check("clocks: autopilot", Verdict.PASS, age_ns / S, limit, "s", other_limit=other)


@pytest.mark.parametrize(
    "row, answered, own",
    [
        (Verdict.PASS, {"outcome": Outcome.ACCEPTED, "ok": True}, None),
        (Verdict.FAIL, {"outcome": Outcome.ACCEPTED}, None),
        (Verdict.PASS, {"outcome": Outcome.ACCEPTED, "message": "no"}, Verdict.FAIL),
        (Verdict.PASS, {}, None),
        (None, {}, Verdict.UNKNOWN),
        (None, {"outcome": Outcome.ACCEPTED, "ok": True}, Verdict.PASS),
        (None, {"outcome": Outcome.TIMED_OUT}, Verdict.FAIL),
    ],
)
def test_a_check_has_a_row_of_its_own_where_its_rows_do_not_say_how_it_went(row, answered, own):
    rows = () if row is None else (Check("level", row),)
    record = CheckRecord(CheckName.BATTERY, rows=rows, **answered)
    told = report(EngineState(t_ns=T, preflight=Preflight(checks=(record,))), Rules()).checks
    names = {"battery": own} if own is not None else {}
    assert {each.name: each.verdict for each in told} == {**({} if row is None else {"battery: level": row}), **names}


# --- computers ---


def computers(*platforms):
    said = RecordingStatus(t_ns=T, session_id="", phase=RecordingPhase.IDLE, platforms=platforms)
    return computer_rows(said, 0.05, Rules().limits)


def test_each_computer_has_a_row_for_its_cpu_load_and_one_for_its_storage_with_its_limit():
    main = PlatformRecording("main", growing=False, free_fraction=0.6, cpu_fraction=0.25)
    full = PlatformRecording("second", growing=False, free_fraction=0.04, cpu_fraction=1.0)
    assert computers(main, full) == (
        Check("computers: main CPU load", Verdict.PASS, 0.25, None, "fraction"),
        Check("computers: main free storage", Verdict.PASS, 0.6, 0.05, "fraction"),
        Check("computers: second CPU load", Verdict.PASS, 1.0, None, "fraction"),
        Check(
            "computers: second free storage",
            Verdict.WARN,
            0.04,
            0.05,
            "fraction",
            advice="make space: no recording starts",
        ),
    )


def test_a_computer_whose_clock_is_another_one_is_warned_of():
    rows = computers(*(PlatformRecording(f"{age_s}", growing=False, clock_age_s=age_s) for age_s in (0.01, 1.5, -0.7)))
    assert [(row.name, row.verdict, row.value, row.limit, row.other_limit) for row in rows] == [
        ("computers: 0.01 clock", Verdict.PASS, 0.01, 1.0, -0.2),
        ("computers: 1.5 clock", Verdict.WARN, 1.5, 1.0, -0.2),
        ("computers: -0.7 clock", Verdict.WARN, -0.7, -0.2, 1.0),
    ]
    assert [row.advice for row in rows] == ["", *["set the clocks of both computers by chrony"] * 2]


def test_what_a_computer_does_not_say_has_no_row():
    assert computers(PlatformRecording("main", growing=True)) == ()


def test_rows_of_computers_stand_with_the_checks_and_only_there():
    rows = computers(PlatformRecording("main", growing=False, cpu_fraction=0.25))
    checked = EngineState(t_ns=T, preflight=Preflight(checks=(CheckRecord(CheckName.BATTERY),)))
    assert report(checked, Rules(), rows).checks[1:] == rows
    assert report(EngineState(t_ns=T), Rules(), rows).checks == ()


# --- messages ---


def say(text):
    return Notify(level=Level.WARNING, key="ready_old", text=text, advice="Look.")


def test_of_several_messages_in_one_step_none_is_lost():
    log = MessageLog()
    assert log.take(T, (say("one"), say("two")))
    assert not log.take(T + 1, ())
    assert log.take(T + 2, (say("three"),))
    said = OperatorMessage(1, T, Level.WARNING, "one", "Look.", "ready_old")
    three = OperatorMessage(3, T + 2, Level.WARNING, "three", "Look.", "ready_old")
    assert log.after(0) == (said, OperatorMessage(2, T, Level.WARNING, "two", "Look.", "ready_old"), three)
    assert log.after(2) == (three,)


def test_eight_hours_of_messages_do_not_grow():
    log = MessageLog()
    for second in range(8 * 3600):
        log.take(second * S, (say(f"{second} s"),))
    kept = log.after(0)
    assert (len(kept), kept[0].number, kept[-1].number) == (MessageLog.MOST, 28_601, 28_800)


# --- the end of a mission with another one in the queue ---


NEXT = Mission(id="1")


@pytest.mark.parametrize("queue", [(), (NEXT,)])
def test_an_end_on_the_way_is_that_of_a_mission_with_another_one_in_the_queue(queue):
    """One event ended it and began the next; with nothing in the queue its end is a state of its own."""
    session = Session(id="first", mission=NEXT)
    before = EngineState(t_ns=T, state=State.MISSION_ENDED, session=session, queue=queue)
    began = replace(before, session=replace(session, id="second"), queue=())
    found = end_on_the_way(before, Tick(t_ns=T), began, Rules())
    assert (found is not None) == bool(queue)
    if found is not None:
        assert (found.session.id, found.queue) == ("first", queue)
    assert end_on_the_way(before, Tick(t_ns=T), before, Rules()) is None
    assert end_on_the_way(replace(before, session=Session()), Tick(t_ns=T), began, Rules()) is None


def test_the_end_of_a_mission_is_found_once_whether_or_not_the_next_one_begins_with_it():
    rules, session = Rules(), Session(id="first", mission=NEXT, result=Result.COMPLETE)
    before = EngineState(t_ns=T, state=State.DATA_CLEANUP, session=session, queue=(NEXT,))  # nothing was recorded
    began, _ = decide(before, Tick(t_ns=T), rules)
    ended, _ = decide(replace(before, queue=()), Tick(t_ns=T), rules)
    assert (began.state, ended.state) == (State.PREFLIGHT, State.MISSION_ENDED)
    assert mission_end(replace(before, queue=()), Tick(t_ns=T), ended, rules) is ended
    passed = mission_end(before, Tick(t_ns=T), began, rules)
    assert passed is not None
    assert (passed.session, passed.queue) == (ended.session, (NEXT,))
    assert mission_end(ended, Tick(t_ns=T), ended, rules) is None
    assert mission_end(replace(ended, queue=(NEXT,)), Tick(t_ns=T), began, rules) is None, "it had ended before"
    assert mission_end(began, Tick(t_ns=T), began, rules) is None
