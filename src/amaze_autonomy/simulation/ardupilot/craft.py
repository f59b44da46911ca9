"""The vehicle as ArduCopter flies it: what lifts off when, where a mission begins, and where it looks.

It looks along its way (WP_YAW_BEHAVIOR), but for a waypoint that it set out for with a turn (CONDITION_YAW) before it.
A turn is good for that waypoint, and forgotten when it leaves AUTO.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Callable, Mapping, Optional, Tuple

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.simulation.px4.craft import Craft
from amaze_autonomy.simulation.px4.missions import Item, MissionServer, Task, Upload
from amaze_autonomy.simulation.px4.wire import DESCEND, OFFBOARD, Parameters
from amaze_autonomy.simulation.vehicle.flight import Mode, VehicleSettings

from ..px4.settings import Geography, Place

# --- modes ------------------------------------------------------------------------------------------------------------
# ArduCopter's flight modes: numbers in HEARTBEAT.custom_mode; inside they have the names of the PX4 modes alike.


STABILIZE, GUIDED = "STABILIZED", OFFBOARD
_NUMBERS: Mapping[str, int] = {
    STABILIZE: 0,
    "ALTCTL": 2,
    Mode.MISSION: 3,  # AUTO
    GUIDED: 4,
    Mode.POSITION: 5,  # LOITER: flown by the sticks
    Mode.RTL: 6,
    Mode.LAND: 9,
    Mode.LOITER: 17,  # BRAKE
}
_SHOWN: Mapping[str, str] = {Mode.TAKEOFF: GUIDED, DESCEND: Mode.LAND, "MANUAL": STABILIZE}
_NAMES: Mapping[int, str] = {number: name for name, number in _NUMBERS.items()}

#: modes in which it can be armed; AUTO only where AUTO_OPTIONS says so
ARMABLE = (STABILIZE, "ALTCTL", GUIDED, Mode.POSITION)
#: modes that need no position
BLIND = (STABILIZE, "ALTCTL", Mode.LAND)


def custom_mode(mode: str) -> int:
    """Return HEARTBEAT.custom_mode."""
    return _NUMBERS[_SHOWN.get(mode, mode)]


def base_mode(*, armed: bool) -> int:
    """Return HEARTBEAT.base_mode."""
    flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    return int(flags | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0))


def mode_of(number: int) -> Optional[str]:
    """Return the mode of a number; None when there is no such mode."""
    return _NAMES.get(number)


# --- store ------------------------------------------------------------------------------------------------------------
# ArduPilot's missions and parameters: item 0 is home, items lose what has no room, integers travel as floats.
#
# It knows CONDITION_YAW, which PX4 refuses.


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


# --- craft ------------------------------------------------------------------------------------------------------------


_NEAR_M = 0.1


class ArduCraft(Craft):
    """It begins in STABILIZE. Item 0 of a mission is home; in AUTO it waits on the ground for MISSION_START.

    Args:
        settings: how it flies.
        t_ns: when it begins.
        geography: where its local frame lies.
    """

    after_takeoff = GUIDED
    home_items = 1
    takeoff_radius_m = 0.0

    def __init__(self, settings: VehicleSettings, t_ns: int = 0, geography: Optional[Geography] = None) -> None:
        super().__init__(settings, t_ns, geography)
        self.mode = self.intended = STABILIZE
        self.started = False
        self.restarts = False  # MIS_RESTART: its mission begins anew whenever it enters AUTO
        self._heading_rad: Optional[float] = None
        self._way_rad: Optional[float] = None

    def arm(self) -> str:
        """Turn the motors on, on the ground."""
        if self.mode not in ARMABLE:
            return "Mode not armable"
        if not self.armed and not self.flags.does_not_arm:
            self._set_armed()
        return ""

    def set_current(self, number: int) -> None:
        """Go on with an item; with 0, home, the mission begins anew, at 1."""
        super().set_current(1 if number == 0 and len(self.items) > 1 else number)
        self.reached = max(0, self.reached - 1)  # home is no waypoint
        self._set_out()

    def fall_into(self, mode: str) -> None:
        """Enter a mode, whoever wants it."""
        if mode == Mode.MISSION and (self.current == 0 or (self.restarts and self.mode != mode)):
            self.set_current(0)
        if mode != Mode.MISSION:
            self.started, self._heading_rad = False, None
        super().fall_into(mode)

    def start_mission(self) -> None:
        """Let it lift off in AUTO."""
        self.started = True
        self._prepare_lift()

    def interrupt_takeoff(self) -> None:
        """Take a set-point during a takeoff in GUIDED: the takeoff is over, wherever it is."""
        if self.mode == Mode.TAKEOFF:
            self.mode, self._lift_at, self._leg = GUIDED, None, None
            if self.airborne:
                self.landed = VehicleLanded.IN_AIR

    def _wants_up(self) -> bool:
        if self.mode == GUIDED or (self.mode == Mode.MISSION and not self.started):
            return False
        return super()._wants_up()

    # --- the mission ----------------------------------------------------------------------------------------------

    def _set_out(self) -> None:
        """Fly to the next place; the first turn on the way there is begun, any other passed over."""
        self._heading_rad = self._way_rad = None
        while self.current + 1 < len(self.items) and self.items[self.current].command == TURN:
            if self._heading_rad is None:
                self._heading_rad = self._heading(self.items[self.current])
            self.current += 1

    def _heading(self, turn: Item) -> float:
        """Return where a turn leads, counter-clockwise from east; clockwise by its angle where it is relative."""
        angle_rad, direction = math.radians(turn.params[0]), turn.params[2]
        if turn.params[3]:
            return self.yaw_rad - math.copysign(angle_rad, direction)
        return math.pi / 2 - angle_rad

    def _next(self, *, took_off: bool = False) -> None:
        super()._next(took_off=took_off)
        if not self.mission_over:
            self._set_out()

    def _current_task(self) -> Optional[Task]:
        task = super()._current_task()
        return task if task is None else dataclasses.replace(task, yaw_rad=self._looks(task))

    def _looks(self, task: Task) -> Optional[float]:
        """Return where it looks on its way to a place; None: as it does."""
        if task.what != "waypoint" or self._heading_rad is not None:
            return self._heading_rad
        east, north = (there - here for there, here in zip(task.across or self.position_m, self.position_m))
        if math.hypot(east, north) >= _NEAR_M:
            self._way_rad = math.atan2(north, east)
        return self._way_rad

    def _finish_on_ground(self) -> None:
        if self.started:  # else it only waits
            super()._finish_on_ground()

    def _set_disarmed(self) -> None:
        mode = self.mode
        super()._set_disarmed()
        self.mode = self.intended = mode
        self.started = False
