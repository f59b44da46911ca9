"""What PX4 says inside, as a recording: its uORB topics in a ULog, or in a ROS 2 bag behind uXRCE-DDS (px4_msgs).

They are turned into the MAVLink that PX4 makes of them, and the code of the live link listens to that, so that a ULog
is judged as the flight would have been. Made are, with the face of a bag:

/autopilot/status   what the autopilot node would have said
/px4/imu            sensor_combined as sensor_msgs/Imu, in the axes of ROS (x forward, y left, z up)
/px4/odometry       vehicle_local_position and vehicle_attitude as nav_msgs/Odometry: east, north, up
/px4/range          the distance_sensor that looks down, as sensor_msgs/Range

A message that is damaged, or is not as PX4 has it, costs itself: what is missing by it is said in `problem`.
"""

from __future__ import annotations

from bisect import bisect_right
from math import isfinite, nan, sqrt
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from amaze_autonomy.autopilot.vehicle.modes import px4_number
from amaze_autonomy.bags import Entry
from amaze_autonomy.bags.errors import MessageError, UndecodableError

from ...autopilot.link.dialect import mavlink
from .telemetry import KINDS, Imu, Made, Teller, Vector, header, unread_words

VEHICLE_KIND = "px4_msgs/VehicleStatus"
_S = 1_000_000_000
_BEAT_NS = _S // 2
_IMU, _ODOMETRY, _RANGE = "/px4/imu", "/px4/odometry", "/px4/range"
_KINDS = {**KINDS, _IMU: "sensor_msgs/Imu", _ODOMETRY: "nav_msgs/Odometry", _RANGE: "sensor_msgs/Range"}
_ARMED, _LOOKS_DOWN = 2, 25
_NAV_STATES: Mapping[int, str] = {
    0: "MANUAL",
    1: "ALTCTL",
    2: "POSCTL",
    3: "AUTO.MISSION",
    4: "AUTO.LOITER",
    5: "AUTO.RTL",
    6: "POSCTL",  # slow
    10: "ACRO",
    12: "AUTO.LAND",  # descend
    13: "TERMINATION",
    14: "OFFBOARD",
    15: "STABILIZED",
    17: "AUTO.TAKEOFF",
    18: "AUTO.LAND",
    19: "AUTO.FOLLOW_TARGET",
    20: "AUTO.PRECLAND",
    21: "POSCTL",  # orbit, flown by the sticks
    22: "AUTO.VTOL_TAKEOFF",
}
_TAKES_OFF, _LANDS = (17, 22), (12, 18, 20)
_SETPOINTS: Mapping[int, int] = {3: mavlink.MAV_LANDED_STATE_TAKEOFF, 4: mavlink.MAV_LANDED_STATE_LANDING}
"""What a set-point of position_setpoint_triplet means by its type, in a mode that PX4 flies by itself."""

_UNUSABLE = (AttributeError, TypeError, ValueError, IndexError, OverflowError)
"""What comes of a message that lacks a field, or has values that no sensor has, as an infinite latitude."""
_UNKNOWN_MV = 65535
_FLAGS: Tuple[Tuple[str, int], ...] = (
    ("xy_valid", mavlink.ESTIMATOR_POS_HORIZ_REL),
    ("z_valid", mavlink.ESTIMATOR_POS_VERT_ABS),
    ("v_xy_valid", mavlink.ESTIMATOR_VELOCITY_HORIZ),
    ("v_z_valid", mavlink.ESTIMATOR_VELOCITY_VERT),
)


