"""The monitors of a replay and the feeds that fill them: what the vehicle's own nodes would have known."""

from __future__ import annotations

from bisect import bisect_left
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.engine.events import Landed, VehicleLanded, WatchdogAction, WatchdogInfo
from amaze_autonomy.monitoring.battery import BatteryMonitor
from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.landing import LandingDetector, LandingVerdict
from amaze_autonomy.monitoring.restart import RestartRequest
from amaze_autonomy.monitoring.specs import RangeSource
from amaze_autonomy.monitoring.state_estimation import StateEstimationMonitor, StateVerdict
from amaze_autonomy.monitoring.watchdog import Watchdog

from ...engine.events import Check
from ...monitoring.watchdog import Streams
from ..agenda import Turns
from ..errors import FieldError, MisfitError
from ..plan import Plan
from ..recordings.fields import Track, kind_of
from .feeds import (
    FACTS,
    BatteryFeed,
    ComponentFeed,
    EstimateFeed,
    Fact,
    FactFeed,
    Feed,
    HealthFeed,
    ImuFeed,
    RangeFeed,
    TiltFeed,
)
from .monitor_columns import unsure_looks

_S = 1_000_000_000
_FACT_AGE_NS = 1 * _S
_BATTERY_AGE_NS = 5 * _S
_TOUCH_M = 0.15
_VEHICLE: Mapping[Landed, VehicleLanded] = {
    Landed.UNKNOWN: VehicleLanded.UNKNOWN,
    Landed.ON_GROUND: VehicleLanded.ON_GROUND,
    Landed.AIRBORNE: VehicleLanded.IN_AIR,
}


_MONITOR: Mapping[type, type] = {
    ComponentFeed: Watchdog,
    HealthFeed: Watchdog,
    RangeFeed: LandingDetector,
    TiltFeed: LandingDetector,
    ImuFeed: StateEstimationMonitor,
    EstimateFeed: StateEstimationMonitor,
    BatteryFeed: BatteryMonitor,
    FactFeed: BatteryMonitor,  # facts of the vehicle, as the battery's are
}


class Light(NamedTuple):
    """How messages of a topic are taken by their numbers alone.

    Args:
        counters: take the time of each.
        readers: take the time and some of the numbers.
        paths: of the numbers.
    """

    counters: Tuple[Callable[[int], None], ...]
    readers: Tuple[Tuple[Callable[[int, Tuple[Any, ...]], None], slice], ...]
    paths: Tuple[str, ...]


