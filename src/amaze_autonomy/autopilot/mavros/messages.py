"""What mavros says, as the MAVLink messages that it was made of; by the fields of its messages alone, without ROS.

So one client serves both ways to the vehicle. The table at the end: topic below mavros' namespace, type, what is made.
The names of modes are turned back into numbers, and tell whose they are (`Behind`). Whether ArduPilot has a position is
in EKF_STATUS_REPORT alone, of which mavros makes no topic, and what an autopilot thinks of its battery in the charge
state of BATTERY_STATUS, which mavros' topic leaves out: both are taken from `mavlink/from`, all that mavros receives.
So are texts, of which mavros' topic has each chunk alone, and where an ArduPilot's home and the origin of its local
frame are on the earth, who says our vehicle's id, and what kind of vehicle it is.
"""

from __future__ import annotations

import struct
from math import asin, atan2, isfinite, nan, pi
from typing import Any, Callable, Dict, FrozenSet, Iterable, List, Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.monitoring.gravity import up_of_quaternion

from ..link.dialect import Message, mavlink
from ..link.peers import REMEMBERED_NS, Sources, is_vehicle
from ..vehicle.modes import autopilot_of, mavros_number

VEHICLE = (1, 1)
_PLACE = "mavros"  # from where all of it comes
_HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
EKF, BATTERY = int(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT), int(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS)
TEXT = int(mavlink.MAVLINK_MSG_ID_STATUSTEXT)
HOME, ORIGIN = int(mavlink.MAVLINK_MSG_ID_HOME_POSITION), int(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
_UNKNOWN_AUTOPILOT, _NO_MODE = int(mavlink.MAV_AUTOPILOT_GENERIC), 255  # of PX4 it is 0.0
_NAMES = {mavlink.MAV_AUTOPILOT_PX4: "PX4's", mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: "ArduPilot's"}
_IN_A_ROW = 5  # states that say another autopilot than the known one, disarmed
_FRAMING_OK = 1
_UNKNOWN_MV, _UNKNOWN = 65535, -1
_DEG7 = 1e7
_IN_PART = frozenset(("BATTERY_STATUS", "STATUSTEXT"))  # whose topics leave out what is said, and who says it
_UNRECEIVED = 5  # states with nothing received of our vehicle, after which those topics count
_BATTERIES = 256  # that 8 bits tell apart
_FIRST_CELLS, _CELLS = 10, 14  # of a BATTERY_STATUS: in `voltages`, and with `voltages_ext`
_CHANNELS = 18


class Source(NamedTuple):
    """One topic of mavros.

    Args:
        topic: below the namespace.
        kind: package and type.
        makes: name of the MAVLink message.
        make: returns it; None: it says nothing.
    """

    topic: str
    kind: str
    makes: str
    make: Callable[[Any], Optional[Message]]


class Behind:
    """Which autopilot is behind mavros: the one whose modes it names; nobody's before such a name.

    Both have an ACRO, and a number (`CMODE(25)`) or a name that nobody has says nothing: then it stays. Once known it
    does not change in the air, and on the ground only by several states in a row: as another autopilot the vehicle
    would not understand its landing, and its mission would be off by one.
    """

    def __init__(self) -> None:
        self.autopilot = _UNKNOWN_AUTOPILOT
        self.vehicle = int(mavlink.MAV_TYPE_QUADROTOR)  # until its own heartbeat is received: no topic says it
        self._others = 0

    def add(self, message: Any) -> None:
        """Take a mavros_msgs/State of a connected mavros."""
        named = autopilot_of(message.mode)
        if self.autopilot == _UNKNOWN_AUTOPILOT:
            self.autopilot = self.autopilot if named is None else named
        other = named not in (None, self.autopilot) and not message.armed
        self._others = self._others + 1 if other else 0
        if named is not None and self._others >= _IN_A_ROW:
            self.autopilot, self._others = named, 0

    def problem(self, message: Any) -> str:
        """Return what is wrong with the mode of a mavros_msgs/State, in words; empty when it is one of its own."""
        if not message.connected or not message.mode or mavros_number(self.autopilot, message.mode) is not None:
            return ""
        whose = _NAMES.get(self.autopilot, "neither PX4's nor ArduPilot's")
        kind = f"none of {whose}" if self.autopilot in _NAMES else whose
        return f"mavros says mode {message.mode!r}, which is {kind}: whoever chose it has control"


def _state(message: Any, behind: Behind) -> Message:
    """Return the HEARTBEAT of a mavros_msgs/State; a mode that is not the autopilot's is none that we know."""
    number = mavros_number(behind.autopilot, message.mode)
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    if message.armed:
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    return mavlink.MAVLink_heartbeat_message(
        behind.vehicle,
        behind.autopilot,
        base,
        _NO_MODE if number is None else number,
        message.system_status,
        3,
    )


def _extended_state(message: Any) -> Message:
    return mavlink.MAVLink_extended_sys_state_message(message.vtol_state, message.landed_state)


def _sys_status(message: Any) -> Message:
    return mavlink.MAVLink_sys_status_message(
        message.sensors_present,
        message.sensors_enabled,
        message.sensors_health,
        message.load,
        message.voltage_battery,
        message.current_battery,
        message.battery_remaining,
        0,
        0,
        0,
        0,
        0,
        0,
    )


def _battery(message: Any) -> Message:
    """Return a BATTERY_STATUS; sensor_msgs/BatteryState has NaN for unknown, and negative currents for discharging."""
    cells = [_millivolts(volts) for volts in list(message.cell_voltage)[:_CELLS]]
    cells = cells or [_millivolts(message.voltage)]
    cells += [_UNKNOWN_MV] * (_CELLS - len(cells))
    first, further = cells[:_FIRST_CELLS], [0 if mv == _UNKNOWN_MV else mv for mv in cells[_FIRST_CELLS:]]
    percent = round(100 * message.percentage) if isfinite(message.percentage) else _UNKNOWN
    current = round(-100 * message.current) if isfinite(message.current) else _UNKNOWN
    return mavlink.MAVLink_battery_status_message(
        _battery_number(message),
        0,
        0,
        32767,
        first,
        current,
        _UNKNOWN,
        _UNKNOWN,
        percent if 0 <= percent <= 100 else _UNKNOWN,  # noqa: PLR2004
        voltages_ext=further,
    )


def _battery_number(message: Any) -> int:
    """Return the number of a battery: all come on one topic, "id0", "id1" in `location` tells them apart."""
    number = str(message.location)[len("id") :]
    return int(number) % _BATTERIES if number.isascii() and number.isdecimal() else 0


def _millivolts(volts: float) -> int:
    return round(1000 * volts) if isfinite(volts) and 0 <= volts < 65 else _UNKNOWN_MV  # noqa: PLR2004 - of 16 bits


def _text(message: Any) -> Message:
    """Return a STATUSTEXT; of a longer text mavros publishes each 50 characters alone."""
    return mavlink.MAVLink_statustext_message(message.severity, message.text.encode("utf-8", "replace"))


def _channels(message: Any) -> Message:
    widths = list(message.channels)[:_CHANNELS]
    padded = widths + [_UNKNOWN_MV] * (_CHANNELS - len(widths))
    return mavlink.MAVLink_rc_channels_message(0, len(widths), *padded, message.rssi)


def _estimator(message: Any) -> Message:
    flags = sum(bit for name, bit in _FLAGS if getattr(message, name))
    return mavlink.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0, 0)


