"""Faults of the engine's peers and of the engine itself in a replay, and what the user asks: not of messages."""

from __future__ import annotations

from typing import List, Mapping, Optional, Sequence, Tuple, Type

from amaze_autonomy.engine.commands import Request
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    EngineStarted,
    Event,
    LandedStatus,
    MissionStatus,
    Outcome,
    RecordingStatus,
    Shutdown,
    UserCommand,
    UserRequest,
    WatchdogAction,
    WatchdogInfo,
)
from amaze_autonomy.engine.state import evolve
from amaze_autonomy.interface import service_of
from amaze_autonomy.simulation import Fault, Subject
from amaze_autonomy.simulation.peers.peer import reply
from amaze_autonomy.simulation.peers.switchboard import SPOILT, in_its_place

from .kinds import Acting

_S = 1_000_000_000
_MS = 1_000_000
_SPEAKERS: Mapping[Type[Event], str] = {
    WatchdogAction: "watchdog",
    WatchdogInfo: "watchdog",
    LandedStatus: "landing_detection",
    AutopilotStatus: "autopilot",
    MissionStatus: "mission_planner",
    RecordingStatus: "data_recorder",
}


class Story:
    """What happens in a replay besides its recording; the default: nothing.

    Args:
        acting: faults with their times.
        requests: of the user, with their times.
    """

    def __init__(self, acting: Sequence[Acting] = (), requests: Sequence[Tuple[int, UserCommand]] = ()) -> None:
        self._acting, self._requests = tuple(acting), tuple(requests)
        self.touched: List[int] = [0] * len(self._acting)

    @property
    def acts(self) -> bool:
        """False when there are no faults: everything is heard as it comes."""
        return bool(self._acting)

    def events(self) -> Tuple[Event, ...]:
        """Return what is due at a time that is known: requests, the end of the process, its new start."""
        found: List[Event] = [
            UserRequest(t_ns=t_ns, command=command, request_id=900_000 + number)
            for number, (t_ns, command) in enumerate(self._requests)
        ]
        for each in self._acting:
            if each.fault.kind.subject != Subject.PROCESS:
                continue
            if each.fault.kind.name == "interrupted":
                found.append(Shutdown(t_ns=each.begin_ns))
            elif each.fault.kind.name == "restarted" and each.end_ns is not None:
                kept = each.fault.word("journal") == "kept"
                found.append(EngineStarted(t_ns=each.end_ns, label="restarted", resumed=kept))
        return tuple(found)

    def engine_down(self, t_ns: int) -> bool:
        """Tell whether the engine's process is dead: it hears nothing."""
        number = self._find(Subject.PROCESS, ("restarted",), t_ns)
        if number is not None:
            self.touched[number] += 1
        return number is not None

    def heard(self, event: Event) -> Optional[Event]:
        """Return what the engine hears as it comes; None: its peer is silent."""
        if isinstance(event, Shutdown):
            self._count_interrupted(event.t_ns)
        peer = _SPEAKERS.get(type(event))
        if peer is None or not self._acting:
            return event
        number = self._find(Subject.PROCESS, ("silent",), event.t_ns, peer)
        if number is not None:
            self.touched[number] += 1
            return None
        return self._recorded(event) if isinstance(event, RecordingStatus) else event

    def answer(self, t_ns: int, command: Request) -> Tuple[bool, int, Optional[Event]]:
        """Return whether a fault acts in a service's place, after how long it answers, and what comes instead.

        A delay may come alone. A slow service does what it is asked; beyond the limit its answer is not heard any more.
        """
        service = service_of(command)
        name = "" if service is None else service.name
        spoilt = self._find(Subject.SERVICE, (*SPOILT, "vanishes"), t_ns, name)
        if spoilt is not None:
            self.touched[spoilt] += 1
            return (True, *self._spoilt(self._acting[spoilt].fault, command))
        slow = self._find(Subject.SERVICE, ("slow",), t_ns, name)
        if slow is None:
            return False, 0, None
        self.touched[slow] += 1
        delay_ns = round(self._acting[slow].fault.number("delay_s") * _S)
        if delay_ns >= command.limit_ns:
            return False, command.limit_ns, reply(command, Outcome.TIMED_OUT)
        return False, delay_ns, None

    def _count_interrupted(self, t_ns: int) -> None:
        for number, each in enumerate(self._acting):
            if each.fault.kind.name == "interrupted" and each.begin_ns == t_ns:
                self.touched[number] += 1

    @staticmethod
    def _spoilt(fault: Fault, command: Request) -> Tuple[int, Event]:
        if fault.kind.name == "vanishes":
            return _MS, reply(command, Outcome.UNAVAILABLE, "there is no such service")
        instead = in_its_place(fault, command)
        return (command.limit_ns, reply(command, Outcome.TIMED_OUT)) if instead is None else (_MS, instead)

    def _recorded(self, status: RecordingStatus) -> RecordingStatus:
        number = self._find(Subject.WORLD, ("storage_full",), status.t_ns)
        if number is None or not any(each.growing for each in status.platforms):
            return status
        self.touched[number] += 1
        platforms = tuple(evolve(each, growing=False, free_fraction=0.0) for each in status.platforms)
        return evolve(status, platforms=platforms)

    def _find(self, subject: str, kinds: Sequence[str], t_ns: int, target: Optional[str] = None) -> Optional[int]:
        for number, each in enumerate(self._acting):
            fault = each.fault
            if (
                fault.kind.subject == subject
                and fault.kind.name in kinds
                and each.holds(t_ns)
                and target in (None, fault.target)
            ):
                return number
        return None
