"""Our nodes in the places of the CNS Flight Stack's: what its engine asks becomes ours, what ours say its words. Pure.

Each is asked what its engine asks of a service (`asked`), hears its topics (`heard`), is told our statuses (`told`) and
how our services answered (`replied`), and looks at the time in `step`. What it wants is in its outbox: requests to our
nodes, messages and answers to its engine, and notices for people. The mission planner is in `served_planner.py`.
"""

from __future__ import annotations

import abc
from math import isfinite
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from amaze_autonomy.engine.commands import Request, RunCheck, StartRecording, StopRecording
from amaze_autonomy.engine.events import (
    CheckName,
    CheckReply,
    ComponentStatus,
    Event,
    Landed,
    LandedStatus,
    Outcome,
    RecordingPhase,
    RecordingStatus,
    Reply,
    WatchdogAction,
    WatchdogInfo,
)
from amaze_autonomy.engine.rules import Code, Rules
from amaze_autonomy.monitoring.specs import ComponentSpec

from .peers import Publish
from .tables import EntityStatus

_S = 1_000_000_000
_BEAT_NS = _S // 2
_LONGEST_STARTUP_S = 600.0
_P = RecordingPhase
_OVER = (_P.IDLE, _P.COMPLETE, _P.FAILED)


class Response(NamedTuple):
    """The answer to a call of its engine: the number of the call, and fields of the response."""

    number: int
    fields: Mapping[str, Any]


class Notice(NamedTuple):
    """What a person is told, once."""

    text: str


class Served(abc.ABC):
    """Base of our nodes as its engine sees them.

    Args:
        ids: of the requests to our nodes; no two have the same.
    """

    def __init__(self, ids: Iterator[int]) -> None:
        self.outbox: List[Union[Request, Publish, Response, Notice]] = []
        self._ids = ids

    def asked(self, t_ns: int, number: int, request: Any) -> None:
        """Take a call of its service; the answer has the same number."""

    def heard(self, t_ns: int, key: str, message: Any) -> None:
        """Take a message of its engine."""

    def told(self, t_ns: int, event: Event) -> None:
        """Take a status of our nodes."""

    @abc.abstractmethod
    def replied(self, t_ns: int, reply: Union[Reply, CheckReply]) -> None:
        """Take the answer of one of our services."""

    def step(self, t_ns: int) -> None:
        """Look at the time."""


def why_not(reply: Union[Reply, CheckReply]) -> str:
    """Return why a reply is no yes, in words; empty when it is one."""
    if reply.outcome is Outcome.ACCEPTED and getattr(reply, "ok", True):
        return ""
    bad = [row for row in getattr(reply, "checks", ()) if not row.passed]
    rows = "; ".join(f"{row.name}: {row.advice or row.verdict.value}" for row in bad)
    return rows or reply.message or reply.outcome.value


# --- watchdog ---------------------------------------------------------------------------------------------------------


class Entity(NamedTuple):
    """What its engine calls one of our components: entity, kind (topic 1, node 2, driver 3), and what is watched."""

    entity: str
    kind: int
    name: str

    @classmethod
    def of(cls, spec: ComponentSpec, entity: str = "") -> Entity:
        """Return the entity of a component, under its own name unless another one is given."""
        watched = (spec.topics[0].topic if spec.topics else None, spec.node, spec.driver[0] if spec.driver else None)
        kind, name = next(((kind, name) for kind, name in enumerate(watched, start=1) if name), (0, spec.name))
        return cls(entity or spec.name, kind, name)


