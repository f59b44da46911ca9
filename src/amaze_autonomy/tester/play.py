"""Plays one case: a simulation, a journal or bags become one journal and its trace."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

from amaze_autonomy.bags.other_formats import content_files
from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.config.model import Configuration
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import EngineStarted, Event, UserCommand
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.files import sha256_of
from amaze_autonomy.paths import config_folder
from amaze_autonomy.simulation import Fault, Scenario, Subject, Trigger
from amaze_autonomy.simulation.errors import SimulationError
from amaze_autonomy.simulation.run import run
from amaze_autonomy.simulation.world import Happened

from ..engine.events import Mission
from ..engine.rules import ComponentRule
from ..journal.journal import JournalError, decode, encode_decision, encode_event, encode_header, make_header, rules_of
from ..journal.trace import Trace, trace_of
from ..replay.beginning import beginning_of, selected_ns
from ..replay.changed_keys import (
    PEER_FACTS,
    DecidedKeys,
    Part,
    Unread,
    blind_losses,
    changes_of,
    keys_of,
    unread_in_journal,
    written,
)
from ..replay.errors import DamagedInputError, ReplayError
from ..replay.faults.kinds import TOPIC, Acting
from ..replay.faults.story import Story
from ..replay.faults.stream import TIMING, FaultedRecordings
from ..replay.maps.topic_map import TopicMap, load_map, map_names
from ..replay.plan import Plan, make_plan
from ..replay.recordings.journals import read_journals
from ..replay.recordings.sources import Recordings, silence, topics_of
from ..replay.session import Outcome, Session, mission_of
from .expect.model import PILOT, Pattern, instants
from .scenario.files import meant, place_of
from .scenario.model import Case, SourceKind
from .task import Options

# --- played -----------------------------------------------------------------------------------------------------------
# What came of playing a case, and what every way of playing it needs: configuration and missions.


_OVERRIDE = "override "
Mark = Tuple[str, float, Optional[float], str]


@dataclass(frozen=True)
class Played:
    """A run.

    Args:
        lines: of its journal, header first.
        trace: of it.
        vacuous: faults and requests of the scenario that did nothing, one line each.
        broken: why the input says nothing about the rules, one line each.
        marks: what went wrong and what the user asked, for reports.
        unread: changed keys of the configuration that nothing looked at; those of the scenario and of the run are in
            `vacuous` as well.
        idle: numbers of the faults that did nothing, from 0: they never began, or touched nothing.
    """

    lines: Tuple[str, ...]
    trace: Trace
    vacuous: Tuple[str, ...] = ()
    broken: Tuple[str, ...] = ()
    marks: Tuple[Mark, ...] = ()
    unread: Tuple[Unread, ...] = ()
    idle: Tuple[int, ...] = ()


def configuration_of(case: Case, options: Options) -> Configuration:
    """Return the configuration that a case is decided by: its own, unless the run names another.

    Raises:
        ConfigError: it has a mistake.
    """
    try:
        if not options.overrides:
            return load_configuration(_folder(case, options), case.overrides)
        return load_configuration(_folder(case, options), overrides_of(case, options))
    except ConfigError as error:
        raise _placed(error, case) from error


def _folder(case: Case, options: Options) -> Union[str, Path]:
    return options.configuration or case.configuration or config_folder()


def overrides_of(case: Case, options: Options) -> Tuple[str, ...]:
    """Return what is replaced of the configuration: by the scenario, then by the run."""
    return (*(f"{key}={written(value)}" for key, value in case.overrides.items()), *options.overrides)


def _followed(case: Case, options: Options) -> Tuple[Union[str, Path], Tuple[str, ...], Tuple[Unread, ...]]:
    """Return a folder and the overrides on top of it that are followed, and what cannot be.

    Another folder is followed as those overrides that make its configuration of the one before; one that is no changed
    copy of it, but a configuration of its own, is not, which is said where two are compared.
    """
    folder, given = _folder(case, options), overrides_of(case, options)
    if options.before is None:
        return folder, given, ()
    before = options.before or case.configuration or config_folder()
    keys = keys_of(folder, given, before)
    if keys is not None:
        return before, keys, ()
    words = "it has other components, missions or waypoint files, so its keys are not followed"
    return folder, given, (Unread(str(folder), words),) if options.compared else ()


def _placed(error: ConfigError, case: Case) -> ConfigError:
    """Return a mistake in an override of the scenario's own with its line in the scenario."""
    key = error.file[len(_OVERRIDE) :].partition("=")[0]
    if not error.file.startswith(_OVERRIDE) or key not in case.overrides:
        return error
    place = place_of(case.path, ("configuration", "set", key), ("matrix", key))
    return ConfigError(place, f"{key.partition('.')[0]}.{error.key}" if error.key else key, error.wrong, error.right)