_FLAGS: Tuple[Tuple[str, int], ...] = (
    ("attitude_status_flag", 1),
    ("velocity_horiz_status_flag", 2),
    ("velocity_vert_status_flag", 4),
    ("pos_horiz_rel_status_flag", 8),
    ("pos_horiz_abs_status_flag", 16),
    ("pos_vert_abs_status_flag", 32),
    ("pos_vert_agl_status_flag", 64),
    ("const_pos_mode_status_flag", 128),
    ("pred_pos_horiz_rel_status_flag", 256),
    ("pred_pos_horiz_abs_status_flag", 512),
    ("gps_glitch_status_flag", 1024),
    ("accel_error_status_flag", 2048),
)


def _gps(message: Any) -> Message:
    stamp = message.header.stamp
    return mavlink.MAVLink_gps_raw_int_message(
        stamp.secs * 1_000_000 + stamp.nsecs // 1000,
        message.fix_type,
        message.lat,
        message.lon,
        message.alt,
        message.eph,
        message.epv,
        message.vel,
        message.cog,
        message.satellites_visible,
    )


def _pose(message: Any) -> Message:
    """Return a LOCAL_POSITION_NED of mavros' local position, which is east, north, up; its velocity comes apart."""
    where = message.pose.position
    return mavlink.MAVLink_local_position_ned_message(0, where.y, where.x, -where.z, nan, nan, nan)


