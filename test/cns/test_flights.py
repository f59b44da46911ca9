"""Whole missions with all five nodes of the CNS Flight Stack as peers, played by stand-ins in virtual time."""

from __future__ import annotations

from dataclasses import replace
from itertools import starmap
from math import dist, radians

import pytest
from flight import ENTITIES, MS, WHOLE, Flight, S, flying
from stand_ins import (
    ABORT,
    ARM,
    DEFECT,
    DISARM,
    ERROR,
    HOLD,
    LAND,
    NOMINAL,
    RESUME,
    TAKEOFF,
    Watchdog,
    namespace,
)

from amaze_autonomy.cns.peers import LandingDetection, Recorder
from amaze_autonomy.cns.peers import Watchdog as CnsWatchdog
from amaze_autonomy.cns.sequencer import Bounds, Sequencer
from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.commands import LoadMission, MissionAction, MissionCommand, RunCheck
from amaze_autonomy.engine.events import CheckName, Landed, MissionPhase, Outcome, UserCommand, Verdict
from amaze_autonomy.engine.state import Result, State
from amaze_autonomy.interface.tables import Service
from amaze_autonomy.missions import Frame, Trajectory, Waypoint

P = MissionPhase


def phases(flight):
    found = []
    for status in flight.planner:
        if not found or found[-1] is not status.phase:
            found.append(status.phase)
    return found


def test_a_mission_is_flown_to_its_end_with_all_five(make):
    flight = make()
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == WHOLE
    assert phases(flight) == [P.IDLE, P.LOADED, P.TAKING_OFF, P.FLYING, P.LANDING, P.LANDED]
    assert (flight.planner[-1].waypoint, flight.planner[-1].waypoints) == (4, 4)
    assert len(flight.calls("watchdog")) == 1  # though it was asked before the takeoff again
    assert [fields["data"] for _, fields in flight.calls("data_recorder")] == [True, False]
    lists = [fields for key, fields in flight.calls("mission_planner") if key == "waypoint_list"]
    assert len(lists) == 1
    assert (lists[0]["action"], lists[0]["reference"]) == (0, 1)
    assert lists[0]["waypoints"][1] == pytest.approx({"x": 3.0, "y": 0.0, "z": 1.5, "yaw": 5.0, "holdtime": 1.0})


@pytest.mark.parametrize("touchdown, flights", [("true", 4), ("false", 2)])
@pytest.mark.slow_rows(1)
def test_several_files_and_repetitions_count_from_their_own_takeoffs(configuration, touchdown, flights):
    apart = load_configuration(configuration.folder, [f"missions.missions.2.touchdown_between_files={touchdown}"])
    flight = Flight(apart, "2", watchdog={"entities": ENTITIES})
    assert flight.end(900 * S) == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == WHOLE * flights


def test_a_component_that_comes_back_is_held_for_and_the_mission_goes_on(make):
    flight = make()
    flying(flight)
    flight.nodes["watchdog"].failing["mission_cam"] = ERROR  # severity high in this mission: hold
    flight.until(lambda: flight.state.state is State.HOLD)
    flight.run(4 * S)
    assert flight.planner[-1].phase is P.HOLDING
    del flight.nodes["watchdog"].failing["mission_cam"]
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == [ARM, TAKEOFF, HOLD, RESUME, LAND, DISARM]


def test_a_component_that_does_not_come_back_ends_the_flight_after_its_wait(make):
    flight = make()
    flying(flight)
    flight.nodes["watchdog"].failing["mission_cam"] = ERROR
    flight.until(lambda: flight.state.state is State.HOLD)
    began_ns = flight.t_ns
    flight.until(lambda: flight.state.state is State.LAND)
    assert (flight.t_ns - began_ns) / S == pytest.approx(15.0, abs=0.3)
    flight.end()
    assert flight.state.session.result is Result.LANDED_EARLY
    assert flight.requests() == [ARM, TAKEOFF, HOLD, LAND, DISARM]


