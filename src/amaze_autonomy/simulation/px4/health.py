"""What the simulated PX4 knows of its sensors and of its position, and what it says of both.

Figures are those of a recorded loss of GPS: GPS_RAW_INT at once, the position after 5.3 s, the GPS bit after 7.8 s.
"""

from __future__ import annotations

from typing import FrozenSet, Mapping, NamedTuple, Optional, Tuple

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.engine.events import VehicleLanded

__all__ = ["Health", "Sensors", "Wrong", "drift_m"]

_S = 1_000_000_000
_POSITION_LOST_NS = 5_280_000_000
_BIT_GONE_NS = 7_800_000_000
_SPREAD_NS = 7_600_000_000  # until the prediction of the position is given up, too
_BACK_NS = 1_300_000_000
_TRUSTED_NS = 4_500_000_000
_STANDS_NS = 2_800_000_000

_BITS: Mapping[str, int] = {
    "imu": mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    "magnetometer": mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG,
    "barometer": mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    "gps": mavlink.MAV_SYS_STATUS_SENSOR_GPS,
    "position": mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL,
    "rc": mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER,
    "battery": mavlink.MAV_SYS_STATUS_SENSOR_BATTERY,
}
# Said to be healthy without being present or enabled, as recorded.
_ALWAYS_HEALTHY = 0x01208810
_PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK

_KNOWN = 0b1101111111  # all estimates but "constant position" and, beside the ground, the height above it
_STANDS = 0b0010000000
_LOST = 0b1101100101
_LOST_FOR_LONG = 0b0001100101


class Sensors(NamedTuple):
    """The three words of SYS_STATUS."""

    present: int
    enabled: int
    health: int


class Wrong(NamedTuple):
    """What PX4 is wrong about, because a fault says so.

    Args:
        off_m: how far the estimate is off: east, north, up.
        landed: what it says of the ground; None: what is so.
    """

    off_m: Tuple[float, float, float] = (0.0, 0.0, 0.0)
    landed: Optional[VehicleLanded] = None


class Health:
    """Follows the sensors over time.

    Args:
        t_ns: when it begins.
    """

    def __init__(self, t_ns: int) -> None:
        self._t_ns = t_ns
        self._lost_ns: Optional[int] = None
        self._back_ns: Optional[int] = None
        self._armed_ns: Optional[int] = None

    def follow(self, t_ns: int, *, gps: bool, armed: bool) -> None:
        """Take notice of the state of the GPS receiver, and of motors that are on."""
        self._t_ns = t_ns
        if armed:
            self._armed_ns = t_ns
        if not gps and self._lost_ns is None:
            self._lost_ns, self._back_ns = t_ns, None
        elif gps and self._lost_ns is not None:
            if self._back_ns is None:
                self._back_ns = t_ns
            if not self.position_lost or t_ns - self._back_ns >= _TRUSTED_NS:
                self._lost_ns = self._back_ns = None
        elif not gps:
            self._back_ns = None

    @property
    def has_fix(self) -> bool:
        """True while the receiver has a fix."""
        return self._lost_ns is None or self._back_ns is not None

    @property
    def blind_ns(self) -> int:
        """How long it has flown without a fix; 0 with one."""
        return 0 if self.has_fix or self._lost_ns is None else self._t_ns - self._lost_ns

    @property
    def position_lost(self) -> bool:
        """True when the estimator has given the position up."""
        if self._lost_ns is None:
            return False
        until = self._t_ns if self._back_ns is None else self._back_ns
        return until - self._lost_ns >= _POSITION_LOST_NS

    @property
    def estimator_flags(self) -> int:
        """The flags of ESTIMATOR_STATUS; that the position is constant comes back some time after disarming."""
        back = self._back_ns is not None and self._t_ns - self._back_ns >= _BACK_NS
        if self.position_lost and not back:
            return _LOST if self.blind_ns < _SPREAD_NS else _LOST_FOR_LONG
        stands = self._armed_ns is None or self._t_ns - self._armed_ns >= _STANDS_NS
        return _KNOWN | _STANDS if stands else _KNOWN

    def sensors(
        self,
        reported: Mapping[str, Optional[bool]],
        *,
        armed: bool,
        transmitter: bool,
        battery_low: bool,
        ready: bool,
    ) -> Sensors:
        """Return the words of SYS_STATUS.

        Args:
            reported: of the sensors: healthy; None: nothing is said of it.
            armed: the motors are on.
            transmitter: of the pilot; without it RC is enabled and unhealthy, all the time.
            battery_low: the battery is at its warning level.
            ready: the pre-arm verdict.
        """
        gone = {name for name, healthy in reported.items() if healthy is None}
        hidden = gone | ({"gps"} if self.blind_ns >= _BIT_GONE_NS else set())
        present = {name for name in _BITS if name not in hidden and name != "rc"}
        enabled = set(present) | {"rc"}
        if transmitter:
            present.add("rc")
        if not armed and "gps" not in gone and self.blind_ns > 0:
            enabled.add("gps")  # on the ground it is asked for again
        bad = {name for name, healthy in reported.items() if healthy is False}
        bad |= {"position"} if self.position_lost else set()
        bad |= set() if transmitter else {"rc"}
        bad |= {"battery"} if battery_low else set()
        bad |= {"gps"} if self.blind_ns >= _BIT_GONE_NS else set()
        health = _word(frozenset(_BITS) - bad) | _ALWAYS_HEALTHY | (_PREARM if ready else 0)
        return Sensors(_word(frozenset(present)), _word(frozenset(enabled)), health)


def _word(names: FrozenSet[str]) -> int:
    return sum(bits for name, bits in _BITS.items() if name in names)


def drift_m(blind_ns: int) -> Tuple[float, float]:
    """Return how far north and east the estimate is off after a time without a fix."""
    seconds = max(0.0, (blind_ns - _POSITION_LOST_NS) / _S)
    return -0.1 * seconds * seconds, 0.25 * seconds * seconds
