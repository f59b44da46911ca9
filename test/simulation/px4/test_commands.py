"""Commands and modes: what is done, what is refused, and how it is acknowledged."""

from __future__ import annotations

import pytest
from px4_tools import LAND, LOITER, MISSION, NAN, OFFBOARD, POSCTL, RTL, STEP, TAKEOFF, Bench, S, mode_of, set_point
from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.engine.events import VehicleLanded

INTERVAL, FAILED = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_RESULT_FAILED
OK, LATER, DENIED, UNSUPPORTED = (
    mavlink.MAV_RESULT_ACCEPTED,
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
    mavlink.MAV_RESULT_DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED,
)


def test_a_takeoff_ends_in_hold_at_its_height():
    bench = Bench().take_off(3.0).advance(2.0)
    assert (round(bench.craft.height_m, 3), mode_of(bench.last("HEARTBEAT"))) == (3.0, "LOITER")
    assert bench.last("EXTENDED_SYS_STATE").landed_state == mavlink.MAV_LANDED_STATE_IN_AIR


def test_a_takeoff_without_an_altitude_goes_to_the_vehicles_own():
    bench = Bench()
    bench.arm()
    bench.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, NAN)
    bench.until(lambda: bench.craft.mode == "AUTO.LOITER")
    assert bench.craft.height_m == 2.5


def test_a_change_of_mode_is_acknowledged_twice_and_shown_by_the_heartbeat():
    bench = Bench().take_off()
    for numbers in (LAND, LOITER, RTL, POSCTL, LOITER):
        assert bench.mode(numbers) == [OK, OK]
        assert mode_of(bench.advance(1.1).last("HEARTBEAT")) == mode_of(
            mavlink.MAVLink_heartbeat_message(2, 12, 0, numbers[1] << 24 | numbers[0] << 16, 4, 3)
        )


def test_offboard_without_set_points_is_accepted_and_then_refused():
    bench = Bench().take_off()
    assert bench.mode(OFFBOARD) == [OK, LATER]
    assert bench.craft.mode == "AUTO.LOITER"


def test_offboard_goes_where_the_set_points_say_and_falls_back_a_second_after_they_stop():
    bench = Bench(transmitter=False).take_off()
    for _ in range(10):
        set_point(bench, north=3.0)
        bench.advance(0.1)
    assert bench.mode(OFFBOARD) == [OK, OK]
    for _ in range(60):
        set_point(bench, north=3.0)
        bench.advance(0.1)
    assert bench.craft.position_m == pytest.approx((0.0, 3.0, 2.0), abs=0.02)
    stopped_ns = bench.t_ns
    bench.until(lambda: bench.craft.mode == "POSCTL")
    assert (bench.t_ns - stopped_ns) / S == pytest.approx(0.9, abs=0.1)
    assert bench.advance(1.0).last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL
    assert bench.texts()[-1] == "Failsafe activated\t"
    bench.mode(LAND)
    assert bench.advance(1.0).last("HEARTBEAT").system_status == mavlink.MAV_STATE_ACTIVE
    bench.until(lambda: not bench.craft.armed).advance(1.0)
    # It shows the mode that was wanted before the landing, in which it could not be armed now.
    assert mode_of(bench.last("HEARTBEAT")) == "OFFBOARD"
    assert bench.last("HEARTBEAT").system_status == mavlink.MAV_STATE_UNINIT


@pytest.mark.parametrize("action, mode", [(3, "AUTO.RTL"), (4, "AUTO.LAND"), (5, "AUTO.LOITER")])
def test_a_stream_that_stops_ends_as_its_parameter_says(action, mode):
    bench = Bench(parameters={"COM_OBL_RC_ACT": action}).take_off()
    for _ in range(10):
        set_point(bench, north=3.0)
        bench.advance(0.1)
    assert bench.mode(OFFBOARD) == [OK, OK]
    bench.until(lambda: bench.craft.mode == mode, 2.0)
    assert bench.craft.failsafe