def test_a_failure_of_the_highest_severity_lands_at_once(make):
    flight = make()
    flying(flight)
    flight.nodes["watchdog"].failing["px4_imu"] = ERROR
    began_ns = flight.t_ns
    flight.until(lambda: LAND in flight.requests())
    assert flight.t_ns - began_ns <= 0.6 * S  # a period of its watchdog
    flight.end()
    assert flight.state.session.result is Result.LANDED_EARLY


def test_a_rate_that_is_off_is_flown_on_with(make):
    flight = make()
    flying(flight)
    flight.nodes["watchdog"].failing["px4_imu"] = DEFECT  # its 4: our 2
    flight.end()
    assert flight.state.session.result is Result.COMPLETE


ORDERS = pytest.mark.parametrize(
    "first, latency_ns", [("log", 0), ("heartbeat", 0), ("log", 40 * MS), ("heartbeat", 40 * MS)]
)


@ORDERS
@pytest.mark.parametrize("rate_hz", [0.5, 2.0])
@pytest.mark.slow_rows
def test_a_component_that_is_flown_on_without_neither_holds_nor_lands_when_it_fails_and_comes_back(
    make, first, latency_ns, rate_hz
):
    flight = make(first=first, latency_ns=latency_ns, watchdog={"rate_hz": rate_hz})
    flying(flight)
    flight.nodes["watchdog"].failing["px4_gps"] = ERROR  # action continue
    flight.run(5 * S)
    flight.nodes["watchdog"].failing.clear()
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == WHOLE


@ORDERS
def test_nor_does_it_cancel_the_takeoff(make, first, latency_ns):
    flight = make(first=first, latency_ns=latency_ns)
    flight.until(lambda: ARM in flight.requests())
    flight.nodes["watchdog"].failing["px4_gps"] = ERROR
    flight.run(S)
    flight.nodes["watchdog"].failing.clear()
    assert flight.end() == "MISSION_ENDED"
    assert flight.requests() == WHOLE


@ORDERS
@pytest.mark.slow_rows
def test_an_error_of_which_the_log_was_missed_counts_from_the_second_heartbeat_that_says_it(make, first, latency_ns):
    flight = make(first=first, latency_ns=latency_ns)
    flying(flight)
    watchdog = flight.nodes["watchdog"]
    watchdog.faults["log_lost"] = True
    watchdog.failing["px4_gps"] = ERROR
    began_ns = flight.t_ns
    flight.until(lambda: flight.state.state is State.HOLD)  # of what nobody names, the row of high
    assert 0.5 * S < flight.t_ns - began_ns <= 1.1 * S  # a period of its watchdog after the first
    assert any("its watchdog says ERROR and its log was missed" in notice for notice in flight.notices)
    watchdog.faults["log_lost"] = False
    watchdog.failing.clear()
    assert flight.end() == "MISSION_ENDED"
    assert flight.requests() == [ARM, TAKEOFF, HOLD, RESUME, LAND, DISARM]


def test_while_its_heartbeat_and_its_log_say_two_things_a_check_is_repeated_and_neither_passes_nor_fails(configuration):
    peer = CnsWatchdog(configuration.rules, configuration.missions, 5.0)
    command = RunCheck(id=1, limit_ns=S, check=CheckName.WATCHDOG, mission_id="1", required=("lrf",))
    row = {"entity": "lrf", "type": 1, "name": "/lrf", "info": ""}

    def check(status=None, key="heartbeat"):
        if key == "heartbeat":
            peer.hear(S, key, namespace({"status": {**row, "status": status}}))
        else:
            peer.hear(S, key, namespace({"data": {"changes": [], "current": [{**row, "status": status}]}}))
        reply = peer.answer(S, command)
        return reply.ok, reply.fixable

    check(NOMINAL)
    assert check(NOMINAL, "log") == (True, False)
    assert check(ERROR) == (False, True)
    assert check(ERROR, "log") == (False, False)
    assert check(NOMINAL, "log") == (False, True)
    assert check(NOMINAL) == (True, False)


