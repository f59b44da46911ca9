"""What the planner knows of the vehicle: the last word of each kind, and when it came. Pure.

Every reading has an age; what is old is unknown. Positions that are fresh and wrong are told by the estimator's flags.
"""

from __future__ import annotations

import math
from typing import Callable, Dict, Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import Place, PlannerSpec

from ..link.dialect import Message, mavlink, source_of
from ..vehicle.agreement import Agreement, Ground, PowerOn
from ..vehicle.client import asked_rates_hz
from ..vehicle.modes import LAND, Control, Heartbeat, is_foreign, is_piloted, kind_problem, mode_name, mode_number
from ..vehicle.texts import Texts
from ..vehicle.vehicle import SystemStatus
from .mission_upload import Dialect

_S = 1_000_000_000
AIRBORNE = (VehicleLanded.TAKING_OFF, VehicleLanded.IN_AIR, VehicleLanded.LANDING)
MISSION, OFFBOARD = "AUTO.MISSION", "OFFBOARD"
SILENT, _ARMED_UNKNOWN = "the vehicle is silent", "whether the vehicle is armed is not known"
MODE_LATE_NS = 1_300_000_000  # PX4 beats at 1 Hz
_TWO_BEATS_NS = 2_300_000_000  # of a PX4: no limit makes its mode unknown between two

_LANDED = {
    mavlink.MAV_LANDED_STATE_ON_GROUND: VehicleLanded.ON_GROUND,
    mavlink.MAV_LANDED_STATE_TAKEOFF: VehicleLanded.TAKING_OFF,
    mavlink.MAV_LANDED_STATE_IN_AIR: VehicleLanded.IN_AIR,
    mavlink.MAV_LANDED_STATE_LANDING: VehicleLanded.LANDING,
}
_RELATIVE, _ABSOLUTE = mavlink.ESTIMATOR_POS_HORIZ_REL, mavlink.ESTIMATOR_POS_HORIZ_ABS
_VERTICAL = mavlink.ESTIMATOR_POS_VERT_ABS
_ESTIMATE_AGE_NS = _SYSTEM_AGE_NS = 3 * _S
_ARDUPILOT_BAD = mavlink.EKF_CONST_POS_MODE | mavlink.EKF_UNINITIALIZED  # PX4 sets the first at rest, too
_OTHERS = {
    Dialect.PX4: ("EKF_STATUS_REPORT", "HEARTBEAT"),  # it beats at 1 Hz, and refuses to be asked
    Dialect.ARDUPILOT: ("ESTIMATOR_STATUS", "CURRENT_MODE"),
}
RESTART = "MIS_RESTART"
"""Parameter of an ArduPilot: its mission begins anew whenever it enters AUTO, also where it was held."""
_NO_ITEMS = 65535  # MISSION_CURRENT of a vehicle that has no mission
_WARNING = mavlink.MAV_SEVERITY_WARNING
_COMPLAINTS = 3
_DEG7, _MM = 1e-7, 1e-3
_DEGREE_M = 111_319.5
_POLAR_DEG, _TURN_DEG = 85.0, 180.0


class Pose(NamedTuple):
    """The local position (ENU, REP-103) in the frame of the estimator.

    Args:
        t_ns: when it came.
        position_m: east, north, up.
        velocity_m_s: likewise.
        on_ms: for how long the vehicle had been on then; 0: it does not say.
    """

    t_ns: int
    position_m: Tuple[float, float, float]
    velocity_m_s: Tuple[float, float, float]
    on_ms: int = 0

    @property
    def speed_m_s(self) -> float:
        """Return how fast it moves."""
        return math.sqrt(sum(each * each for each in self.velocity_m_s))


class HomePlace(NamedTuple):
    """Where home is: east and north in metres, from anywhere; its height is not kept.

    Args:
        t_ns: when it came.
        where_m: east, north.
    """

    t_ns: int
    where_m: Tuple[float, float]


