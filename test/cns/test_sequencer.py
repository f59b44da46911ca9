"""Their mission sequencer where messages cross, are refused or do not come: whole flights in virtual time."""

from __future__ import annotations

import pytest
from flight import MS, WHOLE, S, flying
from stand_ins import ARM, DISARM, HOLD, LAND, RESUME, TAKEOFF, namespace

from amaze_autonomy.engine.commands import MissionAction, MissionCommand
from amaze_autonomy.engine.events import MissionPhase, UserCommand
from amaze_autonomy.engine.state import Result, State

P = MissionPhase
LATENCY_NS = 40 * MS  # of 1 to 60 ms
HEIGHT = {"request": {"id": 1, "request": TAKEOFF}, "response": False, "completed": True}


def planner(flight):
    return flight.peers["mission_planner"]


# --- holds ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("takes_in_hold", [False, True])
def test_a_hold_that_crosses_the_end_of_the_takeoff_is_resumed_to_the_mission(make, takes_in_hold):
    flight = make(latency_ns=LATENCY_NS, mission_planner={"takes_in_hold": takes_in_hold})
    flight.until(lambda: any(fields == HEIGHT for *_, fields in flight._to_peer["mission_planner"]))
    assert (flight.state.state, planner(flight)._phase) == (State.MISSION, P.TAKING_OFF)
    flight.ask(UserCommand.HOLD)
    flight.run(2 * S)
    assert planner(flight)._phase is P.HOLDING
    flight.ask(UserCommand.RESUME)
    flight.end()
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == [ARM, TAKEOFF, HOLD, RESUME, LAND, DISARM]


def test_waypoints_that_were_taken_are_not_sent_again_after_a_hold(make):
    flight = make(latency_ns=LATENCY_NS)
    flight.until(lambda: planner(flight)._phase is P.FLYING)
    flight.run(200 * MS)  # on its way to the first one
    flight.ask(UserCommand.HOLD)
    flight.run(2 * S)
    flight.ask(UserCommand.RESUME)
    flight.end()
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert [key for key, _ in flight.calls("mission_planner")].count("waypoint_list") == 1


def test_a_hold_while_a_resume_is_under_way_is_asked_for(make):
    flight = make(latency_ns=LATENCY_NS)
    flying(flight)
    flight.ask(UserCommand.HOLD)
    flight.run(3 * S)
    flight.ask(UserCommand.RESUME)
    flight.run(20 * MS)  # it is not there yet
    flight.ask(UserCommand.HOLD)
    flight.run(S)
    assert flight.requests()[2:] == [HOLD, RESUME, HOLD]
    assert (flight.state.state, planner(flight)._phase) == (State.HOLD, P.HOLDING)
    where = flight.vehicle.position_m
    flight.run(3 * S)
    assert flight.vehicle.position_m == pytest.approx(where, abs=0.2)
    flight.ask(UserCommand.RESUME)
    flight.end()
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)


def test_a_resume_while_a_hold_is_under_way_is_asked_for(make):
    flight = make(latency_ns=LATENCY_NS)
    flying(flight)
    flight.ask(UserCommand.HOLD)
    flight.run(20 * MS)
    assert planner(flight)._phase is P.FLYING
    command = MissionCommand(id=99, limit_ns=S, session_id=flight.state.session.id, action=MissionAction.RESUME)
    assert planner(flight).answer(flight.t_ns, command) is None  # the answer is that of its sequencer
    flight.run(200 * MS)
    assert flight.requests()[2:] == [HOLD, RESUME]
    assert planner(flight)._phase is P.FLYING


def test_a_takeoff_that_was_called_off_while_it_arms_stays_so_at_the_limit(make, configuration):
    flight = make(mission_planner={"arms_never": True})
    flight.until(lambda: ARM in flight.requests())
    flight.run(S)
    flight.ask(UserCommand.ABORT)
    flight.run(configuration.rules.limits.arm_limit_ns + 2 * S)
    assert flight.requests() == [ARM, DISARM]
    assert (flight.planner[-1].phase, flight.planner[-1].message) == (P.LANDED, "")


# --- the end of the last mission --------------------------------------------------------------------------------------


def by_pilot(flight):
    """Have a pilot take over and land, and a person end the mission; its sequencer stays in it."""
    flight.vehicle.pilot_takes_over("POSCTL", 2 * S)
    flight.until(lambda: flight.state.state is State.PILOT)
    flight.until(lambda: not flight.vehicle.armed)
    flight.run(2 * S)
    flight.ask(UserCommand.ACKNOWLEDGE)
    assert flight.end() == "MISSION_ENDED"
    flight.vehicle.pilot_gives_back()
    assert flight.nodes["mission_planner"]._state == "mission"