def test_an_abort_in_flight_is_a_landing_since_its_abort_does_nothing(make):
    flight = make()
    flying(flight)
    flight.ask(UserCommand.ABORT)
    flight.end()
    assert flight.requests() == WHOLE
    assert ABORT not in flight.requests()
    assert flight.state.session.result is Result.LANDED_EARLY
    assert not flight.vehicle.armed


def test_an_autopilot_that_refuses_to_arm_is_not_asked_for_ever(make):
    flight = make(mission_planner={"arms_never": True})
    assert flight.end() == "OUTREACH"
    assert flight.requests() == [ARM, DISARM]
    assert flight.vehicle.height_m == 0.0


def test_a_supervisor_that_never_answers_fails_its_check_in_time_and_is_not_asked_twice_at_once(make):
    flight = make(state_estimation={"silent": True})
    assert flight.end() == "OUTREACH"
    assert flight.t_ns < 40 * S
    assert any("estimator supervisor does not answer" in notice for notice in flight.notices), flight.notices
    assert flight.calls("state_estimation") == [("supervision", {})]


def test_a_recorder_that_says_yes_and_writes_nothing_is_found_out(make):
    flight = make(data_recorder={"lies": True})
    assert flight.end() == "OUTREACH"
    assert flight.requests() == []
    assert flight.calls("data_recorder")[0] == ("record", {"data": True})


def test_files_that_it_leaves_open_are_no_complete_recording(make):
    flight = make(data_recorder={"stays_open": True})
    assert flight.end() == "OUTREACH"
    assert any("are not closed" in notice for notice in flight.notices), flight.notices


@pytest.mark.parametrize("again", [False, True], ids=["", "peers' node started again meanwhile"])
def test_files_that_its_store_script_has_moved_away_were_recorded_and_are_not_verified(make, again):
    flight = make(data_recorder={"moves_away": True, "stop_s": 2.0})
    flight.until(lambda: len(flight.calls("data_recorder")) == 2)
    if again:
        flight.restart(3 * S)  # its script has ended then
    assert flight.end() == "OUTREACH"
    words = "recorded on main, then moved away by its store script: not verified here (/data/main)"
    assert any(words in notice for notice in flight.notices), flight.notices


def test_waypoints_out_of_its_bounds_are_refused_before_anything_is_sent(make):
    flight = make(bounds=Bounds((-1.0, -1.0, 0.0), (2.0, 2.0, 3.0)))
    assert flight.end() == "OUTREACH"
    assert flight.requests() == []
    reason = "waypoint 2: x is 3.00 m from its start; its sequencer would skip what is not within -1 to 2"
    assert any(reason in notice for notice in flight.notices), flight.notices


def test_a_waypoint_that_it_skips_all_the_same_is_told(make):
    flight = make(mission_planner={"skips": (2,)})
    flight.end()
    assert "its sequencer has skipped waypoint 2" in {status.message for status in flight.planner}


def test_a_sequencer_that_is_gone_in_flight_is_told_at_once_and_the_autopilot_lands(make):
    flight = make()
    flying(flight)
    flight.dead = ("mission_planner",)
    began_ns = flight.t_ns
    flight.until(lambda: flight.state.state is State.LAND)
    assert (flight.t_ns - began_ns) / S == pytest.approx(0.6, abs=0.05)  # not after planner_status_limit_s
    assert flight.planner[-1].message == "its sequencer is gone"
    flight.until(lambda: not flight.vehicle.armed)
    assert flight.requests() == [ARM, TAKEOFF]
    flight.end()
    assert flight.state.session.result is Result.LANDED_EARLY


