"""The simulated PX4: messages and times in, messages out. No socket, no clock, no thread.

::

    px4 = Px4(craft, power, t_ns)
    link = px4.connect("planner")
    px4.receive(t_ns, "planner", message)      # a pymavlink message
    for name, message in px4.advance(t_ns): ...  # what goes out on which link

The vehicle itself is flown by its world (or by `craft.advance`); `advance` here comes after it, for the same time.
"""

from __future__ import annotations

import math
import random
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.simulation.vehicle.flight import TRANSMITTER_LOSS_NS, Mode
from amaze_autonomy.simulation.vehicle.vehicle import Power

from . import telemetry
from .commands import Order, Orders, enter, results
from .craft import Craft, SetPoint
from .health import Failsafes, Health, Wrong
from .missions import MissionServer
from .settings import PARAMETERS, Px4Settings
from .wire import OFFBOARD, Link, Parameters, Texts, mode_of

_S = 1_000_000_000
_INFO, _WARNING = 6, 4
_REACHED_NS = _S
_STATUS_NS = _S // 2
_HOME_SHIFT = (-0.2, 0.2, -0.45)  # of home before the arming: north, east, up in m, as recorded
_PREARM_TEXT_NS = 2 * _S
_SENSORS = ("gps", "imu", "magnetometer", "barometer")
_IGNORE_POSITION, _IGNORE_VELOCITY, _IGNORE_YAW = 0b111, 0b111000, 1 << 10
_COMPONENTS = (0, mavlink.MAV_COMP_ID_AUTOPILOT1)

_Out = Tuple[str, Any]


def _all_well() -> Mapping[str, Optional[bool]]:
    return dict.fromkeys(_SENSORS, True)


