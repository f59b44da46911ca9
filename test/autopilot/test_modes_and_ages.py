"""What decides a flight has an age of its own; a takeover is known at once, a failsafe by what it does.

Figures as measured on PX4 v1.16.1 and ArduCopter 4.5.6 in software-in-the-loop: PX4 refuses a faster HEARTBEAT
(FAILED), grants CURRENT_MODE (twice a second, and each change within 0.1 s), answers a request for one HEARTBEAT with
one, and sends EVENTs on every link; ArduPilot grants 5 Hz, beats at each change of the mode, and denies CURRENT_MODE.
"""

from __future__ import annotations

from math import pi, radians

import pytest
from autopilot_tools import beat
from client_bench import ClientBench
from px4_tools import POSCTL, S
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.link.dialect import current_mode_message, event_message
from amaze_autonomy.autopilot.vehicle.client import Reply
from amaze_autonomy.autopilot.vehicle.texts import event_id
from amaze_autonomy.autopilot.vehicle.vehicle import VehicleState
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.events import VehicleLanded, Verdict
from amaze_autonomy.simulation.ardupilot import ArduCraft, ArduPilot

pytestmark = pytest.mark.long

ASK_RATE, ASK_ONE = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_REQUEST_MESSAGE
ARDUPILOT, CRITICAL, ACTIVE = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_ACTIVE
GUIDED, COPTER_LOITER, COPTER_RTL, COPTER_LAND = 4, 5, 6, 9


def asked(bench, name):
    number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}", 436)
    return [
        m.param2
        for _, m in bench.sent
        if m.get_type() == "COMMAND_LONG" and m.command == ASK_RATE and m.param1 == number
    ]


def control(vehicle, t_ns=0):
    status = vehicle.status(t_ns)
    return "failsafe" if status.failsafe else "pilot" if status.pilot_in_control else "ours"


# --- PX4 ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9])
def test_a_takeover_on_px4_is_known_within_a_fifth_of_a_second_whenever_it_comes(at):
    bench = ClientBench().fly().advance(2.0 + at)
    assert bench.vehicle.status(bench.t_ns).pilot_in_control is False
    bench.far.mode(POSCTL)
    bench.advance(0.2)
    status = bench.vehicle.status(bench.t_ns)
    assert (status.mode, status.pilot_in_control) == ("POSCTL", True)


def test_px4_is_asked_for_its_mode_though_that_streams_by_itself_and_not_for_heartbeats_that_it_refuses():
    bench = ClientBench().advance(10.0)
    assert asked(bench, "CURRENT_MODE") == [100_000.0]
    assert asked(bench, "HEARTBEAT") == []


def test_a_heartbeat_that_is_lost_is_asked_for_again():
    bench = ClientBench().advance(3.0)
    bench.deaf = ("HEARTBEAT",)
    bench.advance(1.5)
    bench.deaf = ()
    before = bench.vehicle.beat.t_ns
    bench.advance(0.4)
    assert bench.vehicle.beat.t_ns > before
    assert bench.commands(ASK_ONE)


def test_the_system_status_is_asked_for_when_the_mode_has_changed():
    """A failsafe changes the mode; that it is one stands in the heartbeat, up to a second later."""
    bench = ClientBench().fly().advance(2.0)
    bench.until(lambda: bench.t_ns - bench.vehicle.beat.t_ns < 50_000_000)  # the next one is nearly 1 s away
    bench.far.craft.failsafe = True
    bench.far.craft.fall_into("AUTO.RTL")
    bench.advance(0.3)
    assert (bench.vehicle.status(bench.t_ns).mode, control(bench.vehicle, bench.t_ns)) == ("AUTO.RTL", "failsafe")


def said(client, t_ns):
    status = client.status(t_ns)
    return status.armed, status.landed.name, status.mode


