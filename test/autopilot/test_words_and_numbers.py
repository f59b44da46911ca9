"""Texts, battery, sensors, parameters, rates, modes: each trap by itself."""

from __future__ import annotations

import struct
from math import nan

import pytest
from autopilot_tools import beat
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.vehicle.asked import Parameters, ParameterState, Rates
from amaze_autonomy.autopilot.vehicle.battery import Battery, BatteryReading
from amaze_autonomy.autopilot.vehicle.client import AutopilotClient
from amaze_autonomy.autopilot.vehicle.modes import Control, Heartbeat, kind_problem, mode_name, mode_number, px4_number
from amaze_autonomy.autopilot.vehicle.position import Place, Position
from amaze_autonomy.autopilot.vehicle.texts import Text, Texts
from amaze_autonomy.autopilot.vehicle.vehicle import (
    ClockOffset,
    Gps,
    GpsLimits,
    Sync,
    SystemStatus,
    VehicleState,
    gps_by_its_bit,
    gps_health,
)
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.events import Verdict
from amaze_autonomy.monitoring.battery import PackVolts
from amaze_autonomy.monitoring.specs import BatterySpec

S = 1_000_000_000
PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
CAPS = {2: 0.15, 3: 0.07}


# --- texts ------------------------------------------------------------------------------------------------------------


def text(said, severity=6, number=0, chunk=0):
    return mavlink.MAVLink_statustext_message(severity, said.encode(), number, chunk)


def heard(*messages, t_ns=0):
    texts = Texts()
    for message in messages:
        texts.add(t_ns, message)
    texts.wake(t_ns + 3 * S)
    return [each.text for each in texts.new]


def test_tabs_and_control_characters_are_cut_off():
    assert heard(text("Takeoff detected\t"), text("a\x07b\n")) == ["Takeoff detected", "a b"]


def test_chunks_are_put_together_in_their_order():
    first, second, third = "x" * 50, "y" * 50, "end"
    assert heard(text(first, 6, 9, 0), text(second, 6, 9, 1), text(third, 6, 9, 2)) == [first + second + third]


def test_a_text_with_a_lost_chunk_says_so_and_does_not_wait_for_ever():
    assert heard(text("x" * 50, 6, 9, 0), text("end", 6, 9, 2)) == ["x" * 50 + "[...]end"]
    assert heard(text("x" * 50, 6, 9, 0)) == ["x" * 50]


def test_a_new_text_ends_the_one_before():
    assert heard(text("x" * 50, 6, 9, 0), text("other", 4)) == ["x" * 50, "other"]


def test_the_same_text_twice_is_one_and_later_it_is_new():
    texts = Texts()
    for t_ns in (0, S, 10 * S):
        texts.add(t_ns, text("Preflight: GPS fix too low", 4))
    assert [each.t_ns for each in texts.new] == [0, 10 * S]
    assert texts.recent(10 * S, S) == (Text(10 * S, 4, "Preflight: GPS fix too low"),)


def test_only_reasons_not_to_arm_are_complaints():
    texts = Texts()
    for said, severity in (("PreArm: Compass not calibrated", 2), ("Low battery", 2), ("Preflight: fine", 6)):
        texts.add(0, text(said, severity))
    assert texts.complaints(S, 5 * S) == ("PreArm: Compass not calibrated",)
    assert texts.complaints(9 * S, 5 * S) == ()


# --- battery ----------------------------------------------------------------------------------------------------------


def pack(percent, cells=(4000,), state=1, number=0, current=100):
    return mavlink.MAVLink_battery_status_message(
        number, 0, 0, 0, [*cells, *[65535] * (10 - len(cells))], current, 0, 0, percent, 0, state
    )


