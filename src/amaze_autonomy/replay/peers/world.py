"""The engine's peers in a replay: statuses at their periods, answers to commands, from the recording or the script."""

from __future__ import annotations

from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Set, Tuple

from amaze_autonomy.engine.commands import (
    AutopilotLand,
    Command,
    LoadMission,
    MissionAction,
    MissionCommand,
    Request,
    RunCheck,
    StartRecording,
    StopRecording,
)
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    ComponentStatus,
    Event,
    Landed,
    LandedStatus,
    MissionStatus,
    Outcome,
    Reply,
    VehicleLanded,
    WatchdogAction,
    WatchdogInfo,
    made,
)
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.engine.state import EngineState, evolve
from amaze_autonomy.interface import InvalidMessageError
from amaze_autonomy.monitoring.condition import FOREVER_NS

from ...engine.events import CHECKS, CheckName, InvalidEventError
from ..agenda import Agenda, Rank, Task, Turns
from ..beginning import Lead
from ..errors import MisfitError, ReplayError
from ..faults.story import Story
from ..monitors.feeds import BatteryFeed, Feed, Rise
from ..monitors.monitors import Monitors
from ..plan import Plan
from ..recordings.fields import kind_of
from ..recordings.sources import Recordings
from ..recordings.statuses import EVENT_OF, FLAT
from ..timeline import Notes, Say, Source
from .answers import RECORDED, Answers, Follower
from .evidence import Evidence, Observed
from .recorded_nodes import COMPARED, RecordedNodes
from .script import Planner, Recorder, Vehicle

_S = 1_000_000_000
_LATENCY_NS = 1_000_000
_TURN_NS = _S // 50
_WATCH_NS = _S // 10
_CONTRADICTION_NS = 3 * _S  # that it must stand: of slow telemetry one word is seconds newer than the other
_PLANNER, _RECORDER = (("mission_planner",), ()), (("data_recorder",), ())
# a value of a decision: the statuses and the readings of which one tells it, where it is not scripted
_TELLERS: Mapping[str, Tuple[Tuple[str, ...], Tuple[str, ...]]] = {
    "armed": (("autopilot",), ("armed",)),
    "landed": (("autopilot",), ("landed", "range", "height")),
    "height": (("autopilot",), ("height", "range")),
    "flight mode": (("autopilot",), ("mode",)),
    "landing detection": (("landing_detection", "autopilot"), ("range", "landed", "height")),
    "speed over ground": (("autopilot",), ()),
    "planner phase": _PLANNER,
    "planner says": _PLANNER,
    "waypoint": _PLANNER,
    "platforms that record": _RECORDER,
    "recorder phase": _RECORDER,
    "files do not grow on": _RECORDER,
    "location": _RECORDER,
}
_MOTION = frozenset(("armed", "landed", "height_m"))
_LANDED = {VehicleLanded.UNKNOWN: Landed.UNKNOWN, VehicleLanded.ON_GROUND: Landed.ON_GROUND}

Tell = Callable[[Event, Source], None]