def test_set_points_of_velocity_move_it_as_long_as_they_say():
    bench = Bench().take_off()

    def push(velocity):
        bench.tell(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0b110111000111, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
            )
        )
        bench.advance(0.1)

    for _ in range(5):
        push((0.0, 0.0, 0.0))
    assert bench.mode(OFFBOARD) == [OK, OK]
    for _ in range(20):
        push((0.0, 1.0, 0.0))
    moved = bench.craft.position_m[0]
    assert moved == pytest.approx(2.0, abs=0.1)
    for _ in range(10):
        push((0.0, 0.0, 0.0))
    assert bench.craft.position_m[0] == pytest.approx(moved, abs=0.11)


def test_motors_that_are_on_for_nothing_stop_after_ten_seconds():
    bench = Bench()
    bench.arm()
    bench.advance(9.5)
    assert bench.craft.armed
    assert not bench.advance(1.0).craft.armed


def test_it_does_not_disarm_in_the_air_and_does_on_the_ground():
    bench = Bench().take_off()
    assert bench.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [LATER]
    assert bench.craft.armed
    bench = Bench()
    bench.arm()
    assert bench.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [OK]
    assert not bench.craft.armed


def test_by_force_it_disarms_in_the_air_and_falls():
    bench = Bench().take_off(8.0)
    assert bench.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == [OK]
    assert not bench.craft.armed
    assert bench.craft.landed == VehicleLanded.IN_AIR
    heights = [bench.advance(0.5).craft.height_m for _ in range(4)]
    assert heights == sorted(heights, reverse=True)
    assert (heights[-1], bench.craft.landed) == (0.0, VehicleLanded.ON_GROUND)
    assert bench.advance(1.0).arm() == [OK]


def test_a_vehicle_that_is_not_ready_refuses_to_arm_and_says_why():
    bench = Bench()
    bench.craft.flags.not_ready["kill_switch"] = "kill switch"
    bench.advance(1.5)
    health = bench.last("SYS_STATUS").onboard_control_sensors_health
    assert not health & mavlink.MAV_SYS_STATUS_PREARM_CHECK
    assert bench.last("HEARTBEAT").system_status == mavlink.MAV_STATE_UNINIT
    assert bench.arm() == [LATER]
    assert bench.texts()[0] == "Preflight Fail: kill switch\t"
    assert bench.texts()[-1] == "Arming denied: kill switch\t"
    assert not bench.craft.armed


def test_a_vehicle_that_does_not_arm_accepts_all_the_same():
    bench = Bench()
    bench.craft.flags.does_not_arm = True
    assert (bench.arm(), bench.craft.armed) == ([OK], False)


def test_a_mode_that_is_ignored_is_acknowledged_and_not_entered():
    bench = Bench().take_off()
    bench.craft.flags.ignores = ("AUTO.LAND",)
    assert (bench.mode(LAND), bench.craft.mode) == ([OK, OK], "AUTO.LOITER")


def test_landing_modes_are_no_modes_to_arm_in():
    bench = Bench()
    assert bench.mode(LAND) == [OK, OK]
    assert bench.arm() == [LATER]