@pytest.mark.parametrize("held", [False, True])
def test_the_peers_node_started_again_in_flight_goes_on_with_the_mission(make, held):
    flight = make()
    flying(flight)
    if held:
        flight.nodes["watchdog"].failing["mission_cam"] = ERROR
        flight.until(lambda: flight.planner[-1].phase is P.HOLDING)
        flight.run(2 * S)
        flight.nodes["watchdog"].failing.clear()  # while nobody hears it
    flight.restart()
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == ([ARM, TAKEOFF, HOLD, RESUME, LAND, DISARM] if held else WHOLE)
    assert (flight.planner[-1].waypoint, flight.planner[-1].waypoints) == (4, 4)
    assert len(flight.calls("watchdog")) == 1
    assert [fields["data"] for _, fields in flight.calls("data_recorder")] == [True, False]


def test_the_peers_node_started_again_while_it_stops_recording_says_what_came_of_it(make):
    flight = make()
    flight.until(lambda: len(flight.calls("data_recorder")) == 2)
    flight.restart()
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert len(flight.calls("data_recorder")) == 2


def test_the_peers_node_started_again_does_not_miss_what_has_failed_meanwhile(make):
    flight = make()
    flying(flight)
    flight.nodes["watchdog"].failing["px4_imu"] = ERROR  # its log of that is heard by nobody
    flight.restart()
    flight.until(lambda: HOLD in flight.requests(), 2 * S)  # of what nobody names, the row of high
    assert any("its watchdog says ERROR and its log was missed" in notice for notice in flight.notices)


def test_the_peers_node_started_again_in_a_takeoff_whose_end_it_missed_lands(make):
    flight = make()
    flight.until(lambda: flight.vehicle.height_m > 0.6)
    flight.restart()  # it comes to its height, and hovers
    flight.end()
    assert flight.requests() == [ARM, TAKEOFF, LAND, DISARM]
    assert flight.state.session.result is Result.LANDED_EARLY


def test_the_peers_node_started_again_that_missed_the_end_of_the_mission_does_not_hover_for_ever(make):
    flight = make()
    vehicle = flight.vehicle
    flight.until(lambda: vehicle.reached == 3)
    last = (vehicle.waypoints[3].x_m, vehicle.waypoints[3].y_m)
    flight.until(lambda: dist(vehicle.position_m[:2], last) < 0.5)
    flight.restart(4 * S)
    assert flight.nodes["mission_planner"]._state == "hover"
    flight.end(120 * S)
    assert flight.requests() == WHOLE
    assert flight.state.session.result is Result.LANDED_EARLY


def test_the_peers_node_started_again_that_missed_a_landing_can_fly_the_next_mission(make):
    flight = make()
    flight.until(lambda: LAND in flight.requests() and flight.vehicle.height_m < 0.3)
    flight.restart()
    flight.end()
    flight.select("1")
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE
    assert flight.requests() == [ARM, TAKEOFF, LAND, DISARM, *WHOLE]  # its first landing ends with that DISARM


def test_a_landing_that_is_asked_of_a_node_started_again_reaches_its_sequencer(make):
    flight = make()
    flying(flight)
    flight.restart()
    flight.ask(UserCommand.LAND)
    flight.end()
    assert flight.requests() == [ARM, TAKEOFF, LAND, DISARM]
    assert flight.state.session.result is Result.LANDED_EARLY


def test_a_watchdog_that_checks_every_two_seconds_is_flown_with_and_tells_a_failure_that_much_later(make):
    flight = make(watchdog={"rate_hz": 0.5})
    flying(flight)
    flight.run(10 * S)  # between two of its beats nothing is missed
    assert flight.state.state is State.MISSION
    flight.nodes["watchdog"].failing["px4_imu"] = ERROR
    began_ns = flight.t_ns
    flight.until(lambda: LAND in flight.requests())
    assert flight.t_ns - began_ns <= 2.1 * S
    flight.end()
    assert flight.state.session.result is Result.LANDED_EARLY