def _attitude(message: Any) -> Message:
    """Return an ATTITUDE of a sensor_msgs/Imu; unknown where its orientation is none (NaN, all zero).

    Yaw turns from north to the east, mavros' from the east to the north; pitch is up, mavros' down (y is left).
    `imu/data` comes with each ATTITUDE of the vehicle alone. The orientation in mavros' poses is no word of the
    vehicle: level and to the east before its first ATTITUDE, and the last one for ever once they have ended.
    """
    q = message.orientation
    up = up_of_quaternion(q.x, q.y, q.z, q.w)
    if up is None:
        return mavlink.MAVLink_attitude_message(0, nan, nan, nan, nan, nan, nan)
    roll, pitch = atan2(up[1], up[2]), asin(max(-1.0, min(1.0, up[0])))
    yaw = atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    return mavlink.MAVLink_attitude_message(0, roll, pitch, pi / 2 - yaw, nan, nan, nan)


def _global(message: Any) -> Optional[Message]:
    """Return a GLOBAL_POSITION_INT of a NavSatFix; its height above home comes apart."""
    if not (isfinite(message.latitude) and isfinite(message.longitude)):
        return None
    place = round(message.latitude * _DEG7), round(message.longitude * _DEG7)
    return mavlink.MAVLink_global_position_int_message(0, *place, 0, 0, 0, 0, 0, _UNKNOWN_MV)


def _reached(message: Any) -> Message:
    return mavlink.MAVLink_mission_item_reached_message(message.wp_seq)


def _apart(_: Any) -> None:
    """Say nothing by itself."""


def _received(message: Any) -> Optional[Message]:
    """Return the message in a mavros_msgs/Mavlink; MAVLink 2 leaves zeros at the end out of a payload."""
    return _decoded(message, TAKEN_FROM_RECEIVED.get(message.msgid))


def _decoded(message: Any, kind: Any) -> Optional[Message]:
    if kind is None or message.framing_status != _FRAMING_OK or message.len > 8 * len(message.payload64):
        return None
    data = struct.pack(f"<{len(message.payload64)}Q", *message.payload64)[: message.len]
    letters = bytes(kind.native_format).decode("ascii")  # the order of bytes, and one for each field, arrays, too
    fields_of = zip(kind.lengths, kind.array_lengths, letters[1:])
    counted = (f"{array}s" if letter == "c" else f"{length}{letter}" for length, array, letter in fields_of)
    form = struct.Struct(letters[0] + "".join(counted))
    fields = _fields(form.unpack(data.ljust(form.size, b"\0")[: form.size]), kind.lengths)
    return kind(*(fields[place] for place in kind.orders))


def _fields(values: Tuple[Any, ...], lengths: Iterable[int]) -> List[Any]:
    """Return the fields of a payload; one that is longer than 1 is an array, but for characters."""
    fields: List[Any] = []
    at = 0
    for length in lengths:
        fields.append(values[at] if length == 1 else list(values[at : at + length]))
        at += length
    return fields


