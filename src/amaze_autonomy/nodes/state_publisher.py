"""Publishes ~state: the engine's report as a message, latched."""

from __future__ import annotations

import rospy

from amaze_autonomy import msg
from amaze_autonomy.engine.report import report
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState

from . import outgoing
from .clock import Clock

__all__ = ["StatePublisher"]


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
        message = outgoing.autonomy_state(report(state, self._rules), self._clock.now_ns(), self._clock.ros_ns())
        self._publisher.publish(message)
