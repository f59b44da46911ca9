"""The statuses that the engine listens to: one row for each.

A new field is a line in the event and one in the message.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import nan
from typing import Any, Dict, Mapping, Optional, Tuple, Type

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

from ..engine.events import Check, made
from .fields import Classes, Shape

__all__ = ["CHECK_ROW", "COMPONENT", "STATUSES", "Status", "health_fields", "health_of", "status_of"]

CHECK_ROW = Shape(Check, "Check")
COMPONENT = Shape(ComponentStatus, "ComponentState", needed={"name": "the name of a component"})
PLATFORM = Shape(PlatformRecording, "PlatformRecording", named={"written_bytes": "bytes"})
_ARRIVAL = ("t_ns", "age_ns", "publisher")
"""What is known of a message by its arrival, not by its fields."""


@dataclass(frozen=True)
class Status:
    """One row.

    Args:
        name: as topic maps call it.
        topic: its default name.
        shape: its event and its message.
    """

    name: str
    topic: str
    shape: Shape[Any]
    _has_publisher: bool = field(init=False, compare=False, repr=False)

    @property
    def event(self) -> Type[Event]:
        """The class of its events."""
        kind: Type[Event] = self.shape.kind
        return kind

    def __post_init__(self) -> None:
        object.__setattr__(self, "_has_publisher", "publisher" in self.event.__dataclass_fields__)

    def read(self, message: Any, t_ns: int, age_ns: int, publisher: str = "") -> Event:
        """Return the event of a message that arrived at `t_ns`, `age_ns` after it was made, from a node of that name.

        Raises:
            InvalidMessageError, InvalidEventError: A field holds what cannot be.
        """
        more = {"publisher": publisher} if self._has_publisher else {}
        return made(self.event, t_ns=t_ns, age_ns=age_ns, **self.shape.read(message, t_ns - age_ns), **more)

    def write(self, event: Event, classes: Classes, **more: Any) -> Any:
        """Return the message of an event, without its stamp."""
        return self.shape.written(event, event.t_ns, classes, **more)


STATUSES: Tuple[Status, ...] = (
    Status(
        "watchdog_action",
        "watchdog/action",
        Shape(WatchdogAction, "WatchdogAction", without=_ARRIVAL, parts=(COMPONENT,)),
    ),
    Status("watchdog_info", "watchdog/info", Shape(WatchdogInfo, "WatchdogInfo", without=_ARRIVAL, parts=(COMPONENT,))),
    Status("mission_planner", "mission_planner/status", Shape(MissionStatus, "MissionStatus", without=_ARRIVAL)),
    Status(
        "data_recorder",
        "data_recorder/status",
        Shape(RecordingStatus, "RecordingStatus", without=_ARRIVAL, parts=(PLATFORM,)),
    ),
    Status(
        "autopilot",
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
    Status("landing_detection", "landing_detection/landed", Shape(LandedStatus, "Landed", without=_ARRIVAL)),
)

_BY_EVENT: Mapping[Type[Event], Status] = {status.event: status for status in STATUSES}


def status_of(event: Event) -> Status:
    """Return the row of an event."""
    return _BY_EVENT[type(event)]


# --- health -----------------------------------------------------------------------------------------------------------
# What an AutopilotStatus says besides, for the watchdog and for people: no matter of the engine.

HEALTH = ("gps", "imu", "magnetometer", "barometer", "rc", "prearm")
MEASURED = ("battery_cell_voltage", "battery_current", "clock_offset")
_HEALTHY: Tuple[Optional[bool], ...] = (None, True, False)
"""SENSOR_UNKNOWN, SENSOR_HEALTHY, SENSOR_FAILED."""


def health_fields(
    healthy: Optional[Mapping[str, Optional[bool]]], measured: Optional[Mapping[str, Optional[float]]] = None
) -> Dict[str, Any]:
    """Return the fields of the message that say it; what is None or not there is unknown."""
    values = {name: (measured or {}).get(name) for name in MEASURED}
    return {
        **{name: _HEALTHY.index((healthy or {}).get(name)) for name in HEALTH},
        **{name: nan if value is None else value for name, value in values.items()},
    }


def health_of(message: Any) -> Dict[str, Optional[bool]]:
    """Return what a message says of the autopilot's sensors, by name; None: it does not know."""
    values = {name: int(getattr(message, name, 0)) for name in HEALTH}
    return {name: _HEALTHY[value] if 0 <= value < len(_HEALTHY) else None for name, value in values.items()}
