"""The planner with the simulated ArduCopter, in virtual time: each of its own ways is a story."""

from __future__ import annotations

import math
from itertools import count
from random import Random

import pytest
from flying import ARDUPILOT, BACK, LIFT, LINE, MS, PX4, Flying, Recorded, S, plan
from vehicle_lies import CRITICAL, ON_GROUND, Liar

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import Controller, PlannerSpec, Trajectory, Waypoint
from amaze_autonomy.simulation.px4 import Px4Settings

P, A = MissionPhase, MissionAction
BOTH = pytest.mark.parametrize("mission", ["line", "inside"])


def ardupilot(**more):
    return Flying(kind=ARDUPILOT, **more)


@BOTH
def test_a_file_is_flown_from_takeoff_to_landing(mission):
    flying = ardupilot()
    flying.take_off(mission)
    flying.until_phase(P.LANDED)
    assert flying.phases == [P.IDLE, P.LOADED, P.TAKING_OFF, P.FLYING, P.LANDING, P.LANDED]
    assert (flying.status.waypoint, flying.status.message, flying.craft.armed) == (3, "", False)
    assert flying.craft.position_m[:2] == pytest.approx((8.0, 6.0), abs=0.6)


@BOTH
def test_it_holds_where_it_is_and_resumes_where_it_stopped(mission):
    flying = ardupilot()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(A.HOLD) == ""
    flying.until_phase(P.HOLDING, limit_ns=3 * S)
    held = flying.craft.position_m
    flying.run(10 * S)
    assert flying.craft.position_m == pytest.approx(held, abs=1.0)
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.FLYING, limit_ns=5 * S)
    assert flying.status.waypoint == 2
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


def test_an_autopilot_whose_held_missions_begin_anew_gets_none_but_flies_by_set_points():
    flying = ardupilot(settings=Px4Settings(parameters={"MIS_RESTART": 1}))
    loading = flying.load("line")
    reason = "MIS_RESTART of the ArduPilot is 1: a mission that is held would begin anew; set it to 0"
    assert (loading.accepted, loading.reason, flying.phase) == (False, reason, P.IDLE)
    flying.take_off("inside")
    flying.until_phase(P.FLYING)


def test_it_is_asked_until_it_says_whether_missions_begin_anew_and_then_does_not_take_off():
    flying = ardupilot(settings=Px4Settings(parameters={"MIS_RESTART": 1}))
    take, asked = flying.vehicle.take, []

    def deaf(t_ns, message):
        if message.get_type() == "PARAM_REQUEST_READ":
            asked.append(t_ns)
            if len(asked) < 20:
                return []
        return take(t_ns, message)

    flying.vehicle.take = deaf
    assert flying.load("line").accepted
    flying.run(15 * S)
    assert len(asked) == 20
    assert flying.command(A.TAKEOFF).startswith("MIS_RESTART of the ArduPilot is 1")


def test_a_mission_that_begins_anew_after_a_hold_has_failed_to_resume():
    flying = ardupilot()
    flying.take_off("line")
    flying.vehicle.px4.parameters["MIS_RESTART"] = 1
    flying.until(lambda: flying.status.waypoint == 3)
    assert flying.command(A.HOLD) == ""
    flying.until_phase(P.HOLDING, limit_ns=3 * S)
    flying.run(5 * S)
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.FAILED, limit_ns=3 * S)
    assert flying.status.message.startswith("the mission began anew when it was to go on: it is at item ")
    flying.run(3 * S)
    assert flying.phase is P.FAILED
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDED)


@BOTH
def test_it_lands_early_where_it_is(mission):
    flying = ardupilot()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDED)
    assert (flying.status.waypoint, flying.craft.armed) == (1, False)


@pytest.mark.parametrize("mission", ["both", "inside twice"])
def test_several_files_and_repetitions_with_touchdowns_between(mission):
    flying = ardupilot()
    for repetition in (0, 1):
        for file_index, trajectory in enumerate((LINE, BACK)):
            flying.take_off(mission, file_index, repetition)
            flying.until_phase(P.LANDED)
            last = trajectory.waypoints[-1]
            assert flying.status.waypoint == len(trajectory.waypoints)
            assert flying.craft.position_m[:2] == pytest.approx((last.x_m, last.y_m), abs=0.6)


ASIDE = Trajectory("aside.csv", tuple(Waypoint(8.0 * n, 0.0, 2.0, yaw, 1.0) for n, yaw in enumerate((2.0, -1.0, 0.5))))


def heading_of(flying):
    return pytest.approx(math.remainder(flying.craft.yaw_rad, math.tau), abs=0.01)


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_at_each_waypoint_it_looks_where_the_file_says(kind):
    flying = Flying(kind=kind, plans=(plan("aside", (ASIDE,), Controller.MISSION),))
    flying.take_off("aside")
    for number, waypoint in enumerate(ASIDE.waypoints, 1):
        flying.until(lambda there=number: flying.craft.reached == there)
        assert (waypoint.yaw_rad, flying.status.waypoint) == (heading_of(flying), number)
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


