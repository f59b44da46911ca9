"""Stories of the planner with the simulated PX4, in virtual time: what the vehicle did, and what was said of it."""

from __future__ import annotations

import math
from dataclasses import replace
from random import Random

import pytest
from flying import ARDUPILOT, ARM, BACK, LIMITS, LINE, MS, PLANS, PX4, Flying, Recorded, S, plan, stand_still
from mission_channel import good

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.link.state_files import origin_from, origin_to
from amaze_autonomy.autopilot.planner.loading import LoadRequest, climb_of, takeoff_item_m
from amaze_autonomy.autopilot.planner.mission_upload import Dialect
from amaze_autonomy.autopilot.planner.mission_vehicle import AIRBORNE, VehicleWatch
from amaze_autonomy.autopilot.vehicle.agreement import PowerOn
from amaze_autonomy.engine.commands import AnswerKind, MissionAction
from amaze_autonomy.engine.decide import ANSWERS
from amaze_autonomy.engine.events import MissionPhase, MissionStatus, UserCommand, VehicleLanded
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.engine.state import State
from amaze_autonomy.missions import Controller, Frame, Home, Trajectory, Waypoint
from amaze_autonomy.simulation.px4 import Px4Settings

P, A = MissionPhase, MissionAction
WHOLE = [P.IDLE, P.LOADED, P.TAKING_OFF, P.FLYING, P.LANDING, P.LANDED]
BOTH = pytest.mark.parametrize("mission", ["line", "inside"])
WHERE_IT_LANDS = (8.0, 6.0)


def near(flying, x, y, within=0.6):
    east, north, _ = flying.craft.position_m
    return abs(east - x) < within and abs(north - y) < within


@BOTH
def test_a_file_is_flown_from_takeoff_to_landing(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until_phase(P.LANDED)
    assert flying.phases == WHOLE
    assert near(flying, *WHERE_IT_LANDS)
    assert flying.status == MissionStatus(
        t_ns=flying.t_ns,
        session_id="s1",
        mission_id=mission,
        phase=P.LANDED,
        waypoint=3,
        waypoints=3,
        distance_left_m=0.0,
        time_left_s=0.0,
    )


@BOTH
def test_what_is_left_gets_less_and_the_waypoint_goes_up(mission):
    flying = Flying()
    flying.take_off(mission)
    seen = []
    while flying.phase is not P.LANDED:
        flying.run(500 * MS)
        seen.append(flying.status)
    flown = [status for status in seen if status.phase in (P.FLYING, P.LANDING)]
    assert [status.waypoint for status in flown] == sorted(status.waypoint for status in flown)
    assert {status.waypoint for status in flown} == {1, 2, 3}
    lengths = [status.distance_left_m for status in flown]
    assert all(later <= earlier + 0.3 for earlier, later in zip(lengths, lengths[1:]))
    assert lengths[0] == pytest.approx(15.0, abs=1.5)
    assert flown[-1].time_left_s == 0.0


@BOTH
def test_it_holds_where_it_is_and_resumes_where_it_stopped(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(A.HOLD) == ""
    flying.until_phase(P.HOLDING, limit_ns=3 * S)
    held, waypoint = flying.craft.position_m, flying.status.waypoint
    assert waypoint == 2
    flying.run(10 * S)
    assert flying.phase is P.HOLDING
    assert max(abs(a - b) for a, b in zip(flying.craft.position_m, held)) < 1.0
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.FLYING, limit_ns=5 * S)
    assert flying.status.waypoint == waypoint
    flying.until_phase(P.LANDED)
    assert (flying.status.waypoint, near(flying, *WHERE_IT_LANDS)) == (3, True)


@BOTH
def test_a_landing_on_the_way_says_which_waypoint_was_reached_last(mission):
    """Nobody shall take the one that it flew to for flown: the mission is not complete."""
    flying = Flying()
    flying.take_off(mission)
    flying.until(lambda: flying.status.waypoint == 3)
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDING, limit_ns=3 * S)
    assert flying.status.waypoint == 2


@BOTH
def test_a_hold_during_the_takeoff_is_resumed_as_well(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.height_m > 0.3)
    assert flying.command(A.HOLD) == ""
    flying.until_phase(P.HOLDING, limit_ns=3 * S)
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