TAKEN_FROM_RECEIVED: Mapping[int, Any] = {
    EKF: mavlink.MAVLink_ekf_status_report_message,
    BATTERY: mavlink.MAVLink_battery_status_message,
    HOME: mavlink.MAVLink_home_position_message,
    ORIGIN: mavlink.MAVLink_gps_global_origin_message,
    TEXT: mavlink.MAVLink_statustext_message,
}
"""What is taken of all that mavros receives."""

_TELL_OF_SENDER: Mapping[int, Any] = {
    int(kind.id): kind
    for kind in (
        mavlink.MAVLink_heartbeat_message,
        mavlink.MAVLink_system_time_message,
        mavlink.MAVLink_attitude_message,
        mavlink.MAVLink_local_position_ned_message,
    )
}
"""What says when its sender was started, or whether he is armed."""


RECEIVED_OF: Mapping[int, FrozenSet[int]] = {
    mavlink.MAV_AUTOPILOT_PX4: frozenset((BATTERY, TEXT)),  # all else is on a topic
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: frozenset(TAKEN_FROM_RECEIVED),
}
"""What is taken of which autopilot."""


def _home(message: Any) -> Message:
    where = message.position
    return mavlink.MAVLink_home_position_message(0, 0, 0, where.y, where.x, -where.z, [1, 0, 0, 0], 0, 0, 0)


_PARTS_APART = 5  # so many of one part may come without the other
_VELOCITY = Source("local_position/velocity_local", "geometry_msgs/TwistStamped", "LOCAL_POSITION_NED", _apart)
_HEIGHT = Source("global_position/rel_alt", "std_msgs/Float64", "GLOBAL_POSITION_INT", _apart)
STATE = Source("state", "mavros_msgs/State", "HEARTBEAT", _apart)
RECEIVED = Source("mavlink/from", "mavros_msgs/Mavlink", "EKF_STATUS_REPORT", _received)
"""Beside mavros' namespace, not below it."""
WAYPOINTS = Source("mission/waypoints", "mavros_msgs/WaypointList", "MISSION_CURRENT", _apart)
"""What `MavrosMission` reads."""
SOURCES: Tuple[Source, ...] = (
    STATE,
    RECEIVED,
    Source("extended_state", "mavros_msgs/ExtendedState", "EXTENDED_SYS_STATE", _extended_state),
    Source("sys_status", "mavros_msgs/SysStatus", "SYS_STATUS", _sys_status),
    Source("battery", "sensor_msgs/BatteryState", "BATTERY_STATUS", _battery),
    Source("statustext/recv", "mavros_msgs/StatusText", "STATUSTEXT", _text),
    Source("rc/in", "mavros_msgs/RCIn", "RC_CHANNELS", _channels),
    Source("estimator_status", "mavros_msgs/EstimatorStatus", "ESTIMATOR_STATUS", _estimator),
    Source("gpsstatus/gps1/raw", "mavros_msgs/GPSRAW", "GPS_RAW_INT", _gps),
    Source("local_position/pose", "geometry_msgs/PoseStamped", "LOCAL_POSITION_NED", _pose),
    _VELOCITY,
    Source("imu/data", "sensor_msgs/Imu", "ATTITUDE", _attitude),
    Source("global_position/global", "sensor_msgs/NavSatFix", "GLOBAL_POSITION_INT", _global),
    _HEIGHT,
    Source("home_position/home", "mavros_msgs/HomePosition", "HOME_POSITION", _home),
    WAYPOINTS,
    Source("mission/reached", "mavros_msgs/WaypointReached", "MISSION_ITEM_REACHED", _reached),
)


def sources_of(wanted: Iterable[str]) -> Tuple[Source, ...]:
    """Return the topics of which the wanted messages are made."""
    names = frozenset(wanted)
    return tuple(source for source in SOURCES if source.makes in names)


