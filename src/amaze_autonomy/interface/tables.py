"""The tables: the statuses that the engine listens to, and the services that it asks, one row for each.

A new field is a line in the event and one in the message.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import nan
from typing import Any, Dict, Mapping, NamedTuple, Optional, Tuple, Type, Union

from amaze_autonomy.engine.commands import (
    AutopilotDisarm,
    AutopilotLand,
    Command,
    LoadMission,
    MissionCommand,
    Request,
    RunCheck,
    StartRecording,
    StopRecording,
)
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    CheckReply,
    ComponentStatus,
    Event,
    LandedStatus,
    MissionStatus,
    Outcome,
    PlatformRecording,
    RecordingStatus,
    Reply,
    WatchdogAction,
    WatchdogInfo,
)

from ..engine.events import CHECKS, Check, CheckName, made
from .fields import Classes, Shape, text

# --- statuses ---------------------------------------------------------------------------------------------------------


CHECK_ROW = Shape(Check, "Check", badness=lambda row: int(row.verdict))
COMPONENT = Shape(
    ComponentStatus,
    "ComponentState",
    needed={"name": "the name of a component"},
    badness=lambda component: int(component.code),
)
PLATFORM = Shape(
    PlatformRecording,
    "PlatformRecording",
    named={"written_bytes": "bytes"},
    badness=lambda platform: not platform.growing,
)
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
        more = {"publisher": text(publisher)} if self._has_publisher else {}
        return made(self.event, t_ns=t_ns, age_ns=age_ns, **self.shape.read(message, t_ns - age_ns), **more)

    def left_out(self, message: Any) -> Dict[str, int]:
        """Return how many entries of each list of a message are not in its event, where the list is too long."""
        return self.shape.left_out(message) if self.shape.lists else {}

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
_SEQUENCES: Mapping[str, str] = {
    "gps": "gps_sequence",
    "imu": "sensors_sequence",
    "magnetometer": "sensors_sequence",
    "barometer": "sensors_sequence",
}
_HEALTHY: Tuple[Optional[bool], ...] = (None, True, False)
"""SENSOR_UNKNOWN, SENSOR_HEALTHY, SENSOR_FAILED."""


class Health(NamedTuple):
    """What a message says of the autopilot's sensors.

    Args:
        healthy: by name; None: it does not know.
        link_age_s: time since the vehicle was heard; NaN: it never was.
        sequences: by name, number of the autopilot's own report that it repeats; 0: not told, as in a status of before.
    """

    healthy: Dict[str, Optional[bool]]
    link_age_s: float
    sequences: Dict[str, int]


def health_fields(
    healthy: Optional[Mapping[str, Optional[bool]]],
    measured: Optional[Mapping[str, Optional[float]]] = None,
    sequences: Optional[Mapping[str, int]] = None,
) -> Dict[str, Any]:
    """Return the fields of the message that say it; what is None or not there is unknown."""
    values = {name: (measured or {}).get(name) for name in MEASURED}
    return {
        **{name: _HEALTHY.index((healthy or {}).get(name)) for name in HEALTH},
        **{name: nan if value is None else value for name, value in values.items()},
        **{field: (sequences or {}).get(field, 0) for field in _SEQUENCES.values()},
    }


def health_of(message: Any) -> Health:
    """Return what a message says of the autopilot's sensors."""
    values = {name: int(getattr(message, name, 0)) for name in HEALTH}
    healthy = {name: _HEALTHY[value] if 0 <= value < len(_HEALTHY) else None for name, value in values.items()}
    sequences = {name: int(getattr(message, field, 0)) for name, field in _SEQUENCES.items()}
    return Health(healthy, float(getattr(message, "link_age", 0.0)), sequences)


# --- services ---------------------------------------------------------------------------------------------------------


_NOT_ASKED = ("id", "limit_ns", "check")
_NOT_ANSWERED = ("t_ns", "command_id", "check", "outcome")