@pytest.mark.parametrize(
    "message, reading",
    [
        (pack(84, (15800,)), BatteryReading(0, 0.84, 15.8, 3.95, 1.0, 1)),
        (pack(84, (4000, 3900, 4100)), BatteryReading(0, 0.84, 12.0, 3.9, 1.0, 1, (4.0, 3.9, 4.1))),
        (pack(84, (4000, 4000, 0, 4000)), BatteryReading(0, 0.84, 12.0, 0.0, 1.0, 1, (4.0, 4.0, 0.0, 4.0))),
        (pack(84, (4000,) * 4 + (0,) * 6), BatteryReading(0, 0.84, 16.0, 4.0, 1.0, 1, (4.0,) * 4)),
        (pack(-1, ()), BatteryReading(0, None, None, None, 1.0, 1)),
        (pack(101, ()), BatteryReading(0, None, None, None, 1.0, 1)),
        (pack(-53, (), current=-100), BatteryReading(0, None, None, None, None, 1)),
        (pack(80, (15800,), state=2), BatteryReading(0, 0.15, 15.8, 3.95, 1.0, 2)),
        (pack(80, (15800,), state=3), BatteryReading(0, 0.07, 15.8, 3.95, 1.0, 3)),
        (pack(5, (15800,), state=2), BatteryReading(0, 0.05, 15.8, 3.95, 1.0, 2)),
    ],
)
def test_a_pack(message, reading):
    battery = Battery(CAPS, cells=4)
    battery.add_pack(0, message)
    assert battery.reading() == reading


def test_of_two_packs_the_worse_counts_and_an_unknown_one_most():
    battery = Battery(CAPS)
    battery.add_pack(0, pack(80))
    battery.add_pack(0, pack(30, number=1))
    assert battery.reading().fraction == 0.3
    battery.add_pack(0, pack(-1, number=2))
    assert battery.reading().fraction is None


def test_of_two_packs_the_volts_of_each_are_told_and_the_lowest_cell_is_that_of_both():
    battery = Battery(CAPS, cells=4)
    battery.add_pack(0, pack(80, (16000,)))
    assert battery.volts() == (PackVolts(16.0),)
    battery.add_pack(0, pack(100, (4000, 3000, 4000, 4000), number=1))
    battery.add_pack(0, pack(-1, (5000,), number=4, current=-1))  # a rail of the avionics
    cells_v = (4.0, 3.0, 4.0, 4.0)
    assert battery.volts() == (PackVolts(16.0, (), "battery 0"), PackVolts(15.0, cells_v, "battery 1"))
    assert battery.reading() == BatteryReading(0, 0.8, 16.0, 3.0, 1.0, 1)


def test_sys_status_has_the_volts_of_the_only_pack_and_not_of_one_of_two():
    battery = Battery(CAPS, cells=4)
    assert battery.volts() == ()
    battery.add_system(0, mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 15200, -1, 70, 0, 0, 0, 0, 0, 0))
    assert battery.volts() == (PackVolts(15.2),)
    battery.add_pack(0, pack(80, ()))
    assert battery.volts() == (PackVolts(15.2),)
    battery.add_pack(0, pack(80, (16000,), number=1))
    assert battery.volts() == (PackVolts(None, (), "battery 0"), PackVolts(16.0, (), "battery 1"))


def test_a_monitor_of_volts_alone_is_no_pack_while_another_one_tells_its_level():
    """Of a rail of the avionics: an ArduPilot has nine monitors."""
    battery = Battery(CAPS)
    rail = pack(-1, (5000,), number=4, current=-1)
    battery.add_pack(0, rail)
    assert battery.reading()[:3] == (0, None, 5.0), "alone it may be one"
    battery.add_pack(S, pack(90, (16000,)))
    assert battery.reading()[:3] == (S, 0.9, 16.0)
    battery.add_pack(2 * S, pack(-1, (5000,), number=4, current=-1, state=3))
    assert battery.critical
    assert battery.reading().fraction is None, "and one that says that it is critical is"


def test_packs_that_are_told_in_turn_are_not_silent_meanwhile():
    battery = Battery(CAPS)
    for number in range(9):
        battery.add_pack(0, pack(90, number=number))
    assert battery.silent(9 * S) == ()
    assert len(battery.silent(9 * S + 1)) == 9


def test_without_packs_sys_status_counts():
    battery = Battery(CAPS, cells=4)
    battery.add_system(0, mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 15200, -1, 70, 0, 0, 0, 0, 0, 0))
    assert battery.reading() == BatteryReading(0, 0.7, 15.2, 3.8, None, 0)


