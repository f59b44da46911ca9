"""What the autopilot node does on its link: listens, asks for what it needs, lands and disarms. Pure.

Drive it with a `Connection`; the services call `land`, `disarm` and the checks through `Connection.ask`.
"""

from __future__ import annotations

import enum
from dataclasses import replace
from typing import Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.config import AutopilotSettings, ConfigError
from amaze_autonomy.config.errors import Place
from amaze_autonomy.config.schemas.autopilot import JUDGED_RATES
from amaze_autonomy.engine.events import AutopilotStatus, Landed, VehicleLanded
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.monitoring.battery import BatteryMonitor, BatteryVerdict
from amaze_autonomy.monitoring.land_switch import LandSwitchMonitor
from amaze_autonomy.monitoring.specs import BatterySpec

from ...engine.events import Check
from ..link.dialect import Message, mavlink, message_id
from .agreement import GROUND_NS, Attention
from .asked import Parameters, Rates
from .modes import LAND, LANDING_MODES, is_piloted, mode_number
from .preflight import Preflight, battery_state_row, channel_width_us, land_switch_rows, preflight_rows
from .vehicle import WANTED, VehicleState

_S = 1_000_000_000
_BREAK_NS = 5 * _S
_ASK_PREARM_NS = 5 * _S
_NOT_PX4, _NOT_ARDUPILOT = (
    ("EKF_STATUS_REPORT", "HEARTBEAT", "GPS_GLOBAL_ORIGIN"),
    ("ESTIMATOR_STATUS", "CURRENT_MODE"),
)
_BEAT_LATE_NS, _ASK_BEAT_NS = 1_300_000_000, 300_000_000  # PX4 beats at 1 Hz

ASKED_FOR: Mapping[str, Tuple[float, str]] = {
    **{name: asked for name, asked in WANTED.items() if asked[0]},
    "SYSTEM_TIME": (1.0, "its time of day"),
    "RC_CHANNELS": (
        JUDGED_RATES["RC_CHANNELS"].rate_hz,
        "the switch that lands, where `land_switch` has a channel",
    ),
}
"""The messages that are asked for: at which rate, unless `rates_hz` of autopilot.yaml says another, and why."""
CLIENT_MESSAGES: Tuple[str, ...] = (*WANTED, "COMMAND_ACK", "PARAM_VALUE", "SYSTEM_TIME")

Address = Callable[[], Tuple[int, int]]


class _Other(NamedTuple):
    """Somebody else who has control, in words: messages agree on it, or it is its first sign."""

    agreed: str
    first_sign: str


_PILOT = _Other("the pilot has control, in {}", "the pilot seems to have control, in {}: landing if he has not")
_FAILSAFE = _Other(
    "the autopilot acts by its failsafe, in {}", "the autopilot seems to act by its failsafe, in {}: landing if not"
)


def switch_messages(settings: AutopilotSettings) -> Tuple[str, ...]:
    """Return the messages that the land switch needs besides."""
    return ("RC_CHANNELS",) if settings.land_switch.channel else ()


def asked_rates_hz(settings: AutopilotSettings) -> Dict[str, float]:
    """Return the rate of each message that is asked for.

    Raises:
        ConfigError: one has another rate that is no message.
    """
    for name in settings.rates_hz:
        try:
            message_id(name)
        except KeyError:
            right = "must be one of https://mavlink.io/en/messages/ardupilotmega.html"
            place = settings.rates_places.get(name, Place("autopilot.yaml"))
            raise ConfigError(place, f"rates_hz.{name}", "is no message", right) from None
    without = () if settings.land_switch.channel else ("RC_CHANNELS",)
    ours = {name: rate_hz for name, (rate_hz, _) in ASKED_FOR.items() if name not in without}
    return {name: rate_hz for name, rate_hz in {**ours, **settings.rates_hz}.items() if rate_hz}


class Reply(NamedTuple):
    """The answer to a command.

    Args:
        accepted: it was done or sent.
        message: in words.
        final: nothing more is to be waited for.
    """

    accepted: bool
    message: str
    final: bool


