"""MAVLink as a recording: a telemetry log (.tlog), or the frames that mavros put into a bag (mavros_msgs/Mavlink).

It has the face of a bag. Its topics are made of what the vehicle sent:

/mavlink/NAME       each message by its name, fields as in MAVLink, e.g. /mavlink/GPS_RAW_INT; of the vehicle's other
                    components what the autopilot does not send itself
/mavlink/DISTANCE_SENSOR_N  where range finders look in several directions: those of orientation N that do not look down
/mavlink/imu        HIGHRES_IMU, else RAW_IMU (mG), in the axes of ROS (x forward, y left, z up) and SI
/autopilot/status   what the autopilot node would have said: the code is that of the live link
"""

from __future__ import annotations

import abc
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Collection, Dict, Iterable, List, Mapping, Optional, Tuple

import numpy as np

from amaze_autonomy.autopilot.link.wire import decode
from amaze_autonomy.bags import BagError, Entry, Recording, Topic
from amaze_autonomy.bags.arrays import set_back
from amaze_autonomy.bags.errors import MessageError, cut_words
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.interface import health_fields, status_of

from ...autopilot.link.dialect import mavlink
from ...autopilot.link.framing import Counter, Frame, TlogCount, TlogError, read_tlog
from ...autopilot.link.peers import Identity, Peers
from ...autopilot.vehicle.vehicle import WANTED, VehicleState
from .sources import JUMP_NS

_S = 1_000_000_000
STATUS, _IMU, _PREFIX = "/autopilot/status", "/mavlink/imu", "/mavlink/"
KINDS: Mapping[str, str] = {STATUS: "amaze_autonomy/AutopilotStatus", _IMU: "sensor_msgs/Imu"}
_PERIOD_NS = _S // 5
_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
_SLOWEST_NS = 20 * _S
# a limit of the link, and what it limits: telemetry that comes more slowly than twice in it is no silence
_AGES: Tuple[Tuple[str, str, Tuple[str, ...]], ...] = (
    ("limits", "link_age_limit_ns", ("HEARTBEAT",)),
    ("limits", "mode_age_limit_ns", ("HEARTBEAT",)),
    (
        "limits",
        "state_age_limit_ns",
        ("EXTENDED_SYS_STATE", "LOCAL_POSITION_NED", "ESTIMATOR_STATUS", "EKF_STATUS_REPORT", "ATTITUDE"),
    ),
    ("limits", "system_age_limit_ns", ("SYS_STATUS",)),
    ("gps", "age_limit_ns", ("GPS_RAW_INT",)),
    ("gps", "frozen_limit_ns", ("GPS_RAW_INT",)),
)
_NOBODY = Identity(255, 1, vehicle=0)  # nobody's address: what was addressed to others is taken, too


class Made(abc.ABC):
    """Topics that are made of what a recording holds in another form, with the face of a bag.

    Args:
        path: of the file that they are from.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._places: Dict[str, List[Tuple[int, int]]] = {}
        self._statuses: List[Any] = []

    def __enter__(self) -> Made:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close nothing: all has been read."""

    @property
    def topics(self) -> Tuple[Topic, ...]:
        """Its topics, by name."""
        return tuple(
            Topic(name, self.kind(name), len(places), places[0][0], places[-1][0])
            for name, places in sorted(self._places.items())
        )

    @property
    def start_ns(self) -> Optional[int]:
        """Time of the first message of the vehicle; None when there is none."""
        return min((places[0][0] for places in self._places.values()), default=None)

    @property
    def end_ns(self) -> Optional[int]:
        """Time of the last message; None when there is none."""
        return max((places[-1][0] for places in self._places.values()), default=None)

    def entries(self, topic: str) -> List[Entry]:
        """Return all messages of a topic in their order."""
        number = self._names.index(topic) if topic in self._names else 0
        return [Entry(t_ns, 0, 0, at, number) for t_ns, at in self._places.get(topic, ())]

    def message(self, entry: Entry) -> Any:
        """Return one message."""
        topic = self._names[entry.connection]
        return self._statuses[entry.offset] if topic == STATUS else self.made(topic, entry)

    @abc.abstractmethod
    def made(self, topic: str, entry: Entry) -> Any:
        """Return one message that is no status."""

    @abc.abstractmethod
    def kind(self, topic: str) -> str:
        """Return the type of a topic."""

    def columns(self, wanted: Mapping[str, Any]) -> Dict[str, Any]:  # noqa: ARG002 - the face of a bag
        """Return nothing: every message is read by itself."""
        return {}

    @property
    def _names(self) -> List[str]:
        if len(self._sorted) != len(self._places):
            self._sorted = sorted(self._places)
        return self._sorted

    _sorted: List[str] = []  # noqa: RUF012  (replaced, never changed)

    def place(self, topic: str, t_ns: int, at: int) -> None:
        """Note a message: its time, and its number where it comes from."""
        self._places.setdefault(topic, []).append((t_ns, at))

    def tell(self, t_ns: int, vehicle: VehicleState) -> None:
        """Note a status."""
        self.place(STATUS, t_ns, len(self._statuses))
        self._statuses.append(status(t_ns, vehicle))


