"""Schema of missions.yaml: the flight model, the bounds of waypoint files, and the missions."""

from __future__ import annotations

from typing import Tuple

from amaze_autonomy.missions import Bounds, FlightModel

from .binding import Row, group_of
from .components_schema import COMPONENT_NAME, NAME, SEVERITY
from .kinds import ListOf, Number, Text, Whole
from .schema import Group, Key, Named

__all__ = ["MISSIONS", "MISSION_ID"]

MISSION_ID = r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}"
_SPEED = Number(above=0.0, maximum=30.0)

# fmt: off
_FLIGHT_ROWS: Tuple[Row, ...] = (
    ("cruise_speed_m_s", _SPEED, "horizontal speed between waypoints", "as set in the autopilot (MPC_XY_CRUISE)"),
    ("climb_speed_m_s", _SPEED, "vertical speed upwards", "MPC_Z_VEL_MAX_UP"),
    ("descent_speed_m_s", _SPEED, "vertical speed downwards, between waypoints", "MPC_Z_VEL_MAX_DN"),
    ("landing_speed_m_s", _SPEED, "vertical speed of a landing", "MPC_LAND_SPEED"),
    ("acceleration_m_s2", Number(above=0.0, maximum=30.0), "acceleration and braking at each waypoint", "each waypoint is a stop"),
    ("turn_rate_rad_s", Number(above=0.0, maximum=10.0), "yaw rate while turning", "a turn may take longer than its leg"),
    ("ground_time_s", Number(minimum=0.0, maximum=600.0), "time on the ground with turning propellers, each takeoff and landing together", "arming, spin-up, disarming"),
    ("endurance_s", Number(minimum=10.0, maximum=86400.0), "flight time of a full battery", "measured: hover from full to empty"),
)
_BOUNDS_ROWS: Tuple[Row, ...] = (
    ("min_height_m", Number(minimum=0.0, maximum=100.0), "lowest waypoint", "ground effect, grass"),
    ("max_leg_m", Number(above=0.0, maximum=10000.0), "longest way between two waypoints", "a slipped digit shows here"),
    ("max_first_leg_m", Number(above=0.0, maximum=10000.0), "longest way from the takeoff to the first waypoint", "a wrong origin shows here"),
    ("max_hold_s", Number(above=0.0, maximum=3600.0), "longest hold at a waypoint", "milliseconds for seconds show here"),
    ("max_waypoints", Whole(1, 100000), "most waypoints of a file", "what the autopilot takes"),
)
# fmt: on


_FILE = Text('a file inside the folder of the configuration, e.g. "trajectories/square.csv"', r"[^\\\x00-\x1f]+\.csv")

_LIMITS = Group(
    "limits of this mission",
    (
        Key(
            "max_height_m",
            Number(above=0.0, maximum=1000.0),
            "height at which it lands",
            "left out: autonomy.yaml, flight",
            None,
        ),
        Key(
            "max_distance_m",
            Number(above=0.0, maximum=10000.0),
            "distance at which it lands",
            "left out: autonomy.yaml, flight",
            None,
        ),
        Key(
            "max_flight_time_s",
            Number(above=0.0, maximum=86400.0),
            "longest flight",
            "left out: autonomy.yaml, flight",
            None,
        ),
    ),
)

_MISSION = Group(
    "a mission",
    (
        Key("description", Text("one line", longest=120), "one line for the user", "read aloud before the flight"),
        Key(
            "files",
            ListOf(_FILE, "waypoint files", 1, example="[trajectories/square.csv]"),
            "flown one after the other, with a touchdown in between",
        ),
        Key("repetitions", Whole(1, 1000), "how often all files are flown", "with a touchdown in between", 1),
        Key(
            "battery_needed_fraction",
            Number(above=0.0, maximum=1.0),
            "battery that it needs, reserve included; left out: estimated",
            "from length, speed, hold times and the reserve",
            None,
        ),
        Key(
            "severities",
            Named("components", COMPONENT_NAME, SEVERITY),
            "components that it judges otherwise",
            "a mission of the RealSense cannot do without it",
            {},
        ),
        Key(
            "required",
            ListOf(NAME, "components", unique=True),
            "components that must be at code 1 before takeoff; empty: all",
            "",
            [],
        ),
        Key(
            "tolerated",
            ListOf(NAME, "components", unique=True),
            "components that may be at code 2 before takeoff",
            "shown and journaled",
            [],
        ),
        Key("limits", _LIMITS, "limits of its own", "a small field", {}),
    ),
)

MISSIONS = Group(
    "the missions",
    (
        Key(
            "flight",
            group_of(FlightModel, "how the vehicle flies", _FLIGHT_ROWS),
            "how it flies: for durations, energy, and the simulated vehicle",
            "",
            {},
        ),
        Key(
            "bounds",
            group_of(Bounds, "bounds of waypoint files", _BOUNDS_ROWS),
            "what a waypoint file may hold",
            "",
            {},
        ),
        Key("missions", Named("missions", MISSION_ID, _MISSION, 1), "the missions by id"),
    ),
)
