"""What is watched, and with which limits: frozen, checked when made. The configuration builds them; defaults fly.

Rules of this file: times are integer nanoseconds (`_ns`), angles radians (`_rad`), everything else SI. A specification
that cannot be is a `SpecError` that names the field, so that a reader of YAML can point at the line. None is "derived"
or "not checked", as each field says.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Optional, Tuple

from ..engine.rules import Severity
from .preflight_specs import (
    BatterySpec,
    Checked,
    EstimateSource,
    LandingSpec,
    RangeSource,
    StateEstimationSpec,
    is_command,
)

__all__ = [
    "GROUPS",
    "AutopilotSensor",
    "BatterySpec",
    "ComponentSpec",
    "EstimateSource",
    "LandingSpec",
    "PollingSpec",
    "RangeSource",
    "RestartPolicy",
    "RestartSpec",
    "StateEstimationSpec",
    "TopicSpec",
]

GROUPS = ("px4", "other")
_S = 1_000_000_000
_SLOWEST_HZ, _FASTEST_HZ = 1e-3, 1e5


class RestartPolicy(enum.Enum):
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


@dataclass(frozen=True)
class TopicSpec(Checked):
    """A topic that must come at a rate.

    Args:
        topic: its name.
        rate_hz: expected messages per second.
        tolerance_fraction: rate off by more than this fraction of the expected one: code 2.
        rate_failed_fraction: rate below this fraction of the expected one: the component has failed.
        age_limit_ns: silence longer than this, and than three periods: the component has failed.
        window_ns: over which the rate is measured; None: 1 s or ten periods, whichever is longer.
        finite: content is looked at, NaN or infinity in it is a failure.
        unchanged_limit_ns: content that stays the same for longer is a failure (a camera that sends the same frame);
            None: not looked at.
        stamp_tolerance_ns: header stamps further than this from the time of arrival: code 2; None: not looked at.
    """

    topic: str
    rate_hz: float
    tolerance_fraction: float = 0.2
    rate_failed_fraction: float = 0.3
    age_limit_ns: int = _S // 2
    window_ns: Optional[int] = None
    finite: bool = False
    unchanged_limit_ns: Optional[int] = None
    stamp_tolerance_ns: Optional[int] = None

    def __post_init__(self) -> None:
        self._need("topic", bool(self.topic), "the name of a topic")
        self._above_zero("rate_hz", "tolerance_fraction", "rate_failed_fraction")
        self._need("rate_hz", _SLOWEST_HZ <= self.rate_hz <= _FASTEST_HZ, "between 0.001 and 100000 Hz")
        self._need("tolerance_fraction", self.tolerance_fraction < 1, "below 1")
        within = self.rate_failed_fraction < 1 - self.tolerance_fraction
        self._need("rate_failed_fraction", within, "below 1 - tolerance_fraction")
        self._whole("age_limit_ns")
        for name in ("window_ns", "unchanged_limit_ns", "stamp_tolerance_ns"):
            if getattr(self, name) is not None:
                self._whole(name)
        if self.window_ns is not None:
            enough = self.window_ns >= 4 * self.period_ns
            self._need("window_ns", enough, f"at least four periods ({4 * self.period_ns / _S:g} s)")

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
class PollingSpec(Checked):
    """How often nodes and drivers are asked, and how old what they or the autopilot said may be.

    Args:
        node_period_ns: how often a node is asked (XML-RPC getPid).
        node_answer_limit_ns: time that its answer may take.
        node_age_limit_ns: longest time without a good answer; a refused connection fails at once.
        driver_period_ns: how often the command that looks at a driver is run, for the whole flight.
        driver_run_limit_ns: time that one run may take; longer is a failed run.
        driver_age_limit_ns: longest time without a result.
        autopilot_age_limit_ns: longest time without a report of the autopilot.
        autopilot_reports: reports in a row that change the verdict; the first of all counts at once.
    """

    node_period_ns: int = _S // 2
    node_answer_limit_ns: int = _S // 4
    node_age_limit_ns: int = 3 * _S // 2
    driver_period_ns: int = 2 * _S
    driver_run_limit_ns: int = 1 * _S
    driver_age_limit_ns: int = 5 * _S
    autopilot_age_limit_ns: int = 5 * _S
    autopilot_reports: int = 2

    def __post_init__(self) -> None:
        self._whole("node_period_ns", "node_answer_limit_ns", "node_age_limit_ns")
        self._whole("driver_period_ns", "driver_run_limit_ns", "driver_age_limit_ns", "autopilot_age_limit_ns")
        least = self.node_period_ns + self.node_answer_limit_ns
        self._need(
            "node_age_limit_ns", self.node_age_limit_ns >= least, "at least node_period_ns + node_answer_limit_ns"
        )
        least = self.driver_period_ns + self.driver_run_limit_ns
        expected = "at least driver_period_ns + driver_run_limit_ns"
        self._need("driver_age_limit_ns", self.driver_age_limit_ns >= least, expected)
        self._count("autopilot_reports")


@dataclass(frozen=True)
class RestartSpec(Checked):
    """How a component is restarted, and when the watchdog gives up.

    Args:
        policy: what is restarted; NEVER is the only one for a component of the PX4.
        command: program and arguments, for the policies DRIVER and COMMAND; no shell.
        attempts: at most so many, one after the other.
        backoff_ns: pause between the end of one attempt and the next.
        attempt_limit_ns: time in which an attempt must bring the component back.
        total_limit_ns: time in which the component must be back, all attempts and pauses together.
        good_samples: messages in time that show that it is back, whether it was restarted or came back by itself.
        forget_after_ns: good for so long: attempts and time spent are forgotten. A component that fails again earlier
            goes on where it was, so that a flapping one is given up.
    """

    policy: RestartPolicy = RestartPolicy.NEVER
    command: Tuple[str, ...] = ()
    attempts: int = 3
    backoff_ns: int = 1 * _S
    attempt_limit_ns: int = 5 * _S
    total_limit_ns: int = 15 * _S
    good_samples: int = 5
    forget_after_ns: int = 60 * _S

    def __post_init__(self) -> None:
        self._need("policy", isinstance(self.policy, RestartPolicy), "one of never, node, driver, command")
        if self.policy in (RestartPolicy.DRIVER, RestartPolicy.COMMAND):
            self._need("command", is_command(self.command), "a program and its arguments")
        else:
            self._need("command", self.command == (), f"empty with the policy {self.policy.value}")
        self._count("attempts", "good_samples")
        self._whole("backoff_ns", "attempt_limit_ns", "total_limit_ns", "forget_after_ns")
        self._need("total_limit_ns", self.total_limit_ns >= self.attempt_limit_ns, "at least attempt_limit_ns")


@dataclass(frozen=True)
class ComponentSpec(Checked):
    """One component: what tells that it works, how bad its failure is, and what may be done about it.

    It has at least one source: topics, a node, a driver, the autopilot. They are judged one by one; the worst counts.

    Args:
        name: as in sensors.yaml and on the wire, e.g. "mission_camera".
        group: "px4" or "other"; components of the PX4 are never restarted.
        severity: how bad its failure is, unless the mission names another.
        topics: topics that it must publish.
        node: ROS node that must answer; None when none is watched.
        driver: program and arguments that tell by exit status 0 that its driver works; empty when there is none.
        autopilot: sensor that the autopilot must call healthy; None when none counts.
        restart: how it is restarted.
        wait_limit_ns: how long a flight may wait for it, all its failures together; 0 when it never waits.
        polling: how often node and driver are asked.
        required: must be at code 1 before takeoff when a mission does not say what it needs.
    """

    name: str
    group: str = "other"
    severity: Severity = Severity.LOW
    topics: Tuple[TopicSpec, ...] = ()
    node: Optional[str] = None
    driver: Tuple[str, ...] = ()
    autopilot: Optional[AutopilotSensor] = None
    restart: RestartSpec = field(default_factory=RestartSpec)
    wait_limit_ns: int = 0
    polling: PollingSpec = field(default_factory=PollingSpec)
    required: bool = True

    def __post_init__(self) -> None:
        self._need("name", bool(self.name), "the name of a component")
        self._need("group", self.group in GROUPS, "px4 or other")
        self._need("severity", isinstance(self.severity, Severity), "low, moderate, high or highest")
        self._need("driver", self.driver == () or is_command(self.driver), "a program and its arguments")
        good = self.autopilot is None or isinstance(self.autopilot, AutopilotSensor)
        self._need("autopilot", good, "one of gps, imu, magnetometer, barometer")
        self._not_negative("wait_limit_ns")
        self._need_source()
        self._need_restart()

    def _need_source(self) -> None:
        expected = "a source (a topic, a node, a driver or the autopilot), nothing would be watched"
        self._need("topics", bool(self.topics or self.node or self.driver or self.autopilot), expected)
        names = [topic.topic for topic in self.topics]
        self._need("topics", len(set(names)) == len(names), "topics that differ")

    def _need_restart(self) -> None:
        policy = self.restart.policy
        expected = "never for a component of the PX4, the vehicle would be uncontrollable"
        self._need("restart", policy is RestartPolicy.NEVER or self.group != "px4", expected)
        self._need(
            "restart", policy is not RestartPolicy.NODE or bool(self.node), "possible: there is no node to restart"
        )