def test_while_a_pack_is_silent_sys_status_does_not_count_in_its_place():
    """It may be of another pack, and has no charge state."""
    battery = Battery(CAPS)
    battery.add_pack(0, pack(30))
    battery.add_system(9 * S, mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 15200, -1, 70, 0, 0, 0, 0, 0, 0))
    assert battery.reading()[:2] == (0, 0.3)


# --- sensors ----------------------------------------------------------------------------------------------------------


def bits(present, enabled, health):
    return mavlink.MAVLink_sys_status_message(present, enabled, health, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)


def test_a_bit_that_leaves_has_failed_and_one_that_never_was_is_unknown():
    system = SystemStatus(3 * S)
    assert system.healthy(0, (32,)) is None
    system.add(0, bits(0, 0, 0))
    assert system.healthy(0, (32,)) is None
    system.add(0, bits(32, 32, 32))
    assert system.healthy(0, (32,)) is True
    system.add(0, bits(0, 0, 32))
    assert system.healthy(0, (32,)) is False
    assert system.healthy(9 * S, (32,)) is None
    assert system.sequence == 3, "each counts as a report of its own, whatever it says"


@pytest.mark.parametrize(
    "system, problem, by_bit",
    [
        (None, None, True),
        (True, None, True),
        (False, None, True),
        (None, "", False),
        (True, "", False),
        (False, "", True),
        (False, "silent for 3.0 s", False),
        (True, "silent for 3.0 s", False),
    ],
)
def test_what_decides_the_health_of_the_gps(system, problem, by_bit):
    assert gps_by_its_bit(system=system, problem=problem) is by_bit


def test_a_report_is_numbered_and_so_is_the_gps_by_what_decides():
    """A status that is told twice does not make two reports of one."""
    vehicle, gps = VehicleState(AutopilotSettings()), 1 << 31
    assert vehicle.sequences(0) == {"sensors_sequence": 0, "gps_sequence": 0}
    vehicle.receive(0, bits(32, 32, 32))
    assert vehicle.sequences(0) == {"sensors_sequence": 1, "gps_sequence": 1}
    vehicle.receive(1, fix(1))
    assert vehicle.sequences(1) == {"sensors_sequence": 1, "gps_sequence": gps + 1}
    vehicle.receive(2, bits(32, 32, 0))
    assert vehicle.sequences(2) == {"sensors_sequence": 2, "gps_sequence": 2}
    vehicle.receive(3, fix(2, 0))
    assert vehicle.sequences(3) == {"sensors_sequence": 2, "gps_sequence": gps + 2}
    assert vehicle.sequences(60 * S) == {"sensors_sequence": 2, "gps_sequence": 0}, "silence is told by each status"


def fix(t_usec, kind=3, **values):
    fields = {"lat": t_usec, "lon": 2, "alt": 3, "eph": 4, "epv": 5, "vel": 6, "cog": 7, **values}
    return mavlink.MAVLink_gps_raw_int_message(t_usec, kind, satellites_visible=9, **fields)


@pytest.mark.parametrize(
    "messages, problem",
    [
        ([(at, fix(at)) for at in range(8)], ""),
        ([(at, fix(at, 2)) for at in range(8)], "fix type 2, needed 3"),
        ([(at, fix(5)) for at in range(8)], "frozen: the same values for 7.0 s"),
        ([(at, fix(5, lat=at)) for at in range(8)], "frozen: the same values for 7.0 s"),
        ([(at, fix(at, lat=1)) for at in range(8)], "frozen: the same values for 7.0 s"),
        ([(0, fix(0))], "silent for 7.0 s"),
        ([], None),
    ],
)
def test_the_gps_by_its_own_messages(messages, problem):
    gps = Gps(GpsLimits())
    for t_s, message in messages:
        gps.add(t_s * S, message)
    assert gps.problem(7 * S) == problem