@pytest.mark.parametrize("rate_hz", [0.5, 2.0])
def test_a_mission_is_flown_to_its_end_at_whatever_rate_its_watchdog_checks(make, rate_hz):
    flight = make(watchdog={"rate_hz": rate_hz})
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert len(flight.calls("watchdog")) == 1


def test_at_half_a_hertz_a_watchdog_that_stops_beating_lands_after_the_limit_that_is_imported(make, configuration):
    flight = make(watchdog={"rate_hz": 0.5})
    flying(flight)
    flight.nodes["watchdog"].faults["silent"] = True
    began_ns = flight.t_ns
    flight.until(lambda: LAND in flight.requests())
    limit_ns = configuration.rules.limits.watchdog_heartbeat_limit_ns
    assert limit_ns - 2 * S <= flight.t_ns - began_ns <= limit_ns + S


@pytest.mark.parametrize("rate_hz", [0.5, 2.0])
def test_a_start_that_says_no_while_entities_start_is_not_asked_again_and_waited_for(make, configuration, rate_hz):
    wait_s = configuration.rules.limits.watchdog_startup_time_ns / S + 2 / rate_hz
    flight = make(watchdog={"rate_hz": rate_hz, "starting_s": wait_s + 10.0})
    watchdog = flight.nodes["watchdog"]
    flight.until(lambda: watchdog.answers)
    assert watchdog.answers == [False]
    assert flight.state.state is State.PREFLIGHT
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert len(flight.calls("watchdog")) == 1


