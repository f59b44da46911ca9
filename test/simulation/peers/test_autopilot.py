"""The simulated autopilot node: what it hears and tells, its checks, the second route of a landing."""

import pytest
from simulation_tools import Driver, S, changes, small_settings

from amaze_autonomy.engine.commands import AutopilotDisarm, AutopilotLand
from amaze_autonomy.engine.events import AutopilotStatus, CheckName, Outcome, VehicleLanded, Verdict
from amaze_autonomy.monitoring.land_switch import LandSwitchSpec


def verdicts(reply):
    return {row.name: row.verdict for row in reply.checks}


def test_tells_what_the_vehicle_does_five_times_a_second_and_at_once_on_a_change():
    driver = Driver()
    driver.go_on(10.0)
    assert len([e for e in driver.events if isinstance(e, AutopilotStatus)]) == pytest.approx(50, abs=1)
    driver.take_off()
    driver.until(lambda: driver.vehicle.reached == 3 and not driver.vehicle.armed)
    assert changes(driver.events, AutopilotStatus, "armed") == [False, True, False]
    assert changes(driver.events, AutopilotStatus, "mode") == [
        "AUTO.LOITER",
        "AUTO.TAKEOFF",
        "AUTO.MISSION",
        "AUTO.LAND",
    ]
    assert changes(driver.events, AutopilotStatus, "landed") == [
        VehicleLanded.ON_GROUND,
        VehicleLanded.TAKING_OFF,
        VehicleLanded.IN_AIR,
        VehicleLanded.LANDING,
        VehicleLanded.ON_GROUND,
    ]


def test_its_height_and_position_are_those_of_the_vehicle_and_a_little_noise():
    driver = Driver()
    driver.take_off()
    driver.until(lambda: driver.vehicle.reached == 2)
    driver.go_on(1.0)
    status, position = driver.autopilot, driver.vehicle.position_m
    assert (status.position_x_m, status.position_y_m, status.height_m) == pytest.approx(position, abs=0.3)
    assert status.vertical_speed_m_s == 0.0
    assert (status.link_age_s, status.battery_age_s) == (0.0, 0.0)
    assert 0.9 < status.battery_fraction < 1.0


def test_a_healthy_vehicle_passes_both_checks():
    driver = Driver()
    driver.go_on(1.0)
    for check in (CheckName.AUTOPILOT, CheckName.BATTERY):
        reply = driver.check(check, required_fraction=0.4)
        assert reply.ok
        assert set(verdicts(reply).values()) == {Verdict.PASS}


@pytest.mark.parametrize(
    "what, row",
    [
        ("prearm", "pre-arm check"),
        ("rc", "RC receiver"),
        ("kill_switch", "kill switch"),
        ("home", "home position"),
        ("parameters", "parameters"),
    ],
)
def test_what_is_not_ready_fails_its_row_and_no_other_and_denies_the_arming(what, row):
    driver = Driver(f"fault: not_ready, what: {what}")
    driver.go_on(1.0)
    reply = driver.check(CheckName.AUTOPILOT)
    assert not reply.ok
    assert [name for name, verdict in verdicts(reply).items() if verdict is not Verdict.PASS] == [row]
    driver.load()
    assert "arming denied" in driver.vehicle.take_off()


def test_an_armed_vehicle_fails_the_check():
    driver = Driver("fault: pilot_arms, at_s: 0.5")
    driver.go_on(1.0)
    reply = driver.check(CheckName.AUTOPILOT)
    assert verdicts(reply)["not armed"] is Verdict.FAIL


def test_a_lost_link_leaves_what_was_heard_last_getting_older():
    driver = Driver("fault: autopilot_link_lost, after: {event: mission, delay_s: 1}, for_s: 5")
    driver.take_off()
    driver.go_on(4.0)
    status = driver.autopilot
    assert status.t_ns > driver.world.now_ns - S // 4
    assert status.link_age_s == pytest.approx(3.0, abs=0.3)
    assert status.battery_age_s == pytest.approx(3.0, abs=0.3)
    assert driver.vehicle.position_m[0] - status.position_x_m > 0.5
    assert driver.ask(AutopilotLand).outcome is Outcome.REFUSED
    driver.go_on(2.0)
    assert driver.autopilot.link_age_s == 0.0
    assert verdicts(driver.check(CheckName.AUTOPILOT))["autopilot link"] is Verdict.PASS


def test_a_link_that_is_not_there_fails_the_check():
    driver = Driver("fault: autopilot_link_lost, at_s: 1")
    driver.go_on(10.0)
    reply = driver.check(CheckName.AUTOPILOT)
    assert verdicts(reply)["autopilot link"] is Verdict.FAIL
    assert verdicts(reply)["RC receiver"] is Verdict.UNKNOWN


