"""What every peer of the engine is in this world, and what all of them share.

A peer is one small class: it answers the commands that go to its services, and it makes its status. Where a real node
takes its place, the world leaves it out, and nothing else changes.
"""

from __future__ import annotations

import abc
import random
from dataclasses import dataclass, field
from typing import Dict, List, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.commands import Request, RunCheck
from amaze_autonomy.engine.events import CheckReply, Event, Outcome, Reply

from ...engine.events import Check, Verdict
from ...monitoring.initialisation import InitialisationSpec
from ..faults import Faults
from ..scenario import Fault, Subject
from ..settings import Settings
from ..streams import Batch, Stream
from ..vehicle.vehicle import Power, Vehicle

_S = 1_000_000_000


@dataclass
class Site:
    """What the peers of one world look at.

    Args:
        settings: what the world is made of.
        vehicle: the vehicle.
        power: its battery.
        faults: what is wrong now.
        seed: of the world.
        streams: the sensors, by topic.
        batches: samples since the last step, by topic.
        happened: (name, number) of what happened in this step, for triggers.
        health: what the autopilot node last said of the PX4's sensors: (time, sensor -> healthy); None: nothing.
    """

    settings: Settings
    vehicle: Vehicle
    power: Power
    faults: Faults
    seed: int
    streams: Dict[str, Stream] = field(default_factory=dict)
    batches: Dict[str, List[Batch]] = field(default_factory=dict)
    happened: List[Tuple[str, int]] = field(default_factory=list)
    health: Optional[Tuple[int, Dict[str, bool]]] = None

    def __post_init__(self) -> None:
        nodes = {spec.name: spec.node for spec in self.settings.components}
        self._of_node = {
            name: tuple(each for each, node in nodes.items() if each == name or (node and node == nodes[name]))
            for name in nodes
        }
        self.restarts = Restarts(self.faults)
        self.estimator = Estimator(self.settings.initialisation, self.faults)
        self.restarted: List[Tuple[str, bool]] = []

    def noise(self, name: str) -> random.Random:
        """Return a source of noise of its own, so that one peer's absence changes nobody else's."""
        return random.Random(f"{self.seed}:{name}")  # noqa: S311 - noise, not a secret

    def note(self, name: str, number: int = 0) -> None:
        """Say that something happened that a trigger may wait for."""
        self.happened.append((name, number))

    def autopilot_speaks(self) -> bool:
        """Tell whether the status of the autopilot node is heard, so that its word on the PX4's sensors is."""
        return not any(self.faults.active(Subject.PROCESS, kind, "autopilot") for kind in ("killed", "silent"))

    def lives(self, process: str) -> bool:
        """Tell whether a peer's process lives."""
        return self.faults.active(Subject.PROCESS, "killed", process) is None

    def of_node(self, component: str) -> Tuple[str, ...]:
        """Return the components whose node is that of a component, itself among them."""
        return self._of_node[component]

    def component_lives(self, component: str) -> bool:
        """Tell whether a component's process lives: it goes with every other one that shares its node."""
        killed = (self.faults.active(Subject.COMPONENT, "killed", each) for each in self._of_node[component])
        return all(fault is None for fault in killed) and not self.restarts.ends(component)

    def world_fault(self, kind: str) -> Optional[Fault]:
        """Return the fault of a kind of which there is one in the world, if it acts now."""
        return self.faults.active(Subject.WORLD, kind)


class Estimator:
    """The estimator: where it must be told to begin, it says nothing before.

    Args:
        spec: what initialises it.
        faults: what is wrong now.
    """

    def __init__(self, spec: InitialisationSpec, faults: Faults) -> None:
        self._faults = faults
        self.runs = not spec.service

    def initialise(self) -> Optional[str]:
        """Take a call of its service; return why not, in words, or nothing; None: there is no answer."""
        fault = self._faults.active(Subject.WORLD, "not_initialised")
        how = "" if fault is None else fault.word("how")
        self.runs = self.runs or not how
        return {"refuses": "the estimator refuses", "hangs": None}.get(how, "")


