"""The monitors' vectorised forms: numpy says beforehand what of a recording can be taken together, and it is the same.

A chapter for each monitor: rates, landing detection, state estimation. Each has its monitor's own arithmetic, and a
test that both judge alike.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Any, Callable, List, Optional, Tuple

import numpy as np

from amaze_autonomy.engine.events import Landed
from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.gravity import BUCKET_NS, PLAUSIBLE_M2_S4, rotation_from_rpy
from amaze_autonomy.monitoring.landing import LandingDetector
from amaze_autonomy.monitoring.rate import RateMonitor
from amaze_autonomy.monitoring.specs import LandingSpec, StateEstimationSpec

from ..recordings.fields import Track

_S = 1_000_000_000
_EXACT = 9_000_000  # so many messages times 1e9 are exact as a float


# --- rates ------------------------------------------------------------------------------------------------------------
# Messages of a topic for its rate monitor: one by one where they change something, else as many as can be at once.
#
# A replay knows the whole recording: numpy says beforehand at which messages the rate, by the very arithmetic of
# `monitoring.rate`, is not as intended, or too young to tell. A monitor that is steady takes all others at once, and is
# left as it would be had it taken them one after the other.


class RateColumns:
    """A track on its way into a rate monitor.

    Args:
        monitor: of the topic.
        track: its messages.
        add: takes the time of one message, as the monitor's `add` does.
    """

    def __init__(self, monitor: RateMonitor, track: Track, add: Callable[[int], object]) -> None:
        self._monitor, self._times, self._add = monitor, track.listed, add
        cross, at, base, rates, calm, silent = _crossings(monitor, track.times)
        self._cross: List[int] = cross.tolist()
        self._at: List[int] = at.tolist()
        self._base: List[int] = base.tolist()
        self._rates: List[float] = rates.tolist()
        self._odd: List[int] = cross[~calm].tolist()
        limit_ns = monitor.silence_ns + 1
        self._odd_ns: List[int] = np.where(silent, at + limit_ns, track.times[cross])[~calm].tolist()
        self._end_ns = self._times[-1] + limit_ns if self._times else FOREVER_NS

    def take(self, begin: int, end: int) -> None:
        """Take messages by their places, the next ones in order."""
        monitor, times, odd = self._monitor, self._times, self._odd
        place = bisect_left(odd, begin)
        while begin < end:
            while place < len(odd) and odd[place] < begin:
                place += 1
            stop = min(end, odd[place]) if place < len(odd) else end
            if begin and begin < stop and monitor.steady:
                self._skip(begin, stop)
                begin = stop
            else:
                self._add(times[begin])
                begin += 1

    @property
    def steady(self) -> bool:
        """True while the monitor is steady: then `changes_ns` foresees silence, too."""
        return self._monitor.steady

    def changes_ns(self, taken: int) -> int:
        """Return when the verdict can change, at the earliest, once so many messages have been taken."""
        if not taken or not self._monitor.steady:
            return self._times[taken] if taken < len(self._times) else FOREVER_NS
        place = bisect_left(self._odd, taken)
        return self._odd_ns[place] if place < len(self._odd) else self._end_ns

    def _skip(self, begin: int, end: int) -> None:
        before = self._monitor.total - begin
        last = bisect_right(self._cross, end - 1) - 1
        marks: List[Tuple[int, int]] = []
        if last >= 0 and self._cross[last] >= begin:
            first = self._base[last]
            marks = [(at, before + cross) for at, cross in zip(self._at[first : last + 1], self._cross[first:])]
        self._monitor.skip(self._times[end - 1], end - begin, marks, self._rates[last] if marks else None)


def _crossings(monitor: RateMonitor, times: Any) -> Tuple[Any, ...]:
    """Return all messages that are the first of a bucket, and what the monitor makes of those before.

    Returns:
        Their places; the times of the messages before them; by place among them the mark that the rate begins at; the
        rates; which leave a steady monitor as it is; which come after silence.
    """
    spec = monitor.spec
    cross: Any = np.flatnonzero(np.diff(times // monitor.bucket_ns)) + 1
    at = times[cross - 1]
    silent = times[cross] - at > monitor.silence_ns
    begun = np.maximum.accumulate(np.where(silent, cross, 0)) if len(cross) else cross
    base = np.searchsorted(at, at - spec.rate_window_ns, "right") - 1
    count, span = cross - cross[base], at - at[base]
    known = (base >= 0) & (cross[base] > begun) & (count < _EXACT) & (span > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = count * _S / span
    fraction = rates / spec.rate_hz
    good = ~(fraction < spec.rate_failed_fraction) & (np.abs(fraction - 1.0) <= spec.tolerance_fraction)
    return cross, at, base, rates, known & ~silent & good, silent


# --- landing detection ------------------------------------------------------------------------------------------------
# Readings of a range finder for the landing detection: as many as can be at once while its judgement cannot change.
#
# numpy finds beforehand the stretches in which every reading, and so every median of some, is far from the ground, or
# near it, without silence; in these a judgement that agrees stands, and only the distance of the last reading is
# needed.


class LandingColumns:
    """What the readings of a track mean for a detector that knows no tilt, and nothing of an autopilot.

    Args:
        detector: that takes them.
        track: readings, and the least and largest that their messages say.
    """

    def __init__(self, detector: LandingDetector, track: Track) -> None:
        self._detector, spec = detector, detector.spec
        heights, seen = _heights(track, spec)
        self._times, self._heights = track.listed, heights.tolist()
        well = seen & _joined(track.times, spec)
        self._runs = {
            Landed.AIRBORNE: _ends(track.times, well & (heights > spec.airborne_distance_m), spec),
            Landed.ON_GROUND: _ends(track.times, well & (np.abs(heights) <= spec.ground_distance_m), spec),
        }

    def skipped(self, begin: int, end: int) -> int:
        """Let the detector take some readings at once, if it can; return the place of the first that it has not."""
        begins, ends = self._runs.get(self._detector.steady, ([], []))
        place = bisect_right(begins, begin) - 1
        if place < 0 or ends[place] <= begin:
            return begin
        end = min(end, ends[place])
        self._detector.skip(self._times[begin:end], self._heights[begin:end])
        return end


def _heights(track: Track, spec: LandingSpec) -> Tuple[Any, Any]:
    """Return the heights above the ground, by the arithmetic of `landing.seen_m`, and which of them were seen."""
    reading, own_least, own_most = (column.astype(float) for column in track.columns)
    least, most, sentinels = spec.limits
    with np.errstate(all="ignore"):
        least = np.where((own_least > 0) & (own_least < most), own_least, least)
        most = np.where((least < own_most) & (own_most < most), own_most, most)
        seen = (least <= reading) & (reading < most) & ~np.isin(reading, sentinels)
        return reading * spec.scale - spec.mounting_height_m, seen


def _joined(times: Any, spec: LandingSpec) -> Any:
    """Return before which readings there was no silence."""
    return np.diff(times, prepend=times[:1]) <= spec.age_limit_ns


def _ends(times: Any, good: Any, spec: LandingSpec) -> Tuple[List[int], List[int]]:
    """Return where stretches begin in which all that any median looks at is good, and where they end."""
    count = np.arange(len(times))
    bad = np.maximum.accumulate(np.where(good, -1, count)) if len(times) else count
    first = np.searchsorted(times, times - spec.window_ns - spec.age_limit_ns)
    enough = count - np.searchsorted(times, times - spec.window_ns) + 1 >= spec.min_samples
    calm: Any = (bad < first) & (first > 0) & enough
    edges = np.flatnonzero(np.diff(calm.astype(np.int8), prepend=0, append=0))
    return edges[::2].tolist(), edges[1::2].tolist()


# --- state estimation -------------------------------------------------------------------------------------------------
# At which looks at the state check does every row that is followed surely pass? Those need no look.
#
# Computed for all looks of a recording at once, and with a margin beside which all rounding is nothing: what is not
# sure is looked at by the check itself, so that its rows, words and values never come from here.


_MARGIN = 1e-6
_LARGEST_SUM = 1e9  # beyond it sums of many numbers are off by more than is nothing


def unsure_looks(
    looks: Any, spec: StateEstimationSpec, imu: Optional[Track], scale: float, estimate: Optional[Track]
) -> Any:
    """Return the places of the looks that must be made, apart from those for the rate of the estimates.

    Args:
        looks: their times in nanoseconds.
        spec: of the check.
        imu: track of the accelerometer, x, y, z first; None: it has none.
        scale: makes SI of its numbers.
        estimate: track of the estimates; None: it has none.
    """
    sure: Any = np.ones(len(looks), bool)
    up = estimated_up = None
    with np.errstate(all="ignore"):
        if estimate is not None:
            good, estimated_up = _estimates(looks, spec, estimate)
            sure &= good
        if imu is not None:
            good, up = _gravity(looks, spec, imu, scale)
            sure &= good
        if up is not None and estimated_up is not None:
            cosine = (up * estimated_up).sum(axis=0) / np.sqrt((up * up).sum(axis=0))
            sure &= np.arccos(np.clip(cosine, -1.0, 1.0)) <= spec.tilt_difference_limit_rad - _MARGIN
    return np.flatnonzero(~sure)


def _estimates(looks: Any, spec: StateEstimationSpec, track: Track) -> Tuple[Any, Any]:
    """Return at which looks the last estimate is fresh and level, and its up."""
    last = np.searchsorted(track.times, looks, "right") - 1
    seconds, fraction = (column.astype(np.int64)[last] for column in track.columns[:2])
    stamps = seconds * _S + fraction
    age = looks - np.where(stamps == 0, track.times[last], stamps)
    x, y, z, w = (column.astype(float)[last] for column in track.columns[5:9])
    length = np.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / length, y / length, z / length, w / length
    up: Any = np.array((2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
    return (last >= 0) & (np.abs(age) <= spec.age_limit_ns) & _level(up, spec), up


def _gravity(looks: Any, spec: StateEstimationSpec, track: Track, scale: float) -> Tuple[Any, Any]:
    """Return at which looks the IMU is fresh and measures gravity, nearly upwards; and what it measures."""
    axes: Any = np.array([column.astype(float) * scale for column in track.columns[:3]])
    good = (axes * axes).sum(axis=0) < PLAUSIBLE_M2_S4
    times, axes = track.times[good], axes[:, good]
    begins = (looks - spec.window_ns) // BUCKET_NS * BUCKET_NS
    if not len(times) or np.abs(axes).sum() > _LARGEST_SUM:
        return np.zeros(len(looks), bool), None
    first, end = np.searchsorted(times, begins), np.searchsorted(times, looks, "right")
    sums = np.concatenate((np.zeros((3, 1)), np.cumsum(axes, axis=1)), axis=1)
    count = end - first
    mean = (sums[:, end] - sums[:, first]) / count
    size = np.sqrt((mean * mean).sum(axis=0))
    up = np.array(rotation_from_rpy(spec.imu_mounting_rpy_rad)) @ mean
    sure = (begins >= times[0]) & (count >= spec.min_samples) & (looks - times[end - 1] <= spec.age_limit_ns)
    sure &= np.abs(size - spec.gravity_m_s2) <= spec.gravity_tolerance_m_s2 - _MARGIN
    return sure & _level(up, spec), up


def _level(up: Any, spec: StateEstimationSpec) -> Any:
    return np.arctan2(np.sqrt(up[0] * up[0] + up[1] * up[1]), up[2]) <= spec.tilt_limit_rad - _MARGIN