@BOTH
def test_hold_and_resume_at_once_end_as_the_last_one_said(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until_phase(P.FLYING)
    flying.run(S)
    for first, last, phase in ((A.HOLD, A.RESUME, P.FLYING), (A.RESUME, A.HOLD, P.HOLDING)):
        flying.command(first)
        assert flying.command(last) == ""
        flying.run(3 * S)
        assert flying.phase is phase


@BOTH
def test_it_lands_early_where_it_is(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDED)
    assert near(flying, 4.0, 0.0, 2.0)
    assert flying.status.waypoint == 1  # not the last: the mission is not complete


@BOTH
def test_an_abort_in_flight_lands_and_on_the_ground_disarms(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.armed)
    assert flying.command(A.ABORT) == ""
    flying.until_phase(P.LANDED, limit_ns=10 * S)
    assert (flying.craft.armed, flying.craft.height_m, flying.status.waypoint) == (False, 0.0, 0)
    flying.run(3 * S)  # within which what was commanded might still take effect
    flying.take_off(mission)
    flying.until_phase(P.FLYING)
    assert flying.command(A.ABORT) == ""
    flying.until_phase(P.LANDED)
    assert flying.craft.armed is False


AHEAD = Trajectory(
    "ahead.csv",
    (Waypoint(0.0, 0.0, 2.0, 0.0, 0.5), Waypoint(6.0, 2.0, 2.0, math.pi / 2, 0.5)),
    frame=Frame.START_HEADING,
)


@pytest.mark.parametrize("controller", list(Controller))
def test_waypoints_ahead_and_left_are_flown_from_each_takeoff_as_it_heads_there(controller):
    flying = Flying(plans=(plan("ahead", (AHEAD,), controller, 2),))
    flying.craft.yaw_rad = math.pi / 2  # north: ahead is north, left is west
    flying.run(2 * S)
    flying.take_off("ahead")
    flying.until_phase(P.LANDED)
    assert near(flying, -2.0, 6.0)
    assert abs(flying.craft.yaw_rad) == pytest.approx(math.pi, abs=0.3)  # west: a quarter left of north
    flying.run(3 * S)
    flying.take_off("ahead", 0, 1)  # heads west now: ahead is west, left is south
    flying.until_phase(P.LANDED)
    assert near(flying, -2.0 - 6.0, 6.0 - 2.0, 1.2)


@pytest.mark.parametrize("controller", list(Controller))
@pytest.mark.parametrize("turned_deg, taken", [(10.0, True), (-90.0, False), (170.0, False)])
def test_a_vehicle_that_was_turned_since_the_load_flies_no_other_way_than_ahead(controller, turned_deg, taken):
    flying = Flying(plans=(plan("ahead", (AHEAD,), controller),))
    flying.craft.yaw_rad = math.radians(175.0)
    flying.run(S)
    assert flying.load("ahead").accepted
    flying.craft.yaw_rad += math.radians(turned_deg)
    flying.run(S)
    refused = f"load it again: it was turned by {abs(turned_deg):.0f} degrees since"
    assert flying.command(A.TAKEOFF) == ("" if taken else refused)


@pytest.mark.parametrize("controller", list(Controller))
def test_without_a_fresh_heading_what_is_ahead_is_not_taken_off_with(controller):
    flying = Flying(plans=(plan("ahead", (AHEAD,), controller),))
    assert flying.load("ahead").accepted
    flying.channel._wanted -= {"ATTITUDE"}
    flying.run(4 * S)
    assert flying.command(A.TAKEOFF) == "there is no fresh heading, and the waypoints count from it"


@pytest.mark.parametrize("controller", list(Controller))
def test_without_a_fresh_heading_waypoints_that_count_from_it_are_not_loaded(controller):
    flying = Flying(plans=(plan("ahead", (AHEAD,), controller), plan("line", (LINE,), controller)))
    flying.planner.watch.yaw_ns -= 60 * S
    ahead, messages = flying.planner.load(flying.t_ns, LoadRequest("s1", "ahead", 0, 0))
    assert (ahead.refused, ahead.reason) == (True, "there is no fresh heading, and the waypoints count from it")
    assert (list(messages), flying.phase) == ([], P.IDLE)
    assert not flying.planner.load(flying.t_ns, LoadRequest("s1", "line", 0, 0))[0].refused


@pytest.mark.parametrize("mission", ["both", "inside twice"])
def test_several_files_and_repetitions_with_touchdowns_between(mission):
    flying = Flying()
    for repetition in (0, 1):
        for file_index, trajectory in enumerate((LINE, BACK)):
            flying.take_off(mission, file_index, repetition)
            assert (flying.status.file_index, flying.status.repetition) == (file_index, repetition)
            flying.until_phase(P.LANDED)
            last = trajectory.waypoints[-1]
            assert near(flying, last.x_m, last.y_m), flying.craft.position_m
            assert flying.status.waypoint == len(trajectory.waypoints)
    sending = (
        WHOLE[:1] if mission == "both" else []
    )  # a mission takes a moment to be sent; set-points are not sent before
    assert flying.phases == WHOLE + (sending + WHOLE[1:]) * 3


FAR = "the vehicle stands 10.0 m from where the file before ends, at most 5 m are good"


@pytest.mark.parametrize("mission", ["both", "inside twice"])
def test_a_later_file_is_not_loaded_elsewhere_than_where_the_file_before_ends(mission):
    """Its first leg, its fence and its battery were checked from there."""
    flying = Flying()
    assert flying.load(mission).accepted
    assert (flying.load(mission, 1).reason, flying.phase) == (FAR, P.LOADED)
    flying.take_off(mission)
    flying.until_phase(P.LANDED)
    assert flying.load(mission, 0, 1).reason == FAR
    for _ in range(2):  # a takeoff that failed is tried again where it stands
        assert flying.load(mission, 1).accepted
    assert flying.command(A.TAKEOFF) == ""
    flying.until_phase(P.LANDED)
    assert flying.load(mission, 0, 1).accepted


@pytest.mark.parametrize("mission", ["both", "inside twice"])
def test_after_an_early_landing_the_next_file_is_loaded_only_near_the_end_of_that_one(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until_phase(P.FLYING)
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDED)
    assert "from where the file before ends" in flying.load(mission, 1).reason
    assert flying.load(mission).accepted


LOW = Trajectory("low.csv", tuple(Waypoint(2.0 * number, 0.0, z, 0.0, 0.0) for number, z in enumerate((1.0, 0.6, 0.6))))


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize("controller", list(Controller))
def test_a_file_that_begins_at_the_takeoff_height_and_goes_lower_reaches_it_first(controller, kind):
    """The engine waits for that very height, and lands out of a climb that never reaches it."""
    flying = Flying(plans=(plan("low", (LOW,), controller),), kind=kind)
    flying.take_off("low")
    begun = []
    flying.until(lambda: begun.append(flying.craft.height_m) or flying.phase is P.FLYING)
    assert max(begun) > 1.05
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


@pytest.mark.parametrize(
    "own_m, limit_m, climb, items_m",
    [
        (None, 30.0, (1.2, 1.1), (2.0, 1.5)),
        (1.5, 30.0, (1.2, 1.1), (1.25, 1.25)),
        (None, 1.2, (1.1, 1.05), (1.1, 1.1)),
    ],
)
def test_a_climb_passes_the_takeoff_height_and_stays_below_the_height_limit(own_m, limit_m, climb, items_m):
    line = plan("line", (LINE,), Controller.MISSION)
    line = replace(line, mission=replace(line.mission, max_height_m=own_m))
    limits = Limits(takeoff_height_m=1.0, max_height_m=limit_m)
    assert climb_of(line, limits) == pytest.approx(climb)
    assert [takeoff_item_m(line, limits, dialect) for dialect in Dialect] == pytest.approx(items_m)


def drifted(flying, up_m=0.0, east_m=0.0, north_m=0.0):
    """Have the local frame drift or jump: what stands at 0 is said to stand so much higher, east, north."""
    take, wake = flying.vehicle.take, flying.vehicle.wake

    def lowered(t_ns, message):
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            message.x, message.y, message.z = message.x - north_m, message.y - east_m, message.z + up_m
        return take(t_ns, message)

    def raised(t_ns):
        messages = wake(t_ns)
        for message in messages:
            if message.get_type() == "LOCAL_POSITION_NED":
                message.x, message.y, message.z = message.x + north_m, message.y + east_m, message.z - up_m
        return messages

    flying.vehicle.take, flying.vehicle.wake = lowered, raised


@pytest.mark.parametrize("up_m", [1.2, -1.2])
def test_by_set_points_each_file_is_flown_at_its_heights_above_where_it_takes_off(up_m):
    flying = Flying()
    flying.take_off("inside twice")
    flying.until_phase(P.LANDED)
    drifted(flying, up_m)
    flying.run(2 * S)
    heights = []
    flying.take_off("inside twice", 1)
    flying.until_phase(P.FLYING)
    assert flying.craft.position_m[2] >= 1.0 - 0.5  # of acceptance
    assert near(flying, *WHERE_IT_LANDS)
    assert flying.status.distance_left_m == pytest.approx(11.0, abs=0.7)

    def down():
        heights.append(flying.craft.height_m)
        return flying.phase is P.LANDED

    flying.until(down)
    assert max(heights) == pytest.approx(2.0, abs=0.1)
    assert flying.status.waypoint == 2


def test_waypoints_that_no_file_has_count_from_their_own_takeoff_in_one_session_too():
    flying = Flying(plans=())
    for number, east_m in enumerate((8.0, 16.0)):
        given = plan(f"given {number}", (LINE,), Controller.MISSION)
        loading, messages = flying.planner.load(flying.t_ns, LoadRequest("s1", given.mission.id, 0, 0), given)
        flying.channel.ours(messages)
        flying.until(lambda sent=loading: sent.over)
        assert flying.command(A.TAKEOFF) == ""
        flying.until_phase(P.LANDED)
        assert flying.craft.position_m[0] == pytest.approx(east_m, abs=0.8)


def test_the_second_mission_does_not_finish_on_the_ground():
    """PX4 keeps the number of the item when none is marked: its second mission would be over at once."""
    flying = Flying()
    flying.take_off("line")
    flying.until_phase(P.LANDED)
    assert flying.craft.current == 4  # the landing of the first one
    assert flying.load("line", session="s2").accepted
    assert flying.craft.current == 0
    assert flying.command(A.TAKEOFF, "s2") == ""
    flying.run(3 * S)
    assert flying.phase in (P.TAKING_OFF, P.FLYING)
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


def test_a_repeated_item_reached_of_the_flight_before_counts_nothing():
    flying = Flying()
    flying.take_off("line")
    flying.until_phase(P.LANDED)
    flying.take_off("line")
    flying.until(lambda: flying.craft.armed)
    for _ in range(3):
        flying.channel.ours(flying.planner.receive(flying.t_ns, mavlink.MAVLink_mission_item_reached_message(3)))
        flying.run(200 * MS)
        assert flying.status.waypoint <= 1


@BOTH
def test_the_pilot_takes_over_and_nothing_more_is_sent(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.craft.pilot_takes_over("POSCTL", 20 * S)
    flying.run(1500 * MS)
    assert flying.status.message == "the pilot has control (mode POSCTL)"
    flying.channel.sent.clear()
    for action in A:
        assert flying.command(action) == "the pilot has control (mode POSCTL)"
    assert flying.planner.shutdown(flying.t_ns) == (False, ())
    flying.run(3 * S)
    assert set(flying.channel.sent) <= {"COMMAND_LONG"}  # streams are asked for again, nothing else
    assert flying.craft.mode == "POSCTL"
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint < 3


def set_points(flying):
    return flying.channel.sent.count("SET_POSITION_TARGET_LOCAL_NED")


EACH = pytest.mark.parametrize("kind", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])


@EACH
@pytest.mark.parametrize("mode", ["POSCTL", "AUTO.LOITER", "AUTO.RTL", "AUTO.LAND"])
@pytest.mark.parametrize("action", [None, A.HOLD, A.LAND])
@pytest.mark.slow_rows
def test_once_taken_over_nothing_is_flown_by_set_points_until_it_is_asked_for(kind, mode, action):
    """An ArduCopter's pilot who picks GUIDED flies by whatever set-points there are: there are none of ours."""
    flying = Flying(kind=kind)
    flying.take_off("inside")
    flying.until(lambda: flying.craft.position_m[0] > 1.0)
    if action is not None:
        flying.craft.flags.ignores = ("AUTO.LAND",)
        assert flying.command(action) == ""
        flying.run(100 * MS)
    flying.craft.pilot_takes_over(mode, 600 * S)
    flying.run(1500 * MS)  # two heartbeats of a PX4
    before = set_points(flying)
    flying.run(3 * S)
    flying.craft.pilot_gives_back()
    flying.craft.command_mode("OFFBOARD")
    flying.run(6 * S)
    assert set_points(flying) == before


def test_a_takeoff_that_somebody_else_comes_before_leaves_no_set_points_behind():
    flying = Flying()
    flying.craft.flags.not_ready["rc"] = "no RC"
    flying.take_off("inside")
    flying.until(lambda: flying.craft.mode == "OFFBOARD", 5 * S)
    flying.run(2 * S)
    flying.craft.command_mode("AUTO.LOITER")
    flying.until(lambda: "takeoff ended" in flying.status.message, 3 * S)
    before = set_points(flying)
    flying.craft.flags.not_ready.clear()
    flying.craft.pilot_takes_over("OFFBOARD", 600 * S)
    flying.craft.pilot_arms()
    flying.run(3 * S)
    assert set_points(flying) == before


@EACH
def test_a_vehicle_that_is_given_back_is_flown_on_when_the_engine_asks_for_it(kind):
    flying = Flying(kind=kind)
    flying.take_off("inside")
    flying.until(lambda: flying.craft.position_m[0] > 1.0)
    flying.craft.pilot_takes_over("POSCTL", 600 * S)
    flying.run(2 * S)
    flying.craft.pilot_gives_back()
    flying.run(2 * S)
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


@BOTH
def test_the_autopilot_returns_by_itself_and_is_not_called_back(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.craft.enter_failsafe("AUTO.RTL")
    flying.run(1500 * MS)
    assert flying.status.message == "the autopilot flies by itself (mode AUTO.RTL)"
    assert flying.command(A.RESUME) == "the autopilot flies by itself (mode AUTO.RTL)"
    assert flying.command(A.HOLD) == "the autopilot flies by itself (mode AUTO.RTL)"
    flying.until_phase(P.LANDED)


def test_a_pilot_who_takes_over_while_a_command_is_under_way_keeps_control():
    flying = Flying()
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.craft.flags.ignores = ("AUTO.LOITER",)  # else it would be done at once
    assert flying.command(A.HOLD) == ""
    flying.run(250 * MS)
    flying.craft.pilot_takes_over("POSCTL", 20 * S)
    flying.craft.flags.ignores = ()
    flying.run(6 * S)
    assert (flying.craft.mode, flying.status.message) == ("POSCTL", "the pilot has control (mode POSCTL)")


@BOTH
def test_a_vehicle_that_does_not_arm_is_left_as_it_is_with_the_reason(mission):
    flying = Flying()
    flying.craft.flags.not_ready["rc"] = "no RC"
    flying.take_off(mission)
    flying.until_phase(P.FAILED, limit_ns=12 * S)
    assert flying.status.waypoint == 0
    assert flying.status.message.startswith("arm: not shown within 4 s (")
    assert "TEMPORARILY_REJECTED" in flying.status.message
    assert flying.craft.armed is False


def test_an_abort_that_comes_too_late_for_the_ground_lands():
    flying = Flying()
    flying.take_off("line")
    flying.until(lambda: flying.craft.height_m > 0.0)
    assert flying.command(A.ABORT) == ""  # the planner has not heard yet that it left the ground
    flying.until_phase(P.LANDED)
    assert (flying.craft.height_m, flying.craft.armed, flying.status.waypoint) == (0.0, False, 0)


def test_a_vehicle_that_disarms_by_itself_before_it_lifts_off_has_not_flown():
    flying = Flying()
    flying.craft.flags.does_not_lift_off = True
    flying.take_off("line")
    flying.until(lambda: flying.craft.armed)
    flying.run(5 * S)
    assert flying.phase is P.TAKING_OFF
    assert flying.craft.disarm() == ""
    flying.until_phase(P.LANDED, limit_ns=3 * S)
    assert (flying.status.waypoint, flying.status.message) == (0, "disarmed before it lifted off")


def test_a_vehicle_that_ignores_a_hold_is_not_said_to_hold():
    flying = Flying()
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 1.0)
    flying.craft.flags.ignores = ("AUTO.LOITER",)
    assert flying.command(A.HOLD) == ""
    flying.run(2 * S)
    assert flying.phase is P.FLYING
    flying.until(lambda: "not shown" in flying.status.message, 10 * S)
    assert flying.status.message == "change to AUTO.LOITER: not shown within 4 s (mode AUTO.MISSION, armed)"


def test_a_landing_is_commanded_again_until_it_is_shown():
    flying = Flying()
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 1.0)
    flying.craft.flags.ignores = ("AUTO.LAND",)
    flying.channel.sent.clear()
    assert flying.command(A.LAND) == ""
    flying.run(5 * S)
    assert "change to AUTO.LAND: not shown within 4 s" in flying.status.message
    flying.craft.flags.ignores = ()
    flying.until_phase(P.LANDING, limit_ns=3 * S)
    flying.until_phase(P.LANDED)


