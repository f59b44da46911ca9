"""What must come of every shipped scenario on mission 1, written by hand: states, requests of motion, result.

Requests that follow each other are written once ("LAND" may be repeated); "AutopilotLand" is the second route.
"""

from __future__ import annotations

from typing import NamedTuple, Optional, Tuple

_UP = ("PREFLIGHT", "READY", "START_RECORDING", "LOAD_MISSION", "TAKEOFF")
_FLY = (*_UP, "MISSION")
_END = ("DATA_CLEANUP", "MISSION_ENDED")
_RETRY = ("PREFLIGHT", "OUTREACH")


class Story(NamedTuple):
    """What comes of a scenario.

    Args:
        states: that the engine goes through after MISSION_INPUT.
        motion: requests of motion, in order.
        result: of the mission; None when it never began.
        data: what became of its recording.
    """

    states: Tuple[str, ...]
    motion: Tuple[str, ...]
    result: Optional[str]
    data: str = "COMPLETE"


FLOWN = Story((*_FLY, *_END), ("TAKEOFF",), "COMPLETE")
LANDED = Story((*_FLY, "LAND", *_END), ("TAKEOFF", "LAND"), "LANDED_EARLY")
LANDED_TWICE = LANDED._replace(motion=("TAKEOFF", "LAND", "AutopilotLand"))
HELD = Story((*_FLY, "HOLD", "MISSION", *_END), ("TAKEOFF", "HOLD", "RESUME"), "COMPLETE")
HELD_LANDED = Story((*_FLY, "HOLD", "LAND", *_END), ("TAKEOFF", "HOLD", "LAND"), "LANDED_EARLY")
RETRIED = Story((*_RETRY, *_FLY, *_END), ("TAKEOFF",), "COMPLETE")
PILOT = Story((*_FLY, "PILOT", *_END), ("TAKEOFF",), "PILOT")
GIVEN_UP = Story((*_FLY, "DATA_CLEANUP", "OUTREACH", "MISSION_ENDED"), ("TAKEOFF",), "COMPLETE", "INCOMPLETE")
CANCELLED = Story((*_UP, "OUTREACH", *_END), ("TAKEOFF", "ABORT"), "NOT_FLOWN")

STORIES = {
    "autopilot_failsafe": PILOT,
    "autopilot_link": LANDED_TWICE,
    "autopilot_silent": LANDED_TWICE,
    "barometer": HELD,
    "battery_drain": LANDED,
    "battery_low": Story((*_RETRY, "MISSION_INPUT"), (), None),
    "battery_unknown": LANDED,
    "data_incomplete": Story((*_FLY, "DATA_CLEANUP", "OUTREACH", *_END), ("TAKEOFF",), "COMPLETE"),
    "data_lost": GIVEN_UP,
    "does_not_arm": CANCELLED,
    "does_not_climb": Story((*_UP, "LAND", *_END), ("TAKEOFF", "LAND"), "LANDED_EARLY"),
    "does_not_descend": Story((*_FLY, "LAND", *_END), ("TAKEOFF", "LAND", "AutopilotLand"), "COMPLETE"),
    "does_not_disarm": LANDED._replace(motion=("TAKEOFF", "LAND", "AutopilotDisarm")),
    "does_not_lift_off": CANCELLED,
    "estimator_silent": RETRIED,
    "flapping": Story((*_FLY, *("HOLD", "MISSION") * 3, *_END), ("TAKEOFF", *("HOLD", "RESUME") * 3), "COMPLETE"),
    "gps": FLOWN,
    "gps_lost": PILOT,
    "heartbeat": LANDED,
    "heartbeat_stuck": LANDED,
    "hold_ignored": HELD_LANDED,
    "land_ignored": LANDED_TWICE,
    "landing_detection": FLOWN,
    "lrf": HELD_LANDED,
    "lrf_during_hold": HELD_LANDED,
    "lrf_returns": HELD,
    "lsm9ds1_imu": HELD,
    "magnetometer": HELD,
    "mission_camera": LANDED,
    "mission_camera_before_takeoff": FLOWN,
    "mission_camera_dead": RETRIED,
    "not_on_ground": RETRIED,
    "pilot_takeover": PILOT,
    "planner_hangs": Story((*_UP[:-1], "OUTREACH", *_FLY, *_END), ("TAKEOFF",), "COMPLETE"),
    "planner_refuses": Story((*_UP[:-1], "OUTREACH", *_FLY, *_END), ("TAKEOFF",), "COMPLETE"),
    "planner_silent": LANDED_TWICE,
    "px4_imu": LANDED,
    "range_nan": RETRIED,
    "rc_missing": RETRIED,
    "realsense_camera": HELD,
    "realsense_camera_returns": HELD,
    "realsense_imu": FLOWN,
    "recorder_dies": Story(
        (*_FLY, "DATA_CLEANUP", "OUTREACH", "MISSION_ENDED"), ("TAKEOFF",), "COMPLETE", "INCOMPLETE"
    ),
    "recorder_does_not_grow": Story((*_UP[:-2], "OUTREACH", *_FLY, *_END), ("TAKEOFF",), "COMPLETE"),
    "recorder_refuses": Story((*_UP[:-2], "OUTREACH", *_FLY, *_END), ("TAKEOFF",), "COMPLETE"),
    "slow_camera": FLOWN,
    "tilt": LANDED,
    "tilted": RETRIED,
    "user_hold": HELD,
    "user_land": LANDED,
}

REACTIONS_S = {
    "mission_camera": ("LAND", 0.5),
    "px4_imu": ("LAND", 0.5),
    "heartbeat": ("LAND", 0.7),
    "heartbeat_stuck": ("LAND", 0.7),
    "planner_silent": ("LAND", 1.1),
    "autopilot_silent": ("LAND", 1.1),
    "tilt": ("LAND", 0.9),
    "realsense_camera": ("HOLD", 0.6),
    "lrf": ("HOLD", 0.6),
    "user_hold": ("HOLD", 0.01),
    "user_land": ("LAND", 0.01),
}
"""How long after the fault, or the user's request, the first such request of motion is sent, at most."""