def messages_of(bag: Any, topic: str, unread: List[str]) -> List[Tuple[int, Any]]:
    """Return the messages of a topic with their times; a line on those that cannot be read is added to `unread`."""
    found: List[Tuple[int, Any]] = []
    wrong: List[Tuple[int, str]] = []
    for entry in bag.entries(topic):
        try:
            found.append((entry.t_ns, bag.message(entry)))
        except MessageError as error:
            wrong.append((entry.t_ns, str(error)))
    if wrong:
        unread.append(unread_words(topic, wrong, bag.start_ns))
    return found


def unread_words(topic: str, wrong: List[Tuple[int, str]], start_ns: int) -> str:
    """Return which messages of a topic cannot be read.

    Args:
        topic: its name.
        wrong: time of each such message, and why.
        start_ns: of the recording.
    """
    (first_ns, reason), (last_ns, _) = wrong[0], wrong[-1]
    times = f"from {(first_ns - start_ns) / _S:+.3f} s to {(last_ns - start_ns) / _S:+.3f} s"
    return f"{topic}: {len(wrong)} messages {times} cannot be read ({reason})"


class Telemetry(Made):
    """MAVLink frames with their times.

    Args:
        path: of the file that they are from.
        frames: time in ns and frame, those of a log in its order.
        counter: of the file's reader, complete when `frames` are used up.
        unread: messages with frames that cannot be read, a line each topic.

    Attributes:
        set_back: whether the clock of a log was set back.
    """

    def __init__(
        self,
        path: Path,
        frames: Iterable[Tuple[int, Frame]],
        counter: Optional[Counter] = None,
        unread: Iterable[str] = (),
    ) -> None:
        super().__init__(path)
        self._unread = "; ".join(unread)
        found = list(frames)
        self._frames = sorted(found, key=lambda each: each[0])
        self._count = counter
        times: Any = np.array([t_ns for t_ns, _ in found if counter is not None], np.int64)  # a bag tells its own
        self.set_back = set_back([(times, np.zeros(len(times), np.int64), np.arange(len(times)))])
        self._read()

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
        unread: List[str] = []
        said = [each for topic in topics for each in messages_of(recording, topic, unread)]
        return cls(recording.path, [(t_ns, _frame_of(message)) for t_ns, message in said], unread=unread)

    @property
    def count(self) -> Optional[TlogCount]:
        """What was in the log; None for a bag."""
        return None if self._count is None else self._count.count

    @property
    def problem(self) -> str:
        """What between its records is none, and which messages with frames cannot be read; empty: nothing."""
        count = self.count
        if count is None:
            return self._unread
        stray = count.stray_bytes - count.cut_bytes
        return (
            f"{self.path.name}: {stray} bytes between its records are none, what was there is missing" if stray else ""
        )

    @property
    def cut(self) -> str:
        """What behind its last record is none; empty: nothing."""
        if self.count is None:
            return ""
        size = self.path.stat().st_size
        return cut_words(self.path.name, size - self.count.cut_bytes, size)

    def made(self, topic: str, entry: Entry) -> Any:
        """Return one message that is no status."""
        message = decode(self._frames[entry.offset][1])
        return imu(entry.t_ns, message) if topic == _IMU else message

    def kind(self, topic: str) -> str:
        """Return the type of a topic."""
        return KINDS[topic] if topic in KINDS else "mavlink/" + topic[len(_PREFIX) :]

    def _read(self) -> None:
        """Sort the vehicle's frames by topic, and let the link's code listen to them."""
        vehicle = _vehicle(self._frames)
        teller = Teller(self.tell, _settings(self._frames, vehicle))
        own = {frame.number for _, frame in self._frames if _sender(frame) == (vehicle, _AUTOPILOT)}
        ways = {decode(frame).orientation for _, frame in self._frames if _is_range(frame, vehicle)}
        for at, (t_ns, frame) in enumerate(self._frames):
            teller.until(t_ns)
            if _sender(frame) != (vehicle, _AUTOPILOT):
                if (
                    frame.system == vehicle and frame.number not in own
                ):  # e.g. a range finder that is a component itself
                    self.place(_PREFIX + _name(frame.number) + _way(frame, ways), t_ns, at)
                continue
            name = _name(frame.number)
            self.place(_PREFIX + name + _way(frame, ways), t_ns, at)
            if name == "HIGHRES_IMU" or (name == "RAW_IMU" and _PREFIX + "HIGHRES_IMU" not in self._places):
                self.place(_IMU, t_ns, at)
            if name in WANTED:
                teller.take(t_ns, decode(frame))