class Monitors:
    """Watchdog, landing detection, state check and battery; None where the recording has nothing for one.

    Args:
        plan: of the replay.
        periods_ns: of topics that tell facts of the vehicle: one that comes every 2.5 s is not silent in between.
    """

    def __init__(self, plan: Plan, periods_ns: Optional[Mapping[str, int]] = None) -> None:
        self._plan = plan
        self._periods_ns = dict(periods_ns or {})
        self._watchdog = Watchdog(plan.components)
        self._streams = Streams(self._watchdog, round(_S / plan.streams.watchdog_action_rate_hz))
        self._landing = LandingDetector(plan.landing) if plan.landing is not None else None
        self._state = StateEstimationMonitor(plan.state_estimation) if plan.state_estimation is not None else None
        self._battery = BatteryMonitor(plan.battery) if plan.battery is not None else None
        self._facts: Dict[str, Fact] = {}
        self.feeds: Tuple[Feed, ...] = tuple(self._made_feeds())
        self._by_topic: Dict[str, List[Feed]] = {}
        for feed in self.feeds:
            self._by_topic.setdefault(feed.topic, []).append(feed)
        self.now: Tuple[int, int] = (0, 0)
        self._riding: Dict[type, List[Feed]] = {}
        self._counters: Tuple[ComponentFeed, ...] = ()
        self._foreseen = False
        self._rests_ns = 0
        self._unsure: Optional[List[int]] = None

    def ride(self, tracks: Mapping[int, Track], topics: Sequence[str]) -> Tuple[int, ...]:
        """Take topics from tracks, as far as can be, instead of message by message; return the ranks of these.

        Whoever asks a monitor then gives it first what has come before `now`.
        """
        names = {topics[rank]: rank for rank in tracks}
        together = {feed.topic for feed in self.feeds if isinstance(feed, (RangeFeed, TiltFeed))}
        if not together <= names.keys():  # one would be ahead of the other
            names = {name: rank for name, rank in names.items() if name not in together}
        for name, rank in names.items():
            first = 0
            for feed in self._by_topic.get(name, ()):
                count = len(feed.paths) if feed.decodes else 0
                feed.ride(tracks[rank].part(first, first + count), rank)
                first += count
                self._riding.setdefault(_MONITOR[type(feed)], []).append(feed)
        self._pair(names)
        watching = [feed for feed in self.feeds if _MONITOR[type(feed)] is Watchdog]
        self._counters = tuple(feed for feed in watching if isinstance(feed, ComponentFeed))
        self._foreseen = all(feed.topic in names for feed in watching)
        return tuple(names.values())

    def _pair(self, names: Mapping[str, int]) -> None:
        """Let the range take the tilt of its time, before the tilt itself goes on to now."""
        tilt = next((feed for feed in self.feeds if isinstance(feed, TiltFeed) and feed.topic in names), None)
        for feed in self.feeds:
            if isinstance(feed, RangeFeed):
                feed.tilt = tilt
        for feeds in self._riding.values():
            feeds.sort(key=lambda feed: isinstance(feed, TiltFeed))

    def poll(self, t_ns: int, left_out: int) -> Tuple[Optional[WatchdogAction], Optional[WatchdogInfo]]:
        """Turn the watchdog's loop, after some turns that were left out; return the messages that are due."""
        watchdog = self._watchdog
        if watchdog.disturbed or not t_ns < self._rests_ns or watchdog.next_ns != self._rests_ns:
            self._caught_up(Watchdog)
            self._rests_ns = 0
        watchdog.loop_counter += left_out
        return self._streams.poll(t_ns)

    def restart_requests(self) -> Tuple[RestartRequest, ...]:
        """Return the restarts to be made now, each once."""
        return self._watchdog.restart_requests()

    def next_poll_ns(self, t_ns: int) -> int:
        """Return when the watchdog's loop must turn again, unless it is asked something before.

        While all is as intended the tracks tell when that can end; until then nobody need look at them.
        """
        watchdog = self._watchdog
        if not watchdog.started:
            return FOREVER_NS
        if watchdog.disturbed or not self._foreseen:
            return t_ns
        if t_ns < self._rests_ns:
            return min(self._streams.due_ns, self._rests_ns)
        changes_ns = min((feed.changes_ns() for feed in self._counters), default=FOREVER_NS)
        if watchdog.steady and all(feed.steady for feed in self._counters):
            self._rests_ns = changes_ns
            watchdog.rest(changes_ns)
        return min(self._streams.due_ns, changes_ns, watchdog.next_ns)

    def unsure_ns(self, t_ns: int, looks: Turns) -> int:
        """Return the first look from a time on, at which not every row of the state check surely passes."""
        feeds = [feed for feed in self.feeds if _MONITOR[type(feed)] is StateEstimationMonitor]
        if self._state is None or any(feed not in self._riding.get(StateEstimationMonitor, ()) for feed in feeds):
            return t_ns
        if self._unsure is None:
            self._unsure = self._unsure_looks(self._state, looks)
        place = bisect_left(self._unsure, t_ns)
        unsure_ns = self._unsure[place] if place < len(self._unsure) else t_ns
        return min([unsure_ns, *(feed.changes_ns() for feed in feeds if isinstance(feed, EstimateFeed))])

    def _unsure_looks(self, state: StateEstimationMonitor, looks: Turns) -> List[int]:
        imu = next((feed for feed in self.feeds if isinstance(feed, ImuFeed)), None)
        estimate = next((feed for feed in self.feeds if isinstance(feed, EstimateFeed)), None)
        last_ns = max((feed.track.listed[-1] for feed in (imu, estimate) if feed and len(feed.track)), default=0)
        times: Any = np.arange(looks.first_ns, last_ns + looks.period_ns, looks.period_ns)
        unsure = unsure_looks(
            times,
            state.spec,
            None if imu is None else imu.track,
            1.0 if imu is None else imu.scale,
            None if estimate is None else estimate.track,
        )
        found: List[int] = times[unsure].tolist()
        return [*found, *times[-1:].tolist()]

    def _caught_up(self, monitor: type) -> None:
        for feed in self._riding.get(monitor, ()):
            feed.until(self.now)

    @property
    def watchdog(self) -> Watchdog:
        """The watchdog as of now."""
        self._caught_up(Watchdog)
        return self._watchdog

    @property
    def streams(self) -> Streams:
        """Its streams as of now."""
        self._caught_up(Watchdog)
        return self._streams

    @property
    def landing(self) -> Optional[LandingDetector]:
        """The landing detection as of now; None when the recording has no range."""
        self._caught_up(LandingDetector)
        return self._landing

    @property
    def state(self) -> Optional[StateEstimationMonitor]:
        """The state check as of now; None when the recording has neither IMU nor estimate."""
        self._caught_up(StateEstimationMonitor)
        return self._state

    @property
    def battery(self) -> Optional[BatteryMonitor]:
        """The battery as of now; None when the recording has none."""
        self._caught_up(BatteryMonitor)
        return self._battery

    def takes(self, topic: str) -> bool:
        """Return True when somebody uses a topic."""
        return topic in self._by_topic

    def decodes(self, topic: str) -> bool:
        """Return True when somebody looks into the messages of a topic."""
        return any(feed.decodes for feed in self._by_topic.get(topic, ()))

    def paths(self, topic: str) -> Optional[Tuple[str, ...]]:
        """Return the fields of a topic that somebody looks at; "" is all of them; None: nobody uses the topic."""
        feeds = self._by_topic.get(topic)
        if feeds is None:
            return None
        return tuple(path for feed in feeds if feed.decodes for path in feed.paths or ("",))

    def light(self, topic: str) -> Optional[Light]:
        """Return how messages of a topic are taken by their numbers alone; None when somebody needs whole ones."""
        feeds = self._by_topic.get(topic, ())
        if not all(feed.paths for feed in feeds if feed.decodes):
            return None
        counters = tuple(feed.count for feed in feeds if isinstance(feed, ComponentFeed))
        readers: List[Tuple[Callable[[int, Tuple[Any, ...]], None], slice]] = []
        paths: List[str] = []
        for feed in feeds:
            if feed.decodes:
                readers.append((feed.take_values, slice(len(paths), len(paths) + len(feed.paths))))
                paths += feed.paths
        return Light(counters, tuple(readers), tuple(paths))

    def take(self, topic: str, t_ns: int, message: Optional[Any]) -> None:
        """Give a message to all that use its topic; one that is None came, but nothing can be read from it.

        Raises:
            FieldError: The map names a field that the message does not have.
            MisfitError: The message is not what the map takes it for.
        """
        for feed in self._by_topic.get(topic, ()):
            if message is not None or not feed.decodes:
                try:
                    feed.take(t_ns, message)
                except FieldError as error:
                    raise FieldError(f"{topic}: {error.path}", error.kind, error.known) from None
                except (AttributeError, IndexError, TypeError) as error:
                    raise MisfitError(topic, kind_of(message), str(error)) from error

    def check_ground(self, t_ns: int) -> Optional[Tuple[Check, ...]]:
        """Return the rows of the landing detection; None when the recording has no range."""
        landing = self.landing
        return None if landing is None else landing.checks(t_ns)

    def check_state(self, t_ns: int) -> Optional[StateVerdict]:
        """Return the verdict on the states; None when the recording has neither IMU nor estimate."""
        state = self.state
        return None if state is None else state.check(t_ns)

    def judge_landing(self, t_ns: int) -> Optional[LandingVerdict]:
        """Return the judgement of the landing detection; None when the recording has no range."""
        landing = self.landing
        return None if landing is None else landing.evaluate(t_ns)

    def facts(self, t_ns: int, *, flown: bool) -> Dict[str, Any]:
        """Return what the recording tells of the vehicle now, by name; None: it should, but it is silent.

        Args:
            t_ns: now.
            flown: the engine has commanded a takeoff; only then does a height say anything of the ground.
        """
        self._caught_up(BatteryMonitor)
        told: Dict[str, Any] = {}
        readings = self._plan.topic_map.readings
        for name in FACTS:
            if name in readings:
                fact = "height_m" if name == "height" else name
                told[fact] = self._fresh(fact, t_ns, self._age_limit_ns(readings[name].topic, _FACT_AGE_NS))
        if "battery" in readings:
            limit_ns = self._age_limit_ns(readings["battery"].topic, _BATTERY_AGE_NS)
            told["battery_fraction"] = self._fresh("battery_fraction", t_ns, limit_ns)
            told["battery_voltage_v"] = self._fresh("battery_voltage_v", t_ns, limit_ns)
        self._tell_landed(told, t_ns, flown=flown)
        return told

    def _tell_landed(self, told: Dict[str, Any], t_ns: int, *, flown: bool) -> None:
        verdict = self.judge_landing(t_ns)
        if verdict is not None:
            told.setdefault("height_m", verdict.distance_m)
        if "landed" in told:
            told["landed"] = told["landed"] or VehicleLanded.UNKNOWN
        elif verdict is not None:
            told["landed"] = _VEHICLE[verdict.landed]
        elif "height_m" in told and flown:
            height = told["height_m"]
            low = height is not None and height <= _TOUCH_M
            told["landed"] = VehicleLanded.ON_GROUND if low else VehicleLanded.IN_AIR

    def _age_limit_ns(self, topic: str, least_ns: int) -> int:
        return max(least_ns, 3 * self._periods_ns.get(topic, 0))

    def _fresh(self, name: str, t_ns: int, limit_ns: int) -> Any:
        fact = self._facts.get(name)
        return fact.value if fact is not None and t_ns - fact.t_ns <= limit_ns else None

    def _made_feeds(self) -> List[Feed]:
        readings = self._plan.topic_map.readings
        feeds: List[Feed] = [
            ComponentFeed(self._watchdog, spec.name, topic.topic, topic.period_ns)
            for spec in self._plan.components
            for topic in spec.topics
        ]
        told = self._plan.topic_map.statuses.get("autopilot")
        if told is not None and any(spec.autopilot is not None for spec in self._plan.components):
            feeds.append(HealthFeed(self._watchdog, told))
        if self._landing is not None:
            feeds.append(RangeFeed(self._landing, readings["range"], self._plan.topic_map.landing))
        tilts = "orientation" in (readings["imu"].fields if "imu" in readings else {})
        # a height is along the vertical already, a range along the vehicle's z axis
        if self._landing is not None and tilts and self._landing.spec.source is not RangeSource.POSE:
            feeds.append(TiltFeed(self._landing, readings["imu"]))
        if self._state is not None and "imu" in readings:
            feeds.append(ImuFeed(self._state, readings["imu"]))
        if self._state is not None and "estimate" in readings:
            feeds.append(EstimateFeed(self._state, readings["estimate"]))
        if self._battery is not None:
            feeds.append(BatteryFeed(self._battery, readings["battery"], self._facts))
        feeds += [FactFeed(name, readings[name], self._facts) for name in FACTS if name in readings]
        return feeds