class World:
    """Watchdog, landing detection, autopilot, planner and recorder of a replay.

    Args:
        plan: of the replay.
        monitors: that the samples go to.
        agenda: for what is due later.
        tell: gives an event to the engine.
        say: writes a line of the timeline: time, source, text, level.
        recordings: open.
        story: faults of the peers' services.
        lead: what the script plays before a recording that begins in the air; None: it begins on the ground.
    """

    def __init__(
        self,
        plan: Plan,
        monitors: Monitors,
        agenda: Agenda,
        tell: Tell,
        say: Say,
        recordings: Recordings,
        story: Story,
        lead: Optional[Lead] = None,
    ) -> None:
        self._story, self._lead = story, lead
        self._plan, self._monitors, self._agenda = plan, monitors, agenda
        self._tell, self._say, self._recordings = tell, say, recordings
        self.recorded = RecordedNodes(plan, recordings, say)
        self.answers = Answers(plan, monitors, self.recorded, self._recorded_landed)
        self.evidence = Evidence(plan.rules.limits)
        self.state = EngineState()
        self.flown = False
        self.failed: Set[str] = set()
        self.motors: List[Tuple[int, bool]] = []
        self._vehicle, self._planner, self._recorder = Vehicle(lead), Planner(), Recorder()
        self._statuses: Dict[str, str] = {topic: name for name, topic in plan.topic_map.statuses.items()}
        self._heard: Dict[str, Event] = {}
        self._sessions: Dict[str, str] = {}
        self._notes = Notes(say)
        self._followed = Follower()
        self._turns = self._looks = Turns(0, _TURN_NS)
        self._turn_ns = FOREVER_NS
        self._origins = Origins(plan, recordings, 0 if lead is None else _S)
        self._contradicted: Dict[str, int] = {}
        self._action: Optional[WatchdogAction] = None
        self._info: Optional[WatchdogInfo] = None

    # --- time and sources ---------------------------------------------------------------------------------------------

    def begin(self, t_ns: int, *, plays: bool) -> None:
        """Start every peer at a time; `plays`: the script plays topics that have not begun."""
        for rank, topic in enumerate(self._recordings.topics if plays else ()):
            for feed in self._monitors.feeds:
                if feed.topic == topic and feed.period_ns:
                    self._join(feed, rank)
                    self._play(feed, t_ns, rank)
        rates = self._plan.streams
        peers = (
            ("landing_detection", rates.landing_detection_rate_hz, Rank.LANDING, self._tell_landed),
            ("autopilot", rates.autopilot_status_rate_hz, Rank.AUTOPILOT, self._tell_autopilot),
            ("mission_planner", rates.planner_status_rate_hz, Rank.PLANNER, self._tell_planner),
            ("data_recorder", rates.recorder_status_rate_hz, Rank.RECORDER, self._tell_recorder),
        )
        for name, rate_hz, rank, task in peers:
            period_ns = round(_S / rate_hz)
            self._agenda.at(t_ns + _LATENCY_NS, rank, self._repeated(name, period_ns, rank, task))
        self._turns = Turns(t_ns + _LATENCY_NS, _TURN_NS)
        self._plan_turn(t_ns + _LATENCY_NS)
        if self._monitors.state is not None:
            self._looks = Turns(self._recordings.start_ns + _S, _WATCH_NS)
            self._agenda.at(self._looks.first_ns, Rank.STATE, self._follow_state)

    def _repeated(self, name: str, period_ns: int, rank: int, task: Task) -> Task:
        """Return what tells a status again and again, until the recording does."""

        def again(t_ns: int) -> None:
            if not self._decides(name, t_ns):
                task(t_ns)
                self._agenda.at(t_ns + period_ns, rank, again)

        return again

    def _decides(self, name: str, t_ns: int) -> bool:
        """Return True when a recorded status decides from now on; one that is only compared does not."""
        return not self.recorded.compares(name) and self._origins.has(name, t_ns)

    def source(self, t_ns: int) -> Source:
        """Return where what is known of the components comes from at a time."""
        return self._origins.source(t_ns)

    def scripted_part(self, t_ns: int, names: Iterable[str]) -> Source:
        """Return SCRIPT when one of the values that a decision looked at is what the script says at a time."""
        readings = self._plan.topic_map.readings

        def told(statuses: Tuple[str, ...], facts: Tuple[str, ...]) -> bool:
            topics = (readings[fact].topic for fact in facts if fact in readings)
            return any(self._origins.has(status, t_ns) for status in statuses) or any(
                t_ns >= self._origins.begins_ns(topic) for topic in topics
            )

        known = all(told(*_TELLERS[name]) for name in names if name in _TELLERS)
        return Source.NONE if known else Source.SCRIPT

    def _join(self, feed: Feed, rank: int) -> None:
        """Let what is played lead up to the first recorded message, where it is played until then."""
        first = next(iter(self._recordings.ordered((rank,))), None)
        if first is None or not feed.decodes or first.t_ns > self._origins.begins_ns(feed.topic):
            return
        message = self._recordings.message(first)
        if message is not None:
            try:
                feed.join(message, self._rise())
            except (ReplayError, AttributeError, IndexError, TypeError):  # it is said when it is replayed
                return

    def _rise(self) -> Rise:
        lead = self._lead
        if lead is None:
            return Rise(lambda _: 0.0, lambda _: 0.0)
        return Rise(lead.share, lambda t_ns: lead.height_m - self._vehicle.height_m(t_ns))

    def _play(self, feed: Feed, t_ns: int, rank: int) -> None:
        """Play a topic as nominal until its first message, for as long as the script says."""
        end_ns = self._origins.begins_ns(feed.topic)

        def again(at_ns: int) -> None:
            if at_ns < end_ns:
                feed.play(at_ns)
                self._agenda.at(at_ns + feed.period_ns, rank, again)

        if t_ns < end_ns:
            self._agenda.at(t_ns, rank, again)

    # --- what the recording says --------------------------------------------------------------------------------------

    def decodes(self, topic: str) -> bool:
        """Return True when a topic carries a recorded status."""
        return topic in self._statuses

    def take(self, topic: str, t_ns: int, message: Any) -> None:
        """Take a recorded status: it takes the place of the scripted one.

        Raises:
            MisfitError: The message is not the one that the map says.
        """
        name = self._statuses.get(topic)
        if name is None or name not in EVENT_OF:
            return
        event = self._read(name, topic, t_ns, message)
        if event is not None:
            self.take_status(name, t_ns, event)

    def status_of(self, topic: str) -> str:
        """Return the name of the status that a topic carries; empty when there is none."""
        name = self._statuses.get(topic, "")
        return name if name in EVENT_OF else ""

    def status_paths(self, topic: str) -> Optional[Tuple[str, ...]]:
        """Return the fields of a recorded status that are looked at; "" is all of them; None: it is no status.

        Neither is the journal: what was asked is read from the bags themselves, past all faults.
        """
        name = self._statuses.get(topic, "")
        if name not in EVENT_OF:
            return None
        return COMPARED.get(name, ()) if self.recorded.compares(name) else FLAT.get(name, ("",))

    def take_status(self, name: str, t_ns: int, event: Event) -> None:
        """Take a recorded status as an event."""
        event = self._ours(event)
        self._heard[name] = event
        if self.recorded.compares(name):
            self._compare(t_ns, event)
            return
        if isinstance(event, WatchdogInfo):
            self.answers.recorded_info = event
            self.recorded.told.update(each.name for each in event.components)
            self._note_components(event.components, t_ns, Source.BAG)
        elif isinstance(event, LandedStatus):
            self.answers.recorded_landed = event
            self._notes.landed(event.landed, event.reason, t_ns, Source.BAG)
        elif isinstance(event, AutopilotStatus) and "mission_planner" not in self._plan.topic_map.statuses:
            self._planner.follow(vars(event), self._plan.rules.limits.takeoff_height_m)
        if isinstance(event, AutopilotStatus):
            self._contradict(t_ns, vars(event))
            self.motors += [] if event.armed is None else [(t_ns, event.armed)]
        self._tell(event, Source.BAG)
        self._observe(t_ns)

    def _compare(self, t_ns: int, event: Event) -> None:
        """Take a recorded status of a node that judges anew: its heartbeat, and what nobody else can tell."""
        if isinstance(event, WatchdogAction):
            beats = self.recorded.beats(event)
            new = self.recorded.take_foreign(event.components, whole=False)
            if beats or new:
                self._poll(t_ns, 0, again=True)
        elif isinstance(event, WatchdogInfo):
            new = self.recorded.take_foreign(event.components, whole=True)
            self.recorded.hear(t_ns, event.components)
            if new:
                self._poll(t_ns, 0, again=True)
        elif isinstance(event, LandedStatus):
            self.recorded.hear_landed(t_ns, event.landed)
            self._tell_landed(t_ns)

    def _read(self, name: str, topic: str, t_ns: int, message: Any) -> Optional[Event]:
        """Return a recorded status as an event; None when it holds what cannot be, which is noted."""
        try:
            return EVENT_OF[name](message, t_ns)
        except (InvalidMessageError, InvalidEventError) as error:
            self._recordings.note(topic, t_ns, str(error))
            return None
        except (AttributeError, TypeError) as error:
            raise MisfitError(topic, kind_of(message), str(error)) from error

    def _ours(self, event: Event) -> Event:
        """Put the engine's session in the place of the recorded one."""
        recorded = getattr(event, "session_id", "")
        if not recorded or not self.state.session.id:
            return event
        return evolve(event, session_id=self._sessions.setdefault(recorded, self.state.session.id))

    def _observe(self, t_ns: int) -> None:
        """Show what the recording tells now to those who wait for it."""
        autopilot, planner = self._heard.get("autopilot"), self._heard.get("mission_planner")
        if isinstance(autopilot, AutopilotStatus) and not self.evidence.waits:
            self.evidence.height_m = autopilot.height_m
            return
        phase = planner.phase if isinstance(planner, MissionStatus) else None
        if isinstance(autopilot, AutopilotStatus):
            seen = Observed(t_ns, autopilot.landed, autopilot.height_m, autopilot.mode, phase)
        else:
            told = self._monitors.facts(t_ns, flown=True)
            seen = Observed(t_ns, told.get("landed"), told.get("height_m"), told.get("mode"), phase)
        self.evidence.observe(seen)

    # --- statuses of the peers ----------------------------------------------------------------------------------------

    def _plan_turn(self, t_ns: int) -> None:
        """Let the watchdog look at a time, the next one at which anything can come of it."""
        self._turn_ns = t_ns
        self._agenda.at(t_ns, Rank.WATCHDOG, self._watch)

    def _wake(self) -> None:
        """Let the watchdog look at its very next turn: something was asked of it."""
        t_ns, rank = self._monitors.now
        next_ns = self._turns.after(t_ns - 1 if rank < Rank.WATCHDOG else t_ns)
        if next_ns < self._turn_ns:
            self._plan_turn(next_ns)

    def _watch(self, t_ns: int) -> None:
        if t_ns != self._turn_ns or self._decides("watchdog_action", t_ns):
            return
        self._poll(t_ns, self._turns.left_out(t_ns))
        next_ns = self._monitors.next_poll_ns(t_ns)
        if next_ns < FOREVER_NS:
            self._plan_turn(self._turns.after(max(t_ns, next_ns - 1)))
        else:
            self._turn_ns = FOREVER_NS

    def _poll(self, t_ns: int, left_out: int, *, again: bool = False) -> None:
        """Turn the watchdog's loop; `again`: its last messages count once more, with what others say now."""
        action, info = self._monitors.poll(t_ns, left_out)
        requests = self._monitors.restart_requests()
        if action is None and info is None and not requests and not again:
            return
        source = self._origins.source(t_ns)
        for request in requests:
            self._monitors.watchdog.restart_outcome(request, t_ns, good=True)
            words = f"watchdog: restart of {request.component}, attempt {request.attempt}"
            self._say(t_ns, Source.SCRIPT, words, 1)
        self._action, self._info = action or self._action, info or self._info
        if again and self._action is not None and self._info is not None:
            loops = self._monitors.watchdog.loop_counter
            action = action or evolve(self._action, t_ns=t_ns, loop_counter=loops)
            info = info or evolve(self._info, t_ns=t_ns, changed=())
        if info is not None:
            self.recorded.judge(t_ns, info.components)
            info = self.recorded.merged_info(info)
            if "watchdog_info" not in self._heard or self.recorded.compares("watchdog_info"):
                self._note_components(info.components, t_ns, source)
        if not self.recorded.speaks("watchdog_action", t_ns):
            return
        if action is not None:
            self._tell(self.recorded.merged_action(action), source)
        if info is not None:
            self._tell(info, source)

    def _note_components(self, components: Tuple[ComponentStatus, ...], t_ns: int, source: Source) -> None:
        self._notes.components(components, t_ns, source)
        self.failed.update(each.name for each in components if each.code is not Code.NOMINAL)

    def _tell_landed(self, t_ns: int) -> None:
        verdict = self._monitors.judge_landing(t_ns)
        if verdict is None:
            facts, source = self._vehicle_facts(t_ns)
            landed = _LANDED.get(facts["landed"], Landed.AIRBORNE)
            reason = "scripted" if Source.SCRIPT in source else "the recorded vehicle says so"
            status = LandedStatus(t_ns=t_ns, landed=landed, distance_m=facts["height_m"], reason=reason)
        else:
            source = self._origins.of((self._plan.topic_map.readings["range"].topic,), t_ns)
            told = {"landed": verdict.landed, "distance_m": verdict.distance_m, "reason": verdict.reason}
            status = made(LandedStatus, t_ns=t_ns, age_ns=0, **told)
            self._notes.landed(verdict.landed, verdict.reason, t_ns, source)
            self.recorded.judge_landed(t_ns, verdict.landed)
        if self.recorded.speaks("landing_detection", t_ns):
            self._tell(status, source)

    def _vehicle_facts(self, t_ns: int) -> Tuple[Dict[str, Any], Source]:
        """Return the whole of what the vehicle says, and where it comes from."""
        told = {} if t_ns < self._recordings.start_ns else self._recorded_facts(t_ns)
        if t_ns < self._origins.script_until_ns:  # what has not begun is played, what has begun is recorded
            told = {name: value for name, value in told.items() if value not in (None, VehicleLanded.UNKNOWN)}
        source = (Source.BAG if told else Source.NONE) | Source.SCRIPT
        if told.keys() >= _MOTION:
            source = Source.BAG
        self._contradict(t_ns, told)
        if told.get("armed") is not None:
            self.motors.append((t_ns, told["armed"]))
        facts = self._vehicle.facts(t_ns, told)
        facts.update({"mode": told["mode"]} if "mode" in told else {})
        facts.update({"failsafe": told["failsafe"] is True and facts["armed"] is True} if "failsafe" in told else {})
        if "battery_fraction" not in told:
            batteries = (feed for feed in self._monitors.feeds if isinstance(feed, BatteryFeed))
            facts["battery_fraction"] = next((feed.level_at(t_ns) for feed in batteries), facts["battery_fraction"])
        return facts, source

    def _recorded_facts(self, t_ns: int) -> Dict[str, Any]:
        """Return what the recording tells of the vehicle now: by its status, else by single readings."""
        status = self._heard.get("autopilot")
        if isinstance(status, AutopilotStatus):
            return {name: getattr(status, name) for name in _MOTION}
        return self._monitors.facts(t_ns, flown=self.flown)

    def _recorded_landed(self, t_ns: int) -> Optional[VehicleLanded]:
        """Return whether the recorded vehicle says that it is on the ground; None: it does not say it now."""
        landed: Optional[VehicleLanded] = None
        if t_ns >= self._recordings.start_ns:
            landed = self._recorded_facts(t_ns).get("landed")
        return None if landed is VehicleLanded.UNKNOWN else landed

    def _contradict(self, t_ns: int, told: Mapping[str, Any]) -> None:
        """Say where the recording contradicts what the script, or the engine by it, takes for granted."""
        landed = told.get("landed")
        flies = landed in (VehicleLanded.IN_AIR, VehicleLanded.LANDING, VehicleLanded.TAKING_OFF)
        found: Dict[str, bool] = {
            "the recorded vehicle flies, and nothing here has commanded a takeoff": flies and not self.flown,
            "the recorded vehicle is in the air and disarmed": flies and told.get("armed") is False,
        }
        for words, holds in found.items():
            if not holds:
                self._contradicted.pop(words, None)
                continue
            since_ns = self._contradicted.setdefault(words, t_ns)
            if since_ns <= t_ns - _CONTRADICTION_NS:
                self._say(since_ns, Source.BAG, f"contradiction: {words}", 2)
                self._contradicted[words] = FOREVER_NS  # once

    def _tell_autopilot(self, t_ns: int) -> None:
        facts, source = self._vehicle_facts(t_ns)
        self._planner.follow(facts, self._plan.rules.limits.takeoff_height_m)
        mode = facts.pop("mode", self._vehicle.mode) or ""
        status = AutopilotStatus(t_ns=t_ns, mode=mode, position_x_m=0.0, position_y_m=0.0, battery_age_s=0.0, **facts)
        self._tell(status, source)
        self._observe(t_ns)

    def _tell_planner(self, t_ns: int) -> None:
        self._tell(self._planner.status(t_ns), Source.SCRIPT)

    def _tell_recorder(self, t_ns: int) -> None:
        self._tell(self._recorder.status(t_ns), Source.SCRIPT)

    # --- lines of the timeline ----------------------------------------------------------------------------------------

    def _follow_state(self, t_ns: int) -> None:
        """Note when rows of the check of the states begin or cease to pass, whether or not the engine asks."""
        state = self._monitors.state
        if state is not None:
            for note in self._followed.take(state.in_motion(t_ns), in_flight=self.state.flight.active):
                self._say(t_ns, self._origins.source(t_ns), note.text, note.level)
        next_ns = self._looks.after(t_ns)
        if self._followed.settled:
            next_ns = self._looks.after(self._monitors.unsure_ns(next_ns, self._looks) - 1)
        if next_ns <= self._recordings.end_ns:
            self._agenda.at(next_ns, Rank.STATE, self._follow_state)

    # --- commands -----------------------------------------------------------------------------------------------------

    def carry_out(self, t_ns: int, command: Command) -> None:
        """Carry out a command of the engine, as far as a replay can, and answer it, unless a fault does."""
        spoilt, delay_ns, instead = (
            self._story.answer(t_ns, command) if isinstance(command, Request) else (False, 0, None)
        )
        if instead is not None:
            self._agenda.at(
                t_ns + delay_ns, Rank.REPLY, lambda at_ns: self._tell(evolve(instead, t_ns=at_ns), Source.SCRIPT)
            )
        if not spoilt:
            self._do(t_ns, command, delay_ns, answers=instead is None)

    def _do(self, t_ns: int, command: Command, delay_ns: int, *, answers: bool) -> None:
        if isinstance(command, RunCheck):
            self._check(t_ns, command, delay_ns, answers=answers)
        elif isinstance(command, MissionCommand):
            self._move(t_ns, command.action)
            self._planner.command(command.action)
        elif isinstance(command, AutopilotLand):
            self._move(t_ns, MissionAction.LAND)
        elif isinstance(command, LoadMission):
            self._planner.load(command)
        elif isinstance(command, StartRecording):
            self._recorder.start(t_ns, command)
        elif isinstance(command, StopRecording):
            self._recorder.stop(t_ns, command)
        if answers and isinstance(command, Request) and not isinstance(command, RunCheck):
            reply_to = command.id
            due_ns = t_ns + delay_ns + _LATENCY_NS
            self._agenda.at(due_ns, Rank.REPLY, lambda at_ns: self._accept(at_ns, reply_to))

    def _accept(self, t_ns: int, command_id: int) -> None:
        self._tell(Reply(t_ns=t_ns, command_id=command_id, outcome=Outcome.ACCEPTED), Source.SCRIPT)

    def _move(self, t_ns: int, action: MissionAction) -> None:
        self._vehicle.command(t_ns, action)
        if self._lead is None or t_ns >= self._lead.end_ns:  # what leads up to a recording is not asked of it
            self.evidence.command(t_ns, action)

    def _check(self, t_ns: int, command: RunCheck, delay_ns: int, *, answers: bool) -> None:
        until_ns = t_ns
        if CHECKS[command.check].watches:
            mission, watchdog = self._plan.mission, self._monitors.watchdog
            until_ns = t_ns if watchdog.started else t_ns + command.startup_time_ns
            startup_ns = command.startup_time_ns or _S
            watchdog.start(t_ns, mission.severities, command.required, mission.tolerated, startup_ns)
            self._wake()
        if answers:
            due_ns = t_ns + delay_ns + _LATENCY_NS
            self._agenda.at(due_ns, Rank.REPLY, lambda at_ns: self._answer(at_ns, command, until_ns))

    def _answer(self, t_ns: int, command: RunCheck, until_ns: int) -> None:
        """Answer a check; the first one of the watchdog waits for components to come up."""
        if CHECKS[command.check].watches:
            self._wake()  # whoever asks it lets it judge
        waits = CHECKS[command.check].watches and not self._decides("watchdog_action", t_ns)
        if waits and t_ns < until_ns and self.answers.watchdog_waits(t_ns):
            self._agenda.at(
                min(t_ns + _WATCH_NS, until_ns), Rank.REPLY, lambda at_ns: self._answer(at_ns, command, until_ns)
            )
            return
        reply, source = self.answers.answer(t_ns, command, self._check_source(command.check, t_ns))
        self._tell(reply, source)

    def _check_source(self, check: CheckName, t_ns: int) -> Source:
        readings = self._plan.topic_map.readings
        topics: List[str] = [readings[name].topic for name in RECORDED[check].readings if name in readings]
        return self._origins.of(tuple(topics), t_ns) if topics else self._origins.source(t_ns)


