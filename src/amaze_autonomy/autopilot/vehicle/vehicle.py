"""What the vehicle says of itself: messages in, state out. Pure: time comes with each message, nothing is sent.

One table says which message goes where; `WANTED` are its names. What is older than its limit is unknown.
"""

from __future__ import annotations

from collections import deque
from math import degrees, inf
from operator import attrgetter
from typing import Any, Deque, Dict, Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.config.schemas.autopilot import JUDGED_RATES
from amaze_autonomy.engine.events import AutopilotStatus, VehicleLanded
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.monitoring.gravity import LastingTilt, tilt_of_rpy

from ..link.dialect import Message, mavlink
from .agreement import Agreement, Ground, PowerOn
from .battery import Battery
from .modes import LANDING_MODES, Control, Heartbeat, is_piloted, mode_name
from .position import Position
from .texts import Texts

_S = 1_000_000_000
_LANDED: Mapping[int, VehicleLanded] = {
    mavlink.MAV_LANDED_STATE_ON_GROUND: VehicleLanded.ON_GROUND,
    mavlink.MAV_LANDED_STATE_IN_AIR: VehicleLanded.IN_AIR,
    mavlink.MAV_LANDED_STATE_TAKEOFF: VehicleLanded.TAKING_OFF,
    mavlink.MAV_LANDED_STATE_LANDING: VehicleLanded.LANDING,
}
_TELL_ITS_START = frozenset(("ATTITUDE", "LOCAL_POSITION_NED", "SYSTEM_TIME"))  # by stamps of when they were sent
_POWERLESS_NS = 10 * _S  # as long as a vehicle is silent at least whose battery is exchanged
_DOUBT_NS = 1_300_000_000  # of heartbeats at 1 Hz, another one has come


class Told(NamedTuple):
    """What a status says by heartbeats: mode and armed (None: not known), and who has control."""

    armed: Optional[bool]
    mode: str
    pilot: bool
    failsafe: bool


class _Taken(NamedTuple):
    """How a message is taken.

    Args:
        by: what of a `VehicleState` takes it, called with the time and the message.
        rate_hz: at which it is asked for, unless `rates_hz` of autopilot.yaml says another; 0: it comes unasked.
        why: of a rate that needs a reason.
    """

    by: str
    rate_hz: float = 0.0
    why: str = ""


_AT_ONCE_KNOWN = "a mode is known within the period: ArduPilot grants HEARTBEAT, PX4 CURRENT_MODE alone"
_ESTIMATE = "what the estimator says of its position: PX4 the one, ArduPilot the other"
_RATES = {name: judged.rate_hz for name, judged in JUDGED_RATES.items()}  # whose limits follow from them
_TAKERS: Mapping[str, _Taken] = {
    "HEARTBEAT": _Taken("_heartbeat", _RATES["HEARTBEAT"], _AT_ONCE_KNOWN),
    "CURRENT_MODE": _Taken("_mode", 10.0, _AT_ONCE_KNOWN),
    "EXTENDED_SYS_STATE": _Taken("_extended", _RATES["EXTENDED_SYS_STATE"], "whether it is on the ground"),
    "SYS_STATUS": _Taken("_system", _RATES["SYS_STATUS"], "health of the sensors, and the battery"),
    "BATTERY_STATUS": _Taken("battery.add_pack", 2.0, "each battery"),
    "GPS_RAW_INT": _Taken("_gps", _RATES["GPS_RAW_INT"], "fix and satellites; a lost one is told here first"),
    "LOCAL_POSITION_NED": _Taken("_local", _RATES["LOCAL_POSITION_NED"], "height, position and speed"),
    "ESTIMATOR_STATUS": _Taken("position.add_px4_flags", _RATES["ESTIMATOR_STATUS"], _ESTIMATE),
    "EKF_STATUS_REPORT": _Taken("position.add_ardupilot_flags", _RATES["EKF_STATUS_REPORT"], _ESTIMATE),
    "HOME_POSITION": _Taken("position.add_home", 0.5, "whether there is a home to return to"),
    "GPS_GLOBAL_ORIGIN": _Taken(
        "position.add_origin", 0.5, "of ArduPilot alone: where home is that it says to be at 0, 0, 0"
    ),
    "ATTITUDE": _Taken("_attitude", _RATES["ATTITUDE"], "roll and pitch: how far it is tilted"),
    "STATUSTEXT": _Taken("texts.add"),
    "EVENT": _Taken("_event"),
    "TIMESYNC": _Taken("offset.add"),
}
WANTED: Mapping[str, Tuple[float, str]] = {name: (taken.rate_hz, taken.why) for name, taken in _TAKERS.items()}
"""What a `VehicleState` takes: at which rate each message is asked for (0: it comes unasked), and why."""