@pytest.mark.parametrize("held_s", [0.0, 6.0])
def test_held_on_its_way_it_looks_where_the_file_says_all_the_same(held_s):
    flying = ardupilot(plans=(plan("aside", (ASIDE,), Controller.MISSION),))
    flying.take_off("aside")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.command(A.HOLD)
    flying.until_phase(P.HOLDING)
    flying.run(round(held_s * S))
    flying.command(A.RESUME)
    flying.until(lambda: flying.craft.reached == 2)
    assert (heading_of(flying), flying.status.waypoint) == (-1.0, 2)
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


@pytest.mark.parametrize("lost", [1, 100])
def test_sent_back_to_its_heading_in_vain_it_is_sent_again_and_goes_on_all_the_same_and_says_so(lost):
    flying, number = ardupilot(plans=(plan("aside", (ASIDE,), Controller.MISSION),)), count()
    flying.take_off("aside")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.command(A.HOLD)
    flying.until_phase(P.HOLDING)
    flying.run(2 * S)
    send = flying.channel.ours
    flying.channel.ours = lambda messages: send(
        [each for each in messages if each.get_type() != "MISSION_SET_CURRENT" or next(number) >= lost]
    )
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.FLYING, limit_ns=4 * S)
    flying.until(lambda: flying.craft.reached == 2)
    all_lost = lost > 1
    assert (heading_of(flying) == -1.0, flying.status.waypoint) == (not all_lost, 2)
    assert flying.status.message == ("it goes on without the heading of its waypoint" if all_lost else "")
    flying.until_phase(P.LANDED)
    assert (flying.status.waypoint, flying.status.message) == (3, "")


def test_a_turn_that_is_told_as_reached_is_no_waypoint():
    flying = ardupilot(plans=(plan("aside", (ASIDE,), Controller.MISSION),))
    flying.take_off("aside")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    turn = flying.craft.current - 1
    flying.planner.receive(flying.t_ns, mavlink.MAVLink_mission_item_reached_message(turn))
    assert flying.status.waypoint == 2


@BOTH
def test_on_a_bad_link_it_is_flown_as_well(mission):
    chance = Random(5)
    flying = ardupilot(fate=lambda: () if chance.random() < 0.05 else (chance.randrange(50_000_000),))
    flying.run(5 * S)  # a lost request for a stream is repeated after 3 s
    flying.take_off(mission)
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


@BOTH
def test_a_pilot_who_switches_to_loiter_is_left_alone(mission):
    flying = ardupilot()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.craft.pilot_takes_over("POSCTL", 20 * S)
    flying.run(2 * S)
    assert flying.status.message == "the pilot has control (mode POSCTL)"
    assert {flying.command(action) for action in A} == {"the pilot has control (mode POSCTL)"}
    flying.until_phase(P.LANDED)


def at_a_critical_battery(mission):
    """Fly with status CRITICAL alone: a low battery, of which it makes nothing (BATT_FS_LOW_ACT 0)."""
    flying = Recorded(kind=ARDUPILOT)
    lies = Liar(flying.planner, copter=True)
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 1.0)
    lies.always(("status", CRITICAL))
    flying.run(1500 * MS)
    return flying


@BOTH
def test_at_a_critical_battery_a_pilot_in_loiter_keeps_it(mission):
    flying = at_a_critical_battery(mission)
    flying.craft.pilot_takes_over("POSCTL", 60 * S)
    flying.run(2 * S)
    taken_ns = flying.t_ns
    assert (flying.planner.watch.pilot, flying.planner.watch.failsafe) == (True, False)
    assert flying.status.message == "the pilot has control (mode POSCTL)"
    assert flying.command(A.LAND) == flying.command(A.ABORT) == "the pilot has control (mode POSCTL)"
    assert flying.planner.shutdown(flying.t_ns) == (False, ())
    flying.run(2 * S)
    assert (flying.since(taken_ns), flying.craft.mode) == ([], "POSCTL")


@BOTH
def test_at_a_critical_battery_it_is_landed_from_a_mode_of_ours(mission):
    flying = at_a_critical_battery(mission)
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDED)
    assert (flying.craft.armed, flying.status.message) == (False, "")


def test_a_lost_position_lands_it_by_its_own_failsafe():
    flying = ardupilot()
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 1.0)
    flying.craft.lose_gps()
    flying.until(lambda: flying.craft.failsafe, 10 * S)
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint < 3


