"""What the simulated PX4 does on its own: battery, position and transmitter lost, the pilot, faults of the world."""

from __future__ import annotations

import pytest
from px4_tools import LOITER, Bench, S, mode_of, set_point
from pymavlink.dialects.v20 import common as mavlink


@pytest.mark.parametrize(
    "action, modes", [(0, ["LOITER"]), (2, ["LOITER", "LAND"]), (3, ["LOITER", "RTL"])], ids=["warn", "land", "return"]
)
def test_a_critical_battery_holds_five_seconds_and_then_does_what_the_parameter_says(action, modes):
    bench = Bench().take_off()
    bench.px4.parameters["COM_LOW_BAT_ACT"] = action
    bench.advance(1.0).heard.clear()
    bench.power.drop_to(0.06)
    bench.advance(4.5)
    assert [mode_of(m) for m in bench.of("HEARTBEAT")] == ["LOITER"] * len(bench.of("HEARTBEAT"))
    bench.advance(1.7)
    assert list(dict.fromkeys(mode_of(m) for m in bench.of("HEARTBEAT"))) == modes
    assert bench.last("BATTERY_STATUS").charge_state == mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL
    held = "Failsafe activated: entering Hold for 5 seconds\t"
    assert (held in "".join(bench.texts())) == (action != 0)


def test_a_long_text_comes_in_chunks_of_fifty():
    bench = Bench().take_off()
    bench.px4._say(4, "x" * 120 + "\t")
    bench.heard.clear()
    bench.advance(0.1)
    chunks = [(len(m.text), m.chunk_seq) for m in bench.of("STATUSTEXT")]
    assert chunks == [(50, 0), (50, 1), (21, 2)]
    assert len({message.id for message in bench.of("STATUSTEXT")}) == 1
    assert len(bench.of("EVENT")) == 1


def test_texts_are_withheld_until_a_ground_station_is_heard():
    bench = Bench(kind=mavlink.MAV_TYPE_ONBOARD_CONTROLLER)
    bench.arm()
    bench.advance(1.0)
    assert bench.texts() == []
    assert len(bench.of("EVENT")) == 1
    bench.kind = mavlink.MAV_TYPE_GCS
    bench.advance(1.5)
    assert bench.texts() == ["Armed by external command\t"]


def test_a_lost_gps_is_seen_in_the_fix_at_once_and_in_the_sensors_late():
    bench = Bench().take_off(8.0).advance(1.0)
    bench.px4.parameters["SIM_GPS_USED"] = 0
    lost_ns = bench.t_ns
    seen = {}

    def look():
        fix, flags = bench.last("GPS_RAW_INT").fix_type, bench.last("ESTIMATOR_STATUS").flags
        present = bench.last("SYS_STATUS").onboard_control_sensors_present
        for name, happened in (
            ("fix", fix == 0),
            ("mode", bench.craft.mode == "DESCEND"),
            ("estimate", not flags & mavlink.ESTIMATOR_POS_HORIZ_ABS),
            ("bit", not present & mavlink.MAV_SYS_STATUS_SENSOR_GPS),
        ):
            if happened:
                seen.setdefault(name, round((bench.t_ns - lost_ns) / S, 1))
        return len(seen) == 4

    bench.until(look, 20.0)
    assert seen["fix"] <= 0.2
    assert seen["mode"] == pytest.approx(5.3, abs=0.1)
    assert seen["estimate"] == pytest.approx(5.8, abs=0.6)
    assert seen["bit"] == pytest.approx(7.9, abs=0.3)
    heartbeat = bench.advance(1.0).last("HEARTBEAT")
    assert (mode_of(heartbeat), heartbeat.system_status) == ("LAND", mavlink.MAV_STATE_CRITICAL)


def test_positions_stay_fresh_and_go_astray_while_the_position_is_lost():
    bench = Bench().take_off(8.0)
    true = bench.craft.position_m[0]
    bench.px4.parameters["SIM_GPS_USED"] = 0
    bench.advance(15.0).heard.clear()
    bench.advance(1.0)
    assert len(bench.of("LOCAL_POSITION_NED")) == 30
    assert abs(bench.last("LOCAL_POSITION_NED").y - true) > 10.0
    assert bench.mode(LOITER) == [0, mavlink.MAV_RESULT_TEMPORARILY_REJECTED]


def test_a_gps_that_comes_back_is_trusted_again_and_it_can_be_armed():
    bench = Bench()
    bench.px4.parameters["SIM_GPS_USED"] = 0
    bench.advance(9.0)
    assert bench.arm() == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]
    bench.px4.parameters["SIM_GPS_USED"] = 10
    bench.advance(6.0)
    assert bench.arm() == [0]


