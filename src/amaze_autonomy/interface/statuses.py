"""The statuses that the engine listens to: one row for each.

A new field is a line in the event and one in the message.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Mapping, Tuple, Type

from amaze_autonomy.engine.events import (
    AutopilotStatus,
    ComponentStatus,
    Event,
    LandedStatus,
    MissionStatus,
    PlatformRecording,
    RecordingStatus,
    WatchdogAction,
    WatchdogInfo,
)

from ..engine.events import Check
from .fields import Classes, Shape

__all__ = ["CHECK_ROW", "COMPONENT", "STATUSES", "Status", "status_of"]

CHECK_ROW = Shape(Check, "Check")
COMPONENT = Shape(ComponentStatus, "ComponentState", needed={"name": "the name of a component"})
PLATFORM = Shape(PlatformRecording, "PlatformRecording", named={"written_bytes": "bytes"})
_ARRIVAL = ("t_ns", "age_ns", "publisher")
"""What is known of a message by its arrival, not by its fields."""


@dataclass(frozen=True)
class Status:
    """One row.

    Args:
        topic: its default name.
        shape: its event and its message.
    """

    topic: str
    shape: Shape[Any]

    @property
    def event(self) -> Type[Event]:
        """The class of its events."""
        kind: Type[Event] = self.shape.kind
        return kind

    def read(self, message: Any, t_ns: int, age_ns: int, **arrival: Any) -> Event:
        """Return the event of a message that arrived at `t_ns`, `age_ns` after it was made.

        Raises:
            InvalidMessageError: A field holds what cannot be.
        """
        event: Event = self.shape.kind(t_ns=t_ns, age_ns=age_ns, **self.shape.read(message, t_ns - age_ns), **arrival)
        return event

    def write(self, event: Event, classes: Classes, **more: Any) -> Any:
        """Return the message of an event, without its stamp."""
        return self.shape.written(event, event.t_ns, classes, **more)


STATUSES: Tuple[Status, ...] = (
    Status("watchdog/action", Shape(WatchdogAction, "WatchdogAction", without=_ARRIVAL, parts=(COMPONENT,))),
    Status("watchdog/info", Shape(WatchdogInfo, "WatchdogInfo", without=_ARRIVAL, parts=(COMPONENT,))),
    Status("mission_planner/status", Shape(MissionStatus, "MissionStatus", without=_ARRIVAL)),
    Status("data_recorder/status", Shape(RecordingStatus, "RecordingStatus", without=_ARRIVAL, parts=(PLATFORM,))),
    Status(
        "autopilot/status",
        Shape(
            AutopilotStatus,
            "AutopilotStatus",
            without=_ARRIVAL,
            known_by={
                "armed": "armed_known",
                "height_m": "height_valid",
                "position_x_m": "position_valid",
                "position_y_m": "position_valid",
            },
        ),
    ),
    Status("landing_detection/landed", Shape(LandedStatus, "Landed", without=_ARRIVAL)),
)

_BY_EVENT: Mapping[Type[Event], Status] = {status.event: status for status in STATUSES}


def status_of(event: Event) -> Status:
    """Return the row of an event."""
    return _BY_EVENT[type(event)]
