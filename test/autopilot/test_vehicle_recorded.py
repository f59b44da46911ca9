"""The state of the vehicle against what PX4 and ArduPilot were recorded to say; times as in the .timeline.txt files."""

from __future__ import annotations

from autopilot_tools import beat
from recorded import Flight, changes, recording, texts

from amaze_autonomy.autopilot.link.framing import TlogCount, read_tlog


def flying(vehicle, t_ns):
    status = vehicle.status(t_ns)
    control = "failsafe" if status.failsafe else "pilot" if status.pilot_in_control else "ours"
    return status.armed, status.landed.name, status.mode, control


def test_a_normal_mission():
    assert changes("px4_normal_mission.tlog", flying) == [
        (0.0, (None, "UNKNOWN", "", "ours")),
        (0.2, (None, "ON_GROUND", "", "ours")),
        (1.0, (False, "ON_GROUND", "AUTO.LOITER", "ours")),
        (2.0, (True, "ON_GROUND", "AUTO.MISSION", "ours")),
        (3.6, (True, "TAKING_OFF", "AUTO.MISSION", "ours")),
        (13.2, (True, "IN_AIR", "AUTO.MISSION", "ours")),
        (43.7, (True, "LANDING", "AUTO.MISSION", "ours")),
        (66.4, (True, "ON_GROUND", "AUTO.MISSION", "ours")),
        (66.8, (False, "ON_GROUND", "AUTO.MISSION", "ours")),
    ]


def test_a_lost_gps_is_px4_s_failsafe_and_the_mode_after_disarming_says_nothing():
    assert changes("px4_gps_loss_param.tlog", flying)[4:] == [
        (2.9, (True, "TAKING_OFF", "AUTO.MISSION", "ours")),
        (13.7, (True, "IN_AIR", "AUTO.MISSION", "ours")),
        (27.7, (True, "IN_AIR", "AUTO.LAND", "failsafe")),
        (45.6, (True, "ON_GROUND", "AUTO.LAND", "failsafe")),
        (48.0, (False, "ON_GROUND", "AUTO.MISSION", "ours")),
    ]


def test_a_lost_gps_is_seen_at_once_though_sys_status_is_8_s_late():
    def gps(vehicle, t_ns):
        bit = vehicle.system.healthy(t_ns, (32,))
        return bit, vehicle.health(t_ns)["gps"], vehicle.gps.problem(t_ns)

    fix = "fix type 0, needed 3"
    assert changes("px4_gps_loss_param.tlog", gps)[-4:] == [
        (21.8, (True, False, fix)),
        (29.5, (False, False, fix)),
        (49.8, (False, False, "")),
        (51.8, (True, True, "")),
    ]


def test_positions_come_on_while_the_estimate_is_lost_and_are_not_believed():
    def place(vehicle, t_ns):
        status = vehicle.status(t_ns)
        return status.height_m is not None, status.position_x_m is not None, vehicle.position._local is not None

    assert changes("px4_gps_loss_param.tlog", place)[-3:] == [
        (0.2, (True, True, True)),
        (27.2, (True, False, True)),
        (51.1, (True, True, True)),
    ]


def test_a_battery_that_drains_to_px4_s_failsafes():
    said = changes("px4_battery_drain.tlog", flying)
    assert said[5:] == [
        (17.4, (True, "IN_AIR", "AUTO.MISSION", "ours")),
        (63.4, (True, "IN_AIR", "AUTO.LOITER", "failsafe")),
        (68.3, (True, "LANDING", "AUTO.LOITER", "failsafe")),
        (68.5, (True, "LANDING", "AUTO.LAND", "failsafe")),
        (85.9, (True, "ON_GROUND", "AUTO.LAND", "failsafe")),
        (88.8, (False, "ON_GROUND", "AUTO.MISSION", "ours")),
    ]