def test_the_kind_of_fix_and_the_satellites_are_known_while_they_are_told():
    gps = Gps(GpsLimits())
    assert gps.fix(0) == ("", None)
    for kind, words in ((0, "no GPS"), (1, "no fix"), (2, "2D"), (3, "3D"), (6, "RTK fixed"), (8, "type 8")):
        gps.add(S, fix(1, kind))
        assert gps.fix(3 * S) == (words, 9.0)
    assert gps.fix(3 * S + 1) == ("", None)
    gps.add(4 * S, mavlink.MAVLink_gps_raw_int_message(4, 3, 1, 2, 3, 4, 5, 6, 7, satellites_visible=255))
    assert gps.fix(4 * S) == ("3D", None)


@pytest.mark.parametrize(
    "system, problem, healthy",
    [(True, "", True), (True, "frozen", False), (False, "", False), (None, "", True), (None, None, None)],
)
def test_the_gps_is_bad_when_either_says_so(system, problem, healthy):
    assert gps_health(system=system, problem=problem) is healthy


# --- position ---------------------------------------------------------------------------------------------------------


def local(x=0.0, y=0.0, z=0.0, vz=0.0):
    return mavlink.MAVLink_local_position_ned_message(0, x, y, z, 0, 0, vz)


def flags(value):
    return mavlink.MAVLink_estimator_status_message(0, value, 0, 0, 0, 0, 0, 0, 0, 0)