# --- refusals ---------------------------------------------------------------------------------------------------------


def refused(flying, *request) -> str:
    loading, messages = flying.planner.load(flying.t_ns, LoadRequest(*request))
    assert (loading.accepted, loading.refused, tuple(messages)) == (False, True, ())
    return loading.reason


def test_what_cannot_be_loaded_is_refused_with_the_reason():
    flying = Flying()
    assert refused(flying, "s1", "9", 0, 0) == "there is no mission '9'"
    assert refused(flying, "", "line", 0, 0) == "there is no session id"
    assert refused(flying, "s1", "line", 1, 0) == "mission line has 1 waypoint files, there is no 2"
    assert refused(flying, "s1", "both", 0, 2) == "mission both is flown 2 times, there is no 3"
    assert refused(flying, "s1", "both", 1, 0) == ("the place of the session's first takeoff is not known")


def test_nothing_is_loaded_into_a_vehicle_that_flies_or_is_silent():
    flying = Flying()
    flying.take_off("line")
    flying.until_phase(P.FLYING)
    assert refused(flying, "s1", "line", 0, 0) == "the vehicle is armed"
    flying.channel.fate = lambda: ()
    flying.run(4 * S)
    assert refused(flying, "s1", "line", 0, 0) == "the vehicle is silent"
    assert flying.status.message == "the vehicle is silent"
    assert flying.command(A.HOLD) == "the vehicle is silent"
    assert flying.command(A.LAND) == ""