class AutopilotClient:
    """One vehicle and what we ask of it.

    Args:
        settings: of autopilot.yaml.
        battery: of sensors.yaml.
        address: returns system and component of the vehicle.
        wall_minus_clock_ns: wall time minus the clock of the messages, for the vehicle's time of day.
        strangers: returns where others speak from that say our vehicle's system id; None: that cannot be told.
        limits: of the engine, for how long messages must agree; None: those that ship.

    Raises:
        ConfigError: `rates_hz` names what is no message.
    """

    def __init__(
        self,
        settings: AutopilotSettings,
        battery: BatterySpec,
        address: Address,
        wall_minus_clock_ns: Callable[[], int] = lambda: 0,
        strangers: Callable[[], Optional[Sequence[str]]] = lambda: (),
        limits: Optional[Limits] = None,
    ) -> None:
        self.settings, self._battery = settings, battery
        self._address, self._wall, self._strangers = address, wall_minus_clock_ns, strangers
        self._confirm_ns = (limits or Limits()).flight_end_confirm_ns
        self.vehicle = VehicleState(settings, battery.cells, limits)
        self.land_switch = LandSwitchMonitor(settings.land_switch)
        self._rates, self._parameters = Rates(asked_rates_hz(settings)), Parameters(settings.parameters)
        pauses = CommandLimits(settings.commands.repeat_ns, settings.commands.limit_ns)
        self.landing = Confirmed(self._land_message, self._landing_seen, pauses, stands=True)
        self.disarming = Confirmed(self._disarm_message, self._disarm_seen, pauses)
        self._lands = False
        self._attention = Attention()
        self._t_ns = self._prearm_due_ns = self._beat_due_ns = self._restarts = 0
        self.on_text: Callable[[int, str], None] = lambda _severity, _text: None

    def status(self, t_ns: int) -> AutopilotStatus:
        """Return all of the vehicle as the engine takes it; after a long stall no state that may be over for long."""
        told, beat = self.vehicle.status(t_ns), self.vehicle.beat
        if self._attention.doubts(None if beat is None else beat.t_ns):
            return replace(told, armed=None, landed=VehicleLanded.UNKNOWN, mode="")
        return told

    # --- the link's thread ----------------------------------------------------------------------------------------

    def receive(self, t_ns: int, message: Message, *, heard: bool = True) -> List[Message]:
        """Take a message of the vehicle; not heard: another one's answer in its place."""
        age_ns = self.vehicle.link_age_ns(t_ns)
        self._look(t_ns)
        name = message.get_type()
        self._rates.heard(t_ns, name)
        self.vehicle.receive(t_ns, message, heard=heard)
        if name == "HEARTBEAT":
            settings = self.settings
            self._parameters.expect(settings.parameters if self._is_px4() else settings.ardupilot_parameters)
            self._began_again(age_ns is None or age_ns > _BREAK_NS)
            self._look_at_the_landing()
            return [*self.landing.wake(t_ns), *self.disarming.wake(t_ns), *self._ask_beat(t_ns)]
        if name == "CURRENT_MODE":
            self._look_at_the_landing()
            return [*self.landing.wake(t_ns), *self._ask_beat(t_ns)]
        if name == "COMMAND_ACK":
            self._acknowledged(message)
        elif name == "PARAM_VALUE":
            self._parameters.add(message, bytewise=self._is_px4())
        elif name == "RC_CHANNELS":
            self._add_channels(t_ns, message)
        elif name == "SYSTEM_TIME":
            self.vehicle.offset.add_system_time(t_ns + self._wall(), message)
        return []

    def _add_channels(self, t_ns: int, message: Message) -> None:
        """Take the channels; of a transmitter that is not heard a receiver repeats the last ones, or makes them up."""
        silent = self.vehicle.system.rc(t_ns) is False
        width_us = None if silent else channel_width_us(message, self.land_switch.spec.channel)
        self.land_switch.add(t_ns, width_us, self.vehicle.system.sequence)

    def wake(self, t_ns: int, *, read: bool = True) -> List[Message]:
        """Ask for what is missing, send commands again."""
        self._look(t_ns, read=read)
        self.vehicle.texts.wake(t_ns)
        self._tell_texts()
        if not self.vehicle.connected(t_ns):
            self.disarming.stop()  # nobody knows any more whether it is on the ground
            return self.landing.wake(t_ns)
        asked = self.vehicle.offset.wake(t_ns)
        return [
            *self.landing.wake(t_ns),
            *self.disarming.wake(t_ns),
            *self._rates.wake(t_ns, *self._address(), _NOT_PX4 if self._is_px4() else _NOT_ARDUPILOT),
            *self._parameters.wake(t_ns, *self._address()),
            *self._ask_beat(t_ns),
            *([] if asked is None else [asked]),
        ]

    def _look(self, t_ns: int, *, read: bool = False) -> None:
        self._t_ns = t_ns
        self._attention.look(t_ns, read=read)

    # --- commands; through `Connection.ask` -----------------------------------------------------------------------

    def land(self, t_ns: int) -> Tuple[Reply, List[Message]]:
        """Command the landing mode, unless there is no reason to or, by a first sign, somebody else has control."""
        return self._land(t_ns, agreed=False)

    def _land(self, t_ns: int, *, agreed: bool) -> Tuple[Reply, List[Message]]:
        self._look(t_ns)
        refusal = self._no_landing(t_ns, agreed=agreed)
        if refusal is not None:
            return refusal, []
        self.vehicle.control.command(LAND)
        messages = self.landing.ask(t_ns)
        self._lands = True
        if not self.vehicle.connected(t_ns):
            return Reply(
                accepted=False, message="the vehicle is not heard; commanded all the same", final=True
            ), messages
        return self.land_reply(), messages

    @property
    def commanding(self) -> str:
        """What stands: a landing until the vehicle is disarmed or a pilot takes it, a disarming while it is sent."""
        return LAND if self._lands else "DISARM" if self.disarming.sending else ""

    def _look_at_the_landing(self) -> None:
        """End what stands: messages agree that the vehicle is down, or somebody else's."""
        other = self._other(agreed=True)
        if other is not None:
            self.landing.stop()
        if self._flies(agreed=True) is not None:
            self.disarming.stop()
        if other is not None or self.vehicle.is_down(self._t_ns):
            self._lands = False

    def _other(self, *, agreed: bool) -> Optional[_Other]:
        """Return who else has control: at a first sign nothing is sent over him, once agreed what stands is over."""
        vehicle = self.vehicle
        if vehicle.taken_over if agreed else vehicle.control.pilot:
            return _PILOT
        return _FAILSAFE if vehicle.acts_by_failsafe(self._t_ns, agreed=agreed) else None

    def _flies(self, *, agreed: bool) -> Optional[_Other]:
        """Return who flies by the sticks; the mode that PX4 chooses when it disarms is none of a pilot's."""
        return self._other(agreed=agreed) if is_piloted(self._mode) else None

    def _left_to(self, other: _Other) -> Reply:
        return Reply(accepted=False, message=other.agreed.format(self._mode), final=True)

    @property
    def _mode(self) -> str:
        beat = self.vehicle.beat
        return "" if beat is None else beat.mode

    def land_reply(self) -> Reply:
        """Return how far the landing is."""
        other = self._other(agreed=True)
        if other is not None:
            return self._left_to(other)
        other = self._other(agreed=False)
        if other is not None:
            return Reply(accepted=False, message=other.first_sign.format(self._mode), final=False)
        return _reply(self.landing, "the vehicle is in its landing mode", "landing")

    def disarm(self, t_ns: int) -> Tuple[Reply, List[Message]]:
        """Disarm on the ground; anywhere else it is refused."""
        self._look(t_ns)
        beat = self.vehicle.beat
        if beat is None or not self.vehicle.connected(t_ns):
            return Reply(accepted=False, message="no link to the vehicle", final=True), []
        if self._disarm_seen():
            return Reply(accepted=True, message="the vehicle is disarmed", final=True), []
        if not beat.armed:  # somebody may have armed it since, and fly it
            age_s = (t_ns - beat.t_ns) / _S
            said = f"whether it is armed is unknown: its last heartbeat came {age_s:.1f} s ago"
            return Reply(accepted=False, message=said, final=True), []
        other = self._flies(agreed=False)
        if other is not None:
            return self._left_to(other), []
        landed = self.vehicle.landed(t_ns)
        if landed is not VehicleLanded.ON_GROUND:
            return Reply(accepted=False, message=f"not on the ground: the vehicle says {landed.name}", final=True), []
        age_ns = self.vehicle.landed_age_ns(t_ns)
        if age_ns > GROUND_NS:
            said = f"ON_GROUND, as the vehicle said {age_ns / _S:.1f} s ago, is too old to disarm"
            return Reply(accepted=False, message=said, final=True), []
        if not self.vehicle.ground.stands(t_ns, GROUND_NS):
            said = f"ON_GROUND must be said for {self._confirm_ns / _S:g} s before it is believed"
            return Reply(accepted=False, message=said, final=True), []
        messages = self.disarming.ask(t_ns)
        return self.disarm_reply(), messages

    def disarm_reply(self) -> Reply:
        """Return how far the disarming is."""
        other = self._flies(agreed=True)
        if other is not None:
            return self._left_to(other)
        return _reply(self.disarming, "the vehicle is disarmed", "disarming")

    def leave(self, t_ns: int) -> Tuple[Reply, List[Message]]:
        """Command the landing mode because this node ends, unless messages agree that somebody else has control."""
        if not self.vehicle.in_flight(t_ns):
            return Reply(accepted=True, message="the vehicle is not in flight", final=True), []
        reply, messages = self._land(t_ns, agreed=True)  # nobody asks again
        # a vehicle that is not heard may hear: sent on for as long as the node stays
        return reply._replace(final=reply.final and self.landing.progress is not Progress.SENT), messages

    # --- checks ---------------------------------------------------------------------------------------------------

    def check(self, t_ns: int, ground: Optional[Landed]) -> Tuple[Tuple[Check, ...], List[Message]]:
        """Return the rows of the pre-flight table; have the autopilot look again when it is not ready."""
        messages: List[Message] = []
        beat = self.vehicle.beat
        if t_ns >= self._prearm_due_ns and beat is not None and not beat.armed and not self._ready(t_ns):
            self._prearm_due_ns = t_ns + _ASK_PREARM_NS
            messages.append(command_long(*self._address(), mavlink.MAV_CMD_RUN_PREARM_CHECKS))
        return self.rows(t_ns, ground), messages

    def rows(self, t_ns: int, ground: Optional[Landed]) -> Tuple[Check, ...]:
        """Return the rows of the pre-flight table."""
        states, strangers = self._parameters.states, self._strangers()
        known = Preflight(t_ns, self.vehicle, self.settings, states, ground, strangers)
        return (*preflight_rows(known), *land_switch_rows(known, self.land_switch))

    def check_battery(self, t_ns: int, required_fraction: Optional[float]) -> BatteryVerdict:
        """Return whether the battery is enough for the next mission."""
        monitor, reading = BatteryMonitor(self._battery), self.vehicle.battery.reading()
        if reading is not None:
            monitor.add(reading.t_ns, reading.fraction, reading.voltage_v, self.vehicle.battery.volts())
        verdict = monitor.check(t_ns, required_fraction)
        rows = (*verdict.checks, battery_state_row(Preflight(t_ns, self.vehicle, self.settings)))
        return verdict._replace(ok=all(row.passed for row in rows), checks=rows)

    # --- inside ---------------------------------------------------------------------------------------------------

    def _ready(self, t_ns: int) -> bool:
        return bool(self.vehicle.system.prearm(t_ns))

    def _no_landing(self, t_ns: int, *, agreed: bool) -> Optional[Reply]:
        vehicle, other = self.vehicle, self._other(agreed=agreed)
        if vehicle.beat is None:
            return Reply(accepted=False, message="no link to the vehicle", final=True)
        if other is not None:
            return self._left_to(other)
        if vehicle.is_down(t_ns) and vehicle.connected(t_ns):
            return Reply(accepted=True, message="the vehicle is on the ground and disarmed", final=True)
        return None

    def _land_message(self) -> Optional[Message]:
        beat, control, sent_ns = self.vehicle.beat, self.vehicle.control, self.landing.sent_ns
        theirs = self._other(agreed=False) is not None
        if beat is None or theirs or not self._attention.lands(self._t_ns, control.mode_ns):
            return None
        if beat.mode in LANDING_MODES and sent_ns is not None and control.mode_ns > sent_ns and self._tells_mode:
            return None  # one message shows it; others will agree, or a pilot chooses another mode meanwhile
        number = mode_number(beat.autopilot, LAND)
        return None if number is None else set_mode(*self._address(), *number)

    def _landing_seen(self) -> bool:
        vehicle = self.vehicle
        shown = vehicle.in_landing_mode and self._tells_mode
        return vehicle.connected(self._t_ns) and (shown or vehicle.is_down(self._t_ns))

    @property
    def _tells_mode(self) -> bool:
        """Whether the mode was told lately; an older one holds no landing back."""
        return self._t_ns - self.vehicle.control.mode_ns <= _BEAT_LATE_NS

    def _disarm_message(self) -> Optional[Message]:
        age_ns = self.vehicle.landed_age_ns(self._t_ns)
        fresh = age_ns <= GROUND_NS and self._t_ns - age_ns >= self._attention.awake_ns
        if not fresh or not self.vehicle.ground.stands(self._t_ns, GROUND_NS) or self._flies(agreed=False) is not None:
            return None
        return command_long(*self._address(), mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)

    def _disarm_seen(self) -> bool:
        return self.vehicle.armed(self._t_ns) is False

    def _acknowledged(self, message: Message) -> None:
        command = {
            mavlink.MAV_CMD_DO_SET_MODE: self.landing,
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self.disarming,
        }.get(message.command)
        if command is not None:
            command.acknowledged(int(message.result))

    def _began_again(self, after_break: bool) -> None:  # noqa: FBT001
        began = self.vehicle.restarts != self._restarts
        if began:
            self.on_text(mavlink.MAV_SEVERITY_ALERT, "the autopilot has started again")
        if after_break or began:
            self._restarts = self.vehicle.restarts
            self._rates.forget()
            self._parameters.forget()

    def _ask_beat(self, t_ns: int) -> List[Message]:
        """Ask for a heartbeat that was lost, or that must say whether what is new is so, or a failsafe's doing."""
        beat = self.vehicle.beat
        if beat is None or t_ns < self._beat_due_ns:
            return []
        if not self.vehicle.in_doubt and t_ns - beat.t_ns <= _BEAT_LATE_NS:
            return []
        self._beat_due_ns = t_ns + _ASK_BEAT_NS
        return [command_long(*self._address(), mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HEARTBEAT)]

    def _is_px4(self) -> bool:
        beat = self.vehicle.beat
        return beat is None or beat.autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA

    def _tell_texts(self) -> None:
        said: Sequence[Tuple[int, str]] = [(text.severity, text.text) for text in self.vehicle.texts.new]
        self.vehicle.texts.new.clear()
        for severity, text in said:
            self.on_text(severity, text)