@pytest.mark.parametrize("stood_s, woken", [(0.9, (True, "IN_AIR", "AUTO.LOITER")), (9.0, (None, "UNKNOWN", ""))])
def test_what_lay_in_the_socket_for_longer_than_it_holds_is_told_as_unknown_until_the_vehicle_speaks(stood_s, woken):
    """A heartbeat of before the landing, read after it, said that it was armed, just now."""
    bench = ClientBench().fly().advance(2.0)
    flies = next(message for _, _, message in reversed(bench.far.heard) if message.get_type() == "HEARTBEAT")
    t_ns = bench.t_ns + int(stood_s * S)
    assert said(bench.client, bench.t_ns) == (True, "IN_AIR", "AUTO.LOITER")
    bench.client.receive(t_ns, flies)
    bench.client.wake(t_ns, read=True)
    assert said(bench.client, t_ns) == woken
    bench.client.receive(t_ns + S // 2, flies)
    assert said(bench.client, t_ns + S // 2)[::2] == (True, "AUTO.LOITER")


def test_link_age_is_the_age_of_anything_and_armed_has_one_of_its_own():
    bench = ClientBench().fly().advance(2.0)
    bench.deaf = ("HEARTBEAT",)
    bench.advance(4.0)
    status = bench.vehicle.status(bench.t_ns)
    assert (status.link_age_s < 0.2, status.armed, status.mode) == (True, True, "AUTO.LOITER")
    bench.advance(2.0)
    status = bench.vehicle.status(bench.t_ns)
    assert (status.link_age_s < 0.2, status.armed, status.mode) == (True, None, "AUTO.LOITER")
    bench.deaf = ("HEARTBEAT", "CURRENT_MODE")
    bench.advance(6.0)
    assert bench.vehicle.status(bench.t_ns).mode == ""
    bench.deaf = ()
    bench.advance(1.5)
    status = bench.vehicle.status(bench.t_ns)
    assert (status.armed, status.mode) == (True, "AUTO.LOITER")


def beat_rows(bench):
    """Return verdict and age of the rows that the heartbeat alone decides."""
    rows = {row.name: row for row in bench.ask(bench.client.check, None)}
    return [(rows[name].verdict, rows[name].age_s) for name in ("not armed", "kill switch")]


def test_a_heartbeat_that_is_too_old_passes_no_row_and_says_no_vehicle_disarmed():
    bench = ClientBench().advance(6.0)
    bench.deaf = ("HEARTBEAT",)
    beat_ns = bench.vehicle.beat.t_ns
    bench.advance(4.0)
    assert beat_rows(bench) == [(Verdict.PASS, (bench.t_ns - beat_ns) / S)] * 2
    bench.advance(2.0)
    assert beat_rows(bench) == [(Verdict.UNKNOWN, (bench.t_ns - beat_ns) / S)] * 2
    reply = bench.ask(bench.client.disarm)
    assert (reply.accepted, reply.final) == (False, True)
    assert reply.message.startswith("whether it is armed is unknown: its last heartbeat came ")
    assert bench.commands(mavlink.MAV_CMD_COMPONENT_ARM_DISARM) == []
    bench.deaf = ()
    bench.advance(1.5)
    assert [verdict for verdict, _ in beat_rows(bench)] == [Verdict.PASS] * 2
    assert bench.ask(bench.client.disarm).accepted is True


def test_a_vehicle_last_heard_armed_is_disarmed_on_the_ground_and_that_is_not_believed_without_a_heartbeat():
    bench = ClientBench().fly()
    bench.ask(bench.client.land)
    bench.advance(1.0)
    bench.deaf = ("HEARTBEAT",)
    bench.until(lambda: bench.vehicle.landed(bench.t_ns) is VehicleLanded.ON_GROUND).advance(0.7)
    assert (bench.vehicle.armed(bench.t_ns), bench.far.craft.armed) == (None, True)
    assert bench.ask(bench.client.disarm).final is False
    bench.until(lambda: not bench.far.craft.armed, limit_s=0.5).advance(0.5)
    assert bench.client.disarm_reply().final is False
    bench.deaf = ()
    bench.advance(1.5)
    assert bench.client.disarm_reply() == Reply(accepted=True, message="the vehicle is disarmed", final=True)


@pytest.mark.parametrize(
    "deaf, unknown",
    [
        (("EXTENDED_SYS_STATE",), {"landed"}),
        (("LOCAL_POSITION_NED",), {"height", "position", "speed"}),
        (("ESTIMATOR_STATUS",), {"height", "position", "speed"}),
        (("BATTERY_STATUS", "SYS_STATUS"), {"battery"}),
        (("ATTITUDE",), {"tilt"}),
    ],
)
def test_each_value_that_grows_old_is_unknown_while_the_link_is_young(deaf, unknown):
    bench = ClientBench().fly().advance(2.0)

    def missing():
        status = bench.vehicle.status(bench.t_ns)
        found = {
            "landed": status.landed is VehicleLanded.UNKNOWN,
            "height": status.height_m is None,
            "position": status.position_x_m is None,
            "speed": status.horizontal_speed_m_s is None and status.vertical_speed_m_s is None,
            "battery": status.battery_age_s > 3.0,
            "tilt": status.tilt_deg is None,
            "link": status.link_age_s > 0.5,
        }
        return {name for name, bad in found.items() if bad}

    assert missing() == set()
    bench.deaf = deaf
    bench.advance(4.0)
    assert missing() == unknown


def test_a_vehicle_that_falls_over_is_known_to_within_half_a_second_and_one_wrong_attitude_is_none():
    bench = ClientBench().fly().advance(2.0)
    wrong = mavlink.MAVLink_attitude_message(0, pi, 0.0, 0.0, 0.0, 0.0, 0.0)
    bench.client.receive(bench.t_ns, wrong)
    assert bench.vehicle.status(bench.t_ns).tilt_deg < 15.0
    bench.far.craft.flags.lean_rad = radians(80.0)
    fell_ns = bench.t_ns
    while bench.vehicle.status(bench.t_ns).tilt_deg < 70.0:
        bench.step()
    assert 0.3 * S <= bench.t_ns - fell_ns <= 0.5 * S


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.slow_rows(1)
def test_a_fifth_of_all_packets_lost_for_two_minutes_makes_nothing_unknown(seed):
    bench = ClientBench(lost=0.2).fly()
    bench._noise.seed(seed)
    bench.advance(5.0)
    worst, bad = 0.0, []
    for _ in range(600):
        bench.advance(0.2)
        status = bench.vehicle.status(bench.t_ns)
        worst = max(worst, status.link_age_s)
        known = status.armed is True and status.mode and status.landed is VehicleLanded.IN_AIR
        if not known or status.height_m is None or status.position_x_m is None:
            bad.append(round(bench.t_ns / S, 1))
    assert bad == []
    assert worst < 0.5


def test_px4_that_disarms_and_goes_back_to_another_mode_is_no_takeover():
    """As PX4 v1.16.1: CURRENT_MODE shows the intended mode at the disarming, the heartbeat that says it 0.9 s later."""
    bench = ClientBench().fly().advance(2.0)
    bench.ask(bench.client.land)
    seen = set()
    while bench.vehicle.beat.armed:
        bench.step()
        status = bench.vehicle.status(bench.t_ns)
        seen.add((status.mode, status.pilot_in_control, status.armed))
    assert {mode for mode, _, armed in seen if armed} == {"AUTO.LOITER", "AUTO.LAND"}
    assert {pilot for _, pilot, _ in seen} == {False}


def test_before_the_first_heartbeat_a_mode_says_nothing():
    vehicle = VehicleState(AutopilotSettings())
    vehicle.receive(S, current_mode_message(0, 3 << 16, 3 << 16))
    status = vehicle.status(S)
    assert (status.armed, status.mode, status.link_age_s) == (None, "", None)


# --- the autopilot's own words ------------------------------------------------------------------------------------


def refused(name, modes=0x7E007C, level=0x33):
    arguments = list(modes.to_bytes(4, "little")) + [0] * 36
    return event_message(0, 0, 1 << 24 | event_id(name), 1000, 1, level, arguments)


def test_why_px4_does_not_arm_is_known_without_a_ground_station_by_its_events():
    """Ids as a real PX4 sent them when GPS was taken away."""
    assert event_id("commander_arm_denied_resolve_failures") == 0x102089D & 0xFFFFFF
    assert event_id("check_modes_local_pos") == 13835193
    assert event_id("check_modes_global_pos") == 10011251
    assert event_id("check_estimator_gps_fix_too_low") == 12369553
    vehicle = VehicleState(AutopilotSettings())
    vehicle.receive(S, beat(4 << 16 | 3 << 24, status=0))
    for number, name in enumerate(("commander_arm_denied_resolve_failures", "check_modes_local_pos")):
        vehicle.receive((2 + number) * S, refused(name))
    vehicle.receive(4 * S, refused("check_modes_global_pos", modes=1 << 14))  # OFFBOARD alone
    vehicle.receive(4 * S, refused("no_such_event"))
    assert vehicle.texts.complaints(5 * S, 60 * S) == (
        "Arming denied: Resolve system health failures first",
        "Preflight: no valid local position estimate",
    )


def test_the_same_as_a_text_and_as_an_event_is_said_once():
    vehicle = VehicleState(AutopilotSettings())
    vehicle.receive(S, beat(4 << 16 | 3 << 24, status=0))
    vehicle.receive(S, refused("check_estimator_gps_fix_too_low", level=0x44))
    vehicle.receive(S, mavlink.MAVLink_statustext_message(4, b"Preflight: GPS fix too low"))
    assert [text.text for text in vehicle.texts.new] == ["Preflight: GPS fix too low"]


def test_what_an_armed_px4_says_of_modes_that_it_is_not_in_is_no_reason_not_to_arm():
    vehicle = VehicleState(AutopilotSettings())
    vehicle.receive(S, beat(4 << 16 | 3 << 24, armed=True))
    vehicle.receive(S, refused("check_modes_local_pos"))
    assert vehicle.texts.complaints(2 * S, 60 * S) == ()


# --- ArduPilot: critical is not the same as acting ----------------------------------------------------------------


def copter(*beats):
    """Return an ArduCopter's vehicle after heartbeats of (mode, status), 0.2 s apart, armed."""
    vehicle = VehicleState(AutopilotSettings())
    for number, (mode, status) in enumerate(beats):
        vehicle.receive(number * S // 5, beat(mode, armed=True, autopilot=ARDUPILOT, status=status))
    return vehicle


@pytest.mark.parametrize(
    "beats, whose",
    [
        ([(GUIDED, ACTIVE), (GUIDED, CRITICAL)], "ours"),  # BATT_FS_LOW_ACT 0
        ([(GUIDED, ACTIVE), (GUIDED, CRITICAL), (COPTER_LOITER, CRITICAL)], "pilot"),
        ([(GUIDED, ACTIVE), (COPTER_LAND, CRITICAL)], "failsafe"),
        ([(GUIDED, ACTIVE), (GUIDED, CRITICAL), (COPTER_RTL, CRITICAL)], "failsafe"),
        ([(GUIDED, CRITICAL), (GUIDED, ACTIVE), (GUIDED, ACTIVE)], "ours"),
        ([(GUIDED, ACTIVE), (COPTER_RTL, ACTIVE)], "pilot"),
    ],
)
def test_a_failsafe_of_ardupilot_has_control_when_it_has_chosen_the_mode(beats, whose):
    assert control(copter(*beats)) == whose


def test_our_own_landing_at_a_critical_battery_is_no_failsafe():
    vehicle = copter((GUIDED, ACTIVE), (GUIDED, CRITICAL))
    vehicle.control.command("AUTO.LAND")
    vehicle.receive(S, beat(COPTER_LAND, armed=True, autopilot=ARDUPILOT, status=CRITICAL))
    assert control(vehicle, S) == "ours"


def test_a_critical_battery_of_which_the_autopilot_makes_nothing_is_said_to_be_one():
    """As recorded: 9 V of three cells, charge state CRITICAL, 87 % by the current, mode GUIDED all the while."""
    vehicle = copter((GUIDED, ACTIVE), (GUIDED, CRITICAL))
    pack = mavlink.MAVLink_battery_status_message(
        0, 0, 0, 32767, [9000, *[65535] * 9], 3933, 424, 157, 87, 0, mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL
    )
    vehicle.receive(S, pack)
    status = vehicle.status(S)
    assert (status.battery_critical, status.battery_fraction, control(vehicle, S)) == (True, 0.07, "ours")
    unknown = mavlink.MAVLink_battery_status_message(
        0, 0, 0, 32767, [9000, *[65535] * 9], -1, -1, -1, -1, 0, mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL
    )
    vehicle.receive(2 * S, unknown)
    status = vehicle.status(2 * S)
    assert (status.battery_critical, status.battery_fraction) == (True, None)
    assert vehicle.status(8 * S).battery_critical is True  # silence takes nothing back


def tell(vehicle, begin_s, end_s, packs, *, armed):
    """Let a vehicle beat, and its packs say their levels and charge states, twice a second."""
    for number in range(2 * begin_s, 2 * end_s):
        t_ns = number * S // 2
        vehicle.receive(t_ns, beat(GUIDED, armed=armed, autopilot=ARDUPILOT, status=ACTIVE))
        for name, (percent, charge_state) in packs.items():
            cells = [4000, *[65535] * 9]
            pack = mavlink.MAVLink_battery_status_message(name, 0, 0, 0, cells, 100, 0, 0, percent, 0, charge_state)
            vehicle.receive(t_ns, pack)


GOOD, SIXTEEN, EMPTY = (80, 1), (16, 1), (14, mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL)


def battery_at(vehicle, t_s):
    status = vehicle.status(t_s * S)
    return status.battery_fraction, status.battery_age_s, status.battery_critical


@pytest.mark.parametrize("worst, critical", [(SIXTEEN, False), (EMPTY, True)])
def test_a_pack_that_falls_silent_in_flight_leaves_its_level_which_grows_old_and_what_was_critical_stays(
    worst, critical
):
    vehicle = VehicleState(AutopilotSettings())
    level = min(worst[0] / 100, 0.07 if critical else 1.0)
    tell(vehicle, 0, 10, {0: GOOD, 1: worst}, armed=True)
    assert battery_at(vehicle, 10) == (level, 0.5, critical)
    tell(vehicle, 10, 30, {0: GOOD}, armed=True)
    assert battery_at(vehicle, 30) == (level, 20.5, critical)
    tell(vehicle, 30, 31, {0: GOOD, 1: GOOD}, armed=True)  # it is back, and says so itself
    assert battery_at(vehicle, 31) == (0.8, 0.5, False)


@pytest.mark.parametrize("packs", [5, 9, 16])
def test_the_last_of_as_many_packs_as_an_ardupilot_has_counts(packs):
    vehicle = VehicleState(AutopilotSettings())
    tell(vehicle, 0, 1, {**dict.fromkeys(range(packs - 1), GOOD), packs - 1: EMPTY}, armed=False)
    assert battery_at(vehicle, 1) == (0.07, 0.5, True)


def test_a_better_pack_that_falls_silent_in_flight_makes_the_level_old_as_well():
    vehicle = VehicleState(AutopilotSettings())
    tell(vehicle, 0, 10, {0: GOOD, 1: (30, 1)}, armed=True)
    tell(vehicle, 10, 20, {1: (25, 1)}, armed=True)
    assert battery_at(vehicle, 20) == (0.25, 10.5, False)


def test_a_pack_that_is_unplugged_on_the_ground_is_forgotten_after_half_a_minute():
    vehicle = VehicleState(AutopilotSettings())
    tell(vehicle, 0, 10, {0: GOOD, 1: EMPTY}, armed=True)
    tell(vehicle, 10, 12, {0: GOOD, 1: EMPTY}, armed=False)
    tell(vehicle, 12, 42, {0: GOOD}, armed=False)
    assert battery_at(vehicle, 42) == (0.07, 30.5, True)
    tell(vehicle, 42, 43, {0: GOOD}, armed=False)
    assert battery_at(vehicle, 43) == (0.8, 0.5, False)


def test_a_pack_that_fell_silent_in_flight_is_not_forgotten_until_the_autopilot_was_without_power():
    vehicle = VehicleState(AutopilotSettings())
    tell(vehicle, 0, 10, {0: GOOD, 1: SIXTEEN}, armed=True)
    tell(vehicle, 10, 20, {0: GOOD}, armed=True)
    tell(vehicle, 20, 100, {0: GOOD}, armed=False)
    assert battery_at(vehicle, 100) == (0.16, 90.5, False)
    tell(vehicle, 110, 112, {0: GOOD}, armed=False)
    assert battery_at(vehicle, 112) == (0.8, 0.5, False)


def test_a_restart_of_the_autopilot_forgets_a_pack_that_fell_silent_in_flight():
    vehicle = VehicleState(AutopilotSettings())
    vehicle.receive(0, mavlink.MAVLink_local_position_ned_message(500_000, 0, 0, 0, 0, 0, 0))
    tell(vehicle, 0, 10, {0: GOOD, 1: SIXTEEN}, armed=True)
    tell(vehicle, 10, 20, {0: GOOD}, armed=True)
    vehicle.receive(20 * S, mavlink.MAVLink_local_position_ned_message(2_000, 0, 0, 0, 0, 0, 0))
    tell(vehicle, 20, 45, {0: GOOD}, armed=False)
    assert battery_at(vehicle, 45) == (0.8, 0.5, False)


def test_a_silence_of_the_link_on_the_ground_loses_no_pack():
    vehicle = VehicleState(AutopilotSettings())
    tell(vehicle, 0, 10, {0: GOOD, 1: SIXTEEN}, armed=False)
    tell(vehicle, 18, 19, {}, armed=False)
    assert battery_at(vehicle, 19) == (0.16, 9.5, False)
    tell(vehicle, 19, 50, {0: GOOD}, armed=False)
    assert battery_at(vehicle, 50) == (0.8, 0.5, False)


@pytest.mark.parametrize("armed, told", [(True, (0.07, 0.5, True)), (False, (0.87, 0.5, False))])
def test_in_flight_a_charge_state_that_is_not_told_any_more_takes_nothing_back(armed, told):
    """As behind mavros, whose topic `battery` is without it, when `mavlink/from` ends."""
    vehicle = VehicleState(AutopilotSettings())
    tell(vehicle, 0, 10, {0: (87, EMPTY[1])}, armed=armed)
    tell(vehicle, 10, 20, {0: (87, 0)}, armed=armed)
    assert battery_at(vehicle, 20) == told
    tell(vehicle, 20, 21, {0: (87, 1)}, armed=armed)
    assert battery_at(vehicle, 21) == (0.87, 0.5, False)


def test_a_takeover_on_ardupilot_is_known_at_once():
    bench = ClientBench(autopilot=(ArduCraft, ArduPilot)).advance(3.0)
    bench.far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    bench.far.arm()
    bench.far.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0)
    bench.until(lambda: bench.vehicle.landed(bench.t_ns).name == "IN_AIR").advance(1.0)
    bench.far.command(mavlink.MAV_CMD_DO_SET_MODE, 1, COPTER_LOITER)
    bench.advance(0.06)
    assert (bench.vehicle.beat.mode, control(bench.vehicle, bench.t_ns)) == ("POSCTL", "pilot")
    assert asked(bench, "CURRENT_MODE") == []


# --- GPS ----------------------------------------------------------------------------------------------------------


def fix(stamp):
    return mavlink.MAVLink_gps_raw_int_message(stamp, 6, 473977420, 85455940, 488100, 121, 200, 0, 0, 10)


@pytest.mark.parametrize("armed, healthy", [(False, True), (True, False)])
def test_a_gps_that_says_the_same_with_new_stamps_is_frozen_in_the_air_and_not_at_rest(armed, healthy):
    """As a real ArduCopter's on the ground: 20 messages in 5 s, 20 stamps, one value."""
    vehicle = VehicleState(AutopilotSettings())
    for number in range(50):
        t_ns = number * S // 5
        vehicle.receive(t_ns, beat(GUIDED, armed=armed, autopilot=ARDUPILOT, status=3))
        vehicle.receive(t_ns, mavlink.MAVLink_extended_sys_state_message(0, 2 if armed else 1))
        vehicle.receive(t_ns, fix(1000 + number))
    assert (vehicle.gps.problem(t_ns) == "") is healthy


def test_a_gps_whose_stamps_stand_still_is_frozen_at_rest_too():
    vehicle = VehicleState(AutopilotSettings())
    for number in range(50):
        vehicle.receive(number * S // 5, beat(GUIDED, autopilot=ARDUPILOT, status=3))
        vehicle.receive(number * S // 5, fix(1000))
    assert vehicle.gps.problem(10 * S).startswith("frozen")


def test_a_vehicle_that_has_just_lifted_off_gets_its_time():
    vehicle = VehicleState(AutopilotSettings())
    for number in range(60):
        t_ns = number * S // 5
        vehicle.receive(t_ns, beat(GUIDED, armed=number > 20, autopilot=ARDUPILOT, status=3))
        vehicle.receive(t_ns, mavlink.MAVLink_extended_sys_state_message(0, 1 if number < 50 else 3))
        vehicle.receive(t_ns, fix(1000 + number))
    assert vehicle.gps.problem(t_ns) == ""


# --- the pre-flight table: what comes by itself -------------------------------------------------------------------


def healing(bench):
    rows = bench.ask(bench.client.check, None)
    return {row.name for row in rows if row.heals}


def test_rows_that_come_by_themselves_say_so_and_what_a_person_must_do_does_not():
    silent = ClientBench()
    silent.cut = True
    silent.advance(1.0)
    assert "autopilot link" in healing(silent)
    bench = ClientBench(transmitter=False)
    bench.far.craft.flags.not_ready["home"] = "no home"
    bench.advance(6.0)
    found = healing(bench)
    assert {"home position", "pre-arm check", "RC receiver"} <= found  # a transmitter is switched on meanwhile
    assert not {"not armed", "kill switch"} & found
    ready = ClientBench().advance(6.0)
    assert healing(ready) == set()
