"""The simulated world: time and commands in, events out."""

from __future__ import annotations

from math import inf, radians
from typing import Callable, Dict, List, Mapping, NamedTuple, Optional, Tuple, Type, Union

from amaze_autonomy.config.model import Configuration
from amaze_autonomy.engine.commands import Command, Request
from amaze_autonomy.engine.events import EngineStarted, Event, MissionSelected, Shutdown, UserRequest
from amaze_autonomy.interface import PEERS, SERVICES, service_of
from amaze_autonomy.monitoring.specs import ComponentSpec

from .errors import NoEffectError, SimulatedTimeError, UnknownTargetError
from .faults import Change, Faults
from .peers.monitors import LandingDetection, SimulatedWatchdog, StateEstimation
from .peers.peer import Peer, Site
from .peers.recorder import Recorder
from .peers.switchboard import Switchboard
from .peers.vehicle import SENSORS, Autopilot, Planner, sensor_health
from .scenario import ENGINE, Fault, Scenario, Subject
from .scenario import Request as Asked
from .sensors import Sample, Sender
from .settings import Settings, settings_of
from .streams import Batch, Stream
from .vehicle.vehicle import Power, Vehicle, VehicleSettings

_CLASSES: Tuple[Type[Peer], ...] = (Autopilot, LandingDetection, StateEstimation, SimulatedWatchdog, Planner, Recorder)


class Happened(NamedTuple):
    """Something that happened by the scenario.

    Args:
        t_ns: when.
        text: what, for a person: a fault that began or ended, a request of the user.
        place: of the fault or request in the scenario, from 0: all faults, then all requests.
    """

    t_ns: int
    text: str
    place: int