def _reply(command: Confirmed, done: str, doing: str) -> Reply:
    if command.progress is Progress.CONFIRMED:
        return Reply(accepted=True, message=done, final=True)
    if command.progress is Progress.SENT:
        said = f"; the autopilot answered: {command.answer}" if command.answer else ""
        return Reply(accepted=True, message=f"{doing}: commanded, not shown yet{said}", final=False)
    said = command.answer or "no answer"
    return Reply(accepted=False, message=f"{doing}: the vehicle did not show it in time ({said})", final=True)


# --- commands ---------------------------------------------------------------------------------------------------------
# Land and disarm: sent, sent again, and confirmed by what the heartbeats show, never by an acknowledgement.
#
# PX4 answers one DO_SET_MODE with two acknowledgements (ACCEPTED, then TEMPORARILY_REJECTED) and some commands with
# none. So they only lend their words to the reason when the state does not change in time.


_RESULTS: Dict[int, str] = {
    mavlink.MAV_RESULT_ACCEPTED: "accepted",
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED: "temporarily rejected",
    mavlink.MAV_RESULT_DENIED: "denied",
    mavlink.MAV_RESULT_UNSUPPORTED: "not supported",
    mavlink.MAV_RESULT_FAILED: "failed",
    mavlink.MAV_RESULT_IN_PROGRESS: "in progress",
}


