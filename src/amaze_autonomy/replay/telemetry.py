"""MAVLink as a recording: a telemetry log (.tlog), or the frames that mavros put into a bag (mavros_msgs/Mavlink).

It has the face of a bag. Its topics are made of what the vehicle sent:

/mavlink/NAME       each message by its name, fields as in MAVLink, e.g. /mavlink/GPS_RAW_INT; of the vehicle's other
                    components what the autopilot does not send itself
/mavlink/imu        HIGHRES_IMU, else RAW_IMU (mG), in the axes of ROS (x forward, y left, z up) and SI
/autopilot/status   what the autopilot node would have said: the code is that of the live link
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Tuple

from amaze_autonomy.bags import BagError, Entry, Recording, Topic
from amaze_autonomy.config import AutopilotSettings

from ..autopilot.link.dialect import mavlink
from ..autopilot.link.framing import Counter, Frame, TlogCount, TlogError, read_tlog
from ..autopilot.link.peers import Identity, Peers
from ..autopilot.link.wire import decode
from ..autopilot.vehicle.vehicle import WANTED, VehicleState

__all__ = ["Status", "Telemetry", "imu", "status", "topics_of_log"]


_S = 1_000_000_000
_STATUS, _IMU, _PREFIX = "/autopilot/status", "/mavlink/imu", "/mavlink/"
_PERIOD_NS = _S // 5
_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
_NOBODY = Identity(255, 1, vehicle=0)  # nobody's address: what was addressed to others is taken, too


class Telemetry:
    """MAVLink frames with their times.

    Args:
        path: of the file that they are from.
        frames: time in ns and frame, in any order.
        counter: of the file's reader, complete when `frames` are used up.
    """

    def __init__(self, path: Path, frames: Iterable[Tuple[int, Frame]], counter: Optional[Counter] = None) -> None:
        self.path = path
        self._frames = sorted(frames, key=lambda each: each[0])
        self._count = counter
        self._places: Dict[str, List[Tuple[int, int]]] = {}
        self._statuses: List[Status] = []
        self._read()
        self.topics: Tuple[Topic, ...] = tuple(
            Topic(name, _kind(name), len(places), places[0][0], places[-1][0])
            for name, places in sorted(self._places.items())
        )

    @classmethod
    def of_log(cls, path: Path) -> Telemetry:
        """Read a telemetry log.

        Raises:
            BagError: It cannot be read, or is none.
        """
        return cls(path, *_frames(path))

    @classmethod
    def of_bag(cls, recording: Recording, topics: Iterable[str]) -> Telemetry:
        """Read the frames that topics of a bag carry."""
        frames = [
            (entry.t_ns, _frame_of(recording.message(entry))) for topic in topics for entry in recording.entries(topic)
        ]
        return cls(recording.path, frames)

    @property
    def count(self) -> Optional[TlogCount]:
        """What was in the log; None for a bag."""
        return None if self._count is None else self._count.count

    def __enter__(self) -> Telemetry:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close nothing: all has been read."""

    @property
    def start_ns(self) -> Optional[int]:
        """Time of the first message of the vehicle; None when there is none."""
        return min((topic.first_ns for topic in self.topics), default=None)

    @property
    def end_ns(self) -> Optional[int]:
        """Time of the last message; None when there is none."""
        return max((topic.last_ns for topic in self.topics), default=None)

    def entries(self, topic: str) -> List[Entry]:
        """Return all messages of a topic in their order."""
        number = sorted(self._places).index(topic) if topic in self._places else 0
        return [Entry(t_ns, 0, 0, at, number) for t_ns, at in self._places.get(topic, ())]

    def message(self, entry: Entry) -> Any:
        """Return one message."""
        topic = self.topics[entry.connection].name
        if topic == _STATUS:
            return self._statuses[entry.offset]
        message = decode(self._frames[entry.offset][1])
        return imu(entry.t_ns, message) if topic == _IMU else message

    def columns(self, wanted: Mapping[str, Any]) -> Dict[str, Any]:  # noqa: ARG002 - the face of a bag
        """Return nothing: every message is read by itself."""
        return {}

    def _read(self) -> None:
        """Sort the vehicle's frames by topic, and let the link's code listen to them."""
        vehicle, teller = _vehicle(self._frames), _Teller(self._tell)
        own = {frame.number for _, frame in self._frames if _sender(frame) == (vehicle, _AUTOPILOT)}
        for at, (t_ns, frame) in enumerate(self._frames):
            teller.until(t_ns)
            if _sender(frame) != (vehicle, _AUTOPILOT):
                if (
                    frame.system == vehicle and frame.number not in own
                ):  # e.g. a range finder that is a component itself
                    self._place(_PREFIX + _name(frame.number), t_ns, at)
                continue
            name = _name(frame.number)
            self._place(_PREFIX + name, t_ns, at)
            if name == "HIGHRES_IMU" or (name == "RAW_IMU" and _PREFIX + "HIGHRES_IMU" not in self._places):
                self._place(_IMU, t_ns, at)
            if name in WANTED:
                teller.take(t_ns, decode(frame))

    def _place(self, topic: str, t_ns: int, at: int) -> None:
        self._places.setdefault(topic, []).append((t_ns, at))

    def _tell(self, t_ns: int, vehicle: VehicleState) -> None:
        self._place(_STATUS, t_ns, len(self._statuses))
        self._statuses.append(status(t_ns, vehicle))


