"""Events of the world and the engine's report -> messages and service answers. None becomes NaN."""

from __future__ import annotations

from math import nan
from typing import Any, Callable, Dict, Mapping, Optional, Sequence

import rospy

from amaze_autonomy import msg, srv
from amaze_autonomy.engine import events
from amaze_autonomy.engine.checks import Check, CheckName, Verdict
from amaze_autonomy.engine.commands import Level
from amaze_autonomy.engine.events import ComponentStatus
from amaze_autonomy.engine.report import Report
from amaze_autonomy.engine.severity import Restart
from amaze_autonomy.engine.state import Failure

__all__ = [
    "autonomy_state",
    "autopilot_status",
    "check_response",
    "check_row",
    "component",
    "landed_status",
    "mission_status",
    "number",
    "recording_status",
    "ros_time",
    "watchdog_action",
    "watchdog_info",
]

_RESTARTS = {Restart.NONE: 0, Restart.TRYING: 1, Restart.GIVEN_UP: 2}
_VERDICTS = {Verdict.PASS: 1, Verdict.WARN: 2, Verdict.FAIL: 3, Verdict.UNKNOWN: 4}
_SENSOR_HEALTH = {None: 0, True: 1, False: 2}
_HEALTH = ("gps", "imu", "magnetometer", "barometer", "rc", "prearm")
_MEASURED = ("battery_cell_voltage", "battery_current", "clock_offset")


def number(value: Optional[float]) -> float:
    """Return the value, or NaN for None."""
    return nan if value is None else value