class ServedWatchdog(Served):
    """Our watchdog as its watchdog.

    Args:
        ids: of the requests.
        check: ours that starts it.
        entities: by our components' names.
        reply_limit_ns: of our watchdog's answer, beyond the start-up time.
    """

    def __init__(
        self, ids: Iterator[int], check: CheckName, entities: Mapping[str, Entity], reply_limit_ns: int
    ) -> None:
        super().__init__(ids)
        self._check, self._entities, self._reply_limit_ns = check, entities, reply_limit_ns
        self._calls: Dict[int, int] = {}
        self._startup_until_ns = 0
        self._components: Tuple[ComponentStatus, ...] = ()
        self._severe = False  # by the action stream, which may be ahead of the other one
        self._rows: Dict[str, Mapping[str, Any]] = {}
        self._beat: Tuple[str, int] = ("", -1)
        self._beat_due_ns = 0

    def asked(self, t_ns: int, number: int, request: Any) -> None:
        """Start ours, or ask it again; it waits for the start-up time itself, the first time."""
        given_s = float(request.startup_time)
        startup_ns = round(min(max(given_s, 0.0), _LONGEST_STARTUP_S) * _S) if isfinite(given_s) else 0
        command = next(self._ids)
        self._calls[command] = number
        self._startup_until_ns = t_ns + startup_ns
        limit_ns = startup_ns + self._reply_limit_ns
        self.outbox.append(RunCheck(id=command, limit_ns=limit_ns, check=self._check, startup_time_ns=startup_ns))

    def replied(self, t_ns: int, reply: Union[Reply, CheckReply]) -> None:
        """Answer by the worst of the components, as its watchdog does."""
        number = self._calls.pop(reply.command_id, None)
        if number is None or not isinstance(reply, CheckReply):
            return
        good = reply.outcome is Outcome.ACCEPTED
        worst = max((self._status(each.code, t_ns) for each in reply.components), default=EntityStatus.NOMINAL)
        info = "" if good and reply.ok else why_not(reply)
        status = worst if good else EntityStatus.UNDEF
        successful = status in (EntityStatus.NOMINAL, EntityStatus.DEFECT)
        fields = {"successful": successful, "status": _all(status, info), "entity_ids": []}
        self.outbox.append(Response(number, fields))

    def _status(self, code: Code, t_ns: int) -> EntityStatus:
        if code is Code.NOMINAL:
            return EntityStatus.NOMINAL
        if code is not Code.NON_CRITICAL:
            return EntityStatus.ERROR
        return EntityStatus.STARTING if t_ns < self._startup_until_ns else EntityStatus.DEFECT

    def told(self, t_ns: int, event: Event) -> None:
        """Take its streams: a turn of its loop is a heartbeat, what changed is a line of the log."""
        if isinstance(event, WatchdogAction):
            self._severe = event.code is not Code.NOMINAL
            beat = (event.publisher, event.loop_counter)
            if beat != self._beat and t_ns >= self._beat_due_ns:
                self._beat_due_ns = t_ns + _BEAT_NS
                self.outbox.append(Publish("heartbeat", {"status": _all(self._worst(t_ns))}))
            self._beat = beat
        elif isinstance(event, WatchdogInfo):
            self._components = event.components
            self.step(t_ns)

    def _worst(self, t_ns: int) -> EntityStatus:
        known = (self._status(each.code, t_ns) for each in self._components)
        return EntityStatus.ERROR if self._severe else max(known, default=EntityStatus.STARTING)

    def step(self, t_ns: int) -> None:
        """Say what has changed; with the end of the start-up time what starts is off."""
        rows = {each.name: self._row(each, t_ns) for each in self._components}
        changed = [row for name, row in rows.items() if not _same(row, self._rows.get(name))]
        self._rows = rows
        if changed:
            self.outbox.append(_log(changed, rows))

    def _row(self, component: ComponentStatus, t_ns: int) -> Mapping[str, Any]:
        entity, kind, name = self._entities.get(component.name, Entity(component.name, 0, component.name))
        status = int(self._status(component.code, t_ns))
        return {"entity": entity, "type": kind, "status": status, "name": name, "info": component.reason}

    @property
    def whole(self) -> Optional[Publish]:
        """The log for somebody who begins to listen now: every entity counts as changed; None: nothing is known yet."""
        return _log(list(self._rows.values()), self._rows) if self._rows else None


def _all(status: EntityStatus, info: str = "") -> Mapping[str, Any]:
    return {"entity": "", "type": 0, "status": int(status), "name": "", "info": info}


def _same(row: Mapping[str, Any], before: Optional[Mapping[str, Any]]) -> bool:
    """Return whether a row says the same; the numbers in its words change all the time."""
    return before is not None and row["status"] == before["status"]


def _log(changes: Sequence[Mapping[str, Any]], rows: Mapping[str, Mapping[str, Any]]) -> Publish:
    return Publish("log", {"data": {"changes": list(changes), "current": list(rows.values())}})


# --- checks -----------------------------------------------------------------------------------------------------------


class ServedCheck(Served):
    """One of our checks as a service of its that says yes or no.

    Args:
        ids: of the requests.
        check: which one.
        limit_ns: of its answer.
    """

    def __init__(self, ids: Iterator[int], check: CheckName, limit_ns: int) -> None:
        super().__init__(ids)
        self._check, self._limit_ns = check, limit_ns
        self._calls: Dict[int, int] = {}

    def asked(self, t_ns: int, number: int, request: Any) -> None:  # noqa: ARG002
        """Ask our check."""
        command = next(self._ids)
        self._calls[command] = number
        self.outbox.append(RunCheck(id=command, limit_ns=self._limit_ns, check=self._check))

    def replied(self, t_ns: int, reply: Union[Reply, CheckReply]) -> None:  # noqa: ARG002
        """Answer, with what failed in words."""
        number = self._calls.pop(reply.command_id, None)
        if number is not None:
            problem = why_not(reply)
            self.outbox.append(Response(number, {"success": not problem, "message": problem}))