class Converter:
    """Makes MAVLink messages of topics; puts together what comes apart: position and velocity, place and height.

    What mavros receives may be of any vehicle on its link; `target`, system and component, is the one that it flies.

    mavros publishes both parts of one message of the vehicle together: a part whose topic has ended is unknown after a
    few of the other, not what it was last. The topics of batteries and texts have those of all components, and less
    than they said: they count only after some states, one for each heartbeat, with nothing received of our vehicle.
    """

    def __init__(self) -> None:
        self.behind, self.target, self.sources = Behind(), VEHICLE, Sources()
        self._heard_ns: Optional[int] = None  # when anything of ours was received last
        self._others: Dict[int, int] = {}  # system id of another vehicle: when it was heard last
        self._velocity, self._height_mm = (nan, nan, nan), 0
        self._without = {_VELOCITY.makes: _PARTS_APART, _HEIGHT.makes: _PARTS_APART}
        self._unreceived = 0  # states since anything of ours was received

    def note_sender(self, t_ns: int, message: Any) -> None:
        """Note who sent what mavros received at a time: two vehicles that say one id have a count of messages each."""
        if message.framing_status != _FRAMING_OK:
            return
        if message.sysid != self.target[0]:
            self._note_other(t_ns, message)
        if (message.sysid, message.compid) != self.target:
            return
        self._heard_ns, self._unreceived = t_ns, 0
        told = _decoded(message, _TELL_OF_SENDER.get(message.msgid))
        armed = None
        if told is not None and told.get_type() == "HEARTBEAT":
            armed = bool(told.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self.behind.vehicle = int(told.type)
        ours = self.sources.take(t_ns, _PLACE, message.seq, getattr(told, "time_boot_ms", None), armed=armed)
        if ours and armed is not None:
            self.sources.armed = armed

    def _note_other(self, t_ns: int, message: Any) -> None:
        """Note a vehicle of another id: but for heartbeats, mavros takes what it says for what ours says."""
        if message.msgid == _HEARTBEAT and message.compid == mavlink.MAV_COMP_ID_AUTOPILOT1:
            beat = _decoded(message, mavlink.MAVLink_heartbeat_message)
            if beat is not None and is_vehicle(beat):
                self._others[message.sysid] = t_ns

    def forget_senders(self) -> None:
        """Forget who was heard: it was received by another mavros."""
        self.sources, self._heard_ns = Sources(), None
        self._others.clear()

    def strangers(self, t_ns: int) -> Optional[Tuple[str, ...]]:
        """Return what tells of other vehicles; None while nothing comes of what mavros receives of ours."""
        heard = [system for system, heard_ns in self._others.items() if t_ns - heard_ns <= REMEMBERED_NS]
        others = tuple(f"system {system}, by mavros" for system in sorted(heard))
        if self._heard_ns is None or t_ns - self._heard_ns > REMEMBERED_NS:
            return others or None
        return (*self.sources.strangers(t_ns), *others)

    def convert(self, source: Source, message: Any) -> Optional[Message]:
        """Return the MAVLink message of a message on a topic; None: it says nothing by itself."""
        if source is STATE:
            return self._heartbeat(message)
        if source is RECEIVED and (message.sysid, message.compid) != self.target:
            return None
        if source.makes in _IN_PART and self._unreceived < _UNRECEIVED:
            return None
        if source is _VELOCITY:
            speed = message.twist.linear
            self._velocity, self._without[source.makes] = (speed.y, speed.x, -speed.z), 0
        elif source is _HEIGHT and isfinite(message.data):
            self._height_mm, self._without[source.makes] = round(1000 * message.data), 0
        made = source.make(message)
        if made is None or source.makes not in self._without:
            return made
        known = self._without[source.makes] < _PARTS_APART
        self._without[source.makes] += 1
        if source.makes == _VELOCITY.makes:
            made.vx, made.vy, made.vz = self._velocity if known else (nan, nan, nan)
            return made
        made.relative_alt = self._height_mm
        return made if known else None

    def _heartbeat(self, message: Any) -> Optional[Message]:
        """Return the HEARTBEAT of a mavros_msgs/State; None while mavros is not connected to the vehicle."""
        if not message.connected:
            return None
        self._unreceived += 1
        self.behind.add(message)
        return _state(message, self.behind)
