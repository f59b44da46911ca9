"""The monitors of a replay and the feeds that fill them: what the vehicle's own nodes would have known."""

from __future__ import annotations

from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.checks import Check
from amaze_autonomy.engine.events import Landed, VehicleLanded
from amaze_autonomy.monitoring.battery import BatteryMonitor
from amaze_autonomy.monitoring.landing import LandingDetector, LandingVerdict
from amaze_autonomy.monitoring.state_estimation import StateEstimationMonitor, StateVerdict
from amaze_autonomy.monitoring.streams import Streams
from amaze_autonomy.monitoring.watchdog import Watchdog

from .errors import FieldError, MisfitError
from .feeds import (
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
from .fields import kind_of
from .plan import Plan

__all__ = ["Light", "Monitors"]

_S = 1_000_000_000
_FACT_AGE_NS = 1 * _S
_BATTERY_AGE_NS = 5 * _S
_TOUCH_M = 0.15
_VEHICLE: Mapping[Landed, VehicleLanded] = {
    Landed.UNKNOWN: VehicleLanded.UNKNOWN,
    Landed.ON_GROUND: VehicleLanded.ON_GROUND,
    Landed.AIRBORNE: VehicleLanded.IN_AIR,
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
    """Watchdog, landing detection, state check and battery; None where the recording has nothing for one."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self.watchdog = Watchdog(plan.components)
        self.streams = Streams(self.watchdog)
        self.landing = LandingDetector(plan.landing) if plan.landing is not None else None
        self.state = StateEstimationMonitor(plan.state_estimation) if plan.state_estimation is not None else None
        self.battery = BatteryMonitor(plan.battery) if plan.battery is not None else None
        self._facts: Dict[str, Fact] = {}
        self.feeds: Tuple[Feed, ...] = tuple(self._made_feeds())
        self._by_topic: Dict[str, List[Feed]] = {}
        for feed in self.feeds:
            self._by_topic.setdefault(feed.topic, []).append(feed)

    def decodes(self, topic: str) -> bool:
        """Return True when somebody looks into the messages of a topic."""
        return any(feed.decodes for feed in self._by_topic.get(topic, ()))

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
        return None if self.landing is None else self.landing.checks(t_ns)

    def check_state(self, t_ns: int) -> Optional[StateVerdict]:
        """Return the verdict on the states; None when the recording has neither IMU nor estimate."""
        return None if self.state is None else self.state.check(t_ns)

    def judge_landing(self, t_ns: int) -> Optional[LandingVerdict]:
        """Return the judgement of the landing detection; None when the recording has no range."""
        return None if self.landing is None else self.landing.evaluate(t_ns)

    def facts(self, t_ns: int, *, flown: bool) -> Dict[str, Any]:
        """Return what the recording tells of the vehicle now, by name; None: it should, but it is silent.

        Args:
            t_ns: now.
            flown: the engine has commanded a takeoff; only then does a height say anything of the ground.
        """
        told: Dict[str, Any] = {}
        readings = self._plan.topic_map.readings
        for name in ("armed", "landed", "height"):
            if name in readings:
                fact = "height_m" if name == "height" else name
                told[fact] = self._fresh(fact, t_ns, _FACT_AGE_NS)
        if "battery" in readings:
            told["battery_fraction"] = self._fresh("battery_fraction", t_ns, _BATTERY_AGE_NS)
            told["battery_voltage_v"] = self._fresh("battery_voltage_v", t_ns, _BATTERY_AGE_NS)
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

    def _fresh(self, name: str, t_ns: int, limit_ns: int) -> Any:
        fact = self._facts.get(name)
        return fact.value if fact is not None and t_ns - fact.t_ns <= limit_ns else None

    def _made_feeds(self) -> List[Feed]:
        readings = self._plan.topic_map.readings
        feeds: List[Feed] = [
            ComponentFeed(self.watchdog, spec.name, topic.topic, topic.period_ns)
            for spec in self._plan.components
            for topic in spec.topics
        ]
        told = self._plan.topic_map.statuses.get("autopilot")
        if told is not None and any(spec.autopilot is not None for spec in self._plan.components):
            feeds.append(HealthFeed(self.watchdog, told))
        if self.landing is not None:
            feeds.append(RangeFeed(self.landing, readings["range"]))
        if self.landing is not None and "orientation" in (readings["imu"].fields if "imu" in readings else {}):
            feeds.append(TiltFeed(self.landing, readings["imu"]))
        if self.state is not None and "imu" in readings:
            spec = self.state.spec
            feeds.append(ImuFeed(self.state.add_imu, readings["imu"], spec.imu_mounting_rpy_rad, spec.gravity_m_s2))
        if self.state is not None and "estimate" in readings:
            feeds.append(EstimateFeed(self.state, readings["estimate"]))
        if self.battery is not None:
            feeds.append(BatteryFeed(self.battery, readings["battery"], self._facts))
        feeds += [
            FactFeed(name, readings[name], self._facts) for name in ("height", "armed", "landed") if name in readings
        ]
        return feeds
