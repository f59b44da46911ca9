"""Where heights are counted from: what a link that is cut, a stall, or a frame that jumps does to the takeoff place."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.vehicle.vehicle import VehicleState
from amaze_autonomy.config import AutopilotSettings

S = 1_000_000_000


@pytest.mark.parametrize("cut_s", [0.0, 1.0, 1.5, 1.8])
@pytest.mark.parametrize("lost", [("EXTENDED_SYS_STATE", "LOCAL_POSITION_NED"), ("EXTENDED_SYS_STATE",)])
def test_a_link_that_is_cut_at_the_lift_off_does_not_put_the_takeoff_place_into_the_air(lost, cut_s):
    vehicle, flags = VehicleState(AutopilotSettings()), 0x33F
    for tick in range(1500):
        t_s, t_ns = tick / 100, tick * S // 100
        up_m, armed, landed = max(0.0, 1.5 * (t_s - 10.0)), t_s > 8.0, 1 if t_s < 10.1 else 3 if t_s < 14.0 else 2
        said = {
            50: mavlink.MAVLink_heartbeat_message(2, 12, 0x81 if armed else 0x01, 4 << 16 | 4 << 24, 4, 3),
            19: mavlink.MAVLink_extended_sys_state_message(0, landed),
            5: mavlink.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0, 0),
            1: mavlink.MAVLink_local_position_ned_message(50_000 + tick * 10, 0, 0, 0.3 - up_m, 0, 0, 0),
        }
        periods = {50: 100, 19: 20, 5: 20, 1: 10}
        for first, message in said.items():
            cut = message.get_type() in lost and 10.0 <= t_s < 10.0 + cut_s
            if tick % periods[first] == first % periods[first] and not cut:
                vehicle.receive(t_ns, message)
    assert vehicle.status(t_ns).height_m == pytest.approx(up_m, abs=0.2)


def test_where_the_heartbeat_alone_tells_the_ground_the_height_that_is_set_anew_at_arming_counts():
    """As ArduCopter of 2015 in copter_low_battery: its height goes back to 0 as it arms, 2 s before it lifts off."""
    vehicle = VehicleState(AutopilotSettings())

    def say(t_ns, down_m, *, armed):
        boot_ms = 50_000 + t_ns // 1_000_000
        vehicle.receive(t_ns, mavlink.MAVLink_local_position_ned_message(boot_ms, 0, 0, down_m, 0, 0, 0))
        vehicle.receive(t_ns, mavlink.MAVLink_ekf_status_report_message(0x33F, 0, 0, 0, 0, 0))
        vehicle.receive(t_ns, mavlink.MAVLink_heartbeat_message(2, 3, 0x81 if armed else 0x01, 0, 4 if armed else 3, 3))

    for t_s in range(4):
        say(t_s * S, 1.0, armed=False)
    say(3 * S + S // 2, 0.0, armed=True)
    say(5 * S + S // 2, -2.0, armed=True)
    assert vehicle.status(5 * S + S // 2).height_m == pytest.approx(2.0)


def test_the_first_position_of_all_is_on_the_ground_when_it_comes_at_rest():
    vehicle = VehicleState(AutopilotSettings())
    for t_ns in (0, S // 2, S):
        vehicle.receive(t_ns, mavlink.MAVLink_heartbeat_message(2, 3, 0x01, 0, 3, 3))
        vehicle.receive(t_ns, mavlink.MAVLink_extended_sys_state_message(0, 1))
    vehicle.receive(S, mavlink.MAVLink_ekf_status_report_message(0x33F, 0, 0, 0, 0, 0))
    for t_ns, down_m, landed in ((S, 0.5, 1), (3 * S // 2, 0.5, 3), (2 * S, -1.5, 2)):  # ON_GROUND once more, too soon
        boot_ms = 50_000 + t_ns // 1_000_000
        vehicle.receive(t_ns, mavlink.MAVLink_local_position_ned_message(boot_ms, 0, 0, down_m, 0, 0, 0))
        vehicle.receive(t_ns, mavlink.MAVLink_extended_sys_state_message(0, landed))
    assert vehicle.status(2 * S).height_m == pytest.approx(2.0)


def say_where(vehicle, t_ns, down_m, flags=0x33F, climb_m_s=0.0):
    vehicle.receive(t_ns, mavlink.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0, 0))
    boot_ms = 50_000 + t_ns // 1_000_000
    vehicle.receive(t_ns, mavlink.MAVLink_local_position_ned_message(boot_ms, 0, 0, down_m, 0, 0, -climb_m_s))


def standing(until_ns, period_ns=S // 5):
    """Return a PX4 that stood until then: landed state at 5 Hz, positions at 10 Hz."""
    vehicle = VehicleState(AutopilotSettings())
    for t_ns in range(0, until_ns, S // 10):
        if t_ns % S == 0:
            vehicle.receive(t_ns, mavlink.MAVLink_heartbeat_message(2, 12, 0x81, 4 << 16 | 4 << 24, 3, 3))
        if t_ns % period_ns == 0:
            vehicle.receive(t_ns, mavlink.MAVLink_extended_sys_state_message(0, 1))
        say_where(vehicle, t_ns + S // 100, 0.3)
    return vehicle


@pytest.mark.parametrize("period_ns", [S // 5, S])
def test_a_frame_that_jumps_at_rest_is_no_height(period_ns):
    vehicle = standing(4 * S + S // 10, period_ns)
    say_where(vehicle, 4 * S + S // 7, 4.8)
    assert vehicle.status(4 * S + S // 7).height_m == pytest.approx(0.0)
    vehicle.receive(4 * S + S // 5, mavlink.MAVLink_extended_sys_state_message(0, 1))
    vehicle.receive(4 * S + S // 4, mavlink.MAVLink_extended_sys_state_message(0, 2))
    say_where(vehicle, 4 * S + S // 4, 3.8)
    assert vehicle.status(4 * S + S // 4).height_m == pytest.approx(1.0)


@pytest.mark.parametrize("jump_m", [-3.0, 3.0, 30.0])
def test_a_frame_that_jumps_while_nothing_says_that_it_stands_takes_the_takeoff_place_along(jump_m):
    vehicle, t_ns = standing(4 * S), 4 * S
    while t_ns < 9 * S:
        up_m = max(0.0, (t_ns - 5 * S) / S)
        say_where(vehicle, t_ns, 0.3 - up_m - (jump_m if t_ns > 4 * S + S // 2 else 0.0), climb_m_s=float(up_m > 0.0))
        t_ns += S // 10
        if t_ns % S == 0:
            vehicle.receive(t_ns, mavlink.MAVLink_heartbeat_message(2, 12, 0x81, 4 << 16 | 4 << 24, 4, 3))
    assert vehicle.status(t_ns).height_m == pytest.approx(3.9)


@pytest.mark.parametrize("stall_s", [1.0, 1.9, 2.5, 3.5])
def test_what_comes_at_once_behind_a_stall_puts_no_takeoff_place_into_the_air(stall_s):
    """As behind mavros, where each topic has a thread of its own: what is older may come later."""
    vehicle, over_ns = standing(4 * S), 4 * S + round(stall_s * S)
    for tick in range(10):
        say_where(vehicle, over_ns + tick * 100_000, 0.3 - 1.5 * stall_s)
    for tick in range(3):
        vehicle.receive(over_ns + S // 500 + tick * 100_000, mavlink.MAVLink_extended_sys_state_message(0, 1))
    vehicle.receive(over_ns + S // 100, mavlink.MAVLink_heartbeat_message(2, 12, 0x81, 4 << 16 | 4 << 24, 4, 3))
    for t_ns in (over_ns + S // 5, over_ns + S // 3):
        vehicle.receive(t_ns, mavlink.MAVLink_extended_sys_state_message(0, 2))
        say_where(vehicle, t_ns, 0.3 - 1.5 * stall_s)
    assert vehicle.status(t_ns).height_m == pytest.approx(1.5 * stall_s, abs=0.1)


def test_a_position_of_before_the_estimate_was_valid_is_no_takeoff_place():
    vehicle = standing(4 * S)
    say_where(vehicle, 4 * S + S // 20, 50.0, flags=0)
    vehicle.receive(4 * S + S // 8, mavlink.MAVLink_estimator_status_message(0, 0x33F, 0, 0, 0, 0, 0, 0, 0, 0))
    for t_ns, landed in ((4 * S + S // 6, 1), (4 * S + S // 5, 2)):
        vehicle.receive(t_ns, mavlink.MAVLink_extended_sys_state_message(0, landed))
    say_where(vehicle, 4 * S + S // 5, -0.7)
    assert vehicle.status(4 * S + S // 5).height_m == pytest.approx(1.0)


@pytest.mark.parametrize("cut_s", [2.0, 3.0, 4.4])
def test_where_the_heartbeat_alone_tells_the_ground_a_cut_puts_no_takeoff_place_into_the_air(cut_s):
    vehicle = VehicleState(AutopilotSettings())
    for tick in range(200):
        t_ns, armed = tick * S // 10, tick >= 101
        if tick % 10 == 0 and not 100 < tick < 100 + cut_s * 10:
            vehicle.receive(
                t_ns, mavlink.MAVLink_heartbeat_message(2, 3, 0x81 if armed else 1, 0, 4 if armed else 3, 3)
            )
        if not 100 < tick < 100 + cut_s * 10:
            vehicle.receive(t_ns, mavlink.MAVLink_ekf_status_report_message(0x33F, 0, 0, 0, 0, 0))
            down_m = 0.3 - max(0.0, 0.15 * (tick - 126))
            boot_ms = 50_000 + tick * 100
            vehicle.receive(t_ns, mavlink.MAVLink_local_position_ned_message(boot_ms, 0, 0, down_m, 0, 0, 0))
    assert vehicle.status(t_ns).height_m == pytest.approx(0.15 * 73, abs=0.1)