@dataclass(frozen=True)
class Service:
    """One row.

    Args:
        name: its default name; the first part is the peer that offers it.
        type: name of its class of services.
        request: the command that it carries out.
        check: the check that it makes; None: it is none.
        ok: the field of the answer that says yes.
        answered: fields of the reply that are in the answer, besides `ok`.
        numbers: fields of the answer that people read: the first row of the check in a unit; without one: unknown.
        optional: where peers of another stack have nobody who makes the check, it passes with a warning; else nothing
            takes off there.
    """

    name: str
    type: str
    request: Type[Request]
    check: Optional[CheckName] = None
    ok: str = "accepted"
    answered: Tuple[str, ...] = ("message",)
    numbers: Mapping[str, str] = field(default_factory=dict)
    optional: bool = False

    @property
    def peer(self) -> str:
        """The peer that offers it."""
        return peer_of(self.name)

    @property
    def _asked(self) -> Optional[Tuple[str, ...]]:
        """The fields of the command that are in the request; None: all."""
        return None if self.check is None else CHECKS[self.check].asks

    def ask(self, command: Request, classes: Classes) -> Dict[str, Any]:
        """Return the fields of the request for a command."""
        if self._asked == ():
            return {}
        return _ASKED[self.request].write(command, 0, classes, *(self._asked or ()))

    def command(self, request: Any, number: int, limit_ns: int) -> Request:
        """Return the command that a request is, with an id and a limit that are not in it."""
        asked = {} if self._asked == () else _ASKED[self.request].read(request, 0, *(self._asked or ()))
        fixed = {} if self.check is None else {"check": self.check}
        return self.request(id=number, limit_ns=limit_ns, **fixed, **asked)

    def reply(self, answer: Any, number: int, t_ns: int) -> Union[Reply, CheckReply]:
        """Return the event that an answer is.

        Raises:
            InvalidMessageError: A field holds what cannot be.
        """
        ok, said = bool(getattr(answer, self.ok)), _ANSWERED.read(answer, t_ns, *self.answered)
        left_out = _ANSWERED.left_out(answer)
        if left_out:
            said["message"] = text(f"{said.get('message', '')} ({_left_out_words(answer, left_out)})".strip())
        if self.check is None:
            outcome = Outcome.ACCEPTED if ok else Outcome.REFUSED
            return Reply(t_ns=t_ns, command_id=number, outcome=outcome, **said)
        return CheckReply(t_ns=t_ns, command_id=number, check=self.check, outcome=Outcome.ACCEPTED, ok=ok, **said)

    def answer(self, reply: Union[Reply, CheckReply], now_ns: int, classes: Classes) -> Dict[str, Any]:
        """Return the fields of the answer for a reply."""
        rows = reply.checks if isinstance(reply, CheckReply) else ()
        ok = reply.ok if isinstance(reply, CheckReply) else reply.outcome is Outcome.ACCEPTED
        numbers = {
            name: next((row.value for row in rows if row.unit == unit and row.value is not None), nan)
            for name, unit in self.numbers.items()
        }
        return {self.ok: ok, **_ANSWERED.write(reply, now_ns, classes, *self.answered), **numbers}


_ASKED: Mapping[Type[Request], Shape[Any]] = {
    kind: Shape(kind, "", without=_NOT_ASKED, named={"action": "command"})
    for kind in (RunCheck, LoadMission, MissionCommand, StartRecording, StopRecording, AutopilotLand, AutopilotDisarm)
}
_ANSWERED = Shape(CheckReply, "", without=_NOT_ANSWERED, parts=(CHECK_ROW, COMPONENT))


def _left_out_words(answer: Any, left_out: Mapping[str, int]) -> str:
    return ", ".join(f"{count} of {len(getattr(answer, name))} {name} are left out" for name, count in left_out.items())


_ROWS = ("checks",)
_HEIGHT, _TILT = {"distance": "m"}, {"tilt": "rad"}
_FIXING = ("checks", "fixable", "being_fixed", "until_ns", "components", "message")

_BATTERY = {"fraction": "fraction", "voltage": "V"}
_CHECKS: Tuple[Service, ...] = (
    Service("watchdog/start", "StartWatchdog", RunCheck, CheckName.WATCHDOG, "ready", _FIXING),
    Service("autopilot/check_battery", "CheckBattery", RunCheck, CheckName.BATTERY, "ok", _ROWS, _BATTERY),
    Service("autopilot/check", "CheckAutopilot", RunCheck, CheckName.AUTOPILOT, "ok", _ROWS),
    Service("landing_detection/check", "CheckLanded", RunCheck, CheckName.ON_GROUND, "on_ground", _ROWS, _HEIGHT),
    Service("state_estimation/check", "CheckState", RunCheck, CheckName.STATE_ESTIMATION, "valid", _ROWS, _TILT),
)
_OTHERS: Tuple[Service, ...] = (
    Service("mission_planner/load", "LoadMission", LoadMission, numbers={"estimated_duration": ""}),
    Service("mission_planner/command", "MissionCommand", MissionCommand),
    Service("data_recorder/start", "StartRecording", StartRecording),
    Service("data_recorder/stop", "StopRecording", StopRecording),
    Service("autopilot/land", "Trigger", AutopilotLand, ok="success"),
    Service("autopilot/disarm", "Trigger", AutopilotDisarm, ok="success"),
)

SERVICES: Mapping[str, Service] = {row.name: row for row in (*_CHECKS, *_OTHERS)}
"""By their names."""

PEERS = ("watchdog", "landing_detection", "state_estimation", "autopilot", "mission_planner", "data_recorder")
CHECK_SERVICES: Mapping[CheckName, Service] = {row.check: row for row in _CHECKS if row.check is not None}
_BY_REQUEST: Mapping[Type[Command], Service] = {row.request: row for row in _OTHERS}


def peer_of(service: str) -> str:
    """Return the peer that offers a service: the first part of its name."""
    return service.split("/", 1)[0]


def service_of(command: Command) -> Optional[Service]:
    """Return the service that carries out a command; None for what is not a request."""
    return CHECK_SERVICES[command.check] if isinstance(command, RunCheck) else _BY_REQUEST.get(type(command))
