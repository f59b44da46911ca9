"""The estimator that must be told to begin: its service is called on a thread of its own, and nobody waits for it."""

from __future__ import annotations

import logging
import threading
import time
from typing import Any, Mapping, Optional, Sequence, Tuple, Type

import rosgraph
import rospy
from std_msgs.msg import String
from std_srvs.srv import Empty, SetBool, Trigger

from amaze_autonomy import msg
from amaze_autonomy.engine.events import Check
from amaze_autonomy.monitoring.initialisation import Initialisation, InitialisationSpec, InitialisationType

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
_STATUS_MAX_AGE_NS = 2_000_000_000
_log = logging.getLogger(__name__)


class Estimator:
    """Asks for an initialisation when the check of the states needs one, and once when a mission begins in the air.

    Args:
        spec: the services.
        clock: the node's.
    """

    def __init__(self, spec: InitialisationSpec, clock: Clock) -> None:
        self._spec, self._clock = spec, clock
        self._initialisation, self._lock = Initialisation(spec), threading.Lock()
        self._workers = Workers("initialisation")
        self._armed: Optional[bool] = None
        self._heard_ns, self._state = 0, ""

    def listen(self) -> None:
        """Subscribe to what must be known: is the vehicle disarmed, has the mission begun?"""
        if self._spec.service:
            rospy.Subscriber("autopilot/status", msg.AutopilotStatus, self._take_status, queue_size=1)
        if self._spec.in_flight_service:
            rospy.Subscriber("autonomy/state_name", String, self._take_state, queue_size=10)

    def rows(self, rows: Sequence[Check]) -> Tuple[Check, ...]:
        """Return the rows of a check with what is said of the initialisation; ask for it where that is due."""
        with self._lock:
            now_ns = self._clock.now_ns()
            armed = self._armed if now_ns - self._heard_ns <= _STATUS_MAX_AGE_NS else None
            rows, due = self._initialisation.check(now_ns, rows, armed=armed)
        if due:
            self._workers.submit(self._initialise)
        return tuple(rows)

    def _initialise(self) -> None:
        failure = self._ask(self._spec.service, self._spec.type)
        with self._lock:
            self._initialisation.answered(self._clock.now_ns(), failure)

    def _initialise_in_flight(self) -> None:
        self._ask(self._spec.in_flight_service, self._spec.in_flight_type)

    def _take_status(self, message: Any) -> None:
        with self._lock:
            self._armed = bool(message.armed) if message.armed_known else None
            self._heard_ns = self._clock.now_ns()

    def _take_state(self, message: Any) -> None:
        before, self._state = self._state, message.data
        if (before, self._state) == ("TAKEOFF", "MISSION"):
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
            _log.warning("the estimator was not initialised: %s", failure)
        else:
            _log.info("the estimator was initialised: %s", name)
        return failure
