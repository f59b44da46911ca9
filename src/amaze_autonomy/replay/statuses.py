"""Statuses of our own nodes that a recording carries, as events of the engine. Messages of msg/, fields as there."""

from __future__ import annotations

import hashlib
import sys
from enum import Enum
from functools import lru_cache
from math import isfinite, nan
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Type, TypeVar

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    ComponentStatus,
    Event,
    Landed,
    LandedStatus,
    MissionPhase,
    MissionStatus,
    PlatformRecording,
    RecordingPhase,
    RecordingStatus,
    VehicleLanded,
    WatchdogAction,
    WatchdogInfo,
    made,
)
from amaze_autonomy.interface.fields import text

from ..engine import events, rules
from ..engine.rules import Code, Restart
from ..journal import codec
from ..journal.codec import bundled, unbundled
from .errors import InvalidStatusError

__all__ = ["EVENT_OF", "FLAT", "Flat", "health_of", "sent_by", "status_rows", "taped_statuses"]


E = TypeVar("E", bound=Enum)
_S = 1_000_000_000
_RESTARTS = (Restart.NONE, Restart.TRYING, Restart.GIVEN_UP)
_HEALTH: Tuple[Optional[bool], ...] = (None, True, False)


def _enum(kind: Type[E], field: str, value: Any) -> E:
    members: Dict[int, E] = _members(kind)
    try:
        return members[int(value)]
    except (KeyError, ValueError):
        raise InvalidStatusError(f"{field} is {value!r}, must be one of {', '.join(map(str, members))}") from None


@lru_cache(maxsize=None)
def _members(kind: Any) -> Dict[int, Any]:
    return {member.value: member for member in kind}


_SENDER = "published_by"


def sent_by(message: Any, caller: str) -> Any:
    """Note on a message which node has published it; that is a fact of its connection, not of the message."""
    setattr(message, _SENDER, caller)
    return message


def _age_ns(message: Any, t_ns: int) -> int:
    stamp = message if message.__class__ is Flat else message.header.stamp
    return t_ns - (int(stamp.sec) * _S + int(stamp.nanosec))


def _component(message: Any, t_ns: int) -> ComponentStatus:
    until_s = float(message.until)
    restart = int(message.restart)
    if not 0 <= restart < len(_RESTARTS):
        raise InvalidStatusError(f"components.restart is {restart}, must be one of 0, 1, 2")
    return ComponentStatus(
        name=text(message.name),
        code=_enum(Code, "components.code", message.code),
        restart=_RESTARTS[restart],
        until_ns=t_ns + round(until_s * _S) if isfinite(until_s) else None,
        reason=text(message.reason),
    )


def _watchdog_action(message: Any, t_ns: int) -> Event:
    return made(
        WatchdogAction,
        t_ns=t_ns,
        sequence=int(message.sequence),
        loop_counter=int(message.loop_counter),
        code=_enum(Code, "code", message.code),
        latest_component=text(message.latest_component),
        components=tuple(_component(each, t_ns) for each in message.components),
        publisher=str(getattr(message, _SENDER, "")),
        age_ns=_age_ns(message, t_ns),
    )


def _watchdog_info(message: Any, t_ns: int) -> Event:
    return made(
        WatchdogInfo,
        t_ns=t_ns,
        sequence=int(message.sequence),
        changed=tuple(text(name) for name in message.changed),
        components=tuple(_component(each, t_ns) for each in message.components),
        age_ns=_age_ns(message, t_ns),
    )


def _mission_planner(message: Any, t_ns: int) -> Event:
    return made(
        MissionStatus,
        t_ns=t_ns,
        session_id=text(message.session_id),
        mission_id=text(message.mission_id),
        phase=_enum(MissionPhase, "phase", message.phase),
        waypoint=int(message.waypoint),
        waypoints=int(message.waypoints),
        file_index=int(message.file_index),
        repetition=int(message.repetition),
        distance_left_m=float(message.distance_left),
        time_left_s=float(message.time_left),
        message=text(message.message),
        age_ns=_age_ns(message, t_ns),
    )


def _autopilot(message: Any, t_ns: int) -> Event:
    placed = bool(message.position_valid)
    return made(
        AutopilotStatus,
        t_ns=t_ns,
        armed=bool(message.armed) if message.armed_known else None,
        landed=_enum(VehicleLanded, "landed", message.landed),
        mode=text(message.mode),
        pilot_in_control=bool(message.pilot_in_control),
        failsafe=bool(message.failsafe),
        link_age_s=float(message.link_age),
        height_m=float(message.height) if message.height_valid else None,
        position_x_m=float(message.position_x) if placed else None,
        position_y_m=float(message.position_y) if placed else None,
        vertical_speed_m_s=float(message.vertical_speed),
        horizontal_speed_m_s=float(getattr(message, "horizontal_speed", nan)),  # not in recordings of before
        battery_fraction=float(message.battery_fraction),
        battery_voltage_v=float(message.battery_voltage),
        battery_age_s=float(message.battery_age),
        battery_critical=bool(getattr(message, "battery_critical", False)),  # likewise
        age_ns=_age_ns(message, t_ns),
    )


def _landing_detection(message: Any, t_ns: int) -> Event:
    return made(
        LandedStatus,
        t_ns=t_ns,
        landed=_enum(Landed, "landed", message.landed),
        distance_m=float(message.distance),
        reason=text(message.reason),
        age_ns=_age_ns(message, t_ns),
    )