class VehicleWatch:
    """Takes messages, keeps the last of each kind, and what several agree on.

    Args:
        limits: of the engine, for how long they must agree; None: those that ship.
        silence_ns: without a message for longer than that it was silent.
    """

    def __init__(self, limits: Optional[Limits] = None, silence_ns: int = PlannerSpec().vehicle_age_limit_ns) -> None:
        self.limits, self._silence_ns = limits or Limits(), silence_ns
        self.control, self.ground = Control(), Ground(self.limits.flight_end_confirm_ns)
        self._aloft, self._lifted, self._landing = Agreement(), Agreement(), Agreement()
        self._others, self._in_land, self._off_setpoints = Agreement(), Agreement(), Agreement()
        self._same_mode = Agreement()
        self.autopilot = int(mavlink.MAV_AUTOPILOT_PX4)
        self.target: Tuple[int, int] = (0, 0)
        self.heartbeat_ns: Optional[int] = None
        self._heard_ns = 0
        self._stood_ns = 0  # for so long this process stood still since then: no silence of the vehicle
        self.speaks_since_ns = 0  # after its last silence
        self.mode_ns: Optional[int] = None
        self.armed: Optional[bool] = None
        self.mode = ""
        self.latest_mode = ""
        self.latest_ns = 0
        self.landed = VehicleLanded.UNKNOWN
        self.landed_ns: Optional[int] = None
        self.pose: Optional[Pose] = None
        self.power_on = PowerOn()
        self.yaw_rad: Optional[float] = None
        self.yaw_ns = 0
        self.place: Optional[Place] = None
        self.height_m = self.sea_m = 0.0  # above home; above the sea, 0: it does not say
        self.place_ns = self.place_on_ms = 0
        self.homes: Dict[bool, HomePlace] = {}  # as it was told: on the earth, or in its local frame
        self.estimator: Optional[int] = None
        self.estimator_ns = 0
        self.current: Optional[int] = None
        self.current_ns: Optional[int] = None
        self.total: Optional[int] = None  # items of the mission that it has; None: it does not say
        self.mission_id = 0  # that tells its mission from another one (PX4: a checksum); 0: it does not say
        self.reached: Optional[int] = None
        self.restarts: Optional[bool] = None  # whether a mission that was held begins anew (ArduPilot); None: not said
        self.texts = Texts()
        self._system = SystemStatus(_SYSTEM_AGE_NS)
        self.results: Dict[int, str] = {}

    def take(self, t_ns: int, message: Message, *, heard: bool = True) -> None:
        """Take a message of the vehicle; not heard: another one's answer in its place."""
        if heard:
            silent = t_ns - self._heard_ns - self._stood_ns > self._silence_ns
            self.speaks_since_ns, self._heard_ns = t_ns if silent else self.speaks_since_ns, t_ns
            self._stood_ns = 0
        take = _TAKES.get(message.get_type())
        if take is not None:
            take(self, t_ns, message)

    def stood_still(self, duration_ns: int) -> None:
        """Take that this process stood still: nobody knows whether the vehicle was silent meanwhile."""
        self._stood_ns += duration_ns

    def known(self, t_ns: int, limit_ns: int) -> bool:
        """Return whether the vehicle speaks: it has beaten, and the last that it said is young."""
        return self.heartbeat_ns is not None and t_ns - self._heard_ns <= limit_ns

    def tells_mode(self, t_ns: int, limit_ns: int) -> bool:
        """Return whether it has told its flight mode lately: all else may come, and its mode not."""
        told_ns = self.mode_ns
        return self.known(t_ns, limit_ns) and told_ns is not None and t_ns - told_ns <= max(limit_ns, _TWO_BEATS_NS)

    def unknown(self, t_ns: int, limit_ns: int) -> str:
        """Return what nobody knows of it that must be known to command it, in words; empty: nothing."""
        if self.mode_ns is None or self.heartbeat_ns is None or not self.known(t_ns, limit_ns):
            return SILENT
        for told_ns, words in ((self.mode_ns, "the flight mode is not known"), (self.heartbeat_ns, _ARMED_UNKNOWN)):
            if t_ns - told_ns > max(limit_ns, _TWO_BEATS_NS):
                return words if self._heard_ns - told_ns > MODE_LATE_NS else SILENT  # it came until nothing did
        return ""

    def on_ground(self, t_ns: int, limit_ns: int) -> bool:
        """Return whether it says, freshly, that it is on the ground."""
        fresh = self.landed_ns is not None and t_ns - self.landed_ns <= limit_ns
        return fresh and self.landed is VehicleLanded.ON_GROUND

    def local(self, t_ns: int, limit_ns: int) -> Optional[Pose]:
        """Return the local position, unless it is old or the estimator disowns it."""
        good = self.pose is not None and t_ns - self.pose.t_ns <= limit_ns
        return self.pose if good and self._estimates(t_ns, _RELATIVE | _ABSOLUTE) else None

    def heading(self, t_ns: int, limit_ns: int) -> Optional[float]:
        """Return the yaw in radians counter-clockwise from east, unless it is old."""
        return self.yaw_rad if t_ns - self.yaw_ns <= limit_ns else None

    def has_height(self, t_ns: int) -> bool:
        """Return whether the estimator stands by its height."""
        return self._estimates(t_ns, _VERTICAL)

    def somewhere(self, t_ns: int, limit_ns: int) -> Optional[Place]:
        """Return the place on the earth, unless it is old or the estimator disowns it."""
        good = self.place is not None and t_ns - self.place_ns <= limit_ns
        return self.place if good and self._estimates(t_ns, _ABSOLUTE) else None

    @property
    def lands(self) -> bool:
        """True while it says that it lands, armed."""
        return bool(self.armed) and self.landed is VehicleLanded.LANDING

    @property
    def is_aloft(self) -> bool:
        """True while messages agree that it has left the ground."""
        return self._aloft.lasts(self.limits.pilot_confirm_ns)

    @property
    def is_up(self) -> bool:
        """True while messages agree that it is in the air, its takeoff over."""
        return self._lifted.lasts(self.limits.pilot_confirm_ns)

    @property
    def descends(self) -> bool:
        """True while messages agree that it lands."""
        return self._landing.lasts(self.limits.flight_end_confirm_ns)

    @property
    def failsafe(self) -> bool:
        """True while the autopilot acts by a failsafe; ArduPilot at a low battery does only in a mode that it chose."""
        return self.control.failsafe

    @property
    def pilot(self) -> bool:
        """True in a mode that pilots choose or that is never ours, a return among them, unless a failsafe chose it.

        In a mode of the sticks that shows under the flag a pilot flies where a transmitter is heard.
        """
        return is_foreign(self.mode) and (not self.failsafe or (is_piloted(self.mode) and bool(self._transmitter)))

    @property
    def may_be_pilot(self) -> bool:
        """True in a mode of the sticks under the flag, for as long as what says whether a transmitter is heard counts.

        Where nothing has said it by then the failsafe is taken to have chosen that mode, as it does when a transmitter
        is lost: a vehicle that nobody flies is landed.
        """
        since_ns = self._others.since_ns
        unknown = self.failsafe and is_piloted(self.mode) and not self._system.fresh(self._heard_ns)
        return unknown and since_ns is not None and self._heard_ns - since_ns < _SYSTEM_AGE_NS

    @property
    def others_fly(self) -> bool:
        """True while messages agree that a pilot flies it, in whatever mode, or that a failsafe acts.

        In a mode of the sticks under the flag nobody may fly it: there that counts where a transmitter is heard.
        """
        sticks = self.failsafe and is_piloted(self.mode)
        return self._others.lasts(self.limits.pilot_confirm_ns) and (not sticks or bool(self._transmitter))

    @property
    def _transmitter(self) -> Optional[bool]:
        """Whether a transmitter is heard; of a silent vehicle, what it said last; None: not known."""
        return self._system.rc(self._heard_ns)

    @property
    def in_land(self) -> bool:
        """True while messages agree on the landing mode."""
        return self._in_land.lasts(self.limits.pilot_confirm_ns)

    @property
    def off_setpoints(self) -> bool:
        """True while messages agree on a mode that follows no set-points."""
        return self._off_setpoints.lasts(self.limits.pilot_confirm_ns)

    @property
    def keeps_mode(self) -> bool:
        """True while messages agree on the mode that it is in."""
        return self._same_mode.lasts(self.limits.pilot_confirm_ns)

    @property
    def kind_problem(self) -> str:
        """Why this kind of vehicle is not flown, in words; empty: it is a multicopter, or was not heard."""
        return "" if self.control.beat is None else kind_problem(self.control.beat.vehicle)

    @property
    def dialect(self) -> Dialect:
        """How it speaks the mission protocol."""
        ardupilot = self.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        return Dialect.ARDUPILOT if ardupilot else Dialect.PX4

    @property
    def unknown_streams(self) -> Tuple[str, ...]:
        """Messages of `STREAMS` that this autopilot does not have."""
        return _OTHERS[self.dialect]

    def numbers(self, mode: str) -> Optional[Tuple[int, int]]:
        """Return the parameters 2 and 3 of DO_SET_MODE; None where there is no such mode."""
        return mode_number(self.autopilot, mode)

    def complaints(self, t_ns: int, since_ns: int) -> Tuple[str, ...]:
        """Return its warnings since a time, in its words; why it does not arm before anything else, at most three."""
        said = [text.text for text in self.texts.recent(t_ns, t_ns - since_ns) if text.severity <= _WARNING]
        reasons = self.texts.complaints(t_ns, t_ns - since_ns)
        return tuple(reasons or said)[-_COMPLAINTS:]

    def _estimates(self, t_ns: int, any_of: int) -> bool:
        fresh = self.estimator is not None and t_ns - self.estimator_ns <= _ESTIMATE_AGE_NS
        flags = self.estimator or 0
        disowned = self.dialect is Dialect.ARDUPILOT and bool(flags & _ARDUPILOT_BAD)
        return fresh and bool(flags & any_of) and not disowned

    # --- messages -------------------------------------------------------------------------------------------------

    def _heartbeat(self, t_ns: int, message: Message) -> None:
        self.autopilot, self.target, self.heartbeat_ns = message.autopilot, source_of(message), t_ns
        beat = Heartbeat.of(t_ns, message)
        self.control.add(beat)
        self.armed, self.latest_mode, self.latest_ns = beat.armed, beat.mode, t_ns
        self.ground.add_armed(t_ns, armed=beat.armed)
        self._take_mode(t_ns, beat.mode)

    def _take_mode(self, t_ns: int, mode: str) -> None:
        if mode != self.mode:
            self._same_mode.add(t_ns, so=False)
        self._same_mode.add(t_ns, so=True)
        self.mode, self.mode_ns = mode, t_ns
        self._others.add(t_ns, so=self.control.pilot or self.control.acts_alone)
        self._in_land.add(t_ns, so=mode == LAND)
        self._off_setpoints.add(t_ns, so=mode != OFFBOARD)

    def _current_mode(self, t_ns: int, message: Message) -> None:
        """Take the mode in the air; on the ground, that of a heartbeat, which says as well whether it is disarmed.

        What it says on the ground is `latest_mode`, for a takeoff that somebody else comes before.
        """
        if self.heartbeat_ns is None:
            return
        self.latest_mode, self.latest_ns = mode_name(self.autopilot, message.custom_mode), t_ns
        if self.landed in AIRBORNE:
            self.control.add_mode(t_ns, message.custom_mode)
            self._take_mode(t_ns, self.latest_mode)

    def _event(self, t_ns: int, message: Message) -> None:
        if not self.armed:  # armed, they tell which modes are not to be had now
            self.texts.add_event(t_ns, message)

    def _extended(self, t_ns: int, message: Message) -> None:
        self.landed, self.landed_ns = _LANDED.get(message.landed_state, VehicleLanded.UNKNOWN), t_ns
        self.ground.add_landed(t_ns, self.landed)
        self._aloft.add(t_ns, so=self.landed in AIRBORNE)
        self._lifted.add(t_ns, so=self.landed is VehicleLanded.IN_AIR)
        self._landing.add(t_ns, so=self.landed is VehicleLanded.LANDING)

    def _local(self, t_ns: int, message: Message) -> None:
        values = (message.y, message.x, -message.z, message.vy, message.vx, -message.vz)
        if all(map(math.isfinite, values)):
            self.pose = Pose(t_ns, values[:3], values[3:], message.time_boot_ms)
        self.power_on.add(t_ns, message.time_boot_ms)

    def _attitude(self, t_ns: int, message: Message) -> None:
        if math.isfinite(message.yaw):
            self.yaw_rad, self.yaw_ns = math.pi / 2 - message.yaw, t_ns

    def _global(self, t_ns: int, message: Message) -> None:
        place = Place(message.lat * _DEG7, message.lon * _DEG7)
        if abs(place.latitude_deg) > _POLAR_DEG or abs(place.longitude_deg) > _TURN_DEG:
            return  # what is there, or nowhere, cannot be flown around in metres
        self.place, self.place_ns, self.place_on_ms = place, t_ns, message.time_boot_ms
        self.height_m, self.sea_m = message.relative_alt * _MM, message.alt * _MM

    def _home(self, t_ns: int, message: Message) -> None:
        """Take its place as it is told; behind mavros an ArduPilot's comes in both ways, and they do not compare."""
        where, on_earth = (message.y, message.x), bool(message.latitude or message.longitude)
        if on_earth:  # made of mavros' topic it has none
            latitude = message.latitude * _DEG7
            east = message.longitude * _DEG7 * math.cos(math.radians(latitude))
            where = (east * _DEGREE_M, latitude * _DEGREE_M)
        if all(map(math.isfinite, where)):
            self.homes[on_earth] = HomePlace(t_ns, where)

    def _estimator(self, t_ns: int, message: Message) -> None:
        self.estimator, self.estimator_ns = message.flags, t_ns

    def _system_status(self, t_ns: int, message: Message) -> None:
        self._system.add(t_ns, message)

    def _current(self, t_ns: int, message: Message) -> None:
        self.current, self.current_ns = message.seq, t_ns
        total = getattr(message, "total", 0)  # an extension: 0 of a vehicle that has it not, 65535 of one without items
        self.total = None if total == 0 else total % _NO_ITEMS
        self.mission_id = getattr(message, "mission_id", 0)  # likewise

    def _reached(self, _: int, message: Message) -> None:
        self.reached = message.seq

    def _parameter(self, _: int, message: Message) -> None:
        if message.param_id == RESTART:
            self.restarts = message.param_value != 0.0

    def _text(self, t_ns: int, message: Message) -> None:
        self.texts.add(t_ns, message)

    def _ack(self, _: int, message: Message) -> None:
        found = mavlink.enums["MAV_RESULT"].get(message.result)
        self.results[message.command] = str(found.name) if found else f"result {message.result}"