class Peer(abc.ABC):
    """Base of the peers. A killed one is made anew when it comes back."""

    name = ""

    def __init__(self, site: Site) -> None:
        self.site = site

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Do what a command asks and return the reply; None: it follows later, among the events of `step`."""
        if not isinstance(command, RunCheck):
            return refused(command, f"not the business of the {self.name}")
        rows = self.checks(t_ns, command)
        return CheckReply(
            t_ns=t_ns,
            command_id=command.id,
            check=command.check,
            outcome=Outcome.ACCEPTED,
            ok=all(row.passed for row in rows),
            checks=rows,
        )

    def checks(self, t_ns: int, command: RunCheck) -> Tuple[Check, ...]:  # noqa: ARG002
        """Return the rows of one of its checks; in a world where nothing can be wrong with it, it passes."""
        return (Check(command.check.value.replace("_", " "), Verdict.PASS),)

    def entered(self, state: str) -> None:
        """Take notice of a state of the engine."""

    @abc.abstractmethod
    def step(self, t_ns: int) -> List[Event]:
        """Do what is to be done at a time; return statuses and late replies."""


class Cadence:
    """Tells when a status is due: at its period, and at once when what matters in it has changed."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(_S / rate_hz)
        self._next_ns: Optional[int] = None
        self._key: object = None

    def due(self, t_ns: int, key: object, slowness: float = 1.0) -> bool:
        """Tell whether to send now; `slowness` stretches the period and takes away the "at once"."""
        changed = key != self._key and slowness == 1.0
        if self._next_ns is not None and t_ns < self._next_ns and not changed:
            return False
        self._key = key
        period = round(self._period_ns * slowness)
        on_time = self._next_ns is not None and self._next_ns <= t_ns < self._next_ns + period
        self._next_ns = (self._next_ns if on_time and self._next_ns is not None else t_ns) + period
        return True


def slowness(site: Site, name: str) -> float:
    """Return by how much a process is slower than it should be, because a fault says so."""
    fault = site.faults.active(Subject.PROCESS, "slow", name)
    return 1.0 / fault.number("rate_fraction") if fault is not None else 1.0


def reply(command: Request, outcome: Outcome, message: str = "") -> Event:
    """Make the plain reply to a command; the world sets its time."""
    if isinstance(command, RunCheck):
        return CheckReply(t_ns=0, command_id=command.id, check=command.check, outcome=outcome, message=message)
    return Reply(t_ns=0, command_id=command.id, outcome=outcome, message=message)


def accepted(command: Request, message: str = "") -> Event:
    """Make the reply "accepted"."""
    return reply(command, Outcome.ACCEPTED, message)


def refused(command: Request, message: str) -> Event:
    """Make the reply "refused"."""
    return reply(command, Outcome.REFUSED, message)


# --- restarts ---------------------------------------------------------------------------------------------------------
# What comes of restarting a simulated component: what its faults say. Who asks is the watchdog, simulated or real.


_QUICK_NS = 2 * _S


class _Running(NamedTuple):
    """A restart under way: when it ends, the faults that it ends, none when it fails, and whose node is ended by it."""

    ends_ns: int
    good: bool
    cures: Tuple[Fault, ...]
    ended: Tuple[str, ...]


class Restarts:
    """The restarts that are under way; a component has one at most, a second one begins it anew."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._running: Dict[str, _Running] = {}

    def begin(self, t_ns: int, component: str, ended: Tuple[str, ...] = ()) -> None:
        """Restart a component; where its node is ended for it, with all components of that node."""
        faults = [fault for each in ended or (component,) for fault, _ in self._faults.on(Subject.COMPONENT, each)]
        acting = [fault for fault in faults if fault.has("restart")]
        good = all(fault.word("restart") == "succeeds" for fault in acting)
        takes_ns = max((round(fault.number("restart_takes_s") * _S) for fault in acting), default=_QUICK_NS)
        self._running[component] = _Running(t_ns + takes_ns, good, tuple(acting) if good else (), ended)

    def ends(self, component: str) -> bool:
        """Tell whether the node of a component is ended now, and not back yet."""
        return any(component in running.ended for running in self._running.values())

    def step(self, t_ns: int) -> List[Tuple[str, bool]]:
        """Return (component, whether it came up) of the restarts that have ended."""
        ended: List[Tuple[str, bool]] = []
        for component, running in list(self._running.items()):
            if running.ends_ns > t_ns:
                continue
            del self._running[component]
            for fault in running.cures:
                self._faults.end(t_ns, fault)
            ended.append((component, running.good))
        return ended