class VehicleState:
    """The state of one vehicle.

    Args:
        settings: limits and caps.
        cells: of its battery in series; 0: unknown.
        limits: of the engine, for how long messages must agree; None: those that ship.
    """

    def __init__(self, settings: AutopilotSettings, cells: int = 0, limits: Optional[Limits] = None) -> None:
        self._settings, self._engine = settings, limits or Limits()
        self.ground = Ground(self._engine.flight_end_confirm_ns)
        self._piloted, self._alone, self._in_landing_mode = Agreement(), Agreement(), Agreement()
        self.control, self.texts, self.offset = Control(), Texts(), ClockOffset()
        self.battery = Battery(_caps(settings), cells)
        self.system = SystemStatus(settings.limits.system_age_limit_ns)
        self.gps = Gps(GpsLimits(settings.gps.min_fix_type, settings.gps.age_limit_ns, settings.gps.frozen_limit_ns))
        self.position = Position(settings.limits.state_age_limit_ns, settings.limits.speed_age_limit_ns)
        self.tilt = LastingTilt(settings.limits.state_age_limit_ns)
        self._power_on = PowerOn()
        self.in_doubt = False  # what is new: another heartbeat must say whether and why it is so
        self._before_doubt: Optional[Tuple[int, Told]] = None
        self._heard_ns: Optional[int] = None
        self._landed: Optional[Tuple[int, int]] = None
        self._powered_ns: Optional[int] = None  # since then it beats again, and may have been without power before
        self._takers = {name: attrgetter(taken.by)(self) for name, taken in _TAKERS.items()}

    def receive(self, t_ns: int, message: Message, *, heard: bool = True) -> None:
        """Take a message; of others than `WANTED` only that they came is noted, where the vehicle itself said them."""
        self._heard_ns = t_ns if heard else self._heard_ns
        self._look_at_its_start(t_ns, message)
        taker = self._takers.get(message.get_type())
        if taker is not None:
            taker(t_ns, message)

    # --- what it is -----------------------------------------------------------------------------------------------

    @property
    def restarts(self) -> int:
        """How often the autopilot was seen to have been started again."""
        return self._power_on.starts

    @property
    def beat(self) -> Optional[Heartbeat]:
        """The last heartbeat."""
        return self.control.beat

    def link_age_ns(self, t_ns: int) -> Optional[int]:
        """Return the time since anything came from the vehicle; None: no heartbeat ever came."""
        return None if self.beat is None or self._heard_ns is None else t_ns - self._heard_ns

    def connected(self, t_ns: int) -> bool:
        """Return whether the vehicle was heard lately."""
        age_ns = self.link_age_ns(t_ns)
        return age_ns is not None and age_ns <= self._settings.limits.link_age_limit_ns

    def armed(self, t_ns: int) -> Optional[bool]:
        """Return whether it is armed; None: no heartbeat has said so lately."""
        return self.beat.armed if self.beat is not None and self._fresh(t_ns, self.beat.t_ns) else None

    def mode(self, t_ns: int) -> str:
        """Return the flight mode; empty: nothing has told it lately."""
        return self.beat.mode if self.beat is not None and self._fresh(t_ns, self.control.mode_ns) else ""

    def _fresh(self, t_ns: int, told_ns: int) -> bool:
        return t_ns - told_ns <= self._settings.limits.mode_age_limit_ns

    def landed(self, t_ns: int) -> VehicleLanded:
        """Return the landed state; ArduPilot's heartbeat tells it where EXTENDED_SYS_STATE never came."""
        if self._landed is not None:
            told_ns, state = self._landed
            fresh = t_ns - told_ns <= self._settings.limits.state_age_limit_ns
            return _LANDED.get(state, VehicleLanded.UNKNOWN) if fresh else VehicleLanded.UNKNOWN
        beat = self.beat
        if beat is None or beat.autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA or self.armed(t_ns) is None:
            return VehicleLanded.UNKNOWN
        at_rest = not beat.armed and beat.status == mavlink.MAV_STATE_STANDBY
        return VehicleLanded.ON_GROUND if at_rest else VehicleLanded.UNKNOWN

    def landed_age_ns(self, t_ns: int) -> int:
        """Return for how long the vehicle has not said whether it is on the ground."""
        told_ns = self._landed[0] if self._landed is not None else self.beat.t_ns if self.beat is not None else 0
        return t_ns - told_ns

    def in_flight(self, t_ns: int) -> bool:
        """Return whether it may be in flight: heard armed, and messages agree on neither disarmed nor on the ground."""
        return self.ground.may_fly(t_ns, self._settings.limits.state_age_limit_ns)

    def is_down(self, t_ns: int) -> bool:
        """Return whether messages agree that it is disarmed and on the ground."""
        stands = self.ground.stands(t_ns, self._settings.limits.state_age_limit_ns)
        return stands and self.ground.disarmed and self.armed(t_ns) is False

    @property
    def taken_over(self) -> bool:
        """Whether messages agree that the pilot has control; at its first sign (`control.pilot`) nothing is sent."""
        return self.control.pilot and self._piloted.lasts(self._engine.pilot_confirm_ns)

    def acts_by_failsafe(self, t_ns: int, *, agreed: bool) -> bool:
        """Return whether a failsafe has taken the vehicle out of our modes, and it is to be left alone.

        In a pilot's mode that is so where a transmitter is heard: without one nobody flies it. Whether one is, is
        unknown after a cut until SYS_STATUS comes: for so long as that counts nothing is sent, and nothing ends. Of a
        silent vehicle the last that was heard counts.

        Args:
            t_ns: now.
            agreed: messages must agree on it; else its first sign is enough.
        """
        control, since_ns = self.control, self._alone.since_ns
        if control.beat is None or not control.acts_alone or since_ns is None:
            return False
        if agreed and not self._alone.lasts(self._engine.pilot_confirm_ns):
            return False
        if not is_piloted(control.beat.mode):
            return True
        heard_ns = min(t_ns, self._heard_ns or t_ns)
        if self.system.fresh(heard_ns):
            return bool(self.system.rc(heard_ns))
        return not agreed and heard_ns - since_ns < self._settings.limits.system_age_limit_ns

    @property
    def in_landing_mode(self) -> bool:
        """Whether messages agree on a landing mode."""
        return self._in_landing_mode.lasts(self._engine.pilot_confirm_ns)

    def told(self, t_ns: int) -> Told:
        """Return what a status says by heartbeats; behind mavros, where one lasts for a second, by two that agree.

        A first sign of something new is held back until the next one says so as well, or none has come in time.
        """
        began_ns, told = self._before_doubt or (0, None)
        if told is not None and self._settings.backend == "mavros" and t_ns - began_ns < _DOUBT_NS:
            return told
        return Told(self.armed(t_ns), self.mode(t_ns), self.control.pilot, self.control.failsafe)

    def health(self, t_ns: int) -> Dict[str, Optional[bool]]:
        """Return the health of each sensor for the watchdog; None: unknown."""
        health = {name: self.system.healthy(t_ns, bits) for name, bits in SENSORS.items()}
        health["gps"] = gps_health(system=health["gps"], problem=self.gps.problem(t_ns))
        return health

    def sequences(self, t_ns: int) -> Dict[str, int]:
        """Return the numbers of the reports that the health is from, by the fields of a status.

        SYS_STATUS is numbered, and so is GPS_RAW_INT, apart from it; its silence has no number: each status tells it.
        """
        system = self.system.healthy(t_ns, SENSORS["gps"])
        by_bit = gps_by_its_bit(system=system, problem=self.gps.problem(t_ns))
        gps = self.system.sequence if by_bit else self.gps.sequence(t_ns)
        return {"sensors_sequence": self.system.sequence, "gps_sequence": gps}

    def status(self, t_ns: int) -> AutopilotStatus:
        """Return all of it as the engine takes it."""
        told = self.told(t_ns)
        battery, place, tilt_rad = self.battery.reading(), self.position.place(t_ns), self.tilt.tilt_rad(t_ns)
        gps_fix, satellites = self.gps.fix(t_ns)
        return AutopilotStatus(
            t_ns=t_ns,
            armed=told.armed,
            landed=self.landed(t_ns),
            mode=told.mode,
            pilot_in_control=told.pilot,
            failsafe=told.failsafe,
            link_age_s=_seconds(self.link_age_ns(t_ns)),
            height_m=place.up_m,
            position_x_m=place.east_m,
            position_y_m=place.north_m,
            vertical_speed_m_s=place.climb_m_s,
            horizontal_speed_m_s=place.ground_m_s,
            battery_fraction=None if battery is None else battery.fraction,
            battery_voltage_v=None if battery is None else battery.voltage_v,
            battery_age_s=None if battery is None else _seconds(t_ns - battery.t_ns),
            battery_critical=self.battery.critical,
            tilt_deg=None if tilt_rad is None else degrees(tilt_rad),
            gps_fix=gps_fix,
            satellites=satellites,
        )

    # --- takers ---------------------------------------------------------------------------------------------------

    def _heartbeat(self, t_ns: int, message: Any) -> None:
        before, beat = self.beat, Heartbeat.of(t_ns, message)
        self.in_doubt = before is not None and before._replace(t_ns=t_ns) != beat
        if not self.in_doubt or (before is not None and not self._fresh(t_ns, before.t_ns)):
            self._before_doubt = None
        elif self._before_doubt is None:
            self._before_doubt = (t_ns, self.told(t_ns))
        self.control.add(beat)
        self.ground.add_armed(t_ns, armed=beat.armed)
        self._watch_battery(t_ns, before, beat)
        self._watch_home(t_ns, before, beat)
        if self._landed is None:
            self._add_landed(t_ns)
        self._agree(t_ns, beat.mode)
        self.texts.wake(t_ns)

    def _watch_battery(self, t_ns: int, before: Optional[Heartbeat], beat: Heartbeat) -> None:
        if before is not None and t_ns - before.t_ns >= _POWERLESS_NS and not beat.armed:
            self.battery.restarted()
        armed = beat.armed and before is not None and before.armed
        self.battery.watch(t_ns, armed=armed, disarmed=self.ground.disarmed)

    def _watch_home(self, t_ns: int, before: Optional[Heartbeat], beat: Heartbeat) -> None:
        """Forget the home from before a break where no message tells its start (mavros), once it is surely disarmed.

        The break is as long as mavros' own limit (`conn/timeout`), after which mavros asks for the home again.
        """
        if self._power_on.since_ns is not None or beat.armed:
            self._powered_ns = None
        elif before is not None and t_ns - before.t_ns >= _POWERLESS_NS:
            self._powered_ns = t_ns
        if self._powered_ns is not None and self.ground.disarmed:
            home_ns, powered_ns = self.position.home_ns, self._powered_ns
            self._powered_ns = None
            if home_ns is not None and home_ns < powered_ns:
                self.position.forget_takeoff()

    def _agree(self, t_ns: int, mode: str) -> None:
        self._piloted.add(t_ns, so=self.control.pilot)
        self._alone.add(t_ns, so=self.control.acts_alone)
        self._in_landing_mode.add(t_ns, so=mode in LANDING_MODES)

    def _event(self, t_ns: int, message: Any) -> None:
        """Take why it does not arm; armed, the same events tell which modes are not to be had now."""
        if not (self.beat and self.beat.armed):
            self.texts.add_event(t_ns, message)

    def _mode(self, t_ns: int, message: Any) -> None:
        """Take a mode; why it has changed is in the next heartbeat, which is asked for.

        Near the ground that is waited for: when PX4 disarms it goes back to the mode that the user intended, and armed
        in that mode it would look like a takeover.
        """
        beat, number = self.beat, int(message.custom_mode)
        waits = self.landed(t_ns) not in (VehicleLanded.IN_AIR, VehicleLanded.TAKING_OFF)
        if waits and beat is not None and mode_name(beat.autopilot, number, beat.vehicle) != beat.mode:
            self.in_doubt = True
        elif beat is not None:
            self.in_doubt = self.control.add_mode(t_ns, number) or self.in_doubt
            self._agree(t_ns, mode_name(beat.autopilot, number, beat.vehicle))

    def _gps(self, t_ns: int, message: Any) -> None:
        at_rest = self.armed(t_ns) is False or self.landed(t_ns) is VehicleLanded.ON_GROUND
        self.gps.add(t_ns, message, at_rest=at_rest)

    def _extended(self, t_ns: int, message: Any) -> None:
        self._landed = (t_ns, int(message.landed_state))
        self._add_landed(t_ns)

    def _add_landed(self, t_ns: int) -> None:
        """Take what was said of the ground."""
        self.ground.add_landed(t_ns, self.landed(t_ns))
        if self._rests(t_ns):
            self.position.stand(t_ns)
        else:
            self.position.leave()

    def _local(self, t_ns: int, message: Any) -> None:
        """Take a position; where a heartbeat alone tells the ground, one that comes at rest is the takeoff place.

        It is disarmed by that, and lifts off after it counts no more; an ArduPilot sets its height anew as it arms.
        """
        self.position.add_local(t_ns, message)
        if self._rests(t_ns):
            self.position.rest(t_ns, final=self._landed is None)
        else:
            self.position.leave()

    def _rests(self, t_ns: int) -> bool:
        """Return whether it is known to stand; a heartbeat says so for no longer than a landed state."""
        limit_ns = self._settings.limits.state_age_limit_ns
        if self._landed is None and (self.beat is None or t_ns - self.beat.t_ns > limit_ns):
            return False
        agreed = self.ground.disarmed or self.ground.stands(t_ns, limit_ns)
        return agreed and self.landed(t_ns) is VehicleLanded.ON_GROUND

    def _system(self, t_ns: int, message: Any) -> None:
        self.system.add(t_ns, message)
        self.battery.add_system(t_ns, message)

    def _attitude(self, t_ns: int, message: Any) -> None:
        self.tilt.add(t_ns, tilt_of_rpy(message.roll, message.pitch))

    def _look_at_its_start(self, t_ns: int, message: Any) -> None:
        """Notice that the autopilot has started again by any message that tells it, since not each of them comes.

        Indoors, and before its GPS has a fix, an ArduPilot has no local position. Behind mavros the time is 0: unknown.
        """
        if message.get_type() in _TELL_ITS_START and self._power_on.add(t_ns, message.time_boot_ms):
            self.battery.restarted()
            self.position.forget_takeoff()