class World:
    """One vehicle, its sensors, and the engine's peers; the same seed, scenario and commands give the same events.

    Args:
        configuration: as `config.load_configuration` returns it, or `Settings`.
        seed: of all noise and latencies.
        faults: what goes wrong, and what the user does.
        start_ns: time at which it begins; `at_s` of a scenario counts from here.
        without: peers that are left out, because real nodes take their place.
        live: it stands behind real services and topics (see the package's docstring).
        make_vehicle: makes the vehicle; `px4.Craft` for one that is flown over MAVLink.

    Raises:
        UnknownTargetError: a fault names a component, process or service that is not there.
        NoEffectError: a fault would do nothing to what it names.
    """

    def __init__(
        self,
        configuration: Union[Configuration, Settings],
        seed: int = 0,
        faults: Optional[Scenario] = None,
        *,
        start_ns: int = 0,
        without: Tuple[str, ...] = (),
        live: bool = False,
        make_vehicle: Callable[[VehicleSettings, int], Vehicle] = Vehicle,
    ) -> None:
        settings = settings_of(configuration)
        scenario = faults if faults is not None else Scenario()
        check_scenario(settings, scenario, live=live)
        _check_peers(without)
        self.now_ns = start_ns
        self._live = live
        self._faults = Faults(scenario, start_ns)
        streams = {each.topic: Stream(each, start_ns, seed) for each in settings.streams()}
        self._site = Site(
            settings=settings,
            vehicle=make_vehicle(settings.vehicle, start_ns),
            power=Power(settings.power),
            faults=self._faults,
            seed=seed,
            streams=streams,
        )
        self._classes = {kind.name: kind for kind in _CLASSES if kind.name not in without}
        self._peers: Dict[str, Peer] = {name: kind(self._site) for name, kind in self._classes.items()}
        self._turn_ns = start_ns
        self._switchboard = Switchboard(self._site, self._peers, live=live)
        self._backlog: List[Event] = []
        self._history: List[Happened] = []
        self._batches: List[Tuple[str, Batch]] = []
        self._sender = Sender(self._site)

    # --- time -----------------------------------------------------------------------------------------------------

    @property
    def next_ns(self) -> int:
        """Time at which the world has something to do next."""
        times = (self._turn_ns, self._faults.next_ns, self._switchboard.next_ns)
        return max(min(time for time in times if time is not None), self.now_ns)

    @property
    def history(self) -> Tuple[Happened, ...]:
        """What happened by the scenario: faults that began and ended, and the user's requests."""
        return tuple(self._history)

    @property
    def engine_down(self) -> bool:
        """True while the engine is dead by the scenario: it hears nothing, and must not be asked to decide."""
        return self._faults.active(Subject.PROCESS, "restarted", ENGINE) is not None

    @property
    def requests_to_come(self) -> bool:
        """True while the scenario's user will ask for something at a time that is known."""
        return self._faults.requests_to_come

    def advance(self, t_ns: int) -> Tuple[Event, ...]:
        """Go on to a time and return what happened until then, in order.

        Raises:
            SimulatedTimeError: the time is in the past.
        """
        if t_ns < self.now_ns:
            raise SimulatedTimeError(self.now_ns, t_ns)
        events, self._backlog = self._backlog, []
        while self.next_ns <= t_ns:
            self._step(self.next_ns, events)
        if t_ns > self.now_ns:
            self._move(t_ns)
        return tuple(events)

    def catch_up(self, t_ns: int) -> None:
        """Go on to a time; what happened until then is among the events of the next `advance`."""
        self._backlog = list(self.advance(max(t_ns, self.now_ns)))

    def handle(self, t_ns: int, command: Command) -> None:
        """Take a command of the engine; what comes of it is among the events of `advance`.

        A command that is no request, or that goes to a peer that was left out, changes nothing.

        Raises:
            SimulatedTimeError: the time is in the past.
        """
        service = service_of(command)
        if not isinstance(command, Request) or service is None or service.peer not in self._classes:
            return
        events = self.advance(t_ns)
        self._backlog.extend(events)
        self._switchboard.call(t_ns, service.name, command)
        self._observe(t_ns)

    def restart(self, component: str) -> None:
        """Restart a component's node now, as a real watchdog would; it comes up, or not, as its faults say."""
        self._site.restarts.begin(self.now_ns, component)

    def observe_state(self, t_ns: int, state: str) -> None:
        """Take notice of a state of the engine, for triggers and peers that wait for it."""
        self._faults.observe(t_ns, state=state)
        for peer in self._peers.values():
            peer.entered(state)

    def initialise(self) -> Optional[str]:
        """Tell the estimator to begin, as its service does; return why not, or nothing; None: there is no answer."""
        return self._site.estimator.initialise()

    def note(self, event: str) -> None:
        """Take notice of something that a real node did in the place of a peer, for triggers that wait for it."""
        self._site.note(event)

    # --- what the live shell looks at -----------------------------------------------------------------------------

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle, to be looked at."""
        return self._site.vehicle

    @property
    def power(self) -> Power:
        """Its battery, to be looked at."""
        return self._site.power

    @property
    def settings(self) -> Settings:
        """What the world is made of."""
        return self._site.settings

    def services(self) -> Tuple[str, ...]:
        """Return the services that are there now: those of killed processes and vanished ones are not."""
        return self._switchboard.services()

    def samples(self) -> Tuple[Sample, ...]:
        """Return what the sensors sent since the last call; nothing when the world is not live."""
        batches, self._batches = self._batches, []
        return tuple(sample for topic, batch in batches for sample in self._sender.samples(topic, batch))

    def sensor_health(self) -> Mapping[str, Optional[bool]]:
        """Return sensor -> healthy as the autopilot says it now; None: it says nothing of it."""
        health = sensor_health(self._site)
        return {name: health.get(name) for name in SENSORS}

    def acting(self, kind: str) -> Optional[Fault]:
        """Return the fault of a kind of which there is one in the world, if it acts now."""
        return self._site.world_fault(kind)

    @property
    def land_switch(self) -> Optional[bool]:
        """Whether the simulated autopilot node says that the transmitter's switch means land; None: it says nothing."""
        peer = self._peers.get("autopilot")
        if not isinstance(peer, Autopilot) or not self._site.autopilot_speaks():
            return None
        return peer.land_switch(self.now_ns)

    def link_lost(self) -> bool:
        """Tell whether the autopilot node's link to the vehicle is cut."""
        return self._site.world_fault("autopilot_link_lost") is not None

    def processes(self) -> Mapping[str, bool]:
        """Return process -> alive for the peers of this world and for the node of every component."""
        alive = {name: self._site.lives(name) for name in self._classes}
        for component in self._site.settings.components:
            alive[component.name] = self._site.component_lives(component.name)
        return alive

    def troubles(self) -> Mapping[str, Tuple[str, ...]]:
        """Return the kinds of the faults that act now on each component and process; those without are left out."""
        names = [(Subject.PROCESS, name) for name in PEERS]
        names += [(Subject.COMPONENT, component.name) for component in self._site.settings.components]
        kinds = {name: tuple(fault.kind.name for fault, _ in self._faults.on(subject, name)) for subject, name in names}
        return {name: acting for name, acting in kinds.items() if acting}

    # --- steps ----------------------------------------------------------------------------------------------------

    def _step(self, t_ns: int, events: List[Event]) -> None:
        """Do what is due at a time."""
        if t_ns > self.now_ns:
            self._move(t_ns)
        for change in self._faults.advance(t_ns):
            self._history.append(Happened(t_ns, _told(change, heard=not self.engine_down), change.place))
            if not isinstance(change.what, Fault):
                if not self.engine_down:
                    events.append(self._asked(t_ns, change.what))
                continue
            if change.what.target == ENGINE and not self.engine_down:
                events.extend(_of_engine(t_ns, change.what, begins=change.begins))
            (begin if change.begins else end)(self._site, change.what)
            if (change.what.kind.subject, change.what.kind.name) == (Subject.PROCESS, "killed"):
                self._kill_or_revive(t_ns, change.what.target, killed=change.begins)
        self._observe(t_ns)
        if self._turn_ns <= t_ns:
            self._turn(t_ns)
            self._turn_ns += self._site.settings.turn_ns
        heard = self._switchboard.deliver(t_ns)
        if not self.engine_down:
            events.extend(heard)

    def _asked(self, t_ns: int, request: Asked) -> Event:
        """Return what a user asks as an event of the engine."""
        if request.command is not None:
            return UserRequest(t_ns=t_ns, command=request.command)
        known = {mission.id: mission for mission in self._site.settings.missions}
        return MissionSelected(t_ns=t_ns, missions=tuple(known[name] for name in request.missions))

    def _move(self, t_ns: int) -> None:
        """Let the vehicle fly and the sensors send until a time."""
        vehicle = self._site.vehicle
        flying = vehicle.airborne
        vehicle.advance(t_ns)
        self._site.power.advance(t_ns - self.now_ns, flying=flying or vehicle.airborne)
        self.now_ns = t_ns
        for topic, stream in self._site.streams.items():
            component = stream.settings.component
            lives = not component or self._site.component_lives(component)
            batch = stream.take(t_ns, self._faults, lives=lives)
            speaks = self._site.estimator.runs or topic != self._site.settings.state_estimation.topic
            if batch is not None and speaks:
                self._site.batches.setdefault(topic, []).append(batch)
                if self._live:
                    self._batches.append((topic, batch))

    def _turn(self, t_ns: int) -> None:
        """Let every peer that lives do its work."""
        self._site.restarted = self._site.restarts.step(t_ns)
        for name, peer in self._peers.items():
            if not self._site.lives(name):
                continue
            mute = self._faults.active(Subject.PROCESS, "silent", name) is not None
            for event in peer.step(t_ns):
                reply_id = getattr(event, "command_id", None)
                if reply_id is not None or not mute:
                    self._switchboard.send(t_ns, event)
        self._site.batches.clear()
        self._observe(t_ns)

    def _observe(self, t_ns: int) -> None:
        """Hand what happened to the triggers."""
        vehicle = self._site.vehicle
        if vehicle.happened:
            for name in vehicle.happened:
                self._site.note(name, vehicle.reached if name == "waypoint" else 0)
            vehicle.happened.clear()
        for name, number in self._site.happened:
            self._faults.observe(t_ns, event=name, number=number)
        self._site.happened.clear()

    def _kill_or_revive(self, t_ns: int, process: str, *, killed: bool) -> None:
        """Break the calls to a process that dies; make one anew that comes back: it has forgotten everything."""
        if killed:
            self._switchboard.hang_up(t_ns, process)
        elif process in self._classes:
            self._peers[process] = self._classes[process](self._site)