def _sender(frame: Frame) -> Tuple[int, int]:
    return frame.system, frame.component


def _vehicle(frames: Iterable[Tuple[int, Frame]]) -> Optional[int]:
    """Return the system id of the first autopilot that beats."""
    peers = Peers(_NOBODY)
    for t_ns, frame in frames:
        if frame.number == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            peers.take(t_ns, decode(frame))
            if peers.vehicle is not None:
                return peers.vehicle
    return None


class _Teller:
    """Says when the autopilot node would have published: five times a second, and at once on a change.

    It begins with the first heartbeat: that none came before says something of the recording, not of the vehicle. It
    goes on to the end, so that a vehicle that falls silent is seen to.
    """

    def __init__(self, tell: Callable[[int, VehicleState], None]) -> None:
        self._tell, self._vehicle = tell, VehicleState(AutopilotSettings())
        self._due_ns: Optional[int] = None
        self._said: Any = None

    def until(self, t_ns: int) -> None:
        """Publish what is due before a time."""
        while self._due_ns is not None and self._due_ns < t_ns:
            self._tell(self._due_ns, self._vehicle)
            self._due_ns += _PERIOD_NS

    def take(self, t_ns: int, message: Any) -> None:
        """Take a message of the vehicle."""
        vehicle = self._vehicle
        vehicle.receive(t_ns, message)
        beat = vehicle.beat
        if beat is None:
            return
        if self._due_ns is None:
            self._due_ns = t_ns + _PERIOD_NS
        key = (beat[1:], vehicle.landed(t_ns), vehicle.control.pilot, tuple(vehicle.health(t_ns).items()))
        if key != self._said:
            self._said = key
            self._tell(t_ns, vehicle)


def topics_of_log(path: Path) -> List[str]:
    """Return the topics that a log may have, without listening to it."""
    numbers = {frame.number for _, frame in _frames(path)[0]}
    return [_STATUS, _IMU, *sorted(_PREFIX + _name(number) for number in numbers)]


def _frames(path: Path) -> Tuple[Iterable[Tuple[int, Frame]], Counter]:
    try:
        return read_tlog(path)
    except TlogError as error:
        raise BagError(str(path), str(error).split(": ", 1)[-1].split("; ")[0], "must be a telemetry log") from None