def missions_of(case: Case, configuration: Configuration) -> Tuple[Mission, ...]:
    """Return the missions that a case flies.

    Raises:
        ReplayError: the configuration has no such mission.
    """
    known = {mission.id: mission for mission in configuration.missions}
    for name in case.missions:
        if name not in known:
            place = place_of(case.path, ("missions",), ("matrix", "missions"))
            raise ReplayError(f"{place}: there is no mission {name!r}; {meant(name, known)}")
    return tuple(known[name] for name in case.missions) or configuration.missions[:1]


# --- bags -------------------------------------------------------------------------------------------------------------
# Plays a case on bags: the part of the recording, with its faults, through the replay's session.


_S = 1_000_000_000


def replay_case(case: Case, options: Options, rules: Optional[Rules]) -> Played:
    """Replay the bags of a case.

    Raises:
        BagError: a bag cannot be read.
        ConfigError: the configuration, or the map, has a mistake.
        DamagedInputError: a bag is not the one that the scenario was written for.
        ReplayError: the case does not fit the recording.
    """
    configuration = configuration_of(case, options)
    topic_map, missions = _map(case), missions_of(case, configuration)
    _check_bags(case)
    paths = [bag.path for bag in case.bags]
    recorded = topics_of(paths, case.memory)
    plan = make_plan(configuration, topic_map, missions[0].id, recorded)
    folder, given, blind = _followed(case, options) if rules is None else (_folder(case, options), (), ())
    with Recordings(paths, plan.topics, memory=case.memory, replayed=True) as recordings:
        mission_id = _mission_of(case, plan, recordings, configuration)
        plan = make_plan(configuration, topic_map, mission_id, recorded)
        changes = changes_of(
            given,
            lambda some: load_configuration(folder, some),
            lambda each: make_plan(each, topic_map, mission_id, recorded),
        )
        if rules is not None:
            plan = replace(plan, rules=replace(rules, components=_rows(plan.rules, rules)))
        part = FaultedRecordings(recordings, case.from_ns, case.to_ns)
        if not part.samples:
            place = place_of(case.path, ("from_s",), ("to_s",), ("bags",))
            raise ReplayError(f"{place}: there is no message between from_s and to_s")
        broken = [*_too_short(case, recordings), *_needs(case, plan, part)]
        beginning, asked_ns = beginning_of(plan, part), selected_ns(plan, part)
        acting, requests = _times(case, plan, part)
        part.apply(acting, case.seed)
        story = Story(acting, requests)
        session = Session(plan, part, story, changes, beginning, asked_ns)
        outcome = session.run()
        touched = [one + other for one, other in zip(part.touched, story.touched)]
        unseen = [
            f"{each.fault} touched {count} messages, and nothing looked at what it changed"
            for each, count in zip(acting, part.touched)
            if count and not _is_looked_at(each, session)
        ]
        broken += part.problems
        broken += [
            f"{each.topic}: {each.count} messages cannot be read ({each.reason})" for each in part.damage.values()
        ]
    outcome = replace(outcome, unread=(*blind, *outcome.unread))
    played = _played(outcome, _zero_ns(part), acting, touched, broken)
    unasked = _never_asked(case, [t_ns <= outcome.end_ns for t_ns, _ in requests])
    return replace(played, vacuous=(*played.vacuous, *unseen, *unasked))


def _mission_of(case: Case, plan: Plan, recordings: Recordings, configuration: Configuration) -> str:
    """Return the id of the mission of a recording; one that a case names wrongly is refused with its line."""
    try:
        return mission_of(plan, recordings, configuration.missions, next(iter(case.missions), None))
    except ReplayError as error:
        raise ReplayError(f"{place_of(case.path, ('missions',), ('matrix', 'missions'))}: {error}") from error


