"""The simulated vehicle in the air: straight legs by the flight model of the missions, one mode at a time.

Position is east, north and up of where it stood first (ENU, REP-103), in metres; the ground is flat at 0. A step of any
length ends where many small steps would.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, sqrt
from typing import Dict, List, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.missions import FlightModel, Waypoint, leg_s

# --- leg --------------------------------------------------------------------------------------------------------------
# One straight move of the simulated vehicle: from here to there in a known time.


_S = 1_000_000_000
TRANSMITTER_LOSS_NS = _S // 2  # COM_RC_LOSS_T: until then nobody notices that a receiver makes its channels up

Vector = Tuple[float, float, float]


@dataclass(frozen=True)
class Leg:
    """A straight move at constant speed.

    Args:
        start: ENU position in m.
        end: ENU position in m.
        start_ns: when it begins.
        lasts_ns: how long it takes; at least 1.
    """

    start: Vector
    end: Vector
    start_ns: int
    lasts_ns: int

    @property
    def end_ns(self) -> int:
        """Time of the arrival."""
        return self.start_ns + self.lasts_ns

    @property
    def velocity(self) -> Vector:
        """Velocity in m/s."""
        x, y, z = ((end - start) / self.lasts_ns * _S for start, end in zip(self.start, self.end))
        return (x, y, z)

    def position(self, t_ns: int) -> Vector:
        """Return where it is at a time."""
        if t_ns >= self.end_ns:
            return self.end
        part = max(0, t_ns - self.start_ns) / self.lasts_ns
        x, y, z = (start + (end - start) * part for start, end in zip(self.start, self.end))
        return (x, y, z)


def flight(here: Vector, yaw_rad: float, target: Waypoint, model: FlightModel, t_ns: int) -> Leg:
    """Fly to a waypoint, in the time that the flight model gives for it."""
    start = Waypoint(here[0], here[1], here[2], yaw_rad, 0.0)
    return _leg(here, (target.x_m, target.y_m, target.z_m), leg_s(start, target, model), t_ns)


def climb(here: Vector, height_m: float, model: FlightModel, t_ns: int) -> Leg:
    """Climb straight up to a height, in the time that the flight model gives for it."""
    above = Waypoint(here[0], here[1], height_m, 0.0, 0.0)
    return flight(here, 0.0, above, model, t_ns)


def descent(here: Vector, speed_m_s: float, t_ns: int) -> Leg:
    """Go straight down to the ground."""
    return _leg(here, (here[0], here[1], 0.0), here[2] / speed_m_s, t_ns)


def _leg(start: Vector, end: Vector, seconds: float, t_ns: int) -> Leg:
    return Leg(start, end, t_ns, max(1, round(seconds * _S)))


# --- flight -----------------------------------------------------------------------------------------------------------


_ARRIVED_M = 1e-9
_CRUISE_LEAN_RAD = 0.06
_STILL: Vector = (0.0, 0.0, 0.0)
_LOWEST_M = 0.01  # of flight: only a landing touches the ground


class Mode:
    """Names of flight modes as PX4 gives them."""

    LOITER = "AUTO.LOITER"
    TAKEOFF = "AUTO.TAKEOFF"
    MISSION = "AUTO.MISSION"
    LAND = "AUTO.LAND"
    RTL = "AUTO.RTL"
    POSITION = "POSCTL"


LANDING_MODES = (Mode.LAND, Mode.RTL)


@dataclass(frozen=True)
class VehicleSettings:
    """How the vehicle flies.

    Args:
        takeoff_height_m: height at which the takeoff ends.
        model: its speeds.
        arm_ns: from the takeoff command to armed.
        spin_up_ns: from armed to lift-off.
        ground_ns: from touching the ground to ON_GROUND.
        disarm_ns: from ON_GROUND to the automatic disarming.
        idle_disarm_ns: how long it stays armed on the ground when no takeoff follows.
        blind_ns: from the loss of the GPS until it gives its position up, as recorded.
    """

    takeoff_height_m: float = 1.0
    model: FlightModel = field(default_factory=FlightModel)
    arm_ns: int = _S // 2
    spin_up_ns: int = 3 * _S // 2
    ground_ns: int = 1 * _S
    disarm_ns: int = 2 * _S
    idle_disarm_ns: int = 10 * _S
    blind_ns: int = 5_280_000_000


class Pose(NamedTuple):
    """What sensors see of the vehicle.

    Args:
        airborne: it does not stand on the ground.
        position_m: ENU.
        velocity_m_s: ENU.
        yaw_rad: counter-clockwise from east.
        tilt_rad: angle between its z axis and the vertical; its nose is down.
        raised_m: height of what it stands on, where its range sensor looks past.
    """

    airborne: bool
    position_m: Vector
    velocity_m_s: Vector
    yaw_rad: float
    tilt_rad: float
    raised_m: float


@dataclass
class Flags:
    """What a fault has broken in the vehicle, and what a person has done to it."""

    does_not_arm: bool = False
    does_not_lift_off: bool = False
    stops_climbing_at_m: float = inf
    ignores: Tuple[str, ...] = ()
    does_not_descend: bool = False
    does_not_disarm: bool = False
    tilt_rad: float = 0.0
    lean_rad: float = 0.0
    raised_m: float = 0.0
    gps_lost: bool = False
    land_switch: bool = False
    not_ready: Dict[str, str] = field(default_factory=dict)


class Flight:
    """Where the vehicle is, what it is told to do, and how it moves through the air."""

    after_takeoff = Mode.MISSION

    def __init__(self, settings: VehicleSettings, t_ns: int = 0) -> None:
        self.settings = settings
        self.flags = Flags()
        self.t_ns = t_ns
        self.position_m: Vector = (0.0, 0.0, 0.0)
        self.velocity_m_s: Vector = _STILL
        self.yaw_rad = 0.0
        self.mode = Mode.LOITER
        self.landed = VehicleLanded.ON_GROUND
        self.pilot = False
        self.waypoints: Tuple[Waypoint, ...] = ()
        self.reached = 0
        self.happened: List[str] = []
        self._top_m = settings.takeoff_height_m
        self._leg: Optional[Leg] = None
        self._leave_at: Optional[int] = None
        self._pilot_lands_at: Optional[int] = None
        self._ground_since: int = t_ns

    @property
    def height_m(self) -> float:
        """Height above the ground."""
        return self.position_m[2]

    @property
    def airborne(self) -> bool:
        """True while it does not stand on the ground."""
        return self.position_m[2] > 0.0

    @property
    def finished(self) -> bool:
        """True when it has been at the last waypoint for as long as it should."""
        return self.reached >= len(self.waypoints) > 0 and self._leave_at is None

    @property
    def tilt_rad(self) -> float:
        """Angle between the vehicle's z axis and the vertical: what it stands on, or the lean of its flight."""
        if not self.airborne:
            return self.flags.tilt_rad
        return max(self.flags.lean_rad, _CRUISE_LEAN_RAD * min(1.0, _across(self.velocity_m_s)))

    @property
    def pose(self) -> Pose:
        """What sensors see of it now."""
        return Pose(self.airborne, self.position_m, self.velocity_m_s, self.yaw_rad, self.tilt_rad, self.flags.raised_m)

    def _lift_off(self) -> None:
        self.position_m = (self.position_m[0], self.position_m[1], _LOWEST_M)
        self.landed = VehicleLanded.TAKING_OFF
        self.happened.append("airborne")

    def _fly(self, end_ns: int) -> None:
        if self.mode == Mode.TAKEOFF:
            self._climb(end_ns)
        elif self.mode == Mode.MISSION:
            self._follow(end_ns)
        elif self.mode == Mode.LAND:
            self._descend(end_ns)
        elif self.mode == Mode.RTL:
            self._return(end_ns)
        elif self.pilot and self._pilot_lands_at is not None:
            self._pilot_flies(end_ns, self._pilot_lands_at)
        else:
            self._stay(end_ns)

    def _climb(self, end_ns: int) -> None:
        top = self._top_m
        if self.height_m < min(top, self.flags.stops_climbing_at_m) - _ARRIVED_M:
            height = min(top, self.flags.stops_climbing_at_m)
            self._go(self._leg or climb(self.position_m, height, self.settings.model, self.t_ns), end_ns)
        elif self.height_m >= top - _ARRIVED_M:
            self.landed = VehicleLanded.IN_AIR
            self._set_mode(self.after_takeoff)
        else:
            self._stay(end_ns)

    def _follow(self, end_ns: int) -> None:
        if self._leave_at is not None:
            self._stay(min(end_ns, max(self._leave_at, self.t_ns)))
            if self._leave_at <= self.t_ns:
                self._leave_at = None
        elif self.reached >= len(self.waypoints):
            self._stay(end_ns)
        elif self._go(self._leg or self._next_leg(), end_ns):
            self._reach(self.waypoints[self.reached])

    def _next_leg(self) -> Leg:
        target = self.waypoints[self.reached]
        height = max(_LOWEST_M, min(target.z_m, max(self.flags.stops_climbing_at_m, self.height_m)))
        there = Waypoint(target.x_m, target.y_m, height, target.yaw_rad, target.hold_s)
        return flight(self.position_m, self.yaw_rad, there, self.settings.model, self.t_ns)

    def _reach(self, target: Waypoint) -> None:
        self.landed = VehicleLanded.IN_AIR
        self.yaw_rad = target.yaw_rad
        self.reached += 1
        self._leave_at = self.t_ns + round(target.hold_s * _S) if target.hold_s > 0 else None
        self.happened.append("waypoint")

    def _descend(self, end_ns: int) -> None:
        self.landed = VehicleLanded.LANDING
        if self.flags.does_not_descend:
            self._stay(end_ns)
        elif self._go(self._leg or descent(self.position_m, self.settings.model.landing_speed_m_s, self.t_ns), end_ns):
            self._touch()

    def _return(self, end_ns: int) -> None:
        height = self.height_m
        if _across(self.position_m) <= _ARRIVED_M:
            self._descend(end_ns)
        else:
            home = Waypoint(0.0, 0.0, height, self.yaw_rad, 0.0)
            self._go(self._leg or flight(self.position_m, self.yaw_rad, home, self.settings.model, self.t_ns), end_ns)

    def _pilot_flies(self, end_ns: int, lands_at: int) -> None:
        if self.t_ns < lands_at:
            self._stay(min(end_ns, lands_at))
        elif self._go(self._leg or descent(self.position_m, self.settings.model.landing_speed_m_s, self.t_ns), end_ns):
            self._touch()

    def _touch(self) -> None:
        self.position_m = (self.position_m[0], self.position_m[1], 0.0)
        self._stop()
        self._ground_since = self.t_ns

    def _go(self, leg: Leg, end_ns: int) -> bool:
        """Go along a leg until `end_ns`; return whether its end was reached (then time stands at the arrival)."""
        self.t_ns = min(end_ns, leg.end_ns)
        self.position_m, self.velocity_m_s = leg.position(self.t_ns), leg.velocity
        arrived = self.t_ns >= leg.end_ns
        self._leg = None if arrived else leg
        return arrived

    def _stay(self, end_ns: int) -> None:
        self._stop()
        self.t_ns = end_ns

    def _stop(self) -> None:
        self._leg = None
        self.velocity_m_s = _STILL

    def _set_mode(self, mode: str) -> None:
        if mode == self.mode:
            return
        self.mode = mode
        self._stop()
        if self.airborne and mode in (Mode.LOITER, Mode.MISSION) and self.landed == VehicleLanded.LANDING:
            self.landed = VehicleLanded.IN_AIR
        self.happened.append(_MODE_EVENTS.get(mode, "mode"))


def _across(vector: Vector) -> float:
    """Return the horizontal part of a vector; `hypot` rounds differently on Python 3.8 and 3.11."""
    return sqrt(vector[0] * vector[0] + vector[1] * vector[1])


_MODE_EVENTS = {
    Mode.LOITER: "hold",
    Mode.TAKEOFF: "climb",
    Mode.MISSION: "mission",
    Mode.LAND: "land",
    Mode.RTL: "return",
    Mode.POSITION: "pilot",
}