def test_the_battery_level_falls_and_the_charge_state_caps_it():
    def level(vehicle, _):
        reading = vehicle.battery.reading()
        return None if reading is None else (reading.charge_state, reading.fraction <= 0.15)

    assert changes("px4_battery_drain.tlog", level)[-4:] == [
        (58.3, (2, True)),
        (63.4, (3, True)),
        (64.4, (4, True)),
        (88.3, (1, False)),
    ]


def test_a_lost_stream_of_set_points_leads_to_a_manual_mode_without_any_pilot():
    assert changes("px4_offboard.tlog", flying)[5:] == [
        (11.1, (True, "IN_AIR", "AUTO.TAKEOFF", "ours")),
        (11.7, (True, "IN_AIR", "AUTO.LOITER", "ours")),
        (15.8, (True, "IN_AIR", "OFFBOARD", "ours")),
        (30.0, (True, "IN_AIR", "POSCTL", "failsafe")),
        (39.0, (True, "LANDING", "POSCTL", "failsafe")),
        (39.1, (True, "LANDING", "AUTO.LAND", "ours")),
        (45.0, (True, "ON_GROUND", "AUTO.LAND", "ours")),
        (47.3, (False, "ON_GROUND", "OFFBOARD", "ours")),
    ]


def test_a_manual_mode_without_failsafe_is_the_pilot_s():
    flight = Flight("px4_offboard.tlog")
    t_ns = next(t_ns for t_ns, t_s in flight if t_s > 20)
    flight.vehicle.receive(t_ns, beat(3 << 16, armed=True))
    assert flying(flight.vehicle, t_ns) == (True, "IN_AIR", "POSCTL", "pilot")


def test_rc_is_not_heard_though_its_bit_is_enabled_and_the_pre_arm_bit_is_in_health_alone():
    def verdicts(vehicle, t_ns):
        return vehicle.system.rc(t_ns), vehicle.system.prearm(t_ns)

    assert changes("px4_normal_mission.tlog", verdicts)[1:4] == [(0.2, (False, True))]


def test_texts_come_once_and_without_their_tabs():
    assert texts("px4_gps_loss_param.tlog") == [
        "Armed by external command",
        "Executing Mission",
        "Climb to 10.0 meters above home",
        "Takeoff detected",
        "Failsafe activated",
        "Landing detected",
        "Disarmed by landing",
        "Preflight: GPS fix too low",
        "Preflight: GPS fix too low",
        *["Preflight: no valid local position estimate", "Preflight: no valid global position estimate"] * 2,  # EVENTs
    ]


def test_an_ardupilot_of_2015_flown_by_its_pilot():
    said = [(mode, control) for _, (_, _, mode, control) in changes("copter_low_battery.tlog", flying)]
    assert {mode for mode, _ in said} == {"STABILIZED", "POSCTL", "AUTO.RTL", "AUTO.MISSION", ""}  # it has gaps of 8 s
    assert {control for _, control in said} == {"ours", "pilot"}  # its low battery is critical, and changes no mode


def test_the_low_battery_of_an_ardupilot_is_in_its_texts():
    flight = Flight("copter_low_battery.tlog")
    low = None
    for _, t_s in flight:
        if any(text.text == "Low Battery!" for text in flight.vehicle.texts.new) and low is None:
            low = (round(t_s), flight.vehicle.battery.reading().fraction)
    assert low == (483, 0.95)
    assert flight.vehicle.battery.reading().fraction == 0.2


def test_every_frame_of_the_logs_is_accounted_for():
    counts = {}
    for name in ("copter_low_battery.tlog", "px4_normal_mission.tlog"):
        frames, counter = read_tlog(recording(name))
        assert len(list(frames)) == counter.count.good
        counts[name] = counter.count
    assert counts == {
        "copter_low_battery.tlog": TlogCount(75477, 1314, 0, 19, 19),
        "px4_normal_mission.tlog": TlogCount(28102, 0, 123, 0),
    }
