"""Readings of a range finder for the landing detection: as many as can be at once while its judgement cannot change.

numpy finds beforehand the stretches in which every reading, and so every median of some, is far from the ground, or
near it, without silence; in these a judgement that agrees stands, and only the distance of the last reading is needed.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Any, List, Tuple

import numpy as np

from amaze_autonomy.engine.events import Landed
from amaze_autonomy.monitoring.landing import LandingDetector
from amaze_autonomy.monitoring.specs import LandingSpec

from .topic_columns import Track

__all__ = ["Footing"]


class Footing:
    """What the readings of a track mean for a detector that knows no tilt.

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
    """Return the heights above the ground, by the arithmetic of `ground.seen_m`, and which of them were seen."""
    reading, least, most = (column.astype(float) for column in track.columns)
    with np.errstate(all="ignore"):
        distance = reading * spec.scale
        least = np.where((least > 0) & (least < spec.max_range_m), least, spec.least_m)
        most = np.where((least < most) & (most < spec.max_range_m), most, spec.max_range_m)
        seen = np.isfinite(reading) & (distance >= min(0.0, spec.least_m)) & ~np.isin(reading, spec.sentinels)
        return distance - spec.mounting_height_m, seen & (least <= distance) & (distance < most)


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