def _never_asked(case: Case, asked: Sequence[bool]) -> List[str]:
    """Return what is said of each request of a case that was not asked."""
    return [f"{request} was never asked" for request, done in zip(case.requests, asked) if not done]


def _is_looked_at(acting: Acting, session: Session) -> bool:
    """Return True when something looks at what a fault changes: when messages come, or what stands in a field."""
    fault = acting.fault
    if fault.kind.subject not in (Subject.COMPONENT, TOPIC):
        return True
    if fault.kind.name in TIMING:
        return any(session.looks_at(topic) is not None for topic in acting.topics)
    given = dict(fault.parameters)
    names = [str(given[name]) for name in ("field", "with") if name in given]
    names = names or (["header.stamp"] if fault.kind.name == "stamped" else [""])
    return any(_meets(name, session.looks_at(topic)) for topic in acting.topics for name in names)


def _meets(field: str, paths: Optional[Tuple[str, ...]]) -> bool:
    """Return True when a field is, holds, or is a part of one that is looked at; "" is any, and is in all paths."""
    if not paths:
        return False
    return any(
        not field
        or path in ("", field)
        or path.startswith((f"{field}.", f"{field}["))
        or field.startswith((f"{path}.", f"{path}["))
        for path in paths
    )


def _rows(own: Rules, other: Rules) -> Tuple[ComponentRule, ...]:
    """Return the rows of other rules, and of the map's components that they do not have."""
    names = [row.name for row in other.components]
    return (*other.components, *(row for row in own.components if row.name not in names))


def _check_bags(case: Case) -> None:
    for bag in case.bags:
        if not bag.path.exists():
            raise DamagedInputError(f"{bag.path}: is not there; the scenario needs it{_hint(bag.path)}")
        if bag.sha256 and sha256_of(*content_files(bag.path)) != bag.sha256:
            raise DamagedInputError(f"{bag.path}: is another file than the scenario was written for (sha256 differs)")


def _hint(path: Path) -> str:
    return f" (is {path.parts[0][2:-1]} set?)" if path.parts[0].startswith("${") else ""


def _map(case: Case) -> TopicMap:
    name = case.topic_map or case.bags[0].path.stem
    if not case.topic_map and name not in map_names():
        raise ReplayError(f"{case.path}: which topics are what? Name a topic map with map: {', '.join(map_names())}")
    if name not in map_names() and not Path(name).is_file():
        place = place_of(case.path, ("map",), ("matrix", "map"))
        raise ReplayError(f"{place}: map: {name} is no topic map and no file; {meant(name, map_names())}")
    return load_map(name)


def _too_short(case: Case, recordings: Recordings) -> List[str]:
    """Return what is said of a recording that ends before the range that the case tests; a rounded time is none."""
    length_ns = recordings.end_ns - recordings.start_ns
    if case.to_ns is None or case.to_ns <= length_ns + _S:
        return []
    return [f"to_s is {case.to_ns / _S:.3f} s, and the recording ends at {length_ns / _S:+.3f} s"]


def _needs(case: Case, plan: Plan, part: FaultedRecordings) -> List[str]:
    """Return which needs the recording does not meet, before any fault."""
    times = {topic: part.times(rank) for rank, topic in enumerate(part.topics)}
    broken: List[str] = []
    for need in case.needs:
        found = times.get(need.topic)
        if found is None or not len(found):
            right = meant(need.topic, (topic for topic in times if len(times[topic])))
            broken.append(
                f"{need.topic}: is needed, and the map does not read it or the recording does not have it; {right}"
            )
            continue
        # What the script plays until a topic begins is not missing; what a topic lacks when it has ended is.
        begin_ns = min(int(found[0]), part.start_ns + plan.topic_map.script.sensors_until_ns)
        rate_hz = (len(found) - 1) * _S / max(1, part.end_ns - begin_ns)
        gap_ns, at_ns = silence(found, begin_ns, part.end_ns)
        if rate_hz < need.rate_hz:
            broken.append(f"{need.topic}: {rate_hz:.2f} Hz, at least {need.rate_hz:g} Hz are needed")
        if need.gap_ns is not None and gap_ns > need.gap_ns:
            when = f"at {(at_ns - _zero_ns(part)) / _S:+.3f} s, at most {need.gap_ns / _S:g} s are allowed"
            broken.append(f"{need.topic}: silent for {gap_ns / _S:.3f} s {when}")
    return broken


