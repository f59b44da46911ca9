"""The recorded watchdog and landing detection, where their judgement is made anew from the recording's sensors.

What they said does not decide then, but three things of it count:

* that they spoke: a watchdog that fell silent in flight, or whose loop stood, is silent in the replay as well;
* what they said of components of which the recording has no topic: nobody else can tell;
* whether it is what the sensors say: where it differs for more than a second, both words are said, with the times.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Dict, Iterable, List, Mapping, Optional, Set, Tuple

from amaze_autonomy.engine.events import ComponentStatus, Landed, WatchdogAction, WatchdogInfo
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.engine.state import evolve

from ..plan import Plan
from ..recordings.sources import Recordings
from ..timeline import Say, Source

_S = 1_000_000_000
_STANDS_NS = 3 * _S // 2  # shorter than that both may be right: one saw it a moment before the other
_SILENT_NS = 4 * _S // 10
COMPARED: Mapping[str, Tuple[str, ...]] = {
    "watchdog_action": ("loop_counter", "components"),
    "watchdog_info": ("components",),
    "landing_detection": ("landed",),
}
"""Fields of a status that are looked at although it does not decide."""

_NODES: Mapping[str, str] = {"watchdog_action": "watchdog", "landing_detection": "landing_detection"}


@dataclass(frozen=True)
class Disagreement:
    """A time in which a recorded node said something else than the recorded sensors.

    Args:
        about: a component, or "landing detection".
        from_ns: when it began.
        to_ns: when it ended, or the recording did.
        recorded: what the node said.
        judged: what the sensors say.
    """

    about: str
    from_ns: int
    to_ns: int
    recorded: str
    judged: str


@dataclass
class _Pair:
    """What both said last; `since_ns` and `differed`: from when on something else, and what, when it began."""

    recorded: str = ""
    judged: str = ""
    since_ns: Optional[int] = None
    differed: Tuple[str, str] = ("", "")
    said: bool = False


class RecordedNodes:
    """What the nodes of the recorded flight said, beside what is judged now.

    Args:
        plan: of the replay.
        recordings: open.
        say: writes a line of the timeline.

    Attributes:
        foreign: what the recorded watchdog said of components of which the recording has no topic, by name.
        told: the names of all of them that it ever said a word of.
        disagreements: that have ended.
    """

    def __init__(self, plan: Plan, recordings: Recordings, say: Say) -> None:
        self._plan, self._say, self._end_ns = plan, say, recordings.end_ns
        self._own = frozenset(spec.name for spec in plan.components)
        self._times: Dict[str, List[int]] = {}
        self._muted: List[str] = []
        for name, node in _NODES.items():
            topic = plan.topic_map.statuses.get(name)
            if node in plan.judged and topic is not None:
                self._times[name] = recordings.times(recordings.topics.index(topic)).tolist()
                self._muted += [name] if topic in recordings.muted else []
        self._limit_ns = {name: _limit_ns(times) for name, times in self._times.items()}
        self._loop_counter: Optional[int] = None
        self._stands = False
        self._pairs: Dict[str, _Pair] = {}
        self.foreign: Dict[str, ComponentStatus] = {}
        self.told: Set[str] = set()
        self.disagreements: List[Disagreement] = []

    @property
    def compared(self) -> Tuple[str, ...]:
        """The nodes whose words were heard and compared."""
        return tuple(node for name, node in _NODES.items() if self._times.get(name))

    def compares(self, name: str) -> bool:
        """Return True when a recorded status of a map is compared and does not decide."""
        node = "watchdog" if name.startswith("watchdog") else name
        return node in self._plan.judged

    def speaks(self, name: str, t_ns: int) -> bool:
        """Return False while the recorded node was silent, or its loop stood: so is the one that judges anew."""
        if name in self._muted or (name == "watchdog_action" and self._stands):
            return False
        times = self._times.get(name)
        if not times or t_ns <= times[0]:
            return True
        place = bisect_right(times, t_ns)
        if times[place - 1] == t_ns:
            return True
        limit_ns = self._limit_ns[name]
        next_ns = times[place] if place < len(times) else self._end_ns
        return next_ns - times[place - 1] <= limit_ns

    def beats(self, action: WatchdogAction) -> bool:
        """Take a recorded heartbeat; return False when its loop stands."""
        known, self._loop_counter = self._loop_counter, action.loop_counter
        self._stands = known is not None and action.loop_counter == known
        return not self._stands

    # --- components without a topic -----------------------------------------------------------------------------------

    def take_foreign(self, components: Iterable[ComponentStatus], *, whole: bool) -> bool:
        """Take what the recorded watchdog says of others; return True when it is something new.

        Args:
            components: as recorded.
            whole: all of them; else those at 4 and above.
        """
        others = {each.name: each for each in components if each.name not in self._own}
        self.told.update(others)
        kept = {} if whole else {name: each for name, each in self.foreign.items() if each.code < Code.INCONVENIENT}
        before, self.foreign = self.foreign, {**kept, **others}
        return before != self.foreign

    def merged_action(self, action: WatchdogAction) -> WatchdogAction:
        """Return an action with what is bad of the others in it."""
        bad = tuple(each for each in self.foreign.values() if each.code >= Code.INCONVENIENT)
        if not bad:
            return action
        code = max(action.code, *(each.code for each in bad))
        latest = action.latest_component or bad[0].name
        return evolve(action, code=code, latest_component=latest, components=(*action.components, *bad))

    def merged_info(self, info: WatchdogInfo) -> WatchdogInfo:
        """Return an info with the others in it."""
        if not self.foreign:
            return info
        return evolve(info, components=(*info.components, *self.foreign.values()))

    # --- comparison ---------------------------------------------------------------------------------------------------

    def hear(self, t_ns: int, components: Iterable[ComponentStatus]) -> None:
        """Take what the recorded watchdog says of the components that are judged."""
        for each in components:
            if each.name in self._own:
                self._pair(each.name).recorded = _words(each)
                self._compare(t_ns, each.name)

    def judge(self, t_ns: int, components: Iterable[ComponentStatus]) -> None:
        """Take what is judged of the components."""
        for each in components:
            self._pair(each.name).judged = _words(each)
            self._compare(t_ns, each.name)

    def hear_landed(self, t_ns: int, landed: Landed) -> None:
        """Take what the recorded landing detection says."""
        self._pair("landing detection").recorded = landed.name
        self._compare(t_ns, "landing detection")

    def judge_landed(self, t_ns: int, landed: Landed) -> None:
        """Take what is judged of the ground."""
        self._pair("landing detection").judged = landed.name
        self._compare(t_ns, "landing detection")

    def end(self, t_ns: int) -> None:
        """End all disagreements with the recording."""
        for about in self._pairs:
            self._agree(t_ns, about)

    def _pair(self, about: str) -> _Pair:
        return self._pairs.setdefault(about, _Pair())

    def _compare(self, t_ns: int, about: str) -> None:
        pair = self._pairs[about]
        if not pair.recorded or not pair.judged:
            return
        if pair.recorded == pair.judged:
            self._agree(t_ns, about)
        elif pair.since_ns is None:
            pair.since_ns, pair.differed = t_ns, (pair.recorded, pair.judged)
        elif not pair.said and t_ns - pair.since_ns >= _STANDS_NS:
            pair.said = True
            words = f"in flight {about} was {pair.recorded}, by the recorded sensors it is {pair.judged}"
            self._say(t_ns, Source.BAG, words, 1)

    def _agree(self, t_ns: int, about: str) -> None:
        pair = self._pairs[about]
        if pair.since_ns is not None and t_ns - pair.since_ns >= _STANDS_NS:
            self.disagreements.append(Disagreement(about, pair.since_ns, t_ns, *pair.differed))
            if pair.recorded == pair.judged:
                self._say(t_ns, Source.BAG, f"{about} is {pair.judged}, as in flight", 0)
        pair.since_ns, pair.said = None, False


def _limit_ns(times: List[int]) -> int:
    """Return the silence that is none of a node's own period any more."""
    gaps = sorted(after - before for before, after in zip(times, times[1:]))
    return max(_SILENT_NS, 2 * gaps[len(gaps) // 2]) if gaps else _SILENT_NS


def _words(status: ComponentStatus) -> str:
    return f"code {int(status.code)}"