@EACH
@BOTH
def test_what_is_no_multicopter_is_given_no_mission_and_does_not_take_off(mission, kind):
    """A plane's autopilot numbers its modes otherwise: what lands a copter is another mode there."""
    flying = Flying(kind=kind)
    assert flying.load(mission).accepted
    wake = flying.vehicle.wake

    def as_plane(t_ns):
        said = wake(t_ns)
        for message in said:
            if message.get_type() == "HEARTBEAT":
                message.type = mavlink.MAV_TYPE_FIXED_WING
        return said

    flying.vehicle.wake = as_plane
    flying.run(1500 * MS)
    words = "the vehicle says that it is no multicopter (MAV_TYPE_FIXED_WING)"
    assert (flying.command(A.TAKEOFF), refused(flying, "s1", mission, 0, 0)) == (words, words)
    assert flying.command(A.LAND) == ""


def test_a_position_that_the_estimator_disowns_is_none():
    flying = Flying()
    flying.planner.watch.estimator = 0
    assert refused(flying, "s1", "line", 0, 0) == "there is no fresh and valid position on the earth"
    assert refused(flying, "s1", "inside", 0, 0) == "there is no fresh and valid local position"


@pytest.mark.parametrize("latitude, longitude", [(91.0, 8.0), (-214.0, 8.0), (89.9, 8.0), (47.0, 181.0)])
def test_a_position_that_is_nowhere_on_the_earth_or_at_its_poles_is_none(latitude, longitude):
    watch = VehicleWatch()
    watch.take(S, mavlink.MAVLink_estimator_status_message(0, 0x1FF, *[0.1] * 8))
    places = ((47.0, 8.0, S), (latitude, longitude, 2 * S))
    for north, east, t_ns in places:
        message = mavlink.MAVLink_global_position_int_message(0, round(north * 1e7), round(east * 1e7), *[0] * 6)
        watch.take(t_ns, message)
    assert watch.somewhere(2 * S, 3 * S) == (47.0, 8.0)
    assert watch.somewhere(4 * S + 1, 3 * S) is None


def test_a_mission_whose_home_is_elsewhere_is_not_flown():
    away = plan("away", (LINE,), Controller.MISSION, home=Home(47.0, 8.0))
    flying = Flying(plans=(away,))
    assert refused(flying, "s1", "away", 0, 0).startswith("the vehicle stands 60")


def test_a_mission_with_a_home_is_flown_from_there():
    flying = Flying()
    place = flying.planner.watch.place
    home = Home(*Home(*place).to_global(-2.0, 0.0))
    flying = Flying(plans=(plan("there", (LINE,), Controller.MISSION, home=home),))
    flying.take_off("there")
    flying.until_phase(P.LANDED)
    assert near(flying, 6.0, 6.0)  # the vehicle stood 2 m east of home


def test_commands_of_another_session_and_in_the_wrong_phase_are_refused():
    flying = Flying()
    assert flying.command(A.TAKEOFF) == "session 's1' is not the one that is loaded"
    assert flying.load("line").accepted
    assert flying.command(A.TAKEOFF, "s0") == "session 's0' is not the one that is loaded"
    assert flying.command(A.HOLD) == "there is nothing to hold in phase LOADED"
    assert flying.command(A.RESUME) == "there is nothing to resume in phase LOADED"
    assert flying.command(A.TAKEOFF) == ""
    assert flying.command(A.TAKEOFF) == "there is nothing to fly in phase TAKING_OFF"


def moved(flying, east_m):
    east, north, up = flying.craft.position_m
    flying.craft.position_m = (east + east_m, north, up)
    flying.run(2 * S)


@EACH
@BOTH
def test_a_vehicle_that_was_carried_away_after_the_load_does_not_take_off(mission, kind):
    """The first leg, the fence and the battery were checked from where it stood."""
    flying = Flying(kind=kind)
    assert flying.load(mission).accepted
    moved(flying, -40.0)
    far = flying.command(A.TAKEOFF)
    assert far.startswith("load it again: the vehicle stands 40.")
    assert far.endswith(" m from where it stood when the file was loaded, at most 5 m are good")
    assert (flying.phase, flying.craft.armed) == (P.LOADED, False)
    moved(flying, 36.0)  # near enough, as a position drifts that stands
    assert flying.command(A.TAKEOFF) == ""
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


@EACH
@BOTH
def test_a_vehicle_that_somebody_else_arms_or_flies_after_the_load_does_not_take_off(mission, kind):
    flying = Flying(kind=kind)
    assert flying.load(mission).accepted
    mode = "OFFBOARD" if kind is ARDUPILOT else "AUTO.LOITER"
    flying.craft.command_mode(mode)
    flying.craft.pilot_arms()
    flying.run(1500 * MS)
    assert flying.command(A.TAKEOFF) == "the vehicle is armed"
    assert flying.phase is P.LOADED
    flying.run(15 * S)
    assert flying.craft.armed is False
    assert flying.command(A.TAKEOFF) == ""


@BOTH
def test_a_vehicle_that_does_not_say_that_it_is_on_the_ground_does_not_take_off(mission):
    flying = Flying()
    assert flying.load(mission).accepted
    flying.planner.watch.ground.add_landed(flying.t_ns, VehicleLanded.IN_AIR)
    assert flying.command(A.TAKEOFF) == "the vehicle does not say that it is on the ground"
    flying.run(S)
    assert flying.command(A.TAKEOFF) == ""


def test_without_a_position_on_the_earth_no_mission_takes_off():
    flying = Flying()
    assert flying.load("line").accepted
    flying.planner.watch.place_ns -= 60 * S
    assert flying.command(A.TAKEOFF) == "there is no fresh and valid position on the earth"
    flying.run(S)
    assert flying.command(A.TAKEOFF) == ""


