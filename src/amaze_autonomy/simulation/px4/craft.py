"""The simulated vehicle as PX4 flies it: arming and modes apart, missions of items, set-points.

Motion, land detection, faults and who has control are those of `simulation.vehicle`; only what PX4 decides is here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Tuple

from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.missions import Waypoint
from amaze_autonomy.simulation.vehicle.flight import Mode, VehicleSettings
from amaze_autonomy.simulation.vehicle.vehicle import Vehicle

from ..vehicle.flight import Leg, Vector, descent, flight
from .missions import Item, Task, task_of
from .settings import Geography
from .wire import DESCEND, OFFBOARD

_S = 1_000_000_000
_NEAR_M = 0.01
_STICKS_FREE_M_S = 0.5  # how fast it sinks in POSCTL without a transmitter, as recorded
_TAKEOFF_RADIUS_M = 0.8  # NAV_MC_ALT_RAD: recorded, an item of 10 m was done with at 9.2 to 9.4 m
_NO_ARMING = (Mode.LAND, Mode.RTL, DESCEND)
_MISSION_DISARM_NS = _S // 20


@dataclass(frozen=True)
class SetPoint:
    """What an offboard computer asks for; either a position or a velocity.

    Args:
        position_m: ENU; None: the velocity counts.
        velocity_m_s: ENU.
        yaw_rad: counter-clockwise from east; None: as it is.
    """

    position_m: Optional[Vector]
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    yaw_rad: Optional[float] = None


class Craft(Vehicle):
    """The vehicle that PX4 controls; commands return why they are refused, or nothing.

    Args:
        settings: how it flies.
        t_ns: when it begins.
        geography: where its local frame lies.
    """

    after_takeoff = Mode.LOITER
    home_items = 0  # with which its missions begin
    takeoff_radius_m = _TAKEOFF_RADIUS_M  # so far below its height a takeoff item is done with

    def __init__(self, settings: VehicleSettings, t_ns: int = 0, geography: Optional[Geography] = None) -> None:
        super().__init__(settings, t_ns)
        self.geography = geography or Geography()
        self.home = self.geography.place(0.0, 0.0, 0.0)
        self.items: Tuple[Item, ...] = ()
        self.current = 0
        self.item_reached = -1
        self.mission_over = False
        self.takeoff_m: Optional[float] = None
        self.set_point: Optional[SetPoint] = None
        self.intended = Mode.LOITER
        self._intended_on_ground = Mode.LOITER
        self._landed_by_mission = False

    # --- commands -------------------------------------------------------------------------------------------------

    def load_items(self, items: Tuple[Item, ...], current: Optional[int]) -> None:
        """Take a mission.

        Args:
            items: of the mission.
            current: where it begins; None: no item was marked as the current one, so the old number stays.
        """
        self.items = items
        self.waypoints = tuple(_waypoint(self._task(item)) for item in items if self._task(item).what == "waypoint")
        self.set_current(min(self.current, max(0, len(items) - 1)) if current is None else current)
        if items:
            self.happened.append("loaded")

    def set_current(self, number: int) -> None:
        """Go on with an item of the mission."""
        self.current, self.item_reached, self.mission_over = number, -1, False
        self.reached = sum(self._task(item).what == "waypoint" for item in self.items[:number])
        self._leave_at = None
        self._stop()

    def arm(self) -> str:
        """Turn the motors on, on the ground."""
        if self.armed:
            return ""
        if self.flags.not_ready:
            return ", ".join(sorted(self.flags.not_ready.values()))
        if self.mode in _NO_ARMING:
            return f"{self.mode} is no mode to arm in"
        if self.mode == Mode.MISSION and not self.items:
            return "no valid mission available"
        if not self.flags.does_not_arm:
            self._set_armed()
        return ""

    def command_mode(self, mode: str) -> None:
        """Enter a mode that a user asked for; whether that can be is the caller's business."""
        if mode in self.flags.ignores:
            return
        self.intended = mode
        if mode not in _NO_ARMING:
            self._intended_on_ground = mode
        self.pilot = self.failsafe = False
        self._pilot_lands_at = None
        self.fall_into(mode)

    def fall_into(self, mode: str) -> None:
        """Enter a mode, whoever wants it."""
        if not self.armed:
            self.mode = mode
            return
        if mode == Mode.MISSION and not self.airborne:
            self.mode = mode  # it begins to follow its waypoints once it has taken off
        else:
            self._set_mode(mode)
        self._prepare_lift()

    def climb_to(self, up_m: float) -> None:
        """Take off, to a height above the origin."""
        self.takeoff_m = up_m
        self.command_mode(Mode.TAKEOFF)

    def lose_gps(self) -> None:
        """Take the GPS away; what follows from that is PX4's own business (`health.py`)."""
        self.flags.gps_lost = True

    # --- on the ground --------------------------------------------------------------------------------------------

    def _set_armed(self) -> None:
        super()._set_armed()
        self._landed_by_mission = False
        self.home = self.geography.place(*self.position_m)
        self._prepare_lift()

    def _prepare_lift(self) -> None:
        """Begin to turn the propellers up, when the mode wants to leave the ground."""
        if self.armed and not self.airborne and self._lift_at is None and self._wants_up():
            self._lift_at = self.t_ns + self.settings.spin_up_ns
            self._top_m = self.settings.takeoff_height_m if self.takeoff_m is None else max(0.1, self.takeoff_m)
            self.happened.append("takeoff")

    def _wants_up(self) -> bool:
        if self.mode == Mode.MISSION:
            task = self._current_task()
            return task is not None and task.what not in ("land", "return")
        if self.mode == OFFBOARD and self.set_point is not None:
            goal = self.set_point
            return goal.position_m[2] > self.height_m + 0.2 if goal.position_m else goal.velocity_m_s[2] > 0.0
        return self.mode == Mode.TAKEOFF

    def _stand(self, end_ns: int) -> None:
        if self.mode == Mode.MISSION and not self._wants_up():
            self._finish_on_ground()
        elif self.mode == OFFBOARD:
            self._prepare_lift()
        super()._stand(end_ns)

    def _finish_on_ground(self) -> None:
        """Be done with a mission whose item is to land: the vehicle stands on the ground already."""
        if self.landed == VehicleLanded.ON_GROUND and not self.mission_over:
            self.mission_over = self._landed_by_mission = True
            self.item_reached = self.current
            self._ground_since = self.t_ns - self.settings.ground_ns

    def _disarm_wait_ns(self) -> int:
        if self._landed_by_mission:
            return self.settings.ground_ns + _MISSION_DISARM_NS
        return super()._disarm_wait_ns()

    def _set_disarmed(self) -> None:
        was_armed = self.armed
        super()._set_disarmed()
        if was_armed:
            self.mode = self.intended = self._intended_on_ground
            self.takeoff_m = None
            self.home = self.geography.place(*self.position_m)

    # --- in the air -----------------------------------------------------------------------------------------------

    def _fly(self, end_ns: int) -> None:
        if self.mode == OFFBOARD:
            self._follow_set_point(end_ns)
        elif self.mode == DESCEND:
            self._sink(end_ns, self.settings.model.landing_speed_m_s)
        elif self.mode == Mode.POSITION and not self.pilot:
            self._sink(end_ns, _STICKS_FREE_M_S)
        elif self.mode == Mode.TAKEOFF:
            self._climb(end_ns)
            if self.mode == Mode.LOITER:
                self.intended = self._intended_on_ground = Mode.LOITER
        else:
            super()._fly(end_ns)

    def _sink(self, end_ns: int, speed_m_s: float) -> None:
        if self._go(self._leg or descent(self.position_m, speed_m_s, self.t_ns), end_ns):
            self._touch()

    def _follow_set_point(self, end_ns: int) -> None:
        goal = self.set_point
        if goal is None:
            self._stay(end_ns)
            return
        self.landed = VehicleLanded.IN_AIR
        if goal.yaw_rad is not None:
            self.yaw_rad = goal.yaw_rad
        if goal.position_m is not None:
            self._approach(goal.position_m, end_ns)
        elif goal.velocity_m_s == (0.0, 0.0, 0.0):
            self._stay(end_ns)
        else:
            self._drive(goal.velocity_m_s, end_ns)

    def _approach(self, goal: Vector, end_ns: int) -> None:
        if self._leg is None or math.dist(self._leg.end, goal) > _NEAR_M:
            if math.dist(self.position_m, goal) <= _NEAR_M:
                self._stay(end_ns)
                return
            there = Waypoint(goal[0], goal[1], max(0.0, goal[2]), self.yaw_rad, 0.0)
            self._leg = flight(self.position_m, self.yaw_rad, there, self.settings.model, self.t_ns)
        if self._go(self._leg, end_ns) and not self.airborne:
            self._touch()

    def _drive(self, velocity: Vector, end_ns: int) -> None:
        if velocity[2] < 0.0:
            end_ns = min(end_ns, self.t_ns + max(1, math.ceil(-self.height_m / velocity[2] * _S)))
        x, y, z = (at + speed * (end_ns - self.t_ns) / _S for at, speed in zip(self.position_m, velocity))
        self._leg = None
        self.t_ns, self.position_m, self.velocity_m_s = end_ns, (x, y, max(0.0, z)), velocity
        if not self.airborne:
            self._touch()

    # --- the mission ----------------------------------------------------------------------------------------------

    def _task(self, item: Item) -> Task:
        return task_of(item, self.home, self.geography)

    def _current_task(self) -> Optional[Task]:
        """Return what is to be done now; None when the mission is over."""
        if self.mission_over or self.current >= len(self.items):
            return None
        return self._task(self.items[self.current])

    def _follow(self, end_ns: int) -> None:
        task = self._current_task()
        if self._leave_at is not None:
            self._stay(min(end_ns, max(self._leave_at, self.t_ns)))
            if self._leave_at <= self.t_ns:
                self._leave_at = None
                self._next()
        elif task is None or task.what == "stay":
            self._stay(end_ns)
        elif task.what == "land":
            self._land_there(task, end_ns)
        elif task.what == "return":
            self._return(end_ns)
        elif task.what == "delay":
            self._leave_at = self.t_ns + round(task.hold_s * _S)
        elif task.what == "pass":
            self._next()
        elif self._go(self._leg or self._leg_to(task), end_ns):
            self._arrive(task)

    def _leg_to(self, task: Task) -> Leg:
        """Fly to an item; a takeoff goes straight up."""
        x, y = task.across if task.across and task.what != "takeoff" else self.position_m[:2]
        up = self.position_m[2] if task.up_m is None else self._done_m(task)
        height = max(_NEAR_M, min(up, max(self.flags.stops_climbing_at_m, self.height_m)))
        yaw = self.yaw_rad if task.yaw_rad is None else task.yaw_rad
        return flight(self.position_m, self.yaw_rad, Waypoint(x, y, height, yaw, 0.0), self.settings.model, self.t_ns)

    def _arrive(self, task: Task) -> None:
        if task.what == "takeoff" and self.height_m < self._done_m(task) - _NEAR_M:
            self._leave_at = None  # it does not get there; it tries on
            self._stay(self.t_ns + _S // 10)
            return
        if task.yaw_rad is not None:
            self.yaw_rad = task.yaw_rad
        self.landed = VehicleLanded.IN_AIR
        if task.what == "waypoint":
            self.reached += 1
            self.happened.append("waypoint")
        if task.hold_s > 0.0:
            self._leave_at = self.t_ns + round(task.hold_s * _S)
        else:
            self._next(took_off=task.what == "takeoff")

    def _done_m(self, task: Task) -> float:
        """Return the height at which it is done with an item: a takeoff is over a little below its own."""
        below_m = self.takeoff_radius_m if task.what == "takeoff" else 0.0
        return max(_NEAR_M, (task.up_m or 0.0) - below_m)

    def _next(self, *, took_off: bool = False) -> None:
        """Be done with an item."""
        self.item_reached = self.current
        if took_off:
            self.happened.append("mission")
        if self.current + 1 < len(self.items):
            self.current += 1
        else:
            self.mission_over = True

    def _land_there(self, task: Task, end_ns: int) -> None:
        if task.across and math.dist(task.across, self.position_m[:2]) > _NEAR_M and self.landed != _LANDING:
            above = Waypoint(task.across[0], task.across[1], self.height_m, self.yaw_rad, 0.0)
            self._go(self._leg or flight(self.position_m, self.yaw_rad, above, self.settings.model, self.t_ns), end_ns)
            return
        if self.landed != _LANDING:
            self.happened.append("land")
            self._leg = None
        self._descend(end_ns)


_LANDING = VehicleLanded.LANDING


def _waypoint(task: Task) -> Waypoint:
    x, y = task.across or (0.0, 0.0)
    return Waypoint(x, y, task.up_m or 0.0, task.yaw_rad or 0.0, task.hold_s)
