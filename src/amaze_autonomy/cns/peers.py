"""Nodes of the CNS Flight Stack as peers of our engine: what they say becomes our statuses and answers. Pure.

Each peer is asked what our engine asks (`answer`), hears its topics (`hear`), is told how its calls ended (`returned`),
and says in `step` what is to be replied and published. What it wants to send is in its outbox: the shell sends it.

What their nodes do not promise has a limit here, and a word for it: a start call that blocks is made once and never
waited for; a supervisor that does not answer fails its check in time; a recorder that always says yes is believed by
its files.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass, field
from typing import Any, ClassVar, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple, Union

from amaze_autonomy.engine.commands import Request, RunCheck, StartRecording, StopRecording
from amaze_autonomy.engine.events import (
    Check,
    CheckName,
    CheckReply,
    ComponentStatus,
    Event,
    Landed,
    LandedStatus,
    Mission,
    Outcome,
    PlatformRecording,
    RecordingPhase,
    RecordingStatus,
    Reply,
    Verdict,
    WatchdogAction,
    WatchdogInfo,
)
from amaze_autonomy.engine.rules import Code, Rules, Severity

from ..interface.tables import Service
from .tables import UNLISTED, EntityStatus, code_of, component_of

_S = 1_000_000_000
GONE_NS = 6 * _S // 10  # without a publisher: one connection that breaks is made again before that
_REPLY_EARLY = 0.9  # of the engine's limit: our word comes before its own "did not answer"
_UNKNOWN_ENTITY = "cns_watchdog"
_UNEXPLAINED_BEATS = 2  # that say ERROR without a log between them: the log of that is not under way any more
_QUIET_NS = 3 * _S  # without growth after the stop: nothing is written any more


class Call(NamedTuple):
    """A service to be asked: its key in `tables.SERVICES`, fields of the request, and how long it may take."""

    key: str
    fields: Mapping[str, Any]
    limit_ns: int


class Publish(NamedTuple):
    """A message to be sent: its key in `tables.TOPICS`, and its fields."""

    key: str
    fields: Mapping[str, Any]


def replied(command: Request, t_ns: int, message: str = "", rows: Sequence[Check] = (), **more: Any) -> Event:
    """Return the reply to a command: good unless a message or a row says otherwise."""
    if isinstance(command, RunCheck):
        good = not message and all(row.passed for row in rows)
        fixed: Dict[str, Any] = {"checks": tuple(rows), "message": message, **more}
        outcome = Outcome.ACCEPTED
        return CheckReply(t_ns=t_ns, command_id=command.id, check=command.check, outcome=outcome, ok=good, **fixed)
    outcome = Outcome.REFUSED if message else Outcome.ACCEPTED
    return Reply(t_ns=t_ns, command_id=command.id, outcome=outcome, message=message)


@dataclass
class Rhythm:
    """When a status is due: at its rate, and at once on a change."""

    rate_hz: float
    due_ns: int = 0
    key: object = None

    def due(self, t_ns: int, key: object) -> bool:
        """Return whether to say it now."""
        if t_ns < self.due_ns and key == self.key:
            return False
        self.key, self.due_ns = key, t_ns + round(_S / self.rate_hz)
        return True


class Peer(abc.ABC):
    """Base of the peers; `makes` is the service of the check that it makes."""

    makes: ClassVar[str] = ""

    def __init__(self) -> None:
        self.outbox: List[Union[Call, Publish]] = []

    def carry_out(self, t_ns: int, service: Service, command: Request) -> Optional[Event]:
        """Return the reply to a command, None: it follows in `step`; of a check that it does not make, say so."""
        if service.check is None or service.name == self.makes:
            return self.answer(t_ns, command)
        verdict = Verdict.WARN if service.optional else Verdict.UNKNOWN
        row = Check(service.check.value.replace("_", " "), verdict, advice="the CNS Flight Stack has no such check")
        return replied(command, t_ns, "" if service.optional else row.advice, [row])

    @abc.abstractmethod
    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Return the reply to a command; None: it follows in `step`."""

    def hear(self, t_ns: int, key: str, message: Any) -> None:
        """Take a message of one of its topics."""

    def returned(self, t_ns: int, key: str, response: Any, problem: str) -> None:
        """Take the end of a call: its response, or what was wrong."""

    @abc.abstractmethod
    def step(self, t_ns: int) -> List[Event]:
        """Return statuses that are due and replies that have become possible."""

    def kept(self) -> Dict[str, Any]:
        """Return what a process that is started again in flight must know, as JSON has it; empty: nothing."""
        return {}

    def restore(self, t_ns: int, kept: Mapping[str, Any]) -> None:
        """Go on with what was kept.

        Raises:
            KeyError, TypeError, ValueError: Another version has kept it.
        """