def test_by_set_points_an_autopilot_that_was_started_again_after_the_load_does_not_take_off():
    """Its local frame begins where it stands: the file would be flown beside where it was loaded for."""
    flying = Flying()
    drifted(flying, east_m=5.0, north_m=10.0)
    flying.run(10 * S)
    assert flying.load("inside").accepted
    drifted(flying, east_m=-5.0, north_m=-10.0)
    flying.vehicle.px4._start_ns = flying.t_ns  # it begins to count anew
    flying.run(S)
    assert flying.command(A.TAKEOFF) == "load it again: the autopilot was started again"
    assert flying.phase is P.LOADED
    flying.take_off("inside")
    flying.until_phase(P.LANDED)
    assert near(flying, *WHERE_IT_LANDS)


def slowed(flying, real_time_factor):
    """Have the vehicle's clock run slower than ours from now on, as a simulator's does on a busy computer."""
    wake, slowed_ns = flying.vehicle.wake, flying.t_ns

    def slow(t_ns):
        messages = wake(t_ns)
        for message in messages:
            if message.get_type() == "LOCAL_POSITION_NED":
                message.time_boot_ms -= round((t_ns - slowed_ns) * (1.0 - real_time_factor)) // MS
        return messages

    flying.vehicle.wake = slow


@pytest.mark.parametrize("real_time_factor", [0.5, 0.95, 1.5])
@pytest.mark.slow_rows(1)
def test_by_set_points_a_simulator_that_does_not_run_in_real_time_was_not_started_again(real_time_factor):
    flying = Flying()
    slowed(flying, real_time_factor)
    assert flying.load("inside twice").accepted
    flying.run(120 * S)
    assert flying.command(A.TAKEOFF) == ""
    flying.until_phase(P.LANDED)
    flying.run(120 * S)
    flying.take_off("inside twice", 1)


@pytest.mark.parametrize("off_s", [1, 15])
def test_an_autopilot_that_was_started_again_soon_after_it_was_switched_on_is_found_out_after_a_longer_silence(off_s):
    """When it is heard again, it is on for longer than it was before."""
    flying = Flying(settings=Px4Settings(boot_ns=0))
    assert flying.load("inside").accepted
    flying.channel.fate = lambda: ()
    flying.run(off_s * S)
    flying.vehicle.px4._start_ns = flying.t_ns
    silent(flying, 10 * S)
    assert flying.command(A.TAKEOFF) == "load it again: the autopilot was started again"


def test_an_origin_that_another_planner_found_counts_while_the_time_at_which_it_was_switched_on_is_the_same():
    flying = Flying()
    flying.take_off("inside twice")
    flying.until_phase(P.LANDED)
    kept = origin_from(origin_to(flying.planner._origin))
    for later_s, reason in ((4, ""), (6, "the autopilot was started again since the session's first takeoff")):
        flying.planner._origin = replace(kept, boot_ns=kept.boot_ns - later_s * S)
        loading = flying.load("inside twice", 1)
        assert (loading.accepted, loading.reason[: len(reason)]) == (not reason, reason)


def behind_mavros() -> Flying:
    """Return a vehicle of which nothing says when it was switched on."""
    flying = Flying()
    wake = flying.vehicle.wake

    def timeless(t_ns):
        messages = wake(t_ns)
        for message in messages:
            if message.get_type() == "LOCAL_POSITION_NED":
                message.time_boot_ms = 0
        return messages

    flying.vehicle.wake = timeless
    flying.run(S)
    flying.planner.watch.power_on = PowerOn()
    return flying


def silent(flying, silence_ns) -> None:
    """Have the vehicle be silent, and then speak again."""
    flying.channel.fate = lambda: ()
    flying.run(silence_ns)
    flying.channel.fate = good
    flying.run(3 * S)


def test_behind_mavros_a_silence_after_the_load_ends_the_local_frame():
    flying = behind_mavros()
    assert flying.load("inside").accepted
    silent(flying, 4 * S)
    words = "load it again: the vehicle was silent, and may have been started again"
    assert (flying.command(A.TAKEOFF), flying.phase) == (words, P.LOADED)
    flying.take_off("inside")
    flying.until_phase(P.LANDED)


@pytest.mark.parametrize("silence_s, taken", [(2, True), (4, False)])
def test_behind_mavros_a_silence_between_two_files_ends_the_local_frame(silence_s, taken):
    flying = behind_mavros()
    flying.take_off("inside twice")
    flying.until_phase(P.LANDED)
    silent(flying, silence_s * S)
    words = (
        "the vehicle was silent, and may have been started again since the session's first takeoff:"
        " its local frame counts no more"
    )
    loading = flying.load("inside twice", 1)
    assert (loading.accepted, loading.reason) == (taken, "" if taken else words)


@pytest.mark.parametrize("stood_s", [4, 60])
def test_behind_mavros_a_pause_of_the_planner_is_no_silence_of_the_vehicle(stood_s):
    flying = behind_mavros()
    assert flying.load("inside").accepted
    stand_still(flying, stood_s * S)
    flying.run(2 * S)
    assert flying.command(A.TAKEOFF) == ""


def test_behind_mavros_a_silence_after_a_pause_of_the_planner_ends_the_local_frame():
    flying = behind_mavros()
    assert flying.load("inside").accepted
    stand_still(flying, 4 * S)
    silent(flying, 4 * S)
    assert flying.command(A.TAKEOFF).startswith("load it again: the vehicle was silent")


