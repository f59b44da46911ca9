"""The simulated PX4 on UDP sockets, with the computer's clock: a server, and a command."""

from __future__ import annotations

import argparse
import contextlib
import logging
import math
import select
import signal
import socket
import sys
import threading
import time
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Protocol, Sequence, Set, Tuple

from amaze_autonomy import paths
from amaze_autonomy.command_line import run_command
from amaze_autonomy.config import ConfigError, load_configuration
from amaze_autonomy.config.errors import EndpointError
from amaze_autonomy.config.kinds import Endpoint, EndpointKind, parse_endpoint
from amaze_autonomy.interface import PEERS
from amaze_autonomy.simulation.ardupilot import AUTOPILOTS
from amaze_autonomy.simulation.cli import scenario_file
from amaze_autonomy.simulation.errors import SimulationError
from amaze_autonomy.simulation.px4 import Framing, Geography, Place, Px4, Px4Settings, VehicleAddressError
from amaze_autonomy.simulation.px4.pairing import fly_world
from amaze_autonomy.simulation.px4.wire import PRESETS
from amaze_autonomy.simulation.scenario import Scenario
from amaze_autonomy.simulation.scenario_file import load_scenario
from amaze_autonomy.simulation.world import World

# --- the server -------------------------------------------------------------------------------------------------------
# ``udpin:HOST:PORT`` waits there; everyone who speaks to it becomes a connection of its own. When there are too many,
# whoever is silent for longest is forgotten. ``udpout:HOST:PORT`` speaks to that address from the beginning, as PX4
# does to computers on board, and never forgets it.


_SLICE_S, _LEAST_S = 0.02, 0.004
_PEERS_MAX = 16
_SILENT_S = 3.0  # three heartbeats: whoever is silent for longer makes room for another one
_BYTES = 65536
_log = logging.getLogger(__name__)

_Place = Tuple[str, int]


class VehicleTime(Protocol):
    """Whoever owns the vehicle's world and its clock."""

    def exchange(self, act: Callable[[int], List[Tuple[str, Any]]]) -> List[Tuple[str, Any]]:
        """Bring the world to the present time and call `act` with it, while nobody else touches the world."""


class _Peer(NamedTuple):
    """The other end of a connection."""

    port: socket.socket
    place: _Place
    framing: Framing