class Uorb(Made):
    """The topics that are made of PX4's own.

    Args:
        source: the recording that has them; it stays open as long as this one.
    """

    def __init__(self, source: Any) -> None:
        super().__init__(source.path)
        self._source = source
        self._state = _Px4State()
        self._teller = Teller(self.tell)
        self._unread: Dict[str, List[Tuple[int, str]]] = {}  # by topic of the source: times and reasons
        self._entries: Dict[str, List[Entry]] = {}
        for topic, kind in ((_IMU, "SensorCombined"), (_ODOMETRY, "VehicleLocalPosition")):
            self._entries[topic] = self._of(kind)
            for at, entry in enumerate(self._entries[topic]):
                self.place(topic, entry.t_ns, at)
        self._attitudes = self._of("VehicleAttitude")
        self._attitude_times = [entry.t_ns for entry in self._attitudes]
        self._entries[_RANGE] = [entry for entry in self._of("DistanceSensor") if self._looks_down(entry)]
        for at, entry in enumerate(self._entries[_RANGE]):
            self.place(_RANGE, entry.t_ns, at)
        self._listen()

    @property
    def problem(self) -> str:
        """Which messages of PX4 cannot be read, and why; empty: none."""
        return "; ".join(unread_words(topic, wrong, self._source.start_ns) for topic, wrong in self._unread.items())

    def made(self, topic: str, entry: Entry) -> Any:
        """Return one message that is no status.

        Raises:
            MessageError: It is damaged, or not as PX4 has it.
        """
        return _made_of(lambda: self._made(topic, entry))

    def _made(self, topic: str, entry: Entry) -> Any:
        source = self._source.message(self._entries[topic][entry.offset])
        if topic == _IMU:
            return Imu(header(entry.t_ns), _flu(source.accelerometer_m_s2), _flu(source.gyro_rad))
        if topic == _RANGE:
            least, most = float(source.min_distance), float(source.max_distance)
            distance_m = float(source.current_distance)
            return SimpleNamespace(header=header(entry.t_ns), range=distance_m, min_range=least, max_range=most)
        place = bisect_right(self._attitude_times, entry.t_ns) - 1
        attitude = self._source.message(self._attitudes[place]) if place >= 0 else None
        return _odometry(entry.t_ns, source, attitude)

    def kind(self, topic: str) -> str:
        """Return the type of a topic."""
        return _KINDS[topic]

    def _of(self, kind: str) -> List[Entry]:
        """Return the messages of a type: of the first topic that has it, where there are several."""
        topics = [topic.name for topic in self._source.topics if topic.kind == f"px4_msgs/{kind}" and topic.messages]
        return self._source.entries(topics[0]) if topics else []

    def _looks_down(self, entry: Entry) -> bool:
        return bool(self._read(entry, lambda message: int(message.orientation) == _LOOKS_DOWN))

    def _read(self, entry: Entry, take: Callable[[Any], Any]) -> Any:
        """Return what is made of a message; None, and a note, when it cannot be read."""
        try:
            return _made_of(lambda: take(self._source.message(entry)))
        except MessageError as error:
            topic = self._source.channels[entry.connection].topic
            self._unread.setdefault(topic, []).append((entry.t_ns, str(error)))
            return None

    def _listen(self) -> None:
        """Let the link's code listen to what PX4 would have sent."""
        takers: Mapping[str, Callable[[Any], Any]] = {
            "VehicleStatus": self._state.take_status,
            "VehicleLandDetected": self._state.take_landed,
            "PositionSetpointTriplet": self._state.take_setpoint,
            "VehicleLocalPosition": _local_position,
            "HomePosition": _home,
            "BatteryStatus": _battery,
            "VehicleGpsPosition": _gps,
            "SensorGps": _gps,
        }
        said = [(entry, taker) for kind, taker in takers.items() for entry in self._of(kind)]
        beat_ns: Optional[int] = None
        for entry, taker in sorted(said, key=lambda each: each[0].t_ns):
            self._teller.until(entry.t_ns)
            messages = self._read(entry, taker)
            if messages is None:
                continue
            if self._state.beats and (beat_ns is None or entry.t_ns - beat_ns >= _BEAT_NS):
                beat_ns = entry.t_ns  # uORB says what has changed, MAVLink says it again and again
                messages = [*self._state.beat(), *messages]
            for message in messages:
                self._teller.take(entry.t_ns, message)
        if said and self._source.end_ns is not None:
            self._teller.until(self._source.end_ns)


