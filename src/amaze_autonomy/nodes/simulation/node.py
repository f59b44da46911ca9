"""The simulated world behind real services and topics: everything the engine talks to, for a laptop without a vehicle.

Offers the services and publishes the status topics of `interface/` for the peers it plays, and the sensors' topics;
with these, where `initialisation` of sensors.yaml names one, the service that has the estimator begin.

    ~peers      which peers it plays: a mapping of name to true or false, or names with commas; default all
    ~sensors    publish the sensors' samples (default: true)
    ~drivers    publish those of components with a node by processes of that name (default: false)
    ~real       peers that are real nodes, as ~peers; faults of their processes are signals
    ~mavlink    the vehicle speaks MAVLink, where autopilot.yaml says that the nodes wait for it (default: false)
    ~vehicle    which autopilot it has then: px4 or ardupilot (default: px4); external: none, the sensors follow a
                vehicle that is flown elsewhere
    ~rates      of its messages: onboard or gcs (default: gcs; the nodes ask for what they need)
    ~seed       of noise and latencies (default: 0)

Its files, the configuration and where that vehicle is heard are words: `arguments.py`.

A second process may play a part of the peers, so that it can be killed. Each process then has a world of its own from
the same seed and faults; the vehicle that obeys is that of the process that plays mission_planner, or speaks MAVLink.
"""

from __future__ import annotations

import functools
import sys
import threading
import time
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

import rospy
from std_msgs.msg import Bool

from amaze_autonomy import msg, srv
from amaze_autonomy.autopilot import Connection, Identity
from amaze_autonomy.config import ConfigError, Configuration, load_configuration
from amaze_autonomy.config.errors import EndpointError
from amaze_autonomy.engine import events
from amaze_autonomy.engine.commands import Request
from amaze_autonomy.engine.events import CheckReply, Event, Outcome, Reply
from amaze_autonomy.interface import PEERS, SERVICES, STATUSES, peer_of, status_of
from amaze_autonomy.monitoring.initialisation import InitialisationType
from amaze_autonomy.ros.clock import Clock, make_clock, wait_for_time
from amaze_autonomy.simulation import Scenario, SimulationError, Subject, World
from amaze_autonomy.simulation.ardupilot import AUTOPILOTS
from amaze_autonomy.simulation.peers.peer import Cadence
from amaze_autonomy.simulation.px4 import Px4
from amaze_autonomy.simulation.px4.pairing import addresses_of, fly_world
from amaze_autonomy.simulation.px4_udp import VehicleServer
from amaze_autonomy.simulation.scenario_file import load_scenario
from amaze_autonomy.simulation.vehicle.external import OF_DATA, WANTED, ExternalVehicle, Observer, as_external
from amaze_autonomy.simulation.vehicle.vehicle import VehicleSettings

from ...autopilot.link.dialect import mavlink
from ...ros import node_main
from ...ros.arguments import answer_words, configuration_folder, given, overrides
from ...ros.errors import NodeError, StartError
from ...ros.interface import SERVICE_CLASSES, message_class, response_of, status_message
from ..checks.state_estimation_node import INITIALISES
from .drivers import SensorPublisher, SimulatedDrivers
from .live_world import LiveWorld, RealPeers, Received, Turn

__all__ = ["PEERS", "SimulationNode", "main"]

_LANDING_LIMIT_S = 10.0
_EXTERNAL = "external"
_SWITCH_HZ = 5.0  # as the autopilot node says it
_OBSERVER = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER3  # the third, beside those of the autopilot node and of the planner
_LIMIT_NS = 3600 * 1_000_000_000  # the caller's limit is not known here
_HISTORY_NS = 5_000_000_000  # the world is older than the node, so that its checks have seen enough samples