def _times(
    case: Case, plan: Plan, part: FaultedRecordings
) -> Tuple[Tuple[Acting, ...], Tuple[Tuple[int, UserCommand], ...]]:
    """Return faults and requests with their times; `after` is looked up in the same run without any fault.

    Times count from the first message of the recording, whatever part of it is played; before the part nothing begins.
    """
    triggers = (*(fault.trigger for fault in case.faults), *(request.trigger for request in case.requests))
    calm: Optional[Trace] = None
    if any(trigger.at_ns is None for trigger in triggers):
        calm = trace_of(Session(plan, part).run().journal, part.start_ns, part.end_ns)
    acting: List[Acting] = []
    for fault in case.faults:
        begin_ns = _begin(case, fault.trigger, part, calm, str(fault))
        end_ns = None if fault.for_ns is None or begin_ns is None else begin_ns + fault.for_ns
        acting.append(Acting(fault, _NEVER if begin_ns is None else begin_ns, end_ns, _topics_of(fault, plan)))
    requests: List[Tuple[int, UserCommand]] = []
    for request in case.requests:
        t_ns = _begin(case, request.trigger, part, calm, str(request))
        if request.command is None:
            raise ReplayError(f"{case.path}: {request}: a replay selects its mission by `missions`")
        requests.append((_NEVER if t_ns is None else t_ns, request.command))
    return tuple(acting), tuple(requests)


_NEVER = 1 << 62


def _zero_ns(part: FaultedRecordings) -> int:
    """Return the time of the first message of the recording that a part is of."""
    return part.start_ns - part.from_ns


def _begin(case: Case, trigger: Trigger, part: FaultedRecordings, calm: Optional[Trace], what: str) -> Optional[int]:
    if trigger.at_ns is not None:
        return _zero_ns(part) + trigger.at_ns if trigger.at_ns >= part.from_ns else None
    if trigger.event:
        raise ReplayError(f"{case.path}: {what}: a recording has no events; use at_s, or after with a state")
    if calm is None:
        return None
    times = instants(Pattern(states=(trigger.state,)), calm)
    return times[trigger.occurrence - 1] + trigger.delay_ns if len(times) >= trigger.occurrence else None


def _topics_of(fault: Fault, plan: Plan) -> Tuple[str, ...]:
    """Return the topics that a fault is about.

    Raises:
        ReplayError: there is no such component or topic in the map.
    """
    if fault.kind.subject == TOPIC:
        if fault.target not in plan.topics:
            raise ReplayError(
                f"{fault.where}: the map reads no topic {fault.target}; {meant(fault.target, plan.topics, 'it reads')}"
            )
        return (fault.target,)
    if fault.kind.subject != Subject.COMPONENT:
        return ()
    known: Dict[str, Tuple[str, ...]] = {s.name: tuple(t.topic for t in s.topics) for s in plan.components}
    if fault.target not in known:
        raise ReplayError(
            f"{fault.where}: the map has no component {fault.target}; {meant(fault.target, known, 'it has')}"
        )
    return known[fault.target]


def _played(
    outcome: Outcome, zero_ns: int, acting: Sequence[Acting], touched: Sequence[int], broken: Sequence[str]
) -> Played:
    began = tuple(None if each.begin_ns == _NEVER else each.begin_ns for each in acting)
    facts = outcome.facts | {fact for each in acting for fact in _facts_of(each.fault)}
    anew = any(each.fault.kind.name == "restarted" for each in acting)  # what it finds it did not command
    blind = {**blind_losses(facts), **({} if anew or facts & _PILOT_FACTS else {PILOT: _NO_PILOT})}
    trace = replace(trace_of(outcome.journal, zero_ns, outcome.end_ns, began), begin_ns=outcome.start_ns, blind=blind)
    vacuous = [
        f"{each.fault} touched nothing" if each.begin_ns != _NEVER else f"{each.fault} never began"
        for each, count in zip(acting, touched)
        if not count
    ]
    vacuous += [str(each) for each in outcome.unread]
    marks = _marks_of_bags(outcome, zero_ns, acting)
    idle = tuple(number for number, count in enumerate(touched) if not count)
    return Played(outcome.journal, trace, tuple(vacuous), tuple(broken), marks, outcome.unread, idle)


