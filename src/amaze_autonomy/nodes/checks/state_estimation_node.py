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
import time
from typing import Any, Callable, Mapping, Sequence, Tuple, Type

import rosgraph
import rospy
from geometry_msgs.msg import Vector3
from sensor_msgs.msg import Imu
from std_msgs.msg import String
from std_srvs.srv import Empty, SetBool, Trigger

from amaze_autonomy import msg, srv
from amaze_autonomy.config import Configuration
from amaze_autonomy.engine.events import Check
from amaze_autonomy.monitoring.initialisation import Initialisation, InitialisationType
from amaze_autonomy.monitoring.readings import estimate_reader, vector
from amaze_autonomy.monitoring.state_estimation import StateEstimationMonitor, StateVerdict
from amaze_autonomy.ros.clock import Clock, Workers

from ...ros.errors import CallError
from ...ros.interface import CheckDiagnostics, check_row, number
from ...ros.node_main import Startup, run_node
from ...ros.service_client import ServiceClient
from ...ros.topic_reader import TopicReader, take_messages
from .landing_detection_node import ESTIMATE_MESSAGES, SLICE_S

# --- the estimator that must be told to begin -------------------------------------------------------------------------


INITIALISES: Mapping[InitialisationType, Tuple[Type[Any], Mapping[str, Any]]] = {
    InitialisationType.TRIGGER: (Trigger, {}),
    InitialisationType.SET_BOOL: (SetBool, {"data": True}),
    InitialisationType.EMPTY: (Empty, {}),
}
"""Classes of services that initialise, with the fields of the request."""


class Estimator:
    """Asks for an initialisation when the check of the states needs one, and once when a mission begins in the air.

    Args:
        configuration: with the services.
        clock: the node's.
        forget: called when it has said yes: what it estimated before says nothing any more.
    """

    def __init__(self, configuration: Configuration, clock: Clock, forget: Callable[[], None] = lambda: None) -> None:
        self._spec, self._clock, self._forget = configuration.initialisation, clock, forget
        limit_ns = configuration.rules.limits.autopilot_status_limit_ns
        self._initialisation, self._lock = Initialisation(self._spec, limit_ns), threading.Lock()
        self._workers = Workers("initialisation")
        self._workers.prepare(1)

    def listen(self) -> None:
        """Subscribe to what must be known: is the vehicle disarmed, has a pre-flight or the mission begun?"""
        if self._spec.service:
            rospy.Subscriber("autopilot/status", msg.AutopilotStatus, self._take_status, queue_size=1)
        if self._spec.in_flight_service or self._spec.always:
            rospy.Subscriber("autonomy/state_name", String, self._take_state, queue_size=10)

    def rows(self, judge: Callable[[], Sequence[Check]]) -> Tuple[Check, ...]:
        """Return the rows of a check with what is said of the initialisation; ask for it where that is due.

        Args:
            judge: makes the rows; here, so that none is of before an answer that comes meanwhile.
        """
        with self._lock:
            said, due = self._initialisation.check(self._clock.now_ns(), judge())
        if due:
            self._begin()
        return said

    def _begin(self) -> None:
        try:
            self._workers.submit(self._initialise)
        except (RuntimeError, MemoryError) as error:  # no thread: it is asked for again with the next check
            with self._lock:
                self._initialisation.answered(self._clock.now_ns(), f"{self._spec.service}: not asked: {error}")

    def _initialise(self) -> None:
        failure = f"{self._spec.service}: its call ended without an answer"
        try:
            failure = self._ask(self._spec.service, self._spec.type)
            if not failure:
                self._forget()
        finally:  # or it would be waited for without an end
            with self._lock:
                self._initialisation.answered(self._clock.now_ns(), failure)

    def _initialise_in_flight(self) -> None:
        self._ask(self._spec.in_flight_service, self._spec.in_flight_type)

    def _take_status(self, message: Any) -> None:
        with self._lock:
            armed = bool(message.armed) if message.armed_known else None
            self._initialisation.heard(self._clock.now_ns(), armed=armed)

    def _take_state(self, message: Any) -> None:
        with self._lock:
            due = self._initialisation.entered(message.data)
        if due:
            self._workers.submit(self._initialise_in_flight)

    def _ask(self, name: str, kind: InitialisationType) -> str:
        """Call a service; return why it did not do it, or nothing."""
        service, fields = INITIALISES[kind]
        client = ServiceClient(rospy.resolve_name(name), service, rosgraph.get_master_uri(), rospy.get_name())
        try:
            request = client.serialize(service._request_class(**fields))
            answer = client.call(request, time.monotonic() + self._spec.limit_ns * 1e-9)
        except CallError as error:
            failure = f"{name}: {error}"
        else:
            failure = "" if getattr(answer, "success", True) else f"{name}: {answer.message or 'it refuses'}"
        finally:
            client.close()
        if failure:
            rospy.logwarn("the estimator was not initialised: %s", failure)
        else:
            rospy.loginfo("the estimator was initialised: %s", name)
        return failure


# --- the node ---------------------------------------------------------------------------------------------------------


_NOTHING = float("nan")
_PERIOD_NS = 1_000_000_000
_LONGEST_WAIT_S = 0.5


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
        self._lock, self._ended = threading.Lock(), False
        self._reader = TopicReader(SLICE_S)
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
            take_messages(spec.topic, ESTIMATE_MESSAGES[spec.source], self._reader, self._take_estimate)
        if spec.imu_topic:
            take_messages(spec.imu_topic, Imu, self._reader, self._take_imu)
        self._estimator.listen()
        rospy.Service("state_estimation/check", srv.CheckState, self._check)
        due_ns = self._clock.now_ns() + _PERIOD_NS
        while not self._ended:
            self._reader.wait(min(_LONGEST_WAIT_S, self._clock.wall_wait_s(due_ns)))
            now_ns = self._clock.now_ns()
            if now_ns >= due_ns:
                due_ns = now_ns + _PERIOD_NS
                self._diagnostics.publish(now_ns, self._verdict().checks)

    def end(self) -> None:
        """End; from any thread."""
        self._ended = True
        self._reader.wake()


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("state_estimation", StateEstimationNode)
