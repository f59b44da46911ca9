"""Mission items as they are uploaded, and what the vehicle makes of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import FrozenSet, Optional, Tuple

from pymavlink.dialects.v20 import common as mavlink

from .settings import Geography, Place

__all__ = ["Item", "Task", "problem_of", "task_of"]

_NOWHERE = 2**31 - 1  # of MISSION_ITEM_INT: NaN
_DEG7 = 1e-7

_ABSOLUTE = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_MISSION = mavlink.MAV_FRAME_MISSION

_TASKS = {
    mavlink.MAV_CMD_NAV_TAKEOFF: "takeoff",
    mavlink.MAV_CMD_NAV_WAYPOINT: "waypoint",
    mavlink.MAV_CMD_NAV_LOITER_TIME: "waypoint",
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: "stay",
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: "return",
    mavlink.MAV_CMD_NAV_LAND: "land",
    mavlink.MAV_CMD_NAV_DELAY: "delay",
}
# Taken and passed over: cameras, gimbals and servos are not simulated.
_PASSED: FrozenSet[int] = frozenset(
    (
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_SET_SERVO,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        mavlink.MAV_CMD_DO_TRIGGER_CONTROL,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
        mavlink.MAV_CMD_VIDEO_START_CAPTURE,
        mavlink.MAV_CMD_VIDEO_STOP_CAPTURE,
        mavlink.MAV_CMD_SET_CAMERA_MODE,
    )
)


@dataclass(frozen=True)
class Item:
    """One item as it was uploaded; it is handed out again unchanged.

    Args:
        frame: MAV_FRAME.
        command: MAV_CMD.
        autocontinue: as given.
        params: the first four.
        x: latitude in 1e-7 degrees.
        y: longitude in 1e-7 degrees.
        z: altitude in m.
        kind: MAV_MISSION_TYPE.
    """

    frame: int
    command: int
    autocontinue: int
    params: Tuple[float, float, float, float]
    x: int
    y: int
    z: float
    kind: int = 0


@dataclass(frozen=True)
class Task:
    """What the vehicle does for an item; what is None stays as it is.

    Args:
        what: takeoff, waypoint, stay, return, land, delay or pass.
        across: metres east and north of the origin.
        up_m: above the origin.
        yaw_rad: counter-clockwise from east.
        hold_s: how long it stays there.
    """

    what: str
    across: Optional[Tuple[float, float]] = None
    up_m: Optional[float] = None
    yaw_rad: Optional[float] = None
    hold_s: float = 0.0


def problem_of(item: Item) -> int:
    """Return the MAV_MISSION_RESULT with which PX4 refuses an item; 0 when it takes it."""
    if item.command not in _TASKS and item.command not in _PASSED:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    if item.frame not in (*_ABSOLUTE, *_RELATIVE, _MISSION):
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if not math.isfinite(item.z) and _TASKS.get(item.command) in ("takeoff", "waypoint"):
        return int(mavlink.MAV_MISSION_INVALID_PARAM7)
    return 0


def task_of(item: Item, home: Place, geography: Geography) -> Task:
    """Return what to do for an item, with the home of this moment."""
    what = _TASKS.get(item.command, "pass")
    if what in ("pass", "return"):
        return Task(what)
    if what == "delay":
        return Task(what, hold_s=max(0.0, item.params[0]))
    return Task(
        what=what,
        across=_across(item, geography),
        up_m=item.z + (home.altitude_m if item.frame in _RELATIVE else 0.0) - geography.origin.altitude_m,
        yaw_rad=None if math.isnan(item.params[3]) else math.pi / 2 - math.radians(item.params[3]),
        hold_s=max(0.0, item.params[0]) if what == "waypoint" else 0.0,
    )


def _across(item: Item, geography: Geography) -> Optional[Tuple[float, float]]:
    if _NOWHERE in (item.x, item.y) or (item.x, item.y) == (0, 0):
        return None
    return geography.local(item.x * _DEG7, item.y * _DEG7)