class Progress(enum.Enum):
    """How far a command is."""

    IDLE = "idle"
    SENT = "sent"
    CONFIRMED = "confirmed"
    GIVEN_UP = "given up"


class CommandLimits(NamedTuple):
    """Time between two sendings, and the time after which it is given up."""

    repeat_ns: int
    limit_ns: int


def command_long(system: int, component: int, command: int, *parameters: float) -> Message:
    """Return a COMMAND_LONG; parameters that are not given are 0."""
    given = [*parameters, *[0.0] * (7 - len(parameters))]
    return mavlink.MAVLink_command_long_message(system, component, command, 0, *given)


def set_mode(system: int, component: int, main: int, sub: int) -> Message:
    """Return the command for a flight mode."""
    custom = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    return command_long(system, component, mavlink.MAV_CMD_DO_SET_MODE, custom, main, sub)


class Confirmed:
    """One command until its effect is seen.

    Args:
        make: returns the message to send.
        done: whether the vehicle shows it.
        limits: see there.
        stands: it is sent on after its limit, until it is done or stopped.
    """

    def __init__(
        self,
        make: Callable[[], Optional[Message]],
        done: Callable[[], bool],
        limits: CommandLimits,
        *,
        stands: bool = False,
    ) -> None:
        self._make, self._done, self._limits, self._stands = make, done, limits, stands
        self.progress = Progress.IDLE
        self.answer = ""
        self.sent_ns: Optional[int] = None  # when it was sent last, since it began
        self._began_ns = self._due_ns = 0

    def ask(self, t_ns: int) -> List[Message]:
        """Begin, or go on when it is under way; return what to send now."""
        if not self.sending:
            self._due_ns, self.answer, self.sent_ns = t_ns, "", None
        self.progress = Progress.SENT
        self._began_ns = t_ns
        return self.wake(t_ns)

    def stop(self) -> None:
        """Send no more."""
        self.progress = Progress.IDLE

    @property
    def sending(self) -> bool:
        """True while it is sent."""
        return self.progress is Progress.SENT or (self._stands and self.progress is Progress.GIVEN_UP)

    def wake(self, t_ns: int) -> List[Message]:
        """Look whether it is done; return what is due."""
        if not self.sending:
            return []
        if self._done():
            self.progress = Progress.CONFIRMED
        elif t_ns - self._began_ns > self._limits.limit_ns:
            self.progress = Progress.GIVEN_UP
        if not self.sending or t_ns < self._due_ns:
            return []
        message = self._make()
        if message is None:
            return []
        self._due_ns, self.sent_ns = t_ns + self._limits.repeat_ns, t_ns
        return [message]

    def acknowledged(self, result: int) -> None:
        """Keep the words of an acknowledgement; a refusal is kept over an acceptance."""
        if self.progress is Progress.SENT and (result != mavlink.MAV_RESULT_ACCEPTED or not self.answer):
            self.answer = _RESULTS.get(result, f"result {result}")