class _Px4State:
    """What PX4 tells in its heartbeat and EXTENDED_SYS_STATE."""

    def __init__(self) -> None:
        self._status: Optional[Tuple[bool, int, bool]] = None  # armed, nav_state, in a failsafe
        self._landed: Optional[bool] = None
        self._setpoint: Optional[Tuple[bool, int]] = None  # whether it is valid, and its type

    @property
    def beats(self) -> bool:
        """Whether its state is known."""
        return self._status is not None

    def take_status(self, message: Any) -> List[Any]:
        """Take a vehicle_status."""
        armed, failsafe = int(message.arming_state) == _ARMED, bool(getattr(message, "failsafe", False))
        self._status = armed, int(message.nav_state), failsafe
        return self.beat()

    def take_landed(self, message: Any) -> List[Any]:
        """Take a vehicle_land_detected."""
        self._landed = bool(message.landed)
        return self._extended()

    def take_setpoint(self, message: Any) -> List[Any]:
        """Take a position_setpoint_triplet: a mission climbs and lands in one mode, what it does stands here."""
        self._setpoint = bool(message.current.valid), int(message.current.type)
        return self._extended()

    def beat(self) -> List[Any]:
        """Return the messages that say all of it."""
        if self._status is None:
            return []
        armed, nav_state, failsafe = self._status
        main, sub = px4_number(_NAV_STATES.get(nav_state, "")) or (0, nav_state)
        state = mavlink.MAV_STATE_ACTIVE if armed else mavlink.MAV_STATE_STANDBY
        if failsafe and armed:
            state = mavlink.MAV_STATE_CRITICAL
        mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
        kind, px4 = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4
        beat = mavlink.MAVLink_heartbeat_message(kind, px4, mode, main << 16 | sub << 24, state, 3)
        return [beat, *self._extended()]

    def _extended(self) -> List[Any]:
        """Return EXTENDED_SYS_STATE; nothing while what it says is not known."""
        if self._status is None or self._landed is None:
            return []
        _, nav_state, _ = self._status
        landed = mavlink.MAV_LANDED_STATE_IN_AIR
        if self._landed:
            landed = mavlink.MAV_LANDED_STATE_ON_GROUND
        elif self._setpoint is not None:
            valid, kind = self._setpoint
            alone = _NAV_STATES.get(nav_state, "").startswith("AUTO.") and valid
            landed = _SETPOINTS.get(kind, landed) if alone else landed
        elif nav_state in _TAKES_OFF:
            landed = mavlink.MAV_LANDED_STATE_TAKEOFF
        elif nav_state in _LANDS:
            landed = mavlink.MAV_LANDED_STATE_LANDING
        return [mavlink.MAVLink_extended_sys_state_message(0, landed)]


def _made_of(make: Callable[[], Any]) -> Any:
    """Return what is made of a message.

    Raises:
        MessageError: The message cannot be read, or is not as PX4 has it.
    """
    try:
        return make()
    except MessageError:
        raise
    except _UNUSABLE as error:
        raise UndecodableError(f"it is not as PX4 has it: {error or type(error).__name__}") from error


def _local_position(message: Any) -> List[Any]:
    """Return LOCAL_POSITION_NED, and ESTIMATOR_STATUS with the flags of the same message."""
    boot_ms = int(message.timestamp) // 1000 & 0xFFFFFFFF
    values = (float(getattr(message, name)) for name in ("x", "y", "z", "vx", "vy", "vz"))
    flags = sum(flag for name, flag in _FLAGS if getattr(message, name, False))
    ratios = [0.0] * 8
    return [
        mavlink.MAVLink_estimator_status_message(int(message.timestamp), flags, *ratios),
        mavlink.MAVLink_local_position_ned_message(boot_ms, *values),
    ]