def test_a_position_counts_from_the_takeoff_place_east_north_up():
    position = Position(2 * S, S // 2)
    position.add_px4_flags(0, flags(0b1101111111))
    position.add_local(0, local(1.0, 2.0, 0.5))
    position.rest(0, final=False)
    position.add_local(S, local(4.0, 8.0, -9.5, vz=-1.5))
    assert position.place(S) == Place(6.0, 3.0, 10.0, 1.5, 0.0)
    assert position.place(S + S // 2) == Place(6.0, 3.0, 10.0, 1.5, 0.0)
    assert position.place(S + S // 2 + 1) == Place(6.0, 3.0, 10.0), "it may move by now"
    assert position.place(9 * S) == Place()


@pytest.mark.parametrize("value", [nan, float("inf"), 1e9])
def test_what_is_no_number_is_no_position(value):
    position = Position(2 * S, S // 2)
    position.add_px4_flags(0, flags(0b1101111111))
    position.add_local(0, local())
    position.stand(0)
    position.add_local(0, local(x=value))
    assert position.place(0) == Place()


def test_ardupilot_without_a_position_says_constant_position_mode():
    position = Position(2 * S, S // 2)
    report = mavlink.MAVLink_ekf_status_report_message(0b10111111, 0, 0, 0, 0, 0)
    position.add_ardupilot_flags(0, report)
    assert not position.valid(0)
    position.add_ardupilot_flags(0, mavlink.MAVLink_ekf_status_report_message(0b00111111, 0, 0, 0, 0, 0))
    assert position.valid(0)


# --- parameters, rates, clocks, modes ---------------------------------------------------------------------------------


def value(name, number, kind=9):
    return mavlink.MAVLink_param_value_message(name.encode(), number, kind, 0, 0)


def test_whole_numbers_of_px4_are_in_the_bytes_and_of_ardupilot_in_the_value():
    bytewise = struct.unpack("<f", struct.pack("<i", 3))[0]
    for message, style in ((value("A", bytewise, 6), True), (value("A", 3.0, 6), False), (value("A", 3.0), True)):
        parameters = Parameters({"A": 3, "B": 1})
        parameters.add(message, bytewise=style)
        parameters.add(value("UNASKED", 7.0), bytewise=style)
        assert parameters.states == [ParameterState("A", 3, 3.0), ParameterState("B", 1, None)]
        assert [one.agrees for one in parameters.states] == [True, None]


@pytest.mark.parametrize(
    "expected, told, agrees",
    [
        (131072, 131073.0, False),
        (10040016, 10040015.0, False),
        (-200000, -200001.0, False),
        (200000, 200000.0, True),
        (0, 0.0, True),
        (0.1, struct.unpack("<f", struct.pack("<f", 0.1))[0], True),
        (2, 2.0000002, True),  # made of another unit
        (33554433, 33554432.0, True),  # a float has no bit for it
    ],
)
def test_whole_numbers_agree_exactly_and_others_as_well_as_a_float_can(expected, told, agrees):
    assert ParameterState("A", expected, told).agrees is agrees


def test_whole_numbers_that_differ_are_told_with_all_of_their_digits():
    state = ParameterState("SERVO_BLH_MASK", 10040016, 10040015.0)
    assert state.difference == "SERVO_BLH_MASK is 10040015, should be 10040016"
    assert ParameterState("A", 0.25, 1 / 3).difference == "A is 0.333333, should be 0.25"


def test_a_parameter_is_asked_for_until_it_is_answered():
    parameters = Parameters({"A": 3})
    asked = [t_s for t_s in range(30) if parameters.wake(t_s * S, 1, 1)]
    assert asked == [0, 1, 2, 3, 4, 14, 24]
    parameters.add(value("A", 4.0), bytewise=True)
    assert parameters.wake(60 * S, 1, 1) == []
    assert [one.agrees for one in parameters.states] == [False]


def test_a_silent_autopilot_is_asked_for_its_messages_and_one_that_streams_is_not():
    rates = Rates({"GPS_RAW_INT": 5.0})
    asked = [t_s for t_s in range(80) if rates.wake(t_s * S, 1, 1)]
    assert asked == [0, 3, 6, 9, 12, 42, 72]
    request = Rates({"GPS_RAW_INT": 5.0}).wake(0, 7, 1)[0]
    assert (request.target_system, request.command, request.param1, request.param2) == (7, 511, 24, 200_000)
    rates.heard(100 * S, "GPS_RAW_INT")
    assert rates.wake(100 * S + S // 2, 1, 1) == []
    assert rates.wake(0, 1, 1, ("GPS_RAW_INT",)) == []


@pytest.mark.parametrize("autopilot, other", [(PX4, 193), (ARDUPILOT, 230)])
def test_no_autopilot_is_asked_for_what_the_other_has(autopilot, other):
    client = AutopilotClient(AutopilotSettings(), BatterySpec(), lambda: (1, 1))
    asked = []
    for t_s in range(1, 40):
        client.receive(t_s * S, beat(autopilot=autopilot))
        asked += [message.param1 for message in client.wake(t_s * S) if message.get_type() == "COMMAND_LONG"]
    assert other not in asked
    assert {230, 193} - {other} <= set(asked)


def test_the_quickest_answer_tells_the_clock():
    offset = ClockOffset()
    for t_ns, took_ns in ((S, 40_000_000), (3 * S, 2_000_000), (5 * S, 30_000_000)):
        asked = offset.wake(t_ns)
        assert asked.ts1 == t_ns
        offset.add(t_ns + 1, mavlink.MAVLink_timesync_message(0, 77))
        offset.add(t_ns + took_ns, mavlink.MAVLink_timesync_message(t_ns + 100 * S + took_ns // 2, t_ns))
    assert offset.best == Sync(100 * S, 2_000_000)


@pytest.mark.parametrize(
    "autopilot, number, name",
    [
        (PX4, 4 << 16 | 6 << 24, "AUTO.LAND"),
        (PX4, 3 << 16, "POSCTL"),
        (PX4, 3 << 16 | 1 << 24, "ORBIT"),
        (PX4, 6 << 16, "OFFBOARD"),
        (PX4, 99 << 16 | 3 << 24, "MODE.99.3"),
        (ARDUPILOT, 4, "OFFBOARD"),
        (ARDUPILOT, 5, "POSCTL"),
        (ARDUPILOT, 24, "POSCTL"),
        (ARDUPILOT, 999, "MODE.999"),
    ],
)
def test_modes_have_px4_s_names(autopilot, number, name):
    assert mode_name(autopilot, number) == name


@pytest.mark.parametrize("number, name", [(9, "MODE.SURFACE"), (19, "MANUAL"), (2, "ALTCTL"), (5, "MODE.5")])
def test_a_submarine_s_modes_have_numbers_of_their_own(number, name):
    said = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_SUBMARINE, ARDUPILOT, 0, number, 4, 3)
    assert Heartbeat.of(0, said).mode == name


@pytest.mark.parametrize(
    "kind, problem",
    [
        *[(kind, "") for kind in (2, 3, 4, 13, 14, 15, 29, 35, 43)],
        (0, "the vehicle does not say what it is: set MAV_TYPE (PX4) or FRAME_CLASS (ArduPilot)"),
        (1, "the vehicle says that it is no multicopter (MAV_TYPE_FIXED_WING)"),
        (10, "the vehicle says that it is no multicopter (MAV_TYPE_GROUND_ROVER)"),
        (12, "the vehicle says that it is no multicopter (MAV_TYPE_SUBMARINE)"),
        (21, "the vehicle says that it is no multicopter (MAV_TYPE_VTOL_TILTROTOR)"),
        (250, "the vehicle says that it is no multicopter (MAV_TYPE 250)"),
    ],
)
def test_multicopters_alone_are_flown(kind, problem):
    assert kind_problem(kind) == problem


@pytest.mark.parametrize("autopilot, mission", [(PX4, 4 << 24 | 4 << 16), (ARDUPILOT, 3)])
@pytest.mark.parametrize("kind, verdict", [(13, Verdict.PASS), (1, Verdict.FAIL), (22, Verdict.FAIL)])
def test_what_is_no_multicopter_does_not_take_off_and_may_be_landed(autopilot, mission, kind, verdict):
    node = AutopilotClient(AutopilotSettings(), BatterySpec(), lambda: (1, 1))
    for t_ns in (S, 2 * S):
        node.receive(t_ns, mavlink.MAVLink_heartbeat_message(kind, autopilot, 129, mission, 4, 3))
    row = next(each for each in node.rows(2 * S, None) if each.name == "autopilot link")
    assert (row.verdict, row.advice, row.heals) == (verdict, kind_problem(kind), False)
    assert node.land(2 * S)[0].accepted


def test_modes_have_numbers_to_command_them():
    assert (mode_number(PX4, "AUTO.LAND"), mode_number(ARDUPILOT, "AUTO.LAND")) == ((4, 6), (9, 0))
    assert (px4_number("NO.SUCH"), mode_number(ARDUPILOT, "POSCTL")) == (None, None)


@pytest.mark.parametrize(
    "mode, armed, status, control",
    [
        ("AUTO.MISSION", True, 4, "ours"),
        ("POSCTL", True, 4, "pilot"),
        ("POSCTL", False, 3, "ours"),
        ("POSCTL", True, 5, "failsafe"),
        ("AUTO.RTL", True, 4, "pilot"),
        ("AUTO.RTL", True, 5, "failsafe"),
        ("AUTO.LAND", False, 8, "ours"),
        ("MODE.25", True, 4, "pilot"),
        ("MODE.25", True, 5, "failsafe"),
        ("MODE.25", False, 3, "ours"),
    ],
)
def test_who_has_control(mode, armed, status, control):
    known = Control()
    known.add(Heartbeat(0, armed, mode, status, PX4))
    assert ("failsafe" if known.failsafe else "pilot" if known.pilot else "ours") == control
    assert known.killed is (status == 8)


def test_a_mode_after_ours_was_confirmed_and_left_is_the_pilot_s_but_not_another_kind_of_landing():
    known = Control()
    known.command("AUTO.LAND")
    said = []
    for mode in ("AUTO.MISSION", "AUTO.LAND", "AUTO.PRECLAND", "AUTO.LOITER"):
        known.add(Heartbeat(0, True, mode, 4, PX4))
        said.append(known.pilot)
    assert said == [False, False, False, True]
    for pilot in (True, False):  # one heartbeat that says disarmed ends nothing, two do
        known.add(Heartbeat(0, False, "AUTO.LOITER", 3, PX4))
        known.add(Heartbeat(0, pilot, "AUTO.LOITER", 3, PX4))
        known.add(Heartbeat(0, True, "AUTO.MISSION", 4, PX4))
        assert known.pilot is pilot


def test_a_mode_that_one_message_shows_confirms_no_command():
    known = Control()
    known.command("AUTO.LAND")
    said = []
    for mode in ("AUTO.MISSION", "AUTO.LAND", "AUTO.MISSION", "AUTO.LAND", "AUTO.LAND", "AUTO.MISSION"):
        known.add(Heartbeat(0, True, mode, 4, PX4))
        said.append(known.pilot)
    assert said == [False, False, False, False, False, True]