_TAKES: Mapping[str, Callable[[VehicleWatch, int, Message], None]] = {
    "HEARTBEAT": VehicleWatch._heartbeat,  # noqa: SLF001 - the table of this class
    "CURRENT_MODE": VehicleWatch._current_mode,  # noqa: SLF001
    "EVENT": VehicleWatch._event,  # noqa: SLF001
    "EXTENDED_SYS_STATE": VehicleWatch._extended,  # noqa: SLF001
    "LOCAL_POSITION_NED": VehicleWatch._local,  # noqa: SLF001
    "ATTITUDE": VehicleWatch._attitude,  # noqa: SLF001
    "GLOBAL_POSITION_INT": VehicleWatch._global,  # noqa: SLF001
    "HOME_POSITION": VehicleWatch._home,  # noqa: SLF001
    "ESTIMATOR_STATUS": VehicleWatch._estimator,  # noqa: SLF001
    "EKF_STATUS_REPORT": VehicleWatch._estimator,  # noqa: SLF001 - the same bits
    "SYS_STATUS": VehicleWatch._system_status,  # noqa: SLF001
    "MISSION_CURRENT": VehicleWatch._current,  # noqa: SLF001
    "MISSION_ITEM_REACHED": VehicleWatch._reached,  # noqa: SLF001
    "PARAM_VALUE": VehicleWatch._parameter,  # noqa: SLF001
    "STATUSTEXT": VehicleWatch._text,  # noqa: SLF001
    "COMMAND_ACK": VehicleWatch._ack,  # noqa: SLF001
}
TAKEN = tuple(_TAKES)
"""Names of the messages that are looked at."""
STREAMS: Mapping[str, float] = {
    "EXTENDED_SYS_STATE": 5.0,
    "LOCAL_POSITION_NED": 20.0,
    "ATTITUDE": 10.0,
    "GLOBAL_POSITION_INT": 5.0,
    "ESTIMATOR_STATUS": 2.0,
    "EKF_STATUS_REPORT": 2.0,
    "SYS_STATUS": 2.0,
    "HEARTBEAT": 5.0,
    "CURRENT_MODE": 10.0,
    "MISSION_CURRENT": 2.0,
}
"""Streams that the planner needs, and their rates in Hz."""
_COME_UNASKED = ("HEARTBEAT", "CURRENT_MODE")  # seldom: asked for, a takeover is noticed earlier


def streams_hz(settings: AutopilotSettings) -> Mapping[str, float]:
    """Return what the planner asks for, and at which rates: never below what the autopilot node asks for.

    Where both share a channel to the vehicle, a message has one rate there, and who asks last says it.

    Raises:
        ConfigError: `rates_hz` of autopilot.yaml names what is no message.
    """
    theirs, unwanted = asked_rates_hz(settings), [name for name, hz in settings.rates_hz.items() if not hz]
    ours = {name: hz for name, hz in STREAMS.items() if name not in unwanted or name not in _COME_UNASKED}
    return {name: max(hz, theirs.get(name, 0.0)) for name, hz in ours.items()}