def test_before_its_position_is_known_it_does_not_arm_and_says_why():
    flying = ardupilot()
    assert flying.load("line").accepted
    flying.craft.lose_gps()
    flying.run(6 * S)
    assert flying.command(A.TAKEOFF) == "there is no fresh and valid position on the earth"
    flying.planner.watch.somewhere = lambda *_: flying.planner.watch.place  # of an estimator that stands by it still
    assert flying.command(A.TAKEOFF) == ""
    flying.until_phase(P.FAILED, limit_ns=12 * S)
    assert flying.status.waypoint == 0
    assert flying.status.message.startswith(
        "change to a mode to arm in: not shown within 4 s (FAILED): Mode change failed"
    )
    assert flying.craft.armed is False


def test_a_vehicle_that_stays_on_the_ground_is_disarmed():
    flying = ardupilot()
    flying.craft.flags.does_not_lift_off = True
    flying.take_off("line")
    flying.until(lambda: flying.craft.armed)
    flying.run(3 * S)
    assert flying.phase is P.TAKING_OFF
    assert flying.command(A.ABORT) == ""
    flying.until_phase(P.LANDED, limit_ns=10 * S)
    assert flying.craft.armed is False


def test_a_set_point_before_it_is_in_the_air_would_end_its_takeoff_and_none_is_sent():
    flying = ardupilot()
    flying.take_off("inside")
    flying.until(lambda: flying.craft.height_m > 0.5)
    assert "SET_POSITION_TARGET_LOCAL_NED" not in flying.channel.sent
    flying.until_phase(P.FLYING)
    assert "SET_POSITION_TARGET_LOCAL_NED" in flying.channel.sent


ABOVE = Trajectory("above.csv", (Waypoint(0.0, 0.0, 8.0, 0.0, 0.5), Waypoint(4.0, 0.0, 8.0, 0.0, 0.5)))


def deepest_set_point_m(flying):
    """Have the height of each set-point above the vehicle kept; return what gives the least of them."""
    least, send = [math.inf], flying.channel.ours

    def seen(messages):
        messages = list(messages)
        for each in messages:
            if each.get_type() == "SET_POSITION_TARGET_LOCAL_NED" and not each.type_mask & 0x7:
                least[0] = min(least[0], -each.z - flying.craft.height_m)
        send(messages)

    flying.channel.ours = seen
    return lambda: least[0]


@pytest.mark.parametrize("height_m", [1.0, 3.0, 5.0])
@pytest.mark.parametrize("held", [False, True])
def test_the_first_set_point_after_its_own_takeoff_is_where_it_is(height_m, held):
    limits = Limits(takeoff_height_m=height_m)
    flying = ardupilot(plans=(plan("above", (ABOVE,), Controller.OFFBOARD),), limits=limits)
    deepest_m = deepest_set_point_m(flying)
    flying.take_off("above")
    if held:
        flying.until(lambda: flying.craft.height_m > 0.3)
        assert flying.command(A.HOLD) == flying.command(A.RESUME) == ""
    flying.until_phase(P.LANDING)
    assert flying.phases == [P.IDLE, P.LOADED, P.TAKING_OFF, P.FLYING, P.LANDING]
    assert flying.status.waypoint == 2
    assert deepest_m() >= -PlannerSpec().acceptance_radius_m


def test_a_hold_on_the_ground_after_the_start_is_resumed():
    flying = ardupilot()
    flying.craft.flags.does_not_lift_off = True
    flying.take_off("line")
    flying.until(lambda: flying.craft.mode == "AUTO.MISSION")
    assert flying.command(A.HOLD) == ""
    flying.until(lambda: flying.craft.mode == "AUTO.LOITER", 3 * S)
    flying.craft.flags.does_not_lift_off = False
    assert flying.command(A.RESUME) == ""
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3


def test_by_set_points_a_takeoff_that_was_held_before_it_took_effect_is_commanded_again_with_the_resume():
    """The takeoff was lost on its way: on the ground no set-point is followed, and nothing else leads up."""
    flying = Recorded(kind=ARDUPILOT)
    send, lost = flying.channel.ours, []

    def losing(messages):
        messages = list(messages)
        first = [each for each in messages if getattr(each, "command", None) == LIFT and not lost]
        lost.extend(first)
        send([each for each in messages if each not in first])

    flying.channel.ours = losing
    flying.take_off("inside")
    flying.until(lambda: lost)
    flying.run(100 * MS)
    assert flying.command(A.HOLD) == flying.command(A.RESUME) == ""
    flying.until_phase(P.LANDED)
    assert (flying.status.waypoint, flying.status.message) == (3, "")


def test_by_set_points_a_resume_in_the_air_commands_no_takeoff():
    flying = Recorded(kind=ARDUPILOT)
    flying.take_off("inside")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(A.HOLD) == ""
    flying.until_phase(P.HOLDING)
    Liar(flying.planner, copter=True).always(("landed", ON_GROUND))
    told_ns = flying.t_ns
    assert flying.command(A.RESUME) == ""
    flying.run(2 * S)
    assert "takeoff" not in flying.since(told_ns)
