"""From the readings of a range finder to the distance between the vehicle's feet and the ground.

Every way of saying "nothing seen" is nothing seen: NaN, infinity, negative, below the minimum, at or above the maximum,
a sentinel such as 8191. The distance is the median of a short window, so that single echoes do not count; when less
than half of the window saw something, or too little, there is no distance. A stale reading is no reading.
"""

from __future__ import annotations

from collections import deque
from math import cos, isfinite
from typing import Deque, Iterable, Optional, Sequence, Tuple

from .specs import LandingSpec

__all__ = ["GroundDistance", "nearest_return", "seen_m"]


def seen_m(
    reading: float, spec: LandingSpec, min_range_m: Optional[float] = None, max_range_m: Optional[float] = None
) -> Optional[float]:
    """Return a reading in metres, or None when it says that nothing was seen.

    Args:
        reading: in units of the message.
        spec: its scale, sentinels, and limits.
        min_range_m: what the message itself says, in metres; None, NaN or nonsense: the specification's.
        max_range_m: likewise.
    """
    if not isfinite(reading) or reading < 0 or reading in spec.sentinels:
        return None
    distance_m = reading * spec.scale
    least = spec.min_range_m if min_range_m is None or not 0 < min_range_m < spec.max_range_m else min_range_m
    most = spec.max_range_m if max_range_m is None or not least < max_range_m < spec.max_range_m else max_range_m
    return distance_m if least <= distance_m < most else None


def nearest_return(
    readings: Iterable[float],
    spec: LandingSpec,
    min_range_m: Optional[float] = None,
    max_range_m: Optional[float] = None,
) -> float:
    """Return the nearest valid reading of a scan, in units of the message; NaN when there is none."""
    good = [reading for reading in readings if seen_m(reading, spec, min_range_m, max_range_m) is not None]
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
        self.why_unknown = "no range yet"

    def add_tilt(self, t_ns: int, tilt_rad: float) -> None:
        """Add the angle between the vehicle's z axis and the vertical; NaN is ignored."""
        if isfinite(tilt_rad):
            self._tilt_rad, self._tilt_ns = abs(tilt_rad), t_ns

    def add(self, t_ns: int, distance_m: Optional[float]) -> None:
        """Add a reading in metres along the beam; None: nothing seen."""
        if self.reading_ns is not None and t_ns < self.reading_ns:
            self.clear()  # time jumped backwards
        self.reading_ns = t_ns
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
        self.reading_ns = self.seen_ns = last_ns
        oldest_ns = last_ns - spec.window_ns
        while len(window) > spec.min_samples and window[0][0] < oldest_ns:
            window.popleft()
        while window[0][0] < oldest_ns - spec.age_limit_ns:
            window.popleft()

    def clear(self) -> None:
        """Forget all readings."""
        self._window.clear()
        self.seen_ns = self.reading_ns = None
        self.why_unknown = "no range yet"

    def distance_m(self) -> Optional[float]:
        """Return the distance from the feet to the ground, as of the last reading; None: `why_unknown` says why."""
        good = sorted(height for _, height in self._window if height is not None)
        if len(good) < self._spec.min_samples:
            self.why_unknown = f"{len(good)} good ranges, {self._spec.min_samples} are needed"
            return None
        if 2 * len(good) < len(self._window):
            self.why_unknown = f"{len(self._window) - len(good)} of {len(self._window)} ranges saw nothing"
            return None
        middle = len(good) // 2
        return good[middle] if len(good) % 2 else 0.5 * (good[middle - 1] + good[middle])

    def _above_ground_m(self, t_ns: int, distance_m: float) -> Optional[float]:
        tilt_rad = self._tilt(t_ns)
        if tilt_rad is None or tilt_rad > self._spec.max_tilt_rad:
            return None
        return distance_m * cos(tilt_rad) - self._spec.mounting_height_m

    def _tilt(self, t_ns: int) -> Optional[float]:
        if not self._spec.tilt_correction or self._tilt_ns is None:
            return 0.0
        return self._tilt_rad if abs(t_ns - self._tilt_ns) <= self._spec.age_limit_ns else None
