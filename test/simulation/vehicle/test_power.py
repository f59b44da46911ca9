"""The simulated battery."""

import pytest

from amaze_autonomy.simulation.vehicle.vehicle import Power, PowerSettings

S = 1_000_000_000


def test_is_used_up_by_flying_faster_than_by_standing():
    power = Power(PowerSettings(flight_endurance_s=100.0, idle_endurance_s=1000.0))
    power.advance(10 * S, flying=True)
    assert power.fraction == pytest.approx(0.9)
    power.advance(10 * S, flying=False)
    assert power.fraction == pytest.approx(0.89)


def test_is_never_below_empty():
    power = Power(PowerSettings(flight_endurance_s=100.0))
    power.advance(1000 * S, flying=True)
    assert power.fraction == 0.0


def test_drops_at_once_and_never_rises():
    power = Power(PowerSettings())
    power.drop_to(0.3)
    power.drop_to(0.8)
    assert power.fraction == 0.3


def test_drains_evenly_down_to_a_level_and_is_then_only_used():
    power = Power(PowerSettings(flight_endurance_s=1e9, idle_endurance_s=1e9))
    power.drain_to(0.5, 10.0)
    power.advance(5 * S, flying=False)
    assert power.fraction == pytest.approx(0.75)
    power.advance(50 * S, flying=False)
    assert power.fraction == pytest.approx(0.5)


def test_a_drain_that_is_stopped_leaves_the_rest():
    power = Power(PowerSettings(flight_endurance_s=1e9, idle_endurance_s=1e9))
    power.drain_to(0.0, 10.0)
    power.advance(2 * S, flying=False)
    power.stop_draining()
    power.advance(50 * S, flying=False)
    assert power.fraction == pytest.approx(0.8)


def test_its_voltage_follows_the_level_and_sags_in_flight():
    power = Power(PowerSettings(cells=4))
    assert power.voltage_v(flying=False) == pytest.approx(16.8)
    assert power.voltage_v(flying=True) == pytest.approx(16.32)
    power.drop_to(0.0)
    assert power.voltage_v(flying=False) == pytest.approx(13.2)


def test_an_unknown_battery_has_no_voltage():
    power = Power(PowerSettings())
    power.known = False
    assert power.voltage_v(flying=False) is None
