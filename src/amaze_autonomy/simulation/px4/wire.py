"""How the simulated vehicle speaks MAVLink: frames, texts, modes, parameters (integers travel as a float), links."""

from __future__ import annotations

import struct
import zlib
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple, Union

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.simulation.vehicle.flight import Mode

_EPOCH_2015_NS = 1_420_070_400_000_000_000  # https://mavlink.io/en/guide/message_signing.html: of time stamps, 10 us

# --- frames -----------------------------------------------------------------------------------------------------------


class Framing:
    """The two directions of one connection; damaged and foreign bytes are passed over.

    Args:
        system: whose frames go out.
        component: likewise.
        key: with which all frames are signed, by pymavlink, and what is not is passed over; empty: none is.
        unix_ns: wall time at the beginning, for signatures.
    """

    def __init__(self, system: int, component: int, key: bytes = b"", unix_ns: int = 0) -> None:
        self._mav: Any = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._mav.robust_parsing = True
        if key:
            signing = self._mav.signing
            signing.secret_key, signing.link_id, signing.sign_outgoing = key, component, True
            signing.timestamp = (unix_ns - _EPOCH_2015_NS) // 10_000

    def encode(self, message: Any) -> bytes:
        """Return the frame of a message; each takes the next sequence number."""
        frame = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return bytes(frame)

    def decode(self, data: bytes) -> List[Any]:
        """Return the messages that are complete with these bytes."""
        messages = self._mav.parse_buffer(data) or []
        return [message for message in messages if message.get_type() != "BAD_DATA"]


class _Raw:
    """A message that the dialect has no class for.

    Args:
        number: of the message.
        name: of the message.
        payload: its bytes.
        extra: that its checksum ends with.
    """

    def __init__(self, number: int, name: str, payload: bytes, extra: int) -> None:
        self._number, self._name, self._extra = number, name, extra
        self._payload = payload.rstrip(b"\0") or b"\0"

    def get_type(self) -> str:
        """Return the name, as pymavlink's messages do."""
        return self._name

    def pack(self, mav: Any) -> bytes:
        """Return the frame, as pymavlink's messages do."""
        flags = mavlink.MAVLINK_IFLAG_SIGNED if mav.signing.sign_outgoing else 0
        head = struct.pack("<BBBBBB", len(self._payload), flags, 0, mav.seq, mav.srcSystem, mav.srcComponent)
        body = head + self._number.to_bytes(3, "little") + self._payload
        checksum = mavlink.x25crc(body)
        checksum.accumulate(bytes((self._extra,)))
        self._msgbuf = bytearray(b"\xfd" + body + struct.pack("<H", checksum.crc))
        if flags:
            mavlink.MAVLink_message.sign_packet(self, mav)
        return bytes(self._msgbuf)


def event(number: int, t_ms: int, sequence: int, log_level: int) -> Any:
    """Make an EVENT: what PX4 sends beside a STATUSTEXT that ends with a tab."""
    payload = struct.pack("<IIHBBB40s", number, t_ms, sequence & 0xFFFF, 0, 0, log_level, b"")
    return _Raw(410, "EVENT", payload, 160)


def current_mode(custom_mode: int, intended_mode: int) -> Any:
    """Make a CURRENT_MODE."""
    return _Raw(436, "CURRENT_MODE", struct.pack("<IIB", custom_mode, intended_mode, 0), 193)


def sequence(number: int) -> Any:
    """Make a CURRENT_EVENT_SEQUENCE."""
    return _Raw(411, "CURRENT_EVENT_SEQUENCE", struct.pack("<HB", number & 0xFFFF, 0), 106)


# --- texts ------------------------------------------------------------------------------------------------------------
# STATUSTEXT as PX4 sends it: in chunks of 50 bytes; most texts once more as an event, which the trailing tab tells.


_CHUNK = 50