@pytest.mark.parametrize("silence_s, reason", [(2, ""), (4, "load it again: the vehicle was silent")])
def test_behind_mavros_a_silence_around_a_pause_of_the_planner_counts_without_it(silence_s, reason):
    flying = behind_mavros()
    assert flying.load("inside").accepted
    flying.channel.fate = lambda: ()
    flying.run(silence_s * S // 2)
    stand_still(flying, 4 * S)
    silent(flying, silence_s * S // 2)
    assert flying.command(A.TAKEOFF)[: len(reason) or None] == reason


def test_a_silence_of_an_autopilot_that_says_since_when_it_is_on_ends_nothing():
    flying = Flying()
    flying.take_off("inside twice")
    flying.until_phase(P.LANDED)
    silent(flying, 20 * S)
    assert flying.load("inside twice", 1).accepted
    assert flying.command(A.TAKEOFF) == ""


def test_a_mission_takes_off_also_when_the_autopilot_was_started_again_after_the_load():
    flying = Flying()
    flying.run(10 * S)
    assert flying.load("line").accepted
    flying.vehicle.px4._start_ns = flying.t_ns
    flying.run(S)
    assert flying.command(A.TAKEOFF) == ""


@BOTH
def test_nothing_is_held_on_the_ground_the_engine_cancels_there(mission):
    """By the engine's table of answers: before lift-off a takeoff is cancelled, never held."""
    flying = Flying()
    flying.take_off(mission)
    assert flying.craft.armed is False
    for action, word in ((A.HOLD, "hold"), (A.RESUME, "resume")):
        assert flying.command(action) == f"there is nothing to {word} on the ground: ABORT cancels the takeoff"
    assert flying.command(A.ABORT) == ""
    flying.until_phase(P.LANDED, limit_ns=10 * S)
    assert (flying.craft.armed, flying.status.waypoint) == (False, 0)
    held = [case.answer for case in ANSWERS[UserCommand.HOLD][State.TAKEOFF] if case.when != "airborne"]
    assert set(held) == {AnswerKind.REFUSED}


def test_a_second_load_takes_the_place_of_the_first():
    flying = Flying()
    first, messages = flying.planner.load(flying.t_ns, LoadRequest("s1", "line", 0, 0))
    flying.channel.ours(messages)
    assert flying.load("line").accepted
    assert (first.over, first.reason) == (True, "another file was loaded meanwhile")


def test_what_is_not_received_is_not_loaded():
    flying = Flying()
    loading, messages = flying.planner.load(flying.t_ns, LoadRequest("s1", "line", 0, 0))
    flying.channel.fate = lambda: ()
    flying.channel.ours(messages)
    flying.run(9 * S)
    assert loading.reason.startswith("sending line.csv: ")
    assert (loading.over, flying.phase) == (True, P.IDLE)


# --- set-points -------------------------------------------------------------------------------------------------------


def setpoints(flying) -> int:
    return flying.channel.sent.count("SET_POSITION_TARGET_LOCAL_NED")


def test_the_stream_runs_before_the_switch_and_through_the_whole_flight_at_20_hz():
    flying = Flying()
    flying.take_off("inside")
    flying.until(lambda: flying.craft.mode == "OFFBOARD", 5 * S)
    assert setpoints(flying) >= 18
    flying.until_phase(P.FLYING)
    before = setpoints(flying)
    flying.run(5 * S)
    assert 95 <= setpoints(flying) - before <= 105


def test_without_a_pose_it_stands_still_and_flies_on_when_it_is_back():
    flying = Flying()
    flying.take_off("inside")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    deaf(flying, "LOCAL_POSITION_NED")
    flying.run(1500 * MS)
    assert flying.craft.mode == "OFFBOARD"
    assert max(map(abs, flying.craft.velocity_m_s)) < 0.1
    hearing(flying)
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


def test_when_the_pose_stays_away_it_lands():
    flying = Flying()
    flying.take_off("inside")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    deaf(flying, "LOCAL_POSITION_NED")
    flying.run(3 * S)
    words = "the local position stays away"
    assert (flying.craft.mode, flying.phase, flying.status.message) == ("AUTO.LAND", P.LANDING, words)
    flying.until_phase(P.LANDED)
    assert near(flying, 5.0, 0.0, 2.5)
    flying.run(5 * S)
    assert (flying.phase, flying.status.message) == (P.LANDED, words)
    hearing(flying)
    flying.run(S)
    assert flying.load("inside").accepted
    assert flying.status.message == ""


@BOTH
def test_why_it_lands_is_told_where_the_mission_did_not_ask_for_it(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until_phase(P.FLYING)
    flying.channel.ours(flying.planner.other_commands(flying.t_ns, "AUTO.LAND"))
    words = []
    flying.until(lambda: words.append(flying.status.message) or flying.phase is P.LANDED)
    assert set(words) == {"the autopilot node commands AUTO.LAND"}


@BOTH
@pytest.mark.parametrize("asked", [False, True])
def test_nothing_is_told_of_a_landing_that_was_asked_for_or_ends_the_file(mission, asked):
    flying = Flying()
    flying.take_off(mission)
    flying.until_phase(P.FLYING)
    if asked:
        assert flying.command(A.LAND) == ""
    words = []
    flying.until(lambda: words.append(flying.status.message) or flying.phase is P.LANDED)
    assert set(words) == {""}


@pytest.mark.parametrize("holds", [False, True])
def test_an_estimate_that_jumps_is_not_followed_and_when_it_stays_there_it_lands(holds):
    flying = Flying()
    flying.take_off("inside")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    if holds:
        assert flying.command(A.HOLD) == ""
        flying.until_phase(P.HOLDING, limit_ns=3 * S)
    east, north, _ = flying.craft.position_m
    drifted(flying, north_m=25.0)
    flying.until_phase(P.LANDED)
    assert near(flying, east, north, 2.5)


def test_when_the_heading_is_not_known_any_more_it_flies_on_without():
    flying = Flying()
    flying.take_off("inside")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    deaf(flying, "ATTITUDE")
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


def test_a_takeoff_does_not_turn_to_a_heading_that_it_had_a_while_ago():
    flying = Flying()
    flying.craft.yaw_rad = 2.0
    flying.run(S)
    assert flying.load("inside").accepted
    deaf(flying, "ATTITUDE")
    flying.run(10 * S)
    flying.craft.yaw_rad = LINE.waypoints[0].yaw_rad  # turned by hand meanwhile, to where its file looks
    assert flying.command(A.TAKEOFF) == ""
    turned = []
    flying.until(lambda: turned.append(abs(flying.craft.yaw_rad)) or flying.craft.position_m[0] > 1.0)
    assert max(turned) < 0.2


def test_the_stream_goes_on_until_the_landing_is_shown():
    flying = Flying()
    flying.take_off("inside")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.craft.flags.ignores = ("AUTO.LAND",)
    flying.command(A.LAND)
    before = setpoints(flying)
    flying.run(4 * S)
    assert flying.craft.mode == "OFFBOARD"
    assert setpoints(flying) - before >= 75
    flying.craft.flags.ignores = ()
    flying.until_phase(P.LANDED)
    before = setpoints(flying)
    flying.run(2 * S)
    assert setpoints(flying) == before


def test_set_points_follow_the_legs_no_faster_than_the_model():
    flying = Flying()
    flying.take_off("inside")
    fastest = 0.0
    while flying.phase is not P.LANDED:
        before = flying.craft.position_m
        flying.run(500 * MS)
        moved = sum((a - b) ** 2 for a, b in zip(before, flying.craft.position_m)) ** 0.5
        fastest = max(fastest, moved / 0.5)
        assert abs(flying.craft.position_m[1]) < 0.3 or flying.craft.position_m[0] > 7.0  # along the legs
    assert 1.0 < fastest < 4.5


def deaf(flying, *kinds) -> None:
    """Have the planner miss messages of some kinds."""
    take = VehicleWatch.take
    flying.planner.watch.take = lambda t_ns, message, **_: (
        None if message.get_type() in kinds else take(flying.planner.watch, t_ns, message)
    )


def hearing(flying) -> None:
    del flying.planner.watch.take


def landed_unheard(flying) -> None:
    """Fly a mission whose last item is not heard of before the landing, and be silent from then on."""
    flying.take_off("line")
    flying.until(lambda: flying.status.waypoint == 3)
    deaf(flying, "MISSION_CURRENT", "MISSION_ITEM_REACHED")
    flying.until(lambda: flying.planner.watch.armed is False and flying.craft.landed.name == "ON_GROUND")
    hearing(flying)
    flying.channel.fate = lambda: ()


def test_an_item_that_its_mission_does_not_have_is_where_nobody_is():
    flying = Flying()
    flying.take_off("line")
    flying.until(lambda: flying.status.waypoint == 2)
    flying.planner.receive(flying.t_ns, mavlink.MAVLink_mission_current_message(65535))
    assert (flying.status.waypoint, flying.phase) == (2, P.FLYING)
    assert flying.command(A.HOLD) == ""
    flying.until_phase(P.HOLDING)
    flying.planner.receive(flying.t_ns, mavlink.MAVLink_mission_current_message(65535))
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.FLYING, limit_ns=6 * S)
    flying.until_phase(P.LANDED)
    assert (flying.status.waypoint, flying.status.message) == (3, "")


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize("during", [P.TAKING_OFF, P.FLYING, P.HOLDING])
def test_a_mission_that_somebody_else_puts_on_the_vehicle_in_flight_is_not_flown(kind, during):
    """After it was read back for the last time: only the number of items in MISSION_CURRENT tells."""
    flying = Flying(kind=kind)
    flying.take_off("line")
    if during is P.HOLDING:
        flying.until_phase(P.FLYING)
        assert flying.command(A.HOLD) == ""
    flying.until(lambda: flying.phase is during and flying.planner.watch.landed in AIRBORNE)
    flying.craft.load_items(flying.craft.items[:2], 0)
    flying.until_phase(P.FAILED, limit_ns=3 * S)
    assert flying.status.message.startswith("somebody else has replaced the mission on the vehicle: it has ")
    flying.run(3 * S)
    assert flying.phase is P.FAILED
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDED)


def shifted(items):
    """Return a mission with as many items, its last waypoint 30 m further east."""
    return tuple(replace(item, y=item.y + 4000) if item in items[-2:] else item for item in items)


@pytest.mark.parametrize("during", [P.TAKING_OFF, P.FLYING, P.HOLDING])
def test_a_mission_that_somebody_else_changes_in_flight_is_not_flown_on(during):
    """It has as many items; a PX4 tells its checksum."""
    flying = Flying()
    flying.take_off("line")
    if during is P.HOLDING:
        flying.until_phase(P.FLYING)
        assert flying.command(A.HOLD) == ""
    flying.until(lambda: flying.phase is during and flying.planner.watch.landed in AIRBORNE)
    flying.craft.load_items(shifted(flying.craft.items), flying.craft.current)
    flying.until_phase(P.FAILED, limit_ns=3 * S)
    assert flying.status.message.startswith("somebody else has replaced the mission on the vehicle: its id is ")
    assert flying.command(A.RESUME) != ""
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDED)