_PILOT_FACTS = frozenset(("armed", "mode", "failsafe"))
_NO_PILOT = "armed, flight mode and failsafe: scripted, not recorded"


def _facts_of(fault: Fault) -> Tuple[str, ...]:
    """Return the facts that a fault of a scripted peer changes: what looks at them can fail by it."""
    if fault.kind.name == "storage_full":
        return PEER_FACTS["data_recorder"]
    return PEER_FACTS.get(fault.target.partition("/")[0], ())  # a topic begins with "/"


def _marks_of_bags(outcome: Outcome, zero_ns: int, acting: Sequence[Acting]) -> Tuple[Mark, ...]:
    def seconds(t_ns: int) -> float:
        return (t_ns - zero_ns) / 1e9

    marks: List[Mark] = [
        ("fault", seconds(each.begin_ns), None if each.end_ns is None else seconds(each.end_ns), str(each.fault))
        for each in acting
        if each.begin_ns != _NEVER
    ]
    if outcome.scripted:
        words = f"scripted all along: {', '.join(outcome.scripted)}"
        marks.append(("script", seconds(outcome.start_ns), seconds(outcome.end_ns), words))
    if outcome.counterfactual_ns is not None:
        words = "the recorded vehicle did otherwise"
        marks.append(("counterfactual", seconds(outcome.counterfactual_ns), seconds(outcome.end_ns), words))
    return tuple(marks)


# --- play -------------------------------------------------------------------------------------------------------------


def play(case: Case, options: Options, rules: Optional[Rules] = None) -> Played:
    """Run a case.

    Args:
        case: of a scenario.
        options: of the run.
        rules: to decide by instead of the configuration's, for mutations of the table.

    Raises:
        ConfigError: the configuration has a mistake.
        ReplayError: it cannot be run.
        BagError: a bag cannot be read.
        SimulationError: the scenario does not fit the simulated world.
        JournalError: a journal is damaged.
    """
    return _PLAYERS[case.source](case, options, rules)


def _simulate(case: Case, options: Options, rules: Optional[Rules]) -> Played:
    configuration = configuration_of(case, options)
    missions = missions_of(case, configuration)
    scenario = Scenario(case.description, case.faults, case.requests)
    fly = partial(run, scenario=scenario, seed=case.seed, limit_ns=case.limit_ns, rules=rules)
    keys, blind = _decided_keys(case, options, rules)
    result = fly(configuration, missions, watch=keys.followed)
    began = _beginnings(case, result.history)
    vacuous = [f"{fault} did nothing: it never began" for fault, t in zip(case.faults, began) if t is None]
    places = {each.place for each in result.history}
    vacuous += _never_asked(case, [len(case.faults) + number in places for number in range(len(case.requests))])
    if not result.finished:
        vacuous.append(f"the run had not ended after {case.limit_ns / 1e9:g} s of simulated time")

    def same(without: Configuration, _: Sequence[Part]) -> str:
        try:
            other = fly(without, missions_of(case, without))
        except (ReplayError, SimulationError):  # without the key it could not be flown
            return ""
        return "the simulated flight is the same without it" if other.lines[1:] == result.lines[1:] else ""

    unread = (*blind, *keys.unread(same))
    trace, marks = trace_of(result.lines, 0, None, began), _marks_of_a_simulation(result.history)
    idle = tuple(number for number, t_ns in enumerate(began) if t_ns is None)
    return Played(result.lines, trace, (*vacuous, *map(str, unread)), (), marks, unread, idle)


def _decided_keys(case: Case, options: Options, rules: Optional[Rules]) -> Tuple[DecidedKeys, Tuple[Unread, ...]]:
    """Return what follows the changed keys where there is no recording, and what cannot be followed."""
    folder, given, blind = _followed(case, options) if rules is None else (_folder(case, options), (), ())
    return DecidedKeys(given, lambda some: load_configuration(folder, some)), blind