def test_the_pilot_takes_over_and_flies_by_hand():
    bench = Bench().take_off().advance(1.0)
    bench.craft.pilot_takes_over("POSCTL", 2 * S)
    heartbeat = bench.advance(1.1).last("HEARTBEAT")
    assert mode_of(heartbeat) == "POSCTL"
    assert heartbeat.base_mode & mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    assert heartbeat.system_status == mavlink.MAV_STATE_ACTIVE
    bench.until(lambda: not bench.craft.armed)


def test_a_failsafe_of_its_own_is_critical_until_somebody_commands_another_mode():
    bench = Bench().take_off().advance(1.0)
    bench.craft.enter_failsafe("AUTO.RTL")
    heartbeat = bench.advance(1.1).last("HEARTBEAT")
    assert (mode_of(heartbeat), heartbeat.system_status) == ("RTL", mavlink.MAV_STATE_CRITICAL)
    assert bench.mode(LOITER) == [0, 0]
    assert bench.advance(1.1).last("HEARTBEAT").system_status == mavlink.MAV_STATE_ACTIVE


def test_without_a_transmitter_rc_is_enabled_and_unhealthy_all_the_time():
    rc = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    for transmitter, expected in ((True, (True, True, True)), (False, (False, True, False))):
        bench = Bench(transmitter=transmitter).advance(1.0)
        word = bench.last("SYS_STATUS")
        bits = (
            word.onboard_control_sensors_present,
            word.onboard_control_sensors_enabled,
            word.onboard_control_sensors_health,
        )
        assert tuple(bool(each & rc) for each in bits) == expected
        assert bool(bench.of("RC_CHANNELS")) == transmitter


def test_a_transmitter_that_is_lost_is_noticed_after_half_a_second_and_its_receiver_makes_channels_up_at_once():
    bench = Bench(land_channel=7).advance(2.0)
    bench.craft.flags.not_ready["rc"] = "no transmitter"
    rc, seen = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER, []
    for _ in range(12):
        word = bench.advance(0.1).last("SYS_STATUS")
        seen.append((bench.last("RC_CHANNELS").chan7_raw, bool(word.onboard_control_sensors_health & rc)))
    assert seen[2:5] == [(2000, True)] * 3
    assert seen[-1] == (2000, False)


@pytest.mark.parametrize("mode, bit", [("AUTO.MISSION", 1), ("AUTO.LOITER", 2), ("OFFBOARD", 4)])
@pytest.mark.parametrize("exceptions", [0, 1, 2, 4, 7])
def test_a_transmitter_that_is_lost_in_flight_returns_unless_the_parameter_excepts_the_mode(mode, bit, exceptions):
    bench = Bench().take_off().advance(1.0)
    bench.px4.parameters["COM_RCL_EXCEPT"] = exceptions
    assert bench.upload(bench.items((50.0, 0.0, 2.0, 0.0))) == 0
    bench.craft.command_mode(mode)
    for step in range(80):
        if step == 10:
            bench.craft.flags.not_ready["rc"] = "no transmitter"
        set_point(bench, north=3.0)
        bench.advance(0.1)
    assert bench.craft.mode == (mode if exceptions & bit else "AUTO.RTL")
    assert ("Manual control lost\t" in bench.texts()) is not bool(exceptions & bit)


@pytest.mark.parametrize(
    "action, modes, text",
    [
        (1, ["AUTO.LOITER"], "Failsafe activated\t"),
        (2, ["AUTO.LOITER", "AUTO.RTL"], "Failsafe activated: entering Hold for 5 seconds\t"),
        (3, ["AUTO.LOITER", "AUTO.LAND"], "Failsafe activated: entering Hold for 5 seconds\t"),
    ],
    ids=["hold", "return", "land"],
)
def test_a_transmitter_that_is_lost_in_a_mission_does_what_the_parameter_says(action, modes, text):
    bench = Bench(parameters={"NAV_RCL_ACT": action}).take_off().advance(1.0)
    assert bench.upload(bench.items((50.0, 0.0, 2.0, 0.0))) == 0
    bench.craft.command_mode("AUTO.MISSION")
    bench.advance(1.0)
    assert modes_without_transmitter(bench) == ["AUTO.MISSION", *modes]
    assert text in bench.texts()
    assert bench.last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL
    bench.craft.flags.not_ready.clear()
    assert bench.advance(2.0).craft.mode == modes[-1]  # a transmitter that is back changes nothing


@pytest.mark.parametrize("action, modes", [(1, ["AUTO.LOITER"]), (2, []), (3, ["AUTO.LOITER", "AUTO.LAND"])])
@pytest.mark.parametrize("mode", ["AUTO.LAND", "AUTO.RTL"])
def test_a_transmitter_that_is_lost_on_the_way_down_interrupts_it_unless_the_parameter_says_return(mode, action, modes):
    bench = Bench(parameters={"NAV_RCL_ACT": action}).take_off(20.0).advance(1.0)
    bench.craft.command_mode(mode)
    bench.advance(1.0)
    assert modes_without_transmitter(bench) == [mode, *modes]