def ros_time(ns: int) -> rospy.Time:
    """Return nanoseconds as a ROS time."""
    return rospy.Time(ns // 1_000_000_000, ns % 1_000_000_000)


def component(status: ComponentStatus, now_ns: int) -> msg.ComponentState:
    """Write one ComponentState; its `until` counts from `now_ns`, on the deciding clock."""
    return msg.ComponentState(
        name=status.name,
        code=int(status.code),
        restart=_RESTARTS[status.restart],
        until=nan if status.until_ns is None else (status.until_ns - now_ns) * 1e-9,
        reason=status.reason,
    )


def watchdog_action(event: events.WatchdogAction, ros_ns: int) -> msg.WatchdogAction:
    """Write a WatchdogAction."""
    message = msg.WatchdogAction(
        sequence=event.sequence,
        loop_counter=event.loop_counter,
        code=int(event.code),
        latest_component=event.latest_component,
        components=[component(each, event.t_ns) for each in event.components],
    )
    return _stamped(message, event, ros_ns)


def watchdog_info(event: events.WatchdogInfo, ros_ns: int) -> msg.WatchdogInfo:
    """Write a WatchdogInfo."""
    message = msg.WatchdogInfo(
        sequence=event.sequence,
        changed=list(event.changed),
        components=[component(each, event.t_ns) for each in event.components],
    )
    return _stamped(message, event, ros_ns)


def mission_status(event: events.MissionStatus, ros_ns: int) -> msg.MissionStatus:
    """Write a MissionStatus."""
    message = msg.MissionStatus(
        session_id=event.session_id,
        mission_id=event.mission_id,
        phase=event.phase.value,
        waypoint=event.waypoint,
        waypoints=event.waypoints,
        file_index=event.file_index,
        repetition=event.repetition,
        distance_left=number(event.distance_left_m),
        time_left=number(event.time_left_s),
        message=event.message,
    )
    return _stamped(message, event, ros_ns)


def recording_status(event: events.RecordingStatus, ros_ns: int) -> msg.RecordingStatus:
    """Write a RecordingStatus."""
    message = msg.RecordingStatus(
        session_id=event.session_id,
        phase=event.phase.value,
        progress=number(event.progress),
        platforms=[_platform(each) for each in event.platforms],
        location=event.location,
        message=event.message,
        remaining=nan,
    )
    return _stamped(message, event, ros_ns)


def _platform(recording: events.PlatformRecording) -> msg.PlatformRecording:
    return msg.PlatformRecording(
        platform=recording.platform,
        growing=recording.growing,
        bytes=recording.written_bytes,
        byte_rate=number(recording.byte_rate),
        free_fraction=number(recording.free_fraction),
        location=recording.location,
        message=recording.message,
    )


def autopilot_status(
    event: events.AutopilotStatus,
    ros_ns: int,
    healthy: Optional[Mapping[str, Optional[bool]]] = None,
    measured: Optional[Mapping[str, Optional[float]]] = None,
) -> msg.AutopilotStatus:
    """Write an AutopilotStatus.

    Args:
        event: what the engine is told.
        ros_ns: now.
        healthy: of gps, imu, magnetometer, barometer, rc, prearm; None or not there: unknown.
        measured: battery_cell_voltage, battery_current, clock_offset; None or not there: unknown.
    """
    health = {name: _SENSOR_HEALTH[(healthy or {}).get(name)] for name in _HEALTH}
    values = {name: number((measured or {}).get(name)) for name in _MEASURED}
    message = msg.AutopilotStatus(
        link_age=number(event.link_age_s),
        armed_known=event.armed is not None,
        armed=bool(event.armed),
        landed=event.landed.value,
        mode=event.mode,
        pilot_in_control=event.pilot_in_control,
        failsafe=event.failsafe,
        height_valid=event.height_m is not None,
        height=number(event.height_m),
        position_valid=event.position_x_m is not None and event.position_y_m is not None,
        position_x=number(event.position_x_m),
        position_y=number(event.position_y_m),
        vertical_speed=number(event.vertical_speed_m_s),
        horizontal_speed=number(event.horizontal_speed_m_s),
        battery_fraction=number(event.battery_fraction),
        battery_voltage=number(event.battery_voltage_v),
        battery_age=number(event.battery_age_s),
        battery_critical=event.battery_critical,
        **health,
        **values,
    )
    return _stamped(message, event, ros_ns)


def landed_status(event: events.LandedStatus, ros_ns: int) -> msg.Landed:
    """Write a Landed."""
    message = msg.Landed(landed=event.landed.value, distance=number(event.distance_m), reason=event.reason)
    return _stamped(message, event, ros_ns)


def _stamped(message: Any, event: Any, ros_ns: int) -> Any:
    """Stamp a message with the time its event says that it was made."""
    message.header.stamp = ros_time(max(0, ros_ns - event.age_ns))
    return message


def check_row(row: Check) -> msg.Check:
    """Write one row of the pre-flight table."""
    return msg.Check(
        name=row.name,
        verdict=_VERDICTS[row.verdict],
        value=number(row.value),
        limit=number(row.limit),
        unit=row.unit,
        age=number(row.age_s),
        advice=row.advice,
        heals=row.heals,
    )


def _value(rows: Sequence[Check], unit: str) -> float:
    """Return the first value among the rows that is in a unit."""
    return next((number(row.value) for row in rows if row.unit == unit), nan)


def _watchdog_response(reply: events.CheckReply, now_ns: int) -> srv.StartWatchdogResponse:
    return srv.StartWatchdogResponse(
        ready=reply.ok,
        fixable=reply.fixable,
        being_fixed=reply.being_fixed,
        until=nan if reply.until_ns is None else (reply.until_ns - now_ns) * 1e-9,
        components=[component(each, now_ns) for each in reply.components],
        message=reply.message,
    )


def _battery_response(reply: events.CheckReply, _now_ns: int) -> srv.CheckBatteryResponse:
    return srv.CheckBatteryResponse(
        ok=reply.ok, fraction=_value(reply.checks, "fraction"), voltage=_value(reply.checks, "V")
    )


def _state_response(reply: events.CheckReply, _now_ns: int) -> srv.CheckStateResponse:
    response = srv.CheckStateResponse(valid=reply.ok, tilt=_value(reply.checks, "rad"))
    response.gravity.x = response.gravity.y = response.gravity.z = nan
    return response


_RESPONSES: Dict[CheckName, Callable[[events.CheckReply, int], Any]] = {
    CheckName.WATCHDOG: _watchdog_response,
    CheckName.BATTERY: _battery_response,
    CheckName.AUTOPILOT: lambda reply, _now_ns: srv.CheckAutopilotResponse(ok=reply.ok),
    CheckName.ON_GROUND: lambda reply, _now_ns: srv.CheckLandedResponse(
        on_ground=reply.ok, distance=_value(reply.checks, "m")
    ),
    CheckName.STATE_ESTIMATION: _state_response,
}


def check_response(reply: events.CheckReply, now_ns: int) -> Any:
    """Write the answer of a check service from what a peer of the world replied."""
    response = _RESPONSES[reply.check](reply, now_ns)
    response.checks = [check_row(row) for row in reply.checks]
    return response


#: Levels of DiagnosticStatus.
_MESSAGE_LEVELS = {Level.INFO: 0, Level.WARNING: 1, Level.ERROR: 2, Level.ALARM: 3}


def _pending(failure: Failure, now_ns: int) -> msg.PendingFailure:
    return msg.PendingFailure(
        name=failure.name,
        code=failure.code,
        verb=failure.verb.name.lower(),
        then="" if failure.then is None else failure.then.name.lower(),
        time_left=_left_s(failure.deadline_ns, now_ns),
        reason=failure.reason,
    )


def _left_s(deadline_ns: Optional[int], now_ns: int) -> float:
    return nan if deadline_ns is None else max(0.0, (deadline_ns - now_ns) * 1e-9)


def autonomy_state(report: Report, now_ns: int, ros_ns: int) -> msg.AutonomyState:
    """Write what a person is shown of the engine; `now_ns` is on the deciding clock."""
    message = msg.AutonomyState(
        state=report.state,
        phase=report.phase,
        session_id=report.session_id,
        mission_id=report.mission_id,
        mission_description=report.mission_description,
        file_index=report.file_index,
        files=report.files,
        repetition=report.repetition,
        repetitions=report.repetitions,
        in_flight=report.in_flight,
        checks=[check_row(row) for row in report.checks],
        failures=[_pending(failure, now_ns) for failure in report.failures],
        waiting_for=report.waiting_for,
        time_left=_left_s(report.deadline_ns, now_ns),
        message=report.message,
        message_level=_MESSAGE_LEVELS[Level(report.message_level)],
        advice=report.advice,
        user_commands=list(report.user_commands),
        waypoint=report.waypoint,
        waypoints=report.waypoints,
        recording_phase=report.recording_phase,
        recording_progress=number(report.recording_progress),
        data_location=report.data_location,
        result=report.result,
    )
    message.header.stamp = ros_time(ros_ns)
    return message