def _told(change: Change, *, heard: bool) -> str:
    """Say what a change is, for a person."""
    if not isinstance(change.what, Fault):
        return f"the user asks: {change.what}" + ("" if heard else " (nobody hears it: the engine is dead)")
    return f"fault {'begins' if change.begins else 'ends'}: {change.what}"


def _of_engine(t_ns: int, fault: Fault, *, begins: bool) -> Tuple[Event, ...]:
    """Return what a fault of the engine's process is for the engine."""
    if fault.kind.name == "interrupted":
        return (Shutdown(t_ns=t_ns),) if begins else ()
    resumed = fault.word("journal") == "kept"
    return () if begins else (EngineStarted(t_ns=t_ns, label=f"simulation-{t_ns // 1_000_000}", resumed=resumed),)


def _check_peers(names: Tuple[str, ...]) -> None:
    for name in names:
        if name not in PEERS:
            raise UnknownTargetError("peer", name, PEERS)


# --- casting ----------------------------------------------------------------------------------------------------------
# Does a scenario fit this world? Everything it names is there, and every fault can do something to it.


_OF_HEALTH = ("unhealthy", "unreported")
_OF_SAMPLES = ("slow", "flapping", "nan", "stuck")


def check_scenario(settings: Settings, scenario: Scenario, *, live: bool = False) -> None:
    """Check every fault and request of a scenario; `live`: the engine is another process.

    Raises:
        UnknownTargetError: a fault names something that is not there.
        NoEffectError: a fault would do nothing.
    """
    for fault in scenario.faults:
        _check_target(settings, fault)
        problem = _without_effect(settings, fault)
        if live and fault.target == ENGINE:
            problem = "the engine is another process; it is for virtual time"
        if problem is not None:
            raise NoEffectError(str(fault), problem, fault.where)
    for request in scenario.requests:
        known = tuple(mission.id for mission in settings.missions)
        for mission in request.missions:
            if mission not in known:
                raise UnknownTargetError("mission", mission, known)
        if live and request.missions:
            raise NoEffectError(str(request), "the user is another process; it is for virtual time")


