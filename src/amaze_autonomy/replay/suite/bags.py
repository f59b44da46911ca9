"""Plays a case on bags: the part of the recording, with its faults, through the replay's session."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

from amaze_autonomy.engine.events import UserCommand
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.severity import ComponentRule
from amaze_autonomy.simulation import Fault, Subject, Trigger

from ..errors import DamagedInputError, ReplayError
from ..expect.pattern import Pattern, instants
from ..expect.trace import Trace, trace_of
from ..faults.acting import Acting
from ..faults.kinds import TOPIC
from ..faults.story import Story
from ..faults.stream import FaultedRecordings
from ..opening import topics_of
from ..plan import Plan, make_plan
from ..scenario.model import Case
from ..scenario.places import meant, place_of
from ..session import Outcome, Session
from ..sources import Recordings
from ..topic_map import TopicMap, load_map, map_names
from .played import Mark, Played, configuration_of, missions_of
from .task import Options

__all__ = ["replay_case"]

_S = 1_000_000_000
_BLOCK = 1 << 20


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
    plan = make_plan(configuration, topic_map, missions[0].id, topics_of(paths))
    if rules is not None:
        plan = replace(plan, rules=replace(rules, components=_rows(plan.rules, rules)))
    with Recordings(paths, plan.topics) as recordings:
        part = FaultedRecordings(recordings, case.from_ns, case.to_ns)
        if not part.samples:
            place = place_of(case.path, ("from_s",), ("to_s",), ("bags",))
            raise ReplayError(f"{place}: there is no message between from_s and to_s")
        broken = _needs(case, part)
        acting, requests = _times(case, plan, part)
        part.apply(acting, case.seed)
        story = Story(acting, requests)
        outcome = Session(plan, part, story).run()
        touched = [one + other for one, other in zip(part.touched, story.touched)]
        broken += [
            f"{each.topic}: {each.count} messages cannot be read ({each.reason})" for each in part.damage.values()
        ]
    return _played(outcome, acting, touched, broken)


def _rows(own: Rules, other: Rules) -> Tuple[ComponentRule, ...]:
    """Return the rows of other rules, and of the map's components that they do not have."""
    names = [row.name for row in other.components]
    return (*other.components, *(row for row in own.components if row.name not in names))


def _check_bags(case: Case) -> None:
    for bag in case.bags:
        if not bag.path.is_file():
            raise DamagedInputError(f"{bag.path}: is not there; the scenario needs it{_hint(bag.path)}")
        if bag.sha256 and _sha256(bag.path) != bag.sha256:
            raise DamagedInputError(f"{bag.path}: is another file than the scenario was written for (sha256 differs)")


def _hint(path: Path) -> str:
    return f" (is {path.parts[0][2:-1]} set?)" if path.parts[0].startswith("${") else ""


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        for block in iter(lambda: file.read(_BLOCK), b""):
            digest.update(block)
    return digest.hexdigest()


def _map(case: Case) -> TopicMap:
    name = case.topic_map or case.bags[0].path.stem
    if not case.topic_map and name not in map_names():
        raise ReplayError(f"{case.path}: which topics are what? Name a topic map with map: {', '.join(map_names())}")
    if name not in map_names() and not Path(name).is_file():
        place = place_of(case.path, ("map",), ("matrix", "map"))
        raise ReplayError(f"{place}: map: {name} is no topic map and no file; {meant(name, map_names())}")
    return load_map(name)


def _needs(case: Case, part: FaultedRecordings) -> List[str]:
    """Return which needs the recording does not meet, before any fault."""
    figures = {each.topic: each for each in part.figures()}
    broken: List[str] = []
    for need in case.needs:
        found = figures.get(need.topic)
        if found is None or not found.messages:
            right = meant(need.topic, (topic for topic in figures if figures[topic].messages))
            broken.append(
                f"{need.topic}: is needed, and the map does not read it or the recording does not have it; {right}"
            )
            continue
        rate_hz, gap_s = found.rate_hz or 0.0, found.longest_gap_s or 0.0
        if rate_hz < need.rate_hz:
            broken.append(f"{need.topic}: {rate_hz:.2f} Hz, at least {need.rate_hz:g} Hz are needed")
        if need.gap_ns is not None and gap_s * _S > need.gap_ns:
            broken.append(f"{need.topic}: silent for {gap_s:.3f} s, at most {need.gap_ns / _S:g} s are allowed")
    return broken


def _times(
    case: Case, plan: Plan, part: FaultedRecordings
) -> Tuple[Tuple[Acting, ...], Tuple[Tuple[int, UserCommand], ...]]:
    """Return faults and requests with their times; `after` is looked up in the same run without any fault."""
    triggers = (*(fault.trigger for fault in case.faults), *(request.trigger for request in case.requests))
    calm: Optional[Trace] = None
    if any(trigger.at_ns is None for trigger in triggers):
        calm = trace_of(Session(plan, part).run().journal, part.start_ns, part.end_ns)
    acting: List[Acting] = []
    for fault in case.faults:
        begin_ns = _begin(case, fault.trigger, part.start_ns, calm, str(fault))
        end_ns = None if fault.for_ns is None or begin_ns is None else begin_ns + fault.for_ns
        acting.append(Acting(fault, _NEVER if begin_ns is None else begin_ns, end_ns, _topics_of(fault, plan)))
    requests: List[Tuple[int, UserCommand]] = []
    for request in case.requests:
        t_ns = _begin(case, request.trigger, part.start_ns, calm, str(request))
        if request.command is None:
            raise ReplayError(f"{case.path}: {request}: a replay selects its mission by `missions`")
        if t_ns is not None:
            requests.append((t_ns, request.command))
    return tuple(acting), tuple(requests)


_NEVER = 1 << 62


def _begin(case: Case, trigger: Trigger, start_ns: int, calm: Optional[Trace], what: str) -> Optional[int]:
    if trigger.at_ns is not None:
        return start_ns + trigger.at_ns
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


def _played(outcome: Outcome, acting: Sequence[Acting], touched: Sequence[int], broken: Sequence[str]) -> Played:
    began = tuple(None if each.begin_ns == _NEVER else each.begin_ns for each in acting)
    trace = trace_of(outcome.journal, outcome.start_ns, outcome.end_ns, began)
    vacuous = [
        f"{each.fault} touched nothing" if each.begin_ns != _NEVER else f"{each.fault} never began"
        for each, count in zip(acting, touched)
        if not count
    ]
    return Played(outcome.journal, trace, tuple(vacuous), tuple(broken), _marks(outcome, acting))


def _marks(outcome: Outcome, acting: Sequence[Acting]) -> Tuple[Mark, ...]:
    def seconds(t_ns: int) -> float:
        return (t_ns - outcome.start_ns) / 1e9

    marks: List[Mark] = [
        ("fault", seconds(each.begin_ns), None if each.end_ns is None else seconds(each.end_ns), str(each.fault))
        for each in acting
        if each.begin_ns != _NEVER
    ]
    if outcome.counterfactual_ns is not None:
        words = "the recorded vehicle did otherwise"
        marks.append(("counterfactual", seconds(outcome.counterfactual_ns), seconds(outcome.end_ns), words))
    return tuple(marks)
