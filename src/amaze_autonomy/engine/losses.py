"""When is something else lost in flight: one predicate for each row of the table `rules.LOSSES`.

Each returns what it looked at when the thing is lost, else None. Comparisons are written so that unknown does not pass.
"""

from __future__ import annotations

from math import sqrt
from typing import Callable, Mapping, Optional, Tuple

from .absorb import proves_recording
from .commands import Value
from .events import MissionPhase
from .timers import max_flight_time_ns, passed
from .turn import Turn

__all__ = ["PREDICATES"]

Values = Tuple[Value, ...]
_NS = 1e9


def _age(turn: Turn, name: str, seen_ns: Optional[int], limit_ns: int) -> Values:
    since = seen_ns if seen_ns is not None else turn.state.flight_started_ns or 0
    return (Value(name, round((turn.now - since) / _NS, 3), limit_ns / _NS, "s"),)


def _silent(timer: str, field: str, limit: str, words: str) -> Callable[[Turn], Optional[Values]]:
    def predicate(turn: Turn) -> Optional[Values]:
        if not passed(timer, turn.state, turn.rules, turn.now):
            return None
        return _age(turn, words, getattr(turn.state, field), getattr(turn.limits, limit))

    return predicate


def _clock(turn: Turn) -> Optional[Values]:
    stalled_s, limit_s = turn.state.clock_stalled_s, turn.limits.clock_stall_limit_ns / _NS
    return (Value("the clock stands for", stalled_s, limit_s, "s"),) if stalled_s > limit_s else None


def _planner_failed(turn: Turn) -> Optional[Values]:
    planner = turn.state.planner
    if planner is None or planner.phase is not MissionPhase.FAILED:
        return None
    return (Value("planner phase", "FAILED"), Value("planner says", planner.message))


def _autopilot_status(turn: Turn) -> Optional[Values]:
    state, limits = turn.state, turn.limits
    if passed("autopilot_status_limit", state, turn.rules, turn.now):
        return _age(turn, "age of the autopilot's status", state.autopilot_ns, limits.autopilot_status_limit_ns)
    status = state.autopilot
    if status is not None and (
        status.link_age_s is None or passed("autopilot_link_limit", state, turn.rules, turn.now)
    ):
        age_s = None if status.link_age_s is None else status.link_age_s + (turn.now - (state.autopilot_ns or 0)) / _NS
        shown = None if age_s is None else round(age_s, 3)
        return (Value("age of the autopilot's link", shown, limits.autopilot_link_limit_ns / _NS, "s"),)
    return None


def _battery_critical(turn: Turn) -> Optional[Values]:
    """Take the level, or the autopilot's word: ArduPilot's level ignores the voltage."""
    status, limit = turn.state.autopilot, turn.limits.battery_critical_fraction
    if status is None:
        return None
    if status.battery_fraction is not None and status.battery_fraction <= limit:
        return (Value("battery fraction", status.battery_fraction, limit, "fraction"),)
    return (Value("reason", "the autopilot says that the battery is critical"),) if status.battery_critical else None


def _flight_time(turn: Turn) -> Optional[Values]:
    if not passed("flight_time", turn.state, turn.rules, turn.now):
        return None
    return _age(turn, "flight time", None, max_flight_time_ns(turn.state, turn.rules))


def _height(turn: Turn) -> Optional[Values]:
    status, mission = turn.vehicle(), turn.state.mission
    limit = turn.limits.max_height_m
    if mission is not None and mission.max_height_m is not None:
        limit = mission.max_height_m
    if status is None or status.height_m is None or status.height_m <= limit:
        return None
    return (Value("height", status.height_m, limit, "m"),)


def _distance(turn: Turn) -> Optional[Values]:
    status, mission = turn.vehicle(), turn.state.mission
    limit = turn.limits.max_distance_m
    if mission is not None and mission.max_distance_m is not None:
        limit = mission.max_distance_m
    if status is None or status.position_x_m is None or status.position_y_m is None:
        return None
    x_m, y_m = status.position_x_m, status.position_y_m
    distance = sqrt(x_m * x_m + y_m * y_m)  # hypot rounds differently on Python 3.8 and 3.11
    return None if distance <= limit else (Value("distance", round(distance, 3), limit, "m"),)


def _recorder_dead(turn: Turn) -> Optional[Values]:
    state = turn.state
    if not state.recording_asked:
        return None
    if passed("recorder_status_limit", state, turn.rules, turn.now):
        return _age(turn, "age of the recorder's status", state.recorder_ns, turn.limits.recorder_status_limit_ns)
    if state.recorder is None or proves_recording(state.recorder):
        return None
    still = ", ".join(p.platform for p in state.recorder.platforms if not p.growing)
    return (Value("recorder phase", state.recorder.phase.name, "RECORDING"), Value("files do not grow on", still))


PREDICATES: Mapping[str, Callable[[Turn], Optional[Values]]] = {
    "watchdog_heartbeat": _silent(
        "watchdog_heartbeat_limit", "heartbeat_ns", "watchdog_heartbeat_limit_ns", "age of the watchdog's heartbeat"
    ),
    "planner_status": _silent(
        "planner_status_limit", "planner_ns", "planner_status_limit_ns", "age of the planner's status"
    ),
    "planner_failed": _planner_failed,
    "clock": _clock,
    "autopilot_status": _autopilot_status,
    "battery_unknown": _silent("battery_age_limit", "battery_ns", "battery_age_limit_ns", "age of the battery level"),
    "battery_critical": _battery_critical,
    "flight_time": _flight_time,
    "height": _height,
    "distance": _distance,
    "position_unknown": _silent("position_age_limit", "position_ns", "position_age_limit_ns", "age of the position"),
    "recorder_dead": _recorder_dead,
    "landing_detection": _silent(
        "landing_detection_limit", "landing_ns", "landing_detection_limit_ns", "age of the landing detection"
    ),
}