# --- watchdog ---------------------------------------------------------------------------------------------------------


class Watchdog(Peer):
    """Its watchdog: started once, heard by its heartbeat, known by its log.

    They are two topics: of what it says at once on both, either may be heard first. So a heartbeat of ERROR of which no
    row tells counts from the second one in a row.

    Restarts of components are its own business and it says nothing of them: what a flight holds for comes back, or the
    wait ends.

    Args:
        rules: severities of the components.
        missions: for severities of their own.
        rate_hz: of our action stream.
    """

    makes = "watchdog/start"

    def __init__(self, rules: Rules, missions: Sequence[Mission], rate_hz: float) -> None:
        super().__init__()
        self._rules, self._limits = rules, rules.limits
        self._missions = {mission.id: mission for mission in missions}
        self._own: Dict[str, Severity] = {}
        self._tolerated: Tuple[str, ...] = ()
        self._calling = False
        self._problem = ""
        self._beats, self._worst, self._beat_ns = 0, int(EntityStatus.UNDEF), 0
        self._unexplained = 0  # heartbeats in a row, without a log between them, that say ERROR where no row does
        self._rows: Dict[Tuple[str, int, str], Tuple[int, str]] = {}
        self._sequence = self._informed = 0
        self._latest = ""
        self._said: Dict[str, ComponentStatus] = {}
        self._rhythm = Rhythm(rate_hz)
        self._mission_id = ""
        self._missed = False  # changes, while this process was not there

    def kept(self) -> Dict[str, Any]:
        """Return the rows, and how far its heartbeat and our streams have come."""
        if not self._beats:
            return {}
        rows = [[*row, *said] for row, said in self._rows.items()]
        counts = [self._beats, self._worst, self._beat_ns, self._unexplained, self._sequence, self._informed]
        return {"mission": self._mission_id, "counts": counts, "rows": rows}

    def restore(self, t_ns: int, kept: Mapping[str, Any]) -> None:  # noqa: ARG002
        """Go on; its start is not called again while it beats."""
        self._take_mission(str(kept["mission"]))
        rows = {(str(row[0]), int(row[1]), str(row[2])): (int(row[3]), str(row[4])) for row in kept["rows"]}
        beats, worst, beat_ns, unexplained, sequence, informed = map(int, kept["counts"])
        self._beats, self._worst, self._beat_ns, self._unexplained = beats, worst, beat_ns, unexplained
        self._sequence, self._informed = sequence, informed
        self._rows, self._missed = rows, True

    def _take_mission(self, mission_id: str) -> None:
        mission = self._missions.get(mission_id, Mission(id="none"))
        self._mission_id, self._own, self._tolerated = mission_id, dict(mission.severities), mission.tolerated

    def hear(self, t_ns: int, key: str, message: Any) -> None:
        """Take a heartbeat or a change."""
        if key == "heartbeat":
            self._beats, self._worst, self._beat_ns = self._beats + 1, int(message.status.status), t_ns
            if self._missed and self._worst == EntityStatus.NOMINAL:  # whatever has failed is back
                self._rows = {row: (self._worst, info) for row, (_, info) in self._rows.items()}
            self._missed = False
            self._unexplained = self._unexplained + 1 if self._beats_without_a_row() else 0
            return
        self._unexplained = 0
        if message.data.current:
            self._rows.clear()
        for each in (*message.data.current, *message.data.changes):
            self._rows[each.entity, int(each.type), each.name] = (int(each.status), each.info)
            self._latest = component_of(each.entity)

    def beat_on(self, t_ns: int) -> None:
        """Have its last heartbeat count once more: in a recording, for a stream that is faster than it."""
        self._beats, self._beat_ns = self._beats + 1, t_ns

    def _beats_without_a_row(self) -> bool:
        """Return whether its last heartbeat says ERROR and no row does."""
        rows = self._rows.values()
        return self._worst == EntityStatus.ERROR and not any(status == EntityStatus.ERROR for status, _ in rows)

    def returned(self, t_ns: int, key: str, response: Any, problem: str) -> None:  # noqa: ARG002
        """Take the end of the start call; it is made again only where nothing beats: none can have been started."""
        self._calling, self._problem = False, problem

    def components(self) -> Tuple[ComponentStatus, ...]:
        """Return what is known of each component: the worst of its entity's topic, node and driver."""
        found: Dict[str, ComponentStatus] = {}
        for (entity, _, name), (status, info) in self._rows.items():
            component = component_of(entity)
            code = code_of(status, self._severity(component))
            if component not in found or code > found[component].code:
                reason = "" if code is Code.NOMINAL else f"{name}: {info or _word(status)}"
                found[component] = ComponentStatus(component, code, reason=reason)
        if self._unexplained >= _UNEXPLAINED_BEATS:  # its log was missed: it is not nominal, whatever it is
            reason = "its watchdog says ERROR and its log was missed"
            found[_UNKNOWN_ENTITY] = ComponentStatus(_UNKNOWN_ENTITY, code_of(self._worst, UNLISTED), reason=reason)
        return tuple(found.values())

    def _severity(self, component: str) -> Severity:
        known = {rule.name: rule.severity for rule in self._rules.components}
        return self._own.get(component, known.get(component, UNLISTED))

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Start it when it does not beat; then answer by what it says, at once."""
        assert isinstance(command, RunCheck)  # noqa: S101 - the row of the service says so
        self._take_mission(command.mission_id)
        silent = not self._beats or t_ns - self._beat_ns > self._limits.watchdog_heartbeat_limit_ns
        if silent and not self._calling:
            self._calling = True
            startup_ns = command.startup_time_ns or self._limits.watchdog_startup_time_ns
            self.outbox.append(Call("watchdog_start", {"startup_time": startup_ns / _S}, startup_ns + 20 * _S))
        rows = self._check_rows(t_ns, command, silent=silent)
        bad = [row for row in rows if not row.passed]
        return replied(
            command,
            t_ns,
            bad[0].advice if bad else "",
            rows,
            fixable=bool(bad) and all(row.heals for row in bad),
            being_fixed=self._calling,
            components=self.components(),
        )

    def _check_rows(self, t_ns: int, command: RunCheck, *, silent: bool) -> List[Check]:
        age_s = (t_ns - self._beat_ns) / _S if self._beats else None
        limit_s = self._limits.watchdog_heartbeat_limit_ns / _S
        if silent:
            why = self._problem or ("its start call is under way" if self._calling else "its watchdog does not beat")
            return [Check("heartbeat", Verdict.UNKNOWN, age_s, limit_s, "s", advice=why, heals=True)]
        rows = [Check("heartbeat", Verdict.PASS, age_s, limit_s, "s")]
        if self._calling:
            rows.append(Check("start", Verdict.UNKNOWN, advice="its start call is under way", heals=True))
            return rows
        known = {each.name: each for each in self.components()}
        needed = command.required or tuple(rule.name for rule in self._rules.components)
        rows += [self._row(name, known.get(name)) for name in needed]
        if _UNKNOWN_ENTITY in known:
            rows.append(self._row(_UNKNOWN_ENTITY, known[_UNKNOWN_ENTITY]))
        elif self._beats_without_a_row():
            why = "its watchdog says ERROR and its log does not: one of them is older"
            rows.append(Check(_UNKNOWN_ENTITY, Verdict.UNKNOWN, advice=why, heals=True))
        return rows

    def _row(self, name: str, status: Optional[ComponentStatus]) -> Check:
        if status is None and not self._rows and self._worst == EntityStatus.NOMINAL:
            return Check(name, Verdict.WARN, advice="its log was missed; all is nominal by its heartbeat")
        if status is None:
            return Check(name, Verdict.UNKNOWN, advice=f"{name} is no entity of its watchdog: add it there, or drop it")
        good = status.code is Code.NOMINAL
        starting = not good and status.code <= Code.NON_CRITICAL
        tolerated = starting and name in self._tolerated
        verdict = Verdict.PASS if good else Verdict.WARN if tolerated else Verdict.FAIL
        return Check(name, verdict, float(status.code), 1.0, advice=status.reason, heals=starting)

    def step(self, t_ns: int) -> List[Event]:
        """Return the action stream while it beats, and the info stream on a change."""
        if not self._beats:
            return []
        now = {each.name: each for each in self.components()}
        changed = tuple(name for name in {**self._said, **now} if self._said.get(name) != now.get(name))
        events: List[Event] = []
        severe = tuple(each for each in now.values() if each.code >= Code.INCONVENIENT)
        if self._rhythm.due(t_ns, (severe, self._beats)):
            self._sequence += 1
            code = max((each.code for each in severe), default=Code.NOMINAL)
            events.append(
                WatchdogAction(
                    t_ns=t_ns,
                    sequence=self._sequence,
                    loop_counter=self._beats,
                    code=code,
                    latest_component=self._latest,
                    components=severe,
                )
            )
        if changed:
            self._informed, self._said = self._informed + 1, now
            events.append(
                WatchdogInfo(t_ns=t_ns, sequence=self._informed, changed=changed, components=tuple(now.values()))
            )
        return events


def _word(status: int) -> str:
    return EntityStatus(status).name if status in list(EntityStatus) else f"status {status}"


# --- checks -----------------------------------------------------------------------------------------------------------


@dataclass
class _OneCall:
    """A check by one call at a time: who asks again while it is open waits for the same answer.

    Args:
        key: of the service.
        row: name of the row.
        limit_ns: of a call; a node that never answers is asked anew after it.
        reply_ns: in which the engine wants an answer.
        silent: what it means when there is none.
    """

    key: str
    row: str
    limit_ns: int
    reply_ns: int
    silent: str
    open: bool = False
    waiting: List[Tuple[RunCheck, int]] = field(default_factory=list)

    def ask(self, t_ns: int, command: Request, outbox: List[Union[Call, Publish]]) -> None:
        assert isinstance(command, RunCheck)  # noqa: S101 - the row of the service says so
        self.waiting.append((command, t_ns + round(self.reply_ns * _REPLY_EARLY)))
        if not self.open:
            self.open = True
            outbox.append(Call(self.key, {}, self.limit_ns))

    def end(self, t_ns: int, response: Any, problem: str) -> List[Event]:
        self.open = False
        if problem:
            row = Check(self.row, Verdict.UNKNOWN, advice=problem)
        elif response.success:
            row = Check(self.row, Verdict.PASS)
        else:
            row = Check(self.row, Verdict.FAIL, advice=response.message or f"its {self.row} says no")
        waiting, self.waiting = self.waiting, []
        return [replied(command, t_ns, row.advice, (row,)) for command, _ in waiting]

    def overdue(self, t_ns: int) -> List[Event]:
        late = [command for command, until_ns in self.waiting if t_ns >= until_ns]
        self.waiting = [each for each in self.waiting if t_ns < each[1]]
        row = Check(self.row, Verdict.UNKNOWN, self.reply_ns * _REPLY_EARLY / _S, unit="s", advice=self.silent)
        return [replied(command, t_ns, self.silent, (row,)) for command in late]


class LandingDetection(Peer):
    """Its landing detector: one message for each event becomes a level, which is known after its check alone.

    Args:
        rules: limits of the engine.
        rate_hz: of our status.
    """

    makes = "landing_detection/check"

    def __init__(self, rules: Rules, rate_hz: float) -> None:
        super().__init__()
        reply_ns = rules.reply_limit_ns(CheckName.ON_GROUND.value)
        silent = "its landing detector does not answer"
        self._call = _OneCall("takeoff_check", "landing detector", 2 * reply_ns, reply_ns, silent)
        self._landed, self._reason = Landed.UNKNOWN, "its landing detector has said nothing yet"
        self._ended: List[Event] = []
        self._rhythm = Rhythm(rate_hz)
        self._gone_ns: Optional[int] = None  # when it counts as gone unless it is there again
        self.alive = True

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Ask its detector whether it may take off; that arms the detector."""
        self._call.ask(t_ns, command, self.outbox)
        return None

    def returned(self, t_ns: int, key: str, response: Any, problem: str) -> None:  # noqa: ARG002
        """Take its answer: yes says that it stands on the ground, flat."""
        if not problem and response.success:
            self._landed, self._reason = Landed.ON_GROUND, "its detector was armed on the ground"
        self._ended += self._call.end(t_ns, response, problem)

    def hear(self, t_ns: int, key: str, message: Any) -> None:  # noqa: ARG002
        """Take an event; only a true one is one."""
        if message.data:
            landed = key == "is_landed"
            self._landed = Landed.ON_GROUND if landed else Landed.AIRBORNE
            self._reason = "its detector said landed" if landed else "its detector said takeoff"

    def step(self, t_ns: int) -> List[Event]:
        """Return replies, and the level; unknown while nobody is there, and then until there is an event or a check."""
        ended, self._ended = self._ended, []
        ended += self._call.overdue(t_ns)
        if self.alive:
            self._gone_ns = t_ns + GONE_NS
        elif self._gone_ns is not None and t_ns >= self._gone_ns:  # who comes may be another one
            self._landed, self._reason = Landed.UNKNOWN, "its landing detector was away: unknown until its next event"
        landed = self._landed if self.alive else Landed.UNKNOWN
        reason = self._reason if self.alive else "its landing detector is not there"
        if self._rhythm.due(t_ns, (landed, reason)):
            ended.append(LandedStatus(t_ns=t_ns, landed=landed, reason=reason))
        return ended