class ServedLanding(ServedCheck):
    """Our landing detection as its landing detector: the level becomes one message for each event."""

    def __init__(self, ids: Iterator[int], check: CheckName, limit_ns: int) -> None:
        super().__init__(ids, check, limit_ns)
        self._landed = Landed.UNKNOWN

    def told(self, t_ns: int, event: Event) -> None:  # noqa: ARG002
        """Take the level; a time in which it is unknown is no event."""
        if not isinstance(event, LandedStatus) or event.landed in (Landed.UNKNOWN, self._landed):
            return
        before, self._landed = self._landed, event.landed
        if before is not Landed.UNKNOWN:
            key = "is_takeoff" if event.landed is Landed.AIRBORNE else "is_landed"
            self.outbox.append(Publish(key, {"data": True}))


# --- recorder ---------------------------------------------------------------------------------------------------------


class ServedRecorder(Served):
    """Our recorder as its recorder: it says yes when it records, and when the recording is complete.

    Args:
        ids: of the requests.
        rules: limits.
        begin: what the ids of its sessions begin with.
    """

    def __init__(self, ids: Iterator[int], rules: Rules, begin: str) -> None:
        super().__init__(ids)
        self._limits, self._begin = rules.limits, begin
        self._sessions = 0
        self._session, self._message = "", ""
        self._phase: Optional[RecordingPhase] = None  # until it has said something
        self._calls: Dict[int, Tuple[bool, int]] = {}
        self._waiting: List[Tuple[bool, int, int]] = []  # on or off, the call, until when

    def asked(self, t_ns: int, number: int, request: Any) -> None:  # noqa: ARG002
        """Start a session, or stop the one that is recorded."""
        on, command = bool(request.data), next(self._ids)
        limit_ns = self._limits.command_reply_limit_ns
        if self._phase is None:
            self._say(number, "our recorder says nothing")
        elif on and not all(each[0] for each in (*self._waiting, *self._calls.values())):
            self._say(number, "the recorder is being stopped")
        elif on and self._phase not in _OVER:
            self._say(number, "" if self._phase is _P.RECORDING else f"the recorder is {self._phase.name}")
        elif on:
            self._sessions += 1
            self._session, self._phase, self._message = f"{self._begin}_{self._sessions}", _P.IDLE, ""
            self._calls[command] = (on, number)
            self.outbox.append(StartRecording(id=command, limit_ns=limit_ns, session_id=self._session, mission_id=""))
        elif self._phase in (_P.IDLE, _P.COMPLETE):
            self._say(number, "nothing is being recorded")
        else:
            self._calls[command] = (on, number)
            self.outbox.append(StopRecording(id=command, limit_ns=limit_ns, session_id=self._session))

    def replied(self, t_ns: int, reply: Union[Reply, CheckReply]) -> None:
        """Wait for what was accepted to show in the status."""
        call, problem = self._calls.pop(reply.command_id, None), why_not(reply)
        if call is None:
            return
        on, number = call
        if problem:
            self._say(number, problem)
            return
        limit_ns = self._limits.recording_start_limit_ns if on else self._limits.data_cleanup_limit_ns
        self._waiting.append((on, number, t_ns + limit_ns))
        if not on:
            self._phase = _P.STOPPING  # what it said before is of no worth: COMPLETE or FAILED is said again

    def told(self, t_ns: int, event: Event) -> None:
        """Take its status; after a start of this process it says which session there is."""
        if not isinstance(event, RecordingStatus):
            return
        if not self._session or event.phase not in _OVER:
            self._session = event.session_id
        if event.session_id == self._session:
            self._phase, self._message = event.phase, event.message
            self.step(t_ns)

    def step(self, t_ns: int) -> None:
        """Answer what is done, has failed, or takes too long."""
        for each in list(self._waiting):
            on, number, until_ns = each
            done = self._phase is (_P.RECORDING if on else _P.COMPLETE)
            if done or self._phase is _P.FAILED or t_ns >= until_ns:
                self._waiting.remove(each)
                self._say(number, "" if done else self._message or "the recorder has not done it within its limit")

    def _say(self, number: int, problem: str) -> None:
        self.outbox.append(Response(number, {"success": not problem, "message": problem or self._message}))