def _home(message: Any) -> List[Any]:
    if not getattr(message, "valid_lpos", True):
        return []
    x, y, z = float(message.x), float(message.y), float(message.z)
    return [mavlink.MAVLink_home_position_message(0, 0, 0, x, y, z, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0)]


def _battery(message: Any) -> List[Any]:
    if not getattr(message, "connected", True):
        return []
    volts, left = float(message.voltage_v), float(message.remaining)
    known = isfinite(volts) and 0.0 < volts * 1000 < _UNKNOWN_MV
    voltages = [round(volts * 1000) if known else _UNKNOWN_MV, *[_UNKNOWN_MV] * 9]
    percent = int(left * 100 + 1e-6) if isfinite(left) and 0.0 <= left <= 1.0 else -1
    amperes = float(message.current_a)
    current = round(amperes * 100) if isfinite(amperes) and 0.0 <= amperes < 327.0 else -1  # noqa: PLR2004
    warning = int(message.warning)
    state = warning + 1 if 0 <= warning <= 4 else 0  # noqa: PLR2004  (both count ok, low, critical, emergency, failed)
    number = max(0, int(getattr(message, "id", 0)))
    parts = (number, 0, 0, 0, voltages, current, -1, -1, percent, 0, state, [0, 0, 0, 0])
    return [mavlink.MAVLink_battery_status_message(*parts)]


def _gps(message: Any) -> List[Any]:
    if hasattr(message, "latitude_deg"):  # since 1.14
        place = tuple(round(each) for each in (message.latitude_deg * 1e7, message.longitude_deg * 1e7))
        above = round(message.altitude_msl_m * 1000)
    else:
        place, above = (int(message.lat), int(message.lon)), int(message.alt)
    stamp, fix, seen = int(message.timestamp), int(message.fix_type), int(message.satellites_used)
    speed = min(_UNKNOWN_MV, max(0, round(float(message.vel_m_s) * 100))) if isfinite(message.vel_m_s) else _UNKNOWN_MV
    unknown = _UNKNOWN_MV
    return [mavlink.MAVLink_gps_raw_int_message(stamp, fix, *place, above, unknown, unknown, speed, unknown, seen)]


def _flu(value: Any) -> Vector:
    """Return a vector of forward, right, down as forward, left, up."""
    return Vector(float(value[0]), -float(value[1]), -float(value[2]))


def _odometry(t_ns: int, local: Any, attitude: Optional[Any]) -> Any:
    """Return nav_msgs/Odometry: what PX4 does not stand by is no number."""
    flat, up = (0.0 if local.xy_valid else nan), (0.0 if local.z_valid else nan)
    position = Vector(float(local.y) + flat, float(local.x) + flat, -float(local.z) + up)
    velocity = Vector(float(local.vy), float(local.vx), -float(local.vz))
    turn = _east_north_up(attitude.q) if attitude is not None else SimpleNamespace(x=nan, y=nan, z=nan, w=nan)
    pose = SimpleNamespace(pose=SimpleNamespace(position=position, orientation=turn), covariance=[0.0] * 36)
    return SimpleNamespace(
        header=header(t_ns), pose=pose, twist=SimpleNamespace(twist=SimpleNamespace(linear=velocity))
    )


def _east_north_up(q: Any) -> Any:
    """Return an attitude (w, x, y, z; forward, right, down in north, east, down) in the axes of ROS.

    It is turned by (0, 1/sqrt 2, 1/sqrt 2, 0) before, from north, east, down, and by (0, 1, 0, 0) behind.
    """
    w, x, y, z = (float(each) for each in q)
    half = sqrt(0.5)
    a, b, c, d = -half * (x + y), half * (w + z), half * (w - z), half * (y - x)
    return SimpleNamespace(w=-b, x=a, y=d, z=-c)