class StateEstimation(Peer):
    """Its estimator supervisor: it answers after its window, and never when its topic is silent.

    Args:
        rules: limits of the engine; `checks.reply_limits_s.state_estimation` must be longer than its window.
    """

    makes = "state_estimation/check"

    def __init__(self, rules: Rules) -> None:
        super().__init__()
        reply_ns = rules.reply_limit_ns(CheckName.STATE_ESTIMATION.value)
        silent = (
            "its estimator supervisor does not answer: its estimate is silent, or checks.reply_limits_s has no "
            "state_estimation above its window"
        )
        self._call = _OneCall("supervision", "estimator supervisor", 2 * reply_ns, reply_ns, silent)
        self._ended: List[Event] = []

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Ask its supervisor."""
        self._call.ask(t_ns, command, self.outbox)
        return None

    def returned(self, t_ns: int, key: str, response: Any, problem: str) -> None:  # noqa: ARG002
        """Take its answer."""
        self._ended += self._call.end(t_ns, response, problem)

    def step(self, t_ns: int) -> List[Event]:
        """Return replies."""
        ended, self._ended = self._ended, []
        return [*ended, *self._call.overdue(t_ns)]


# --- recorder ---------------------------------------------------------------------------------------------------------


class Folder(NamedTuple):
    """What lies in a folder of recordings: bytes of all files, and how many of them are still being written."""

    written_bytes: int
    open_files: int


class Recorder(Peer):
    """Its recorder, which says yes whatever happened: believed by the files that grow, on each computer.

    Args:
        folders: where each platform records, by its name; at least one.
        growth_limit_ns: files that have not grown for so long are not being written.
        stop_limit_ns: its stop call runs its store script, and may take so long.
        rate_hz: of our status.
    """

    def __init__(self, folders: Mapping[str, str], growth_limit_ns: int, stop_limit_ns: int, rate_hz: float) -> None:
        super().__init__()
        self._folders, self._growth_limit_ns, self._stop_limit_ns = dict(folders), growth_limit_ns, stop_limit_ns
        self._phase, self._session, self._message = RecordingPhase.IDLE, "", ""
        self._seen: Dict[str, Folder] = {}
        self._before: Dict[str, int] = {}
        self._grew_ns: Dict[str, int] = {}
        self._recorded: Set[str] = set()  # platforms whose files have grown since the start
        self._asked: List[Request] = []
        self._ended: List[Event] = []
        self._since_ns = 0
        self._calling = False
        self._rhythm = Rhythm(rate_hz)

    def look(self, t_ns: int, platform: str, folder: Optional[Folder]) -> None:
        """Take what lies in a folder now; None: it cannot be seen."""
        if folder is None:
            return
        before = self._seen.get(platform)
        if before is not None and folder.written_bytes > before.written_bytes:
            self._grew_ns[platform] = t_ns
            self._recorded.add(platform)
        self._seen[platform] = folder

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Start or stop it; its yes is the answer, its files are the proof."""
        if isinstance(command, StartRecording):
            unseen = [name for name in self._folders if name not in self._seen]
            if unseen:
                places = ", ".join(f"{name}: {self._folders[name]}" for name in unseen)
                return replied(command, t_ns, f"the folder of the recordings cannot be seen ({places})")
            self._session, self._message = command.session_id, ""
            self._before = {name: folder.written_bytes for name, folder in self._seen.items()}
            self._grew_ns, self._recorded = {}, set()
            self._enter(t_ns, RecordingPhase.STARTING)
        elif not isinstance(command, StopRecording) or command.session_id != self._session or not self._session:
            return replied(command, t_ns, "this session is not recorded here")
        elif self._phase is RecordingPhase.COMPLETE:
            return replied(command, t_ns)
        else:
            self._message = ""
            self._enter(t_ns, RecordingPhase.STOPPING)
            self._send(on=False)
            return replied(command, t_ns)  # its call lasts as long as its store script
        self._asked.append(command)
        self._send(on=True)
        return None

    def kept(self) -> Dict[str, Any]:
        """Return what is recorded, and what lay in the folders before."""
        if not self._session:
            return {}
        return {
            "session": self._session,
            "phase": [self._phase.name, self._message],
            "before": self._before,
            "recorded": sorted(self._recorded),
        }

    def restore(self, t_ns: int, kept: Mapping[str, Any]) -> None:
        """Go on; how its call ended is not known any more: what it writes is."""
        name, message = kept["phase"]
        phase, before = RecordingPhase[name], {str(each): int(size) for each, size in kept["before"].items()}
        self._recorded = set(map(str, kept["recorded"]))
        self._session, self._before, self._message = str(kept["session"]), before, str(message)
        self._enter(t_ns, RecordingPhase.VERIFYING if phase is RecordingPhase.STOPPING else phase)
        if phase is RecordingPhase.RECORDING:  # it was proven; whether it still is shows within its limit
            self._grew_ns = dict.fromkeys(before, t_ns)

    def _send(self, *, on: bool) -> None:
        self._calling = True
        self.outbox.append(Call("record", {"data": on}, self._growth_limit_ns if on else self._stop_limit_ns))

    def _enter(self, t_ns: int, phase: RecordingPhase, message: str = "") -> None:
        self._phase, self._since_ns, self._message = phase, t_ns, message or self._message

    def returned(self, t_ns: int, key: str, response: Any, problem: str) -> None:  # noqa: ARG002
        """Take the end of a call; that it says yes proves nothing."""
        self._calling = False
        why = problem or ("" if response.success else response.message or "its recorder says no")
        asked, self._asked = self._asked, []
        self._ended += [replied(command, t_ns, why) for command in asked]
        if why:
            self._enter(t_ns, RecordingPhase.FAILED, f"its recorder: {why}")
        elif self._phase is RecordingPhase.STOPPING:
            self._enter(t_ns, RecordingPhase.VERIFYING)

    def _growing(self, t_ns: int, platform: str) -> bool:
        grew_ns = self._grew_ns.get(platform)
        return grew_ns is not None and t_ns - grew_ns <= self._growth_limit_ns

    def _go_on(self, t_ns: int) -> None:
        if self._phase is RecordingPhase.STARTING and not self._calling:
            if all(self._growing(t_ns, name) for name in self._folders):
                self._enter(t_ns, RecordingPhase.RECORDING)
        elif self._phase is RecordingPhase.VERIFYING and t_ns - self._since_ns >= _QUIET_NS:
            problem = self._incomplete(t_ns)
            self._enter(t_ns, RecordingPhase.FAILED if problem else RecordingPhase.COMPLETE, problem)

    def _incomplete(self, t_ns: int) -> str:
        """Return what is wrong with the files after the stop; empty when nothing is."""
        for name, place in self._folders.items():
            folder = self._seen.get(name)
            if folder is None:
                return f"the folder on {name} cannot be seen ({place})"
            if folder.written_bytes <= self._before.get(name, 0) and name in self._recorded:
                return f"recorded on {name}, then moved away by its store script: not verified here ({place})"
            if folder.written_bytes <= self._before.get(name, 0):
                return f"nothing was recorded on {name} ({place})"
            if folder.open_files:
                return f"{folder.open_files} files on {name} are not closed ({place})"
            if t_ns - self._grew_ns.get(name, 0) < _QUIET_NS:
                return f"files on {name} still grow after the stop ({place})"
        return ""

    def step(self, t_ns: int) -> List[Event]:
        """Return replies and the status."""
        self._go_on(t_ns)
        ended, self._ended = self._ended, []
        growing = {name: self._growing(t_ns, name) for name in self._folders}
        if self._rhythm.due(t_ns, (self._phase, self._message, tuple(growing.values()))):
            ended.append(
                RecordingStatus(
                    t_ns=t_ns,
                    session_id=self._session,
                    phase=self._phase,
                    platforms=tuple(self._platform(name, growing=growing[name]) for name in self._folders),
                    location=", ".join(self._folders.values()) if self._phase is not RecordingPhase.IDLE else "",
                    message=self._message,
                )
            )
        return ended

    def _platform(self, name: str, *, growing: bool) -> PlatformRecording:
        folder = self._seen.get(name)
        written = 0 if folder is None else max(0, folder.written_bytes - self._before.get(name, 0))
        message = "" if folder is not None else "its folder cannot be seen"
        return PlatformRecording(name, growing, written, location=self._folders[name], message=message)
