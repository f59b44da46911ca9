"""Messages and service answers of the peers -> events of the engine.

Each function takes the message, the time of its arrival on the deciding clock, and ROS time of its arrival; it raises
`InvalidMessageError` naming the field when the message holds what cannot be. Unknown (NaN) becomes None in the events.
"""

from __future__ import annotations

from enum import Enum
from math import isfinite
from typing import Any, Dict, Optional, Tuple, Type, TypeVar

from amaze_autonomy.engine import events
from amaze_autonomy.engine.checks import Check, CheckName, Verdict
from amaze_autonomy.engine.events import ComponentStatus, Outcome
from amaze_autonomy.engine.severity import Code, Restart

from .errors import InvalidMessageError

__all__ = [
    "age_of",
    "autopilot_status",
    "check_answer",
    "check_row",
    "component",
    "landed_status",
    "mission_status",
    "recording_status",
    "watchdog_action",
    "watchdog_info",
]

E = TypeVar("E", bound=Enum)
_FAR_S = 1e9  # further away than this is nonsense, not a time


def _by_value(kind: Type[E]) -> Dict[int, E]:
    return {int(member.value): member for member in kind}


_CODES = _by_value(Code)
_MISSION_PHASES = _by_value(events.MissionPhase)
_RECORDING_PHASES = _by_value(events.RecordingPhase)
_VEHICLE_LANDED = _by_value(events.VehicleLanded)
_LANDED = _by_value(events.Landed)
_RESTARTS = {0: Restart.NONE, 1: Restart.TRYING, 2: Restart.GIVEN_UP}
_VERDICTS = {1: Verdict.PASS, 2: Verdict.WARN, 3: Verdict.FAIL, 4: Verdict.UNKNOWN}


def _look_up(table: Dict[int, E], field: str, value: int) -> E:
    found = table.get(value)
    if found is None:
        raise InvalidMessageError(field, value, f"one of {', '.join(map(str, table))}")
    return found


def age_of(header: Any, ros_ns: int) -> int:
    """Return how old a header says that its message is."""
    return ros_ns - int(header.stamp.secs) * 1_000_000_000 - int(header.stamp.nsecs)


def _until_ns(seconds: float, from_ns: int) -> Optional[int]:
    if not isfinite(seconds) or abs(seconds) > _FAR_S:
        return None
    return from_ns + round(seconds * 1e9)


def component(msg: Any, from_ns: int, where: str = "components") -> ComponentStatus:
    """Read one ComponentState; `from_ns` is the time on the deciding clock that its `until` counts from."""
    if not msg.name:
        raise InvalidMessageError(f"{where}.name", msg.name, "the name of a component")
    return ComponentStatus(
        name=msg.name,
        code=_look_up(_CODES, f"{where}.code", msg.code),
        restart=_look_up(_RESTARTS, f"{where}.restart", msg.restart),
        until_ns=_until_ns(msg.until, from_ns),
        reason=msg.reason,
    )


def watchdog_action(msg: Any, t_ns: int, ros_ns: int) -> events.WatchdogAction:
    """Read a WatchdogAction."""
    age_ns = age_of(msg.header, ros_ns)
    return events.WatchdogAction(
        t_ns=t_ns,
        sequence=msg.sequence,
        loop_counter=msg.loop_counter,
        code=_look_up(_CODES, "code", msg.code),
        latest_component=msg.latest_component,
        components=tuple([component(each, t_ns - age_ns) for each in msg.components]),
        publisher=(getattr(msg, "_connection_header", None) or {}).get("callerid", ""),
        age_ns=age_ns,
    )


def watchdog_info(msg: Any, t_ns: int, ros_ns: int) -> events.WatchdogInfo:
    """Read a WatchdogInfo."""
    age_ns = age_of(msg.header, ros_ns)
    return events.WatchdogInfo(
        t_ns=t_ns,
        sequence=msg.sequence,
        changed=tuple(msg.changed),
        components=tuple([component(each, t_ns - age_ns) for each in msg.components]),
        age_ns=age_ns,
    )


