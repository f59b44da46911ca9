"""What must happen when something fails: sections 4 and 5 of DESIGN.md, copied out by hand.

Nothing here is taken from the tables of the engine: this is the specification that they are tested against.
"""

from __future__ import annotations

from typing import Dict, NamedTuple, Optional, Tuple


class SeverityRow(NamedTuple):
    """A row of the severity table: the code when it fails, the code once restarting has failed, the two verbs."""

    code: int
    code_given_up: int
    action: str
    fallback: Optional[str]


SEVERITIES: Dict[str, SeverityRow] = {
    "low": SeverityRow(2, 2, "continue", None),
    "moderate": SeverityRow(4, 4, "wait", "continue"),
    "high": SeverityRow(8, 16, "wait", "land"),
    "highest": SeverityRow(16, 16, "land", None),
}


class Component(NamedTuple):
    """A row of the decision table; `wait_s` as in the rules of these stories."""

    group: str
    restart: bool
    severity: str
    code: int
    action: str
    fallback: Optional[str]
    wait_s: float


COMPONENTS: Dict[str, Component] = {
    "gps": Component("px4", False, "low", 2, "continue", None, 0.0),
    "imu": Component("px4", False, "highest", 16, "land", None, 0.0),
    "magnetometer": Component("px4", False, "moderate", 4, "wait", "continue", 6.0),
    "barometer": Component("px4", False, "moderate", 4, "wait", "continue", 7.0),
    "mission_camera": Component("other", True, "highest", 16, "land", None, 0.0),
    "realsense_camera": Component("other", True, "moderate", 4, "wait", "continue", 8.0),
    "realsense_imu": Component("other", False, "low", 2, "continue", None, 0.0),
    "lsm9ds1_imu": Component("other", True, "moderate", 4, "wait", "continue", 9.0),
    "lrf": Component("other", True, "high", 8, "wait", "land", 5.0),
}

VERBS: Dict[Tuple[str, int], Optional[str]] = {
    ("low", 1): None,
    ("low", 2): "continue",
    ("low", 4): "continue",
    ("low", 8): "continue",
    ("low", 16): "land",
    ("moderate", 1): None,
    ("moderate", 2): "continue",
    ("moderate", 4): "wait",
    ("moderate", 8): "wait",
    ("moderate", 16): "land",
    ("high", 1): None,
    ("high", 2): "continue",
    ("high", 4): "wait",
    ("high", 8): "wait",
    ("high", 16): "land",
    ("highest", 1): None,
    ("highest", 2): "continue",
    ("highest", 4): "land",
    ("highest", 8): "land",
    ("highest", 16): "land",
}
"""(severity, code) -> action: 1 clears; 2 is always continue; 4 and 8 take the row's action; 16 is always land."""


class Reaction(NamedTuple):
    """Where the engine is at once, and what the vehicle's side is told, in order."""

    state: str
    step: str
    motions: Tuple[str, ...]


def _stay(place: str) -> Reaction:
    state, _, step = place.partition(" ")
    return Reaction(state, step, ())


_HOLD = Reaction("HOLD", "confirming", ("HOLD",))
_LAND = Reaction("LAND", "commanding", ("LAND",))
_LAND_DISARMED = Reaction("LAND", "descending", ("LAND",))
_CANCEL = Reaction("TAKEOFF", "cancelling", ("ABORT",))

AIRBORNE: Dict[str, Dict[str, Reaction]] = {
    "TAKEOFF climbing": {"continue": _stay("TAKEOFF climbing"), "wait": _HOLD, "land": _LAND},
    "MISSION flying": {"continue": _stay("MISSION flying"), "wait": _HOLD, "land": _LAND},
    "HOLD confirming": {"continue": _stay("HOLD confirming"), "wait": _stay("HOLD confirming"), "land": _LAND},
    "HOLD holding": {"continue": _stay("HOLD holding"), "wait": _stay("HOLD holding"), "land": _LAND},
    "HOLD holding takeoff": {"continue": _stay("HOLD holding"), "wait": _stay("HOLD holding"), "land": _LAND},
    "HOLD resuming": {"continue": _stay("HOLD resuming"), "wait": _HOLD, "land": _LAND},
    "LAND commanding": dict.fromkeys(("continue", "wait", "land"), _stay("LAND commanding")),
    "LAND descending": dict.fromkeys(("continue", "wait", "land"), _stay("LAND descending")),
    "PILOT": dict.fromkeys(("continue", "wait", "land"), _stay("PILOT")),
}
"""place -> action -> reaction, in the air: the same in every phase; a hold never interrupts a landing."""

BEFORE_LIFT_OFF: Dict[str, Dict[str, Reaction]] = {
    "TAKEOFF arming": {"continue": _stay("TAKEOFF arming"), "wait": _CANCEL, "land": _LAND_DISARMED},
    "TAKEOFF lifting_off": {"continue": _stay("TAKEOFF lifting_off"), "wait": _CANCEL, "land": _LAND},
    "TAKEOFF cancelling": {"continue": _stay("TAKEOFF cancelling"), "wait": _stay("TAKEOFF cancelling"), "land": _LAND},
}
"""From the TAKEOFF command to lift-off: in flight, so 16 lands; what would be waited for cancels the takeoff."""

ON_THE_GROUND: Dict[str, Dict[int, str]] = {
    "MISSION_INPUT": dict.fromkeys((1, 2, 4, 8, 16), "MISSION_INPUT"),
    "PREFLIGHT": dict.fromkeys((1, 2, 4, 8, 16), "PREFLIGHT"),
    "OUTREACH": dict.fromkeys((1, 2, 4, 8, 16), "OUTREACH"),
    "OUTREACH recorded": dict.fromkeys((1, 2, 4, 8, 16), "OUTREACH"),
    "OUTREACH data": dict.fromkeys((1, 2, 4, 8, 16), "OUTREACH"),
    "OUTREACH data queued": dict.fromkeys((1, 2, 4, 8, 16), "OUTREACH"),
    "READY": {1: "READY", 2: "PREFLIGHT", 4: "PREFLIGHT", 8: "PREFLIGHT", 16: "PREFLIGHT"},
    "START_RECORDING": {1: "START_RECORDING", 2: "PREFLIGHT", 4: "PREFLIGHT", 8: "PREFLIGHT", 16: "PREFLIGHT"},
    "LOAD_MISSION": {1: "LOAD_MISSION", 2: "PREFLIGHT", 4: "PREFLIGHT", 8: "PREFLIGHT", 16: "PREFLIGHT"},
    "MISSION touchdown": {
        1: "MISSION",
        2: "DATA_CLEANUP",
        4: "DATA_CLEANUP",
        8: "DATA_CLEANUP",
        16: "DATA_CLEANUP",
    },
    "PILOT landed": dict.fromkeys((1, 2, 4, 8, 16), "PILOT"),
    "DATA_CLEANUP": dict.fromkeys((1, 2, 4, 8, 16), "DATA_CLEANUP"),
    "DATA_CLEANUP queued": dict.fromkeys((1, 2, 4, 8, 16), "DATA_CLEANUP"),
    "MISSION_ENDED": dict.fromkeys((1, 2, 4, 8, 16), "MISSION_ENDED"),
}
"""place -> code -> state, on the ground: between Ready and takeoff a failure takes Ready back; nothing moves."""
