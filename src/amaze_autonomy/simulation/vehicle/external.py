"""A vehicle that is flown elsewhere: a real autopilot, in software-in-the-loop or on the bench. Pure.

The world's sensors and landing detection follow what it says of itself on a link of its own, which no fault touches:
where a simulated autopilot tells the truth of its simulator (PX4's HIL_STATE_QUATERNION, ArduPilot's SIM_STATE), that;
else what it estimates. The place where it is heard first, on the ground, is the origin; the ground is flat there.

What it is told to do is not the world's business, so faults that act on the vehicle itself have no effect here and are
refused (`as_external`). A PX4 sensor cannot be made unhealthy from outside: its topics stop instead.
"""

from __future__ import annotations

import dataclasses
from math import acos, atan2, cos, pi
from typing import Callable, Iterable, List, Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.autopilot.vehicle.asked import Rates
from amaze_autonomy.autopilot.vehicle.modes import mode_name
from amaze_autonomy.engine.events import VehicleLanded

from ...autopilot.link.dialect import Message, mavlink, source_of
from ...autopilot.planner.mission_upload import Dialect, beginning, waypoint_index
from ..errors import NoEffectError
from ..scenario import KINDS, Fault, Scenario, Subject
from .flight import Vector
from .vehicle import Mode, Vehicle, VehicleSettings

_S = 1_000_000_000
_TRUTH_AGE_NS = _S
_LIFTED_M, _LOWEST_M = 0.05, 0.01
_METRES_PER_DEGREE = 111_319.49

_RATES_HZ: Mapping[str, float] = {
    "HIL_STATE_QUATERNION": 30.0,
    "SIM_STATE": 30.0,
    "LOCAL_POSITION_NED": 20.0,
    "ATTITUDE": 20.0,
    "EXTENDED_SYS_STATE": 5.0,
    "HEARTBEAT": 5.0,
}
WANTED = (*_RATES_HZ, "MISSION_ITEM_REACHED")
"""Messages that an observer looks at."""

_LANDED: Mapping[int, VehicleLanded] = {
    mavlink.MAV_LANDED_STATE_ON_GROUND: VehicleLanded.ON_GROUND,
    mavlink.MAV_LANDED_STATE_TAKEOFF: VehicleLanded.TAKING_OFF,
    mavlink.MAV_LANDED_STATE_IN_AIR: VehicleLanded.IN_AIR,
    mavlink.MAV_LANDED_STATE_LANDING: VehicleLanded.LANDING,
}


class Place(NamedTuple):
    """Where the vehicle is: metres east, north, up of anywhere, metres per second, and what its attitude is."""

    position_m: Vector
    velocity_m_s: Vector
    yaw_rad: float
    tilt_rad: float