class SimulationNode:
    """A world, and its services and topics.

    Args:
        world: made with `live=True`.
        clock: the node's.
        peers: which peers this process plays.
        received: writes down what came.
        sensors: publish the sensors' samples.
        drivers: publish those of components with a node by processes of that name.
        real: node of each peer that is a real one on this computer.
        serve: makes the server of a vehicle that speaks MAVLink; None: the vehicle does not.
        observed: the link to a vehicle that is flown elsewhere; None: it is the world's own.
    """

    def __init__(
        self,
        world: World,
        clock: Clock,
        peers: Tuple[str, ...],
        received: Received,
        *,
        sensors: bool,
        drivers: bool = False,
        real: Mapping[str, str] = {},
        serve: Optional[Callable[[LiveWorld], VehicleServer]] = None,
        observed: Optional[Connection] = None,
    ) -> None:
        self._clock, self._peers = clock, peers
        self._observed = observed
        self._jobs: List[Callable[[], None]] = []
        self._jobs_lock = threading.Lock()
        self._live = LiveWorld(world, clock, self._take, received)
        self._server = None if serve is None else serve(self._live)
        self._drivers: Optional[SimulatedDrivers] = None
        if sensors and drivers:
            settings = world.settings
            self._drivers = SimulatedDrivers(settings.components, settings.streams(), clock, self._live.restart)
        self._sensors = self._drivers or (SensorPublisher(clock) if sensors else None)
        self._real = RealPeers(real)
        self._is_watched = self._history_told = False
        self._services: Dict[str, Any] = {}
        self._status = {
            row.topic: rospy.Publisher(row.topic, message_class(row), queue_size=100, tcp_nodelay=True)
            for row in STATUSES
            if peer_of(row.topic) in peers
        }
        self._switch: Optional[rospy.Publisher] = None
        if world.settings.land_switch.channel and "autopilot" in peers:
            self._switch = rospy.Publisher("autopilot/land_switch", Bool, queue_size=10, tcp_nodelay=True)
        self._switch_cadence = Cadence(_SWITCH_HZ)
        self._engine_state = ""
        self._ended = threading.Event()
        spec = world.settings.initialisation
        services = ((spec.service, spec.type), (spec.in_flight_service, spec.in_flight_type))
        self._initialises = tuple((name, kind) for name, kind in services if name)

    def start(self) -> None:
        """Let the world begin."""
        rospy.Subscriber("autonomy/state", msg.AutonomyState, self._observe, queue_size=10)
        if "watchdog" not in self._peers:
            rospy.Subscriber("watchdog/action", msg.WatchdogAction, self._see_watchdog, queue_size=10)
        if self._drivers is not None:
            self._jobs.append(self._drivers.start)
        if self._sensors is not None:  # whose estimates are of this process
            for name, kind in self._initialises:
                handler = functools.partial(self._initialise, kind)
                rospy.Service(name, INITIALISES[kind][0], handler, error_handler=_say_nothing)
        if self._observed is not None:
            self._observed.start()
        self._live.start()
        if self._server is not None:
            self._server.start()

    def _see_watchdog(self, _message: Any) -> None:
        if not self._is_watched:
            self._is_watched = True
            self._live.note("watched")

    def _observe(self, message: Any) -> None:
        if message.state != self._engine_state:
            self._engine_state = message.state
            self._live.observe_state(message.state)

    # --- the world's side -----------------------------------------------------------------------------------------

    def _take(self, turn: Turn) -> None:
        """Publish what came of a turn of the world; on the world's thread."""
        for event in turn.events:
            self._publish(event, turn)
        self._offer(turn.services)
        on = turn.land_switch
        if self._switch is not None and on is not None and self._switch_cadence.due(self._clock.now_ns(), on):
            self._switch.publish(Bool(data=on))
        if self._sensors is not None and self._history_told:
            self._sensors.publish(turn.samples)
        self._history_told = True  # what the world sensed before the node was there comes in its first turn
        if self._drivers is not None:
            self._drivers.look_after(turn.troubles)
        self._real.look_after(turn.troubles)
        with self._jobs_lock:
            jobs, self._jobs = self._jobs, []
        for job in jobs:
            job()

    def _publish(self, event: Event, turn: Turn) -> None:
        """Publish a status, or ask the engine what the scenario's user asks."""
        if isinstance(event, events.UserRequest):
            threading.Thread(target=_ask_engine, args=(event.command.value,), daemon=True).start()
            return
        publisher = self._status.get(status_of(event).topic)
        if publisher is not None:
            publisher.publish(status_message(event, self._clock.ros_ns(), turn.health))

    def _offer(self, wanted: Tuple[str, ...]) -> None:
        """Have exactly those services that are there now."""
        for name in [name for name in self._services if name not in wanted]:
            self._services.pop(name).shutdown("vanished")
        for name in wanted:
            if name not in self._services and peer_of(name) in self._peers:
                handler = functools.partial(self._serve, name)
                self._services[name] = rospy.Service(name, SERVICE_CLASSES[name], handler, error_handler=_say_nothing)

    def _initialise(self, kind: InitialisationType, _: Any) -> Any:
        """Have the estimator begin, or not, as its fault says; on a service thread."""
        why = self._live.initialise()
        if why is None:
            self._ended.wait()  # there is no answer
        empty = kind is InitialisationType.EMPTY
        if why is None or (why and empty):
            raise rospy.ServiceException(why or "the node ends")
        return INITIALISES[kind][0]._response_class(**({} if empty else {"success": not why, "message": why}))

    def _serve(self, name: str, request: Any) -> Any:
        """Answer a request; on a service thread."""
        asked: List[Request] = []

        def make(number: int) -> Request:
            asked.append(SERVICES[name].command(request, number, _LIMIT_NS))
            return asked[0]

        reply = self._live.ask(name, make)
        if not isinstance(reply, (Reply, CheckReply)):
            raise rospy.ServiceException("the node ends")
        if getattr(reply, "outcome", None) is Outcome.BROKEN:
            raise BrokenPipeError(getattr(reply, "message", ""))
        return response_of(SERVICES[name], reply, self._clock.now_ns())

    # --- end ------------------------------------------------------------------------------------------------------

    def end(self) -> None:
        """End; a vehicle in the air does not vanish because of a Ctrl-C: it gets the time to land."""
        self._ended.set()
        deadline_s = time.monotonic() + _LANDING_LIMIT_S
        flies = "mission_planner" in self._peers or self._server is not None
        while flies and self._live.in_the_air and time.monotonic() < deadline_s:
            time.sleep(0.05)
        if self._server is not None:
            self._server.stop()
        if self._observed is not None:
            self._observed.close()
        self._live.stop()
        self._real.end()
        if self._drivers is not None:
            self._drivers.end()