class Texts:
    """Numbers what is told."""

    def __init__(self) -> None:
        self._number = 0
        self.events = 0

    def chunks(self, severity: int, text: str) -> List[Any]:
        """Make the messages of a text."""
        data = text.encode("ascii", "replace")
        self._number = self._number % 65535 + 1
        parts = [data[start : start + _CHUNK] for start in range(0, len(data), _CHUNK)] or [b""]
        return [mavlink.MAVLink_statustext_message(severity, part, self._number, n) for n, part in enumerate(parts)]

    def event(self, t_ms: int, severity: int, text: str) -> List[Any]:
        """Make the event of a text that has one."""
        if not text.endswith("\t"):
            return []
        self.events += 1
        return [event(zlib.crc32(text.encode("ascii", "replace")), t_ms, self.events, severity << 4 | severity)]


# --- modes ------------------------------------------------------------------------------------------------------------


OFFBOARD = "OFFBOARD"
DESCEND = "DESCEND"  # AUTO.LAND of a vehicle that does not know where it is

_CUSTOM = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
_STABILIZE = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
_MANUAL = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | _STABILIZE
_AUTO = mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED | _STABILIZE


class Wire(NamedTuple):
    """A mode on the wire.

    Args:
        main: PX4's main mode.
        sub: its sub-mode; 0: it has none.
        flags: of HEARTBEAT.base_mode, without "armed".
    """

    main: int
    sub: int
    flags: int


_MODES: Mapping[str, Wire] = {
    "MANUAL": Wire(1, 0, _MANUAL),
    "ALTCTL": Wire(2, 0, _MANUAL),
    Mode.POSITION: Wire(3, 0, _MANUAL),
    Mode.TAKEOFF: Wire(4, 2, _AUTO),
    Mode.LOITER: Wire(4, 3, _AUTO),
    Mode.MISSION: Wire(4, 4, _AUTO),
    Mode.RTL: Wire(4, 5, _AUTO),
    Mode.LAND: Wire(4, 6, _AUTO),
    OFFBOARD: Wire(6, 0, _AUTO),
    "STABILIZED": Wire(7, 0, _MANUAL),
}
_BY_NUMBERS: Mapping[Tuple[int, int], str] = {(wire.main, wire.sub): name for name, wire in _MODES.items()}


def shown(mode: str) -> str:
    """Return the mode that others are shown: PX4 has no number for a blind descent."""
    return Mode.LAND if mode == DESCEND else mode


def custom_mode(mode: str) -> int:
    """Return HEARTBEAT.custom_mode: the sub-mode in the highest byte, the main mode below it."""
    wire = _MODES[shown(mode)]
    return wire.sub << 24 | wire.main << 16


def base_mode(mode: str, *, armed: bool) -> int:
    """Return HEARTBEAT.base_mode."""
    return int(_CUSTOM | _MODES[shown(mode)].flags | (_ARMED if armed else 0))


def mode_of(main: int, sub: int) -> Optional[str]:
    """Return the mode of these numbers; None when there is no such mode."""
    return _BY_NUMBERS.get((main, sub))


# --- parameters -------------------------------------------------------------------------------------------------------


_Number = Union[int, float]


