"""The simulated world: time and commands in, events out."""

from __future__ import annotations

import heapq
from typing import Dict, List, Mapping, Optional, Tuple, Type, Union

from amaze_autonomy.config.model import Configuration
from amaze_autonomy.engine.checks import Check, Verdict
from amaze_autonomy.engine.commands import Command, Request, RunCheck
from amaze_autonomy.engine.events import CheckReply, Event, Outcome, UserRequest
from amaze_autonomy.engine.state import evolve

from .autopilot import SENSORS, Autopilot, sensor_health
from .effects import begin, end
from .errors import SimulatedTimeError, UnknownTargetError
from .faults import Change, Faults
from .landing_detection import LandingDetection
from .messages import Sample, Sender
from .peer import Peer, Site, accepted, reply
from .planner import Planner
from .power import Power
from .recorder import Recorder
from .scenario import Fault, Scenario, Subject
from .services import PEERS, SERVICES, peer_of, service_of
from .settings import Settings, settings_of
from .state_estimation import StateEstimation
from .streams import Batch, Stream
from .vehicle import Vehicle
from .watchdog import SimulatedWatchdog

__all__ = ["World"]

_MS = 1_000_000
_CLASSES: Tuple[Type[Peer], ...] = (Autopilot, LandingDetection, StateEstimation, SimulatedWatchdog, Planner, Recorder)


