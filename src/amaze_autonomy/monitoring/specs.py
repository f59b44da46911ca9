"""What is watched, and within which limits: frozen values, made from sensors.yaml, usable with their defaults alone."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from math import radians
from typing import Optional, Tuple

from amaze_autonomy.engine.severity import Severity

__all__ = [
    "AutopilotSensor",
    "BatterySpec",
    "ComponentSpec",
    "LandingSpec",
    "RestartPolicy",
    "RestartSpec",
    "StateEstimationSpec",
    "TopicSpec",
]

_S = 1_000_000_000


class RestartPolicy(enum.Enum):
    """How a component that failed is restarted."""

    NEVER = "never"
    NODE = "node"  # the ROS node is stopped, its launch file respawns it
    DRIVER = "driver"  # the driver's process, which the watchdog runs, is started again
    COMMAND = "command"  # a command of its own


class AutopilotSensor(enum.Enum):
    """A sensor whose health the autopilot reports."""

    GPS = "gps"
    IMU = "imu"
    MAGNETOMETER = "magnetometer"
    BAROMETER = "barometer"


@dataclass(frozen=True)
class TopicSpec:
    """One topic that is watched.

    Args:
        topic: its name.
        rate_hz: messages per second that are intended.
        tolerance_fraction: deviation of the rate that is still as intended, within 0..1.
        age_limit_ns: how old the last message may be before the component has failed.
        window_ns: over which the rate is measured.
        rate_failed_fraction: fraction of the intended rate below which the component has failed.
    """

    topic: str
    rate_hz: float
    tolerance_fraction: float = 0.2
    age_limit_ns: int = _S
    window_ns: int = 2 * _S
    rate_failed_fraction: float = 0.5


@dataclass(frozen=True)
class RestartSpec:
    """How a component is restarted, and when the watchdog gives up.

    Args:
        policy: what is restarted.
        command: argument list, for the policy COMMAND.
        attempts: at most so many, one after the other.
        backoff_ns: pause before each attempt but the first.
        attempt_limit_ns: time in which an attempt must bring the component back.
        total_limit_ns: time in which the component must be back, all attempts together.
        good_samples: messages in a row that show that it is back.
    """

    policy: RestartPolicy = RestartPolicy.NEVER
    command: Tuple[str, ...] = ()
    attempts: int = 3
    backoff_ns: int = _S
    attempt_limit_ns: int = 5 * _S
    total_limit_ns: int = 15 * _S
    good_samples: int = 5


@dataclass(frozen=True)
class ComponentSpec:
    """One component that is watched. Its sources are judged one by one; the worst counts.

    Args:
        name: as on the wire, e.g. "mission_camera".
        group: "px4" or "other"; components of the PX4 are never restarted.
        severity: how bad its failure is, unless the mission names another.
        topics: topics that it must publish.
        node: ROS node that must run; None when none is watched.
        driver: argument list of the driver's process, which the watchdog runs; empty when there is none.
        autopilot: sensor of the autopilot whose health counts; None when none does.
        restart: how it is restarted.
        wait_limit_ns: how long a flight may wait for it, all its failures together; 0 when it never waits.
    """

    name: str
    group: str
    severity: Severity
    topics: Tuple[TopicSpec, ...] = ()
    node: Optional[str] = None
    driver: Tuple[str, ...] = ()
    autopilot: Optional[AutopilotSensor] = None
    restart: RestartSpec = field(default_factory=RestartSpec)
    wait_limit_ns: int = 0

    def __post_init__(self) -> None:
        if self.group == "px4" and self.restart.policy is not RestartPolicy.NEVER:
            raise ValueError(f"{self.name}: a component of the PX4 is never restarted, the vehicle would be uncontrollable")
        if not (self.topics or self.node or self.driver or self.autopilot):
            raise ValueError(f"{self.name}: has no source, nothing would be watched")


@dataclass(frozen=True)
class LandingSpec:
    """Landing detection from a range to the ground. Between the two distances the last judgement stands.

    Args:
        topic: of the range finder.
        mounting_height_m: from the feet up to the sensor; what it measures when the vehicle stands on the ground.
        ground_distance_m: feet nearer to the ground than this are on it.
        airborne_distance_m: feet farther from the ground than this are in the air.
        settle_ns: how long all samples must agree before the judgement changes.
        age_limit_ns: how old the last sample may be before the judgement is unknown.
    """

    topic: str = "/lrf/range"
    mounting_height_m: float = 0.1
    ground_distance_m: float = 0.1
    airborne_distance_m: float = 0.3
    settle_ns: int = _S // 2
    age_limit_ns: int = _S // 2


@dataclass(frozen=True)
class StateEstimationSpec:
    """Check of the estimator's output before takeoff: are the states valid, does gravity point down?

    Args:
        topic: of the estimator's odometry; empty: judged from the IMU alone.
        imu_topic: of an accelerometer in the vehicle frame whose gravity must agree; empty: none is looked at.
        rate_hz: messages per second that are intended.
        tolerance_fraction: deviation of the rate that is still as intended.
        age_limit_ns: how old the last state may be.
        window_ns: over which rate and gravity are measured.
        tilt_limit_rad: largest angle between the vehicle's z axis and the vertical.
        gravity_m_s2: what an accelerometer measures at rest.
        gravity_tolerance_m_s2: its deviation that is still at rest.
        speed_limit_m_s: largest speed of a vehicle that stands on the ground.
        position_limit_m: largest distance from the origin that a valid state has.
    """

    topic: str = "/odometry"
    imu_topic: str = "/px4/imu"
    rate_hz: float = 30.0
    tolerance_fraction: float = 0.2
    age_limit_ns: int = _S // 2
    window_ns: int = 1 * _S
    tilt_limit_rad: float = radians(10.0)
    gravity_m_s2: float = 9.81
    gravity_tolerance_m_s2: float = 0.5
    speed_limit_m_s: float = 0.3
    position_limit_m: float = 1000.0


@dataclass(frozen=True)
class BatterySpec:
    """Check of the battery before takeoff. What happens to it in flight is in the engine's limits.

    Args:
        age_limit_ns: how old the last level may be.
        cells: in series.
        cell_voltage_min_v: lowest resting voltage per cell, whatever the level says.
        cell_voltage_max_v: highest voltage per cell that is believed.
    """

    age_limit_ns: int = 5 * _S
    cells: int = 6
    cell_voltage_min_v: float = 3.5
    cell_voltage_max_v: float = 4.35
