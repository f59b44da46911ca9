"""When the node ends, what it waits for before, and what its exit status says."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.engine.commands import (
    AutopilotLand,
    MissionAction,
    MissionCommand,
    StopRecording,
)
from amaze_autonomy.engine.events import Mission, Outcome, Reply, Shutdown, Tick
from amaze_autonomy.engine.state import DataResult, EngineState, Flight, Result, Session, State
from amaze_autonomy.nodes.autonomy.ending import Ended, Ending, Farewell
from amaze_autonomy.nodes.autonomy.node import data_outcome, exit_status, outcome

LAND = MissionCommand(id=1, limit_ns=1, session_id="s", action=MissionAction.LAND)
SECOND = AutopilotLand(id=2, limit_ns=1)
SHUTDOWN = Shutdown(t_ns=1, signal="SIGINT")
WHOLE, LACKS = DataResult.COMPLETE, DataResult.INCOMPLETE


def reply(number, how=Outcome.ACCEPTED):
    return Reply(t_ns=2, command_id=number, outcome=how)


def waits(farewell, limit_s=0.05):
    began = time.monotonic()
    farewell.wait(limit_s)
    return time.monotonic() - began >= limit_s


def test_nothing_to_land_is_nothing_to_wait_for():
    farewell = Farewell()
    farewell.see(SHUTDOWN, (StopRecording(id=9, limit_ns=1, session_id="s"),))
    assert not waits(farewell, 5.0)
    assert farewell.text() == ""


def test_it_waits_for_the_shutdown_to_be_decided_on():
    assert waits(Farewell())


def test_it_waits_until_both_routes_have_accepted():
    farewell = Farewell()
    farewell.see(SHUTDOWN, (LAND, SECOND))
    assert waits(farewell)
    farewell.see(reply(1), ())
    assert waits(farewell)
    farewell.see(reply(2), ())
    assert not waits(farewell, 5.0)
    assert farewell.text() == "mission planner: accepted, autopilot: accepted"


def test_a_reply_ends_the_wait_at_once():
    farewell = Farewell()
    farewell.see(SHUTDOWN, (LAND, SECOND))
    farewell.see(reply(1), ())
    threading.Timer(0.05, lambda: farewell.see(reply(2), ())).start()
    assert not waits(farewell, 5.0)


def test_a_route_that_failed_may_still_accept_a_repetition():
    farewell = Farewell()
    farewell.see(SHUTDOWN, (LAND, SECOND))
    farewell.see(reply(1), ())
    farewell.see(reply(2, Outcome.UNAVAILABLE), ())
    assert waits(farewell)
    assert farewell.text() == "mission planner: accepted, autopilot: unavailable"
    farewell.see(Tick(t_ns=3), (replace(SECOND, id=3),))
    farewell.see(reply(3), ())
    assert not waits(farewell, 5.0)


def test_what_was_sent_before_the_shutdown_does_not_count():
    farewell = Farewell()
    farewell.see(Tick(t_ns=0), (LAND, SECOND))
    farewell.see(SHUTDOWN, ())
    farewell.see(reply(1), ())
    assert farewell.text() == ""


def ending(*, exit_when_ended=True):
    reasons = []
    return Ending(reasons.append, EngineState(), exit_when_ended=exit_when_ended), reasons


def see(watched, *states, result=Result.NONE, queue=()):
    for state in states:
        watched.see(EngineState(state=state, queue=queue, session=Session(result=result)))


def test_the_end_of_the_last_mission_ends_the_node():
    watched, reasons = ending()
    see(watched, State.PREFLIGHT, State.MISSION, State.DATA_CLEANUP)
    assert reasons == []
    see(watched, State.MISSION_ENDED, State.MISSION_ENDED, result=Result.COMPLETE)
    assert (reasons, watched.results) == (["mission ended"], [Ended(Result.COMPLETE)])


def test_a_mission_that_waits_is_still_flown():
    watched, reasons = ending()
    see(watched, State.PREFLIGHT)
    see(watched, State.MISSION_ENDED, result=Result.COMPLETE, queue=(Mission(id="2"),))
    assert reasons == []


def test_a_mission_that_was_given_up_was_not_flown():
    watched, reasons = ending()
    see(watched, State.PREFLIGHT, State.OUTREACH, State.MISSION_INPUT)
    assert (reasons, watched.results) == (["mission ended"], [Ended(Result.NOT_FLOWN)])


def test_the_next_mission_is_selected_after_an_end():
    watched, _ = ending()
    see(watched, State.PREFLIGHT)
    see(watched, State.MISSION_ENDED, State.MISSION_INPUT, result=Result.PILOT)
    assert watched.results == [Ended(Result.PILOT)]


def test_the_node_stays_when_it_is_not_asked_to_end():
    watched, reasons = ending(exit_when_ended=False)
    see(watched, State.PREFLIGHT, State.MISSION_ENDED)
    assert reasons == []


def at(state, *, in_flight=False):
    return EngineState(state=state, flight=Flight(active=in_flight))


@pytest.mark.parametrize(
    "results, state, words, status",
    [
        ([], at(State.MISSION_INPUT), "COMPLETE", 0),
        ([Ended(Result.COMPLETE)], at(State.MISSION_ENDED), "COMPLETE", 0),
        ([Ended(Result.LANDED_EARLY)], at(State.MISSION_ENDED), "LANDED_EARLY", 3),
        ([Ended(Result.PILOT)], at(State.MISSION_ENDED), "PILOT", 4),
        ([Ended(Result.NOT_FLOWN)], at(State.MISSION_INPUT), "NOT_FLOWN", 5),
        ([], at(State.START_RECORDING), "INTERRUPTED", 7),
        ([Ended(Result.COMPLETE)], at(State.MISSION, in_flight=True), "INTERRUPTED_IN_FLIGHT", 8),
    ],
)
def test_the_exit_status_is_the_worst_that_happened(results, state, words, status):
    assert (outcome(results, state), exit_status(results, state)) == (words, status)


@pytest.mark.parametrize(
    "results, state, words, data, status",
    [
        ([Ended(Result.COMPLETE, WHOLE)], at(State.MISSION_ENDED), "COMPLETE", WHOLE, 0),
        ([Ended(Result.COMPLETE, LACKS)], at(State.MISSION_ENDED), "COMPLETE", LACKS, 6),
        ([Ended(Result.LANDED_EARLY, LACKS)], at(State.MISSION_ENDED), "LANDED_EARLY", LACKS, 6),
        ([Ended(Result.COMPLETE, LACKS), Ended(Result.COMPLETE, WHOLE)], at(State.MISSION_ENDED), "COMPLETE", LACKS, 6),
        ([Ended(Result.COMPLETE, LACKS)], at(State.MISSION, in_flight=True), "INTERRUPTED_IN_FLIGHT", LACKS, 8),
        ([Ended(Result.NOT_FLOWN)], at(State.MISSION_INPUT), "NOT_FLOWN", DataResult.NONE, 5),
    ],
)
def test_what_became_of_the_data_is_said_apart_and_has_a_status_of_its_own(results, state, words, data, status):
    assert (outcome(results, state), data_outcome(results), exit_status(results, state)) == (words, data, status)
