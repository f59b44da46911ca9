"""Carries requests to the services of the peers and brings their replies back, as well as the faults let it."""

from __future__ import annotations

import heapq
from collections import Counter
from typing import Counter as CounterType
from typing import Dict, List, Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.commands import Request, RunCheck
from amaze_autonomy.engine.events import CheckReply, Event, Outcome
from amaze_autonomy.engine.state import evolve
from amaze_autonomy.interface import SERVICES, peer_of

from ...engine.events import Check, Verdict
from ..scenario import Fault, Subject
from .peer import Peer, Site, accepted, reply

_MS = 1_000_000
_S = 1000 * _MS
_QUICKEST_NS, _SLOWEST_NS = 2 * _MS, 12 * _MS


class _Open(NamedTuple):
    """A request that has not been answered: its service, and whether an answer is on its way."""

    command: Request
    service: str
    on_its_way: bool


class Switchboard:
    """Everything that is under way between the engine and its peers.

    Args:
        site: of the peers.
        peers: by name; one that is replaced later is seen.
        live: requests have no limit here; the caller's own holds.
    """

    def __init__(self, site: Site, peers: Mapping[str, Peer], *, live: bool) -> None:
        self._site, self._peers, self._live = site, peers, live
        self._calls: CounterType[str] = Counter()
        self._deliveries: List[Tuple[int, int, Event]] = []
        self._deadlines: List[Tuple[int, int, int]] = []
        self._open: Dict[int, _Open] = {}
        self._serial = 0

    @property
    def next_ns(self) -> Optional[int]:
        """Time of the next delivery, or of the next request to time out; None when nothing is under way."""
        times = [queue[0][0] for queue in (self._deliveries, self._deadlines) if queue]
        return min(times) if times else None

    def send(self, t_ns: int, event: Event) -> None:
        """Deliver an event at a time."""
        self._serial += 1
        heapq.heappush(self._deliveries, (t_ns, self._serial, event))

    def call(self, t_ns: int, service: str, command: Request) -> None:
        """Carry a request to its service."""
        self._open[command.id] = _Open(command, service, on_its_way=False)
        if not self._live:
            self._serial += 1
            heapq.heappush(self._deadlines, (t_ns + command.limit_ns, self._serial, command.id))
        if not self.is_there(service):
            self._answer(t_ns + _MS, reply(command, Outcome.UNAVAILABLE, f"there is no service {service}"))
            return
        spoilt, answer = self._spoilt(service, command)
        if not spoilt:
            answer = self._peers[peer_of(service)].answer(t_ns, command)
        if answer is not None:
            slow = self._site.faults.active(Subject.SERVICE, "slow", service)
            delay_ns = round(slow.number("delay_s") * _S) if slow is not None else 0
            self._answer(t_ns + self._latency_ns(service) + delay_ns, answer)

    def _latency_ns(self, service: str) -> int:
        """Draw how long an answer takes; one service more leaves those of all others as they were."""
        self._calls[service] += 1
        return self._site.noise(f"latency of {service} {self._calls[service]}").randrange(_QUICKEST_NS, _SLOWEST_NS)

    def deliver(self, t_ns: int) -> List[Event]:
        """Return what arrives up to a time, and the end of requests that were not answered in time."""
        events: List[Event] = []
        while self._deliveries and self._deliveries[0][0] <= t_ns:
            at_ns, _, event = heapq.heappop(self._deliveries)
            self._open.pop(getattr(event, "command_id", -1), None)
            events.append(evolve(event, t_ns=at_ns))
        while self._deadlines and self._deadlines[0][0] <= t_ns:
            _, _, command_id = heapq.heappop(self._deadlines)
            late = self._open.pop(command_id, None)
            if late is not None:
                events.append(evolve(reply(late.command, Outcome.TIMED_OUT), t_ns=t_ns))
        return events

    def hang_up(self, t_ns: int, process: str) -> None:
        """End the calls to a process that has just died: they break in the middle."""
        for each in list(self._open.values()):
            if peer_of(each.service) == process and not each.on_its_way:
                self._answer(t_ns, reply(each.command, Outcome.BROKEN, f"{process} has died in mid-call"))

    def services(self) -> Tuple[str, ...]:
        """Return the services that are there now."""
        return tuple(name for name in SERVICES if peer_of(name) in self._peers and self.is_there(name))

    def is_there(self, service: str) -> bool:
        """Tell whether a service is there now: its process lives, and it has not vanished."""
        vanished = self._site.faults.active(Subject.SERVICE, "vanishes", service) is not None
        return self._site.lives(peer_of(service)) and not vanished

    def _answer(self, t_ns: int, answer: Event) -> None:
        """Send a reply, and note that it is on its way."""
        command_id = getattr(answer, "command_id", -1)
        waiting = self._open.get(command_id)
        if waiting is not None:
            self._open[command_id] = waiting._replace(on_its_way=True)
        self.send(t_ns, answer)

    def _spoilt(self, service: str, command: Request) -> Tuple[bool, Optional[Event]]:
        """Return whether a fault of a service answers in its place, and what; None: no answer at all."""
        for fault, _ in self._site.faults.on(Subject.SERVICE, service):
            if fault.kind.name in SPOILT:
                return True, in_its_place(fault, command)
        return False, None


SPOILT = ("refuses", "hangs", "breaks", "lies")


def in_its_place(fault: Fault, command: Request) -> Optional[Event]:
    """Return what comes instead of a service's answer while a fault of SPOILT acts; None: nothing."""
    kind = fault.kind.name
    if kind == "hangs":
        return None
    if kind == "breaks":
        return reply(command, Outcome.BROKEN, "the connection was closed in mid-call")
    if kind == "lies":
        return evolve(accepted(command), ok=True) if isinstance(command, RunCheck) else accepted(command)
    return _refusal(command)


def _refusal(command: Request) -> Event:
    """Make the answer "no": of a check, a row that failed."""
    if not isinstance(command, RunCheck):
        return reply(command, Outcome.REFUSED, "refused")
    row = Check(command.check.value, Verdict.FAIL, advice="refused")
    answer = reply(command, Outcome.ACCEPTED, "refused")
    return evolve(answer, checks=(row,)) if isinstance(answer, CheckReply) else answer
