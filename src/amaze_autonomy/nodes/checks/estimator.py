"""The estimator that must be told to begin: its service is called on a thread of its own, and nobody waits for it."""

from __future__ import annotations

import threading
import time
from typing import Any, Callable, Mapping, Sequence, Tuple, Type

import rosgraph
import rospy
from std_msgs.msg import String
from std_srvs.srv import Empty, SetBool, Trigger

from amaze_autonomy import msg
from amaze_autonomy.config import Configuration
from amaze_autonomy.engine.events import Check
from amaze_autonomy.monitoring.initialisation import Initialisation, InitialisationType

from ...ros.clock import Clock
from ...ros.errors import CallError
from ...ros.service_client import ServiceClient
from ...ros.threads import Workers

__all__ = ["Estimator"]

_TYPES: Mapping[InitialisationType, Tuple[Type[Any], Mapping[str, Any]]] = {
    InitialisationType.TRIGGER: (Trigger, {}),
    InitialisationType.SET_BOOL: (SetBool, {"data": True}),
    InitialisationType.EMPTY: (Empty, {}),
}


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
            self._workers.submit(self._initialise)
        return said

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
        service, fields = _TYPES[kind]
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