def without_id(flying):
    """Have the vehicle tell no id of its mission, as an ArduPilot, an older PX4, or mavros."""
    wake = flying.vehicle.wake

    def told(t_ns):
        messages = wake(t_ns)
        for message in messages:
            if message.get_type() == "MISSION_CURRENT":
                message.mission_id = 0
        return messages

    flying.vehicle.wake = told
    return flying


def held(kind, hold_ns=6 * S, fate=good):
    """Return a flight by a mission that is held so long, of which its vehicle tells no id."""
    flying = without_id(Flying(kind=kind))
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 2.0)
    flying.channel.fate = fate
    flying.channel.sent.clear()
    assert flying.command(A.HOLD) == ""
    flying.until_phase(P.HOLDING)
    flying.run(hold_ns)
    return flying


def change(flying):
    """Change the mission on the vehicle."""
    items = shifted(flying.craft.items)
    flying.vehicle.px4.missions._stores[mavlink.MAV_MISSION_TYPE_MISSION] = items
    flying.craft.load_items(items, flying.craft.current)


REPLACED = "somebody else has replaced the mission on the vehicle: item "


@EACH
def test_where_no_id_tells_it_a_mission_that_is_changed_in_a_hold_is_read(kind):
    flying = held(kind)
    change(flying)
    flying.until_phase(P.FAILED, limit_ns=4 * S)
    assert flying.status.message.startswith(REPLACED)
    assert flying.command(A.RESUME) == "there is nothing to resume in phase FAILED"
    assert flying.planner.watch.mode == "AUTO.LOITER"
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDED)


@EACH
@pytest.mark.parametrize("before", [True, False])
def test_a_mission_that_is_changed_just_before_or_after_a_resume_is_not_flown(kind, before):
    flying = held(kind)
    if before:
        change(flying)
    assert flying.command(A.RESUME) == ""
    if not before:
        change(flying)
    flying.until_phase(P.FAILED, limit_ns=3 * S)
    assert flying.status.message.startswith(REPLACED)
    assert flying.planner.watch.mode == "AUTO.LOITER"


@EACH
def test_what_is_read_in_a_hold_changes_nothing_on_the_vehicle(kind):
    flying = held(kind)
    assert set(flying.channel.sent) <= {"MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK", "COMMAND_LONG"}
    assert 2 <= flying.channel.sent.count("MISSION_REQUEST_LIST") <= 4  # with pauses between
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.FLYING, limit_ns=3 * S)
    flying.channel.sent.clear()
    flying.until_phase(P.LANDED)
    assert "MISSION_REQUEST_INT" not in flying.channel.sent
    assert flying.status.waypoint == 3


def test_of_a_vehicle_that_tells_an_id_no_mission_is_read_in_a_hold():
    flying = Flying()
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 2.0)
    flying.channel.sent.clear()
    assert flying.command(A.HOLD) == ""
    flying.run(3 * S)
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.LANDED)
    assert "MISSION_REQUEST_LIST" not in flying.channel.sent


SLOW = (300 * MS,)


@EACH
def test_on_a_slow_way_a_resume_goes_on_with_what_was_read_in_the_hold_and_ends_when_it_was_changed_since(kind):
    flying = held(kind, 12 * S, lambda: SLOW)
    change(flying)
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.FAILED, limit_ns=15 * S)
    assert flying.status.message.startswith(REPLACED)


def test_on_a_slow_way_a_resume_goes_on_with_what_was_read_in_the_hold():
    flying = held(ARDUPILOT, 12 * S, lambda: SLOW)
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.FLYING, limit_ns=5 * S)
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


def test_on_a_slow_way_a_resume_right_after_the_hold_ends_where_the_mission_could_not_be_read():
    flying = held(ARDUPILOT, 0, lambda: SLOW)
    assert flying.command(A.RESUME) == ""
    flying.run(4 * S)
    assert (flying.phase, flying.status.message) == (P.HOLDING, "the mission was not read back in time to go on")
    flying.run(10 * S)
    assert flying.command(A.RESUME) == ""  # asked again, it does
    flying.until_phase(P.FLYING, limit_ns=6 * S)


@pytest.mark.parametrize("beat_ms", [0, 300, 600, 900])
def test_where_it_was_read_in_the_hold_a_resume_leaves_the_change_of_mode_two_heartbeats(beat_ms):
    """Of a PX4 that tells its mode by its heartbeats alone, once a second, and those of 1.6 s are lost."""
    flying = held(PX4, 8 * S + beat_ms * MS)
    take, told_ns = flying.planner.receive, flying.t_ns
    lost = ["CURRENT_MODE", "MISSION_COUNT"]
    flying.planner.receive = lambda t_ns, message, **how: (
        () if message.get_type() in lost else take(t_ns, message, **how)
    )
    assert flying.command(A.RESUME) == ""
    flying.until(lambda: flying.craft.mode == "AUTO.MISSION", 5 * S)
    assert flying.t_ns - told_ns >= 2200 * MS  # for so long the reading is waited for
    lost.append("HEARTBEAT")
    flying.run(1600 * MS)
    lost.remove("HEARTBEAT")
    flying.until_phase(P.FLYING, limit_ns=told_ns + LIMITS.resume_confirm_limit_ns - flying.t_ns)