class World:
    """One vehicle, its sensors, and the engine's peers; the same seed, scenario and commands give the same events.

    Args:
        configuration: as `config.load_configuration` returns it, or `Settings`.
        seed: of all noise and latencies.
        faults: what goes wrong, and what the user does.
        start_ns: time at which it begins; `at_s` of a scenario counts from here.
        without: peers that are left out, because real nodes take their place.
        live: it stands behind real services and topics (see the package's docstring).

    Raises:
        UnknownTargetError: a fault names a component, process or service that is not there.
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
    ) -> None:
        settings = settings_of(configuration)
        scenario = faults if faults is not None else Scenario()
        _check_targets(settings, scenario, without)
        self.now_ns = start_ns
        self._live = live
        self._faults = Faults(scenario, start_ns)
        streams = {each.topic: Stream(each, start_ns, seed) for each in settings.streams()}
        self._site = Site(
            settings=settings,
            vehicle=Vehicle(settings.vehicle, start_ns),
            power=Power(settings.power),
            faults=self._faults,
            seed=seed,
            streams=streams,
        )
        self._classes = {kind.name: kind for kind in _CLASSES if kind.name not in without}
        self._peers: Dict[str, Peer] = {name: kind(self._site) for name, kind in self._classes.items()}
        self._latency = self._site.noise("latency")
        self._turn_ns = start_ns
        self._deliveries: List[Tuple[int, int, Event]] = []
        self._open: Dict[int, Request] = {}
        self._deadlines: List[Tuple[int, int, int]] = []
        self._serial = 0
        self._backlog: List[Event] = []
        self._history: List[Tuple[int, str]] = []
        self._batches: List[Tuple[str, Batch]] = []
        self._sender = Sender(self._site)

    # --- time -----------------------------------------------------------------------------------------------------

    @property
    def next_ns(self) -> int:
        """Time at which the world has something to do next."""
        times = [self._turn_ns]
        if self._faults.next_ns is not None:
            times.append(max(self._faults.next_ns, self.now_ns))
        if self._deliveries:
            times.append(self._deliveries[0][0])
        if self._deadlines:
            times.append(self._deadlines[0][0])
        return max(min(times), self.now_ns)

    @property
    def history(self) -> Tuple[Tuple[int, str], ...]:
        """What happened by the scenario: (time, text) of faults that began and ended and of the user's requests."""
        return tuple(self._history)

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

    def handle(self, t_ns: int, command: Command) -> None:
        """Take a command of the engine; what comes of it is among the events of `advance`.

        A command that is no request, or that goes to a peer that was left out, changes nothing.

        Raises:
            SimulatedTimeError: the time is in the past.
        """
        service = service_of(command)
        if not isinstance(command, Request) or service is None or peer_of(service) not in self._classes:
            return
        events = self.advance(t_ns)
        self._backlog.extend(events)
        self._open[command.id] = command
        self._call(t_ns, service, command)
        if not self._live:
            self._serial += 1
            heapq.heappush(self._deadlines, (t_ns + command.limit_ns, self._serial, command.id))

    def restart(self, component: str) -> None:
        """Restart a component's node now, as a real watchdog would; it comes up, or not, as its faults say."""
        self._site.restarts.begin(self.now_ns, component)

    def observe_state(self, t_ns: int, state: str) -> None:
        """Take notice of a state of the engine, for triggers that wait for it."""
        self._faults.observe(t_ns, state=state)

    # --- what the live shell looks at -----------------------------------------------------------------------------

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle, to be looked at."""
        return self._site.vehicle

    @property
    def settings(self) -> Settings:
        """What the world is made of."""
        return self._site.settings

    def services(self) -> Tuple[str, ...]:
        """Return the services that are there now: those of killed processes and vanished ones are not."""
        return tuple(name for name in SERVICES if peer_of(name) in self._classes and self._is_there(name))

    def samples(self) -> Tuple[Sample, ...]:
        """Return what the sensors sent since the last call; nothing when the world is not live."""
        batches, self._batches = self._batches, []
        return tuple(sample for topic, batch in batches for sample in self._sender.samples(topic, batch))

    def sensor_health(self) -> Mapping[str, Optional[bool]]:
        """Return sensor -> healthy as the autopilot says it now; None: it says nothing of it."""
        health = sensor_health(self._site)
        return {name: health.get(name) for name in SENSORS}

    def processes(self) -> Mapping[str, bool]:
        """Return process -> alive for the peers of this world and for the node of every component."""
        alive = {name: self._lives(name) for name in self._classes}
        for component in self._site.settings.components:
            alive[component.name] = not self._faults.active(Subject.COMPONENT, "killed", component.name)
        return alive

    # --- steps ----------------------------------------------------------------------------------------------------

    def _step(self, t_ns: int, events: List[Event]) -> None:
        """Do what is due at a time."""
        if t_ns > self.now_ns:
            self._move(t_ns)
        for change in self._faults.advance(t_ns):
            self._history.append((t_ns, _told(change)))
            if not isinstance(change.what, Fault):
                events.append(UserRequest(t_ns=t_ns, command=change.what.command))
            elif change.begins:
                begin(self._site, change.what)
            else:
                end(self._site, change.what)
                self._revive(change.what)
        self._observe(t_ns)
        if self._turn_ns <= t_ns:
            self._turn(t_ns)
            self._turn_ns += self._site.settings.turn_ns
        self._deliver(t_ns, events)

    def _move(self, t_ns: int) -> None:
        """Let the vehicle fly and the sensors send until a time."""
        vehicle = self._site.vehicle
        flying = vehicle.airborne
        vehicle.advance(t_ns)
        self._site.power.advance(t_ns - self.now_ns, flying=flying or vehicle.airborne)
        self.now_ns = t_ns
        for topic, stream in self._site.streams.items():
            batch = stream.take(t_ns, self._faults)
            if batch is not None:
                self._site.batches.setdefault(topic, []).append(batch)
                if self._live:
                    self._batches.append((topic, batch))

    def _turn(self, t_ns: int) -> None:
        """Let every peer that lives do its work."""
        self._site.restarted = self._site.restarts.step(t_ns)
        for name, peer in self._peers.items():
            if not self._lives(name):
                continue
            mute = self._faults.active(Subject.PROCESS, "silent", name) is not None
            for event in peer.step(t_ns):
                reply_id = getattr(event, "command_id", None)
                if reply_id is not None or not mute:
                    self._push(t_ns, event)
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

    def _deliver(self, t_ns: int, events: List[Event]) -> None:
        """Hand over what has arrived, and end requests that were not answered in time."""
        while self._deliveries and self._deliveries[0][0] <= t_ns:
            at_ns, _, event = heapq.heappop(self._deliveries)
            self._open.pop(getattr(event, "command_id", -1), None)
            events.append(evolve(event, t_ns=at_ns))
        while self._deadlines and self._deadlines[0][0] <= t_ns:
            _, _, command_id = heapq.heappop(self._deadlines)
            command = self._open.pop(command_id, None)
            if command is not None:
                events.append(evolve(reply(command, Outcome.TIMED_OUT), t_ns=t_ns))

    def _revive(self, fault: Fault) -> None:
        """Start a killed process anew: it has forgotten everything."""
        if fault.kind.subject == Subject.PROCESS and fault.kind.name == "killed" and fault.target in self._classes:
            self._peers[fault.target] = self._classes[fault.target](self._site)

    # --- requests -------------------------------------------------------------------------------------------------

    def _call(self, t_ns: int, service: str, command: Request) -> None:
        """Carry a request to its service, as well as that works now."""
        if not self._is_there(service):
            self._push(t_ns + _MS, reply(command, Outcome.UNAVAILABLE, f"there is no service {service}"))
            return
        for fault, _ in self._faults.on(Subject.SERVICE, service):
            answered, answer = _spoilt(fault, command)
            if answered:
                if answer is not None:
                    self._push(self._arrival(t_ns), answer)
                return
        answer = self._peers[peer_of(service)].answer(t_ns, command)
        if answer is not None:
            slow = self._faults.active(Subject.SERVICE, "slow", service)
            delay = round(slow.number("delay_s") * 1000 * _MS) if slow is not None else 0
            self._push(self._arrival(t_ns) + delay, answer)
        self._observe(t_ns)

    def _arrival(self, t_ns: int) -> int:
        """Return when a reply arrives: two to twelve milliseconds later."""
        return t_ns + self._latency.randrange(2 * _MS, 12 * _MS)

    def _push(self, t_ns: int, event: Event) -> None:
        self._serial += 1
        heapq.heappush(self._deliveries, (t_ns, self._serial, event))

    def _lives(self, process: str) -> bool:
        return self._faults.active(Subject.PROCESS, "killed", process) is None

    def _is_there(self, service: str) -> bool:
        vanished = self._faults.active(Subject.SERVICE, "vanishes", service) is not None
        return self._lives(peer_of(service)) and not vanished


def _told(change: Change) -> str:
    """Say what a change is, for a person."""
    if not isinstance(change.what, Fault):
        return f"the user asks: {change.what.command.value}"
    return f"fault {'begins' if change.begins else 'ends'}: {change.what}"


def _spoilt(fault: Fault, command: Request) -> Tuple[bool, Optional[Event]]:
    """Return whether a fault of a service answers in its place, and what; None: no answer at all."""
    kind = fault.kind.name
    if kind == "hangs":
        return True, None
    if kind == "breaks":
        return True, reply(command, Outcome.BROKEN, "the connection was closed in mid-call")
    if kind == "lies":
        return True, evolve(accepted(command), ok=True) if isinstance(command, RunCheck) else accepted(command)
    if kind == "refuses":
        return True, _refusal(command)
    return False, None


def _refusal(command: Request) -> Event:
    """Make the answer "no": of a check, a row that failed."""
    if not isinstance(command, RunCheck):
        return reply(command, Outcome.REFUSED, "refused")
    row = Check(command.check.value, Verdict.FAIL, advice="refused")
    answer = reply(command, Outcome.ACCEPTED, "refused")
    return evolve(answer, checks=(row,)) if isinstance(answer, CheckReply) else answer


def _check_targets(settings: Settings, scenario: Scenario, without: Tuple[str, ...]) -> None:
    """Refuse a scenario or a name that means nothing here."""
    components = tuple(component.name for component in settings.components)
    known = {Subject.COMPONENT: components, Subject.PROCESS: PEERS, Subject.SERVICE: SERVICES}
    for fault in scenario.faults:
        names = known.get(fault.kind.subject)
        if names is not None and fault.target not in names:
            raise UnknownTargetError(fault.kind.subject, fault.target, names, fault.where)
    for name in without:
        if name not in PEERS:
            raise UnknownTargetError("peer", name, PEERS)
