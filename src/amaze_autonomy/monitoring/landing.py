"""Is the vehicle on the ground, has it landed? Judged from the distance to the ground; unknown is not on the ground.

```
  UNKNOWN --- near for settle_ns ---> ON_GROUND --- far for settle_ns ---> AIRBORNE
     ^                                    ^                                   |
     |  no distance, at once              +--- near for landed_dwell_ns, -----+
     +------------- from any                   hardly any vertical speed, autopilot agrees where it says anything
```

Near is below `ground_distance_m`, far above `airborne_distance_m`; in between the last judgement stands, and anything
but near begins the dwell anew. A vehicle that was airborne stays so through UNKNOWN: it needs the long dwell. So a
bounce, a low pass over the pad or a hand under the sensor is no landing. Before ON_GROUND, an autopilot that says that
it flies is enough to have been airborne: the node may have been started low in the air. An ON_GROUND that it never
agreed to is taken back then, at once; one that it agreed to, when autopilot or vertical speed speak against it for
landed_dwell_ns. A range finder that saw the ground meanwhile may be stuck: it is not believed until it has seen that
the ground is farther away. The judgement moves when a range arrives, at most once per `STEP_NS`, and does not depend on
how often somebody asks.
"""

from __future__ import annotations

from collections import deque
from math import cos, inf, isfinite
from typing import Deque, Iterable, NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.engine.events import Landed, VehicleLanded

from ..engine.events import Check, Verdict
from .condition import FOREVER_NS, seconds
from .specs import LandingSpec

# --- ground -----------------------------------------------------------------------------------------------------------
# From the readings of a range finder to the distance between the vehicle's feet and the ground.
#
# Every way of saying "nothing seen" is nothing seen: NaN, infinity, negative, below the minimum, at or above the
# maximum, a sentinel such as 8191. The distance is the median of a short window, so that single echoes do not count;
# when less than half of the window saw something, or too little, there is no distance. A stale reading is no reading.


def seen_m(
    reading: float, spec: LandingSpec, min_range: Optional[float] = None, max_range: Optional[float] = None
) -> Optional[float]:
    """Return a reading in metres, or None when it says that nothing was seen.

    Args:
        reading: in units of the message.
        spec: its scale, sentinels, and limits.
        min_range: what the message itself says, in the same units; None, NaN or nonsense: the specification's.
        max_range: likewise.
    """
    least, most = _limits(spec, min_range, max_range)
    return reading * spec.scale if least <= reading < most and reading not in spec.limits.sentinels else None


def _limits(spec: LandingSpec, min_range: Optional[float], max_range: Optional[float]) -> Tuple[float, float]:
    """Return the limits that count, in units of the message."""
    least, most, _ = spec.limits
    least = least if min_range is None or not 0 < min_range < most else min_range
    most = most if max_range is None or not least < max_range < most else max_range
    return least, most


class Unseen(NamedTuple):
    """Why a reading is nothing seen; what to do about it, where that is not the usual."""

    why: str
    advice: str = ""


def unseen(
    reading: float, spec: LandingSpec, min_range: Optional[float] = None, max_range: Optional[float] = None
) -> Optional[Unseen]:
    """Return at which limit a reading is nothing seen; None when it is at none: seen, zero, a sentinel, not finite."""
    least, most = _limits(spec, min_range, max_range)
    if reading in spec.limits.sentinels or not 0 < reading < inf or least <= reading < most:
        return None
    distance_m, least_m, most_m = (f"{round(told * spec.scale, 3):g} m" for told in (reading, least, most))
    if reading < least:
        name = "min_range_m" if least == spec.limits.least else "the sensor's least range"
        return Unseen(f"{distance_m} is below {name} of {least_m}", "mount it higher")
    name = "max_range_m" if most == spec.limits.most else "the sensor's largest range"
    return Unseen(f"{distance_m} is not below {name} of {most_m}")


def nearest_return(
    readings: Iterable[float],
    spec: LandingSpec,
    min_range: Optional[float] = None,
    max_range: Optional[float] = None,
) -> float:
    """Return the nearest valid reading of a scan, in units of the message; NaN when there is none."""
    good = [reading for reading in readings if seen_m(reading, spec, min_range, max_range) is not None]
    return min(good, default=float("nan"))


class GroundDistance:
    """Sliding median of what a range finder saw, corrected by mounting and tilt.

    The range finder looks along the vehicle's -z axis from `mounting_height_m` above the feet. A tilt that was given
    once must stay fresh; where none is ever given, the vehicle is taken to be level.
    """

    def __init__(self, spec: LandingSpec) -> None:
        self._spec = spec
        self._window: Deque[Tuple[int, Optional[float]]] = deque()
        self._tilt_rad: Optional[float] = None
        self._tilt_ns: Optional[int] = None
        self.seen_ns: Optional[int] = None
        self.reading_ns: Optional[int] = None
        self.unseen: Optional[Unseen] = None
        self.why_unknown = "no range yet"

    def add_tilt(self, t_ns: int, tilt_rad: float) -> None:
        """Add the angle between the vehicle's z axis and the vertical; NaN is ignored."""
        if isfinite(tilt_rad):
            self._tilt_rad, self._tilt_ns = abs(tilt_rad), t_ns

    def add(self, t_ns: int, distance_m: Optional[float], why: Optional[Unseen] = None) -> None:
        """Add a reading in metres along the beam; None: nothing seen, for a reason that may be known."""
        if self.reading_ns is not None and t_ns < self.reading_ns:
            self.clear()  # time jumped backwards
        self.reading_ns, self.unseen = t_ns, why
        height_m = None if distance_m is None else self._above_ground_m(t_ns, distance_m)
        if height_m is not None:
            self.seen_ns = t_ns
        window, spec = self._window, self._spec
        window.append((t_ns, height_m))
        oldest_ns = t_ns - spec.window_ns
        while len(window) > spec.min_samples and window[0][0] < oldest_ns:
            window.popleft()
        while window[0][0] < t_ns - spec.age_limit_ns - spec.window_ns:
            window.popleft()

    def extend(self, times: Sequence[int], heights_m: Sequence[float]) -> None:
        """Add heights above the ground that were seen one after the other, in order of time."""
        window, spec, last_ns = self._window, self._spec, times[-1]
        window.extend(zip(times, heights_m))
        self.reading_ns, self.seen_ns, self.unseen = last_ns, last_ns, None
        oldest_ns = last_ns - spec.window_ns
        while len(window) > spec.min_samples and window[0][0] < oldest_ns:
            window.popleft()
        while window[0][0] < oldest_ns - spec.age_limit_ns:
            window.popleft()

    def clear(self) -> None:
        """Forget all readings."""
        self._window.clear()
        self.seen_ns = self.reading_ns = self.unseen = None
        self.why_unknown = "no range yet"

    def distance_m(self) -> Optional[float]:
        """Return the distance from the feet to the ground, as of the last reading; None: `why_unknown` says why."""
        good = sorted(height for _, height in self._window if height is not None)
        if not good and self.unseen is not None:
            self.why_unknown = self.unseen.why
            return None
        if len(good) < self._spec.min_samples:
            self.why_unknown = f"{len(good)} good ranges, {self._spec.min_samples} are needed"
            return None
        if 2 * len(good) < len(self._window):
            self.why_unknown = f"{len(self._window) - len(good)} of {len(self._window)} ranges saw nothing"
            return None
        middle = len(good) // 2
        return good[middle] if len(good) % 2 else 0.5 * (good[middle - 1] + good[middle])

    def blind(self, t_ns: int) -> Optional[Unseen]:
        """Return at which limit the last reading is nothing seen; None when it is at none, or old."""
        fresh = self.reading_ns is not None and abs(t_ns - self.reading_ns) <= self._spec.age_limit_ns
        return self.unseen if fresh else None

    def _above_ground_m(self, t_ns: int, distance_m: float) -> Optional[float]:
        tilt_rad = self._tilt(t_ns)
        if tilt_rad is None or tilt_rad > self._spec.max_tilt_rad:
            return None
        return distance_m * cos(tilt_rad) - self._spec.mounting_height_m

    def _tilt(self, t_ns: int) -> Optional[float]:
        if not self._spec.tilt_correction or self._tilt_ns is None:
            return 0.0
        return self._tilt_rad if abs(t_ns - self._tilt_ns) <= self._spec.age_limit_ns else None


# --- landing ----------------------------------------------------------------------------------------------------------


_S = 1_000_000_000
STEP_NS = _S // 20
_FAR_PAST_NS = -(2**62)
_OFF_THE_GROUND = frozenset((VehicleLanded.IN_AIR, VehicleLanded.LANDING))
_FLYING = _OFF_THE_GROUND | {VehicleLanded.TAKING_OFF}  # it says TAKING_OFF before it lifts off
_STUCK = "the range finder saw the ground while the vehicle flew"


class LandingVerdict(NamedTuple):
    """The judgement at a time.

    Args:
        landed: UNKNOWN, ON_GROUND or AIRBORNE.
        distance_m: from the feet to the ground; None: unknown.
        reason: why.
        age_ns: since something was last seen; None: never.
        changes_at_ns: when it can change if nothing arrives.
    """

    landed: Landed
    distance_m: Optional[float]
    reason: str
    age_ns: Optional[int]
    changes_at_ns: int


class LandingDetector:
    """The landing detection's judgement."""

    def __init__(self, spec: Optional[LandingSpec] = None) -> None:
        self.spec = spec or LandingSpec()
        self._ground = GroundDistance(self.spec)
        self._landed, self._reason = Landed.UNKNOWN, ""
        self._was_airborne = False
        self._agreed = False
        self._believed = True
        self._against_since_ns: Optional[int] = None
        self._distance_m: Optional[float] = None
        self._near_since_ns: Optional[int] = None
        self._far_since_ns: Optional[int] = None
        self._stale = f"nothing seen for longer than {seconds(self.spec.age_limit_ns)}"
        self._judged_ns = _FAR_PAST_NS
        self._speed: Tuple[int, float] = (_FAR_PAST_NS, 0.0)
        self._autopilot: Tuple[int, VehicleLanded] = (_FAR_PAST_NS, VehicleLanded.UNKNOWN)

    def add_range(
        self, t_ns: int, reading: float, min_range: Optional[float] = None, max_range: Optional[float] = None
    ) -> bool:
        """Add a reading and the limits that its message says, in its units. Return True when the judgement changed."""
        seen_ns = self._ground.seen_ns
        if t_ns < self._judged_ns:
            self._begin()
        elif seen_ns is not None and t_ns - seen_ns > self.spec.age_limit_ns:
            self._lose(self._stale)
        distance_m = seen_m(reading, self.spec, min_range, max_range)
        why = unseen(reading, self.spec, min_range, max_range) if distance_m is None else None
        self._ground.add(t_ns, distance_m, why)
        if t_ns - self._judged_ns < STEP_NS:
            return False
        before = self._landed
        self._judged_ns = t_ns
        self._distance_m = self._ground.distance_m()
        self._judge(t_ns)
        return self._landed is not before

    @property
    def steady(self) -> Landed:
        """The judgement that stands for as long as every distance agrees with it; UNKNOWN when none does yet."""
        if self._landed is Landed.ON_GROUND and self._near_since_ns is not None and not self._was_airborne:
            return Landed.ON_GROUND
        if self._landed is Landed.AIRBORNE and self._far_since_ns is not None and self._was_airborne:
            return Landed.AIRBORNE
        return Landed.UNKNOWN

    def skip(self, times: Sequence[int], heights_m: Sequence[float]) -> None:
        """Add readings of which every median agrees with the steady judgement: only the last one is asked for.

        Args:
            times: of the readings.
            heights_m: what they say, scaled and corrected by the mounting.
        """
        judged, judged_ns = 0, self._judged_ns
        for place, t_ns in enumerate(times, 1):
            if t_ns - judged_ns >= STEP_NS:
                judged, judged_ns = place, t_ns
        if judged:
            self._ground.extend(times[:judged], heights_m[:judged])
            self._judged_ns, self._distance_m = judged_ns, self._ground.distance_m()
        if judged < len(times):
            self._ground.extend(times[judged:], heights_m[judged:])

    def add_tilt(self, t_ns: int, tilt_rad: float) -> None:
        """Add the angle between the vehicle's z axis and the vertical."""
        self._ground.add_tilt(t_ns, tilt_rad)

    def add_vertical_speed(self, t_ns: int, speed_m_s: float) -> None:
        """Add the vertical speed; NaN is ignored."""
        if isfinite(speed_m_s):
            self._speed = (t_ns, speed_m_s)

    def add_autopilot(self, t_ns: int, landed: VehicleLanded) -> None:
        """Add what the autopilot says; UNKNOWN does not count."""
        self._autopilot = (t_ns, landed)

    def evaluate(self, t_ns: int) -> LandingVerdict:
        """Return the judgement at a time."""
        seen_ns, limit_ns = self._ground.seen_ns, self.spec.age_limit_ns
        if seen_ns is None:
            return LandingVerdict(Landed.UNKNOWN, None, self._reason or "no range yet", None, FOREVER_NS)
        age_ns = t_ns - seen_ns
        if abs(age_ns) > limit_ns:
            why = self._ground.blind(t_ns)
            self._lose(self._stale if why is None else why.why)
            return LandingVerdict(Landed.UNKNOWN, None, self._reason, max(0, age_ns), FOREVER_NS)
        return LandingVerdict(self._landed, self._distance_m, self._reason, max(0, age_ns), seen_ns + limit_ns + 1)

    def checks(self, t_ns: int) -> Tuple[Check, ...]:
        """Return the rows of the check "on the ground" at a time."""
        return (self._range_row(self.evaluate(t_ns)), self._ground_row(self.evaluate(t_ns)))

    def _range_row(self, verdict: LandingVerdict) -> Check:
        limit_s = self.spec.age_limit_ns / _S
        age_s = None if verdict.age_ns is None else verdict.age_ns / _S
        if verdict.distance_m is not None:
            return Check("range age", Verdict.PASS, age_s, limit_s, "s", age_s)
        why, usual = self._ground.unseen, f"check the range finder, its lens and its topic {self.spec.topic}"
        advice = f"{verdict.reason}: {why.advice if why and why.why == verdict.reason and why.advice else usual}"
        return Check("range age", Verdict.UNKNOWN, age_s, limit_s, "s", age_s, advice)

    def _ground_row(self, verdict: LandingVerdict) -> Check:
        limit_m = self.spec.ground_distance_m
        age_s = None if verdict.age_ns is None else verdict.age_ns / _S
        outcome, advice, comes = Verdict.PASS, "", False
        if verdict.distance_m is None:
            outcome, advice = Verdict.UNKNOWN, "the distance to the ground is unknown"
        elif verdict.distance_m > limit_m:
            outcome, height = Verdict.FAIL, f"{verdict.distance_m:.2f} m above the ground, limit {limit_m:.2f} m"
            advice = f"the feet are {height}: place the vehicle on the ground"
        elif not self._believed:
            outcome, height = Verdict.UNKNOWN, f"{limit_m:.2f} m"
            advice = f"{verdict.reason}: check it, then lift the vehicle until it sees more than {height}"
        elif verdict.landed is not Landed.ON_GROUND:
            outcome, advice, comes = Verdict.UNKNOWN, f"{verdict.reason}, wait", True
        return Check("distance to ground", outcome, verdict.distance_m, limit_m, "m", age_s, advice, heals=comes)

    def _begin(self) -> None:
        """Begin anew when time has jumped backwards; that it was airborne stands."""
        self._ground.clear()
        self._lose("no range yet")
        self._judged_ns = _FAR_PAST_NS

    def _lose(self, reason: str) -> None:
        self._landed, self._reason, self._distance_m = Landed.UNKNOWN, reason, None
        self._near_since_ns = self._far_since_ns = self._against_since_ns = None

    def _judge(self, t_ns: int) -> None:
        """Move the judgement by the present distance."""
        spec, distance_m = self.spec, self._distance_m
        if distance_m is None:
            self._lose(self._ground.why_unknown)
            return
        if distance_m < -spec.ground_distance_m:
            self._lose("something is nearer to the range finder than the ground can be")
            return
        self._hear_autopilot(t_ns)
        near, far = distance_m <= spec.ground_distance_m, distance_m > spec.airborne_distance_m
        self._doubt(t_ns, near=near)
        near = near and self._believed and (not self._was_airborne or self._at_rest(t_ns))
        self._near_since_ns = (t_ns if self._near_since_ns is None else self._near_since_ns) if near else None
        self._far_since_ns = (t_ns if self._far_since_ns is None else self._far_since_ns) if far else None
        if self._far_since_ns is not None and t_ns - self._far_since_ns >= spec.settle_ns:
            self._landed, self._was_airborne = Landed.AIRBORNE, True
        dwell_ns = spec.landed_dwell_ns if self._was_airborne else spec.settle_ns
        if self._near_since_ns is not None and t_ns - self._near_since_ns >= dwell_ns:
            self._landed, self._was_airborne = Landed.ON_GROUND, False
        self._reason = self._words(near=near)

    def _hear_autopilot(self, t_ns: int) -> None:
        """Let the autopilot agree to ON_GROUND, or speak against it while it has not."""
        said = self._said(t_ns)
        self._agreed = self._landed is Landed.ON_GROUND and (self._agreed or said is VehicleLanded.ON_GROUND)
        if said in _FLYING and not self._agreed:
            self._was_airborne = True
            if self._landed is Landed.ON_GROUND:
                self._landed = Landed.UNKNOWN

    def _doubt(self, t_ns: int, *, near: bool) -> None:
        """Take back an ON_GROUND that is spoken against for long.

        Neither a platform that moves does that, nor an autopilot that says for a moment at spool-up that it flies.
        """
        said = self._said(t_ns)
        flies = said in _OFF_THE_GROUND or (said is not VehicleLanded.ON_GROUND and self._fast(t_ns))
        against = flies and self._landed is Landed.ON_GROUND
        since_ns = (t_ns if self._against_since_ns is None else self._against_since_ns) if against else None
        self._against_since_ns = since_ns
        if since_ns is not None and t_ns - since_ns >= self.spec.landed_dwell_ns:
            self._landed, self._was_airborne, self._believed = Landed.UNKNOWN, True, False
        self._believed = self._believed or not near

    def _said(self, t_ns: int) -> VehicleLanded:
        """Return what the autopilot says; UNKNOWN when that is old."""
        said_ns, landed = self._autopilot
        return landed if abs(t_ns - said_ns) <= self.spec.age_limit_ns else VehicleLanded.UNKNOWN

    def _at_rest(self, t_ns: int) -> bool:
        """Return False when vertical speed or autopilot, as far as they are known, speak against a landing."""
        return not self._fast(t_ns) and self._said(t_ns) not in _FLYING

    def _fast(self, t_ns: int) -> bool:
        """Return True when the vehicle is known to climb or sink."""
        speed_ns, speed_m_s = self._speed
        fresh = abs(t_ns - speed_ns) <= self.spec.age_limit_ns
        return fresh and abs(speed_m_s) > self.spec.max_vertical_speed_m_s

    def _words(self, *, near: bool) -> str:
        if self._landed is Landed.ON_GROUND:
            return "on the ground"
        if not self._believed:
            return _STUCK
        if near:
            dwell_ns = self.spec.landed_dwell_ns if self._was_airborne else self.spec.settle_ns
            return f"near the ground, not yet for {seconds(dwell_ns)}"
        if self._landed is Landed.AIRBORNE:
            return "in the air"
        if self._distance_m is not None and self._distance_m <= self.spec.ground_distance_m:
            return "near the ground, but it moves or the autopilot says that it flies"
        return "neither near the ground nor clear of it"
