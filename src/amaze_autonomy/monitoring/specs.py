"""What is watched, and with which limits: frozen, checked when made. The configuration builds them; defaults fly.

Rules of this file: times are integer nanoseconds (`_ns`), angles radians (`_rad`), everything else SI. A specification
that cannot be is a `SpecError` that names the field, so that a reader of YAML can point at the line. None is "derived"
or "not checked", as each field says.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from math import isfinite, pi
from typing import Optional, Tuple

from amaze_autonomy.engine.severity import Severity

from .errors import SpecError

__all__ = [
    "GROUPS",
    "AutopilotSensor",
    "AutopilotSpec",
    "BatterySpec",
    "ComponentSpec",
    "DriverSpec",
    "EstimateSource",
    "LandingSpec",
    "NodeSpec",
    "RangeSource",
    "RestartKind",
    "RestartSpec",
    "StateEstimationSpec",
    "TopicSpec",
]

GROUPS = ("px4", "other")
_S = 1_000_000_000
_SLOWEST_HZ, _FASTEST_HZ = 1e-3, 1e5


class RestartKind(enum.Enum):
    """How a component is restarted."""

    NEVER = "never"
    NODE = "node"  # its node is killed and comes back by roslaunch's respawn
    DRIVER = "driver"  # a command that restarts its driver
    COMMAND = "command"  # any other command


class AutopilotSensor(enum.Enum):
    """A sensor whose health the autopilot tells; names as in msg/AutopilotStatus."""

    GPS = "gps"
    IMU = "imu"
    MAGNETOMETER = "magnetometer"
    BAROMETER = "barometer"


class RangeSource(enum.Enum):
    """What kind of message the distance to the ground comes from."""

    RANGE = "range"  # sensor_msgs/Range
    SCAN = "scan"  # sensor_msgs/LaserScan, nearest valid return
    FLOAT = "float"  # std_msgs/Float32
    POSE = "pose"  # geometry_msgs/PoseStamped, height z


class EstimateSource(enum.Enum):
    """What kind of message the state estimate comes from."""

    ODOMETRY = "odometry"
    POSE = "pose"
    POSE_WITH_COVARIANCE = "pose_with_covariance"


class _Checked:
    """Checks that the specifications share; each raises a `SpecError` that names the field."""

    def _need(self, name: str, good: bool, expected: str) -> None:  # noqa: FBT001
        if not good:
            raise SpecError(getattr(self, "name", "") or type(self).__name__, name, getattr(self, name), expected)

    def _whole(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            self._need(name, type(value) is int and value > 0, "a whole number of nanoseconds above 0")

    def _above_zero(self, *names: str) -> None:
        for name in names:
            self._need(name, _is_number(getattr(self, name)) and getattr(self, name) > 0, "a number above 0")

    def _not_negative(self, *names: str) -> None:
        for name in names:
            self._need(name, _is_number(getattr(self, name)) and getattr(self, name) >= 0, "a number, 0 or above")

    def _angle(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            self._need(name, _is_number(value) and 0 < value <= pi / 2, "an angle above 0, at most pi/2 rad")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)


@dataclass(frozen=True)
class TopicSpec(_Checked):
    """A topic that must come at a rate.

    Args:
        topic: its name.
        rate_hz: expected messages per second.
        rate_tolerance_fraction: rate off by more than this fraction of the expected one: code 2.
        rate_failed_fraction: rate below this fraction of the expected one: the component has failed.
        age_limit_ns: silence longer than this, and than three periods: the component has failed.
        window_ns: over which the rate is measured; None: 1 s or ten periods, whichever is longer.
        good_samples: messages in time after a failure before it counts as back.
        finite: content is looked at, NaN or infinity in it is a failure.
        unchanged_limit_ns: content that stays the same for longer is a failure (a camera that sends the same frame);
            None: not looked at.
        stamp_tolerance_ns: header stamps further than this from the time of arrival: code 2; None: not looked at.
    """

    topic: str
    rate_hz: float
    rate_tolerance_fraction: float = 0.2
    rate_failed_fraction: float = 0.3
    age_limit_ns: int = _S // 2
    window_ns: Optional[int] = None
    good_samples: int = 5
    finite: bool = False
    unchanged_limit_ns: Optional[int] = None
    stamp_tolerance_ns: Optional[int] = None

    def __post_init__(self) -> None:
        self._need("topic", bool(self.topic), "the name of a topic")
        self._above_zero("rate_hz", "rate_tolerance_fraction", "rate_failed_fraction")
        self._need("rate_hz", _SLOWEST_HZ <= self.rate_hz <= _FASTEST_HZ, "between 0.001 and 100000 Hz")
        self._need("rate_tolerance_fraction", self.rate_tolerance_fraction < 1, "below 1")
        within = self.rate_failed_fraction < 1 - self.rate_tolerance_fraction
        self._need("rate_failed_fraction", within, "below 1 - rate_tolerance_fraction")
        self._whole("age_limit_ns")
        for name in ("window_ns", "unchanged_limit_ns", "stamp_tolerance_ns"):
            if getattr(self, name) is not None:
                self._whole(name)
        if self.window_ns is not None:
            enough = self.window_ns >= 4 * self.period_ns
            self._need("window_ns", enough, f"at least four periods ({4 * self.period_ns / _S:g} s)")
        self._need("good_samples", type(self.good_samples) is int and self.good_samples >= 1, "a whole number above 0")

    @property
    def period_ns(self) -> int:
        """Expected time between two messages."""
        return max(1, round(_S / self.rate_hz))

    @property
    def silence_limit_ns(self) -> int:
        """Silence after which the topic has stopped: the age limit or three periods, whichever is longer."""
        return max(self.age_limit_ns, 3 * self.period_ns)

    @property
    def rate_window_ns(self) -> int:
        """Window of the rate, as given or derived."""
        return self.window_ns if self.window_ns is not None else max(_S, 10 * self.period_ns)


@dataclass(frozen=True)
class NodeSpec(_Checked):
    """A node that must answer when asked (XML-RPC getPid).

    Args:
        node: its name, e.g. "/camera/driver".
        period_ns: how often it is asked.
        answer_limit_ns: time that one answer may take.
        age_limit_ns: longest time without a good answer; a refused connection fails at once.
    """

    node: str
    period_ns: int = _S // 2
    answer_limit_ns: int = _S // 4
    age_limit_ns: int = 3 * _S // 2

    def __post_init__(self) -> None:
        self._need("node", bool(self.node), "the name of a node")
        self._whole("period_ns", "answer_limit_ns", "age_limit_ns")
        expected = "at least period_ns + answer_limit_ns"
        self._need("age_limit_ns", self.age_limit_ns >= self.period_ns + self.answer_limit_ns, expected)


@dataclass(frozen=True)
class DriverSpec(_Checked):
    """A command that tells by its exit status 0 that a driver works; run again at its period for the whole flight.

    Args:
        command: program and arguments; no shell.
        period_ns: how often it is run.
        run_limit_ns: time that one run may take; longer is a failed run.
        age_limit_ns: longest time without a result.
    """

    command: Tuple[str, ...]
    period_ns: int = 2 * _S
    run_limit_ns: int = 1 * _S
    age_limit_ns: int = 5 * _S

    def __post_init__(self) -> None:
        _need_command(self, self.command)
        self._whole("period_ns", "run_limit_ns", "age_limit_ns")
        expected = "at least period_ns + run_limit_ns"
        self._need("age_limit_ns", self.age_limit_ns >= self.period_ns + self.run_limit_ns, expected)


@dataclass(frozen=True)
class AutopilotSpec(_Checked):
    """A sensor whose health the autopilot tells.

    Args:
        sensor: which one.
        reports: reports in a row that change the verdict; the first of all counts at once.
        age_limit_ns: longest time without a report.
    """

    sensor: AutopilotSensor
    reports: int = 2
    age_limit_ns: int = 2 * _S

    def __post_init__(self) -> None:
        self._need("sensor", isinstance(self.sensor, AutopilotSensor), "one of gps, imu, magnetometer, barometer")
        self._need("reports", type(self.reports) is int and self.reports >= 1, "a whole number above 0")
        self._whole("age_limit_ns")


@dataclass(frozen=True)
class RestartSpec(_Checked):
    """How, how often and for how long a failed component is restarted.

    Args:
        kind: how; NEVER takes no other field.
        command: program and arguments for DRIVER and COMMAND; no shell.
        attempts: at most so many.
        back_off_ns: pause between the end of one attempt and the next.
        attempt_limit_ns: time from an attempt until the component must be back.
        total_limit_ns: time from the failure until the watchdog gives up, all attempts and pauses together.
        forget_after_ns: good for so long: attempts and time spent are forgotten. A component that fails again earlier
            goes on where it was, so that a flapping one is given up.
    """

    kind: RestartKind = RestartKind.NEVER
    command: Tuple[str, ...] = ()
    attempts: int = 3
    back_off_ns: int = 1 * _S
    attempt_limit_ns: int = 6 * _S
    total_limit_ns: int = 20 * _S
    forget_after_ns: int = 60 * _S

    def __post_init__(self) -> None:
        self._need("kind", isinstance(self.kind, RestartKind), "one of never, node, driver, command")
        if self.kind in (RestartKind.DRIVER, RestartKind.COMMAND):
            _need_command(self, self.command)
        else:
            self._need("command", not self.command, f"empty with kind {self.kind.value}")
        self._need("attempts", type(self.attempts) is int and self.attempts >= 1, "a whole number above 0")
        self._whole("back_off_ns", "attempt_limit_ns", "total_limit_ns", "forget_after_ns")
        self._need("total_limit_ns", self.total_limit_ns >= self.attempt_limit_ns, "at least attempt_limit_ns")


def _need_command(spec: _Checked, command: Tuple[str, ...]) -> None:
    good = isinstance(command, tuple) and len(command) > 0 and all(isinstance(part, str) for part in command)
    spec._need("command", good and bool(command[0]), "a program and its arguments")  # noqa: SLF001


@dataclass(frozen=True)
class ComponentSpec(_Checked):
    """One component: what tells that it works, how bad its failure is, and what may be done about it.

    It has at least one source: topics, a node, a driver, or the autopilot; the worst of them counts.

    Args:
        name: as in sensors.yaml and on the wire, e.g. "mission_camera".
        group: "px4" or "other"; components of the PX4 are never restarted.
        severity: its severity, unless the mission names another.
        topics: topics that must come.
        node: node that must answer.
        driver: command that must succeed.
        autopilot: sensor that the autopilot must call healthy.
        restart: what may be done when it fails.
        required: must be at code 1 before takeoff when the mission does not say what it needs.
    """

    name: str
    group: str = "other"
    severity: Severity = Severity.LOW
    topics: Tuple[TopicSpec, ...] = ()
    node: Optional[NodeSpec] = None
    driver: Optional[DriverSpec] = None
    autopilot: Optional[AutopilotSpec] = None
    restart: RestartSpec = field(default_factory=RestartSpec)
    required: bool = True

    def __post_init__(self) -> None:
        self._need("name", bool(self.name), "the name of a component")
        self._need("group", self.group in GROUPS, "px4 or other")
        self._need("severity", isinstance(self.severity, Severity), "low, moderate, high or highest")
        sources = (*self.topics, self.node, self.driver, self.autopilot)
        expected = "a source: a topic, a node, a driver or the autopilot"
        self._need("topics", any(source is not None for source in sources), expected)
        names = [topic.topic for topic in self.topics]
        self._need("topics", len(set(names)) == len(names), "topics that differ")
        never = self.restart.kind is RestartKind.NEVER
        expected = "never for a component of the PX4, the vehicle would be uncontrollable"
        self._need("restart", never or self.group != "px4", expected)
        node = self.restart.kind is not RestartKind.NODE or self.node is not None
        self._need("restart", node, "of a kind that it has: there is no node to restart")


@dataclass(frozen=True)
class LandingSpec(_Checked):
    """How the distance to the ground is measured, and when it means that the vehicle is on it or has landed.

    Args:
        topic: where the range comes from.
        source: kind of message.
        scale: metres per unit of the message, e.g. 0.001 for millimetres.
        offset_m: reading of the sensor, in metres, when the vehicle stands on level ground.
        min_range_m: readings below are "nothing seen", when the message does not say it itself.
        max_range_m: readings at or above are "nothing seen", when the message does not say it itself.
        sentinels: readings, in units of the message, that mean "nothing seen".
        tilt_correction: the beam is fixed to the vehicle; its reading is multiplied by the cosine of the tilt.
        max_tilt_rad: beyond this tilt a range says nothing about the ground.
        window_ns: over which the median is taken.
        min_samples: good readings in the window that make a distance.
        age_limit_ns: longest time without a reading, and without a tilt where one has been given.
        on_ground_below_m: distance from the feet to the ground below which the vehicle stands on it.
        airborne_above_m: distance above which it has left it.
        landed_dwell_ns: so long on the ground, still, until it has landed.
        airborne_dwell_ns: so long above until it is airborne.
        max_vertical_speed_m_s: faster than this it has not landed.
    """

    topic: str = "/lrf/range"
    source: RangeSource = RangeSource.RANGE
    scale: float = 1.0
    offset_m: float = 0.0
    min_range_m: float = 0.02
    max_range_m: float = 40.0
    sentinels: Tuple[float, ...] = (8190.0, 8191.0, 65535.0)
    tilt_correction: bool = True
    max_tilt_rad: float = 45 * pi / 180
    window_ns: int = 3 * _S // 10
    min_samples: int = 3
    age_limit_ns: int = _S // 2
    on_ground_below_m: float = 0.1
    airborne_above_m: float = 0.3
    landed_dwell_ns: int = 2 * _S
    airborne_dwell_ns: int = 3 * _S // 10
    max_vertical_speed_m_s: float = 0.2

    def __post_init__(self) -> None:
        self._need("topic", bool(self.topic), "the name of a topic")
        self._need("source", isinstance(self.source, RangeSource), "one of range, scan, float, pose")
        self._need("scale", _is_number(self.scale) and self.scale > 0, "a number above 0")
        self._need("offset_m", _is_number(self.offset_m), "a number")
        self._not_negative("min_range_m")
        self._need(
            "max_range_m", _is_number(self.max_range_m) and self.max_range_m > self.min_range_m, "above min_range_m"
        )
        self._angle("max_tilt_rad")
        self._whole("window_ns", "age_limit_ns", "landed_dwell_ns", "airborne_dwell_ns")
        self._need("min_samples", type(self.min_samples) is int and self.min_samples >= 1, "a whole number above 0")
        self._above_zero("on_ground_below_m", "airborne_above_m", "max_vertical_speed_m_s")
        apart = self.airborne_above_m > self.on_ground_below_m
        self._need("airborne_above_m", apart, "above on_ground_below_m")


@dataclass(frozen=True)
class StateEstimationSpec(_Checked):
    """When the states are valid: the estimator's, and gravity as the IMU measures it.

    Args:
        estimate_topic: where the estimate comes from.
        estimate_source: kind of message.
        imu_topic: where the IMU comes from.
        imu_mounting_rpy_rad: roll, pitch, yaw of the IMU in the vehicle frame (REP-103, as in URDF).
        gravity_m_s2: magnitude of gravity where it flies.
        gravity_tolerance_m_s2: how far the measured magnitude may be off.
        max_tilt_rad: of the vehicle, by the IMU and by the estimator.
        max_tilt_difference_rad: between the vertical of the estimator and that of the IMU.
        max_position_deviation_m: largest standard deviation of the position, from the covariance.
        max_orientation_deviation_rad: largest standard deviation of the orientation.
        require_covariance: an estimate without covariance fails; otherwise it is a warning where the message has none.
        quaternion_tolerance: how far the norm of the quaternion may be from 1.
        window_ns: over which gravity is averaged.
        min_samples: of the IMU in the window.
        estimate_age_limit_ns: oldest estimate that counts.
        imu_age_limit_ns: oldest IMU sample that counts.
        still_ns: so long the vehicle must have been still.
        still_acceleration_m_s2: largest standard deviation of the acceleration while still.
        still_turn_rate_rad_s: largest mean turn rate while still.
        still_drift_m: furthest that the estimated position may move while still.
    """

    estimate_topic: str = "/state_estimator/odometry"
    estimate_source: EstimateSource = EstimateSource.ODOMETRY
    imu_topic: str = "/imu"
    imu_mounting_rpy_rad: Tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity_m_s2: float = 9.80665
    gravity_tolerance_m_s2: float = 0.6
    max_tilt_rad: float = 10 * pi / 180
    max_tilt_difference_rad: float = 5 * pi / 180
    max_position_deviation_m: float = 0.5
    max_orientation_deviation_rad: float = 10 * pi / 180
    require_covariance: bool = False
    quaternion_tolerance: float = 0.01
    window_ns: int = 1 * _S
    min_samples: int = 10
    estimate_age_limit_ns: int = _S // 2
    imu_age_limit_ns: int = _S // 2
    still_ns: int = 2 * _S
    still_acceleration_m_s2: float = 0.5
    still_turn_rate_rad_s: float = 0.1
    still_drift_m: float = 0.1

    def __post_init__(self) -> None:
        self._need("estimate_topic", bool(self.estimate_topic), "the name of a topic")
        self._need("imu_topic", bool(self.imu_topic), "the name of a topic")
        good = isinstance(self.estimate_source, EstimateSource)
        self._need("estimate_source", good, "one of odometry, pose, pose_with_covariance")
        rpy = self.imu_mounting_rpy_rad
        good = isinstance(rpy, tuple) and len(rpy) == 3 and all(_is_number(angle) for angle in rpy)  # noqa: PLR2004
        self._need("imu_mounting_rpy_rad", good, "three numbers: roll, pitch, yaw")
        self._angle("max_tilt_rad", "max_tilt_difference_rad", "max_orientation_deviation_rad")
        self._above_zero("gravity_m_s2", "gravity_tolerance_m_s2", "max_position_deviation_m", "quaternion_tolerance")
        self._above_zero("still_acceleration_m_s2", "still_turn_rate_rad_s", "still_drift_m")
        self._need("gravity_tolerance_m_s2", self.gravity_tolerance_m_s2 < self.gravity_m_s2, "below gravity_m_s2")
        self._whole("window_ns", "estimate_age_limit_ns", "imu_age_limit_ns", "still_ns")
        self._need("min_samples", type(self.min_samples) is int and self.min_samples >= 1, "a whole number above 0")


@dataclass(frozen=True)
class BatterySpec(_Checked):
    """When the battery is enough for the next mission.

    Args:
        age_limit_ns: oldest battery message that counts.
        min_takeoff_fraction: below this no mission starts, whatever it needs.
        min_voltage_v: below this no mission starts; None: not looked at.
    """

    age_limit_ns: int = 10 * _S
    min_takeoff_fraction: float = 0.3
    min_voltage_v: Optional[float] = None

    def __post_init__(self) -> None:
        self._whole("age_limit_ns")
        self._not_negative("min_takeoff_fraction")
        self._need("min_takeoff_fraction", self.min_takeoff_fraction <= 1, "a fraction 0..1")
        if self.min_voltage_v is not None:
            self._above_zero("min_voltage_v")