def _caps(settings: AutopilotSettings) -> Mapping[int, float]:
    caps = settings.battery
    return {
        mavlink.MAV_BATTERY_CHARGE_STATE_LOW: caps.low_fraction,
        mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL: caps.critical_fraction,
        mavlink.MAV_BATTERY_CHARGE_STATE_EMERGENCY: caps.emergency_fraction,
        mavlink.MAV_BATTERY_CHARGE_STATE_FAILED: 0.0,
        mavlink.MAV_BATTERY_CHARGE_STATE_UNHEALTHY: caps.critical_fraction,
    }


def _seconds(ns: Optional[int]) -> Optional[float]:
    return None if ns is None else round(ns / _S, 3)


# --- sensors ----------------------------------------------------------------------------------------------------------
# Health of the autopilot's sensors for the watchdog: from the bits of SYS_STATUS, and for GPS from GPS_RAW_INT.
#
# What was seen: PX4 takes the bit of a lost GPS away from `present` and `enabled` 7.8 s after the loss, ArduPilot
# leaves it healthy; GPS_RAW_INT says it at once (fix), or by silence, or by values that stand still.


GYRO = mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
ACCEL = mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
GPS = mavlink.MAV_SYS_STATUS_SENSOR_GPS
RC = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK

SENSORS: Mapping[str, Tuple[int, ...]] = {
    "gps": (GPS,),
    "imu": (GYRO, ACCEL),
    "magnetometer": (mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG,),
    "barometer": (mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,),
}


