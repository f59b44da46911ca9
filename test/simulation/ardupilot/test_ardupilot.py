"""The simulated ArduCopter: each of the ways in which ArduPilot differs from PX4 and was seen to surprise."""

from __future__ import annotations

import math

import pytest
from px4_tools import Bench, S
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.simulation.ardupilot import ArduCraft, ArduPilot

OK, FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_FAILED
STABILIZE, AUTO, GUIDED, LOITER, LAND, BRAKE = 0, 3, 4, 5, 9, 17
SET_MODE, ARM, TAKE_OFF = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 22
TURN = mavlink.MAV_CMD_CONDITION_YAW
START, INTERVAL = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL


def bench(*asked):
    """Return one that streams what is asked for."""
    made = Bench(autopilot=(ArduCraft, ArduPilot), kind=mavlink.MAV_TYPE_ONBOARD_CONTROLLER).advance(0.1)
    for number in asked:
        assert made.command(INTERVAL, number, 100_000) == [OK]
    return made


def mode(bench, number):
    return bench.command(SET_MODE, 1, number)


def items(bench, *heights):
    """Upload a place holder for home, a takeoff, waypoints and a landing; return what it asked with."""
    commands = [16, TAKE_OFF, *[16] * len(heights), 21]
    bench.heard.clear()
    bench.tell(mavlink.MAVLink_mission_count_message(1, 1, len(commands)))
    for number, command in enumerate(commands):
        bench.advance(0.05)
        place = bench.place(3.0 * number, 0.0)
        height = [0.0, 2.0, *heights, 0.0][number]
        bench.tell(
            mavlink.MAVLink_mission_item_int_message(
                1, 1, number, 6, command, number == 0, 1, 0, 0, 0, 90, *place, height
            )
        )
    bench.advance(0.05)
    return [message.get_type() for message in bench.of("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK")]


def test_every_item_is_asked_for_in_the_old_way_and_the_first_becomes_home():
    vehicle = bench()
    assert items(vehicle, 2.005) == ["MISSION_REQUEST"] * 4 + ["MISSION_ACK"]
    for number in (0, 2):
        vehicle.tell(mavlink.MAVLink_mission_request_int_message(1, 1, number))
    home, waypoint = vehicle.advance(0.1).of("MISSION_ITEM_INT")
    assert (home.frame, home.command, home.z) == (0, 16, pytest.approx(489.4))
    assert (waypoint.frame, waypoint.param4, waypoint.z) == (6, 0.0, pytest.approx(2.0, abs=0.01))


def test_told_to_begin_with_home_it_begins_with_the_item_behind_it():
    vehicle = bench(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)
    items(vehicle, 2.0)
    vehicle.tell(mavlink.MAVLink_mission_set_current_message(1, 1, 0))
    vehicle.heard.clear()
    assert [each.seq for each in vehicle.advance(1.5).of("MISSION_CURRENT")][:2] == [0, 1]  # first what it was told


def send(bench, *mission):
    """Upload (command, parameters 1 to 4, metres east, height) after a place holder for home."""
    bench.tell(mavlink.MAVLink_mission_count_message(1, 1, len(mission) + 1))
    for number, (command, parameters, east, height) in enumerate([(16, (0, 0, 0, 0), 0.0, 0.0), *mission]):
        bench.advance(0.05)
        head = (1, 1, number, 6, command, number == 0, 1, *parameters)
        bench.tell(mavlink.MAVLink_mission_item_int_message(*head, *bench.place(east, 0.0), height))
    return bench.advance(0.05)


NONE = (0, 0, 0, 0)
EAST = (TAKE_OFF, NONE, 0.0, 2.0), (16, NONE, 9.0, 2.0), (16, (0, 0, 0, 123), 18.0, 2.0), (21, NONE, 18.0, 0.0)


def fly(bench):
    bench.tell(mavlink.MAVLink_mission_set_current_message(1, 1, 0))
    mode(bench, GUIDED)
    assert bench.command(ARM, 1) == [OK]
    mode(bench, AUTO)
    assert bench.command(START) == [OK]
    return bench.until(lambda: bench.craft.reached == 1)


def looks(bench):
    return round(math.degrees(bench.craft.yaw_rad)) % 360


def turned(heading_deg, direction=0, relative=0):
    """Return a mission with a turn before the first waypoint."""
    return EAST[0], (TURN, (heading_deg, 0, direction, relative), 0.0, 0.0), *EAST[1:]