class VehicleServer:
    """Serves one simulated PX4.

    Args:
        px4: it.
        addresses: udpin: and udpout: URLs.
        owner: of the world.
        preset: of the rates of new connections: onboard or gcs.
        mute: names connections (a component that was heard on them) that are cut at this moment.
        complain: is told once that somebody is not answered, and once that somebody is forgotten.

    Raises:
        VehicleAddressError: an address cannot be served.
    """

    def __init__(
        self,
        px4: Px4,
        addresses: Tuple[str, ...],
        owner: VehicleTime,
        preset: str = "onboard",
        mute: Callable[[int], bool] = lambda _: False,
        *,
        complain: Callable[[str], None] = _log.warning,
    ) -> None:
        self._px4, self._owner, self._preset, self._mute, self._complain = px4, owner, preset, mute, complain
        self._peers: Dict[str, _Peer] = {}
        self._heard: Dict[str, int] = {}
        self._heard_s: Dict[str, float] = {}
        self._kept: Set[Optional[str]] = set()
        self._told_full = self._told_forgotten = False
        self._waiting: List[socket.socket] = []
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="vehicle", daemon=True)
        try:
            for address in addresses:
                self._open(address)
        except VehicleAddressError:
            self._close()
            raise

    @property
    def ports(self) -> Tuple[int, ...]:
        """The UDP port of each address, in order."""
        return tuple(int(port.getsockname()[1]) for port in self._waiting)

    def start(self) -> None:
        """Serve from now on."""
        self._thread.start()

    def stop(self) -> None:
        """Stop, and close the sockets."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join(5.0)
        self._close()

    def run(self, stopped: threading.Event) -> None:
        """Serve on this thread until an event is set."""
        while not stopped.is_set():
            self._step()
        self._close()

    # --- sockets --------------------------------------------------------------------------------------------------

    def _open(self, address: str) -> None:
        endpoint = _endpoint(address)
        port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        port.setblocking(False)
        self._waiting.append(port)
        place = (endpoint.address, endpoint.number)
        try:
            port.bind(place if endpoint.kind is EndpointKind.UDP_IN else ("", 0))
        except OSError as error:
            raise VehicleAddressError(address, error.strerror or str(error)) from error
        if endpoint.kind is EndpointKind.UDP_OUT:
            with contextlib.suppress(OSError):
                place = (socket.gethostbyname(endpoint.address), endpoint.number)
            self._kept.add(self._meet(port, place))

    def _close(self) -> None:
        for port in self._waiting:
            port.close()

    def _meet(self, port: socket.socket, place: _Place) -> Optional[str]:
        """Return the name of the connection to a place; None when there are too many already."""
        name = f"{place[0]}:{place[1]}"
        if name not in self._peers:
            if len(self._peers) >= _PEERS_MAX and not self._make_room(name):
                return None
            settings = self._px4.settings
            framing = Framing(settings.system, 1, settings.signing_key, time.time_ns())
            self._peers[name] = _Peer(port, place, framing)
            self._px4.connect(name, self._preset)
        return name

    def _make_room(self, name: str) -> bool:
        """Forget whoever is silent for longest; False when all still speak. A transfer of theirs ends by its limit."""
        silent = min(self._heard_s, key=lambda each: self._heard_s[each], default="")
        if not silent or time.monotonic() - self._heard_s[silent] < _SILENT_S:
            if not self._told_full:
                self._told_full = True
                speak = f"{_PEERS_MAX} speak to the simulated vehicle"
                self._complain(f"{speak}: it does not answer {name}, nor others, until one is silent")
            return False
        del self._peers[silent], self._heard_s[silent]
        self._heard.pop(silent, None)
        self._px4.disconnect(silent)
        if not self._told_forgotten:
            self._told_forgotten = True
            spoken = f"{_PEERS_MAX} have spoken to the simulated vehicle"
            self._complain(f"{spoken}: {silent}, silent for longest, is forgotten, and others will be")
        return True

    # --- the loop -------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._stopped.is_set():
            try:
                self._step()
            except Exception:  # noqa: BLE001 - whatever it is, the others are still served
                _log.exception("the simulated vehicle failed")
                time.sleep(_SLICE_S)

    def _step(self) -> None:
        readable, _, _ = select.select(self._waiting, [], [], _SLICE_S)
        came = [datagram for port in readable for datagram in _datagrams(port)]
        out = self._owner.exchange(lambda t_ns: self._exchange(t_ns, came))
        for name, message in out:
            self._send(name, message)
        if came:
            time.sleep(_LEAST_S)  # many small datagrams are better taken together

    def _exchange(self, t_ns: int, came: List[Tuple[socket.socket, _Place, bytes]]) -> List[Tuple[str, Any]]:
        for port, place, data in came:
            name = self._meet(port, place)
            if name is None:
                continue
            if name not in self._kept:
                self._heard_s[name] = time.monotonic()
            for message in self._peers[name].framing.decode(data):
                self._heard[name] = message.get_srcComponent()
                if not self._cut(name):
                    self._px4.receive(t_ns, name, message)
        return self._px4.advance(t_ns)

    def _cut(self, name: str) -> bool:
        return name in self._heard and self._mute(self._heard[name])

    def _send(self, name: str, message: Any) -> None:
        peer = self._peers.get(name)
        if peer is None or self._cut(name):
            return
        with contextlib.suppress(OSError):  # nobody is there, or the buffer is full: as on any radio
            peer.port.sendto(peer.framing.encode(message), peer.place)


def _datagrams(port: socket.socket) -> List[Tuple[socket.socket, _Place, bytes]]:
    """Return what has come to a socket."""
    came: List[Tuple[socket.socket, _Place, bytes]] = []
    while True:
        try:
            data, place = port.recvfrom(_BYTES)
        except BlockingIOError:
            return came
        except OSError:
            continue  # an earlier datagram met a closed port
        came.append((port, place, data))


def _endpoint(address: str) -> Endpoint:
    try:
        endpoint = parse_endpoint(address)
    except EndpointError as error:
        raise VehicleAddressError(address, str(error)) from error
    if endpoint.kind not in (EndpointKind.UDP_IN, EndpointKind.UDP_OUT):
        raise VehicleAddressError(address, "must be udpin:HOST:PORT or udpout:HOST:PORT")
    return endpoint


# --- the command ------------------------------------------------------------------------------------------------------


_OK, _USAGE = 0, 2
_DEFAULT = "udpin:127.0.0.1:14540"
_EPILOG = f"""\
examples:
  amaze-autonomy vehicle                                     waits at {_DEFAULT}
  amaze-autonomy vehicle --link udpout:127.0.0.1:14540       speaks to whoever waits there
  amaze-autonomy vehicle --faults battery_drain --rates gcs
  amaze-autonomy vehicle --autopilot ardupilot               an ArduCopter instead