def _is_range(frame: Frame, vehicle: Optional[int]) -> bool:
    return frame.number == mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR and frame.system == vehicle


def _way(frame: Frame, ways: Collection[int]) -> str:
    """Return what is added to the topic of a range finder that does not look down, where several look about.

    A single one keeps its topic whatever it says: not every driver is told where it looks.
    """
    if frame.number != mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR or len(ways) < 2:  # noqa: PLR2004
        return ""
    way = decode(frame).orientation
    return "" if way == mavlink.MAV_SENSOR_ROTATION_PITCH_270 else f"_{way}"


def _settings(frames: Iterable[Tuple[int, Frame]], vehicle: Optional[int]) -> AutopilotSettings:
    """Return the link's settings, whose limits leave a slow recording twice the time between two messages."""
    times: Dict[str, List[int]] = {}
    for t_ns, frame in frames:
        if _sender(frame) == (vehicle, _AUTOPILOT):
            times.setdefault(_name(frame.number), []).append(t_ns)
    periods = {name: int(np.median(np.diff(those))) for name, those in times.items() if len(those) > 1}
    settings = AutopilotSettings()
    for group, limit, names in _AGES:
        own = getattr(settings, group)
        slow_ns = min(_SLOWEST_NS, 2 * max((periods.get(name, 0) for name in names), default=0))
        settings = replace(settings, **{group: replace(own, **{limit: max(getattr(own, limit), slow_ns)})})
    return settings


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


class Teller:
    """Says when the autopilot node would have published: five times a second, and at once on a change.

    It begins with the first heartbeat: that none came before says something of the recording, not of the vehicle. It
    goes on to the end, so that a vehicle that falls silent is seen to.

    Args:
        tell: a status, with its time.
        settings: of the link; None: those that ship.
    """

    def __init__(self, tell: Callable[[int, VehicleState], None], settings: Optional[AutopilotSettings] = None) -> None:
        self._tell, self._vehicle = tell, VehicleState(settings or AutopilotSettings())
        self._due_ns: Optional[int] = None
        self._said: Any = None

    def until(self, t_ns: int) -> None:
        """Publish what is due before a time; nothing while a clock was set, which `Recordings` then sees as a gap."""
        if self._due_ns is not None and t_ns - self._due_ns > JUMP_NS:
            self._due_ns = t_ns
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
    return [STATUS, _IMU, *sorted(_PREFIX + _name(number) for number in numbers)]


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


# --- telemetry messages -----------------------------------------------------------------------------------------------
# What a telemetry log tells, as the messages that a bag would hold: fields as in ROS, made of MAVLink.


_MILLI_G = 9.80665e-3


@dataclass(frozen=True)
class Stamp:
    """A time."""

    sec: int
    nanosec: int


@dataclass(frozen=True)
class Header:
    """The header of a message."""

    stamp: Stamp


@dataclass(frozen=True)
class Vector:
    """A vector."""

    x: float
    y: float
    z: float


@dataclass(frozen=True)
class Imu:
    """Fields as in sensor_msgs/Imu."""

    header: Header
    linear_acceleration: Vector
    angular_velocity: Vector


def header(t_ns: int) -> Header:
    """Return the header of a message of a time."""
    return Header(Stamp(t_ns // _S, t_ns % _S))


def imu(t_ns: int, message: Any) -> Imu:
    """Return an IMU sample: forward, right, down becomes forward, left, up."""
    scale, turn = (1.0, 1.0) if message.get_type() == "HIGHRES_IMU" else (_MILLI_G, 1e-3)
    acceleration = Vector(message.xacc * scale, -message.yacc * scale, -message.zacc * scale)
    rates = Vector(message.xgyro * turn, -message.ygyro * turn, -message.zgyro * turn)
    return Imu(header(t_ns), acceleration, rates)


def status(t_ns: int, vehicle: VehicleState) -> Any:
    """Return what the autopilot node would say of a vehicle at a time.

    Reports are not numbered in a slow recording: each lasts for longer than the watchdog waits for the next one.
    """
    said = vehicle.status(t_ns)
    slow = vehicle.system.age_limit_ns > AutopilotSettings().limits.system_age_limit_ns
    more = health_fields(vehicle.health(t_ns), sequences=None if slow else vehicle.sequences(t_ns))
    return status_of(said).write(said, lambda _: SimpleNamespace, header=header(t_ns), **more)