def _check_target(settings: Settings, fault: Fault) -> None:
    components = tuple(component.name for component in settings.components)
    known = {Subject.COMPONENT: components, Subject.PROCESS: (*PEERS, ENGINE), Subject.SERVICE: tuple(SERVICES)}
    names = known.get(fault.kind.subject)
    if names is not None and fault.target not in names:
        raise UnknownTargetError(fault.kind.subject, fault.target, names, fault.where)
    if fault.has("platform") and fault.word("platform") not in ("", *settings.platforms):
        raise UnknownTargetError("platform", fault.word("platform"), settings.platforms, fault.where)


def _without_effect(settings: Settings, fault: Fault) -> Optional[str]:
    """Return why a fault would do nothing worth a test; None when it does something."""
    if fault.kind.targets and fault.target not in fault.kind.targets:
        return f"it is about {', '.join(fault.kind.targets)} only"
    if fault.kind.name == "restarted" and fault.for_ns is None:
        return "the engine would never be started again; say for how long with for_s"
    if fault.kind.name == "land_switch" and not settings.land_switch.channel:
        return "no channel means land; set land_switch.channel in autopilot.yaml"
    if fault.kind.name == "not_initialised" and not settings.initialisation.service:
        return "no estimator is initialised; set initialisation.service in sensors.yaml"
    if fault.kind.subject != Subject.COMPONENT:
        return None
    component = next(each for each in settings.components if each.name == fault.target)
    if fault.kind.name in _OF_HEALTH and component.autopilot is None:
        return "the autopilot says nothing of this component"
    if fault.kind.name in _OF_SAMPLES and not component.topics:
        return "this component has no topics"
    if fault.kind.name == "reads" and not _has_range(settings, component):
        return f"it is not the range sensor ({settings.landing.topic})"
    return None


def _has_range(settings: Settings, component: ComponentSpec) -> bool:
    return any(topic.topic == settings.landing.topic for topic in component.topics)


# --- effects ----------------------------------------------------------------------------------------------------------
# What a fault does to the vehicle, its battery and its pilot when it begins and when it ends.
#
# Faults of components, processes and services are looked up where they matter; these here change something at a moment.


_S = 1_000_000_000
_Effect = Callable[[Site, Fault], None]


def begin(site: Site, fault: Fault) -> None:
    """Let a fault act on the vehicle."""
    effect = _BEGIN.get(fault.kind.name)
    if effect is not None and not fault.kind.subject:
        effect(site, fault)


def end(site: Site, fault: Fault) -> None:
    """Undo what a fault did to the vehicle, where that can be undone."""
    effect = _END.get(fault.kind.name)
    if effect is not None and not fault.kind.subject:
        effect(site, fault)


def _battery_drops(site: Site, fault: Fault) -> None:
    level, over_s = fault.number("to_fraction"), fault.number("over_s")
    if over_s <= 0.0:
        site.power.drop_to(level)
    else:
        site.power.drain_to(level, over_s)


def _battery_holds(site: Site, _: Fault) -> None:
    site.power.stop_draining()


def _battery_unknown(site: Site, _: Fault) -> None:
    site.power.known = False


def _battery_known(site: Site, _: Fault) -> None:
    site.power.known = True


