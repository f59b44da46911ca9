from __future__ import annotations

import struct
from math import cos, nan, pi, sin
from types import SimpleNamespace as Said

import pytest

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.mavros.messages import RECEIVED, STATE, Behind, Converter, sources_of
from amaze_autonomy.autopilot.mavros.requests import (
    CALL_LIMITS_S,
    LATE_NS,
    Lane,
    MavrosMission,
    Publication,
    Request,
    is_late,
    publication_of,
    request_of,
)
from amaze_autonomy.autopilot.planner.mission_vehicle import VehicleWatch
from amaze_autonomy.autopilot.planner.sequencer import PLANNER_MESSAGES
from amaze_autonomy.autopilot.vehicle.battery import Battery
from amaze_autonomy.autopilot.vehicle.client import AutopilotClient, command_long, set_mode
from amaze_autonomy.autopilot.vehicle.modes import (
    ARDUPILOT_NAMES,
    Heartbeat,
    autopilot_of,
    mavros_name,
    mavros_number,
    mode_name,
)
from amaze_autonomy.autopilot.vehicle.position import Position
from amaze_autonomy.autopilot.vehicle.vehicle import WANTED
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.events import Verdict
from amaze_autonomy.monitoring.battery import PackVolts
from amaze_autonomy.monitoring.specs import BatterySpec
from amaze_autonomy.simulation.px4 import Framing

S = 1_000_000_000
SOURCES = sources_of({*WANTED, *PLANNER_MESSAGES})
BY_TOPIC = {source.topic: source for source in SOURCES}
ATTITUDE = BY_TOPIC["imu/data"]


def convert(topic, **fields):
    return unreceived().convert(BY_TOPIC[topic], Said(**fields))


def unreceived():
    """Return a converter that nothing of what mavros receives comes to, for so long that its topics count."""
    converter = Converter()
    for _ in range(5):
        converter.convert(STATE, state("AUTO.LOITER"))
    return converter


def test_a_state_is_a_heartbeat_with_the_same_mode():
    message = convert("state", connected=True, armed=True, mode="AUTO.LAND", system_status=5)
    assert Heartbeat.of(7, message) == Heartbeat(7, armed=True, mode="AUTO.LAND", status=5, autopilot=12)


def test_a_mavros_without_a_vehicle_says_nothing():
    assert convert("state", connected=False, armed=False, mode="", system_status=0) is None


NOBODY, PX4, ARDUPILOT = 0, 12, 3


def state(mode, *, armed=False, connected=True, status=4):
    return Said(connected=connected, armed=armed, mode=mode, system_status=status)


def beats(*states):
    """Return the last heartbeat of a vehicle that mavros told so, and what is said of its mode."""
    converter = Converter()
    made = [converter.convert(STATE, each) for each in states]
    return Heartbeat.of(0, made[-1]), converter.behind.problem(states[-1])


@pytest.mark.parametrize("mode", ["", "NO.SUCH", "CMODE(25)", "MODE(0x51)"])
def test_before_a_mode_that_is_known_no_autopilot_is_claimed(mode):
    beat, _ = beats(state(mode, armed=True))
    assert (beat.mode, beat.autopilot) == ("MODE.0.0", NOBODY)
    assert Behind().problem(state("CMODE(25)")) == (
        "mavros says mode 'CMODE(25)', which is neither PX4's nor ArduPilot's: whoever chose it has control"
    )


@pytest.mark.parametrize(
    "said, mode",
    [
        ("STABILIZE", "STABILIZED"),
        ("GUIDED", "OFFBOARD"),
        ("AUTO", "AUTO.MISSION"),
        ("BRAKE", "AUTO.LOITER"),
        ("LOITER", "POSCTL"),
        ("LAND", "AUTO.LAND"),
        ("RTL", "AUTO.RTL"),
        ("CIRCLE", "ORBIT"),
        ("AVOID_ADSB", "MODE.19"),
    ],
)
def test_an_ardupilot_is_known_by_the_names_of_its_modes(said, mode):
    beat, problem = beats(state(said, armed=True, status=5))
    assert (beat, problem) == (Heartbeat(0, armed=True, mode=mode, status=5, autopilot=ARDUPILOT), "")


@pytest.mark.parametrize(
    "before, said, mode, autopilot",
    [
        ("AUTO", "CMODE(21)", "AUTO.RTL", ARDUPILOT),
        ("AUTO", "CMODE(24)", "POSCTL", ARDUPILOT),
        ("AUTO", "CMODE(9)", "AUTO.LAND", ARDUPILOT),
        ("AUTO", "CMODE(0)", "STABILIZED", ARDUPILOT),
        ("AUTO", "CMODE(28)", "MODE.28", ARDUPILOT),
        ("AUTO", "ACRO", "ACRO", ARDUPILOT),
        ("OFFBOARD", "CMODE(67371008)", "AUTO.MISSION", PX4),
        ("OFFBOARD", "CMODE(393216)", "OFFBOARD", PX4),
        ("OFFBOARD", "CMODE(184811520)", "MODE.4.11", PX4),
    ],
)
def test_numbers_that_mavros_has_no_name_for_are_read_once_the_autopilot_is_known(before, said, mode, autopilot):
    beat, problem = beats(state(before), state(said))
    assert (beat.mode, beat.autopilot, problem) == (mode, autopilot, "")