def test_an_unknown_battery_is_unknown_and_its_age_grows():
    driver = Driver("fault: battery_unknown, at_s: 2, for_s: 10")
    driver.go_on(5.0)
    status = driver.autopilot
    assert (status.battery_fraction, status.battery_voltage_v) == (None, None)
    assert status.battery_age_s == pytest.approx(3.0, abs=0.3)
    reply = driver.check(CheckName.BATTERY, required_fraction=0.3)
    assert not reply.ok
    driver.go_on(2.0)
    assert driver.autopilot.battery_fraction > 0.9


def test_a_battery_that_drops_is_seen_in_level_and_voltage_and_fails_the_check():
    driver = Driver("fault: battery_drops, to_fraction: 0.25, at_s: 1")
    driver.go_on(0.9)
    before = driver.autopilot.battery_voltage_v
    driver.go_on(1.0)
    assert driver.autopilot.battery_fraction == pytest.approx(0.25, abs=0.001)
    assert driver.autopilot.battery_voltage_v < before - 3.0
    assert not driver.check(CheckName.BATTERY, required_fraction=0.4).ok


def test_the_second_route_lands_and_disarms_on_the_ground_only():
    driver = Driver()
    driver.take_off()
    assert driver.ask(AutopilotDisarm).outcome is Outcome.REFUSED
    assert driver.vehicle.armed
    assert driver.ask(AutopilotLand).outcome is Outcome.ACCEPTED
    assert driver.vehicle.mode == "AUTO.LAND"
    driver.until(lambda: driver.vehicle.landed is VehicleLanded.ON_GROUND)
    assert driver.ask(AutopilotDisarm).outcome is Outcome.ACCEPTED
    assert not driver.vehicle.armed


def test_pilot_and_failsafe_are_told_at_once():
    for fault, told in (("pilot_takes_over", "pilot_in_control"), ("autopilot_failsafe", "failsafe")):
        driver = Driver(f"fault: {fault}, after: {{event: mission, delay_s: 1.05}}")
        driver.take_off()
        begun_ns = driver.world.now_ns + round(1.05 * S)
        driver.go_on(2.0)
        first = next(e for e in driver.events if isinstance(e, AutopilotStatus) and getattr(e, told))
        assert first.t_ns - begun_ns <= S // 10


def test_the_health_of_the_sensors_is_what_the_faults_left_of_it():
    driver = Driver("component: gps, fault: unhealthy, at_s: 1, for_s: 1\ncomponent: gps, fault: unreported, at_s: 3")
    told = []
    for _ in range(4):
        driver.go_on(0.9)
        told.append((driver.world.sensor_health()["gps"], driver.autopilot.gps_fix, driver.autopilot.satellites))
        driver.go_on(0.1)
    assert told == [(True, "3D", 12.0), (False, "no fix", 0.0), (True, "3D", 12.0), (None, "", None)]
    assert driver.world.sensor_health()["imu"] is None


def test_a_silent_one_says_nothing_and_still_lands():
    driver = Driver("process: autopilot, fault: silent, after: {event: mission}")
    driver.take_off()
    since = driver.world.now_ns
    assert driver.ask(AutopilotLand, wait_s=2.0).outcome is Outcome.ACCEPTED
    assert driver.autopilot.t_ns <= since
    assert driver.vehicle.mode == "AUTO.LAND"


def test_the_switch_of_the_transmitter_says_land_while_it_is_thrown_and_nothing_takes_off_then():
    settings = small_settings(land_switch=LandSwitchSpec(channel=7))
    driver = Driver("fault: land_switch, at_s: 2, for_s: 15", settings=settings)
    said = [(driver.go_on(1.75), driver.world.land_switch)[1] for _ in range(2)]
    assert said == [False, True]
    assert verdicts(driver.check(CheckName.AUTOPILOT))["land switch"] is Verdict.FAIL
    driver.go_on(4.5)
    assert driver.world.land_switch is False
    assert verdicts(driver.check(CheckName.AUTOPILOT))["land switch"] is Verdict.PASS


@pytest.mark.parametrize("fault", ["fault: not_ready, what: rc", "fault: autopilot_link_lost"])
def test_without_a_transmitter_or_a_link_the_switch_says_nothing(fault):
    settings = small_settings(land_switch=LandSwitchSpec(channel=7))
    driver = Driver(f"fault: land_switch\n{fault}, at_s: 2", settings=settings)
    driver.go_on(1.9)
    assert driver.world.land_switch is True
    driver.go_on(2.0)
    assert driver.world.land_switch is None
    assert Driver().world.land_switch is None


def test_a_receiver_that_makes_its_channels_up_says_no_land_before_its_loss_is_noticed():
    driver = Driver(
        "fault: not_ready, what: rc, at_s: 2", settings=small_settings(land_switch=LandSwitchSpec(channel=7))
    )
    driver.go_on(1.9)
    said = [(driver.go_on(0.05), driver.world.land_switch)[1] for _ in range(60)]
    assert set(said) == {False, None}
    assert said[-1] is None
