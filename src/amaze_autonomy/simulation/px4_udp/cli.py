"""The command `amaze-autonomy vehicle`: the simulated PX4 or ArduCopter on UDP, in real time, without ROS."""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any, Callable, List, Optional, Sequence, Tuple

from amaze_autonomy import paths
from amaze_autonomy.command_line import run_command
from amaze_autonomy.config import ConfigError, load_configuration
from amaze_autonomy.interface import PEERS
from amaze_autonomy.simulation.autopilots import AUTOPILOTS
from amaze_autonomy.simulation.cli import scenario_file
from amaze_autonomy.simulation.errors import SimulationError
from amaze_autonomy.simulation.px4 import Geography, Place, Px4, Px4Settings
from amaze_autonomy.simulation.px4.links import PRESETS
from amaze_autonomy.simulation.px4.pairing import fly_world
from amaze_autonomy.simulation.scenario import Scenario
from amaze_autonomy.simulation.scenario_file import load_scenario
from amaze_autonomy.simulation.world import World

from .server import VehicleServer

__all__ = ["main"]

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
    print(f"vehicle: system {px4.settings.system}, {', '.join(options.links) or _DEFAULT}", flush=True)
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
    words = "udpin:HOST:PORT to wait there for any number of peers, udpout:HOST:PORT to speak to one; may be repeated"
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
    parser.add_argument("--config", type=Path, metavar="DIR", help=words)
    words = "override a value of the configuration; may be repeated"
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help=words)
    return parser


if __name__ == "__main__":
    sys.exit(main())