def next_mission(flight):
    """Fly another one, which is loaded once the last one has ended; return what was asked on the way."""
    before = len(flight.requests())
    flight.run(S)
    flight.select("1")
    flight.until(lambda: flight.state.state is State.OUTREACH)
    words = "its sequencer is still in its last mission, which is being ended: try again"
    assert any(words in notice for notice in flight.notices), flight.notices
    flight.run(5 * S)
    assert flight.nodes["mission_planner"]._state == "idle"
    assert (flight.planner[-1].phase, flight.planner[-1].message) == (P.LANDED, "")
    flight.ask(UserCommand.RETRY)
    flight.until(lambda: flight.state.state is not State.OUTREACH)
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    return flight.requests()[before:]


@pytest.mark.parametrize("later_s", [0, 120])
def test_a_mission_in_which_the_peers_node_was_started_again_and_a_pilot_landed_is_ended(make, later_s):
    flight = make()
    flying(flight)
    flight.restart(S)
    flight.run(S // 5)
    by_pilot(flight)
    flight.run(later_s * S)  # nothing was heard of its end meanwhile
    assert planner(flight)._phase is (P.FAILED if later_s else P.FLYING)
    assert next_mission(flight) == [LAND, DISARM, *WHOLE]


def test_a_sequencer_that_was_away_in_flight_and_is_there_again_is_ended(make):
    flight = make()
    flying(flight)
    flight.dead = ("mission_planner",)
    flight.run(4 * S)
    flight.dead = ()
    planner(flight).alive = True
    assert flight.end() == "MISSION_ENDED"
    assert flight.nodes["mission_planner"]._state == "mission"
    assert next_mission(flight) == [LAND, DISARM, *WHOLE]


def test_a_sequencer_that_was_started_again_has_nothing_to_be_ended(make):
    flight = make()
    flying(flight)
    by_pilot(flight)
    flight.nodes["mission_planner"]._state = "idle"
    assert next_mission(flight) == [LAND, DISARM, *WHOLE]  # both are refused


def test_after_a_failure_that_its_sequencer_landed_from_the_next_mission_is_loaded_at_once(make):
    flight = make()
    flying(flight)
    planner(flight)._fail("failed")
    assert flight.end() == "MISSION_ENDED"
    assert flight.nodes["mission_planner"]._state == "idle"
    flight.select("1")
    flight.until(lambda: flight.state.state in (State.OUTREACH, State.MISSION))
    assert flight.end() == "MISSION_ENDED"
    assert flight.requests() == WHOLE * 2


# --- what has a limit -------------------------------------------------------------------------------------------------

FOR_EVER = 1000


@pytest.mark.parametrize("fault", ["refuses", "ignores"])
def test_a_landing_that_it_does_not_begin_after_the_last_waypoint_is_asked_for_again(make, fault):
    flight = make(mission_planner={fault: {LAND: 1}})
    flight.end()
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == [ARM, TAKEOFF, LAND, LAND, DISARM]


@pytest.mark.parametrize("fault", ["refuses", "ignores"])
def test_a_sequencer_that_does_not_land_after_the_last_waypoint_has_failed(make, fault):
    flight = make(mission_planner={fault: {LAND: FOR_EVER}})
    flight.until(lambda: LAND in flight.requests())
    began_ns = flight.t_ns
    flight.until(lambda: flight.state.state is State.LAND)
    assert flight.t_ns - began_ns <= 2 * S
    assert flight.requests()[:4] == [ARM, TAKEOFF, LAND, LAND]
    assert flight.planner[-1].message == "its sequencer does not land"
    flight.until(lambda: not flight.vehicle.armed)
    flight.end()
    assert flight.state.session.result is Result.LANDED_EARLY


def test_a_landing_whose_answer_was_lost_is_one_where_the_second_is_refused(make):
    """It refuses a LAND while it lands."""
    flight = make()
    flight.until(lambda: LAND in flight.requests())
    its = planner(flight)
    its._land_until_ns, its._phase = flight.t_ns, P.FLYING
    its._repeat_landing(flight.t_ns)
    its._land_refused()
    assert its._phase is P.LANDING
    flight.end()
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)


def test_an_answer_that_comes_late_finds_a_landing_that_was_asked_for_twice(make):
    flight = make()
    flight.until(lambda: LAND in flight.requests())
    assert planner(flight)._phase is P.FLYING
    planner(flight)._repeat_landing(planner(flight)._land_until_ns)  # before it is heard
    flight.end()
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == [ARM, TAKEOFF, LAND, LAND, DISARM]