class Parameters:
    """Named numbers, read and changed by messages.

    Args:
        values: to begin with.
    """

    def __init__(self, values: Mapping[str, _Number]) -> None:
        self._values: Dict[str, _Number] = {name: values[name] for name in sorted(values)}

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> _Number:
        return self._values[name]

    def __setitem__(self, name: str, value: _Number) -> None:
        self._values[name] = value

    def take(self, message: Any) -> List[Any]:
        """Answer a message about parameters; one that is no such message gets no answer."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            return [self.told(name) for name in self._values]
        if kind == "PARAM_REQUEST_READ":
            return self._read(_name(message.param_id), message.param_index)
        if kind == "PARAM_SET":
            return self._set(_name(message.param_id), message)
        return []

    def told(self, name: str) -> Any:
        """Make the PARAM_VALUE of a parameter."""
        names = list(self._values)
        return self._value(name, len(names), names.index(name))

    def _read(self, name: str, index: int) -> List[Any]:
        names = list(self._values)
        if index >= 0:
            name = names[index] if index < len(names) else ""
        return [self.told(name)] if name in self._values else []

    def _set(self, name: str, message: Any) -> List[Any]:
        """Take a value and tell it twice: as the answer, and because it changed."""
        value = _number(message.param_value, message.param_type)
        old = self._values.get(name)
        if old is None or value is None or isinstance(old, int) != isinstance(value, int):
            return [self.told(name)] if old is not None else []
        self._values[name] = value
        return [self.told(name), self.told(name)]

    def _value(self, name: str, count: int, index: int) -> Any:
        value = self._values[name]
        kind, number = mavlink.MAV_PARAM_TYPE_REAL32, float(value)
        if isinstance(value, int):
            kind, number = mavlink.MAV_PARAM_TYPE_INT32, struct.unpack("<f", struct.pack("<i", value))[0]
        return mavlink.MAVLink_param_value_message(name.encode("ascii"), number, kind, count, index)


def _name(text: Any) -> str:
    return text.decode("ascii", "replace").rstrip("\0") if isinstance(text, bytes) else str(text).rstrip("\0")


def _number(value: float, kind: int) -> Optional[_Number]:
    if kind == mavlink.MAV_PARAM_TYPE_REAL32:
        return float(value)
    if kind == mavlink.MAV_PARAM_TYPE_INT32:
        return int(struct.unpack("<i", struct.pack("<f", value))[0])
    return None


# --- links ------------------------------------------------------------------------------------------------------------
# One connection of the vehicle: who was heard on it, and how often it sends which message.


_S = 1_000_000_000
_GCS_LIMIT_NS = 5 * _S // 2
_MANY = 8  # texts that are kept for a ground station to come

# Rates in Hz as PX4 v1.16 streams them to an onboard computer and to a ground station.
_ONBOARD: Mapping[str, float] = {
    "HEARTBEAT": 1.0,
    "ALTITUDE": 10.0,
    "ATTITUDE": 100.0,
    "ATTITUDE_QUATERNION": 50.0,
    "ATTITUDE_TARGET": 10.0,
    "BATTERY_STATUS": 0.5,
    "CURRENT_EVENT_SEQUENCE": 0.3,
    "CURRENT_MODE": 0.5,
    "DISTANCE_SENSOR": 10.0,
    "ESTIMATOR_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 5.0,
    "GLOBAL_POSITION_INT": 50.0,
    "GPS_RAW_INT": 5.0,
    "HIGHRES_IMU": 50.0,
    "HOME_POSITION": 0.5,
    "LOCAL_POSITION_NED": 30.0,
    "MISSION_CURRENT": 1.0,
    "ODOMETRY": 30.0,
    "PING": 1.0,
    "POSITION_TARGET_GLOBAL_INT": 10.0,
    "POSITION_TARGET_LOCAL_NED": 10.0,
    "RC_CHANNELS": 20.0,
    "SCALED_PRESSURE": 1.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "SYSTEM_TIME": 1.0,
    "SYS_STATUS": 5.0,
    "TIMESYNC": 10.0,
    "VFR_HUD": 10.0,
    "VIBRATION": 0.5,
}
_GCS: Mapping[str, float] = {
    "HEARTBEAT": 1.0,
    "ALTITUDE": 1.0,
    "ATTITUDE": 15.0,
    "ATTITUDE_QUATERNION": 10.0,
    "ATTITUDE_TARGET": 2.0,
    "BATTERY_STATUS": 0.5,
    "CURRENT_EVENT_SEQUENCE": 0.3,
    "CURRENT_MODE": 0.5,
    "DISTANCE_SENSOR": 0.5,
    "ESTIMATOR_STATUS": 0.5,
    "EXTENDED_SYS_STATE": 1.0,
    "GLOBAL_POSITION_INT": 5.0,
    "GPS_RAW_INT": 1.0,
    "HOME_POSITION": 0.5,
    "LOCAL_POSITION_NED": 1.0,
    "MISSION_CURRENT": 1.0,
    "ODOMETRY": 3.0,
    "PING": 0.1,
    "POSITION_TARGET_GLOBAL_INT": 1.0,
    "POSITION_TARGET_LOCAL_NED": 1.5,
    "RC_CHANNELS": 5.0,
    "SCALED_PRESSURE": 1.0,
    "SERVO_OUTPUT_RAW": 1.0,
    "SYSTEM_TIME": 1.0,
    "SYS_STATUS": 1.0,
    "VFR_HUD": 4.0,
    "VIBRATION": 0.1,
}
PRESETS: Mapping[str, Mapping[str, float]] = {"onboard": _ONBOARD, "gcs": _GCS, "silent": {"HEARTBEAT": 1.0}}


class Link:
    """What PX4 keeps for one of its connections.

    Args:
        name: by which the caller knows it.
        t_ns: when it begins.
        preset: rates to begin with: onboard or gcs; silent: ArduPilot's, a heartbeat until more is asked for.
    """

    def __init__(self, name: str, t_ns: int, preset: str = "onboard") -> None:
        self.name = name
        self._defaults = PRESETS[preset]
        self._periods: Dict[str, int] = {message: round(_S / rate) for message, rate in self._defaults.items()}
        self._due: Dict[str, int] = {
            message: t_ns + place * 7_000_000 % period for place, (message, period) in enumerate(self._periods.items())
        }
        self._told: Dict[str, int] = {}
        self._gcs_ns: Optional[int] = None
        self._texts: List[object] = []

    def interval_us(self, message: str) -> int:
        """Return the interval of a message as MESSAGE_INTERVAL tells it: -1 when it is not sent."""
        period = self._periods.get(message)
        return -1 if period is None else period // 1000

    def set_interval(self, t_ns: int, message: str, interval_us: float) -> None:
        """Change how often a message is sent: 0 as in the beginning, negative: not at all."""
        self._periods.pop(message, None)
        self._due.pop(message, None)
        if interval_us > 0:
            self._periods[message] = max(1_000_000, round(interval_us * 1000))
        elif interval_us == 0 and message in self._defaults:
            self._periods[message] = round(_S / self._defaults[message])
        if message in self._periods:
            self._due[message] = t_ns

    @property
    def next_ns(self) -> int:
        """Time at which the next message is due."""
        return min(self._due.values())

    def due(self, t_ns: int) -> List[str]:
        """Return the messages that are due, in a fixed order, each once however late it is."""
        names = [message for message, due_ns in self._due.items() if due_ns <= t_ns]
        for message in names:
            period = self._periods[message]
            self._due[message] += period * (1 + (t_ns - self._due[message]) // period)
        return names

    def hasten(self, t_ns: int, message: str) -> None:
        """Send a message that is streamed now, and then as before."""
        if message in self._due:
            self._due[message] = t_ns

    def is_new(self, message: str, version: int) -> bool:
        """Note which version of its topic a message tells; return whether it was not told yet."""
        told, self._told[message] = self._told.get(message), version
        return told != version

    def hear_heartbeat(self, t_ns: int, kind: int) -> None:
        """Take notice of a heartbeat: PX4 tells its texts to a ground station only."""
        if kind == mavlink.MAV_TYPE_GCS:
            self._gcs_ns = t_ns

    def has_ground_station(self, t_ns: int) -> bool:
        """Tell whether a ground station was heard lately."""
        return self._gcs_ns is not None and t_ns - self._gcs_ns <= _GCS_LIMIT_NS

    def keep_text(self, message: object) -> None:
        """Keep a text until a ground station listens; the oldest are forgotten."""
        self._texts = [*self._texts, message][-_MANY:]

    def take_texts(self, t_ns: int) -> List[object]:
        """Return the texts that can be told now."""
        if not self._texts or not self.has_ground_station(t_ns):
            return []
        texts, self._texts = self._texts, []
        return texts