@pytest.mark.parametrize("flies, number", [("AUTO.MISSION", 4 << 24 | 4 << 16), ("AUTO", 3)])
def test_a_mavros_that_was_started_again_in_flight_is_no_pilot(flies, number):
    """It names the mode before it knows the autopilot: its first state has the number alone."""
    gone, back = state("", connected=False), state(f"CMODE({number})", armed=True)
    node, converter = client(state(flies, armed=True)), Converter()
    for t_s, said in ((1, state(flies, armed=True)), (2, gone), (5, back)):
        made = converter.convert(STATE, said)
        if made is not None:
            node.receive(t_s * S, made)
    answer, messages = node.land(5 * S)
    assert (node.vehicle.control.pilot, node.vehicle.beat.mode, answer.accepted) == (False, "AUTO.MISSION", True)
    assert len(messages) == 1


@pytest.mark.parametrize("said", ["CMODE()", "CMODE(x)", "MODE(0x00)", "SURFACE", "OFFBOARD", ""])
@pytest.mark.parametrize("armed", [True, False])
def test_a_mode_that_nobody_knows_keeps_the_autopilot_and_is_none_of_ours(said, armed):
    beat, problem = beats(state("AUTO", armed=armed), state(said, armed=armed))
    assert (beat.mode, beat.autopilot) == ("MODE.255", ARDUPILOT)
    whole = f"mavros says mode {said!r}, which is none of ArduPilot's: whoever chose it has control"
    assert problem == (whole if said else "")


@pytest.mark.parametrize("mode", ["AUTO.LAND", "POSCTL", "ACRO", ""])
def test_px4_s_modes_are_no_problem(mode):
    beat, problem = beats(state("OFFBOARD"), state(mode))
    assert (beat.autopilot, problem) == (PX4, "")


def test_in_the_air_the_autopilot_never_changes():
    beat, problem = beats(state("AUTO.MISSION", armed=True), *[state("GUIDED", armed=True)] * 100)
    assert (beat.autopilot, beat.mode) == (PX4, "MODE.0.0")
    assert problem == "mavros says mode 'GUIDED', which is none of PX4's: whoever chose it has control"


def test_on_the_ground_it_changes_by_several_states_in_a_row():
    px4, ardupilot = state("AUTO.LOITER"), state("STABILIZE")
    assert beats(px4, *[ardupilot] * 4)[0].autopilot == PX4
    assert beats(px4, *[ardupilot] * 5)[0] == Heartbeat(
        0, armed=False, mode="STABILIZED", status=4, autopilot=ARDUPILOT
    )
    assert beats(px4, *[*[ardupilot] * 4, px4] * 3)[0].autopilot == PX4
    assert beats(px4, *[*[ardupilot] * 4, state("CMODE(0)")] * 3)[0].autopilot == PX4
    assert beats(px4, *[ardupilot] * 4, state("STABILIZE", armed=True), ardupilot)[0].autopilot == PX4


def test_only_acro_is_a_mode_of_both():
    px4 = [mode_name(PX4, main << 16) for main in (1, 2, 3, 5, 6, 7, 8, 10)]
    px4 += [mode_name(PX4, sub << 24 | 4 << 16) for sub in range(1, 11)]
    assert {name for name in px4 if name in ARDUPILOT_NAMES} == {"ACRO"}
    assert {name for name in px4 if autopilot_of(name) != PX4} == {"ACRO"}


def test_names_and_numbers_of_mavros_are_one_table():
    for number in range(256):
        name = mavros_name(ARDUPILOT, number)
        assert mavros_number(ARDUPILOT, name) == number


def test_without_a_vehicle_behind_mavros_nothing_is_learnt():
    behind = Converter()
    assert behind.convert(STATE, state("GUIDED", connected=False)) is None
    assert behind.behind.autopilot == NOBODY


def client(*states, backend="mavros"):
    """Return the client of the autopilot node after mavros has told so, at 1 Hz."""
    node, converter = (
        AutopilotClient(AutopilotSettings(backend=backend), BatterySpec(cells=4), lambda: (1, 1)),
        Converter(),
    )
    for number, each in enumerate(states):
        node.receive(number * S, converter.convert(STATE, each))
        node.wake(number * S)
    return node


def row(node, name):
    return next(each for each in node.rows(0, None) if each.name == name)


def test_nobody_takes_off_before_it_is_known_who_lands_it():
    unknown = row(client(state("CMODE(25)")), "autopilot link")
    assert (unknown.verdict, unknown.heals) == (Verdict.FAIL, True)
    assert unknown.advice.startswith("mavros names a mode that neither PX4 nor ArduPilot has")
    for known in (client(state("CMODE(25)"), state("STABILIZE")), client(state("MANUAL"))):
        assert (row(known, "autopilot link").verdict, row(known, "autopilot link").advice) == (Verdict.PASS, "")
    assert row(client(state("CMODE(25)"), backend="mavlink"), "autopilot link").verdict is Verdict.PASS


def test_an_ardupilot_whose_flags_do_not_come_is_not_ready_and_it_is_said_why():
    ardupilot = client(state("STABILIZE"))
    assert row(ardupilot, "pre-arm check").advice.startswith("mavros hands on no EKF_STATUS_REPORT")
    ardupilot.receive(0, Converter().convert(RECEIVED, received(report(0xA7))))
    assert row(ardupilot, "pre-arm check").advice.startswith("the autopilot has no valid position")