def _ask_engine(command: str) -> None:
    try:
        rospy.ServiceProxy("autonomy/command", srv.UserCommand)(command)
    except rospy.ServiceException as error:
        rospy.logwarn("the scenario's user asked for %s: %s", command, error)


def _say_nothing(_error: Exception, _kind: Any, _value: Any, _trace: Any) -> None:
    """A service that breaks by the scenario is no error of this node."""


def _names(parameter: str, default: Tuple[str, ...]) -> Tuple[str, ...]:
    """Return the peers that a parameter names: a mapping of name to true or false, or names with commas."""
    value = rospy.get_param(parameter, "")
    if isinstance(value, dict):
        names = [name for name, chosen in value.items() if chosen]
    else:
        names = [name.strip() for name in str(value).split(",") if name.strip()] or list(default)
    for name in names:
        if name not in PEERS:
            raise StartError(f"{parameter} names {name!r}, there are {', '.join(PEERS)}")
    return tuple(name for name in PEERS if name in names)


def _make(stopped: threading.Event) -> SimulationNode:
    node_main.warn_of_parameters("simulation")
    configuration = load_configuration(configuration_folder(), overrides())
    peers, real = _names("~peers", PEERS), _names("~real", ())
    faults = given("faults")
    scenario = load_scenario(faults) if faults else None
    wait_for_time(stopped)
    clock = make_clock()
    start_ns = max(0, clock.now_ns() - _HISTORY_NS)
    seed, over_mavlink = node_main.whole_number("seed", 0), node_main.flag("mavlink", default=False)
    serve: Optional[Callable[[LiveWorld], VehicleServer]] = None
    observed: Optional[Connection] = None
    if str(rospy.get_param("~vehicle", "px4")) == _EXTERNAL:
        world, observed = _observing(configuration, scenario, seed, start_ns, clock)
    elif over_mavlink:
        world, serve = _flown(configuration, scenario, seed, start_ns)
    else:
        world = World(configuration, seed, scenario, start_ns=start_ns, live=True)
    received = Received(given("received"))
    sensors = node_main.flag("sensors", default=True) and ("mission_planner" in peers or over_mavlink)
    drivers = node_main.flag("drivers", default=False)
    nodes = {name: name for name in real}
    if "data_recorder" in nodes:
        nodes["data_recorder"] = f"data_recorder_{configuration.recording.collector}"
    _tell_without_effect(scenario, real)
    return SimulationNode(
        world, clock, peers, received, sensors=sensors, drivers=drivers, real=nodes, serve=serve, observed=observed
    )


