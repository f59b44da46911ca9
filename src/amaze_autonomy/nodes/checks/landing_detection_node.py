"""The landing detection node: is the vehicle on the ground, has it landed?

    landing_detection/check    CheckLanded
    landing_detection/landed   Landed, 5 Hz and at once on a change
    /diagnostics               diagnostic_msgs/DiagnosticArray, 1 Hz
    autopilot/status           AutopilotStatus: landed state and vertical speed (subscribed)
    (landing_detection.topic)  the range finder, (state_estimation.topic) the estimate, for the tilt (subscribed)

Topics, kinds of messages and limits: sensors.yaml. Parameters: `node_main.py`. How it judges: docs/monitoring.md.
"""

from __future__ import annotations

import threading
from typing import Any, Mapping, Type

import rospy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan, Range
from std_msgs.msg import Float32

from amaze_autonomy import msg, srv
from amaze_autonomy.config import Configuration
from amaze_autonomy.engine.events import LandedStatus, VehicleLanded
from amaze_autonomy.monitoring.gravity import tilt_of, up_of_quaternion
from amaze_autonomy.monitoring.landing import STEP_NS, LandingDetector, LandingVerdict
from amaze_autonomy.monitoring.readings import estimate_reader, range_reader
from amaze_autonomy.monitoring.specs import EstimateSource, RangeSource
from amaze_autonomy.ros.clock import Clock

from ...ros.interface import CheckDiagnostics, check_row, number, status_message
from ...ros.node_main import Startup, run_node
from ...ros.topic_reader import TopicReader, take_messages

_S = 1_000_000_000
_QUEUE = 10
_LONGEST_WAIT_S = 0.5
_LINK_LIMIT_S = 2.0
SLICE_S = STEP_NS / _S
"""It looks at its topics as often as it judges: a message counts as that much younger at most."""
_RANGE_MESSAGES: Mapping[RangeSource, Type[Any]] = {
    RangeSource.RANGE: Range,
    RangeSource.SCAN: LaserScan,
    RangeSource.FLOAT: Float32,
    RangeSource.POSE: PoseStamped,
}
_LANDED = {int(state.value): state for state in VehicleLanded}


class LandingDetectionNode:
    """A detector, fed by its topics under one lock.

    Args:
        configuration: as loaded.
        clock: the node's.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        self._clock, self._configuration = clock, configuration
        self._spec = configuration.landing
        self._detector = LandingDetector(self._spec)
        self._read = range_reader(self._spec)
        self._read_estimate = estimate_reader(configuration.state_estimation.source)
        self._startup = Startup(configuration, clock)
        self._lock, self._ended = threading.Lock(), False
        self._reader = TopicReader(SLICE_S)
        self._period_ns = round(_S / configuration.streams.landing_detection_rate_hz)
        self._publisher = rospy.Publisher("landing_detection/landed", msg.Landed, queue_size=_QUEUE, tcp_nodelay=True)
        self._diagnostics = CheckDiagnostics("landing detection", clock)

    # --- samples; on this node's own thread -----------------------------------------------------------------------

    def _subscribe(self) -> None:
        take_messages(self._spec.topic, _RANGE_MESSAGES[self._spec.source], self._reader, self._take_range)
        take_messages("autopilot/status", msg.AutopilotStatus, self._reader, self._take_autopilot)
        states = self._configuration.state_estimation
        # a height is along the vertical already, a range along the vehicle's z axis
        if self._spec.tilt_correction and self._spec.source is not RangeSource.POSE and states.topic:
            take_messages(states.topic, ESTIMATE_MESSAGES[states.source], self._reader, self._take_estimate)

    def _take_range(self, message: Any) -> None:
        reading = self._read(message)
        with self._lock:
            self._detector.add_range(self._clock.now_ns(), reading.value, reading.least, reading.most)

    def _take_estimate(self, message: Any) -> None:
        up = up_of_quaternion(*self._read_estimate(message).orientation)
        if up is not None:
            with self._lock:
                self._detector.add_tilt(self._clock.now_ns(), tilt_of(up))

    def _take_autopilot(self, message: Any) -> None:
        """Take what the autopilot says of itself; when its link is old, it says nothing."""
        if not message.link_age <= _LINK_LIMIT_S:
            return
        with self._lock:
            now_ns = self._clock.now_ns()
            self._detector.add_vertical_speed(now_ns, message.vertical_speed)
            self._detector.add_autopilot(now_ns, _LANDED.get(message.landed, VehicleLanded.UNKNOWN))

    # --- judgement ------------------------------------------------------------------------------------------------

    def _check(self, _request: Any) -> Any:
        with self._lock:
            now_ns = self._clock.now_ns()
            rows, verdict = self._startup.rows(now_ns, self._detector.checks(now_ns)), self._detector.evaluate(now_ns)
        return srv.CheckLandedResponse(
            on_ground=all(row.passed for row in rows),
            distance=number(verdict.distance_m),
            checks=[check_row(row) for row in rows],
        )

    def run(self) -> None:
        """Judge, on this thread, until `end`."""
        self._subscribe()
        rospy.Service("landing_detection/check", srv.CheckLanded, self._check)
        said, due_ns = None, 0
        while not self._ended:
            with self._lock:
                now_ns = self._clock.now_ns()
                verdict = self._detector.evaluate(now_ns)
                due = now_ns >= due_ns or verdict.landed is not said
                rows = self._detector.checks(now_ns) if due else ()
            if due:
                said, due_ns = verdict.landed, now_ns + self._period_ns
                self._publish(verdict, now_ns)
                self._diagnostics.publish(now_ns, rows)
            self._reader.wait(min(_LONGEST_WAIT_S, self._clock.wall_wait_s(min(due_ns, verdict.changes_at_ns))))

    def _publish(self, verdict: LandingVerdict, now_ns: int) -> None:
        status = LandedStatus(t_ns=now_ns, landed=verdict.landed, distance_m=verdict.distance_m, reason=verdict.reason)
        self._publisher.publish(status_message(status, self._clock.ros_ns()))

    def end(self) -> None:
        """End; from any thread."""
        self._ended = True
        self._reader.wake()


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("landing_detection", LandingDetectionNode)


# --- estimate topics --------------------------------------------------------------------------------------------------
# The kinds of messages that a state estimate may come in.


ESTIMATE_MESSAGES: Mapping[EstimateSource, Type[Any]] = {
    EstimateSource.ODOMETRY: Odometry,
    EstimateSource.POSE: PoseStamped,
    EstimateSource.POSE_WITH_COVARIANCE: PoseWithCovarianceStamped,
}
