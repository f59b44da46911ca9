"""The rules: all that a configuration can say to the engine, and the table of severities. Two rule sets, two engines.

A limit is one row of `Limits`: its unit is the end of its name, its default, its bounds and its words stand behind it.
`config/autonomy.yaml`, its schema and its reference in docs/ are made from these rows.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, fields
from typing import Any, Mapping, Optional, Tuple

# --- severity ---------------------------------------------------------------------------------------------------------
# Severities, codes, actions, and the two tables that connect them (DESIGN.md section 4).
#
# A component has a *severity*: how bad is it when it fails? The watchdog turns its health into a *code*: its
# condition now. The *action* says what is done about it. `SEVERITIES` is the whole of the rule; `action_of` reads it.


class Code(enum.IntEnum):
    """Condition of a component on the wire; the watchdog publishes the highest."""

    NOMINAL = 1
    NON_CRITICAL = 2
    INCONVENIENT = 4
    HOLD = 8
    ABORT = 16


class Severity(enum.Enum):
    """How bad the failure of a component is."""

    LOW = "low"
    MODERATE = "moderate"
    HIGH = "high"
    HIGHEST = "highest"


class Action(enum.IntEnum):
    """What is done about a failure. Ordered: the worst wins."""

    CONTINUE = 1
    WAIT = 2
    LAND = 3
    PILOT = 4


class Restart(enum.Enum):
    """What the watchdog does about a component that failed."""

    NONE = "none"
    TRYING = "trying"
    GIVEN_UP = "given_up"


@dataclass(frozen=True)
class SeverityRow:
    """One row of the severity table.

    Args:
        code: the watchdog's code when the component fails.
        code_given_up: its code once restarting has failed.
        action: what is done at first.
        fallback: what is done when a wait has ended without success; None when `action` does not wait.
    """

    code: Code
    code_given_up: Code
    action: Action
    fallback: Optional[Action]


SEVERITIES: Mapping[Severity, SeverityRow] = {
    Severity.LOW: SeverityRow(Code.NON_CRITICAL, Code.NON_CRITICAL, Action.CONTINUE, None),
    Severity.MODERATE: SeverityRow(Code.INCONVENIENT, Code.INCONVENIENT, Action.WAIT, Action.CONTINUE),
    Severity.HIGH: SeverityRow(Code.HOLD, Code.ABORT, Action.WAIT, Action.LAND),
    Severity.HIGHEST: SeverityRow(Code.ABORT, Code.ABORT, Action.LAND, None),
}


@dataclass(frozen=True)
class ComponentRule:
    """One row of the decision table: a component and what its failure means.

    Args:
        name: as in sensors.yaml and on the wire, e.g. "mission_camera".
        group: "px4" or "other"; components of the PX4 are never restarted.
        restart: the watchdog may restart it.
        severity: its severity, unless the mission names another.
        wait_limit_ns: how long a flight may wait for it, all its failures together.
    """

    name: str
    group: str
    restart: bool
    severity: Severity
    wait_limit_ns: int

    def __post_init__(self) -> None:
        if self.group == "px4" and self.restart:
            raise ValueError(
                f"{self.name}: a component of the PX4 is never restarted, the vehicle would be uncontrollable"
            )
        if self.wait_limit_ns < 0:
            raise ValueError(f"{self.name}: wait_limit_ns is {self.wait_limit_ns}, must not be negative")


def row_of_code(code: Code) -> Severity:
    """Return the severity that a component gets when nobody listed it: the row of its code."""
    return _ROW_OF_CODE[code]


_ROW_OF_CODE: Mapping[Code, Severity] = {
    Code.NOMINAL: Severity.LOW,
    Code.NON_CRITICAL: Severity.LOW,
    Code.INCONVENIENT: Severity.MODERATE,
    Code.HOLD: Severity.HIGH,
    Code.ABORT: Severity.HIGHEST,
}


def action_of(severity: Severity, code: Code) -> Optional[Action]:
    """Return what is done at first about a component of a severity at a code; None when nothing is wrong.

    1 clears; 2 is always `continue`; 4 and 8 take the row's action; 16 is always `land`.
    """
    if code == Code.NOMINAL:
        return None
    if code == Code.NON_CRITICAL:
        return Action.CONTINUE
    if code == Code.ABORT:
        return Action.LAND
    return SEVERITIES[severity].action


# --- rules ------------------------------------------------------------------------------------------------------------


_S = 1_000_000_000


@dataclass(frozen=True)
class LimitRow:
    """What is said of a limit: stands in the metadata of its field.

    Args:
        group: of autonomy.yaml in which it stands.
        about: what the group is about.
        most: largest value that is accepted, in the unit of the configuration; 1: fractions below it.
        least: smallest that is; 0: everything above it.
        words: what it is.
        reason: why it is there, or why it has this value.
    """

    group: str
    about: str
    most: float
    words: str
    reason: str
    least: float = 0.0


class _Group:
    """A group of limits; makes their fields."""

    def __init__(self, name: str, about: str) -> None:
        self.name, self.about = name, about

    def _field(self, default: float, most: float, words: str, reason: str, least: float = 0.0) -> Any:
        return field(default=default, metadata={"row": LimitRow(self.name, self.about, most, words, reason, least)})

    def time(self, default_s: float, most_s: float, words: str, reason: str) -> Any:
        """Return a time: in seconds here and in the configuration, in nanoseconds in the engine."""
        return self._field(round(default_s * _S), most_s, words, reason)

    def number(self, default: float, most: float, words: str, reason: str, least: float = 0.0) -> Any:
        """Return a number of the unit that its name ends with, or a fraction."""
        return self._field(default, most, words, reason, least)


_CHECKS = _Group("checks", "pre-flight checks")
_RECORDING = _Group("recording", "start and end of the recording")
_TAKEOFF = _Group("takeoff", "from the planner's confirmation to the mission")
_COMMANDS = _Group("commands", "commands in flight, holds")
_LANDING = _Group("landing", "landing, second route, alarm")
_FAILSAFE = _Group("failsafe", "silence, and what is unknown: from when on it counts")
_BATTERY = _Group("battery", "battery in flight and after it")
_FLIGHT = _Group("flight", "limits of every flight; a mission may set its own time, height and distance")


@dataclass(frozen=True)
class Limits:
    """Every limit of the engine, in nanoseconds, metres, metres per second, degrees and fractions. One row a line."""

    # fmt: off
    check_reply_limit_ns: int = _CHECKS.time(3, 60, "time in which a check must be answered", "a service call takes milliseconds; 3 s is a hung peer")
    watchdog_startup_time_ns: int = _CHECKS.time(10, 120, "how long the first call of the watchdog may wait for every component to come up", "cameras take several seconds to start")
    preflight_fix_limit_ns: int = _CHECKS.time(60, 3600, "time in which the watchdog may fix what failed before the user is asked", "longer than all attempts of one restart")
    preflight_fix_poll_ns: int = _CHECKS.time(1, 60, "pause between two questions to the watchdog while it fixes", "shows progress without flooding")
    preflight_rounds_limit: int = _CHECKS.number(5, 100, "how often the checks are run again by themselves before the user is asked", "a component that comes and goes must not keep the checks going for ever")
    check_max_age_ns: int = _CHECKS.time(10, 60, "how old a check may be at the takeoff", "what was true 10 s ago may not be true now")
    ready_limit_ns: int = _CHECKS.time(60, 3600, "how long Ready stands before the checks are run again", "an operator's go may come late")
    recording_lead_ns: int = _RECORDING.time(3, 600, "recording time before the takeoff", "state estimators need data at rest to start from")
    recording_start_limit_ns: int = _RECORDING.time(15, 600, "time in which both platforms must show growing files, lead included", "rosbag needs a second, a slow disk several")
    data_cleanup_limit_ns: int = _RECORDING.time(1800, 36000, "time in which the recording must be merged and verified", "copying 100 GB between two computers takes half an hour")
    load_limit_ns: int = _TAKEOFF.time(10, 120, "time in which the planner must confirm the mission", "uploading waypoints takes seconds")
    arm_limit_ns: int = _TAKEOFF.time(10, 120, "time from the takeoff command to armed", "PX4 refuses or arms within seconds")
    lift_off_limit_ns: int = _TAKEOFF.time(10, 120, "time from armed to airborne", "armed on the ground with turning propellers is dangerous")
    takeoff_limit_ns: int = _TAKEOFF.time(30, 300, "time from airborne to the takeoff height", "climbing a metre takes seconds")
    takeoff_height_m: float = _TAKEOFF.number(1.0, 50.0, "height at which the takeoff is over", "clear of ground effect")
    cancel_limit_ns: int = _TAKEOFF.time(10, 120, "time in which a cancelled takeoff must be disarmed", "the autopilot disarms on the ground at once")
    command_reply_limit_ns: int = _COMMANDS.time(1, 10, "time in which a command must be answered", "an answer takes milliseconds; what it does is read from the state")
    hold_confirm_limit_ns: int = _COMMANDS.time(3, 60, "time in which the planner must show that it holds", "unconfirmed: land")
    hold_repeat_after_ns: int = _COMMANDS.time(1.5, 60, "the hold is asked for again when nothing shows it after this time", "one request may be lost between planner and autopilot")
    hold_speed_m_s: float = _COMMANDS.number(0.5, 5.0, "slower than this, over ground and up or down, it stands still", "where the flight mode does not show a hold (set-points); above the drift of a hover")
    hold_speed_age_limit_ns: int = _COMMANDS.time(0.5, 5, "a speed that was told longer ago says nothing of standing still", "statuses come at 5 Hz; a vehicle that stood half a second ago may have flown on")
    resume_confirm_limit_ns: int = _COMMANDS.time(5, 60, "time in which the planner must show that it flies on", "unconfirmed: land")
    user_hold_limit_ns: int = _COMMANDS.time(120, 3600, "longest hold that a user may ask for", "then it lands: the battery does not wait")
    unlisted_wait_limit_ns: int = _COMMANDS.time(15, 600, "how long a flight waits for a component that has no wait_limit_s of its own", "a component that nobody listed gets the row of its code")
    land_repeat_period_ns: int = _LANDING.time(0.5, 1, "pause between two land commands until the vehicle shows that it lands", "2 Hz: a lost command costs half a second")
    land_second_route_after_ns: int = _LANDING.time(3, 30, "time without a sign of landing after which LAND is sent to the autopilot directly", "the planner may be what has failed")
    land_alarm_after_ns: int = _LANDING.time(6, 60, "time without a sign of landing after which the pilot is alarmed", "the pilot is the last route")
    land_limit_ns: int = _LANDING.time(120, 3600, "time in which the vehicle must be on the ground and disarmed", "30 m at 0.5 m/s take a minute")
    descent_speed_m_s: float = _LANDING.number(0.2, 10.0, "sinking faster than this is a descent", "above the noise of a hover")
    descent_time_ns: int = _LANDING.time(1, 30, "so long it must sink to show that it lands", "a gust is shorter")
    landing_height_m: float = _LANDING.number(1.5, 50.0, "sinking for that long within this height of the takeoff place is a landing: nothing is held any more", "the overshoot of a takeoff, or a leg of a mission, sinks higher up")
    ground_disarm_after_ns: int = _LANDING.time(4, 120, "time on the ground, armed, after which it is disarmed by command", "PX4 disarms by itself after 2 s")
    ground_disarm_period_ns: int = _LANDING.time(2, 60, "pause between two disarm commands", "the autopilot may refuse the first")
    flight_end_confirm_ns: int = _LANDING.time(0.5, 10, "so long statuses must agree on disarmed and on the ground before the flight is over", "one wrong status must not end the supervision; costs this time after each landing")
    confirm_limit_ns: int = _LANDING.time(10, 120, "time in which the landing detection should confirm the landing", "reported when it does not, never waited for longer; a flight that has stood for so long is over for good")
    watchdog_heartbeat_limit_ns: int = _FAILSAFE.time(0.6, 60, "silence of the watchdog, or a standing loop counter, that is a lost heartbeat", "three messages at 5 Hz")
    planner_status_limit_ns: int = _FAILSAFE.time(1, 60, "silence of the planner that is a loss", "five messages at 5 Hz")
    planner_idle_limit_ns: int = _FAILSAFE.time(1, 60, "how long the planner may say that nothing is flown, or hold unasked, while the vehicle flies", "it leads nothing then, whatever it was told wrongly; its statuses come at 5 Hz")
    landing_stall_limit_ns: int = _FAILSAFE.time(60, 600, "how long the planner may say that it lands while the vehicle stands in the air", "a landing that looks for its place stands for some seconds; after a minute nobody lands it")
    autopilot_status_limit_ns: int = _FAILSAFE.time(1, 60, "silence of the autopilot node that is a loss", "five messages at 5 Hz")
    autopilot_link_limit_ns: int = _FAILSAFE.time(3, 60, "age of the vehicle's heartbeat that is a lost link", "three MAVLink heartbeats at 1 Hz")
    vehicle_unknown_limit_ns: int = _FAILSAFE.time(5, 60, "how long it may be unknown in flight whether the vehicle is armed and on the ground, or said that it is disarmed in the air", "who flies it, and whether it has landed, is not known then; both come at 1 Hz or more")
    position_age_limit_ns: int = _FAILSAFE.time(10, 60, "how long height, position or tilt may be unknown in flight", "their limits cannot be watched without")
    recorder_status_limit_ns: int = _FAILSAFE.time(5, 120, "silence of the recorder that is a loss", "ten messages at 2 Hz")
    landing_detection_limit_ns: int = _FAILSAFE.time(1, 60, "silence of the landing detection that is a loss", "five messages at 5 Hz")
    status_max_age_ns: int = _FAILSAFE.time(1, 60, "how old a status may be to count as the present", "landed and disarmed are believed fresh only")
    pilot_confirm_ns: int = _FAILSAFE.time(0.3, 5, "so long statuses must agree that somebody else has control", "commanding stops with the first, one wrong status must not end the supervision; until then a landing that falls due waits, for a status that denies it, for this time, or for autopilot_status_limit_s where none comes")
    pilot_silence_limit_ns: int = _FAILSAFE.time(30, 600, "silence of a vehicle in somebody else's hands after which a person may end the mission", "a crash or a battery that was pulled ends its statuses for good")
    clock_stall_limit_ns: int = _FAILSAFE.time(1, 60, "how long /clock may stand still (use_sim_time)", "no limit is worth anything without a clock")
    clock_tolerance_ns: int = _FAILSAFE.time(0.2, 5, "how far a stamp may lie in the future", "clocks of two computers differ")
    battery_age_limit_ns: int = _BATTERY.time(10, 120, "how long the level may be unknown in flight", "then it lands")
    battery_critical_fraction: float = _BATTERY.number(0.15, 1, "level at which it lands", "enough for a landing from the height limit")
    battery_reserve_fraction: float = _BATTERY.number(0.2, 1, "level that an estimated mission leaves", "above the critical level, or every mission ends by it")
    max_flight_time_ns: int = _FLIGHT.time(900, 86400, "longest flight, from the takeoff command on", "the battery's endurance")
    max_height_m: float = _FLIGHT.number(30.0, 1000.0, "height above the takeoff position at which it lands", "ceiling or permit")
    max_distance_m: float = _FLIGHT.number(100.0, 10000.0, "horizontal distance from the takeoff position at which it lands", "field or permit")
    max_tilt_deg: float = _FLIGHT.number(70.0, 180.0, "angle to the vertical at which it lands, once it lasts; 180: never", "no mission leans so far: a motor, a propeller or the estimate has failed", least=10.0)
    tilt_warning_deg: float = _FLIGHT.number(45.0, 180.0, "angle to the vertical at which it warns, once it lasts; 180: never", "PX4 leans by at most 45 deg (MPC_TILTMAX_AIR), ArduPilot by 30 (ANGLE_MAX)", least=10.0)
    # fmt: on

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not value > 0:
                raise ValueError(f"{entry.name} is {value}, must be above 0")

    def is_present(self, age_ns: int) -> bool:
        """Return True when a status that is so old on arrival, by its own stamp, is of the present."""
        return -self.clock_tolerance_ns <= age_ns <= self.status_max_age_ns


@dataclass(frozen=True)
class Rules:
    """All that a configuration says to the engine.

    Args:
        components: the decision table.
        limits: every limit.
        require_go: READY waits for the operator's go.
        reply_limits_ns: checks with a limit of their own in the place of `check_reply_limit_ns`, by their names.
        max_ages_ns: likewise in the place of `check_max_age_ns`.
        checks: names of those that are asked before a takeoff; empty: every `events.CheckName`. A journal says which there
            were when it was written, so that a check that comes later changes none of its decisions.
    """

    components: Tuple[ComponentRule, ...] = ()
    limits: Limits = field(default_factory=Limits)
    require_go: bool = False
    reply_limits_ns: Tuple[Tuple[str, int], ...] = ()
    max_ages_ns: Tuple[Tuple[str, int], ...] = ()
    checks: Tuple[str, ...] = ()

    def reply_limit_ns(self, check: str) -> int:
        """Return the time in which a check must be answered."""
        return dict(self.reply_limits_ns).get(check, self.limits.check_reply_limit_ns)

    def max_age_ns(self, check: str) -> int:
        """Return how old the answer to a check may be at the takeoff."""
        return dict(self.max_ages_ns).get(check, self.limits.check_max_age_ns)

    def __post_init__(self) -> None:
        names = [rule.name for rule in self.components]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"component {name} is listed twice")