def test_a_landing_that_the_peers_node_did_not_hear_of_is_asked_for_again(make):
    flight = make(mission_planner={"ignores": {LAND: 1}})
    flight.until(lambda: LAND in flight.requests())
    flight.restart(S)
    flight.end()
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == [ARM, TAKEOFF, LAND, LAND, DISARM]


@pytest.mark.parametrize(
    "fault", [{"ignores": {"waypoint_list": 1}}, {"climbs_for_ever": True}, {"skips": (1, 2, 3, 4)}], ids=str
)
def test_a_sequencer_that_flies_no_waypoint_has_failed_after_the_duration_of_the_mission(make, fault):
    flight = make(mission_planner=fault)
    flight.until(lambda: flight.state.state is State.MISSION)
    began_ns = flight.t_ns
    flight.until(lambda: flight.state.state is State.LAND)
    assert (flight.t_ns - began_ns) / S == pytest.approx(60, abs=5)  # of a mission that is shorter
    assert flight.planner[-1].message == "its sequencer has said nothing new for 60 s"
    flight.end()
    assert not flight.vehicle.armed
    assert flight.state.session.result is Result.LANDED_EARLY


def test_a_hold_is_no_time_of_the_mission(make):
    flight = make()
    flying(flight)
    for _ in range(2):
        flight.ask(UserCommand.HOLD)
        flight.run(50 * S)
        assert planner(flight)._phase is P.HOLDING
        flight.ask(UserCommand.RESUME)
        flight.run(S // 2)
    flight.end()
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)


def test_a_landing_that_does_not_come_down_has_a_limit(make, configuration):
    flight = make(mission_planner={"lands_not": True})
    flight.until(lambda: planner(flight)._phase is P.LANDING)
    began_ns = flight.t_ns
    flight.until(lambda: flight.state.state is State.LAND)
    assert flight.t_ns - began_ns == pytest.approx(configuration.rules.limits.landing_stall_limit_ns, abs=S)
    flight.until(lambda: not flight.vehicle.armed)
    flight.end()
    assert flight.state.session.result is Result.COMPLETE


# --- waypoints that it skips ------------------------------------------------------------------------------------------


@pytest.mark.slow_rows
@pytest.mark.parametrize("latency_ns", [0, LATENCY_NS])
@pytest.mark.parametrize(
    "skips, words, result",
    [
        ((2,), "waypoint 2", Result.COMPLETE),
        ((2, 3), "waypoints 2, 3", Result.COMPLETE),
        ((1, 3), "waypoints 1, 3", Result.COMPLETE),
        ((4,), "waypoint 4", Result.LANDED_EARLY),
        ((1, 3, 4), "waypoints 1, 3, 4", Result.LANDED_EARLY),
    ],
)
def test_all_waypoints_that_it_skips_are_named_and_without_the_last_one_nothing_is_complete(
    make, latency_ns, skips, words, result
):
    flight = make(latency_ns=latency_ns, mission_planner={"skips": skips})
    flight.end()
    assert flight.planner[-1].message == f"its sequencer has skipped {words}"
    assert flight.state.session.result is result


@pytest.mark.parametrize("command", [UserCommand.LAND, UserCommand.ABORT])
def test_waypoints_that_a_landing_leaves_out_are_not_skipped(make, command):
    flight = make()
    flying(flight)
    flight.ask(command)
    flight.end()
    assert {status.message for status in flight.planner} == {""}


def test_a_last_waypoint_that_is_heard_after_the_end_was_not_skipped(make):
    flight = make()
    node = flight.nodes["mission_planner"]
    flight.until(lambda: node._told == 3)
    point = dict(node._points[3])
    node._points[3] = {**node._points[3], "x": 1000.0}  # what it says of it now is not understood
    flight.until(lambda: planner(flight)._phase is P.LANDING)
    flight.run(S // 5)
    assert flight.planner[-1].message == "its sequencer has skipped waypoint 4"
    planner(flight).hear(flight.t_ns, "waypoint_reached", namespace({"waypoint": point}))
    flight.end()
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.planner[-1].message == ""


def test_what_was_skipped_is_known_to_a_peers_node_that_is_started_again(make):
    flight = make(mission_planner={"skips": (1, 3)})
    flight.until(lambda: planner(flight)._reached == 2)
    flight.restart(S // 2)
    flight.end()
    assert flight.planner[-1].message == "its sequencer has skipped waypoints 1, 3"
