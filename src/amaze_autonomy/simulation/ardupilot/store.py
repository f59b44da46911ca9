"""ArduPilot's missions and parameters: item 0 is home, items lose what has no room, integers travel as floats.

It knows CONDITION_YAW, which PX4 refuses.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Callable, Optional, Tuple

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.simulation.px4.geography import Place
from amaze_autonomy.simulation.px4.items import Item
from amaze_autonomy.simulation.px4.mission_server import MissionServer, Upload
from amaze_autonomy.simulation.px4.parameters import Parameters

__all__ = ["TURN", "ArduMissions", "ArduParameters"]

TURN = mavlink.MAV_CMD_CONDITION_YAW


class ArduMissions(MissionServer):
    """Asks for every item with MISSION_REQUEST; keeps whole seconds, heights in centimetres and no yaw of a waypoint.

    Args:
        capacity: items that can be kept.
        home: returns what item 0 is.
    """

    def __init__(self, capacity: int, home: Callable[[], Place]) -> None:
        super().__init__(capacity)
        self._home = home

    def _ask(self, t_ns: int) -> Any:
        self._in_ints = False
        return super()._ask(t_ns)

    def _problem(self, item: Item) -> int:
        return 0 if item.command == TURN else super()._problem(item)

    def _store(self, kind: int, items: Tuple[Item, ...], current: Optional[int]) -> None:
        kept = tuple(_kept(item) for item in items)
        if kind == mavlink.MAV_MISSION_TYPE_MISSION and items:
            home = self._home()
            first = Item(0, mavlink.MAV_CMD_NAV_WAYPOINT, 1, (0.0,) * 4, home.lat, home.lon, home.altitude_m)
            kept = (first, *kept[1:])
        super()._store(kind, kept, current)
        if self.uploaded is not None:
            self.uploaded = Upload(kept, None)  # the number of the mission before stays, whatever is marked


def _kept(item: Item) -> Item:
    """Return what is left of an item: whole seconds, no yaw, centimetres; of a turn all but its place."""
    if item.command == TURN:
        return dataclasses.replace(item, frame=0, x=0, y=0, z=0.0)
    first, second, third, _ = item.params
    whole = float(int(first)) if math.isfinite(first) else 0.0
    return dataclasses.replace(item, params=(whole, second, third, 0.0), z=round(item.z, 2))


class ArduParameters(Parameters):
    """An integer is told as the float of its value."""

    def _value(self, name: str, count: int, index: int) -> Any:
        value = self._values[name]
        kind = mavlink.MAV_PARAM_TYPE_INT32 if isinstance(value, int) else mavlink.MAV_PARAM_TYPE_REAL32
        return mavlink.MAVLink_param_value_message(name.encode("ascii"), float(value), kind, count, index)