def test_it_looks_along_its_way_whatever_yaw_a_waypoint_has():
    vehicle = fly(send(bench(), *EAST))
    assert looks(vehicle) == 0
    vehicle.until(lambda: vehicle.craft.reached == 2)
    assert looks(vehicle) == 0


@pytest.mark.parametrize("turn, looks_deg", [((30.0,), 60), ((30.0, 1, 1), 330), ((30.0, -1, 1), 30)])
def test_a_turn_before_a_waypoint_is_good_for_that_one_alone(turn, looks_deg):
    vehicle = fly(send(bench(), *turned(*turn)))
    assert (looks(vehicle), vehicle.craft.current) == (looks_deg, 4)
    vehicle.until(lambda: vehicle.craft.reached == 2)
    assert looks(vehicle) == 0


def test_a_turn_is_forgotten_when_it_leaves_auto_and_begins_anew_when_it_is_sent_back_to_it():
    vehicle = bench(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)
    send(vehicle, EAST[0], EAST[1], (TURN, (30.0, 0, 0, 0), 0.0, 0.0), *EAST[2:])
    fly(vehicle).advance(1.0)
    for number, looks_deg in ((None, 0), (3, 60)):
        mode(vehicle, BRAKE)
        if number is not None:
            vehicle.heard.clear()
            vehicle.tell(mavlink.MAVLink_mission_set_current_message(1, 1, number))
            vehicle.advance(1.5)
            told = [message.seq for message in vehicle.of("MISSION_CURRENT")]
            assert (told[0], set(told[1:])) == (number, {4})  # once what it was told, then where it flies to
        mode(vehicle, AUTO)
        vehicle.advance(0.1)
        assert round(math.degrees(vehicle.craft._current_task().yaw_rad)) == looks_deg


def test_a_turn_is_kept_but_for_its_place():
    vehicle = send(bench(), *turned(30.5))
    vehicle.tell(mavlink.MAVLink_mission_request_int_message(1, 1, 2))
    turn = vehicle.advance(0.1).last("MISSION_ITEM_INT")
    assert (turn.frame, turn.command, turn.param1, turn.param4) == (0, TURN, 30.5, 0.0)
    assert (turn.x, turn.y, turn.z) == (0, 0, 0.0)


def test_in_auto_it_does_not_arm_and_stands_until_it_is_told_to_start():
    vehicle = bench()
    items(vehicle, 2.0)
    assert (mode(vehicle, AUTO), vehicle.command(ARM, 1)) == ([OK], [FAILED])
    assert vehicle.texts()[-1] == "Arm: Mode not armable"
    assert (mode(vehicle, GUIDED), vehicle.command(ARM, 1), mode(vehicle, AUTO)) == ([OK], [OK], [OK])
    assert vehicle.advance(3.0).craft.airborne is False
    assert vehicle.command(START) == [OK]
    vehicle.until(lambda: vehicle.craft.airborne, 5.0)
    vehicle.until(lambda: not vehicle.craft.armed)
    assert vehicle.advance(1.1).last("HEARTBEAT").custom_mode == AUTO  # it stays in its mode
    assert vehicle.texts()[-2:] == ["Arming motors", "Disarming motors"]


def test_without_a_mission_there_is_no_auto():
    vehicle = bench()
    assert mode(vehicle, AUTO) == [FAILED]
    assert vehicle.texts() == ["Mode change to AUTO failed: missing mission"]


def test_in_guided_it_climbs_when_it_is_told_to_from_the_ground_only():
    vehicle = bench()
    assert vehicle.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 3.0) == [FAILED]
    mode(vehicle, GUIDED)
    vehicle.command(ARM, 1)
    assert vehicle.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 3.0) == [OK]
    vehicle.until(lambda: vehicle.craft.height_m > 2.9)
    assert vehicle.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 9.0) == [FAILED]
    assert vehicle.command(ARM, 0) == [FAILED]


def test_by_force_it_disarms_in_the_air_and_falls():
    vehicle = bench()
    mode(vehicle, GUIDED)
    vehicle.command(ARM, 1)
    vehicle.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 3.0)
    vehicle.until(lambda: vehicle.craft.height_m > 2.9)
    assert vehicle.command(ARM, 0, 21196) == [OK]
    assert not vehicle.craft.armed
    assert vehicle.advance(1.0).craft.height_m == 0.0


