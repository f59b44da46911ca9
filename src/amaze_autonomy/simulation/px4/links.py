"""One MAVLink connection of the simulated vehicle: who was heard on it, and how often it sends which message."""

from __future__ import annotations

from typing import Dict, List, Mapping, Optional

from pymavlink.dialects.v20 import common as mavlink

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