# --- origins ----------------------------------------------------------------------------------------------------------
# Where what is known at a time comes from: the recording, or the script that plays what has not begun yet.


class Origins:
    """When each topic begins to speak for itself.

    Args:
        plan: of the replay.
        recordings: open.
        least_ns: a recorder needs so long until it hears every topic.

    Attributes:
        script_until_ns: until then silent topics may be played.
    """

    def __init__(self, plan: Plan, recordings: Recordings, least_ns: int = 0) -> None:
        self.script_until_ns = recordings.start_ns + max(least_ns, plan.topic_map.script.sensors_until_ns)
        self._statuses = plan.topic_map.statuses
        self._watched = plan.component_topics or recordings.topics
        self._first_ns = _first_times(recordings)

    def begins_ns(self, topic: str) -> int:
        """Return until when a topic may be played."""
        return min(self.script_until_ns, self._first_ns.get(topic, self.script_until_ns))

    def source(self, t_ns: int) -> Source:
        """Return where what is known of the components comes from at a time."""
        return self.of(self._watched, t_ns)

    def of(self, topics: Tuple[str, ...], t_ns: int) -> Source:
        """Return where what some topics say comes from at a time."""
        if t_ns >= self.script_until_ns:
            return Source.BAG
        begun = [topic for topic in topics if t_ns >= self._first_ns.get(topic, self.script_until_ns)]
        if len(begun) == len(topics):
            return Source.BAG
        return Source.BAG | Source.SCRIPT if begun else Source.SCRIPT

    def has(self, name: str, t_ns: int) -> bool:
        """Return True when the recording tells a status, so that the script is silent; before it begins it may play."""
        topic = self._statuses.get(name)
        return topic is not None and t_ns >= self.begins_ns(topic)


def _first_times(recordings: Recordings) -> Dict[str, int]:
    first: Dict[str, int] = {}
    for rank, topic in enumerate(recordings.topics):
        times = recordings.times(rank)
        if len(times):
            first[topic] = int(times[0])
    return first