class Observer:
    """What the vehicle says of itself; a client of a link (`autopilot.hosting.Client`).

    Each attribute is replaced whole, so that another thread may look.
    """

    def __init__(self) -> None:
        self.place: Optional[Place] = None
        self.armed, self.mode, self.landed = False, "", VehicleLanded.UNKNOWN
        self.reached: Tuple[int, ...] = ()
        """Waypoints, from 1, in the order in which they were reached."""
        self._item: Optional[int] = None
        self._dialect = Dialect.PX4
        self._attitude = (0.0, 0.0)
        self._truth_ns: Optional[int] = None
        self._start: Optional[Tuple[float, float]] = None
        self._rates = Rates(_RATES_HZ)
        self._address = (1, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._readers: Mapping[str, Callable[[int, Message], None]] = {
            "HEARTBEAT": self._heartbeat,
            "EXTENDED_SYS_STATE": self._landed_state,
            "HIL_STATE_QUATERNION": self._px4_truth,
            "SIM_STATE": self._ardupilot_truth,
            "LOCAL_POSITION_NED": self._estimate,
            "ATTITUDE": self._estimated_attitude,
            "MISSION_ITEM_REACHED": self._item_reached,
        }

    def receive(self, t_ns: int, message: Message, *, heard: bool = True) -> Iterable[Message]:  # noqa: ARG002
        """Take a message of the vehicle."""
        name = message.get_type()
        self._rates.heard(t_ns, name)
        self._address = source_of(message)
        read = self._readers.get(name)
        if read is not None:
            read(t_ns, message)
        return ()

    def wake(self, t_ns: int, *, read: bool = True) -> List[Message]:  # noqa: ARG002 (it sends no command)
        """Ask for what does not come."""
        return self._rates.wake(t_ns, *self._address)

    def _heartbeat(self, _: int, message: Message) -> None:
        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.mode = mode_name(message.autopilot, message.custom_mode)
        ardupilot = message.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        self._dialect = Dialect.ARDUPILOT if ardupilot else Dialect.PX4

    def _landed_state(self, _: int, message: Message) -> None:
        self.landed = _LANDED.get(message.landed_state, VehicleLanded.UNKNOWN)

    def _px4_truth(self, t_ns: int, message: Message) -> None:
        position = self._across(message.lat, message.lon, message.alt / 1000.0)
        velocity = (message.vy / 100.0, message.vx / 100.0, -message.vz / 100.0)
        w, x, y, z = message.attitude_quaternion
        yaw = _yaw(w * z + x * y, 0.5 - (y * y + z * z))
        self._tell_truth(t_ns, Place(position, velocity, pi / 2 - yaw, _between(1.0 - 2.0 * (x * x + y * y))))

    def _ardupilot_truth(self, t_ns: int, message: Message) -> None:
        position = self._across(message.lat_int, message.lon_int, message.alt)
        velocity = (message.ve, message.vn, -message.vd)
        tilt = _between(cos(message.roll) * cos(message.pitch))
        self._tell_truth(t_ns, Place(position, velocity, pi / 2 - message.yaw, tilt))

    def _tell_truth(self, t_ns: int, place: Place) -> None:
        self.place, self._truth_ns = place, t_ns

    def _estimated_attitude(self, _: int, message: Message) -> None:
        self._attitude = (pi / 2 - message.yaw, _between(cos(message.roll) * cos(message.pitch)))

    def _estimate(self, t_ns: int, message: Message) -> None:
        if self._truth_ns is None or t_ns - self._truth_ns > _TRUTH_AGE_NS:
            position, velocity = (message.y, message.x, -message.z), (message.vy, message.vx, -message.vz)
            self.place = Place(position, velocity, *self._attitude)

    def _item_reached(self, _: int, message: Message) -> None:
        if message.seq == self._item:
            return
        self._item = message.seq
        if self.landed != VehicleLanded.ON_GROUND and _is_waypoint(message.seq, self._dialect):  # else the landing
            self.reached = (*self.reached, waypoint_index(message.seq, self._dialect) + 1)

    def _across(self, latitude_e7: int, longitude_e7: int, altitude_m: float) -> Vector:
        """Return metres from the first place; a flight is short, so the earth is flat."""
        latitude, longitude = latitude_e7 * 1e-7, longitude_e7 * 1e-7
        if self._start is None:
            self._start = latitude, longitude
        north, east = latitude - self._start[0], longitude - self._start[1]
        east_m = east * _METRES_PER_DEGREE * cos(self._start[0] * pi / 180.0)
        return east_m, north * _METRES_PER_DEGREE, altitude_m


class ExternalVehicle(Vehicle):
    """A vehicle that is where its observer says.

    Args:
        settings: as every vehicle's.
        t_ns: time at which the world begins.
        seen: what the vehicle says of itself.
    """

    def __init__(self, settings: VehicleSettings, t_ns: int, seen: Observer) -> None:
        super().__init__(settings, t_ns)
        self._seen = seen
        self._origin: Optional[Vector] = None
        self._tilt_rad = 0.0
        self._counted = 0

    def advance(self, t_ns: int) -> None:
        """Look where the vehicle is now; what happened since the last look is appended to `happened`."""
        self.t_ns = max(self.t_ns, t_ns)
        place = self._seen.place
        if place is None:
            return
        flew = self.airborne
        self._move(place)
        self._note_armed()
        if self.airborne and not flew:
            self._flew = True
            self.happened.append("airborne")
        self._note_mode()
        self._note_ground()
        for number in self._seen.reached[self._counted :]:
            self._counted += 1
            self.reached = number
            self.happened.append("waypoint")

    def _move(self, place: Place) -> None:
        on_ground = self._seen.landed == VehicleLanded.ON_GROUND or not self._seen.armed
        if self._origin is None:
            self._origin = place.position_m
        east, north, up = (at - origin for at, origin in zip(place.position_m, self._origin))
        lifted = up > _LIFTED_M and not on_ground
        self.position_m = (east, north, max(_LOWEST_M, up) if lifted else 0.0)
        self.velocity_m_s = place.velocity_m_s if lifted else (0.0, 0.0, 0.0)
        self.yaw_rad, self._tilt_rad = place.yaw_rad, place.tilt_rad

    @property
    def tilt_rad(self) -> float:
        """Angle between the vehicle's z axis and the vertical; on the ground also what it is made to stand on."""
        return self._tilt_rad if self.airborne else self.flags.tilt_rad

    def _note_armed(self) -> None:
        if self._seen.armed != self.armed:
            self.armed = self._seen.armed
            self.happened.append("armed" if self.armed else "disarmed")
            if self.armed:
                self._flew = False
                self.happened.append("takeoff")

    def _note_mode(self) -> None:
        if self._seen.mode not in ("", self.mode):
            self.mode = self._seen.mode
            if self.armed and self.mode in _EVENTS:
                self.happened.append(_EVENTS[self.mode])

    def _note_ground(self) -> None:
        if self._seen.landed != self.landed:
            self.landed = self._seen.landed
            if self.landed == VehicleLanded.ON_GROUND and self._flew:
                self.happened.append("landed")


def _is_waypoint(number: int, dialect: Dialect) -> bool:
    """Tell home, takeoff and turns from waypoints, and from what comes after them with ArduPilot: the landing."""
    begins_before = beginning(number, dialect) != number
    return waypoint_index(number, dialect) >= 0 and (begins_before or dialect is Dialect.PX4)


_EVENTS: Mapping[str, str] = {
    Mode.LOITER: "hold",
    Mode.MISSION: "mission",
    Mode.LAND: "land",
    Mode.POSITION: "pilot",
}
_OF_SENSORS = ("tilted", "raised", "not_initialised")
OF_DATA = ("data_incomplete", "recording_does_not_grow", "recording_fails")
"""Faults that act on the simulated recorder alone."""


def as_external(scenario: Scenario) -> Scenario:
    """Return a scenario as it acts on a vehicle that is flown elsewhere: what is unhealthy is silent.

    Raises:
        NoEffectError: a fault acts on the vehicle itself.
    """
    return dataclasses.replace(scenario, faults=tuple(_as_external(fault) for fault in scenario.faults))


def _as_external(fault: Fault) -> Fault:
    if fault.kind.subject == Subject.COMPONENT and fault.kind.name in ("unhealthy", "unreported"):
        return dataclasses.replace(fault, kind=KINDS[Subject.COMPONENT, "silent"])
    if fault.kind.subject == Subject.WORLD and fault.kind.name not in (*_OF_SENSORS, *OF_DATA):
        raise NoEffectError(str(fault), "the vehicle is flown elsewhere: do it there", fault.where)
    return fault


def _between(cosine: float) -> float:
    return acos(min(1.0, max(-1.0, cosine)))


def _yaw(sine: float, cosine: float) -> float:
    return atan2(sine, cosine)
