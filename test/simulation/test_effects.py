"""Faults of the vehicle, its battery and its pilot: each acts when it begins, and is undone when it ends."""

import pytest
from simulation_tools import Driver

from amaze_autonomy.engine.events import AutopilotStatus, VehicleLanded
from amaze_autonomy.simulation.scenario import KINDS, Subject

FOR = "at_s: 5, for_s: 5"


def state(driver):
    """Return what a fault of the world may change."""
    vehicle, flags = driver.vehicle, driver.vehicle.flags
    return {
        "battery_unknown": driver.world.power.known,
        "pilot_takes_over": (vehicle.pilot, vehicle.mode),
        "pilot_arms": vehicle.armed,
        "not_ready": dict(flags.not_ready),
        "tilted": flags.tilt_rad,
        "tilted_in_flight": flags.lean_rad,
        "raised": flags.raised_m,
        "does_not_arm": flags.does_not_arm,
        "does_not_lift_off": flags.does_not_lift_off,
        "does_not_climb": flags.stops_climbing_at_m,
        "ignores_mode": flags.ignores,
        "does_not_descend": flags.does_not_descend,
        "does_not_disarm": flags.does_not_disarm,
    }


PARAMETERS = {
    "not_ready": "what: home, ",
    "tilted": "tilt_deg: 10, ",
    "tilted_in_flight": "tilt_deg: 60, ",
    "raised": "height_m: 0.2, ",
    "does_not_climb": "above_m: 0.5, ",
    "ignores_mode": "mode: AUTO.LAND, ",
}
UNDONE = (
    *("battery_unknown", "pilot_takes_over", *PARAMETERS, "does_not_arm", "does_not_lift_off"),
    *("does_not_descend", "does_not_disarm"),
)


@pytest.mark.parametrize("kind", UNDONE)
def test_acts_while_it_lasts_and_is_undone_afterwards(kind):
    driver = Driver(f"fault: {kind}, {PARAMETERS.get(kind, '')}{FOR}")
    driver.go_on(4.0)
    before = state(driver)
    driver.go_on(4.0)
    during = state(driver)
    driver.go_on(4.0)
    assert {name for name in before if before[name] != during[name]} == {kind}
    assert state(driver) == before


def test_a_drain_stops_where_it_is_when_its_fault_ends():
    driver = Driver("fault: battery_drops, to_fraction: 0.0, over_s: 20, at_s: 5, for_s: 5")
    driver.go_on(30.0)
    assert driver.world.power.fraction == pytest.approx(0.75, abs=0.01)


def test_a_failsafe_that_ends_gives_the_vehicle_back():
    driver = Driver("fault: autopilot_failsafe, after: {event: mission, delay_s: 1}, for_s: 2")
    driver.take_off()
    driver.go_on(2.0)
    assert (driver.vehicle.failsafe, driver.vehicle.mode) == (True, "AUTO.RTL")
    driver.go_on(2.0)
    assert (driver.vehicle.failsafe, driver.vehicle.mode) == (False, "AUTO.LOITER")


def test_a_lost_gps_is_told_at_once_and_ends_in_a_landing_of_its_own():
    driver = Driver("fault: gps_lost, after: {event: mission, delay_s: 1}")
    driver.take_off()
    driver.go_on(2.0)
    assert (driver.world.sensor_health()["gps"], driver.vehicle.failsafe) == (False, False)
    driver.go_on(5.0)
    assert (driver.vehicle.failsafe, driver.vehicle.mode) == (True, "AUTO.LAND")


def test_a_gps_that_comes_back_in_time_changes_nothing():
    driver = Driver("fault: gps_lost, after: {event: mission, delay_s: 1}, for_s: 3")
    driver.take_off()
    driver.go_on(8.0)
    assert (driver.world.sensor_health()["gps"], driver.vehicle.failsafe) == (True, False)


def test_somebody_who_arms_arms():
    driver = Driver("fault: pilot_arms, at_s: 1")
    driver.go_on(2.0)
    assert driver.vehicle.armed


def said(driver):
    """Return what the autopilot says last of height, position and ground."""
    status = [event for event in driver.events if isinstance(event, AutopilotStatus)][-1]
    return round(status.height_m), round(status.position_x_m), status.landed


def test_somebody_who_disarms_disarms():
    driver = Driver("fault: pilot_disarms, at_s: 5\nfault: pilot_arms, at_s: 1")
    driver.go_on(4.0)
    assert driver.vehicle.armed
    driver.go_on(2.0)
    assert not driver.vehicle.armed


@pytest.mark.parametrize(
    "kind, during",
    [
        ("estimate_off, height_m: 40, position_m: -9", (40, -9, VehicleLanded.ON_GROUND)),
        ("ground_unknown", (0, 0, VehicleLanded.UNKNOWN)),
    ],
)
def test_what_the_autopilot_says_is_wrong_while_it_lasts(kind, during):
    driver = Driver(f"fault: {kind}, {FOR}")
    told = [(driver.go_on(4.0), said(driver))[1] for _ in range(3)]
    assert told == [(0, 0, VehicleLanded.ON_GROUND), during, (0, 0, VehicleLanded.ON_GROUND)]


def test_a_vehicle_that_seems_landed_flies():
    driver = Driver("fault: seems_landed, after: {event: airborne, delay_s: 1}, for_s: 2")
    driver.take_off()
    told = []
    for _ in range(12):
        driver.go_on(0.5)
        told.append((said(driver)[2] is VehicleLanded.ON_GROUND, driver.vehicle.airborne))
    assert (True, True) in told
    assert told[-1] == (False, True)


def test_every_fault_of_the_world_has_its_effect_tested():
    elsewhere = {"battery_drops", "pilot_arms", "autopilot_failsafe", "gps_lost"}  # above
    elsewhere |= {"pilot_disarms", "estimate_off", "ground_unknown", "seems_landed"}  # above
    elsewhere |= {"autopilot_link_lost", "land_switch"}  # test_autopilot.py
    elsewhere |= {"not_initialised"}  # test_initialisation.py
    elsewhere |= {"data_incomplete", "recording_does_not_grow", "recording_fails"}  # test_recorder.py
    assert {name for subject, name in KINDS if subject == Subject.WORLD} == {*UNDONE, *elsewhere}