@pytest.mark.parametrize(
    "mode, status, pilot, failsafe",
    [
        ("LAND", 5, False, True),  # by a failsafe of its own
        ("RTL", 5, False, True),
        ("AUTO", 5, False, False),  # a low battery about which nothing is done
        ("LOITER", 4, True, False),  # the pilot's switch
        ("CMODE(25)", 5, True, False),
        ("ALTCTL", 4, True, False),  # PX4's name of a mode, of an ArduPilot
    ],
)
def test_who_has_control_of_an_ardupilot_is_known_by_its_mode(mode, status, pilot, failsafe):
    told = state(mode, armed=True, status=status)
    flown = client(state("AUTO", armed=True), told, told)
    assert (flown.vehicle.control.pilot, flown.vehicle.control.failsafe) == (pilot, failsafe)
    answer, messages = flown.land(2 * S)
    asked = [request_of(each, ARDUPILOT).fields["custom_mode"] for each in messages]
    assert asked == ([] if pilot or failsafe else ["LAND"])  # that lands it already, or acts
    acts = "the autopilot acts by its failsafe" if mode == "RTL" else ""
    assert answer.message.startswith("the pilot has control" if pilot else acts)


def test_met_in_the_air_in_a_mode_that_nobody_knows_it_is_left_to_its_pilot():
    answer, messages = client(state("CMODE(25)", armed=True)).land(0)
    assert (answer.message, messages) == ("the pilot has control, in MODE.0.0", [])


# --- one message of the vehicle ---------------------------------------------------------------------------------------
# Behind mavros there is a heartbeat a second, and nothing else that says mode, armed and failsafe: five statuses come
# of one.


FLIES, TAKEN, DISARMED, FAILSAFE = (
    state("AUTO.MISSION", armed=True),
    state("POSCTL", armed=True),
    state("AUTO.MISSION"),
    state("AUTO.MISSION", armed=True, status=5),
)
LIES = pytest.mark.parametrize("lie", [TAKEN, DISARMED, FAILSAFE], ids=["pilot", "disarmed", "failsafe"])


class Told:
    """A node that mavros tells states at given times, and what its statuses say of them at 20 Hz."""

    def __init__(self, *states_at_s, until_s, backend="mavros"):
        self.node = AutopilotClient(AutopilotSettings(backend=backend), BatterySpec(cells=4), lambda: (1, 1))
        converter, waiting = Converter(), list(states_at_s)
        self.said, self.asked = [], []
        for step in range(round(20 * until_s)):
            t_ns = step * S // 20
            while waiting and waiting[0][0] * S <= t_ns:
                self.asked += self.node.receive(t_ns, converter.convert(STATE, waiting.pop(0)[1]))
            self.node.wake(t_ns)
            status = self.node.vehicle.status(t_ns)
            self.said.append((status.armed, status.mode, status.pilot_in_control, status.failsafe))

    def between(self, from_s, to_s):
        return set(self.said[round(20 * from_s) : round(20 * to_s)])


TRUE = (True, "AUTO.MISSION", False, False)


@LIES
@pytest.mark.parametrize("after_s", [0.05, 0.5, 0.95])
def test_what_one_message_alone_says_is_in_no_status(lie, after_s):
    told = Told((0, FLIES), (1, FLIES), (2, FLIES), (2 + after_s, lie), (3, FLIES), (4, FLIES), until_s=5)
    assert told.between(0, 5) == {TRUE}


@LIES
def test_what_two_messages_say_is_told_with_the_second(lie):
    told = Told((0, FLIES), (1, FLIES), (2, lie), (2.2, lie), (3.2, lie), until_s=4)
    assert told.between(0, 2.2) == {TRUE}
    assert len(told.between(2.2, 4)) == 1
    assert told.between(2.2, 4) != {TRUE}


@LIES
def test_what_nothing_contradicts_is_told_after_a_while(lie):
    told = Told((0, FLIES), (1, FLIES), (2, lie), until_s=4)
    assert told.between(0, 3.3) == {TRUE}
    assert TRUE not in told.between(3.4, 4)


def test_messages_that_never_agree_do_not_leave_the_status_as_it_was_for_good():
    swings = [(2 + number / 2, TAKEN if number % 2 == 0 else FAILSAFE) for number in range(8)]
    told = Told((0, FLIES), (1, FLIES), *swings, until_s=6)
    assert told.between(0, 3.3) == {TRUE}
    assert TRUE not in told.between(3.4, 6)


@LIES
def test_after_a_silence_nothing_is_told_that_is_older_than_it(lie):
    told = Told((0, FLIES), (1, FLIES), (8, lie), until_s=9)
    assert TRUE not in told.between(8, 9)


@LIES
def test_a_new_word_of_the_vehicle_has_another_heartbeat_asked_for(lie):
    told = Told((0, FLIES), (1, FLIES), (2, lie), until_s=2.5)
    request = request_of(told.asked[-1], PX4)
    assert (request.service, request.command, request.lane) == ("cmd/command", 512, Lane.REST)
    assert request.fields["param1"] == mavlink.MAVLINK_MSG_ID_HEARTBEAT


