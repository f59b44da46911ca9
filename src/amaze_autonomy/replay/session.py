"""One replay: the recording's samples, the script's answers and the engine's deadlines, in virtual time.

Time is the recording's. Everything that happens is one of: a message of the recording, a task of the agenda (a status
that is due, an answer, the user), a deadline of the engine. They happen in the order (time, rank, position), so that
the journal of a recording is the same whenever and wherever it is made.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from itertools import zip_longest
from typing import Any, Callable, Dict, FrozenSet, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.bags.columns import WHOLE
from amaze_autonomy.engine.commands import (
    Command,
    Decision,
    Level,
    MissionAction,
    MissionCommand,
    Notify,
)
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    EngineStarted,
    Event,
    MissionSelected,
    Tick,
    UserCommand,
    UserRequest,
)
from amaze_autonomy.engine.state import EngineState, State
from amaze_autonomy.engine.timers import next_deadline

from ..engine.events import Check, CheckName, Mission
from ..journal.codec import to_plain
from ..journal.journal import encode_decision, encode_event, encode_header, make_header
from .agenda import Agenda, Rank
from .beginning import Beginning, Flight, Lead, armings, beginning_of, lead_of, selected_ns
from .changed_keys import Change, ChangedKeys, Unread, recorded_facts
from .errors import ReplayError
from .faults.story import Story
from .monitors.monitors import Light, Monitors
from .monitors.upsets import upsets_of
from .peers.recorded_nodes import Disagreement
from .peers.script import User
from .peers.world import World
from .plan import Plan, recorded_words
from .recordings import fields
from .recordings.journals import FlightLog, selection_of
from .recordings.sources import Recordings, Sample
from .recordings.statuses import FLAT
from .timeline import Line, LineKind, Source, decision_text, joined, marked

_S = 1_000_000_000
_STEP_NS = 1_000_000
_NEVER_NS = 1 << 62
_NOTICE = 5  # of the severities of MAVLink: 4 is a warning, below it are errors
_SCRIPTED = ("armed", "landed", "height", "mode", "position", "battery", "planner", "recorder")
_WARM_UP_NS = 3 * _S  # what is played fills the windows of the checks before anybody asks
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Outcome:
    """What came of a replay.

    Args:
        journal: its lines.
        timeline: its lines.
        state: of the engine at the end.
        start_ns: time of the recording's first message.
        end_ns: of its last.
        counterfactual_ns: after it the recorded vehicle is another one: the time of the first command that it did not
            get, or of the first decision that is not that of the flight; None: there is none.
        missed: that command; None: it was a decision.
        checks: the last answer to each check, and where it came from.
        decisions: that were made.
        mission: that was flown last; else the one that was to be.
        flown: those that were made in flight, where its journal is in the recording; None: it is not.
        parting: the first decision that is not one of those; None: all are.
        flown_in_part: lines of the flight's journal are lost, `flown` ends before the first of them.
        compared: nodes of the recorded flight whose judgement was made anew and compared.
        disagreements: where what they said is not what the recorded sensors say.
        unread: changed keys of the configuration that nothing looked at.
        beginning: of the recording: on the ground, or in the air.
        facts: that the recording tells (`changed_keys.recorded_facts`).
        scripted: what of the vehicle and its nodes the recording never tells; required components among it.
        unseen: those components: the configuration requires them, and nothing in the recording says a word of them.
            Each with the topics that the recording lacks; none: it lacks all of its topics.
        flights: armings that it tells of.
    """

    journal: Tuple[str, ...]
    timeline: Tuple[Line, ...]
    state: EngineState
    start_ns: int
    end_ns: int
    counterfactual_ns: Optional[int]
    missed: Optional[MissionAction]
    checks: Dict[CheckName, Tuple[Source, Tuple[Check, ...]]]
    decisions: Tuple[Decision, ...]
    mission: Mission
    flown: Optional[Tuple[Decision, ...]] = None
    parting: Optional[Parting] = None
    flown_in_part: bool = False
    compared: Tuple[str, ...] = ()
    disagreements: Tuple[Disagreement, ...] = ()
    unread: Tuple[Unread, ...] = ()
    beginning: Optional[Beginning] = None
    facts: FrozenSet[str] = frozenset()
    scripted: Tuple[str, ...] = ()
    flights: Tuple[Flight, ...] = ()
    unseen: Mapping[str, Tuple[str, ...]] = field(default_factory=dict)


class Session:
    """A replay in the making.

    Args:
        plan: what is decided by and with.
        recordings: open.
        story: what happens besides: faults of peers and of the engine, requests of the user.
        changes: keys of the configuration to be followed: were they looked at?
        beginning: of the recording, without any fault in it; None: as the recording has it.
        asked_ns: when the script selects the mission, without any fault in the recording; None: as that has it.
    """

    def __init__(
        self,
        plan: Plan,
        recordings: Recordings,
        story: Optional[Story] = None,
        changes: Sequence[Change] = (),
        beginning: Optional[Beginning] = None,
        asked_ns: Optional[int] = None,
    ) -> None:
        self._plan, self._recordings = plan, recordings
        self._story = Story() if story is None else story
        self._state = EngineState()
        self._agenda = Agenda()
        self._journal: List[str] = []
        self._lines: List[Line] = []
        self._decisions: List[Decision] = []
        self._statuses: List[AutopilotStatus] = []
        self._request_id = 0
        self._deadline_ns: Optional[int] = None  # or, while `_deadline_open`, a time that it is not before
        self._user = User(plan.topic_map.script)
        self._source = Source.SCRIPT
        self._monitors = Monitors(plan, _periods_ns(recordings))
        self._riding: Tuple[int, ...] = ()
        self._names: Dict[int, str] = {}
        self._script = plan.topic_map.script
        log = self._read_log()
        as_flown = log is not None and log.configuration_hash == plan.configuration_hash
        self._keys = ChangedKeys(plan, () if as_flown else changes)  # what flew by them is not changed by them
        self._rules = self._keys.rules
        led = log is not None and log.leads and not recordings.from_ns
        self._at_first = Beginning(recordings.start_ns, airborne=False) if led else beginning
        if self._at_first is None:
            self._at_first = beginning_of(plan, recordings)
        self._log, self._asked_later = self._of_part(log, airborne=self._at_first.airborne)
        if log is not None:
            self._tell_lost(log)
        self._lead: Optional[Lead] = lead_of(plan, self._at_first, _WARM_UP_NS) if self._at_first.airborne else None
        if self._log or self._lead:
            asked_ns = recordings.start_ns
        self._asked_ns = selected_ns(plan, recordings) if asked_ns is None else asked_ns
        self._begin_ns = self._beginning()
        self._world = World(
            plan, self._monitors, self._agenda, self._feed, self._say, recordings, self._story, self._lead
        )
        self._takers = self._made_takers()

    def run(self, progress: Optional[Progress] = None) -> Outcome:
        """Replay all of it.

        Raises:
            ReplayError: The map does not fit the recording.
        """
        self._begin()
        lights, values_of, due_ns = self._lights(), self._recordings.values, 0
        samples = self._recordings.ordered(rank for rank in range(len(lights)) if rank not in self._riding)
        total = len(samples)
        for number, sample in enumerate(samples):
            t_ns, rank = sample[0], sample[1]
            light = lights[rank]
            if t_ns >= due_ns:
                self._until(t_ns, rank)
                due_ns = 0 if light is None else self._due_ns()
            self._monitors.now = t_ns, rank
            values = values_of(sample) if light is not None and light.readers else None
            if light is None or (values is None and light.readers):
                self._take(sample)
                due_ns = 0
            else:
                for count in light.counters:
                    count(t_ns)
                for take, part in light.readers:
                    take(t_ns, values[part])  # type: ignore[index]
            if progress is not None and number % 2048 == 0:
                progress(number, total)
        self._until(self._recordings.end_ns, Rank.TICK + 1)
        if progress is not None:
            progress(total, total)
        return self._outcome()

    def looks_at(self, topic: str) -> Optional[Tuple[str, ...]]:
        """Return the fields of a topic that something looks at; "" is all of them, None not even when it comes."""
        paths, status = self._monitors.paths(topic), self._world.status_paths(topic)
        return None if paths is None and status is None else (*(paths or ()), *(status or ()))

    def _begin(self) -> None:
        start_ns = self._recordings.start_ns
        self._journal.append(encode_header(self._header()))
        self._world.begin(self._begin_ns, plays=self._plays())
        self._note(start_ns, f"the recording begins{self._begins_words()}")
        if self._lead is not None:
            self._agenda.at(start_ns, Rank.TICK, self._check_lead)
        for topic in self._recordings.missing:
            self._note(start_ns, f"{topic} is {'muted' if topic in self._recordings.muted else 'not in the recording'}")
        self._note_texts()
        source = Source.SCRIPT if self._log is None else Source.LOG
        self._feed(EngineStarted(t_ns=self._begin_ns, label=self._label()), source)
        for event in self._story.events():
            rank = Rank.START if isinstance(event, EngineStarted) else Rank.USER
            self._agenda.at(event.t_ns, rank, self._told(event))
        for event in self._asked_later if self._log is None else self._log.events:
            self._agenda.at(event.t_ns, Rank.LOG, self._logged(event))
        if self._log is None:
            asked_ns = self._asked_ns if self._lead is None else self._lead.begin_ns + _WARM_UP_NS
            self._agenda.at(max(self._begin_ns + _STEP_NS, asked_ns), Rank.USER, self._select)

    def _begins_words(self) -> str:
        first = self._at_first
        if first is None or not (first.airborne or first.armed):
            return ""
        if not first.airborne:
            return " on the ground, with motors that are armed already"
        at = "" if first.height_m is None else f" at {first.height_m:.1f} m"
        return f" in the air{at} ({first.reason}): it is judged from here, what led to it is scripted"

    def _check_lead(self, t_ns: int) -> None:
        """Say when the script could not lead up to a recording that begins in the air."""
        if not self._state.flight.active:
            words = f"contradiction: the recording begins in the air, the script has come to {self._state.state.value}"
            self._lines.append(Line(t_ns, Source.SCRIPT, LineKind.NOTE, words, 2))

    def _told(self, event: Event) -> Callable[[int], None]:
        return lambda _: self._feed(event, Source.SCRIPT)

    def _logged(self, event: Event) -> Callable[[int], None]:
        return lambda _: self._feed(event, Source.LOG)

    def _beginning(self) -> int:
        """Return when the replay begins: before the recording where the script must have played by then."""
        start_ns = self._recordings.start_ns
        if self._lead is not None:
            return self._not_before_0(self._lead.begin_ns - _STEP_NS)
        first_ns = min(start_ns, self._asked_ns)
        if self._log is not None:
            first_ns = min(start_ns, self._log.events[0].t_ns)
        return self._not_before_0(first_ns - (_WARM_UP_NS if self._plays() else _STEP_NS))

    def _not_before_0(self, t_ns: int) -> int:
        """Refuse a lead that would have to begin before time 0: cut short, it would lead to other decisions."""
        if t_ns < 0:
            short_s, begins_s = -t_ns / _S, self._recordings.start_ns / _S
            raise ReplayError(
                f"the recording begins at {begins_s:.3f} s of its clock, and the script must begin {short_s:.3f} s "
                "before time 0 to lead up to it: read it with replayed=True"
            )
        return t_ns

    def _plays(self) -> bool:
        """Return True when the script plays topics before their recording begins."""
        return (
            self._log is not None
            or self._lead is not None
            or self._asked_ns < self._recordings.start_ns
            or self._script.sensors_until_ns > 0
        )

    def _of_part(self, log: Optional[FlightLog], *, airborne: bool) -> Tuple[Optional[FlightLog], Tuple[Event, ...]]:
        """Return the log that leads the replay, and what it asks beside the script, where that leads it.

        In a part of a recording nothing counts that was asked for the flight before it. What had taken off before the
        part is led up to by the script, as in any recording; decisions are compared with those of a whole log only.
        """
        start_ns = self._recordings.start_ns
        if log is None or not self._recordings.from_ns:
            return (log if log is not None and log.leads else None), ()
        led_ns = None if airborne else selection_of(log, start_ns)
        if led_ns is None:
            return None, tuple(event for event in log.events if event.t_ns >= start_ns)
        events = tuple(event for event in log.events if event.t_ns >= led_ns)
        whole = all(decision.t_ns >= led_ns for decision in log.decisions)
        return replace(log, events=events, decisions=log.decisions if whole else ()), ()

    def _read_log(self) -> Optional[FlightLog]:
        log = self._recordings.log(self._plan.topic_map.statuses.get("journal", ""))
        return log if log is not None and (log.events or log.lost) else None

    def _tell_lost(self, log: FlightLog) -> None:
        """Say which lines of the flight's journal are lost, of a part of a recording those that matter to it."""
        start_ns, end_ns = self._recordings.start_ns, self._recordings.end_ns
        topic = self._plan.topic_map.statuses["journal"]
        led = self._log is not None
        within = [lost for lost in log.lost if led or not lost.before_all]
        for lost in within:
            if lost.from_ns <= end_ns and (led or lost.to_ns >= start_ns):
                from_s, to_s = ((t_ns - start_ns) / _S for t_ns in (lost.from_ns, lost.to_ns))
                words = f"{lost.words}, {from_s:+.3f} s to {to_s:+.3f} s: what was asked and decided there is unknown"
                self._recordings.tell(f"{topic}: {words}")
        if within and not log.leads and not self._recordings.from_ns:
            self._recordings.tell(f"{topic}: no line of it selects a mission, what was asked is scripted")

    def _label(self) -> str:
        """Return the prefix of session ids: that of the flight, or the time of the recording, not of the replay."""
        if self._log is not None and self._log.label:
            return self._log.label
        recorded_ns = self._recordings.start_ns - self._recordings.shift_ns
        start = datetime.fromtimestamp(recorded_ns // _S, tz=timezone.utc)
        return start.strftime("%Y%m%dT%H%M%S")

    def _header(self) -> Dict[str, Any]:
        plan, recordings = self._plan, self._recordings
        return make_header(
            plan.rules,
            plan.configuration,
            plan.configuration_hash,
            program="amaze-replay",
            map=plan.topic_map.name,
            mission=to_plain(self._log.missions[0] if self._log and self._log.missions else plan.mission),
            recording={
                "start_ns": recordings.start_ns - recordings.shift_ns,
                "end_ns": recordings.end_ns - recordings.shift_ns,
                "messages": recordings.count,
                **({"shift_ns": recordings.shift_ns} if recordings.shift_ns else {}),
            },
        )

    def _made_takers(self) -> Tuple[Tuple[bool, str], ...]:
        """Return for each rank whether its messages are decoded, and its topic."""
        topics = self._recordings.topics
        return tuple((self._monitors.decodes(topic) or self._world.decodes(topic), topic) for topic in topics)

    def _lights(self) -> List[Optional[Light]]:
        """Return for each rank how its messages are taken by their numbers alone; None: they must be decoded."""
        topics = self._recordings.topics
        lights = [None if self._world.decodes(topic) else self._monitors.light(topic) for topic in topics]
        whole = [topic for rank, topic in enumerate(topics) if lights[rank] is None and self._takers[rank][0]]
        names = {rank: self._world.status_of(topic) for rank, topic in enumerate(topics) if topic in whole}
        told = {rank: name for rank, name in names.items() if name and not self._monitors.decodes(topics[rank])}
        taped = self._recordings.read_statuses(told)
        read = {rank: name for rank, name in told.items() if rank not in taped}
        self._names = told
        self._recordings.keep([topic for rank, topic in enumerate(topics) if topic in whole and rank not in taped])
        wanted = {rank: light.paths for rank, light in enumerate(lights) if light and light.readers}
        paths = {rank: FLAT.get(name, WHOLE) for rank, name in read.items()}
        self._recordings.read({**wanted, **paths}, tuple(read))
        self._recordings.tell_statuses(read)
        tracks = {
            rank: self._recordings.track(rank, light.paths) for rank, light in enumerate(lights) if light is not None
        }
        whole_tracks = {rank: track for rank, track in tracks.items() if track is not None}
        self._riding = self._monitors.ride(whole_tracks, topics)
        return lights

    def _due_ns(self) -> int:
        """Return when something happens besides the recording, at the earliest."""
        task = self._agenda.next
        times = [each for each in (self._deadline_ns, task[0] if task else None) if each is not None]
        return min(times, default=_NEVER_NS)

    def _take(self, sample: Sample) -> None:
        decodes, topic = self._takers[sample.rank]
        event = self._recordings.status(sample) if sample.rank in self._names else None
        if event is not None:
            if self._monitors.takes(topic):
                self._monitors.take(topic, sample.t_ns, None)
            self._world.take_status(self._names[sample.rank], sample.t_ns, event)
            return
        message = self._recordings.message(sample) if decodes else None
        self._monitors.take(topic, sample.t_ns, message)
        if message is not None:
            self._world.take(topic, sample.t_ns, message)

    def _until(self, t_ns: int, rank: int) -> None:
        """Do everything that comes before a time and rank."""
        while True:
            task = self._agenda.next
            tick = (self._deadline_ns, Rank.TICK) if self._deadline_ns is not None else None
            if tick is not None and tick < (t_ns, rank) and (task is None or tick < task):
                self._monitors.now = tick
                self._feed(Tick(t_ns=tick[0]), self._world.source(tick[0]))
            elif task is not None and task < (t_ns, rank):
                self._monitors.now = task
                self._agenda.run()
            else:
                return

    def _feed(self, event: Event, source: Source) -> None:
        """Give an event to the engine, and carry out what it says; nobody hears it while its process is dead."""
        if self._story.acts:
            heard = None if self._story.engine_down(event.t_ns) else self._story.heard(event)
            if heard is None:
                self._deadline_ns = None if self._story.engine_down(event.t_ns) else self._deadline_ns
                return
            event = heard
        if isinstance(event, EngineStarted) and not event.resumed:
            self._state = EngineState()
        self._journal.append(encode_event(event))
        if isinstance(event, AutopilotStatus):
            self._statuses.append(event)
        self._source = source
        self._state, commands = decide(self._state, event, self._rules)
        self._world.state = self._state
        self._deadline_ns = next_deadline(self._state, self._rules)
        if not commands:
            return
        for command in commands:
            source |= self._carry_out(event.t_ns, command)
        for message in (command for command in commands if isinstance(command, Notify)):
            self._lines.append(Line(event.t_ns, source, LineKind.MESSAGE, f'"{message.text}"', _level(message.level)))
        self._ask_user()

    def _carry_out(self, t_ns: int, command: Command) -> Source:
        """Carry out a command; return what else than its event had a part in it."""
        if isinstance(command, Decision):
            self._decisions.append(command)
            self._journal.append(encode_decision(command))
            level = 2 if command.after in (State.LAND.value, State.PILOT.value, State.OUTREACH.value) else 0
            level = 1 if command.after == State.HOLD.value else level
            source = self._source | self._world.scripted_part(t_ns, (value.name for value in command.values))
            text = decision_text(command, self._recordings.start_ns)
            self._lines.append(Line(t_ns, source, LineKind.DECISION, text, level))
            return source
        if isinstance(command, MissionCommand) and command.action is MissionAction.TAKEOFF:
            self._world.flown = True
        self._world.carry_out(t_ns, command)
        return Source.NONE

    def _ask_user(self) -> None:
        if self._log is not None:
            return
        asked = self._user.react(self._state, require_go=self._plan.rules.require_go)
        if asked is not None:
            self._ask(*asked)

    def _ask(self, when_ns: int, command: UserCommand) -> None:
        self._agenda.at(when_ns, Rank.USER, lambda t_ns: self._request(t_ns, command))

    def _request(self, t_ns: int, command: UserCommand) -> None:
        self._request_id += 1
        self._feed(UserRequest(t_ns=t_ns, command=command, request_id=self._request_id), Source.SCRIPT)
        again_ns = self._user.again(self._state, command)
        if again_ns is not None:
            self._ask(again_ns, command)

    def _select(self, t_ns: int) -> None:
        self._request_id += 1
        missions = (self._plan.mission,)
        self._feed(MissionSelected(t_ns=t_ns, missions=missions, request_id=self._request_id), Source.SCRIPT)

    def _say(self, t_ns: int, source: Source, text: str, level: int) -> None:
        self._lines.append(Line(t_ns, source, LineKind.MONITOR, text, level))

    def _note(self, t_ns: int, text: str, level: int = 0) -> None:
        self._agenda.at(t_ns, 0, lambda at_ns: self._lines.append(Line(at_ns, Source.BAG, LineKind.NOTE, text, level)))

    def _note_texts(self) -> None:
        """Note what the recorded vehicle says in words."""
        reading = self._plan.topic_map.readings.get("texts")
        if reading is None or reading.topic not in self._recordings.topics:
            return
        get = {name: fields.getter(path) for name, path in reading.fields.items()}
        for sample in self._recordings.ordered((self._recordings.topics.index(reading.topic),)):
            message = self._recordings.message(sample)
            if message is not None:
                severity = fields.number(get["severity"](message)) if "severity" in get else None
                level = 0 if severity is None or severity >= _NOTICE else 1 if severity == _NOTICE - 1 else 2
                self._note(sample.t_ns, f"the autopilot says: {_said(get['text'](message))}", level)

    def _outcome(self) -> Outcome:
        end_ns, evidence = self._recordings.end_ns, self._world.evidence
        evidence.end()
        self._world.recorded.end(end_ns)
        parting = flown = None
        log = self._log if self._log is not None and (self._log.decisions or not self._recordings.from_ns) else None
        if log is not None and log.known_decisions is None:
            flown, until_ns = log.decisions, min(end_ns - _S, log.end_ns)
        elif log is not None and log.known_decisions:
            flown, until_ns = log.decisions[: log.known_decisions], min(end_ns, log.known_ns) - _S
        if flown is not None:
            parting = part(flown, tuple(self._decisions), until_ns)
        missed, since_ns = evidence.action, evidence.counterfactual_ns
        if parting is not None and (since_ns is None or parting.t_ns < since_ns):
            missed, since_ns = None, parting.t_ns
        words = f"the recording ends in {self._state.state.value}"
        self._lines.append(Line(end_ns, Source.BAG, LineKind.NOTE, words))
        told = self._world.recorded.told
        unseen = {name: missing for name, missing in self._plan.unseen.items() if name not in told}
        start_ns = self._recordings.start_ns
        self._lines += [Line(start_ns, Source.BAG, LineKind.NOTE, not_recorded(*each), 1) for each in unseen.items()]
        upsets = upsets_of(self._plan, self._recordings, self._statuses, flown="landed" in self._facts())
        lines = sorted([*self._lines, *upsets], key=lambda line: line.t_ns)
        return Outcome(
            journal=tuple(self._journal),
            timeline=tuple(marked(joined(lines), since_ns)),
            state=self._state,
            start_ns=self._recordings.start_ns,
            end_ns=end_ns,
            counterfactual_ns=since_ns,
            missed=missed,
            checks=dict(self._world.answers.last),
            decisions=tuple(self._decisions),
            flown=flown,
            parting=parting,
            flown_in_part=flown is not None and log is not None and log.known_decisions is not None,
            compared=self._world.recorded.compared,
            disagreements=tuple(self._world.recorded.disagreements),
            unread=self._unread(),
            beginning=self._at_first,
            flights=armings(self._world.motors, end_ns),
            facts=self._facts(),
            scripted=(*(name for name in _SCRIPTED if name not in self._facts()), *unseen),
            unseen=unseen,
            mission=self._state.session.mission or self._plan.mission,
        )

    def _facts(self) -> FrozenSet[str]:
        return recorded_facts(self._plan, self._recordings, log=self._log is not None)

    def _unread(self) -> Tuple[Unread, ...]:
        facts = self._facts()
        watched = self._monitors.watchdog.started or "watchdog_info" in self._plan.topic_map.statuses
        failed = self._world.failed
        return self._keys.unread(self._plan, self._recordings, facts, watched=watched, failed=failed)


def mission_of(plan: Plan, recordings: Recordings, known: Sequence[Mission], asked: Optional[str]) -> str:
    """Return the id of the mission to plan for: the one that the flight's journal selects, else that of a plan.

    Args:
        plan: for the mission that was asked for, else for the configuration's first.
        recordings: open.
        known: missions of the configuration; one that it does not have cannot be planned for.
        asked: the id of the mission that was asked for; None: none was.

    Raises:
        ReplayError: Another one was asked for, and what was asked in flight is replayed.
    """
    log = recordings.log(plan.topic_map.statuses.get("journal", ""))
    flown = () if log is None else tuple(dict.fromkeys(mission.id for mission in log.missions))
    if asked and flown and asked not in flown:
        words = f"the journal in the recording selects {' and '.join(flown)}, and what it says is replayed"
        raise ReplayError(f"mission {asked} was not flown: {words}; leave the mission out")
    possible = flown[:1] if not asked and flown and flown[0] in [mission.id for mission in known] else ()
    return next(iter(possible), plan.mission.id)


def _periods_ns(recordings: Recordings) -> Dict[str, int]:
    """Return how far apart the messages of each topic mostly are."""
    found: Dict[str, int] = {}
    for rank, topic in enumerate(recordings.topics):
        times = recordings.times(rank)
        if len(times) > 1:
            found[topic] = int(np.median(np.diff(times)))
    return found


def not_recorded(name: str, missing: Tuple[str, ...]) -> str:
    """Return what is said of a required component of which the recording has no word, or lacks some topics."""
    return f"{name} is {recorded_words(missing)}: it is required, and takeoff does not wait for it here"


def _said(value: Any) -> str:
    """Return a text of a vehicle as one line: bytes up to the first zero, or words."""
    text = value.split(b"\0")[0].decode("utf-8", "replace") if isinstance(value, bytes) else str(value).split("\0")[0]
    return "".join(each if each.isprintable() else " " for each in text).strip()


def _level(level: Level) -> int:
    return {Level.INFO: 0, Level.WARNING: 1}.get(level, 2)


# --- parting ----------------------------------------------------------------------------------------------------------
# Where a replay parts from the flight it replays: the first decision that is not that of the flight.
#
# Compared are states, steps and rules in their order, not times and values. From there on the recorded vehicle did
# what the flight's engine said, not what this one says.


@dataclass(frozen=True)
class Parting:
    """The first decision that is not that of the flight.

    Args:
        number: of it, from 0.
        flown: the flight's; None: it made none any more.
        decided: the replay's; None: it made none any more.
        t_ns: the earlier time of the two.
    """

    number: int
    flown: Optional[Decision]
    decided: Optional[Decision]
    t_ns: int


def part(flown: Tuple[Decision, ...], decided: Tuple[Decision, ...], until_ns: int) -> Optional[Parting]:
    """Return where two flights part; None: they do not.

    Args:
        flown: decisions of the flight, in the bag's time.
        decided: those of the replay.
        until_ns: from then on a decision may be missing on either side: the recording's topics do not end at one
            moment, and what the flight decided after its journal ends is not known.
    """
    for number, (one, other) in enumerate(zip_longest(flown, decided)):
        t_ns: int = min(each.t_ns for each in (one, other) if each is not None)
        if one is None or other is None:
            return None if t_ns >= until_ns else Parting(number, one, other, t_ns)
        if _step(one) != _step(other):
            return Parting(number, one, other, t_ns)
    return None


def _step(decision: Decision) -> Tuple[str, str, str, str]:
    return decision.before, decision.after, decision.step, decision.rule
