"""Schema of missions.yaml: the flight model, the bounds of waypoint files, and the missions."""

from __future__ import annotations

from typing import Tuple

from amaze_autonomy.missions import Bounds, Controller, FlightModel, Frame, PlannerSpec, YawUnit

from ..kinds import Choice, Flag, ListOf, Number, Text, Whole
from ..schema import Group, Key, Named, Row, group_of
from .sensors import COMPONENT_NAME, NAME, SEVERITY

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
_PLANNER_ROWS: Tuple[Row, ...] = (
    ("acceptance_radius_m", Number(above=0.0, maximum=100.0), "nearer than this a waypoint is reached", "half a metre is what a GPS is good for"),
    ("heading_tolerance_rad", Number(above=0.0, maximum=180.0), "nearer than this a yaw is reached, with set-points", "a magnetometer wanders by some degrees"),
    ("home_tolerance_m", Number(above=0.0, maximum=1000.0), "how far the first takeoff may be from the mission's home, and a later one from where the file before ends", "the mission, or the first leg of a file, is flown that much beside its fence"),
    ("transfer_limit_ns", Number(above=0.0, maximum=600.0), "time in which a waypoint file must be sent, read back and compared", "below the engine's load_limit_s; 500 waypoints on a slow radio take longer"),
    ("message_retry_ns", Number(above=0.0, maximum=60.0), "time without an answer after which a message of the mission protocol is sent again", "longer than a turn of the slowest link"),
    ("command_retry_ns", Number(above=0.0, maximum=60.0), "time without an effect after which a command is sent again", "PX4 shows a change of mode with its next heartbeat; to be told twice does no harm"),
    ("command_limit_ns", Number(above=0.0, maximum=60.0), "time in which a command must show its effect", "then it has failed, with the autopilot's reason"),
    ("vehicle_age_limit_ns", Number(above=0.0, maximum=60.0), "how old the vehicle's last message, its flight mode and whether it is armed may be to be believed", "three heartbeats"),
    ("setpoint_rate_hz", Number(minimum=10.0, maximum=20.0), "rate of the stream of set-points", "the link sends them when it looks at the time, 20 times a second: 20 is each time, 10 each second time, between them is one of both; PX4 needs more than 2 Hz"),
    ("setpoint_lead_ns", Number(above=0.0, maximum=60.0), "how long set-points are sent before the autopilot is told to follow them", "PX4 refuses OFFBOARD without a stream of half a second"),
    ("pose_age_limit_ns", Number(above=0.0, maximum=60.0), "how old the local position may be to be flown by", "older: stop and stand still; still older: land"),
)
# fmt: on


_FILE = Text(
    'a .csv or .plan file inside the folder of the configuration, e.g. "trajectories/square.csv"',
    r"[^\\\x00-\x1f]+\.(csv|plan)",
)

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
            "horizontal distance from each flight's own takeoff at which it lands",
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

_HOME = Group(
    "a place on the earth",
    (
        Key("latitude_deg", Number(minimum=-80.0, maximum=80.0), "north"),
        Key("longitude_deg", Number(minimum=-180.0, maximum=180.0), "east"),
    ),
)
_CORNER = ListOf(
    Number(minimum=-100000.0, maximum=100000.0), "two numbers, metres east and north", 2, example="[20, -5]"
)

_MISSION = Group(
    "a mission",
    (
        Key("description", Text("one line", longest=120), "one line for the user", "read aloud before the flight"),
        Key(
            "files",
            ListOf(_FILE, "waypoint files", 1, example="[trajectories/square.csv]"),
            "CSV in metres, CSV in latitude and longitude, or .plan of QGroundControl; flown one after the other, with a touchdown in between",
        ),
        Key(
            "touchdown_between_files",
            Flag(),
            "false: all its files are one flight, straight from the last waypoint of one to the first of the next",
            "a long survey in parts; their waypoints count from the same takeoff",
            True,
        ),
        Key(
            "hover_at_end_s",
            Number(minimum=0.0, maximum=3600.0),
            "how long it hovers at its last waypoint, besides the hold there, before it lands by itself",
            "for a last look; the operator's land ends it earlier",
            0.0,
        ),
        Key(
            "frame",
            Choice(tuple(each.value for each in Frame)),
            "of files in metres that do not say it themselves: x east and y north of the first takeoff, or x ahead and y left of the heading at each file's takeoff; left out: every file says it",
            "a file in the wrong frame is flown in another direction",
            None,
        ),
        Key(
            "yaw_unit",
            Choice(tuple(each.value for each in YawUnit)),
            "of files that do not say it themselves; left out: every file says it",
            "5 degrees are not 5 rad",
            None,
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
            "components that must be at code 1 before takeoff; empty: those that are required in sensors.yaml",
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
        Key(
            "land_switch",
            Flag(),
            "the switch of the transmitter that means land counts (land_switch of autopilot.yaml)",
            "a pilot who trains landings has it for himself",
            True,
        ),
        Key(
            "controller",
            Choice(tuple(each.value for each in Controller)),
            "who steers: the autopilot by an uploaded mission, or the planner by set-points (offboard)",
            "offboard needs no GPS, only a local position (vision, motion capture)",
            Controller.MISSION.value,
        ),
        Key(
            "home",
            _HOME,
            "place of its first takeoff, where the autopilot steers; left out: the home of its .plan, or wherever the vehicle stands",
            "needed for waypoints in latitude and longitude",
            None,
        ),
        Key(
            "fence_m",
            ListOf(
                _CORNER,
                "corners of a polygon that it stays inside, at most 500, metres east and north of its first takeoff",
                example="[[-5, -5], [25, -5], [25, 15], [-5, 15]]",
            ),
            "geofence: every leg is checked against it, and against the fence of its .plan",
            "walls, a road, the neighbour's field",
            [],
        ),
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
        Key(
            "planner",
            group_of(PlannerSpec, "limits of the mission planner", _PLANNER_ROWS),
            "how the mission planner flies them through the autopilot",
            "",
            {},
        ),
        Key("missions", Named("missions", MISSION_ID, _MISSION, 1), "the missions by id"),
    ),
)