def test_a_landing_is_not_sent_from_the_first_sign_of_a_pilot_on():
    told = Told((0, FLIES), (1, FLIES), (2, TAKEN), until_s=2.5)
    answer, messages = told.node.land(2 * S + S // 2)
    assert (answer.message, messages) == ("the pilot has control, in POSCTL", [])


def test_over_a_link_of_our_own_a_first_sign_is_told_at_once():
    told = Told((0, FLIES), (1, FLIES), (2, TAKEN), until_s=2.5, backend="mavlink")
    assert told.between(2, 2.5) == {(True, "POSCTL", True, False)}


# --- what mavros receives ---------------------------------------------------------------------------------------------


def received(message, *, system=1, framing=1, sequence=0):
    """Return a mavros_msgs/Mavlink: what is behind the payload in its last 8 bytes is whatever was there before."""
    frame = Framing(system, 1).encode(message)
    length = frame[1]
    words = frame[10 : 10 + length].ljust(-(-length // 8) * 8, b"\xff")
    payload = struct.unpack(f"<{len(words) // 8}Q", words)
    number = int.from_bytes(frame[7:10], "little")
    return Said(
        framing_status=framing,
        len=length,
        seq=sequence % 256,
        sysid=system,
        compid=1,
        msgid=number,
        payload64=payload,
    )


def of_received(converter, message, *, component=1):
    """Return what is made of a message of our vehicle's system that mavros has received."""
    said = Said(**{**vars(received(message)), "compid": component})
    converter.note_sender(S, said)
    return converter.convert(RECEIVED, said)


def report(flags, airspeed=0.0):
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.2, 0.3, 0.4, 0.5, airspeed)


@pytest.mark.parametrize("flags, airspeed", [(0x33F, 0.0), (0xA7, 0.0), (0x33F, 0.25), (0, 0.0)])
def test_an_ekf_status_report_is_taken_from_what_mavros_receives(flags, airspeed):
    made = Converter().convert(RECEIVED, received(report(flags, airspeed)))
    assert (made.get_type(), made.flags) == ("EKF_STATUS_REPORT", flags)
    assert (made.velocity_variance, made.terrain_alt_variance) == (pytest.approx(0.1), pytest.approx(0.5))
    assert made.airspeed_variance == airspeed


def test_home_and_origin_on_the_earth_are_taken_from_what_mavros_receives():
    """Its topic has the altitude of home above the ellipsoid, and none has the origin's above the sea."""
    home = mavlink.MAVLink_home_position_message(473978318, 85456604, 485100, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
    origin = mavlink.MAVLink_gps_global_origin_message(473977420, 85455940, 488100)
    for said in (home, origin):
        made = Converter().convert(RECEIVED, received(said))
        assert made.get_type() == said.get_type()
        assert (made.latitude, made.longitude, made.altitude) == (said.latitude, said.longitude, said.altitude)


def test_all_zero_it_is_one_byte_long():
    zeros = mavlink.MAVLink_ekf_status_report_message(0, 0, 0, 0, 0, 0)
    assert received(zeros).len == 1
    assert Converter().convert(RECEIVED, received(zeros)).flags == 0


@pytest.mark.parametrize("flags, valid", [(0x33F, True), (0xA7, False), (0x33F | 1024, False), (0x33F | 128, False)])
def test_a_position_is_as_good_as_it_says(flags, valid):
    position = Position(10, 10)
    assert not position.judged
    position.add_ardupilot_flags(0, Converter().convert(RECEIVED, received(report(flags))))
    assert (position.judged, position.valid(0)) == (True, valid)


def pack(state, number=0, cells=(3000, 3000, 3000), percent=87):
    """Return a BATTERY_STATUS: three cells at 3.0 V, 87 % by the current, as an ArduCopter of 4.5.6 said."""
    volts = [*cells, *[65535] * (10 - len(cells))]
    return mavlink.MAVLink_battery_status_message(number, 0, 1, 32767, volts, 3933, 424, 157, percent, 0, state)


CRITICAL = mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL


def test_the_judgement_of_a_battery_is_taken_from_what_mavros_receives_and_its_topic_does_not_take_it_back():
    """mavros' topic `battery` is made of the same message, without the charge state."""
    ardupilot, converter = client(state("GUIDED", armed=True)), Converter()
    topic = Said(location="id0", voltage=9.0, cell_voltage=[3.0] * 3, current=-39.3, percentage=0.87)
    for number in range(8):
        for made in (of_received(converter, pack(CRITICAL)), converter.convert(BY_TOPIC["battery"], topic)):
            if made is not None:
                ardupilot.receive(number * S // 2, made)
    reading = ardupilot.vehicle.battery.reading()
    assert (reading.charge_state, reading.fraction, reading.voltage_v) == (CRITICAL, 0.07, 9.0)
    assert ardupilot.vehicle.status(4 * S).battery_critical
    for _ in range(5):  # that has ended: after five states its topic counts
        assert converter.convert(BY_TOPIC["battery"], topic) is None
        converter.convert(STATE, state("GUIDED", armed=True))
    assert converter.convert(BY_TOPIC["battery"], topic).charge_state == 0


@pytest.mark.parametrize("number", [0, 1])
def test_the_battery_of_a_gimbal_or_payload_is_no_pack_of_the_vehicle(number):
    """mavros publishes those of all components on one topic, also before anything that it receives has come."""
    ardupilot, converter = client(state("GUIDED", armed=True)), Converter()
    theirs = Said(location=f"id{number}", voltage=7.0, cell_voltage=[7.0], current=-0.1, percentage=0.12)
    for second in range(60):
        made = [converter.convert(STATE, state("GUIDED", armed=True))]
        for _ in range(10):
            made += [converter.convert(BY_TOPIC["battery"], theirs)]
            made += [of_received(converter, pack(1, number, percent=12), component=154)] if second > 2 else []
        made += [of_received(converter, pack(1, percent=80))] if second > 2 else []
        for each in made:
            if each is not None:
                ardupilot.receive(second * S, each)
    status = ardupilot.vehicle.status(59 * S)
    assert (status.battery_fraction, status.battery_age_s) == (0.8, 0.0)


def test_a_battery_that_mavros_receives_without_a_charge_state_is_not_judged():
    """Of MAVLink 1, or of an old autopilot, it is not in the payload."""
    old = pack(CRITICAL)
    whole = received(old)
    short = Said(**{**vars(whole), "len": 36})
    made = Converter().convert(RECEIVED, short)
    assert (made.charge_state, made.voltages[:4], made.battery_remaining) == (0, [3000, 3000, 3000, 65535], 87)


def test_a_text_in_chunks_is_whole_though_its_topic_has_each_chunk_alone():
    node, converter = client(state("AUTO.LOITER")), Converter()
    said = b"PreArm: GPS 1: primary but TYPE 0, compass 2 not calibrated: reboot needed"
    for chunk, words in enumerate((said[:50], said[50:])):
        message = mavlink.MAVLink_statustext_message(2, words, 7, chunk)
        topic = converter.convert(BY_TOPIC["statustext/recv"], Said(severity=2, text=words.decode()))
        for made in (topic, of_received(converter, message)):
            if made is not None:
                node.receive(S, made)
    assert node.vehicle.texts.complaints(S, S) == (said.decode(),)
    assert node.vehicle.texts.recent(S, S)[0].severity == 2


def test_without_what_mavros_receives_a_text_is_that_of_its_topic():
    made = convert("statustext/recv", severity=4, text="PreArm: Compass not healthy")
    assert (made.severity, made.text, made.id) == (4, "PreArm: Compass not healthy", 0)


@pytest.mark.parametrize(
    "charge_state, verdict, advice",
    [
        (None, Verdict.WARN, "the autopilot does not judge its battery: its level and voltage alone count"),
        (0, Verdict.WARN, "the autopilot does not judge its battery: its level and voltage alone count"),
        (99, Verdict.WARN, "the autopilot does not judge its battery: its level and voltage alone count"),
        (1, Verdict.PASS, ""),
        (7, Verdict.PASS, ""),
        (2, Verdict.FAIL, "the autopilot says low: change or charge the battery"),
        (CRITICAL, Verdict.FAIL, "the autopilot says critical: change or charge the battery"),
    ],
)
def test_a_battery_that_nobody_judges_is_warned_of_and_does_not_keep_it_on_the_ground(charge_state, verdict, advice):
    node = client(state("STABILIZE"), backend="mavlink")
    if charge_state is None:
        node.receive(0, mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 15800, 100, 90, 0, 0, 0, 0, 0, 0))
    else:
        node.receive(0, pack(charge_state, cells=(3950,) * 4, percent=90))
    found = node.check_battery(0, 0.5)
    row = found.checks[-1]
    assert (row.name, row.verdict, row.advice) == ("battery state", verdict, advice)
    assert found.ok is (verdict is not Verdict.FAIL)


def test_damaged_ones_those_of_others_and_all_else_are_passed_over():
    good = received(report(0x33F))
    bad = [
        received(report(0x33F), framing=2),
        received(report(0x33F), system=2),
        Said(**{**vars(good), "compid": 191}),
        Said(**{**vars(good), "payload64": good.payload64[:2]}),
        received(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)),
    ]
    converter = Converter()
    assert [converter.convert(RECEIVED, each) for each in bad] == [None] * len(bad)
    converter.target = (2, 1)
    assert converter.convert(RECEIVED, bad[1]).flags == 0x33F


def test_a_battery_keeps_what_is_unknown():
    full = convert("battery", location="", voltage=15.8, cell_voltage=[], current=-2.5, percentage=0.84)
    assert (full.voltages[:2], full.current_battery, full.battery_remaining) == ([15800, 65535], 250, 84)
    empty = convert("battery", location="id0", voltage=nan, cell_voltage=[], current=nan, percentage=nan)
    assert (empty.voltages[:2], empty.current_battery, empty.battery_remaining) == ([65535, 65535], -1, -1)
    cells_v = [4.0, 0.0, nan, *[4.0] * 9]
    large = convert("battery", location="", voltage=nan, cell_voltage=cells_v, current=nan, percentage=nan)
    assert large.voltages == [4000, 0, 65535, *[4000] * 7], "a cell of 0 V is dead"
    assert large.voltages_ext == [4000, 4000, 0, 0]


def test_position_and_velocity_come_together_north_east_down():
    converter = Converter()
    pose = Said(pose=Said(position=Said(x=1.0, y=2.0, z=3.0)))
    assert str(converter.convert(BY_TOPIC["local_position/pose"], pose).vz) == "nan"
    speed = Said(twist=Said(linear=Said(x=0.1, y=0.2, z=0.5)))
    assert converter.convert(BY_TOPIC["local_position/velocity_local"], speed) is None
    message = converter.convert(BY_TOPIC["local_position/pose"], pose)
    assert (message.x, message.y, message.z) == (2.0, 1.0, -3.0)
    assert (message.vx, message.vy, message.vz) == (0.2, 0.1, -0.5)
    for _ in range(4):
        assert converter.convert(BY_TOPIC["local_position/pose"], pose).vz == -0.5
    message = converter.convert(BY_TOPIC["local_position/pose"], pose)
    assert (message.z, str(message.vx), str(message.vz)) == (-3.0, "nan", "nan"), "its topic has ended"


@pytest.mark.parametrize("z, w, from_north", [(0.0, 1.0, pi / 2), (0.5**0.5, 0.5**0.5, 0.0), (1.0, 0.0, -pi / 2)])
def test_an_orientation_tells_the_heading_from_north(z, w, from_north):
    message = Converter().convert(ATTITUDE, Said(orientation=Said(x=0.0, y=0.0, z=z, w=w)))
    assert message.yaw == pytest.approx(from_north)


@pytest.mark.parametrize(
    "about, roll, pitch",
    [("x", pi / 3, 0.0), ("y", 0.0, -pi / 3)],  # nose up is against y, which is to the left
)
def test_an_orientation_tells_roll_and_pitch_as_mavlink_does(about, roll, pitch):
    axis = {"x": 0.0, "y": 0.0, "z": 0.0, about: sin(pi / 6)}
    message = Converter().convert(ATTITUDE, Said(orientation=Said(w=cos(pi / 6), **axis)))
    assert (message.roll, message.pitch) == (pytest.approx(roll), pytest.approx(pitch))


@pytest.mark.parametrize("w", [0.0, nan])
def test_an_orientation_that_is_none_tells_no_attitude(w):
    message = Converter().convert(ATTITUDE, Said(orientation=Said(x=0.0, y=0.0, z=0.0, w=w)))
    assert [str(angle) for angle in (message.roll, message.pitch, message.yaw)] == ["nan"] * 3


def test_the_orientation_of_a_pose_is_nobodys_word():
    """mavros puts one into each pose: level and to the east before any ATTITUDE came, the last one after they ended."""
    level = Said(x=0.0, y=0.0, z=0.0, w=1.0)
    pose = Said(pose=Said(position=Said(x=1.0, y=2.0, z=3.0), orientation=level))
    node, planner, converter = client(state("AUTO.LOITER")), VehicleWatch(), Converter()
    asked = []
    for number in range(1, 601):
        t_ns = number * S // 10
        for made in [converter.convert(each, pose) for each in SOURCES if each.topic == "local_position/pose"]:
            node.receive(t_ns, made)
            planner.take(t_ns, made)
        node.receive(t_ns, converter.convert(STATE, state("AUTO.LOITER")))
        asked += [each for each in node.wake(t_ns) if each.get_type() == "COMMAND_LONG"]
    assert (planner.heading(t_ns, S), node.vehicle.tilt.tilt_rad(t_ns)) == (None, None)
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE in {each.param1 for each in asked}


def test_a_place_and_its_height_come_together():
    converter = Converter()
    assert converter.convert(BY_TOPIC["global_position/rel_alt"], Said(data=2.5)) is None
    message = converter.convert(BY_TOPIC["global_position/global"], Said(latitude=47.1, longitude=-8.2))
    assert (message.lat, message.lon, message.relative_alt) == (471000000, -82000000, 2500)
    assert converter.convert(BY_TOPIC["global_position/global"], Said(latitude=nan, longitude=8.0)) is None
    for _ in range(4):
        assert converter.convert(BY_TOPIC["global_position/global"], Said(latitude=47.1, longitude=-8.2)) is not None
    assert converter.convert(BY_TOPIC["global_position/global"], Said(latitude=47.1, longitude=-8.2)) is None


def test_a_place_whose_height_never_came_is_none():
    assert convert("global_position/global", latitude=47.1, longitude=-8.2) is None


def test_only_topics_of_wanted_messages_are_listened_to():
    assert [source.topic for source in sources_of(["HEARTBEAT", "MISSION_CURRENT"])] == ["state", "mission/waypoints"]
    assert "mission/waypoints" not in {source.topic for source in sources_of(WANTED)}


def test_requests_of_the_client_are_services():
    land = request_of(set_mode(1, 1, 4, 6), PX4)
    assert land == Request("set_mode", {"base_mode": 0, "custom_mode": "AUTO.LAND"}, 176, Lane.MODE, lands=True)
    assert land.kind == "SetMode"
    disarm = request_of(command_long(1, 1, 400, 0.0), PX4)
    assert (disarm.service, disarm.fields["command"], disarm.fields["param1"]) == ("cmd/command", 400, 0.0)
    assert (disarm.lane, request_of(command_long(1, 1, 511, 0.0), PX4).lane) == (Lane.ARMING, Lane.REST)
    asked = mavlink.MAVLink_param_request_read_message(1, 1, b"COM_LOW_BAT_ACT", -1)
    assert request_of(asked, PX4) == Request("param/get", {"param_id": "COM_LOW_BAT_ACT"})
    assert request_of(mavlink.MAVLink_timesync_message(0, 1), PX4) is None


@pytest.mark.parametrize("mode, name", [(9, "LAND"), (3, "AUTO"), (4, "GUIDED"), (17, "BRAKE")])
def test_an_ardupilot_is_asked_for_a_mode_by_mavros_name_of_it(mode, name):
    fields = {"base_mode": 0, "custom_mode": name}
    assert request_of(set_mode(1, 1, mode, 0), ARDUPILOT) == Request(
        "set_mode", fields, 176, Lane.MODE, lands=name == "LAND"
    )


MISSION, DISARM, INTERVAL = set_mode(1, 1, 4, 4), command_long(1, 1, 400, 0.0), command_long(1, 1, 511, 0.0)


@pytest.mark.parametrize(
    "message, autopilot, late",
    [
        (set_mode(1, 1, 4, 6), PX4, False),
        (set_mode(1, 1, 9, 0), ARDUPILOT, False),
        (MISSION, PX4, True),
        (set_mode(1, 1, 3, 0), ARDUPILOT, True),
        (DISARM, PX4, True),
        (command_long(1, 1, mavlink.MAV_CMD_MISSION_START), ARDUPILOT, True),
        (command_long(1, 1, mavlink.MAV_CMD_NAV_TAKEOFF), ARDUPILOT, True),
        (INTERVAL, PX4, False),
    ],
    ids=["land", "land of ardupilot", "mission", "mission of ardupilot", "disarm", "start", "takeoff", "interval"],
)
def test_what_has_waited_for_half_a_second_is_no_command_any_more_but_for_a_landing(message, autopilot, late):
    request = request_of(message, autopilot)
    assert [is_late(request, waited_ns) for waited_ns in (LATE_NS, LATE_NS + 1)] == [False, late]


def test_a_waypoint_to_go_on_from_that_comes_late_is_no_command_any_more():
    (request,) = MavrosMission().take(mavlink.MAVLink_mission_set_current_message(1, 1, 3)).requests
    assert [is_late(request, waited_ns) for waited_ns in (LATE_NS, LATE_NS + 1)] == [False, True]


def test_a_landing_waits_for_nothing_that_mavros_waits_for():
    assert Lane.MODE not in {request_of(each, PX4).lane for each in (DISARM, INTERVAL)}
    assert CALL_LIMITS_S[Lane.MODE] <= 1.0
    assert set(CALL_LIMITS_S) == set(Lane)


def test_a_set_point_is_published_east_north_up():
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 3576, 2.0, 1.0, -3.0, 0, 0, 0, 0, 0, 0, pi / 2, 0
    )
    assert publication_of(message) == Publication(
        "setpoint_raw/local",
        "mavros_msgs/PositionTarget",
        {
            "coordinate_frame": 1,
            "type_mask": 3576,
            "yaw": 0.0,
            "position.x": 1.0,
            "position.y": 2.0,
            "position.z": 3.0,
            "velocity.x": 0,
            "velocity.y": 0,
            "velocity.z": 0,
        },
    )
    assert publication_of(set_mode(1, 1, 4, 6)) is None


def test_two_batteries_on_one_topic_are_told_apart_and_the_worst_counts():
    """mavros publishes each BATTERY_STATUS on one topic; its `location` names the battery."""
    battery = Battery({}, cells=4)
    for number, (where, level) in enumerate([("id0", 0.9), ("id1", 0.3)] * 3):
        said = convert("battery", location=where, voltage=15.0, cell_voltage=[], current=-1.0, percentage=level)
        assert said.id == number % 2
        battery.add_pack(number, said)
        if number:
            assert battery.reading().fraction == 0.3
    told = {"voltage": 14.85, "cell_voltage": [4.15, 4.15, 4.15, 2.4], "current": -1.0, "percentage": 0.9}
    battery.add_pack(6, convert("battery", location="id0", **told))
    one, other = PackVolts(14.85, (4.15, 4.15, 4.15, 2.4), "battery 0"), PackVolts(15.0, (), "battery 1")
    assert battery.volts() == (one, other)
    unnamed = convert("battery", location="", voltage=15.0, cell_voltage=[], current=-1.0, percentage=0.9)
    assert unnamed.id == 0


# --- who sent what mavros receives ------------------------------------------------------------------------------------


class Vehicle:
    """One behind mavros that says 50 messages a second, of which every fifth tells when it was started."""

    def __init__(self, converter, *, first=0, boot_s=100.0, system=1):
        self.converter, self.number, self.boot_s, self.system = converter, first, boot_s, system

    def say(self, t_s, *, armed=False, lost=False):
        self.number += 1
        if lost:
            return
        kinds = (
            mavlink.MAVLink_attitude_message(int(1000 * (t_s + self.boot_s)), 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_heartbeat_message(2, 12, 129 if armed else 1, 0, 4, 3),
            *[mavlink.MAVLink_vfr_hud_message(0, 0, 0, 0, 0, 0)] * 3,
        )
        said = received(kinds[self.number % len(kinds)], system=self.system, sequence=self.number)
        self.converter.note_sender(round(t_s * S), said)


def strangers(*vehicles, seconds=8, gone_at_s=None, loses=lambda _number: False):
    """Return who was told as a second vehicle, second by second; the first vehicle goes at a time."""
    converter, told = vehicles[0].converter, []
    for number in range(50 * seconds):
        t_s = 10 + number / 50
        for vehicle in vehicles:
            if vehicle is not vehicles[0] or gone_at_s is None or number < 50 * gone_at_s:
                vehicle.say(t_s, lost=loses(number))
        if number % 50 == 49:
            told.append(converter.strangers(round(t_s * S)))
    return told


MAVROS = ("mavros, where ours is, too",)


def test_two_vehicles_of_one_id_behind_mavros_are_told_apart_by_their_counts_of_messages():
    converter = Converter()
    assert converter.strangers(0) is None  # nobody can tell yet
    told = strangers(Vehicle(converter), Vehicle(converter, first=120, boot_s=4000.0))
    assert told == [MAVROS] * 8


def test_one_that_was_started_when_ours_was_may_be_ours_by_a_second_port():
    """A router that hears both ports hands on each message twice, under two counts: it is refused, and said so."""
    converter = Converter()
    told = strangers(Vehicle(converter), Vehicle(converter, first=120))
    assert told[-1] == (f"{MAVROS[0]} (started when ours was: perhaps ours by a second port)",)


@pytest.mark.parametrize("loses", [lambda _: False, lambda number: number % 3 == 0, lambda number: number % 200 < 100])
def test_one_vehicle_behind_mavros_is_one_though_messages_are_lost(loses):
    assert set(strangers(Vehicle(Converter()), seconds=20, loses=loses)) - {None} == {()}


def test_a_vehicle_of_another_id_is_told_since_mavros_mixes_it_into_ours():
    """Of all but heartbeats mavros looks at nobody's id: its landed state, battery and position come as ours."""
    converter = Converter()
    ours = Vehicle(converter)
    assert set(strangers(ours, Vehicle(converter, first=120, boot_s=4000.0, system=2))) == {("system 2, by mavros",)}
    for number in range(600):
        ours.say(18 + number / 50)
    assert converter.strangers(30 * S) == ()  # it was switched off


def test_one_of_another_id_is_told_also_while_nothing_of_ours_comes():
    converter = Converter()
    converter.note_sender(10 * S, received(mavlink.MAVLink_heartbeat_message(2, 12, 1, 0, 4, 3), system=7))
    assert (converter.strangers(20 * S), converter.strangers(20 * S + 1)) == (("system 7, by mavros",), None)


@pytest.mark.parametrize(
    "kind, autopilot, component",
    [(6, 8, 1), (6, 3, 1), (18, 8, 1), (2, 12, 191)],
    ids=["ground station", "one that says an autopilot", "companion", "no autopilot's component"],
)
def test_ground_stations_and_companions_of_another_id_are_no_vehicles(kind, autopilot, component):
    converter = Converter()
    vehicle = Vehicle(converter)
    beat = received(mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3), system=255)
    for number in range(50):
        vehicle.say(10 + number / 50)
        converter.note_sender((10 + number // 50) * S, Said(**{**vars(beat), "compid": component}))
    assert converter.strangers(11 * S) == ()


def test_what_is_damaged_is_nobodys():
    converter = Converter()
    Vehicle(converter).say(19)
    for number in range(400):
        t_ns = (20 + number // 50) * S
        converter.note_sender(t_ns, received(report(0), framing=2, sequence=number + 120))
        beat = mavlink.MAVLink_heartbeat_message(2, 12, 1, 0, 4, 3)
        converter.note_sender(t_ns, received(beat, framing=2, system=2))
    assert converter.strangers(28 * S) == ()


@pytest.mark.parametrize("system", [1, 2])
def test_behind_mavros_the_row_says_to_let_it_hear_one_vehicle(system):
    """Another id does not part them there."""
    now_ns, converter = [0], Converter()
    node = AutopilotClient(
        AutopilotSettings(backend="mavros"),
        BatterySpec(),
        lambda: (1, 1),
        lambda: 0,
        lambda: converter.strangers(*now_ns),
    )
    vehicles = [Vehicle(converter), Vehicle(converter, first=120, boot_s=4000.0, system=system)]
    for number in range(400):
        now_ns[0] = 10 * S + number * S // 50
        for vehicle in vehicles:
            vehicle.say(now_ns[0] / S)
    node.receive(now_ns[0], converter.convert(STATE, state("AUTO.LOITER")))
    found = next(each for each in node.rows(now_ns[0], None) if each.name == "one vehicle")
    who = "mavros, where ours is, too" if system == 1 else "system 2, by mavros"
    assert (found.verdict, found.heals, found.advice) == (
        Verdict.FAIL,
        True,
        f"mavros mixes another vehicle into ours ({who}): "
        "let mavros hear one vehicle alone (a link or port of its own)",
    )


def test_a_vehicle_that_takes_the_place_of_one_that_was_switched_off_is_no_second_one():
    converter = Converter()
    told = strangers(Vehicle(converter), seconds=3, gone_at_s=3)
    for number in range(400):
        other = Vehicle(converter, first=120 + number, boot_s=-15.0)
        other.say(20 + number / 50)
    assert (set(told), converter.strangers(28 * S)) == ({()}, ())


def test_what_mavros_received_once_tells_nobody_for_ever_that_it_hears_one_vehicle():
    """Its topic may end: another start of mavros without it, a relay that is gone."""
    converter = Converter()
    Vehicle(converter).say(10)
    assert (converter.strangers(20 * S), converter.strangers(20 * S + 1)) == ((), None)
    Vehicle(converter).say(70)
    assert converter.strangers(71 * S) == ()


@pytest.mark.parametrize("autopilot, mode", [(PX4, "AUTO.LOITER"), (ARDUPILOT, "LOITER")])
def test_what_kind_of_vehicle_it_is_is_told_by_its_own_heartbeat(autopilot, mode):
    """A plane's modes behind mavros have names that copters have, too."""
    converter = Converter()
    for kind, system, verdict in ((10, 2, Verdict.PASS), (13, 1, Verdict.PASS), (1, 1, Verdict.FAIL)):
        beat = mavlink.MAVLink_heartbeat_message(kind, autopilot, 1, 0, 4, 3)
        converter.note_sender(S, received(beat, system=system))
        node = AutopilotClient(AutopilotSettings(backend="mavros"), BatterySpec(), lambda: (1, 1))
        node.receive(S, converter.convert(STATE, state(mode)))
        found = next(each for each in node.rows(S, None) if each.name == "autopilot link")
        assert (found.verdict, "no multicopter" in found.advice) == (verdict, verdict is Verdict.FAIL)


def test_whether_the_vehicle_is_armed_is_told_by_its_own_heartbeat():
    converter = Converter()
    vehicle = Vehicle(converter)
    for number in range(10):
        vehicle.say(10 + number / 50, armed=True)
    assert converter.sources.armed
