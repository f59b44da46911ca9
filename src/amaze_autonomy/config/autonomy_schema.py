"""Schema of autonomy.yaml: every limit of the engine, in groups, and the rates of the status streams."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

from amaze_autonomy.engine.rules import Limits, Rules

from .binding import Row, bind, group_of
from .kinds import Flag, Number, Whole
from .schema import Group, Key

__all__ = ["AUTONOMY", "LIMIT_GROUPS", "Streams"]


@dataclass(frozen=True)
class Streams:
    """How often each peer sends its status; the limits of the losses are measured against it.

    Args:
        watchdog_action_rate_hz: heartbeat of the watchdog.
        planner_status_rate_hz: of the mission planner.
        autopilot_status_rate_hz: of the autopilot node.
        landing_detection_rate_hz: of the landing detection.
        recorder_status_rate_hz: of the data recorder.
    """

    watchdog_action_rate_hz: float = 5.0
    planner_status_rate_hz: float = 5.0
    autopilot_status_rate_hz: float = 5.0
    landing_detection_rate_hz: float = 5.0
    recorder_status_rate_hz: float = 2.0


def _time(most: float = 3600.0) -> Number:
    return Number(above=0.0, maximum=most)


_PART = Number(above=0.0, below=1.0)

# group, what it is, rows of (field of engine.rules.Limits, kind, meaning, reason)
# fmt: off
LIMIT_GROUPS: Tuple[Tuple[str, str, Tuple[Row, ...]], ...] = (
    (
        "checks",
        "pre-flight checks",
        (
            ("check_reply_limit_ns", _time(60), "time in which a check must be answered", "a service call takes milliseconds; 3 s is a hung peer"),
            ("watchdog_startup_time_ns", _time(120), "how long the first call of the watchdog may wait for every component to come up", "cameras take several seconds to start"),
            ("preflight_fix_limit_ns", _time(), "time in which the watchdog may fix what failed before the user is asked", "longer than all attempts of one restart"),
            ("preflight_fix_poll_ns", _time(60), "pause between two questions to the watchdog while it fixes", "shows progress without flooding"),
            ("preflight_rounds_limit", Whole(1, 100), "how often the checks are run again by themselves before the user is asked", "a component that comes and goes must not keep the checks going for ever"),
            ("check_max_age_ns", _time(60), "how old a check may be at the takeoff", "what was true 10 s ago may not be true now"),
            ("ready_limit_ns", _time(), "how long Ready stands before the checks are run again", "an operator's go may come late"),
        ),
    ),
    (
        "recording",
        "start and end of the recording",
        (
            ("recording_lead_ns", _time(600), "recording time before the takeoff", "state estimators need data at rest to start from"),
            ("recording_start_limit_ns", _time(600), "time in which both platforms must show growing files, lead included", "rosbag needs a second, a slow disk several"),
            ("data_cleanup_limit_ns", _time(36000), "time in which the recording must be merged and verified", "copying 100 GB between two computers takes half an hour"),
        ),
    ),
    (
        "takeoff",
        "from the planner's confirmation to the mission",
        (
            ("load_limit_ns", _time(120), "time in which the planner must confirm the mission", "uploading waypoints takes seconds"),
            ("arm_limit_ns", _time(120), "time from the takeoff command to armed", "PX4 refuses or arms within seconds"),
            ("lift_off_limit_ns", _time(120), "time from armed to airborne", "armed on the ground with turning propellers is dangerous"),
            ("takeoff_limit_ns", _time(300), "time from airborne to the takeoff height", "climbing a metre takes seconds"),
            ("takeoff_height_m", Number(above=0.0, maximum=50.0), "height at which the takeoff is over", "clear of ground effect"),
            ("cancel_limit_ns", _time(120), "time in which a cancelled takeoff must be disarmed", "the autopilot disarms on the ground at once"),
        ),
    ),
    (
        "commands",
        "commands in flight, holds",
        (
            ("command_reply_limit_ns", _time(10), "time in which a command must be answered", "an answer takes milliseconds; what it does is read from the state"),
            ("hold_confirm_limit_ns", _time(60), "time in which the planner must show that it holds", "unconfirmed: land"),
            ("hold_repeat_after_ns", _time(60), "the hold is asked for again when nothing shows it after this time", "one request may be lost between planner and autopilot"),
            ("hold_speed_m_s", Number(above=0.0, maximum=5.0), "slower than this over ground it stands still", "where the flight mode does not show a hold (set-points); above the drift of a hover"),
            ("resume_confirm_limit_ns", _time(60), "time in which the planner must show that it flies on", "unconfirmed: land"),
            ("user_hold_limit_ns", _time(), "longest hold that a user may ask for", "then it lands: the battery does not wait"),
            ("unlisted_wait_limit_ns", _time(600), "how long a flight waits for a component that has no wait_limit_s of its own", "a component that nobody listed gets the row of its code"),
        ),
    ),
    (
        "landing",
        "landing, second route, alarm",
        (
            ("land_repeat_period_ns", _time(1), "pause between two land commands until the vehicle shows that it lands", "2 Hz: a lost command costs half a second"),
            ("land_second_route_after_ns", _time(30), "time without a sign of landing after which the autopilot is told directly", "the planner may be what has failed"),
            ("land_alarm_after_ns", _time(60), "time without a sign of landing after which the pilot is alarmed", "the pilot is the last route"),
            ("land_limit_ns", _time(), "time in which the vehicle must be on the ground and disarmed", "30 m at 0.5 m/s take a minute"),
            ("descent_speed_m_s", Number(above=0.0, maximum=10.0), "sinking faster than this is a descent", "above the noise of a hover"),
            ("descent_time_ns", _time(30), "so long it must sink to show that it lands", "a gust is shorter"),
            ("landing_height_m", Number(above=0.0, maximum=50.0), "sinking for that long below this height is a landing: nothing is held any more", "a mission sinks higher up"),
            ("ground_disarm_after_ns", _time(120), "time on the ground, armed, after which it is disarmed by command", "PX4 disarms by itself after 2 s"),
            ("ground_disarm_period_ns", _time(60), "pause between two disarm commands", "the autopilot may refuse the first"),
            ("flight_end_confirm_ns", _time(10), "so long statuses must agree on disarmed and on the ground before the flight is over", "one wrong status must not end the supervision; costs this time after each landing"),
            ("confirm_limit_ns", _time(120), "time in which the landing detection should confirm the landing", "reported when it does not, never waited for longer"),
        ),
    ),
    (
        "losses",
        "peers that fall silent",
        (
            ("watchdog_heartbeat_limit_ns", _time(60), "silence of the watchdog, or a standing loop counter, that is a lost heartbeat", "three messages at 5 Hz"),
            ("planner_status_limit_ns", _time(60), "silence of the planner that is a loss", "five messages at 5 Hz"),
            ("autopilot_status_limit_ns", _time(60), "silence of the autopilot node that is a loss", "five messages at 5 Hz"),
            ("autopilot_link_limit_ns", _time(60), "age of the vehicle's heartbeat that is a lost link", "three MAVLink heartbeats at 1 Hz"),
            ("position_age_limit_ns", _time(60), "how long height or position may be unknown in flight", "limits of height and distance cannot be watched without"),
            ("recorder_status_limit_ns", _time(120), "silence of the recorder that is a loss", "ten messages at 2 Hz"),
            ("landing_detection_limit_ns", _time(60), "silence of the landing detection that is a loss", "five messages at 5 Hz"),
            ("status_max_age_ns", _time(60), "how old a status may be to count as the present", "landed and disarmed are believed fresh only"),
            ("pilot_confirm_ns", _time(5), "so long statuses must agree that somebody else has control", "commanding stops with the first; one wrong status must not end the supervision"),
            ("clock_stall_limit_ns", _time(60), "how long /clock may stand still (use_sim_time)", "no limit is worth anything without a clock"),
            ("clock_tolerance_ns", _time(5), "how far a stamp may lie in the future", "clocks of two computers differ"),
        ),
    ),
    (
        "battery",
        "battery in flight and after it",
        (
            ("battery_age_limit_ns", _time(120), "how long the level may be unknown in flight", "then it lands"),
            ("battery_critical_fraction", _PART, "level at which it lands", "enough for a landing from the height limit"),
            ("battery_reserve_fraction", _PART, "level that an estimated mission leaves", "above the critical level, or every mission ends by it"),
        ),
    ),
    (
        "flight",
        "limits of every flight; a mission may set its own",
        (
            ("max_flight_time_ns", _time(86400), "longest flight, from the takeoff command on", "the battery's endurance"),
            ("max_height_m", Number(above=0.0, maximum=1000.0), "height above the takeoff position at which it lands", "ceiling or permit"),
            ("max_distance_m", Number(above=0.0, maximum=10000.0), "horizontal distance from the takeoff position at which it lands", "field or permit"),
        ),
    ),
)
# fmt: on

_RATE = Number(minimum=0.5, maximum=50.0)
# fmt: off
_STREAM_ROWS: Tuple[Row, ...] = (
    ("watchdog_action_rate_hz", _RATE, "heartbeat of the watchdog", "its loss is seen within its limit"),
    ("planner_status_rate_hz", _RATE, "status of the mission planner", ""),
    ("autopilot_status_rate_hz", _RATE, "status of the autopilot node", ""),
    ("landing_detection_rate_hz", _RATE, "judgement of the landing detection", ""),
    ("recorder_status_rate_hz", _RATE, "status of the data recorder", ""),
)
# fmt: on


_STATUS = "how often each peer sends its status"

AUTONOMY = Group(
    "the engine",
    (
        bind(
            Rules, "require_go", Flag(), "Ready waits for the operator's go", "off: it takes off as soon as it is ready"
        ),
        *(Key(name, group_of(Limits, said, rows), said, "", {}) for name, said, rows in LIMIT_GROUPS),
        Key("streams", group_of(Streams, _STATUS, _STREAM_ROWS), _STATUS, "", {}),
    ),
)