def _pilot_takes_over(site: Site, fault: Fault) -> None:
    site.vehicle.pilot_takes_over(fault.word("mode"), round(fault.number("land_after_s") * _S))


def _pilot_gives_back(site: Site, _: Fault) -> None:
    site.vehicle.pilot_gives_back()


def _pilot_arms(site: Site, _: Fault) -> None:
    site.vehicle.pilot_arms()


def _pilot_disarms(site: Site, _: Fault) -> None:
    site.vehicle.disarm()


def _failsafe(site: Site, fault: Fault) -> None:
    site.vehicle.enter_failsafe(fault.word("mode"))


def _failsafe_ends(site: Site, _: Fault) -> None:
    site.vehicle.leave_failsafe()


def _gps_lost(site: Site, _: Fault) -> None:
    site.vehicle.lose_gps()


def _gps_found(site: Site, _: Fault) -> None:
    site.vehicle.find_gps()


def _not_ready(site: Site, fault: Fault) -> None:
    site.vehicle.flags.not_ready[fault.word("what")] = fault.word("what").replace("_", " ")


def _ready(site: Site, fault: Fault) -> None:
    site.vehicle.flags.not_ready.pop(fault.word("what"), None)


def _tilted(site: Site, fault: Fault) -> None:
    site.vehicle.flags.tilt_rad = radians(fault.number("tilt_deg"))


def _level(site: Site, _: Fault) -> None:
    site.vehicle.flags.tilt_rad = 0.0


def _leans(site: Site, fault: Fault) -> None:
    site.vehicle.flags.lean_rad = radians(fault.number("tilt_deg"))


def _upright(site: Site, _: Fault) -> None:
    site.vehicle.flags.lean_rad = 0.0


def _raised(site: Site, fault: Fault) -> None:
    site.vehicle.flags.raised_m = fault.number("height_m")


def _lowered(site: Site, _: Fault) -> None:
    site.vehicle.flags.raised_m = 0.0


def _does_not_climb(site: Site, fault: Fault) -> None:
    site.vehicle.flags.stops_climbing_at_m = fault.number("above_m")


def _climbs(site: Site, _: Fault) -> None:
    site.vehicle.flags.stops_climbing_at_m = inf


def _ignores(site: Site, fault: Fault) -> None:
    site.vehicle.flags.ignores = (*site.vehicle.flags.ignores, fault.word("mode"))


def _obeys(site: Site, fault: Fault) -> None:
    site.vehicle.flags.ignores = tuple(mode for mode in site.vehicle.flags.ignores if mode != fault.word("mode"))


def _flag(name: str, value: bool) -> _Effect:  # noqa: FBT001
    def effect(site: Site, _: Fault) -> None:
        setattr(site.vehicle.flags, name, value)

    return effect


_BEGIN: Mapping[str, _Effect] = {
    "battery_drops": _battery_drops,
    "battery_unknown": _battery_unknown,
    "pilot_takes_over": _pilot_takes_over,
    "pilot_arms": _pilot_arms,
    "pilot_disarms": _pilot_disarms,
    "autopilot_failsafe": _failsafe,
    "gps_lost": _gps_lost,
    "land_switch": _flag("land_switch", value=True),
    "not_ready": _not_ready,
    "tilted": _tilted,
    "tilted_in_flight": _leans,
    "raised": _raised,
    "does_not_arm": _flag("does_not_arm", value=True),
    "does_not_lift_off": _flag("does_not_lift_off", value=True),
    "does_not_climb": _does_not_climb,
    "ignores_mode": _ignores,
    "does_not_descend": _flag("does_not_descend", value=True),
    "does_not_disarm": _flag("does_not_disarm", value=True),
}
_END: Mapping[str, _Effect] = {
    "battery_drops": _battery_holds,
    "autopilot_failsafe": _failsafe_ends,
    "gps_lost": _gps_found,
    "battery_unknown": _battery_known,
    "pilot_takes_over": _pilot_gives_back,
    "land_switch": _flag("land_switch", value=False),
    "not_ready": _ready,
    "tilted": _level,
    "tilted_in_flight": _upright,
    "raised": _lowered,
    "does_not_arm": _flag("does_not_arm", value=False),
    "does_not_lift_off": _flag("does_not_lift_off", value=False),
    "does_not_climb": _climbs,
    "ignores_mode": _obeys,
    "does_not_descend": _flag("does_not_descend", value=False),
    "does_not_disarm": _flag("does_not_disarm", value=False),
}