class SystemStatus:
    """The bits of SYS_STATUS, which were ever present, and how many came (`sequence`).

    Args:
        age_limit_ns: older than this they say nothing.
    """

    def __init__(self, age_limit_ns: int) -> None:
        self.age_limit_ns = age_limit_ns
        self._t_ns: Optional[int] = None
        self._present = self._enabled = self._health = self._ever = 0
        self.sequence = 0

    def add(self, t_ns: int, message: Any) -> None:
        """Take a SYS_STATUS."""
        self.sequence += 1
        self._t_ns = t_ns
        self._present = message.onboard_control_sensors_present
        self._enabled = message.onboard_control_sensors_enabled
        self._health = message.onboard_control_sensors_health
        self._ever |= self._present

    def fresh(self, t_ns: int) -> bool:
        """Return whether the bits say anything."""
        return self._t_ns is not None and t_ns - self._t_ns <= self.age_limit_ns

    def healthy(self, t_ns: int, bits: Tuple[int, ...]) -> Optional[bool]:
        """Return whether all of these work; a bit that has left `present` has failed, one that never was is unknown."""
        if not self.fresh(t_ns):
            return None
        if not all(self._ever & bit for bit in bits):
            return None
        good = self._present & self._enabled & self._health
        return all(good & bit for bit in bits)

    def rc(self, t_ns: int) -> Optional[bool]:
        """Return whether a transmitter is heard: without one PX4 has RC enabled and unhealthy, and never present."""
        if not self.fresh(t_ns) or not (self._present | self._enabled) & RC:
            return None
        return bool(self._present & self._enabled & self._health & RC)

    def prearm(self, t_ns: int) -> Optional[bool]:
        """Return the verdict of the pre-arm checks; PX4 has their bit in `health` only."""
        return bool(self._health & PREARM) if self.fresh(t_ns) else None


