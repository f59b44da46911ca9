"""The rules: everything that a configuration can say to the engine. Two rule sets make two engines, nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Tuple

from .severity import ComponentRule, Verb

__all__ = ["LOSSES", "Limits", "Loss", "Rules"]

_S = 1_000_000_000


@dataclass(frozen=True)
class Limits:
    """Every limit of the engine, in nanoseconds, metres, metres per second and fractions. Defaults as shipped.

    autonomy.yaml has each of them, in seconds (`_s`) where it is `_ns` here.
    """

    check_reply_limit_ns: int = 3 * _S
    watchdog_startup_time_ns: int = 10 * _S
    preflight_fix_limit_ns: int = 60 * _S
    preflight_fix_poll_ns: int = 1 * _S
    preflight_rounds_limit: int = 5
    check_max_age_ns: int = 10 * _S
    ready_limit_ns: int = 60 * _S
    recording_lead_ns: int = 3 * _S
    recording_start_limit_ns: int = 15 * _S
    load_limit_ns: int = 10 * _S
    arm_limit_ns: int = 10 * _S
    lift_off_limit_ns: int = 10 * _S
    takeoff_limit_ns: int = 30 * _S
    takeoff_height_m: float = 1.0
    cancel_limit_ns: int = 10 * _S
    command_reply_limit_ns: int = 1 * _S
    hold_confirm_limit_ns: int = 3 * _S
    hold_repeat_after_ns: int = 3 * _S // 2
    hold_speed_m_s: float = 0.5
    resume_confirm_limit_ns: int = 5 * _S
    user_hold_limit_ns: int = 120 * _S
    unlisted_wait_limit_ns: int = 15 * _S
    land_repeat_period_ns: int = _S // 2
    land_second_route_after_ns: int = 3 * _S
    land_alarm_after_ns: int = 6 * _S
    land_limit_ns: int = 120 * _S
    descent_speed_m_s: float = 0.2
    descent_time_ns: int = 1 * _S
    landing_height_m: float = 3.0
    ground_disarm_after_ns: int = 4 * _S
    ground_disarm_period_ns: int = 2 * _S
    flight_end_confirm_ns: int = _S // 2
    confirm_limit_ns: int = 10 * _S
    pilot_confirm_ns: int = 3 * _S // 10
    data_cleanup_limit_ns: int = 1800 * _S
    watchdog_heartbeat_limit_ns: int = 6 * _S // 10
    planner_status_limit_ns: int = 1 * _S
    autopilot_status_limit_ns: int = 1 * _S
    autopilot_link_limit_ns: int = 3 * _S
    position_age_limit_ns: int = 10 * _S
    recorder_status_limit_ns: int = 5 * _S
    landing_detection_limit_ns: int = 1 * _S
    status_max_age_ns: int = 1 * _S
    clock_tolerance_ns: int = _S // 5
    clock_stall_limit_ns: int = 1 * _S
    battery_age_limit_ns: int = 10 * _S
    battery_critical_fraction: float = 0.15
    battery_reserve_fraction: float = 0.2
    max_flight_time_ns: int = 900 * _S
    max_height_m: float = 30.0
    max_distance_m: float = 100.0

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not value > 0:
                raise ValueError(f"{entry.name} is {value}, must be above 0")

    def is_present(self, age_ns: int) -> bool:
        """Return True when a status that is so old on arrival, by its own stamp, is of the present."""
        return -self.clock_tolerance_ns <= age_ns <= self.status_max_age_ns


@dataclass(frozen=True)
class Loss:
    """One row of the table of what else can be lost in flight.

    Args:
        name: of the loss.
        verb: what is done about it.
        both_routes: the landing is sent to the planner and to the autopilot at once.
        alarm: the pilot is alarmed at once.
        words: for the user and the documentation.
        peer: whose silence it is; where its clock is the reason, that is said.
    """

    name: str
    verb: Verb
    both_routes: bool
    alarm: bool
    words: str
    peer: str = ""


LOSSES: Tuple[Loss, ...] = (
    Loss("watchdog_heartbeat", Verb.LAND, False, False, "the watchdog's heartbeat is lost", "watchdog"),
    Loss("planner_status", Verb.LAND, True, False, "the mission planner's status is lost", "planner"),
    Loss("planner_failed", Verb.LAND, True, False, "the mission planner says that it failed"),
    Loss("autopilot_status", Verb.LAND, True, True, "the autopilot's status is lost", "autopilot"),
    Loss("clock", Verb.LAND, True, False, "the clock that decides stands still (/clock)"),
    Loss("battery_unknown", Verb.LAND, False, False, "the battery level is unknown for too long"),
    Loss("battery_critical", Verb.LAND, False, False, "the battery is critical"),
    Loss("flight_time", Verb.LAND, False, False, "the maximum flight time is reached"),
    Loss("height", Verb.LAND, False, False, "the height limit is exceeded"),
    Loss("distance", Verb.LAND, False, False, "the distance limit is exceeded"),
    Loss(
        "position_unknown", Verb.CONTINUE, False, False, "height or position is unknown: their limits cannot be checked"
    ),
    Loss("recorder_dead", Verb.CONTINUE, False, False, "the recorder is silent or does not record", "recorder"),
    Loss("landing_detection", Verb.CONTINUE, False, False, "the landing detection is silent", "landing detection"),
)


@dataclass(frozen=True)
class Rules:
    """All that a configuration says to the engine.

    Args:
        components: the decision table.
        limits: every limit.
        require_go: READY waits for the operator's go.
    """

    components: Tuple[ComponentRule, ...] = ()
    limits: Limits = field(default_factory=Limits)
    require_go: bool = False

    def __post_init__(self) -> None:
        names = [rule.name for rule in self.components]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"component {name} is listed twice")