def _frame_of(message: Any) -> Frame:
    """Return the frame of a mavros_msgs/Mavlink: its payload comes in words of 8 bytes, the lowest first."""
    payload = b"".join(int(word).to_bytes(8, "little") for word in message.payload64)[: int(message.len)]
    return Frame(
        int(message.msgid), int(message.seq), int(message.sysid), int(message.compid), payload, b"", signed=False
    )


def _name(number: int) -> str:
    kind = mavlink.mavlink_map.get(number)
    return f"MESSAGE_{number}" if kind is None else str(kind.msgname)


def _kind(topic: str) -> str:
    kinds = {_STATUS: "amaze_autonomy/AutopilotStatus", _IMU: "sensor_msgs/Imu"}
    return kinds.get(topic, "mavlink/" + topic[len(_PREFIX) :])


# --- telemetry messages -----------------------------------------------------------------------------------------------
# What a telemetry log tells, as the messages that a bag would hold: fields as in ROS, made of MAVLink.


_HEALTH = {None: 0, True: 1, False: 2}
_MILLI_G = 9.80665e-3
_SENSORS = ("gps", "imu", "magnetometer", "barometer")


@dataclass(frozen=True)
class _Stamp:
    sec: int
    nanosec: int


@dataclass(frozen=True)
class _Header:
    stamp: _Stamp


@dataclass(frozen=True)
class _Vector:
    x: float
    y: float
    z: float


@dataclass(frozen=True)
class _Imu:
    header: _Header
    linear_acceleration: _Vector
    angular_velocity: _Vector


@dataclass(frozen=True)
class Status:
    """Fields as in msg/AutopilotStatus."""

    header: _Header
    link_age: float
    armed_known: bool
    armed: bool
    landed: int
    mode: str
    pilot_in_control: bool
    failsafe: bool
    height_valid: bool
    height: float
    position_valid: bool
    position_x: float
    position_y: float
    vertical_speed: float
    horizontal_speed: float
    battery_fraction: float
    battery_voltage: float
    battery_age: float
    battery_critical: bool
    gps: int
    imu: int
    magnetometer: int
    barometer: int


def _header(t_ns: int) -> _Header:
    return _Header(_Stamp(t_ns // _S, t_ns % _S))


def imu(t_ns: int, message: Any) -> _Imu:
    """Return an IMU sample: forward, right, down becomes forward, left, up."""
    scale, turn = (1.0, 1.0) if message.get_type() == "HIGHRES_IMU" else (_MILLI_G, 1e-3)
    acceleration = _Vector(message.xacc * scale, -message.yacc * scale, -message.zacc * scale)
    rates = _Vector(message.xgyro * turn, -message.ygyro * turn, -message.zgyro * turn)
    return _Imu(_header(t_ns), acceleration, rates)


def _number(value: Optional[float]) -> float:
    return nan if value is None else float(value)


def status(t_ns: int, vehicle: VehicleState) -> Status:
    """Return what the autopilot node would say of a vehicle at a time."""
    said, health = vehicle.status(t_ns), vehicle.health(t_ns)
    return Status(
        header=_header(t_ns),
        link_age=_number(said.link_age_s),
        armed_known=said.armed is not None,
        armed=bool(said.armed),
        landed=said.landed.value,
        mode=said.mode,
        pilot_in_control=said.pilot_in_control,
        failsafe=said.failsafe,
        height_valid=said.height_m is not None,
        height=_number(said.height_m),
        position_valid=said.position_x_m is not None,
        position_x=_number(said.position_x_m),
        position_y=_number(said.position_y_m),
        vertical_speed=_number(said.vertical_speed_m_s),
        horizontal_speed=_number(said.horizontal_speed_m_s),
        battery_fraction=_number(said.battery_fraction),
        battery_voltage=_number(said.battery_voltage_v),
        battery_age=_number(said.battery_age_s),
        battery_critical=said.battery_critical,
        **{name: _HEALTH[health[name]] for name in _SENSORS},
    )
