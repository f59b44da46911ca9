"""What is known of the CNS Flight Stack's nodes: names, types with their md5 sums, and what its words are here.

Facts of its public interface, seen on the running nodes. A type whose md5 sum is another one is refused by name: it
would be another message under the same name.
"""

from __future__ import annotations

import enum
import re
from dataclasses import dataclass
from typing import Mapping, Tuple

from amaze_autonomy.engine.rules import SEVERITIES, Code, Severity

PEERS = ("watchdog", "landing_detection", "state_estimation", "mission_planner", "data_recorder")
"""Peers of our engine that a node of the CNS Flight Stack can be."""

UNLISTED = Severity.HIGH
"""What an entity counts as of which no mission says anything."""


class EntityStatus(enum.IntEnum):
    """Status of an entity, as its watchdog numbers it: 4 is not our 4."""

    UNDEF = 0
    NOMINAL = 1
    STARTING = 2
    DEFECT = 4  # the rate is off
    ERROR = 8


class Request(enum.IntEnum):
    """What its sequencer is asked."""

    UNDEF = 0
    ARM = 1
    TAKEOFF = 2
    HOLD = 3
    RESUME = 4
    LAND = 5
    HOVER = 6
    ABORT = 7  # in flight it does nothing: LAND or DISARM is sent in its place
    DISARM = 8


class WaypointAction(enum.IntEnum):
    """What its sequencer does with a list of waypoints."""

    CLEAR = 0
    APPEND = 1
    INSERT = 2


class Reference(enum.IntEnum):
    """What its waypoints count from, and along which axes."""

    GLOBAL = 0  # the estimator's frame
    LOCAL = 1  # where it started, along its heading there
    CUR_POS = 2  # where it is, along the axes of the estimator's frame
    CUR_POSE = 3  # where it is, along its heading


class Answer(enum.Enum):
    """What its pairs (response, completed) say of a request."""

    ACCEPTED = (True, False)
    COMPLETED = (False, True)
    DONE = (True, True)
    REFUSED = (False, False)


@dataclass(frozen=True)
class Name:
    """One topic or service.

    Args:
        peer: of our engine that it belongs to.
        name: as its operator's launch file names it.
        type: package and message or service.
        md5: of the type.
        heard: a topic that we listen to; else one that we publish, or a service that we ask.
    """

    peer: str
    name: str
    type: str
    md5: str
    heard: bool = False


_TRIGGER, _SET_BOOL = "937c9679a518e3a18d831e57125ea522", "09fb03525b03e7ea1fd3992bafd87e16"
_BOOL = "8b94c1b53db61fb6aed406028ad6332a"
_WATCHDOG, _LANDING, _ESTIMATOR, _SEQUENCER, _RECORDER = PEERS

TOPICS: Mapping[str, Name] = {
    "heartbeat": Name(
        _WATCHDOG, "/watchdog/status", "watchdog_msgs/StatusStamped", "327baea3faba54734bd2f3b6c68787ab", heard=True
    ),
    "log": Name(
        _WATCHDOG,
        "/watchdog/log",
        "watchdog_msgs/StatusChangesArrayStamped",
        "be226fc8063e4e54e0bf24bced9535a4",
        heard=True,
    ),
    "is_landed": Name(_LANDING, "/toland_detector/is_landed", "std_msgs/Bool", _BOOL, heard=True),
    "is_takeoff": Name(_LANDING, "/toland_detector/is_takeoff", "std_msgs/Bool", _BOOL, heard=True),
    "request": Name(
        _SEQUENCER, "/autonomy/request", "mission_sequencer/MissionRequest", "9dc2c5de534a1b79647415cbe2c04c9b"
    ),
    "response": Name(
        _SEQUENCER,
        "/autonomy/response",
        "mission_sequencer/MissionResponse",
        "80ae1966a367858a868f2d03d5ae46d6",
        heard=True,
    ),
    "waypoint_list": Name(
        _SEQUENCER,
        "/mission_sequencer/waypoint_list",
        "mission_sequencer/MissionWaypointArray",
        "822a9ffd0f5a8b197c9682a5fd39f664",
    ),
    "waypoint_reached": Name(
        _SEQUENCER,
        "/waypoint_reached",
        "mission_sequencer/MissionWaypointStamped",
        "dcaf6ca291c20888da9eef186799be8d",
        heard=True,
    ),
}
SERVICES: Mapping[str, Name] = {
    "watchdog_start": Name(
        _WATCHDOG, "/watchdog/service/start", "watchdog_msgs/Start", "0dce17580854048dd8c9764a29917bd4"
    ),
    "takeoff_check": Name(_LANDING, "/toland_detector/service/takeoff", "std_srvs/Trigger", _TRIGGER),
    "supervision": Name(_ESTIMATOR, "/estimator_supervisor/service/supervision", "std_srvs/Trigger", _TRIGGER),
    "record": Name(_RECORDER, "/data_recorder/record", "std_srvs/SetBool", _SET_BOOL),
}

ACTIONS: Mapping[str, Severity] = {
    "continue": Severity.LOW,
    "hold": Severity.HIGH,
    "land": Severity.HIGHEST,
    "failure": Severity.HIGHEST,
}
"""Severity of an entity by the action that a mission has for it."""

AUTOPILOT_ENTITIES: Mapping[str, str] = {
    "px4_gps": "gps",
    "px4_imu": "imu",
    "px4_mag": "magnetometer",
    "px4_bar": "barometer",
}
"""Entities that are sensors of the autopilot, by the names that its template gives them."""

_OTHER = re.compile(r"[^a-z0-9]+")
_LONGEST = 60


def code_of(status: int, severity: Severity) -> Code:
    """Return our code of an entity's status; a status that is none of theirs is an error."""
    if status == EntityStatus.NOMINAL:
        return Code.NOMINAL
    if status in (EntityStatus.UNDEF, EntityStatus.STARTING, EntityStatus.DEFECT):
        return Code.NON_CRITICAL
    return SEVERITIES[severity].code


def component_of(entity: str) -> str:
    """Return the name that an entity has as a component here."""
    name = _OTHER.sub("_", entity.lower()).strip("_") or "entity"
    return (name if name[0].isalpha() else f"entity_{name}")[:_LONGEST]


def worst(severities: Tuple[Severity, ...]) -> Severity:
    """Return the worst of some severities."""
    return max(severities, key=list(SEVERITIES).index)