_SATELLITES_UNKNOWN = 255
_GPS_NUMBERS = 1 << 31  # from here on they are of GPS_RAW_INT
_FIXES: Mapping[int, str] = {
    mavlink.GPS_FIX_TYPE_NO_GPS: "no GPS",
    mavlink.GPS_FIX_TYPE_NO_FIX: "no fix",
    mavlink.GPS_FIX_TYPE_2D_FIX: "2D",
    mavlink.GPS_FIX_TYPE_3D_FIX: "3D",
    mavlink.GPS_FIX_TYPE_DGPS: "DGPS",
    mavlink.GPS_FIX_TYPE_RTK_FLOAT: "RTK float",
    mavlink.GPS_FIX_TYPE_RTK_FIXED: "RTK fixed",
}


class GpsLimits(NamedTuple):
    """Limits of the GPS: least fix type (3: three-dimensional), longest silence, longest time with the same values."""

    min_fix_type: int = 3
    age_limit_ns: int = 2 * _S
    frozen_limit_ns: int = 3 * _S


class Gps:
    """The GPS receiver as GPS_RAW_INT shows it.

    Args:
        limits: see there.
    """

    def __init__(self, limits: GpsLimits) -> None:
        self._limits = limits
        self._t_ns: Optional[int] = None
        self._changed_ns = self._stepped_ns = 0
        self._time_usec: Optional[int] = None
        self._values: Tuple[int, ...] = ()
        self._satellites: Optional[float] = None
        self.fix_type = self._count = 0

    def add(self, t_ns: int, message: Any, *, at_rest: bool = False) -> None:
        """Take a GPS_RAW_INT; a receiver at rest may say the same again and again, with new stamps."""
        values = tuple(getattr(message, name) for name in ("lat", "lon", "alt", "eph", "epv", "vel", "cog"))
        if self._t_ns is None or at_rest or values != self._values:
            self._changed_ns = t_ns
        if self._t_ns is None or message.time_usec != self._time_usec:
            self._stepped_ns = t_ns
        self._t_ns, self._values, self._time_usec = t_ns, values, message.time_usec
        self._count += 1
        self.fix_type = int(message.fix_type)
        seen = int(message.satellites_visible)
        self._satellites = None if seen == _SATELLITES_UNKNOWN else float(seen)

    def fix(self, t_ns: int) -> Tuple[str, Optional[float]]:
        """Return the kind of fix and the number of satellites; empty and None when nothing has told it lately."""
        if self._t_ns is None or not t_ns - self._t_ns <= self._limits.age_limit_ns:
            return "", None
        return _FIXES.get(self.fix_type, f"type {self.fix_type}"), self._satellites

    def problem(self, t_ns: int) -> Optional[str]:
        """Return what is wrong; empty: nothing; None: it was never heard."""
        if self._t_ns is None:
            return None
        age_ns = t_ns - self._t_ns
        if not age_ns <= self._limits.age_limit_ns:
            return f"silent for {age_ns / _S:.1f} s"
        if self.fix_type < self._limits.min_fix_type:
            return f"fix type {self.fix_type}, needed {self._limits.min_fix_type}"
        still_ns = self._t_ns - min(self._changed_ns, self._stepped_ns)
        if still_ns > self._limits.frozen_limit_ns:
            return f"frozen: the same values for {still_ns / _S:.1f} s"
        return ""

    def sequence(self, t_ns: int) -> int:
        """Return the number of the last GPS_RAW_INT, none that a SYS_STATUS has; 0: it is silent."""
        return _GPS_NUMBERS + self._count if self.age_s(t_ns) * _S <= self._limits.age_limit_ns else 0

    def age_s(self, t_ns: int) -> float:
        """Return the time since the last GPS_RAW_INT, infinite when there was none."""
        return inf if self._t_ns is None else (t_ns - self._t_ns) / _S