It ends with SIGINT or SIGTERM.
"""


class _Clock:
    """Moves a world with the computer's clock, for one thread."""

    def __init__(self, world: World) -> None:
        self._world, self._begin_ns = world, time.monotonic_ns()

    def exchange(self, act: Callable[[int], List[Tuple[str, Any]]]) -> List[Tuple[str, Any]]:
        """Bring the world to the present time and call `act` with it."""
        self._world.advance(time.monotonic_ns() - self._begin_ns)  # nobody listens to its own events here
        return act(self._world.now_ns)


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Run the command and return its exit status."""
    options = _parser().parse_args(argv)
    return run_command("vehicle", lambda: _run(options), (ConfigError, SimulationError, ValueError), wrong=_USAGE)


def _run(options: argparse.Namespace) -> int:
    world, px4 = _make(options)
    server = VehicleServer(px4, tuple(options.links) or (_DEFAULT,), _Clock(world), options.rates, _muted(world))
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    print(f"vehicle: system {px4.settings.system}, {', '.join(options.links) or _DEFAULT}", flush=True)  # noqa: T201 (a command)
    server.run(stopped)
    return _OK


def _muted(world: World) -> Callable[[int], bool]:
    """Return what cuts all links while the scenario says so."""
    return lambda _component: world.link_lost()


def _make(options: argparse.Namespace) -> Tuple[World, Px4]:
    configuration = load_configuration(options.config or paths.config_folder(), options.overrides)
    folder = options.config or paths.config_folder()
    scenario = load_scenario(scenario_file(folder, options.faults)) if options.faults else Scenario()
    if not 1 <= options.system <= 255:  # noqa: PLR2004 - MAVLink's
        raise ValueError(f"--system {options.system}: must be 1 to 255")
    settings = Px4Settings(
        system=options.system, geography=Geography(_place(options.home)), transmitter=not options.no_transmitter
    )
    return fly_world(
        configuration,
        settings,
        scenario,
        seed=options.seed,
        unix_ns=time.time_ns(),
        without=PEERS,
        kind=AUTOPILOTS[options.autopilot],
    )


def _place(text: str) -> Place:
    try:
        latitude, longitude, altitude = (float(part) for part in text.split(","))
        good = abs(latitude) < 90.0 and abs(longitude) <= 180.0 and math.isfinite(altitude)  # noqa: PLR2004 - degrees
    except ValueError:
        good = False
    if not good:
        raise ValueError(f"--home {text}: must be latitude,longitude,altitude, e.g. 47.397743,8.545594,489.4")
    return Place(latitude, longitude, altitude)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "amaze-autonomy vehicle",
        description="A simulated PX4, or ArduCopter, that speaks MAVLink on UDP, in real time. No ROS is needed.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    words = "udpin:HOST:PORT to wait there for up to 16 peers, udpout:HOST:PORT to speak to one; may be repeated"
    parser.add_argument("--link", action="append", default=[], dest="links", metavar="URL", help=words)
    words = "rates of its messages: those for a computer on board, or the lower ones for a ground station"
    parser.add_argument("--rates", choices=tuple(PRESETS), default="onboard", help=words)
    parser.add_argument("--autopilot", choices=tuple(AUTOPILOTS), default="px4", help="which one (default: px4)")
    parser.add_argument("--system", type=int, default=1, help="MAVLink system id (default: 1)")
    words = "latitude, longitude, altitude where it stands"
    parser.add_argument("--home", default="47.397743,8.545594,489.4", metavar="LAT,LON,ALT", help=words)
    parser.add_argument("--no-transmitter", action="store_true", help="the pilot's transmitter is off")
    words = "scenario: a file, or the name of one in the configuration's folder faults/"
    parser.add_argument("--faults", default="", metavar="FILE", help=words)
    parser.add_argument("--seed", type=int, default=0, help="of noise (default: 0)")
    words = "folder of the configuration (default: the one that ships with the package)"
    parser.add_argument("--config", type=paths.expanded, metavar="DIR", help=words)
    words = "override a value of the configuration; may be repeated"
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help=words)
    return parser


if __name__ == "__main__":
    sys.exit(main())
