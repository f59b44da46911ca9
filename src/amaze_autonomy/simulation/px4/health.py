"""What the simulated PX4 knows of its sensors and of its position, what it says of both, and its failsafes.

Figures are those of a recorded loss of GPS: GPS_RAW_INT at once, the position after 5.3 s, the GPS bit after 7.8 s.
"""

from __future__ import annotations

from typing import Callable, FrozenSet, Mapping, NamedTuple, Optional, Tuple

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.simulation.vehicle.flight import Mode

from .craft import Craft
from .wire import DESCEND, OFFBOARD, Parameters

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


# --- failsafes --------------------------------------------------------------------------------------------------------


BATTERY_LEVELS = ("ok", "low", "critical", "emergency")
_BATTERY_TEXTS = ("", "Low battery\t", "Critical battery\t", "Emergency battery level\t")
_EMERGENCY, _CRITICAL, _INFO = 0, 2, 6
_WITH_POSITION = (Mode.MISSION, Mode.LOITER, Mode.TAKEOFF, Mode.RTL, Mode.LAND, OFFBOARD)
_LAND_AT = {2: 2, 3: 3}  # COM_LOW_BAT_ACT -> level at which it lands
_RETURN_AT = {1: 2, 3: 2}  # COM_LOW_BAT_ACT -> level at which it returns

# COM_RCL_EXCEPT: without the transmitter it flies on
_EXCEPT_BITS = {Mode.MISSION: 1, Mode.LOITER: 2, Mode.TAKEOFF: 2, OFFBOARD: 4}
WITHOUT_TRANSMITTER = {1: Mode.LOITER, 2: Mode.RTL, 3: Mode.LAND}  # NAV_RCL_ACT
_SEVERITY = {Mode.LOITER: 1, Mode.RTL: 2, Mode.LAND: 3, DESCEND: 4}  # of failsafes the worst is done
_AFTER_OFFBOARD = {3: Mode.RTL, 4: Mode.LAND, 5: Mode.LOITER}  # COM_OBL_RC_ACT

_Say = Callable[[int, str], None]


class Failsafes:
    """Acts on its own when it must; each action once.

    Args:
        craft: the vehicle.
        health: of its sensors.
        parameters: what is done in which case.
        say: tells a text: (severity, text).
    """

    def __init__(self, craft: Craft, health: Health, parameters: Parameters, say: _Say) -> None:
        self._craft, self._health, self._parameters, self._say = craft, health, parameters, say
        self.level = 0
        self.set_point_ns: Optional[int] = None
        self._after_hold: Optional[str] = None
        self._hold_until_ns: Optional[int] = None
        self._transmitter_lost = False

    def offboard_ready(self, t_ns: int) -> bool:
        """Tell whether set-points come."""
        limit_ns = round(float(self._parameters["COM_OF_LOSS_T"]) * _S)
        return self.set_point_ns is not None and t_ns - self.set_point_ns < limit_ns

    def advance(self, t_ns: int, fraction: Optional[float], *, transmitter: bool) -> None:
        """Look at everything, and act."""
        self._follow_battery(t_ns, fraction)
        self._follow_transmitter(t_ns, transmitter=transmitter)
        if not self._craft.armed:
            self._hold_until_ns = None
            return
        if self._hold_until_ns is not None and not self._craft.failsafe:
            self._hold_until_ns = None  # somebody chose another mode meanwhile
        if self._craft.mode == OFFBOARD and not self.offboard_ready(t_ns):
            self._act(_AFTER_OFFBOARD.get(int(self._parameters["COM_OBL_RC_ACT"]), Mode.POSITION))
        elif self._health.position_lost and self._craft.airborne and self._craft.mode in _WITH_POSITION:
            self._act(DESCEND)
        elif self._hold_until_ns is not None and t_ns >= self._hold_until_ns and self._after_hold is not None:
            self._hold_until_ns = None
            self._act(self._after_hold)

    def _act(self, mode: str, text: str = "Failsafe activated\t") -> None:
        if self._craft.pilot:
            return
        self._say(_CRITICAL, text)
        self._craft.failsafe = True
        self._craft.fall_into(mode)

    def _delay(self, t_ns: int, mode: str) -> None:
        """Hold for a while, so that the pilot can take over, then act."""
        wait_s = float(self._parameters["COM_FAIL_ACT_T"])
        self._after_hold = mode
        if self._hold_until_ns is None:
            self._hold_until_ns = t_ns + round(wait_s * _S)
            self._act(Mode.LOITER, f"Failsafe activated: entering Hold for {wait_s:.0f} seconds\t")

    def _follow_battery(self, t_ns: int, fraction: Optional[float]) -> None:
        if fraction is None:
            return
        thresholds = (float(self._parameters[name]) for name in ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"))
        level = sum(fraction < threshold for threshold in thresholds)
        worse, self.level = level > self.level, level
        if not worse:
            return
        self._say(_EMERGENCY, _BATTERY_TEXTS[level])
        if not self._craft.armed:
            return
        if level == 1:
            self._say(_CRITICAL, "Failsafe activated\t")
        action = int(self._parameters["COM_LOW_BAT_ACT"])
        if self._craft.mode in (Mode.LAND, DESCEND) or not self._craft.airborne:
            return
        if level >= _LAND_AT.get(action, 9):
            self._delay(t_ns, Mode.LAND)
        elif level >= _RETURN_AT.get(action, 9):
            self._delay(t_ns, Mode.RTL)

    def _follow_transmitter(self, t_ns: int, *, transmitter: bool) -> None:
        lost = not transmitter
        newly, self._transmitter_lost = lost and not self._transmitter_lost, lost
        if newly and self._craft.airborne:
            self._lose_transmitter(t_ns)

    def _lose_transmitter(self, t_ns: int) -> None:
        """Do what NAV_RCL_ACT says, unless more is done already; as seen of PX4 1.16.1, also on the way down."""
        mode, exceptions = self._craft.mode, int(self._parameters["COM_RCL_EXCEPT"])
        action = WITHOUT_TRANSMITTER.get(int(self._parameters["NAV_RCL_ACT"]), "")
        comes_down = mode in (Mode.LAND, Mode.RTL)
        if exceptions & _EXCEPT_BITS.get(mode, 0) or (action == Mode.RTL and comes_down):
            return
        self._say(_EMERGENCY, "Manual control lost\t")
        if _SEVERITY.get(action, 0) <= self._severity():
            return
        if action == Mode.LOITER or (self._craft.failsafe and comes_down):
            self._act(action)
        else:
            self._delay(t_ns, action)

    def _severity(self) -> int:
        """Return that of what a failsafe does now, or will do after its hold; 0: there is none."""
        if not self._craft.failsafe:
            return 0
        done = self._craft.mode if self._hold_until_ns is None else self._after_hold
        return _SEVERITY.get(done or "", 0)