def gps_health(*, system: Optional[bool], problem: Optional[str]) -> Optional[bool]:
    """Return the health of the GPS from its bit and from GPS_RAW_INT: bad when either says so."""
    if problem or system is False:
        return False
    return True if problem == "" else system


def gps_by_its_bit(*, system: Optional[bool], problem: Optional[str]) -> bool:
    """Return whether it is the bit that decides the health of the GPS, not GPS_RAW_INT."""
    return problem is None or (not problem and system is False)


# --- offset -----------------------------------------------------------------------------------------------------------
# How far the vehicle's clocks are from this computer's: since its start (TIMESYNC), and of the day (SYSTEM_TIME).
#
# We ask with our time, it answers with its own; of the last answers the one that came quickest is right within half
# of the time it took. https://mavlink.io/en/services/timesync.html


_ASK_NS = 1_000_000_000
_LONGEST_NS = 500_000_000
_KEPT = 16
_YEAR_2020_US = 1_577_836_800_000_000


class Sync(NamedTuple):
    """The vehicle's clock minus ours, and how long the answer took; ns."""

    offset_ns: int
    round_trip_ns: int


class ClockOffset:
    """Asks and listens."""

    def __init__(self) -> None:
        self._asked: Optional[int] = None
        self._due_ns = 0
        self._answers: Deque[Sync] = deque(maxlen=_KEPT)
        self.utc_offset_ns: Optional[int] = None

    def wake(self, t_ns: int) -> Optional[Message]:
        """Return a question when one is due."""
        if t_ns < self._due_ns:
            return None
        self._due_ns, self._asked = t_ns + _ASK_NS, t_ns
        return mavlink.MAVLink_timesync_message(0, t_ns)

    def add(self, t_ns: int, message: Any) -> None:
        """Take a TIMESYNC; the vehicle's own questions (tc1 of 0) and answers to others are not ours."""
        if message.tc1 <= 0 or message.ts1 != self._asked:
            return
        self._asked = None
        took_ns = t_ns - message.ts1
        if 0 <= took_ns <= _LONGEST_NS:
            self._answers.append(Sync(message.tc1 - message.ts1 - took_ns // 2, took_ns))

    def add_system_time(self, unix_ns: int, message: Any) -> None:
        """Take a SYSTEM_TIME; one before 2020 says that the vehicle has no time of day."""
        known = message.time_unix_usec >= _YEAR_2020_US and unix_ns > 0
        self.utc_offset_ns = message.time_unix_usec * 1000 - unix_ns if known else None

    @property
    def best(self) -> Optional[Sync]:
        """The quickest of the last answers, None when there was none."""
        return min(self._answers, key=lambda answer: answer.round_trip_ns) if self._answers else None