def _beginnings(case: Case, history: Tuple[Happened, ...]) -> Tuple[Optional[int], ...]:
    """Return when each fault began; None: never."""
    times = {each.place: each.t_ns for each in reversed(history)}
    return tuple(times.get(place) for place in range(len(case.faults)))


def _marks_of_a_simulation(history: Tuple[Happened, ...]) -> Tuple[Mark, ...]:
    marks: List[Mark] = []
    for number, (t_ns, text, place) in enumerate(history):
        kind, _, what = text.partition(": ")
        if kind == "fault begins":
            ends = (each.t_ns for each in history[number + 1 :] if each.place == place)
            end_ns = next(ends, None)
            marks.append(("fault", t_ns / 1e9, None if end_ns is None else end_ns / 1e9, what))
        elif kind == "the user asks":
            marks.append(("user", t_ns / 1e9, t_ns / 1e9, what))
    return tuple(marks)


def _decide_again(case: Case, options: Options, rules: Optional[Rules]) -> Played:
    """Decide a journal again, by its own rules unless the scenario or the run names a configuration."""
    (journal, *more) = read_journals(case.journal, memory=case.memory) if case.journal is not None else ()
    if more:
        raise ReplayError(f"{case.journal}: holds several journals; take one of them")
    named = options.configuration or options.overrides or case.configuration is not None or case.overrides
    keys, blind = _decided_keys(case, options, rules)
    configuration = configuration_of(case, options) if rules is None and named else None
    rules = rules_of(journal.lines[0], rules if configuration is None else configuration.rules)
    header = _header_again(journal.lines[0].payload, rules, configuration)
    lines = [header, *_decided((line.payload for line in journal.lines), keys.followed(rules))]
    broken = (f"{case.journal}: the end of the journal is cut off",) if journal.truncated else ()
    unread = (*blind, *keys.unread(unread_in_journal))
    return Played(tuple(lines), trace_of(lines), tuple(map(str, unread)), broken, unread=unread)


def _header_again(old: object, rules: Rules, configuration: Optional[Configuration]) -> str:
    """Return a journal's header with the rules that it is decided by now: the laws are checked by them, too."""
    told: Dict[str, Any] = dict(old) if isinstance(old, dict) else {}
    if configuration is not None:
        told.update(configuration=configuration.effective, hash=configuration.hash)
    said = make_header(rules, told.get("configuration", {}), told.get("hash", ""))
    return encode_header({**told, **said})


def _decide_events(case: Case, options: Options, rules: Optional[Rules]) -> Played:
    """Decide the events that stand in the scenario itself."""
    try:
        payloads = [decode(text, number).payload for number, text in enumerate(case.events, 1)]
    except JournalError as error:
        raise ReplayError(f"{case.path}: events, {error}") from error
    keys, blind = _decided_keys(case, options, rules)
    configuration = configuration_of(case, options)
    rules = replace(configuration.rules if rules is None else rules, checks=case.checks)
    header = encode_header(make_header(rules, configuration.effective, configuration.hash, program="amaze-replay"))
    lines = [header, *_decided(payloads, keys.followed(rules))]
    unread = (*blind, *keys.unread(unread_in_journal))
    return Played(tuple(lines), trace_of(lines), tuple(map(str, unread)), unread=unread)


def _decided(payloads: Iterable[object], rules: Rules) -> List[str]:
    """Return the lines of events and of what is decided about them; decisions among them are left out."""
    state = EngineState()
    lines: List[str] = []
    for event in payloads:
        if isinstance(event, Event):
            if isinstance(event, EngineStarted) and not event.resumed:
                state = EngineState()
            lines.append(encode_event(event))
            state, commands = decide(state, event, rules)
            lines += [encode_decision(each) for each in commands if isinstance(each, Decision)]
    return lines


_Player = Callable[[Case, Options, Optional[Rules]], Played]
_PLAYERS: Mapping[str, _Player] = {
    SourceKind.SIMULATION: _simulate,
    SourceKind.JOURNAL: _decide_again,
    SourceKind.EVENTS: _decide_events,
    SourceKind.BAGS: replay_case,
}
