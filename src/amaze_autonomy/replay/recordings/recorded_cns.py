"""What nodes of the CNS Flight Stack said in a recording, as statuses of ours: by the code of the live peers.

Their topics are known by type, those of std_msgs/Bool by type and name. Made are, with the face of a bag:

/cns/watchdog_action, /cns/watchdog_info   of its watchdog's heartbeat and log
/cns/landing_detection                     of its detector's events
/cns/mission_planner                       of its sequencer's answers

A status that the recording has of a node of ours is not made.
"""

from __future__ import annotations

from functools import cached_property
from types import SimpleNamespace
from typing import Any, Dict, FrozenSet, Iterator, List, Mapping, Sequence, Tuple

from amaze_autonomy.bags import Entry
from amaze_autonomy.engine.events import Event, MissionPhase
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.interface import STATUSES, status_of

from ...cns.peers import LandingDetection, Watchdog
from ...cns.sequencer import Sequencer
from ...cns.tables import TOPICS, Answer, Request
from .sources import spans_of
from .telemetry import Made, header, messages_of

_S = 1_000_000_000
_RATE_HZ = 5.0
_PERIOD_NS = round(_S / _RATE_HZ)
_BEATS_MISSED = 2.5  # periods of a watchdog's heartbeat without one: it was silent
_BEAT_NS = 2 * _S  # of a heartbeat that was heard once: the slowest that is known
_EVENT = "std_msgs/Bool"
_PREFIX, _SESSION = "/cns/", "cns-{}"
_Said = Tuple[int, str, Any]
_KINDS: Mapping[str, str] = {f"{_PREFIX}{row.name}": f"amaze_autonomy/{row.shape.message}" for row in STATUSES}

_USES: Mapping[str, str] = {
    "heartbeat": "heartbeat of its watchdog: watchdog_action",
    "log": "entities of its watchdog: watchdog_info and watchdog_action; an error counts as severity high",
    "is_landed": "its landing detector: landing_detection",
    "is_takeoff": "its landing detector: landing_detection",
    "response": "answers of its sequencer: mission_planner",
    "request": "not mapped: each answer says what was asked",
    "waypoint_list": "not mapped: waypoints decide nothing, the phases are those of the answers",
    "waypoint_reached": "not mapped: waypoints decide nothing, the phases are those of the answers",
}
_OTHERS: Mapping[str, str] = {
    "watchdog_msgs/ActionStamped": "not mapped: its watchdog does nothing with what it is asked",
    "mavros_msgs/RCIn": "not mapped: which channel means land stands in its configuration",
}
_SERVICES = "state check, start and stop of the recorder: not mapped, they are services, of which no topic tells"


def _known_topics(bag: Any) -> Tuple[Dict[str, str], Tuple[str, ...]]:
    """Return the topics of a recording that are read, by `cns.tables.TOPICS` key, and those of another definition."""
    found: Dict[str, str] = {}
    others: List[str] = []
    for topic in bag.topics:
        key = next((key for key, known in TOPICS.items() if _is(topic, key, known.type)), None)
        if key is None or not topic.messages:
            continue
        md5s = _md5s(bag, topic.name)
        if md5s - {"", TOPICS[key].md5}:
            others.append(topic.name)
        else:
            found.setdefault(key, topic.name)
    return found, tuple(others)


def _is(topic: Any, key: str, kind: str) -> bool:
    return topic.kind == kind and (kind != _EVENT or topic.name.rpartition("/")[2] == key)


def _md5s(bag: Any, topic: str) -> FrozenSet[str]:
    channels = bag.channels.values() if hasattr(bag, "channels") else bag.links
    return frozenset(each.md5 for each in channels if each.topic == topic)


def said_of_cns(bags: Sequence[Any]) -> List[str]:
    """Return what is made of each topic of the CNS Flight Stack, or why nothing, one line each."""
    lines: List[str] = []
    for bag in bags:
        found, others = _known_topics(bag)
        lines += [f"CNS {topic}: {_USES[key]}" for key, topic in found.items()]
        lines += [f"CNS {topic}: not mapped: its definition is another one than is known" for topic in others]
        lines += [f"CNS {topic.name}: {_OTHERS[topic.kind]}" for topic in bag.topics if topic.kind in _OTHERS]
        if "response" in found:
            missions = sorted({int(each.request.id) for _, each in messages_of(bag, found["response"], [])})
            lines.append(f"CNS missions that were asked for: {', '.join(map(str, missions))} (run --mission)")
        if "log" in found and "heartbeat" not in found:
            lines.append("CNS watchdog: not mapped: without its heartbeat nothing tells that it lives")
    return [*lines, f"CNS {_SERVICES}"]