def mission_status(msg: Any, t_ns: int, ros_ns: int) -> events.MissionStatus:
    """Read a MissionStatus."""
    return events.MissionStatus(
        t_ns=t_ns,
        session_id=msg.session_id,
        mission_id=msg.mission_id,
        phase=_look_up(_MISSION_PHASES, "phase", msg.phase),
        waypoint=msg.waypoint,
        waypoints=msg.waypoints,
        file_index=msg.file_index,
        repetition=msg.repetition,
        distance_left_m=msg.distance_left,
        time_left_s=msg.time_left,
        message=msg.message,
        age_ns=age_of(msg.header, ros_ns),
    )


def recording_status(msg: Any, t_ns: int, ros_ns: int) -> events.RecordingStatus:
    """Read a RecordingStatus."""
    return events.RecordingStatus(
        t_ns=t_ns,
        session_id=msg.session_id,
        phase=_look_up(_RECORDING_PHASES, "phase", msg.phase),
        progress=msg.progress,
        platforms=tuple([_platform(each) for each in msg.platforms]),
        location=msg.location,
        message=msg.message,
        age_ns=age_of(msg.header, ros_ns),
    )


def _platform(msg: Any) -> events.PlatformRecording:
    return events.PlatformRecording(
        platform=msg.platform,
        growing=msg.growing,
        written_bytes=msg.bytes,
        byte_rate=msg.byte_rate,
        free_fraction=msg.free_fraction,
        location=msg.location,
        message=msg.message,
    )


def autopilot_status(msg: Any, t_ns: int, ros_ns: int) -> events.AutopilotStatus:
    """Read an AutopilotStatus; what its validity flags call invalid is unknown."""
    return events.AutopilotStatus(
        t_ns=t_ns,
        armed=msg.armed if msg.armed_known else None,
        landed=_look_up(_VEHICLE_LANDED, "landed", msg.landed),
        mode=msg.mode,
        pilot_in_control=msg.pilot_in_control,
        failsafe=msg.failsafe,
        link_age_s=msg.link_age,
        height_m=msg.height if msg.height_valid else None,
        position_x_m=msg.position_x if msg.position_valid else None,
        position_y_m=msg.position_y if msg.position_valid else None,
        vertical_speed_m_s=msg.vertical_speed,
        horizontal_speed_m_s=msg.horizontal_speed,
        battery_fraction=msg.battery_fraction,
        battery_voltage_v=msg.battery_voltage,
        battery_age_s=msg.battery_age,
        battery_critical=msg.battery_critical,
        age_ns=age_of(msg.header, ros_ns),
    )


def landed_status(msg: Any, t_ns: int, ros_ns: int) -> events.LandedStatus:
    """Read a Landed."""
    return events.LandedStatus(
        t_ns=t_ns,
        landed=_look_up(_LANDED, "landed", msg.landed),
        distance_m=msg.distance,
        reason=msg.reason,
        age_ns=age_of(msg.header, ros_ns),
    )


def check_row(msg: Any) -> Check:
    """Read one row of the pre-flight table."""
    return Check(
        name=msg.name,
        verdict=_look_up(_VERDICTS, "checks.verdict", msg.verdict),
        value=msg.value,
        limit=msg.limit,
        unit=msg.unit,
        age_s=msg.age,
        advice=msg.advice,
        heals=msg.heals,
    )


_OK_FIELD = {
    CheckName.WATCHDOG: "ready",
    CheckName.BATTERY: "ok",
    CheckName.AUTOPILOT: "ok",
    CheckName.ON_GROUND: "on_ground",
    CheckName.STATE_ESTIMATION: "valid",
}


def check_answer(response: Any, check: CheckName, command_id: int, t_ns: int) -> events.CheckReply:
    """Read the answer of any of the five checks."""
    rows: Tuple[Check, ...] = tuple([check_row(row) for row in response.checks])
    ok = bool(getattr(response, _OK_FIELD[check]))
    if check is not CheckName.WATCHDOG:
        return events.CheckReply(
            t_ns=t_ns, command_id=command_id, check=check, outcome=Outcome.ACCEPTED, ok=ok, checks=rows
        )
    return events.CheckReply(
        t_ns=t_ns,
        command_id=command_id,
        check=check,
        outcome=Outcome.ACCEPTED,
        ok=ok,
        checks=rows,
        fixable=response.fixable,
        being_fixed=response.being_fixed,
        until_ns=_until_ns(response.until, t_ns),
        components=tuple([component(each, t_ns) for each in response.components]),
        message=response.message,
    )