def test_unknown_commands_and_those_for_others():
    bench = Bench()
    assert bench.command(31999) == [UNSUPPORTED]
    assert bench.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 77) == [UNSUPPORTED]
    for system, component in ((2, 1), (1, 154)):
        bench.tell(mavlink.MAVLink_command_long_message(system, component, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    bench.advance(0.1)
    assert not bench.craft.armed
    assert len(bench.of("COMMAND_ACK")) == 2


def test_some_commands_get_no_acknowledgement():
    bench = Bench(unacknowledged=(mavlink.MAV_CMD_COMPONENT_ARM_DISARM,))
    assert (bench.arm(), bench.craft.armed) == ([], True)


def test_the_old_message_changes_the_mode_without_an_acknowledgement():
    bench = Bench().take_off()
    bench.tell(mavlink.MAVLink_set_mode_message(1, 1, LAND[1] << 24 | LAND[0] << 16))
    bench.step(bench.t_ns + STEP)
    assert (bench.craft.mode, bench.of("COMMAND_ACK")[-1].command) == ("AUTO.LAND", mavlink.MAV_CMD_NAV_TAKEOFF)


def test_commands_for_the_mission():
    bench = Bench()
    assert bench.command(mavlink.MAV_CMD_MISSION_START) == [DENIED]
    bench.upload(bench.items((3.0, 0.0, 2.0, 0.0), (6.0, 0.0, 2.0, 0.0)))
    assert bench.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 9) == [DENIED]
    assert bench.command(mavlink.MAV_CMD_MISSION_START) == [OK]
    bench.until(lambda: bench.craft.current == 1)
    assert bench.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == [OK]
    assert bench.craft.mode == "AUTO.LOITER"
    assert bench.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1) == [OK]
    assert bench.craft.mode == "AUTO.MISSION"
    assert bench.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 2) == [OK]
    bench.until(lambda: bench.craft.position_m[0] > 5.9)
    assert bench.craft.item_reached in (-1, 2)


def test_messages_can_be_asked_for_once_and_more_often():
    bench = Bench()
    before = len(bench.of("AUTOPILOT_VERSION"))
    assert bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148) == [OK]
    assert len(bench.of("AUTOPILOT_VERSION")) == before + 1
    assert bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 9999) == [DENIED]
    assert bench.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 245, 100_000) == [OK]
    bench.heard.clear()
    bench.advance(2.0)
    assert len(bench.of("EXTENDED_SYS_STATE")) == 20
    bench.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 245, -1)
    bench.heard.clear()
    assert bench.advance(2.0).of("EXTENDED_SYS_STATE") == []
    bench.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 245, 0)
    assert len(bench.advance(2.0).of("EXTENDED_SYS_STATE")) == 11


def test_home_moves_when_the_motors_start():
    bench = Bench().advance(3.0)
    before = bench.last("HOME_POSITION").altitude
    assert bench.last("GLOBAL_POSITION_INT").relative_alt == pytest.approx(450, abs=60)
    bench.arm()
    bench.advance(3.0)
    assert bench.last("HOME_POSITION").altitude - before == 450
    assert bench.last("GLOBAL_POSITION_INT").relative_alt == pytest.approx(0, abs=60)


def test_takeoff_is_refused_in_the_air():
    bench = Bench().take_off()
    assert bench.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, NAN) == [LATER]
    assert bench.mode(MISSION) == [OK, LATER]  # there is none
    assert bench.mode(TAKEOFF) == [OK, OK]


def test_a_faster_heartbeat_is_refused_and_beats_go_on_once_a_second():
    """As PX4 v1.16.1: result FAILED, 1.0 Hz before and after."""
    bench = Bench().advance(1.0)
    assert bench.command(INTERVAL, 0, 200_000) == [FAILED]
    bench.heard.clear()
    assert len(bench.advance(10.0).of("HEARTBEAT")) == 10


def test_one_heartbeat_can_be_asked_for():
    """As PX4 v1.16.1: 20 requests in 4 s, 24 heartbeats."""
    bench = Bench().advance(1.0)
    bench.heard.clear()
    for _ in range(20):
        assert bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 0) == [OK]
        bench.advance(0.2 - STEP / S)
    assert len(bench.of("HEARTBEAT")) == 24


def test_current_mode_at_10_hz_comes_twice_a_second_and_with_each_change():
    """As PX4 v1.16.1: 2.0 Hz at rest, each change within 0.1 s."""
    bench = Bench().advance(1.0)
    assert bench.command(INTERVAL, 436, 100_000) == [OK]
    bench.heard.clear()
    assert len(bench.advance(10.0).of("CURRENT_MODE")) in (19, 20, 21)
    for numbers in (POSCTL, LOITER, POSCTL):
        bench.heard.clear()
        bench.mode(numbers)
        assert len(bench.advance(0.1).of("CURRENT_MODE")) in (1, 2)  # the change, and perhaps the usual one
        bench.advance(0.05)
