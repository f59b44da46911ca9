"""Publishes ~state: the engine's report as a message, latched."""

from __future__ import annotations

from math import nan
from typing import Optional

import rospy

from amaze_autonomy import msg
from amaze_autonomy.engine.commands import Level
from amaze_autonomy.engine.report import Report, report
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, Failure

from .clock import Clock
from .interface import check_row, number, ros_time

__all__ = ["StatePublisher", "state_message"]


class StatePublisher:
    """Writes AutonomyState.

    Args:
        rules: that the engine decides by.
        clock: for the time that is left.
    """

    def __init__(self, rules: Rules, clock: Clock) -> None:
        self._rules, self._clock = rules, clock
        self._publisher = rospy.Publisher("~state", msg.AutonomyState, latch=True, queue_size=10)

    def publish(self, state: EngineState) -> None:
        """Publish the report about a state."""
        message = state_message(report(state, self._rules), self._clock.now_ns(), self._clock.ros_ns())
        self._publisher.publish(message)


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


def state_message(report: Report, now_ns: int, ros_ns: int) -> msg.AutonomyState:
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
