"""Specifications: the defaults stand, and one that cannot be is refused with field, value and what would be right."""

from __future__ import annotations

from typing import Any, Callable, Dict

import pytest

from amaze_autonomy.monitoring.errors import SpecError
from amaze_autonomy.monitoring.specs import (
    AutopilotSensor,
    BatterySpec,
    ComponentSpec,
    LandingSpec,
    PollingSpec,
    RestartPolicy,
    RestartSpec,
    StateEstimationSpec,
    TopicSpec,
)

S = 1_000_000_000
NAN = float("nan")


@pytest.mark.parametrize("make", [LandingSpec, StateEstimationSpec, BatterySpec, PollingSpec, RestartSpec])
def test_defaults_are_a_valid_specification(make: Callable[[], object]):
    assert make() == make()


@pytest.mark.parametrize(
    "rate_hz,age_limit_ns,silence_ns",
    [(200.0, S // 2, S // 2), (30.0, S // 20, S // 10), (1.0, S // 2, 3 * S), (0.2, S, 15 * S)],
)
def test_silence_is_the_age_limit_or_three_periods(rate_hz: float, age_limit_ns: int, silence_ns: int):
    limit_ns = TopicSpec("/t", rate_hz, age_limit_ns=age_limit_ns).silence_limit_ns
    assert abs(limit_ns - silence_ns) <= 3


@pytest.mark.parametrize("rate_hz,window_ns", [(200.0, S), (10.0, S), (1.0, 10 * S), (0.2, 50 * S)])
def test_the_window_is_a_second_or_ten_periods(rate_hz: float, window_ns: int):
    assert TopicSpec("/t", rate_hz).rate_window_ns == window_ns


@pytest.mark.parametrize(
    "changes,message",
    [
        ({"topic": ""}, "TopicSpec.topic is '', must be the name of a topic"),
        ({"rate_hz": 0}, "TopicSpec.rate_hz is 0, must be a number above 0"),
        ({"rate_hz": NAN}, "TopicSpec.rate_hz is nan, must be a number above 0"),
        ({"rate_hz": 1e9}, "TopicSpec.rate_hz is 1000000000.0, must be between 0.001 and 100000 Hz"),
        ({"tolerance_fraction": 1.0}, "TopicSpec.tolerance_fraction is 1.0, must be below 1"),
        ({"rate_failed_fraction": 0.8}, "TopicSpec.rate_failed_fraction is 0.8, must be below 1 - tolerance_fraction"),
        ({"age_limit_ns": 0.5}, "TopicSpec.age_limit_ns is 0.5, must be a whole number of nanoseconds above 0"),
        ({"window_ns": S}, "TopicSpec.window_ns is 1000000000, must be at least four periods (4 s)"),
        (
            {"unchanged_limit_ns": -1},
            "TopicSpec.unchanged_limit_ns is -1, must be a whole number of nanoseconds above 0",
        ),
    ],
)
def test_a_topic_that_cannot_be_is_refused(changes: Dict[str, Any], message: str):
    with pytest.raises(SpecError) as refused:
        TopicSpec(**{"topic": "/t", "rate_hz": 1.0, **changes})
    assert str(refused.value) == message
    assert refused.value.field in changes


@pytest.mark.parametrize("policy", [RestartPolicy.NODE, RestartPolicy.DRIVER, RestartPolicy.COMMAND])
def test_a_restart_of_the_px4_is_refused(policy: RestartPolicy):
    command = () if policy is RestartPolicy.NODE else ("restart",)
    with pytest.raises(SpecError, match=r"px4_imu\.restart is .*never for a component of the PX4") as refused:
        ComponentSpec("px4_imu", "px4", node="/mavros", restart=RestartSpec(policy, command))
    assert (refused.value.spec, refused.value.field) == ("px4_imu", "restart")


@pytest.mark.parametrize(
    "changes,field",
    [
        ({}, "topics"),
        ({"name": "", "node": "/n"}, "name"),
        ({"group": "PX4", "node": "/n"}, "group"),
        ({"topics": (TopicSpec("/t", 1.0), TopicSpec("/t", 2.0))}, "topics"),
        ({"node": "/n", "severity": "low"}, "severity"),
        ({"autopilot": "gps"}, "autopilot"),
        ({"driver": ("",)}, "driver"),
        ({"node": "/n", "wait_limit_ns": -1}, "wait_limit_ns"),
        ({"autopilot": AutopilotSensor.GPS, "restart": RestartSpec(RestartPolicy.NODE)}, "restart"),
    ],
)
def test_a_component_that_cannot_be_is_refused(changes: Dict[str, Any], field: str):
    with pytest.raises(SpecError) as refused:
        ComponentSpec(**{"name": "camera", **changes})
    assert refused.value.field == field


@pytest.mark.parametrize(
    "make,field",
    [
        (lambda: RestartSpec(RestartPolicy.COMMAND), "command"),
        (lambda: RestartSpec(RestartPolicy.NEVER, ("x",)), "command"),
        (lambda: RestartSpec(attempts=0), "attempts"),
        (lambda: RestartSpec(attempt_limit_ns=16 * S), "total_limit_ns"),
        (lambda: PollingSpec(node_age_limit_ns=S // 2), "node_age_limit_ns"),
        (lambda: PollingSpec(driver_age_limit_ns=2 * S), "driver_age_limit_ns"),
        (lambda: LandingSpec(airborne_distance_m=0.1), "airborne_distance_m"),
        (lambda: LandingSpec(max_range_m=0.01), "max_range_m"),
        (lambda: LandingSpec(scale=NAN), "scale"),
        (lambda: LandingSpec(scale=0.0), "scale"),
        (lambda: LandingSpec(max_tilt_rad=2.0), "max_tilt_rad"),
        (lambda: LandingSpec(max_tilt_rad=0.0), "max_tilt_rad"),
        (lambda: LandingSpec(max_tilt_rad=-0.1), "max_tilt_rad"),
        (lambda: StateEstimationSpec(topic="", imu_topic=""), "topic"),
        (lambda: StateEstimationSpec(imu_mounting_rpy_rad=(0.0, NAN, 0.0)), "imu_mounting_rpy_rad"),
        (lambda: StateEstimationSpec(gravity_tolerance_m_s2=10.0), "gravity_tolerance_m_s2"),
        (lambda: StateEstimationSpec(tilt_limit_rad=10.0), "tilt_limit_rad"),
        (lambda: BatterySpec(minimum_fraction=30.0), "minimum_fraction"),
        (lambda: BatterySpec(cell_voltage_max_v=3.0), "cell_voltage_max_v"),
        (lambda: BatterySpec(cells=-1), "cells"),
    ],
)
def test_a_limit_that_cannot_be_is_refused(make: Callable[[], object], field: str):
    with pytest.raises(SpecError) as refused:
        make()
    assert refused.value.field == field
