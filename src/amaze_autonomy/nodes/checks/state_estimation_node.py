"""The state estimation node: are the states valid, does gravity point down? A check, not an estimator.

    state_estimation/check          CheckState
    /diagnostics                    diagnostic_msgs/DiagnosticArray, 1 Hz
    (state_estimation.topic)        the estimate: Odometry, PoseStamped or PoseWithCovarianceStamped (subscribed)
    (state_estimation.imu_topic)    sensor_msgs/Imu (subscribed)
    (initialisation.service)        asked, where the estimator must be told to begin; (in_flight_service) in the air
    autonomy/state_name             std_msgs/String (subscribed), where a pre-flight or a mission is when it is asked
    autopilot/status                AutopilotStatus (subscribed), where it is asked: only a disarmed vehicle is

Topics, kinds of messages and limits: sensors.yaml. Parameters: `node_main.py`. How it judges: docs/monitoring.md.
"""

from __future__ import annotations

import threading
from typing import Any

import rospy
from geometry_msgs.msg import Vector3
from sensor_msgs.msg import Imu

from amaze_autonomy import srv
from amaze_autonomy.config import Configuration
from amaze_autonomy.monitoring.readings import estimate_reader, vector
from amaze_autonomy.monitoring.state_estimation import StateEstimationMonitor, StateVerdict

from ...ros.clock import Clock
from ...ros.interface import check_row, number
from ...ros.node_main import Startup, run_node
from .diagnostics import CheckDiagnostics
from .estimator import Estimator
from .landing_detection_node import ESTIMATE_MESSAGES

__all__ = ["StateEstimationNode", "main"]

_NOTHING = float("nan")
_QUEUE = 50
_PERIOD_S = 1.0


class StateEstimationNode:
    """A monitor, fed by its topics under one lock.

    Args:
        configuration: as loaded.
        clock: the node's.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        self._clock, self._spec = clock, configuration.state_estimation
        self._monitor = StateEstimationMonitor(self._spec)
        self._read = estimate_reader(self._spec.source)
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._startup = Startup(configuration, clock)
        self._estimator = Estimator(configuration, clock, self._forget)
        self._diagnostics = CheckDiagnostics("state estimation", clock)

    def _take_estimate(self, message: Any) -> None:
        """Take an estimate; its stamp, moved to the deciding clock, tells its age. A stamp of 0 says nothing."""
        now_ns, stamp_ns = self._clock.now_ns(), int(message.header.stamp.to_nsec())
        age_ns = self._clock.ros_ns() - stamp_ns
        estimate = self._read(message)
        with self._lock:
            self._monitor.add_estimate(now_ns, estimate, now_ns - age_ns if stamp_ns else None)

    def _take_imu(self, message: Any) -> None:
        force, turn_rate = vector(message.linear_acceleration), vector(message.angular_velocity)
        # a covariance that begins with -1 says that there is no such measurement (sensor_msgs/Imu)
        measured = message.angular_velocity_covariance[0] >= 0
        with self._lock:
            self._monitor.add_imu(self._clock.now_ns(), force, turn_rate if measured else None)

    def _forget(self) -> None:
        with self._lock:
            self._monitor.forget_estimates()

    def _verdict(self) -> StateVerdict:
        with self._lock:
            return self._monitor.check(self._clock.now_ns())

    def _check(self, _request: Any) -> Any:
        rows = self._estimator.rows(lambda: self._startup.rows(self._clock.now_ns(), self._verdict().checks))
        verdict = self._verdict()
        return srv.CheckStateResponse(
            valid=all(row.passed for row in rows),
            gravity=Vector3(*(verdict.gravity or (_NOTHING,) * 3)),
            tilt=number(verdict.tilt_rad),
            checks=[check_row(row) for row in rows],
        )

    def run(self) -> None:
        """Listen until `end`."""
        spec = self._spec
        if spec.topic:
            kind = ESTIMATE_MESSAGES[spec.source]
            rospy.Subscriber(spec.topic, kind, self._take_estimate, queue_size=_QUEUE, tcp_nodelay=True)
        if spec.imu_topic:
            rospy.Subscriber(spec.imu_topic, Imu, self._take_imu, queue_size=_QUEUE, tcp_nodelay=True)
        self._estimator.listen()
        rospy.Service("state_estimation/check", srv.CheckState, self._check)
        while not self._ended.wait(_PERIOD_S):
            self._diagnostics.publish(self._clock.now_ns(), self._verdict().checks)

    def end(self) -> None:
        """End; from any thread and from signal handlers."""
        self._ended.set()


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("state_estimation", StateEstimationNode)
