"""The tables of `interface/` with the classes of ROS: messages and service answers <-> events and commands.

Names are defaults, all can be remapped. The rows of a check go to /diagnostics too, for tools that are not ours.
"""

from __future__ import annotations

from math import nan
from typing import Any, Dict, Mapping, Optional, Sequence, Tuple, Type, Union

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_srvs.srv import Trigger

from amaze_autonomy import msg, srv
from amaze_autonomy.engine.commands import Request
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    CheckReply,
    ComponentStatus,
    Event,
    RecordingStatus,
    Reply,
)
from amaze_autonomy.interface import (
    CHECK_ROW,
    COMPONENT,
    SERVICES,
    Service,
    Status,
    health_fields,
    service_of,
    status_of,
)

from ..engine.events import Check, Verdict
from ..journal.report import limit_words
from .clock import Clock

SERVICE_CLASSES: Dict[str, Type[Any]] = {
    name: Trigger if row.type == "Trigger" else getattr(srv, row.type) for name, row in SERVICES.items()
}
TAKEOFF_FRAME = "takeoff_enu"
"""What positions in our messages are measured in; no tf is needed, and none published."""
_DIAGNOSTICS_PERIOD_NS = 1_000_000_000
_LEVELS = {
    Verdict.PASS: DiagnosticStatus.OK,
    Verdict.WARN: DiagnosticStatus.WARN,
    Verdict.FAIL: DiagnosticStatus.ERROR,
    Verdict.UNKNOWN: DiagnosticStatus.STALE,
}
_FRAMES: Mapping[Type[Event], str] = {AutopilotStatus: TAKEOFF_FRAME}


def classes(name: str) -> Any:
    """Return the class of one of our messages by its name."""
    return getattr(msg, name)


def message_class(status: Status) -> Type[Any]:
    """Return the class of the messages of a status."""
    kind: Type[Any] = classes(status.shape.message)
    return kind


def number(value: Optional[float]) -> float:
    """Return the value, or NaN for None."""
    return nan if value is None else value


def ros_time(ns: int) -> rospy.Time:
    """Return nanoseconds as a ROS time."""
    return rospy.Time(ns // 1_000_000_000, ns % 1_000_000_000)


def age_of(header: Any, ros_ns: int) -> int:
    """Return how old a header says that its message is."""
    return ros_ns - int(header.stamp.secs) * 1_000_000_000 - int(header.stamp.nsecs)


def read_status(status: Status, message: Any, t_ns: int, ros_ns: int) -> Event:
    """Return the event of a message: arrival on the deciding clock, and in ROS time.

    Raises:
        InvalidMessageError: A field holds what cannot be.
    """
    sender = (getattr(message, "_connection_header", None) or {}).get("callerid", "")
    return status.read(message, t_ns, age_of(message.header, ros_ns), sender)


def status_message(
    event: Event,
    ros_ns: int,
    healthy: Optional[Mapping[str, Optional[bool]]] = None,
    measured: Optional[Mapping[str, Optional[float]]] = None,
    sequences: Optional[Mapping[str, int]] = None,
) -> Any:
    """Return the message of an event, stamped with the time at which it says that it was made.

    Args:
        event: what the engine is told.
        ros_ns: now.
        healthy: of an autopilot, what `statuses.HEALTH` names; None or not there: unknown.
        measured: likewise, what `statuses.MEASURED` names.
        sequences: likewise, numbers of the vehicle's own reports of its sensors, by their fields.
    """
    more: Dict[str, Any] = {}
    if isinstance(event, AutopilotStatus):
        more = health_fields(healthy, measured, sequences)
    elif isinstance(event, RecordingStatus):
        more = {"remaining": nan}
    message = status_of(event).write(event, classes, **more)
    message.header.frame_id = _FRAMES.get(type(event), "")
    message.header.stamp = ros_time(max(0, ros_ns - getattr(event, "age_ns", 0)))
    return message


def component_state(status: ComponentStatus, now_ns: int) -> msg.ComponentState:
    """Return one ComponentState; its `until` counts from `now_ns`, on the deciding clock."""
    return COMPONENT.written(status, now_ns, classes)


def check_row(row: Check) -> msg.Check:
    """Return one row of the pre-flight table."""
    return CHECK_ROW.written(row, 0, classes)


def request_of(command: Request) -> Tuple[Service, Any]:
    """Return the service that carries out a command, and the request to it."""
    service = service_of(command)
    if service is None:
        raise TypeError(f"{type(command).__name__} goes to no service")
    return service, SERVICE_CLASSES[service.name]._request_class(**service.ask(command, classes))


def response_of(service: Service, reply: Union[Reply, CheckReply], now_ns: int) -> Any:
    """Return the response of a service that says what was replied."""
    response = SERVICE_CLASSES[service.name]._response_class(**service.answer(reply, now_ns, classes))
    if hasattr(response, "gravity"):
        response.gravity.x = response.gravity.y = response.gravity.z = nan
    return response


class CheckDiagnostics:
    """Publishes the rows of one check on /diagnostics, one status for all of them, once a second.

    Args:
        name: of the status.
        clock: the node's.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self._name, self._clock = name, clock
        self._due_ns = 0
        self._publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)

    def publish(self, now_ns: int, rows: Sequence[Check]) -> None:
        """Publish the rows, at most once a second."""
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + _DIAGNOSTICS_PERIOD_NS
        message = DiagnosticArray(status=[self._status(rows)])
        message.header.stamp = ros_time(self._clock.ros_ns())
        self._publisher.publish(message)

    def _status(self, rows: Sequence[Check]) -> Any:
        worst = max(rows, key=lambda row: _LEVELS[row.verdict], default=None)
        return DiagnosticStatus(
            level=DiagnosticStatus.OK if worst is None else _LEVELS[worst.verdict],
            name=self._name,
            message="; ".join(row.advice for row in rows if row.advice) or "all checks pass",
            values=[KeyValue(row.name, _row_words(row)) for row in rows],
        )


def _row_words(row: Check) -> str:
    value = "" if row.value is None else f" {row.value:.4g} {row.unit}".rstrip()
    limits = limit_words(row, lambda each: f"{each:.4g} {row.unit}".rstrip())
    return f"{row.verdict.name}{value}{f', limit {limits}' if limits else ''}"