@pytest.mark.parametrize("battery, worse", [(2, "AUTO.LAND"), (3, "AUTO.RTL")], ids=["land", "return"])
@pytest.mark.parametrize("held_s", [1.0, 6.0], ids=["while it holds", "after that"])
def test_a_lost_transmitter_does_not_weaken_what_is_done_about_the_battery(battery, worse, held_s):
    bench = Bench(parameters={"COM_LOW_BAT_ACT": battery, "NAV_RCL_ACT": 1}).take_off(20.0).advance(1.0)
    bench.power.drop_to(0.06)
    bench.advance(held_s)
    modes_without_transmitter(bench)
    assert bench.craft.mode == worse


def test_a_lost_transmitter_lands_a_return_at_once():
    bench = Bench(parameters={"COM_LOW_BAT_ACT": 3, "NAV_RCL_ACT": 3}).take_off(20.0).advance(1.0)
    bench.power.drop_to(0.06)
    bench.advance(6.0)
    assert modes_without_transmitter(bench) == ["AUTO.RTL", "AUTO.LAND"]


@pytest.mark.parametrize("exceptions, modes", [(0, ["AUTO.LOITER"]), (2, [])])
def test_what_excepts_a_hold_excepts_a_takeoff_as_well(exceptions, modes):
    bench = Bench(parameters={"NAV_RCL_ACT": 1, "COM_RCL_EXCEPT": exceptions})
    bench.arm()
    bench.craft.climb_to(40.0)
    bench.until(lambda: bench.craft.height_m > 2.0)
    assert modes_without_transmitter(bench) == ["AUTO.TAKEOFF", *modes]


def modes_without_transmitter(bench, seconds=7.0):
    """Take the transmitter away; return the modes that follow, with the one before."""
    modes = [bench.craft.mode]
    bench.craft.flags.not_ready["rc"] = "no transmitter"
    for _ in range(round(seconds * 10)):
        bench.advance(0.1)
        modes += [bench.craft.mode] if bench.craft.mode != modes[-1] else []
    return modes


@pytest.mark.parametrize("sensor", ["gps", "imu", "magnetometer", "barometer"])
def test_a_sensor_is_unhealthy_or_not_reported_as_its_world_says(sensor):
    bits = {
        "gps": mavlink.MAV_SYS_STATUS_SENSOR_GPS,
        "imu": mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL,
        "magnetometer": mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG,
        "barometer": mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    }[sensor]
    bench = Bench()
    bench.health[sensor] = False
    word = bench.advance(1.0).last("SYS_STATUS")
    assert word.onboard_control_sensors_present & bits == bits
    assert word.onboard_control_sensors_health & bits == 0
    bench.health[sensor] = None
    word = bench.advance(1.0).last("SYS_STATUS")
    assert (word.onboard_control_sensors_present | word.onboard_control_sensors_enabled) & bits == 0


def test_an_unknown_battery_is_unknown_on_the_wire():
    bench = Bench()
    bench.power.known = False
    bench.advance(3.0).heard.clear()
    bench.advance(3.0)
    assert (bench.last("SYS_STATUS").battery_remaining, bench.last("SYS_STATUS").voltage_battery) == (-1, 65535)
    status = bench.last("BATTERY_STATUS")
    assert (status.battery_remaining, status.voltages[0], status.charge_state) == (-1, 65535, 0)


def test_parameters_are_read_listed_and_set_and_a_change_is_told_twice():
    bench = Bench()
    bench.tell(mavlink.MAVLink_param_request_list_message(1, 1))
    bench.advance(0.1)
    values = {message.param_id: message for message in bench.of("PARAM_VALUE")}
    assert len(values) == values["COM_LOW_BAT_ACT"].param_count
    bench.heard.clear()
    bench.tell(mavlink.MAVLink_param_set_message(1, 1, b"COM_FAIL_ACT_T", 2.5, mavlink.MAV_PARAM_TYPE_REAL32))
    bench.tell(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_FAIL_ACT_T", -1))
    bench.tell(mavlink.MAVLink_param_set_message(1, 1, b"COM_LOW_BAT_ACT", 2.5, mavlink.MAV_PARAM_TYPE_REAL32))
    bench.advance(0.1)
    assert [(m.param_id, m.param_value) for m in bench.of("PARAM_VALUE")][:3] == [("COM_FAIL_ACT_T", 2.5)] * 3
    assert bench.px4.parameters["COM_LOW_BAT_ACT"] == 0  # a number of the wrong kind changes nothing
    bench.heard.clear()
    bench.tell(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    assert bench.advance(0.1).of("PARAM_VALUE") == []