def _data_recorder(message: Any, t_ns: int) -> Event:
    return made(
        RecordingStatus,
        t_ns=t_ns,
        session_id=text(message.session_id),
        phase=_enum(RecordingPhase, "phase", message.phase),
        progress=float(message.progress),
        platforms=tuple(_platform(each) for each in message.platforms),
        location=text(message.location),
        message=text(message.message),
        lost=text(getattr(message, "lost", "")),  # not in recordings of before
        age_ns=_age_ns(message, t_ns),
    )


def _platform(message: Any) -> PlatformRecording:
    return made(
        PlatformRecording,
        platform=text(message.platform),
        growing=bool(message.growing),
        written_bytes=int(message.bytes),
        byte_rate=float(message.byte_rate),
        free_fraction=float(message.free_fraction),
        location=text(message.location),
        message=text(message.message),
    )


EVENT_OF: Mapping[str, Callable[[Any, int], Event]] = {
    "watchdog_action": _watchdog_action,
    "watchdog_info": _watchdog_info,
    "mission_planner": _mission_planner,
    "autopilot": _autopilot,
    "landing_detection": _landing_detection,
    "data_recorder": _data_recorder,
}
"""By the name of the status in a topic map: message and time of recording to event."""


_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
FLAT: Mapping[str, Tuple[str, ...]] = {
    "mission_planner": (
        *_STAMP,
        *("session_id", "mission_id", "phase", "waypoint", "waypoints", "file_index", "repetition"),
        *("distance_left", "time_left", "message"),
    ),
    "autopilot": (
        *_STAMP,
        *("armed", "armed_known", "landed", "mode", "pilot_in_control", "failsafe", "link_age"),
        *("height", "height_valid", "position_x", "position_y", "position_valid"),
        *("vertical_speed", "horizontal_speed"),
        *("battery_fraction", "battery_voltage", "battery_age", "battery_critical"),
    ),
    "landing_detection": (*_STAMP, "landed", "distance", "reason"),
}
"""Every field of a status that is looked at, for those that have no list in them: such are read as columns."""


class Flat:
    """A message by its fields alone, with the face of a whole one; the stamp is in the message itself."""

    def __init__(self, fields: Dict[str, Any]) -> None:
        self.__dict__.update(fields)

    @property
    def header(self) -> Flat:
        """The header, in which only the stamp is."""
        return self

    @property
    def stamp(self) -> Flat:
        """The stamp, `sec` and `nanosec`."""
        return self


def health_of(message: Any) -> Dict[str, Optional[bool]]:
    """Return what an AutopilotStatus says of the autopilot's sensors, by name; None: it does not know."""
    names = ("gps", "imu", "magnetometer", "barometer")
    values = {name: int(getattr(message, name)) for name in names}
    return {name: _HEALTH[value] if 0 <= value < len(_HEALTH) else None for name, value in values.items()}


# --- status tapes -----------------------------------------------------------------------------------------------------
# The recorded statuses of a bag as events, many at once: out of columns of their messages, and out of tapes.


_KIND = "statuses"
_CLASSES: Mapping[str, type] = {
    "watchdog_action": WatchdogAction,
    "watchdog_info": WatchdogInfo,
    "mission_planner": MissionStatus,
    "autopilot": AutopilotStatus,
    "landing_detection": LandedStatus,
    "data_recorder": RecordingStatus,
}


def taped_statuses(bag: Recording, topic: str, name: str) -> Optional[List[Event]]:
    """Return all statuses of a topic in the order of its entries, each with the session that was recorded.

    Returns:
        None without tapes, and when a message is damaged or holds what cannot be: then each is asked by itself.
    """
    tapes = bag.tapes
    if tapes is None or name not in _CLASSES:
        return None
    what = [topic, name, _code()]
    found = _unbundled(_CLASSES[name], tapes.text(_KIND, what))
    if found is not None and len(found) == len(bag.table(topic).t_ns):
        return found
    found = _read(bag, topic, name)
    if found is not None:
        tapes.keep_text(_KIND, what, bundled(found))
    return found


def status_rows(
    name: str, times: Sequence[int], rows: Sequence[Optional[Tuple[Any, ...]]], callers: Sequence[str]
) -> List[Optional[Event]]:
    """Return statuses out of their messages, or the columns `FLAT`; None for what must be asked for by itself."""
    make, names = EVENT_OF[name], [path.rpartition(".")[2] for path in FLAT.get(name, ())]
    found: List[Optional[Event]] = []
    for t_ns, row, caller in zip(times, rows, callers):
        try:
            whole = None if row is None else Flat(dict(zip(names, row))) if names else row[0]
            found.append(None if whole is None else make(sent_by(whole, caller), t_ns))
        except (InvalidStatusError, AttributeError, TypeError):  # of another type than the map says
            found.append(None)
    return found


def _unbundled(kind: type, text: Optional[str]) -> Optional[List[Event]]:
    try:
        return None if text is None else unbundled(kind, text)
    except ValueError:  # damaged: made anew
        return None


def _read(bag: Recording, topic: str, name: str) -> Optional[List[Event]]:
    make = EVENT_OF[name]
    try:
        return [
            make(sent_by(bag.message(entry), bag.caller(entry.connection)), entry.t_ns) for entry in bag.entries(topic)
        ]
    except (MessageError, InvalidStatusError, AttributeError, TypeError):
        return None


@lru_cache(maxsize=None)
def _code() -> str:
    """Return a digest of the code that makes the events: a tape of another version is another tape."""
    digest = hashlib.sha256()
    modules: Sequence[object] = (codec, events, codec, events, rules, sys.modules[__name__])
    for module in modules:
        digest.update(Path(str(getattr(module, "__file__", ""))).read_bytes())
    return digest.hexdigest()