def test_a_set_point_during_its_takeoff_ends_the_takeoff():
    vehicle = bench()
    mode(vehicle, GUIDED)
    vehicle.command(ARM, 1)
    vehicle.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 5.0)
    vehicle.tell(mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xDF8, 0, 0, -5.0, *[0] * 8))
    assert vehicle.advance(5.0).craft.airborne is False


def test_its_status_is_standby_on_the_ground_also_armed_and_critical_with_a_low_battery():
    vehicle = bench()
    mode(vehicle, GUIDED)
    vehicle.command(ARM, 1)
    assert vehicle.advance(1.1).last("HEARTBEAT").system_status == mavlink.MAV_STATE_STANDBY
    vehicle.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 3.0)
    vehicle.advance(4.0)
    assert vehicle.last("HEARTBEAT").system_status == mavlink.MAV_STATE_ACTIVE
    vehicle.power.drop_to(0.1)
    assert vehicle.advance(1.1).last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL


def test_a_position_that_is_lost_in_flight_lands_it():
    vehicle = bench(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    mode(vehicle, GUIDED)
    vehicle.command(ARM, 1)
    vehicle.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 3.0)
    vehicle.advance(4.0)
    assert vehicle.last("EKF_STATUS_REPORT").flags == 0x33F
    vehicle.craft.lose_gps()
    vehicle.advance(6.5)
    assert vehicle.last("HEARTBEAT").custom_mode == LAND
    assert vehicle.last("EKF_STATUS_REPORT").flags == 0xA7
    assert vehicle.last("SYS_STATUS").onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_GPS
    assert vehicle.texts()[-1] == "EKF Failsafe: changed to LAND Mode"
    assert [mode(vehicle, number) for number in (GUIDED, LOITER, BRAKE, STABILIZE)] == [[FAILED]] * 3 + [[OK]]


def test_what_stands_against_arming_is_said_when_it_is_asked():
    vehicle = bench()
    vehicle.craft.flags.not_ready["compass"] = "Compass not calibrated"
    assert vehicle.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == [OK]
    assert "PreArm: Compass not calibrated" in vehicle.texts()


def test_a_stream_of_set_points_may_stop():
    vehicle = bench()
    mode(vehicle, GUIDED)
    vehicle.command(ARM, 1)
    vehicle.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 3.0)
    vehicle.until(lambda: vehicle.craft.height_m > 2.9).advance(1.0)
    vehicle.tell(mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0xDF8, 4.0, 0, -3.0, *[0] * 8))
    vehicle.advance(10.0)
    assert vehicle.craft.position_m == pytest.approx((0.0, 4.0, 3.0), abs=0.1)
    assert vehicle.last("HEARTBEAT").custom_mode == GUIDED
    assert vehicle.t_ns > 10 * S


def test_messages_that_it_does_not_have_are_denied_with_a_text():
    """As ArduCopter 4.5.6: result DENIED, "No ap_message for mavlink id (436)"."""
    vehicle = bench()
    assert vehicle.command(INTERVAL, 436, 100_000) == [mavlink.MAV_RESULT_DENIED]
    assert vehicle.texts() == ["No ap_message for mavlink id (436)"]


def test_a_change_of_the_mode_is_a_heartbeat_at_once():
    vehicle = bench().advance(1.5)
    vehicle.heard.clear()
    assert mode(vehicle, LOITER) == [OK]
    assert [message.custom_mode for message in vehicle.advance(0.02).of("HEARTBEAT")] == [LOITER]


def test_a_low_battery_is_critical_without_any_action_and_stays_so_after_landing():
    """As ArduCopter 4.5.6 with BATT_FS_LOW_ACT 0: mode GUIDED all the while; CRITICAL, disarmed, on the ground."""
    vehicle = bench(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS)
    mode(vehicle, GUIDED)
    assert vehicle.command(ARM, 1) == [OK]
    vehicle.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, 3.0)
    vehicle.advance(5.0)
    vehicle.power.drop_to(0.05)
    vehicle.advance(2.0)
    beat = vehicle.last("HEARTBEAT")
    assert (beat.custom_mode, beat.system_status) == (GUIDED, mavlink.MAV_STATE_CRITICAL)
    mode(vehicle, LAND)
    vehicle.until(lambda: not vehicle.craft.armed).advance(1.5)
    assert vehicle.last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL
