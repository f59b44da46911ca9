"""How a recording begins: on the ground, or in the air; and how the script leads up to it without a jump.

A recording that begins in the air is judged from there. Before its first message the script plays what led to it, as
far as it must have been: selected, checked, taken off, climbed. At the first message the scripted vehicle is as high,
its battery as full and its estimate at the same place as the recorded one is, so that no difference between script and
recording is taken for a motion. Everything of that is scripted, and marked so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.engine.events import AutopilotStatus, Landed, VehicleLanded
from amaze_autonomy.monitoring.landing import LandingDetector

from .errors import ReplayError
from .monitors.feeds import FactFeed, RangeFeed
from .plan import Plan
from .recordings.fields import getter, number
from .recordings.sources import Recordings
from .recordings.statuses import EVENT_OF

_S = 1_000_000_000
_LOOK_NS = 2 * _S
_CRUISE_M = 2.0
_BEFORE_NS, _AFTER_NS = 15 * _S, 5 * _S
ARMING_LEAD_NS = 9 * _S // 2  # from the selection to the takeoff command, with the shipped recording lead
_ON_GROUND = (VehicleLanded.ON_GROUND,)


@dataclass(frozen=True)
class Beginning:
    """The vehicle at the first message of a recording.

    Args:
        t_ns: of that message.
        airborne: it flies.
        height_m: that the recording tells; None: it does not.
        reason: why it is taken to fly, or not.
        armed: the motors are armed.
    """

    t_ns: int
    airborne: bool
    height_m: Optional[float] = None
    reason: str = ""
    armed: Optional[bool] = None


@dataclass(frozen=True)
class Lead:
    """What the script plays before a recording that begins in the air.

    Args:
        begin_ns: when the mission is selected.
        end_ns: when the recording begins.
        height_m: of the vehicle then.
        takeoff_height_m: that it must have reached before.
    """

    begin_ns: int
    end_ns: int
    height_m: float
    takeoff_height_m: float

    def height_at(self, t_ns: int, takeoff_ns: Optional[int]) -> float:
        """Return how high the scripted vehicle is: it climbs in time, and is at the recorded height at the end."""
        if t_ns >= self.end_ns:
            return self.height_m
        if takeoff_ns is None or t_ns <= takeoff_ns:
            return 0.0
        top_m = max(self.height_m, 1.2 * self.takeoff_height_m)
        turn_ns = max(takeoff_ns + _S, self.end_ns - _LOOK_NS)
        if t_ns < turn_ns:
            return min(top_m, top_m * 1.25 * (t_ns - takeoff_ns) / (turn_ns - takeoff_ns))
        return top_m + (self.height_m - top_m) * (t_ns - turn_ns) / max(1, self.end_ns - turn_ns)

    def share(self, t_ns: int) -> float:
        """Return how much of the lead is still to come, from 1 to 0."""
        return min(1.0, max(0.0, (self.end_ns - t_ns) / max(1, self.end_ns - self.begin_ns)))


def beginning_of(plan: Plan, recordings: Recordings) -> Beginning:
    """Return how a recording begins: by what its vehicle says, else by its range, else by height while armed.

    A map that says how it begins (`script.begins`) is believed; one that does not fit is told of when it is replayed.
    """
    begins = plan.topic_map.script.begins
    try:
        said = _Look(plan, recordings).beginning()
    except (ReplayError, AttributeError, IndexError, TypeError):
        said = Beginning(recordings.start_ns, airborne=False, reason="the map does not fit")
    if begins == "auto" or (begins == "air") == said.airborne:
        return said
    return Beginning(said.t_ns, begins == "air", said.height_m, f"the map says so, {said.reason}", said.armed)


class Flight(NamedTuple):
    """One arming of a recording.

    Args:
        armed_ns: of the first word that says armed.
        disarmed_ns: of the first that says disarmed again; the recording's end, where none does.
    """

    armed_ns: int
    disarmed_ns: int

    def words(self, start_ns: int) -> str:
        """Return its times in seconds from a beginning."""
        begin_s, end_s = ((t_ns - start_ns) / _S for t_ns in self)
        return f"{begin_s:+.1f} s to {end_s:+.1f} s"


def flights_of(plan: Plan, recordings: Recordings) -> Tuple[Flight, ...]:
    """Return every arming that a recording tells of."""
    return armings(_Look(plan, recordings, whole=True).motors(), recordings.end_ns)


def armings(motors: Iterable[Tuple[int, bool]], end_ns: int) -> Tuple[Flight, ...]:
    """Return the armings out of whether the motors were armed at some times."""
    found: List[Flight] = []
    armed_ns: Optional[int] = None
    for t_ns, armed in motors:
        if armed and armed_ns is None:
            armed_ns = t_ns
        elif not armed and armed_ns is not None:
            found.append(Flight(armed_ns, t_ns))
            armed_ns = None
    return (*found, *([] if armed_ns is None else [Flight(armed_ns, end_ns)]))


def part_of(flights: Sequence[Flight], number: int, recordings: Recordings) -> Tuple[int, int]:
    """Return where the part of a flight begins and ends, from the start of the recording, in ns.

    Args:
        flights: of the recording.
        number: of the one, from 1.
        recordings: open.

    Raises:
        ReplayError: There is no such flight.
    """
    if not 1 <= number <= len(flights):
        raise ReplayError(f"there is no flight {number}: the recording tells of {len(flights)} armings")
    start_ns, flight = recordings.start_ns, flights[number - 1]
    earliest_ns = flights[number - 2].disarmed_ns if number > 1 else start_ns
    latest_ns = flights[number].armed_ns if number < len(flights) else recordings.end_ns
    begin_ns = max(earliest_ns + 1, flight.armed_ns - _BEFORE_NS, start_ns)
    return begin_ns - start_ns, min(latest_ns - 1, flight.disarmed_ns + _AFTER_NS) - start_ns


def selected_ns(plan: Plan, recordings: Recordings) -> int:
    """Return when the script selects the mission: at its time, or so long before the first recorded arming.

    Where it says both, the later of them: a flight may come late in a log, and the takeoff is not waited for for ever.
    """
    script = plan.topic_map.script
    at_ns = recordings.start_ns + (script.select_at_ns or 0)
    if script.before_arming_ns is None:
        return at_ns
    armed_ns = _Look(plan, recordings, whole=True).armed_ns()
    if armed_ns is None:
        return at_ns
    before_ns = armed_ns - script.before_arming_ns
    return before_ns if script.select_at_ns is None else max(at_ns, before_ns)


class _Look:
    """Looks at the first seconds of a recording."""

    def __init__(self, plan: Plan, recordings: Recordings, *, whole: bool = False) -> None:
        self._plan, self._recordings = plan, recordings
        self._until_ns = recordings.end_ns if whole else recordings.start_ns + _LOOK_NS

    def beginning(self) -> Beginning:
        start_ns = self._recordings.start_ns
        status = self._status()
        if status is not None and status.landed is not VehicleLanded.UNKNOWN:
            flies = status.landed not in _ON_GROUND
            return Beginning(start_ns, flies, status.height_m, f"landed is {status.landed.name}", status.armed)
        armed, landed, height_m = (self._fact(name) for name in ("armed", "landed", "height"))
        judged, distance_m = self._ground()
        height_m = distance_m if height_m is None else height_m
        if landed is not None:
            return Beginning(start_ns, landed not in _ON_GROUND, height_m, f"landed is {landed.name}", armed)
        if judged is not Landed.UNKNOWN:
            return Beginning(start_ns, judged is Landed.AIRBORNE, height_m, f"the range says {judged.name}", armed)
        limit_m = self._plan.rules.limits.takeoff_height_m
        if armed and height_m is not None and height_m >= limit_m:
            return Beginning(
                start_ns, airborne=True, height_m=height_m, reason=f"armed at {height_m:.1f} m", armed=True
            )
        return Beginning(start_ns, airborne=False, height_m=height_m, reason="nothing says that it flies", armed=armed)

    def _samples(self, topic: str) -> Any:
        if topic not in self._recordings.topics:
            return
        for sample in self._recordings.ordered((self._recordings.topics.index(topic),)):
            if sample.t_ns > self._until_ns:
                return
            message = self._recordings.message(sample)
            if message is not None:
                yield sample.t_ns, message

    def _status(self) -> Optional[AutopilotStatus]:
        """Return the first status that knows whether the vehicle flies, else the first of all."""
        found: Optional[AutopilotStatus] = None
        for t_ns, message in self._samples(self._plan.topic_map.statuses.get("autopilot", "")):
            try:
                event = EVENT_OF["autopilot"](message, t_ns)
            except (ValueError, AttributeError, TypeError):  # said where it is replayed
                continue
            if isinstance(event, AutopilotStatus):
                found = found or event
                if event.landed is not VehicleLanded.UNKNOWN:
                    return event
        return found

    def _fact(self, name: str) -> Any:
        reading = self._plan.topic_map.readings.get(name)
        if reading is None:
            return None
        facts: Any = {}
        feed = FactFeed(name, reading, facts)
        for t_ns, message in self._samples(reading.topic):
            feed.take(t_ns, message)
            return next(iter(facts.values())).value
        return None

    def armed_ns(self) -> Optional[int]:
        """Return the last word before the motors are first armed; None: they never are, or nothing tells."""
        before_ns: Optional[int] = None
        for t_ns, armed in self.motors():
            if armed:
                return t_ns if before_ns is None else before_ns
            before_ns = t_ns
        return None

    def motors(self) -> Iterator[Tuple[int, bool]]:
        """Return whether the motors are armed, at each word of it."""
        topic_map = self._plan.topic_map
        reading = topic_map.readings.get("armed")
        topic = topic_map.statuses.get("autopilot") or ("" if reading is None else reading.topic)
        get = getter("armed" if reading is None or "autopilot" in topic_map.statuses else reading.fields["armed"])
        for t_ns, message in self._samples(topic):
            yield t_ns, bool(get(message))

    def _ground(self) -> Any:
        """Return what the landing detection says after the first seconds, and the first distance."""
        reading = self._plan.topic_map.readings.get("range")
        if reading is None or self._plan.landing is None:
            return Landed.UNKNOWN, None
        detector = LandingDetector(self._plan.landing)
        feed, judged, first_m = RangeFeed(detector, reading), Landed.UNKNOWN, None
        for t_ns, message in self._samples(reading.topic):
            feed.take(t_ns, message)
            verdict = detector.evaluate(t_ns)
            first_m = verdict.distance_m if first_m is None else first_m
            if verdict.landed is not Landed.UNKNOWN:
                return verdict.landed, number(first_m)
        return judged, number(first_m)


def lead_of(plan: Plan, beginning: Beginning, warm_up_ns: int) -> Lead:
    """Return what leads up to a recording that begins in the air: long enough for the checks and a recorder's lead."""
    limits = plan.rules.limits
    needed_ns = limits.recording_lead_ns + 10 * _S + warm_up_ns
    height_m = beginning.height_m
    if height_m is None or height_m <= 0.0:
        height_m = max(_CRUISE_M, 1.2 * limits.takeoff_height_m) if height_m is None else 0.1
    return Lead(beginning.t_ns - needed_ns, beginning.t_ns, height_m, limits.takeoff_height_m)