def test_a_second_start_of_the_stand_in_begins_anew_and_says_no():
    watchdog = Watchdog(None, ("lrf",), starting_s=2.0)
    for second in (0, 10):
        watchdog.call(second * S, "watchdog_start", {"startup_time": 0.0 if second else 5.0})
        for half in range(19):
            watchdog.step(second * S + half * S // 2)
    assert watchdog.answers == [True, False]


def test_a_watchdog_that_stops_beating_in_flight_lands(make):
    flight = make()
    flying(flight)
    flight.nodes["watchdog"].faults["silent"] = True
    began_ns = flight.t_ns
    flight.until(lambda: LAND in flight.requests())
    assert (flight.t_ns - began_ns) / S == pytest.approx(6.0, abs=0.6)  # as import-cns writes it


def test_after_a_takeover_the_next_mission_is_loaded_once_its_sequencer_has_ended_the_last_one(make):
    flight = make()
    flying(flight)
    flight.vehicle.pilot_takes_over("POSCTL", 5 * S)
    flight.until(lambda: flight.state.state is State.PILOT)
    flight.until(lambda: not flight.vehicle.armed)
    flight.run(3 * S)
    flight.ask(UserCommand.ACKNOWLEDGE)
    assert flight.end() == "MISSION_ENDED"
    flight.vehicle.pilot_gives_back()
    flight.run(S)
    flight.select("1")
    flight.until(lambda: flight.state.state is State.OUTREACH)
    words = "its sequencer is still in its last mission, which is being ended: try again"
    assert any(words in notice for notice in flight.notices), flight.notices
    flight.run(5 * S)
    assert (flight.planner[-1].phase, flight.requests()) == (P.LANDED, WHOLE)
    flight.ask(UserCommand.RETRY)
    flight.until(lambda: flight.state.state is not State.OUTREACH)
    assert flight.end() == "MISSION_ENDED"
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert flight.requests() == WHOLE * 2


def test_a_mission_of_the_session_that_flies_is_not_ended_by_a_load(make):
    flight = make()
    flying(flight)
    session, before = flight.state.session.id, flight.requests()
    command = LoadMission(id=99, limit_ns=S, session_id=session, mission_id="1", file_index=0, repetition=0)
    reply = flight.peers["mission_planner"].answer(flight.t_ns, command)
    flight.run(S)
    assert reply.message.startswith("its sequencer is in a mission (phase FLYING), and the vehicle is armed")
    assert flight.requests() == before


@pytest.mark.parametrize("phase, restarted", [(P.TAKING_OFF, False), (P.FLYING, False), (P.FLYING, True)])
def test_a_load_of_another_session_changes_nothing_while_the_vehicle_is_armed(make, phase, restarted):
    flight = make()
    flight.until(lambda: flight.planner[-1:] and flight.planner[-1].phase is phase and flight.vehicle.armed)
    if restarted:
        flight.restart(S // 5)
        flight.run(S // 2)
    before = flight.requests()
    command = LoadMission(id=99, limit_ns=S, session_id="by_hand", mission_id="1", file_index=0, repetition=0)
    reply = flight.peers["mission_planner"].answer(flight.t_ns, command)
    flight.run(S // 2)
    words = "and the vehicle is armed, or was just asked for something"
    assert reply.message == f"its sequencer is in a mission (phase {phase.name}), {words}"
    assert flight.requests() in (before, [*before, TAKEOFF])


def test_where_it_is_not_known_whether_the_vehicle_is_armed_a_load_changes_nothing_in_flight(make):
    flight = make()
    flying(flight)
    before = flight.requests()
    planner = flight.peers["mission_planner"]
    command = LoadMission(id=99, limit_ns=S, session_id="by_hand", mission_id="1", file_index=0, repetition=0)
    words = "its sequencer is in a mission (phase FLYING), and it is not known whether the vehicle is armed"
    assert planner.answer(flight.t_ns + 2 * S, command).message == words
    planner.see_vehicle(flight.t_ns, armed=None)
    assert planner.answer(flight.t_ns, command).message == words
    flight.run(S)
    assert flight.requests() == before


def test_a_hold_or_resume_does_not_interrupt_the_landing_that_was_asked_for_and_is_not_answered_yet(make):
    flight = make()
    planner = flight.peers["mission_planner"]
    flight.until(lambda: flight.requests() and flight.requests()[-1] == LAND)
    assert planner._phase is P.FLYING
    for action in (MissionAction.HOLD, MissionAction.RESUME):
        command = MissionCommand(id=99, limit_ns=S, session_id=flight.state.session.id, action=action)
        assert planner.answer(flight.t_ns, command).message == f"it lands: there is nothing to {action.name}"
    assert flight.end() == "MISSION_ENDED"
    assert flight.requests() == WHOLE


def test_a_vehicle_that_does_not_stand_flat_does_not_take_off(make):
    flight = make(landing_detection={"not_flat": True})
    assert flight.end() == "OUTREACH"
    assert any("not flat" in notice for notice in flight.notices), flight.notices


def levels(flight):
    """Return the levels that were said, and why, each once."""
    found = []
    for status in flight.landed:
        if not found or found[-1] != (status.landed, status.reason):
            found.append((status.landed, status.reason))
    return found


ARMED, TOOK_OFF = "its detector was armed on the ground", "its detector said takeoff"
AGAIN = "its landing detector was away: unknown until its next event"


@pytest.mark.parametrize(
    "in_flight, known",
    [(False, [(Landed.ON_GROUND, ARMED)]), (True, [(Landed.ON_GROUND, ARMED), (Landed.AIRBORNE, TOOK_OFF)])],
    ids=["before it lifts off", "in flight"],
)
def test_a_landing_detector_started_again_is_not_believed_by_what_the_last_one_said(make, in_flight, known):
    flight = make()
    flight.until(lambda: ARM in flight.requests())
    if in_flight:
        flying(flight)
    flight.restart_node("landing_detection", 4 * S if not in_flight else 2 * S)
    assert flight.end() == "MISSION_ENDED"
    first = (Landed.UNKNOWN, "its landing detector has said nothing yet")
    gone = (Landed.UNKNOWN, "its landing detector is not there")
    assert levels(flight) == [first, *known, gone, (Landed.UNKNOWN, AGAIN)]
    assert not flight.vehicle.armed
    flight.select("1")
    assert flight.end() == "MISSION_ENDED"  # its check has armed it again
    assert flight.state.session.result is Result.COMPLETE, "\n".join(flight.notices)
    assert [landed for landed, _ in levels(flight)][-3:] == [Landed.ON_GROUND, Landed.AIRBORNE, Landed.ON_GROUND]


def test_what_a_landing_detector_answers_before_its_topics_are_connected_is_kept(configuration):
    peer = LandingDetection(configuration.rules, 5.0)
    peer.alive = False
    peer.step(0)
    peer.returned(0, "takeoff_check", namespace({"success": True, "message": ""}), "")
    peer.step(S)
    peer.alive = True
    (status,) = peer.step(2 * S)
    assert (status.landed, status.reason) == (Landed.ON_GROUND, ARMED)


# --- metres east and north, for a sequencer that counts ahead and left ------------------------------------------------


class Turned:
    """A sequencer whose mission is in metres east and north, on a vehicle with a heading.

    Args:
        configuration: whose first mission has the waypoints.
        waypoints: x east, y north, z up, yaw counter-clockwise from east in radians, hold in seconds.
    """

    def __init__(self, configuration, *waypoints):
        trajectory = Trajectory("legs.csv", tuple(starmap(Waypoint, waypoints)), frame=Frame.EAST_NORTH)
        plan = replace(configuration.plans[0], trajectories=(trajectory, trajectory))
        self.planner = Sequencer([plan], configuration.rules.limits, 1.0, Bounds((-20, -20, 0), (20, 20, 5)))

    def load(self, t_ns=0, file_index=0, repetition=0):
        fields = {"session_id": "s", "mission_id": "1", "file_index": file_index, "repetition": repetition}
        return self.planner.answer(t_ns, LoadMission(id=1, limit_ns=S, **fields))

    def command_takeoff(self, t_ns):
        command = MissionCommand(id=2, limit_ns=S, session_id="s", action=MissionAction.TAKEOFF)
        return self.planner.answer(t_ns, command)

    def take_off(self, t_ns=0):
        """Command it and say yes to everything; return the waypoints that its sequencer is sent."""
        reply = self.command_takeoff(t_ns)
        assert reply is None, reply.message
        for request in (ARM, TAKEOFF):
            self.hear(t_ns, request)
        return [tuple(each.values()) for each in self.planner.outbox[-1].fields["waypoints"]]

    def hear(self, t_ns, request):
        said = {"request": {"id": 1, "request": request}, "response": False, "completed": True}
        self.planner.hear(t_ns, "response", namespace(said))


@pytest.mark.parametrize(
    "heading_deg, east, north",
    [
        # It looks east: what is 10 m east is ahead, what is 10 m north is left. Yaws count from its heading: none.
        (0, (10, 0, 0), (0, 10, 90)),
        # It looks north: east is on its right, which is less than nothing to the left, and 90 degrees clockwise.
        (90, (0, -10, -90), (10, 0, 0)),
        # It looks 20 degrees south of west. East is behind it, 10 cos 20 = 9.397 m, and, as it is turned left beyond
        # west, on its left, 10 sin 20 = 3.420 m; to look there it turns 160 left. North is on its right, 9.397 m, and
        # behind it, 3.420 m; to look there it turns 110 right.
        (200, (-9.397, 3.420, 160), (-3.420, -9.397, -110)),
        (-160, (-9.397, 3.420, 160), (-3.420, -9.397, -110)),
    ],
)
def test_east_and_north_become_ahead_and_left_of_the_heading_at_the_start(configuration, heading_deg, east, north):
    turned = Turned(configuration, (10.0, 0.0, 2.0, 0.0, 1.0), (0.0, 10.0, 3.0, radians(90), 4.0))
    turned.planner.turn(0, radians(heading_deg))
    assert turned.load().outcome is Outcome.ACCEPTED
    sent = turned.take_off()
    assert sent[0] == pytest.approx((east[0], east[1], 2, east[2], 1), abs=0.001)
    assert sent[1] == pytest.approx((north[0], north[1], 3, north[2], 4), abs=0.001)


def test_a_vehicle_that_was_turned_after_loading_flies_by_its_heading_at_the_takeoff(configuration):
    turned = Turned(configuration, (10, 0, 2, 0, 1))
    turned.planner.turn(0, 0.0)
    assert turned.load().outcome is Outcome.ACCEPTED
    turned.planner.turn(60 * S, radians(90))  # east is on its right now
    assert turned.take_off(60 * S) == [pytest.approx((0, -10, 2, -90, 1), abs=0.001)]


@pytest.mark.parametrize("heard_ns, why", [(None, "no fresh heading"), (0, "no fresh heading"), (S // 10, "")])
def test_without_a_fresh_heading_metres_east_are_refused(configuration, heard_ns, why):
    turned = Turned(configuration, (10, 0, 2, 0, 1))
    if heard_ns is not None:
        turned.planner.turn(heard_ns, 0.0)
    reply = turned.load(S + S // 10)  # it may be 1 s old
    assert (reply.outcome is Outcome.ACCEPTED, why in reply.message) == (not why, True)


def test_nor_does_it_take_off_without_one(configuration):
    turned = Turned(configuration, (10, 0, 2, 0, 1))
    turned.planner.turn(0, 0.0)
    assert turned.load().outcome is Outcome.ACCEPTED
    reply = turned.command_takeoff(2 * S)
    assert reply.outcome is not Outcome.ACCEPTED
    assert "no fresh heading" in reply.message
    assert turned.planner.outbox == []


def test_a_file_that_the_mission_lost_while_the_peers_node_was_started_again_is_not_flown(configuration):
    turned, again = (Turned(configuration, (10, 0, 2, 0, 1)) for _ in range(2))
    turned.planner.turn(0, 0.0)
    assert turned.load().outcome is Outcome.ACCEPTED
    kept = turned.planner.kept()
    kept["loaded"][2] = 2  # of the two that it has now, the third one
    again.planner.restore(0, kept)
    again.planner.turn(0, 0.0)
    reply = again.command_takeoff(0)
    assert (reply.outcome, reply.message) == (Outcome.REFUSED, "mission 1 has 2 waypoint files")
    assert again.planner.outbox == []


@pytest.mark.parametrize("file_index, repetition", [(1, 0), (0, 1)])
def test_metres_east_of_the_first_takeoff_are_refused_for_another_one(configuration, file_index, repetition):
    turned = Turned(configuration, (10, 0, 2, 0, 1))
    turned.planner.turn(0, 0.0)
    reply = turned.load(0, file_index, repetition)
    assert reply.outcome is not Outcome.ACCEPTED
    assert "only the first file may be east_north" in reply.message


def test_bounds_are_of_what_is_ahead_and_left(configuration):
    turned = Turned(configuration, (15, 15, 2, 0, 1))  # on the diagonal, 21.2 m ahead
    turned.planner.turn(0, radians(45))
    assert turned.load().message.startswith("waypoint 1: x is 21.21 m from its start")


# --- checks that it does not make -------------------------------------------------------------------------------------


@pytest.mark.parametrize("optional", [False, True])
def test_a_check_that_its_stack_does_not_make_is_told_so_and_passes_only_where_it_is_optional(optional):
    service = Service("data_recorder/check", "CheckAutopilot", RunCheck, CheckName.BATTERY, "ok", optional=optional)
    command = RunCheck(id=7, limit_ns=S, check=CheckName.BATTERY)
    reply = Recorder({"main": "~"}, S, S, 2.0).carry_out(S, service, command)
    assert (reply.command_id, reply.check, reply.ok) == (7, CheckName.BATTERY, optional)
    assert [(row.name, row.verdict) for row in reply.checks] == [
        ("battery", Verdict.WARN if optional else Verdict.UNKNOWN)
    ]
    assert reply.checks[0].advice == "the CNS Flight Stack has no such check"