class CnsStatuses(Made):
    """The statuses that are made of their topics.

    Args:
        source: the recording that has them.
    """

    def __init__(self, source: Any) -> None:
        super().__init__(source.path)
        self._source = source
        found, _ = _known_topics(source)
        unread: List[str] = []
        self._heard = {key: messages_of(source, topic, unread) for key, topic in found.items()}
        #: what is missing, for `sources.problems_of`
        self.problem = "; ".join(unread)
        own = {topic.kind for topic in source.topics}
        for events in (self._watchdog(), self._landings(), self._phases()):
            for event in events:
                row = status_of(event)
                topic = f"{_PREFIX}{row.name}"
                if _KINDS[topic] not in own:
                    self.place(topic, event.t_ns, len(self._statuses))
                    self._statuses.append(row.write(event, lambda _: SimpleNamespace, header=header(event.t_ns)))

    def made(self, topic: str, entry: Entry) -> Any:  # noqa: ARG002 - one list for all topics
        """Return one status."""
        return self._statuses[entry.offset]

    def kind(self, topic: str) -> str:
        """Return the type of a topic."""
        return _KINDS[topic]

    def _messages(self, *keys: str) -> List[_Said]:
        """Return what was said on some topics, in order of time."""
        found = [(t_ns, key, message) for key in keys for t_ns, message in self._heard.get(key, ())]
        return sorted(found, key=lambda each: each[0])

    @cached_property
    def _spans(self) -> List[Tuple[int, int]]:
        return spans_of(self._source)

    def _ticks(self, said: Sequence[_Said]) -> List[_Said]:
        """Return what was said and, without a key, moments at which a status is due, in order of time."""
        moments = [
            (t_ns, "", None) for begin_ns, end_ns in self._spans for t_ns in range(begin_ns, end_ns + 1, _PERIOD_NS)
        ]
        return sorted([*said, *moments], key=lambda each: each[0])

    def _watchdog(self) -> Iterator[Event]:
        """Yield what is said of the components, five times a second while its slow heartbeat is not overdue."""
        beats = self._messages("heartbeat")
        if not beats:
            return
        times = [t_ns for t_ns, _, _ in beats]
        gaps = sorted(after - before for before, after in zip(times, times[1:]))
        limit_ns = round(_BEATS_MISSED * (gaps[len(gaps) // 2] if gaps else _BEAT_NS))
        peer, beat_ns = Watchdog(Rules(), (), _RATE_HZ), times[0] - limit_ns - 1
        for t_ns, key, message in self._ticks(self._messages("heartbeat", "log")):
            if key:
                peer.hear(t_ns, key, message)
            if key == "heartbeat":
                beat_ns = t_ns
            elif t_ns - beat_ns <= limit_ns:
                peer.beat_on(t_ns)
            else:
                continue
            yield from peer.step(t_ns)

    def _landings(self) -> Iterator[Event]:
        """Yield what its detector knew: before its first event the contrary of that."""
        events = [each for each in self._messages("is_landed", "is_takeoff") if each[2].data]
        if not {"is_landed", "is_takeoff"} & self._heard.keys():
            return
        peer = LandingDetection(Rules(), _RATE_HZ)
        if events and events[0][1] == "is_takeoff":  # its service armed it on the ground, of which no topic tells
            peer.returned(self._source.start_ns, "takeoff_check", SimpleNamespace(success=True, message=""), "")
        elif events:
            peer.hear(self._source.start_ns, "is_takeoff", SimpleNamespace(data=True))
        for t_ns, key, message in self._ticks(events):
            if key:
                peer.hear(t_ns, key, message)
            yield from peer.step(t_ns)

    def _phases(self) -> Iterator[Event]:
        """Yield what its sequencer did. It has nothing to load: until it arms, it counts as loaded."""
        answers = self._messages("response")
        if not answers:
            return
        peer, session = Sequencer((), Rules().limits, _RATE_HZ), 1
        first = answers[0][2].request
        begun = MissionPhase.LOADED if first.request in (Request.ARM, Request.TAKEOFF) else MissionPhase.FLYING
        peer.adopt(_SESSION.format(session), int(first.id), begun)
        armed = False
        for t_ns, key, answer in self._ticks(answers):
            if key and _arms(answer):
                session, armed = session + armed, True
                peer.adopt(_SESSION.format(session), int(answer.request.id), MissionPhase.TAKING_OFF)
            if key:
                peer.hear(t_ns, key, answer)
            yield from peer.step(t_ns)


def _arms(answer: Any) -> bool:
    accepted = (bool(answer.response), bool(answer.completed)) == Answer.ACCEPTED.value
    return accepted and answer.request.request == Request.ARM