class Px4:
    """One autopilot.

    Args:
        craft: the vehicle it flies.
        power: its battery.
        t_ns: when it begins.
        settings: the rest.
        sensors: returns sensor -> healthy; None: the autopilot says nothing of it.
        wrong: returns what it is wrong about.
        seed: of the noise.
        unix_ns: time of the day at `t_ns`.
    """

    _takers: Mapping[str, Callable[[Any, int, Link, Any], None]] = {}

    def __init__(
        self,
        craft: Craft,
        power: Power,
        t_ns: int = 0,
        settings: Optional[Px4Settings] = None,
        *,
        sensors: Callable[[], Mapping[str, Optional[bool]]] = _all_well,
        wrong: Callable[[], Wrong] = Wrong,
        seed: int = 0,
        unix_ns: int = 0,
    ) -> None:
        self.settings = settings or Px4Settings()
        self.craft, self._power, self._sensors, self._wrong = craft, power, sensors, wrong
        self._start_ns, self._unix_ns, self._now_ns = t_ns, unix_ns, t_ns
        self._noise = random.Random(f"{seed}:px4")  # noqa: S311 - noise, not a secret
        self.parameters = self._make_parameters()
        self.missions = self._make_missions()
        self.health = Health(t_ns)
        self.failsafes = self._make_failsafes()
        self._orders = Orders(craft, self.health, self.failsafes, self.parameters, self._say, self._tell)
        self._links: Dict[str, Link] = {}
        self._out: List[_Out] = []
        self._texts = Texts()
        self._said, self._status = _Said(craft), _Status(craft)
        self._reached_ns: Optional[int] = None
        self._reached = -1
        self._prearm_ns = t_ns
        self._transmitter_ns: Optional[int] = None

    # --- what another autopilot does in another way ---------------------------------------------------------------

    def _make_parameters(self) -> Parameters:
        return Parameters({**PARAMETERS, **self.settings.parameters})

    def _make_missions(self) -> MissionServer:
        return MissionServer(self.settings.mission_capacity)

    def _make_failsafes(self) -> Failsafes:
        return Failsafes(self.craft, self.health, self.parameters, self._say)

    @property
    def _has_gps(self) -> bool:
        """False when a parameter switches the receiver off."""
        return int(self.parameters["SIM_GPS_USED"]) > 0

    def _results(self, t_ns: int, order: Order) -> List[int]:
        """Carry a command out; return the results with which it is acknowledged."""
        return results(self._orders, t_ns, order)

    def _message(self, name: str, view: telemetry.View) -> Any:
        """Make a message to stream; None when there is nothing to tell."""
        return telemetry.make(name, view)

    # --- links ----------------------------------------------------------------------------------------------------

    def connect(self, name: str, preset: str = "onboard") -> Link:
        """Have a connection, with the rates of an onboard computer (onboard) or of a ground station (gcs)."""
        return self._links.setdefault(name, Link(name, self._now_ns, preset))

    def disconnect(self, name: str) -> None:
        """Forget a connection, with its rates and texts."""
        self._links.pop(name, None)

    @property
    def next_ns(self) -> int:
        """Time at which a message is due next."""
        return min((link.next_ns for link in self._links.values()), default=self._now_ns + _S)

    # --- in -------------------------------------------------------------------------------------------------------

    def receive(self, t_ns: int, name: str, message: Any) -> None:
        """Take a message that came on a link; answers are among what `advance` returns."""
        self._now_ns = max(self._now_ns, t_ns)
        link = self.connect(name)
        kind = message.get_type()
        if kind == "HEARTBEAT":
            link.hear_heartbeat(t_ns, message.type)
        if not self._is_for_us(message):
            return
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            self._obey(t_ns, link, message)
        elif kind in self._takers:
            self._takers[kind](self, t_ns, link, message)
        elif kind.startswith("MISSION_"):
            self.missions.current = self.craft.current
            self._out.extend((name, answer) for answer in self.missions.take(t_ns, name, message))
            self._take_mission()
        elif kind.startswith("PARAM_"):
            self._out.extend((name, answer) for answer in self.parameters.take(message))

    def _is_for_us(self, message: Any) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self.settings.system) and component in _COMPONENTS

    def _obey(self, t_ns: int, link: Link, message: Any) -> None:
        params = [message.param1, message.param2, message.param3, message.param4]
        if message.get_type() == "COMMAND_INT":
            params += [message.x * 1e-7, message.y * 1e-7, message.z]
        else:
            params += [message.param5, message.param6, message.param7]
        order = Order(message.command, tuple(params), link)
        outcomes = self._results(t_ns, order)
        if message.command in self.settings.unacknowledged:
            return
        for outcome in outcomes:
            ack = mavlink.MAVLink_command_ack_message(
                message.command, outcome, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
            self._out.append((link.name, ack))

    def _take_mission(self) -> None:
        uploaded, self.missions.uploaded = self.missions.uploaded, None
        if uploaded is not None:
            self.craft.load_items(uploaded.items, uploaded.current)
            self._reached, self._reached_ns = -1, None

    def _take_set_mode(self, t_ns: int, _link: Link, message: Any) -> None:
        """Enter a mode by the old message, which is not acknowledged."""
        mode = mode_of(message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24)
        if mode is not None and message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            enter(self._orders, t_ns, mode)

    def _take_current(self, _t_ns: int, link: Link, message: Any) -> None:
        if message.seq < len(self.craft.items):
            self.craft.set_current(message.seq)
            self._tell(link, "MISSION_CURRENT")

    def _take_set_point(self, t_ns: int, _link: Link, message: Any) -> None:
        mask = message.type_mask
        frame_known = message.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
        place, speed = (message.x, message.y, message.z), (message.vx, message.vy, message.vz)
        by_place = not mask & _IGNORE_POSITION and all(map(math.isfinite, place))
        by_speed = not mask & _IGNORE_VELOCITY and all(map(math.isfinite, speed))
        if not frame_known or not (by_place or by_speed):
            return
        self.failsafes.set_point_ns = t_ns
        has_yaw = not mask & _IGNORE_YAW and math.isfinite(message.yaw)
        self.craft.set_point = SetPoint(
            position_m=(place[1], place[0], -place[2]) if by_place else None,
            velocity_m_s=(speed[1], speed[0], -speed[2]) if by_speed else (0.0, 0.0, 0.0),
            yaw_rad=math.pi / 2 - message.yaw if has_yaw else None,
        )

    def _take_timesync(self, t_ns: int, link: Link, message: Any) -> None:
        if message.tc1 == 0:
            self._out.append((link.name, mavlink.MAVLink_timesync_message(self._boot_ns(t_ns), message.ts1)))

    def _take_ping(self, _t_ns: int, link: Link, message: Any) -> None:
        if message.target_system == 0:
            answer = mavlink.MAVLink_ping_message(
                message.time_usec, message.seq, message.get_srcSystem(), message.get_srcComponent()
            )
            self._out.append((link.name, answer))

    # --- out ------------------------------------------------------------------------------------------------------

    def advance(self, t_ns: int) -> List[_Out]:
        """Look at the vehicle, act where a failsafe must, and return what is sent: (link, message), in order."""
        self._now_ns = t_ns
        self._transmitter_ns = t_ns if self._transmits else self._transmitter_ns
        has_gps = self._has_gps and not self.craft.flags.gps_lost
        self.health.follow(t_ns, gps=has_gps, armed=self.craft.armed)
        fraction = self._power.fraction if self._power.known else None
        self.failsafes.advance(t_ns, fraction, transmitter=self._transmitter)
        self._status.follow(t_ns)
        self._tell_changes(t_ns)
        self._tell_reached(t_ns)
        out, self._out = self._out, []
        out.extend(self.missions.advance(t_ns))
        view: Optional[telemetry.View] = None
        for name, link in self._links.items():
            out.extend((name, text) for text in link.take_texts(t_ns))
            for message in link.due(t_ns):
                if message == "CURRENT_MODE" and not link.is_new(message, self._status.version):
                    continue
                view = view or self._view(t_ns)
                made = self._message(message, view)
                if made is not None:
                    out.append((name, made))
        return out

    def _boot_ns(self, t_ns: int) -> int:
        return t_ns - self._start_ns + self.settings.boot_ns

    @property
    def _transmits(self) -> Optional[bool]:
        """Whether the transmitter is on; None: there is none."""
        return "rc" not in self.craft.flags.not_ready if self.settings.transmitter else None

    @property
    def _transmitter(self) -> bool:
        """Whether it is heard, as far as the autopilot knows."""
        heard_ns = self._transmitter_ns
        return heard_ns is not None and self._now_ns - heard_ns < TRANSMITTER_LOSS_NS

    @property
    def _ready(self) -> bool:
        """The pre-arm verdict."""
        craft = self.craft
        modeless = craft.mode == OFFBOARD and not self.failsafes.offboard_ready(self._now_ns)
        return not craft.flags.not_ready and not self.health.position_lost and self.health.has_fix and not modeless

    def _view(self, t_ns: int) -> telemetry.View:
        armed, ready = self.craft.armed, self._ready
        reported = dict(self._sensors())
        return telemetry.View(
            t_ns=self._boot_ns(t_ns),
            unix_ns=self._unix_ns + t_ns - self._start_ns,
            craft=self.craft,
            health=self.health,
            sensors=self.health.sensors(
                reported,
                armed=armed,
                transmitter=self._transmitter,
                battery_low=self.failsafes.level > 0,
                ready=ready,
            ),
            fraction=self._power.fraction if self._power.known else None,
            voltage_v=self._power.voltage_v(flying=self.craft.airborne),
            cells=self._power.cells,
            level=self.failsafes.level,
            ready=ready,
            transmitter=self._transmits,
            land_channel=self.settings.land_channel,
            home_shift=_HOME_SHIFT,
            has_home="home" not in self.craft.flags.not_ready,
            range_finder=self.settings.range_finder,
            events=self._texts.events,
            wrong=self._wrong(),
            noise=self._noise,
        )

    def _tell(self, link: Link, name: str) -> bool:
        """Send a message once."""
        is_version = name == "AUTOPILOT_VERSION"
        message = _version() if is_version else self._message(name, self._view(self._now_ns))
        if message is not None:
            self._out.append((link.name, message))
        return message is not None

    def _say(self, severity: int, text: str) -> None:
        """Tell a text: to ground stations, and as an event to all."""
        chunks = self._texts.chunks(severity, text)
        events = self._texts.event(self._boot_ns(self._now_ns) // 1_000_000, severity, text)
        for name, link in self._links.items():
            for chunk in chunks:
                link.keep_text(chunk)
            self._out.extend((name, each) for each in events)

    def _tell_changes(self, t_ns: int) -> None:
        for severity, text in self._said.changes():
            self._say(severity, text)
        if not self.craft.armed and self.craft.flags.not_ready and t_ns >= self._prearm_ns:
            self._prearm_ns = t_ns + _PREARM_TEXT_NS
            for problem in sorted(self.craft.flags.not_ready.values()):
                self._say(_WARNING, f"Preflight Fail: {problem}\t")

    def _tell_reached(self, t_ns: int) -> None:
        """Tell the item that was reached at once, then every second again."""
        reached = self.craft.item_reached
        if reached < 0 or (reached == self._reached and self._reached_ns is not None and t_ns < self._reached_ns):
            return
        self._reached, self._reached_ns = reached, t_ns + _REACHED_NS
        self._out.extend((name, mavlink.MAVLink_mission_item_reached_message(reached)) for name in self._links)


class _Status:
    """PX4's topic of its mode: published twice a second and with each change, and each of that is told once.

    Args:
        craft: the vehicle.
    """

    def __init__(self, craft: Craft) -> None:
        self._craft = craft
        self.version, self._due_ns = 0, 0
        self._last: Any = None

    def follow(self, t_ns: int) -> None:
        """Publish what is due, and what has changed."""
        craft = self._craft
        now = (craft.mode, craft.intended, craft.armed, craft.failsafe)
        if now != self._last or t_ns >= self._due_ns:
            self._last, self._due_ns = now, t_ns + _STATUS_NS
            self.version += 1


class _Said:
    """Turns what changed about the vehicle into PX4's words.

    Args:
        craft: the vehicle.
    """

    def __init__(self, craft: Craft) -> None:
        self._craft = craft
        self._armed, self._airborne, self._over = craft.armed, craft.airborne, craft.mission_over
        self._landed = craft.landed

    def changes(self) -> List[Tuple[int, str]]:
        """Return what is to be said since the last time."""
        craft, texts = self._craft, []
        if craft.armed and not self._armed:
            texts.append("Armed by external command\t")
            if craft.mode == Mode.MISSION and craft.items:
                texts.append("Executing Mission\t")
        if craft.airborne and not self._airborne:
            texts.append("Takeoff detected\t")
        if craft.mission_over and not self._over:
            texts.append("Mission finished, loitering\t" if craft.airborne else "Mission finished, landed\t")
        if craft.landed != self._landed and craft.landed.name == "ON_GROUND":
            texts.append("Landing detected\t")
        if self._armed and not craft.armed:
            texts.append("Disarmed by landing\t")
        self._armed, self._airborne, self._over = craft.armed, craft.airborne, craft.mission_over
        self._landed = craft.landed
        return [(_INFO, text) for text in texts]


def _version() -> Any:
    return mavlink.MAVLink_autopilot_version_message(
        59647, 0x011001FF, 0x011001FF, 101854463, 1, [0] * 8, [0] * 8, [0] * 8, 0, 0, 5283920058631409231
    )


Px4._takers = {  # noqa: SLF001 - a table of its own methods
    "SET_MODE": Px4._take_set_mode,  # noqa: SLF001
    "MISSION_SET_CURRENT": Px4._take_current,  # noqa: SLF001
    "SET_POSITION_TARGET_LOCAL_NED": Px4._take_set_point,  # noqa: SLF001
    "TIMESYNC": Px4._take_timesync,  # noqa: SLF001
    "PING": Px4._take_ping,  # noqa: SLF001
}