def _tell_without_effect(scenario: Optional[Scenario], real: Tuple[str, ...]) -> None:
    """Say which faults do nothing, because a real node has the service, or records."""
    for fault in scenario.faults if scenario is not None else ():
        peer = peer_of(fault.target) if fault.kind.subject == Subject.SERVICE else ""
        if fault.kind.subject == Subject.WORLD and fault.kind.name in OF_DATA:
            peer = "data_recorder"
        if peer in real:
            start = "recorder:=" if peer == "data_recorder" else "flight:=simulated or monitors:="
            rospy.logwarn("the fault %s does nothing: %s is a real node; start with %ssimulated", fault, peer, start)


def _flown(
    configuration: Configuration, scenario: Optional[Scenario], seed: int, start_ns: int
) -> Tuple[World, Callable[[LiveWorld], VehicleServer]]:
    """Make a world whose vehicle speaks MAVLink, and what makes its server."""
    name = str(rospy.get_param("~vehicle", "px4"))
    if name not in AUTOPILOTS:
        raise StartError(f"~vehicle: is {name!r}; must be one of {', '.join((*AUTOPILOTS, _EXTERNAL))}")
    if configuration.autopilot.backend == "mavros":  # the nodes would command whatever vehicle is behind it
        problem = "autopilot.yaml: backend is mavros, and the simulated vehicle is reached over MAVLink alone"
        raise StartError(f"{problem}; start with flight:=simulated, or override autopilot.backend=mavlink")
    unix_ns, kind = time.time_ns() - _HISTORY_NS, AUTOPILOTS[name]
    world, px4 = fly_world(
        configuration, None, scenario, seed=seed, start_ns=start_ns, unix_ns=unix_ns, live=True, kind=kind
    )
    return world, functools.partial(_server, configuration, world, px4)


def _observing(
    configuration: Configuration, scenario: Optional[Scenario], seed: int, start_ns: int, clock: Clock
) -> Tuple[World, Connection]:
    """Make a world whose vehicle is flown elsewhere, and the link on which it is heard."""
    if not node_main.flag("mavlink", default=False):
        raise StartError("~vehicle is external, but nothing flies it: autopilot and planner must be real nodes")
    seen = Observer()
    own = Identity(configuration.autopilot.link.system_id, _OBSERVER, configuration.autopilot.link.vehicle_id)
    try:
        link = Connection(given("vehicle_url"), own, seen, wanted=WANTED, now_ns=clock.now_ns, complain=rospy.logerr)
    except EndpointError as error:
        raise StartError(f"--vehicle-url: {error}") from None

    def follow(settings: VehicleSettings, t_ns: int) -> ExternalVehicle:
        return ExternalVehicle(settings, t_ns, seen)

    external = None if scenario is None else as_external(scenario)
    return World(configuration, seed, external, start_ns=start_ns, live=True, make_vehicle=follow), link


def _server(configuration: Configuration, world: World, px4: Px4, live: LiveWorld) -> VehicleServer:
    autopilot = configuration.autopilot.link.component_id
    return VehicleServer(
        px4,
        addresses_of(configuration),
        live,
        str(rospy.get_param("~rates", "gcs")),
        mute=lambda component: component == autopilot and world.link_lost(),
        complain=rospy.logwarn,
    )


def main() -> int:
    """Run the node; return its exit status."""
    answered = answer_words("simulation", __doc__)
    if answered is not None:
        return answered
    node_main.begin("simulation")
    stopped = threading.Event()
    node_main.end_by_signals(lambda _: stopped.set())
    rospy.core.add_preshutdown_hook(lambda _: stopped.set())
    try:
        node = _make(stopped)
    except (ConfigError, NodeError, SimulationError, OSError) as error:
        print(f"simulation: {error}", file=sys.stderr, flush=True)
        return 2
    node.start()
    stopped.wait()
    node.end()
    rospy.signal_shutdown("ended")
    return 0