def test_where_none_was_read_in_the_hold_a_resume_waits_longer_for_the_first_reading():
    flying = without_id(Flying())
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 2.0)
    take, lost = flying.planner.receive, ["MISSION_COUNT"]
    flying.planner.receive = lambda t_ns, message, **how: (
        () if message.get_type() in lost else take(t_ns, message, **how)
    )
    assert flying.command(A.HOLD) == ""
    flying.until_phase(P.HOLDING)
    assert flying.command(A.RESUME) == ""
    flying.run(2700 * MS)
    assert (flying.craft.mode, flying.status.message) == ("AUTO.LOITER", "")
    lost.clear()
    flying.until(lambda: flying.craft.mode == "AUTO.MISSION", 800 * MS)


def test_one_wrong_item_that_is_read_in_a_hold_is_not_believed():
    flying = held(ARDUPILOT, 0)
    take, wrong = flying.planner.receive, []

    def once(t_ns, message, **how):
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == 3 and not wrong:
            wrong.append(message)
            message.y += 4000
        return take(t_ns, message, **how)

    flying.planner.receive = once
    flying.run(5 * S)
    assert wrong
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.LANDED)
    assert P.FAILED not in flying.phases


def test_one_wrong_number_of_items_is_not_believed():
    flying = Flying()
    flying.take_off("line")
    flying.until(lambda: flying.status.waypoint == 2)
    flying.planner.receive(flying.t_ns, mavlink.MAVLink_mission_current_message(flying.planner.watch.current, 2))
    flying.until_phase(P.LANDED)
    assert P.FAILED not in flying.phases


def test_how_far_it_came_is_not_given_up_while_the_vehicle_is_silent():
    flying = Flying()
    landed_unheard(flying)
    flying.run(8 * S)
    assert flying.phase is not P.LANDED
    flying.channel.fate = good
    flying.until_phase(P.LANDED, limit_ns=4 * S)
    assert (flying.status.waypoint, flying.status.message) == (3, "")


def test_of_a_vehicle_that_says_no_more_where_in_its_mission_it_is_counts_what_was_heard():
    flying = Flying()
    landed_unheard(flying)
    flying.channel.fate = good
    deaf(flying, "MISSION_CURRENT", "MISSION_ITEM_REACHED")
    flying.until_phase(P.LANDED, limit_ns=6 * S)
    assert flying.status.waypoint == 2


# --- endings ----------------------------------------------------------------------------------------------------------


@BOTH
def test_told_to_end_in_flight_it_lands(mission):
    flying = Flying()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert not flying.planner.landing_shown
    lands, messages = flying.planner.shutdown(flying.t_ns)
    flying.channel.ours(messages)
    assert lands
    flying.until(lambda: flying.planner.landing_shown, 3 * S)
    assert flying.craft.mode == "AUTO.LAND"


def test_told_to_end_on_the_ground_it_ends():
    flying = Flying()
    assert flying.load("line").accepted
    assert flying.planner.shutdown(flying.t_ns) == (False, ())
    assert flying.planner.landing_shown


def told_to_end(flying):
    """Tell the planner to end as its node does, which waits for what it says at most so long; return whether it did."""
    leaves, messages = flying.planner.shutdown(flying.t_ns)
    flying.channel.ours(messages)
    if leaves:
        flying.until(lambda: flying.planner.landing_shown, 3 * S, must=False)  # exit_limit_s
    flying.planner.receive = flying.planner.wake = lambda *_, **__: []  # its process has ended
    return leaves


def slow_to_arm(flying, delay_ns):
    """Have its armings take so long, and nothing else that it sends."""
    send = flying.channel.ours

    def slow(messages):
        for message in messages:
            arms = message.get_type() == "COMMAND_LONG" and message.command == ARM and message.param1 == 1.0
            flying.channel.fate = (lambda: (delay_ns,)) if arms else good
            send([message])
            flying.channel.fate = good

    flying.channel.ours = slow


@BOTH
@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize("delay_ns", [5 * MS, 800 * MS, 1500 * MS])
def test_told_to_end_just_after_it_sent_an_arming_it_takes_it_back(mission, kind, delay_ns):
    flying = Recorded(kind=kind)
    slow_to_arm(flying, delay_ns)
    flying.take_off(mission)
    flying.until(lambda: "arm" in flying.since(0), 20 * S)
    assert (flying.planner.watch.armed, told_to_end(flying)) == (False, True)
    flying.run(2 * S)
    assert (flying.craft.armed, flying.craft.height_m) == (False, 0.0)


@BOTH
@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_told_to_end_while_an_abort_guards_an_arming_that_is_late_it_stays_for_it(mission, kind):
    flying = Recorded(kind=kind)
    slow_to_arm(flying, 1500 * MS)
    flying.take_off(mission)
    flying.until(lambda: "arm" in flying.since(0), 20 * S)
    assert flying.command(A.ABORT) == ""
    flying.run(1200 * MS)
    assert (flying.planner.watch.armed, told_to_end(flying)) == (False, True)
    flying.run(2 * S)
    assert (flying.craft.armed, flying.craft.height_m) == (False, 0.0)


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_told_to_end_with_an_arming_under_way_it_leaves_the_vehicle_to_a_pilot_who_takes_it(kind):
    flying = Recorded(kind=kind)
    slow_to_arm(flying, 800 * MS)
    flying.take_off("line")
    flying.until(lambda: "arm" in flying.since(0), 20 * S)
    leaves, messages = flying.planner.shutdown(flying.t_ns)
    flying.channel.ours(messages)
    flying.run(500 * MS)
    flying.craft.pilot_takes_over("POSCTL", 600 * S)
    assert (leaves, flying.planner.landing_shown) == (True, False)
    flying.until(lambda: flying.craft.armed, S)
    armed_ns = flying.t_ns
    flying.until(lambda: flying.planner.landing_shown, 2500 * MS)
    assert (flying.since(armed_ns), flying.craft.armed, flying.craft.mode) == ([], True, "POSCTL")


def test_told_to_end_once_an_arming_cannot_be_late_any_more_it_ends():
    flying = Recorded()
    flying.take_off("line")
    flying.until(lambda: "arm" in flying.since(0), 20 * S)
    assert flying.command(A.ABORT) == ""
    flying.run(5 * S)
    assert flying.planner.shutdown(flying.t_ns) == (False, ())
    assert flying.planner.landing_shown


# --- bad links --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mission", ["line", "inside"])
@pytest.mark.parametrize("seed", range(4))
def test_missions_end_well_with_loss_jitter_and_a_link_cut(mission, seed):
    random = Random(seed)
    flying = Flying()
    cut_ns = flying.t_ns + random.randrange(3, 12) * S

    def fate():
        cut = mission == "line" and cut_ns <= flying.t_ns < cut_ns + 2 * S
        return () if cut or random.random() < 0.05 else (5 * MS + random.randrange(50) * MS,)

    flying.channel.fate = fate
    flying.take_off(mission)
    flying.until_phase(P.LANDED)
    assert (flying.status.waypoint, near(flying, *WHERE_IT_LANDS)) == (3, True)
    flying.channel.fate = good


def test_one_waypoint_and_no_hold_is_a_mission_too():
    one = Trajectory("one.csv", (Waypoint(0.0, 0.0, 2.0, 0.0, 0.0),))
    for controller in Controller:
        flying = Flying(plans=(*PLANS, plan("one", (one,), controller)))
        flying.take_off("one")
        flying.until_phase(P.LANDED)
        assert (flying.status.waypoint, flying.status.waypoints) == (1, 1)
