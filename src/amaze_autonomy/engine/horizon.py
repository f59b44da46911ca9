"""Until when no comparison with the time comes out otherwise than before, for states that differ by quiet events alone.

Of all that ends some day, most ends at a time that no quiet event changes. These ends are collected once for a settled
state; only those that wait for the next word of a peer (`MOVING`, `_STAMPS`) are looked up again.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Iterator, List, Tuple

from .rules import Rules
from .state import EngineState
from .timers import TIMERS, check_limit_ns

__all__ = ["MOVING", "Horizon", "horizon_ns"]

_NEVER_NS = 1 << 62
_STAMPS: Tuple[Tuple[str, str], ...] = (
    ("heartbeat_ns", "watchdog_heartbeat_limit_ns"),
    ("planner_ns", "planner_status_limit_ns"),
    ("recorder_ns", "recorder_status_limit_ns"),
    ("autopilot_ns", "autopilot_status_limit_ns"),
    ("landing_ns", "landing_detection_limit_ns"),
    ("battery_ns", "battery_age_limit_ns"),
    ("position_ns", "position_age_limit_ns"),
)
MOVING = frozenset(
    (
        *("watchdog_heartbeat_limit", "planner_status_limit", "autopilot_status_limit", "autopilot_link_limit"),
        *("battery_age_limit", "position_age_limit", "recorder_status_limit", "landing_detection_limit"),
        "recorder_silent",
    )
)
"""Timers whose end a quiet event moves on."""
_MOVING = tuple(timer.when for timer in TIMERS if timer.name in MOVING)
_FIXED = tuple(timer.when for timer in TIMERS if timer.name not in MOVING)


class Horizon:
    """The horizon of a settled state, and of all that quiet events make of it.

    Args:
        state: the settled one.
        rules: the configuration.
    """

    def __init__(self, state: EngineState, rules: Rules) -> None:
        self._rules = rules
        self._limits = tuple((stamp, getattr(rules.limits, limit) + 1) for stamp, limit in _STAMPS)
        self._fixed: List[int] = sorted(_fixed_ends(state, rules))

    def after(self, state: EngineState) -> int:
        """Return the first time after the state's own at which a comparison with the time can come out otherwise."""
        fixed, now = self._fixed, state.t_ns
        place = bisect_right(fixed, now)
        soonest = fixed[place] if place < len(fixed) else _NEVER_NS
        fields = state.__dict__
        for stamp, limit in self._limits:
            since = fields[stamp]
            if since is not None and now < since + limit < soonest:
                soonest = since + limit
        for when in _MOVING:
            end = when(state, self._rules)
            if end is not None and now < end < soonest:
                soonest = end
        return soonest


def horizon_ns(state: EngineState, rules: Rules) -> int:
    """Return the horizon of any state."""
    return Horizon(state, rules).after(state)


def _fixed_ends(state: EngineState, rules: Rules) -> Iterator[int]:
    for when in _FIXED:
        end = when(state, rules)
        if end is not None:
            yield end
    for record in state.checks:
        yield record.asked_ns + check_limit_ns(state, rules, record.check)
    for failure in state.failures:
        if failure.deadline_ns is not None:
            yield failure.deadline_ns
