"""A flight as items of the MAVLink mission protocol: takeoff, waypoints with holds, landing; and how they compare.

Autopilots keep items in types of their own, so what is read back may be rounded; what may differ by how much is one
table below. ArduPilot's item 0 is home: a place holder that it overwrites, sent and never compared. It flies no yaw of
a waypoint: before each stands a turn (CONDITION_YAW), which it begins when it sets out for that waypoint. It forgets a
turn when it leaves AUTO, so that it is sent back to the turn (`beginning`) to go on.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Callable, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.missions import Home, Place, Trajectory

from ..link.dialect import Message, mavlink

__all__ = ["Dialect", "MissionItem", "beginning", "difference", "mission_items", "waypoint_index"]

_FRAME = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
_FRAMES = {_FRAME: 3, 3: 3}  # with and without _INT in its name is the same
_DEGREES = 1e7
_TAKEOFF, _WAYPOINT, _LAND = mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LAND
_TURN = mavlink.MAV_CMD_CONDITION_YAW
_NOWHERE = (_LAND, _TURN)  # commands whose frame an autopilot may forget


class Dialect(enum.Enum):
    """How an autopilot speaks the mission protocol; the value is what its missions begin with before our items."""

    PX4 = 0
    ARDUPILOT = 1


#: items of each waypoint
_EACH: Mapping[Dialect, int] = {Dialect.PX4: 1, Dialect.ARDUPILOT: 2}


@dataclass(frozen=True)
class MissionItem:
    """One item; places in 1e-7 degrees, height in metres above home, yaw in degrees clockwise from north.

    Args:
        command: MAV_CMD.
        latitude_e7: north.
        longitude_e7: east.
        height_m: above home.
        hold_s: how long to stay.
        radius_m: nearer than this it is reached.
        heading_deg: 0..360; None: the autopilot's choice.
    """

    command: int
    latitude_e7: int
    longitude_e7: int
    height_m: float
    hold_s: float = 0.0
    radius_m: float = 0.0
    heading_deg: Optional[float] = None

    def message(self, number: int, target: Tuple[int, int]) -> Message:
        """Return it as MISSION_ITEM_INT; the first one is marked as the current one."""
        heading = math.nan if self.heading_deg is None else self.heading_deg
        return mavlink.MAVLink_mission_item_int_message(
            *target,
            number,
            _FRAME,
            self.command,
            int(number == 0),
            1,
            self.hold_s,
            self.radius_m,
            0.0,
            heading,
            self.latitude_e7,
            self.longitude_e7,
            self.height_m,
        )


def mission_items(
    trajectory: Trajectory, home: Home, start: Place, takeoff_height_m: float, radius_m: float, dialect: Dialect
) -> Tuple[MissionItem, ...]:
    """Return the items of one flight.

    Args:
        trajectory: its waypoints.
        home: origin of the waypoints.
        start: where it takes off.
        takeoff_height_m: of the climb.
        radius_m: of acceptance.
        dialect: of the autopilot.
    """
    places = trajectory.places or tuple(home.to_global(each.x_m, each.y_m) for each in trajectory.waypoints)
    waypoints = tuple(
        MissionItem(
            _WAYPOINT,
            *_integers(place),
            waypoint.z_m,
            _hold_s(waypoint.hold_s, dialect),
            radius_m,
            (90.0 - math.degrees(waypoint.yaw_rad)) % 360.0,
        )
        for place, waypoint in zip(places, trajectory.waypoints)
    )
    if dialect is Dialect.ARDUPILOT:
        waypoints = tuple(item for waypoint in waypoints for item in (_turn(waypoint), waypoint))
    takeoff = MissionItem(_TAKEOFF, *_integers(start), takeoff_height_m)
    land = MissionItem(_LAND, *_integers(places[-1]), 0.0)
    place_holder = MissionItem(_WAYPOINT, *_integers(start), 0.0)
    return (*(place_holder,) * dialect.value, takeoff, *waypoints, land)


def _turn(waypoint: MissionItem) -> MissionItem:
    """Return the turn before a waypoint: param1 is the heading, param4 that it is none relative to the present one."""
    return MissionItem(_TURN, 0, 0, 0.0, hold_s=waypoint.heading_deg or 0.0, heading_deg=0.0)


def _hold_s(hold_s: float, dialect: Dialect) -> float:
    """Return a hold as an autopilot keeps it: ArduPilot cuts parts of a second off, so it is told the next one."""
    return float(math.ceil(hold_s)) if dialect is Dialect.ARDUPILOT else hold_s


def _integers(place: Place) -> Tuple[int, int]:
    return round(place.latitude_deg * _DEGREES), round(place.longitude_deg * _DEGREES)


def waypoint_index(number: int, dialect: Dialect) -> int:
    """Return which waypoint an item is, from 0; negative before the first, their count for the landing."""
    return (number - dialect.value - 1) // _EACH[dialect]


def beginning(number: int, dialect: Dialect) -> int:
    """Return the item with which a waypoint begins: the turn before it, where there is one."""
    after_takeoff = number - dialect.value
    return number - 1 if dialect is Dialect.ARDUPILOT and after_takeoff > 1 and after_takeoff % 2 == 0 else number


_Same = Callable[[float, float], bool]


def _within(tolerance: float) -> _Same:
    return lambda sent, read: abs(sent - read) <= tolerance


def _anything(_sent: float, _read: float) -> bool:
    return True


def _whole(sent: float, read: float) -> bool:
    return sent == read


#: field, how much of it each autopilot keeps
_KEPT: Tuple[Tuple[str, Mapping[Dialect, _Same]], ...] = (
    ("command", {Dialect.PX4: _whole, Dialect.ARDUPILOT: _whole}),
    ("x", {Dialect.PX4: _within(2), Dialect.ARDUPILOT: _within(2)}),  # a double of degrees
    ("y", {Dialect.PX4: _within(2), Dialect.ARDUPILOT: _within(2)}),
    ("z", {Dialect.PX4: _within(0.01), Dialect.ARDUPILOT: _within(0.011)}),  # a float; centimetres
    ("param1", {Dialect.PX4: _within(0.01), Dialect.ARDUPILOT: _within(0.01)}),
    ("param4", {Dialect.PX4: lambda sent, read: _turned(sent, read) <= 0.1, Dialect.ARDUPILOT: _anything}),  # noqa: PLR2004 - degrees; not kept
)


_KEPT_OF_TURN = (*_KEPT[:-1], ("param4", dict.fromkeys(Dialect, _whole)))  # param4 is no yaw there


def _turned(sent: float, read: float) -> float:
    """Return the angle between two headings; no heading differs from none."""
    if math.isnan(sent):
        return 0.0
    return abs((read - sent + 180.0) % 360.0 - 180.0) if math.isfinite(read) else math.inf


def difference(items: Sequence[MissionItem], number: int, read: Message, dialect: Dialect) -> str:
    """Return how an item that was read back differs from what was sent; empty when it does not."""
    if number < dialect.value:
        return ""
    if _FRAMES.get(read.frame) is None and read.command not in _NOWHERE:
        return f"item {number} came back in frame {read.frame}"
    sent = items[number].message(number, (0, 0))
    for field, kept in _KEPT_OF_TURN if sent.command == _TURN else _KEPT:
        before, after = getattr(sent, field), getattr(read, field)
        if not kept[dialect](before, after):
            return f"item {number} came back with {field} {_shown(after)} instead of {_shown(before)}"
    return ""


def _shown(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.6g}"
