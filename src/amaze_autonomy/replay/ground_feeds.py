"""From messages to the landing detection: distances to the ground, and how far the vehicle is tilted."""

from __future__ import annotations

from math import isfinite, nan
from typing import Any, Optional, Tuple

from amaze_autonomy.monitoring.gravity import tilt_of, up_of_quaternion
from amaze_autonomy.monitoring.landing import LandingDetector

from .feed import Feed
from .fields import getter, number, orientation, quaternion
from .footing import Footing
from .topic_map import Reading

__all__ = ["RangeFeed", "TiltFeed"]

_S = 1_000_000_000


class RangeFeed(Feed):
    """A distance to the ground, in the units of the message; the specification scales it."""

    def __init__(self, detector: LandingDetector, reading: Reading) -> None:
        super().__init__(reading.topic, _S // 20, paths=(reading.fields["distance"], "min_range", "max_range"))
        self._detector, self._get = detector, getter(reading.fields["distance"])
        self.tilt: Optional[TiltFeed] = None
        self._footing: Optional[Footing] = None

    def take_many(self, begin: int, end: int) -> None:
        """Take readings of the track, each with the tilt of its time."""
        if self.tilt is None:
            self._take_level(begin, end)
            return
        for place in range(begin, end):
            self.tilt.until((self.track.listed[place], self.rank))
            super().take_many(place, place + 1)

    def _take_level(self, begin: int, end: int) -> None:
        if self._footing is None:
            self._footing = Footing(self._detector, self.track)
        while begin < end:
            taken = self._footing.skipped(begin, end)
            if taken == begin:
                taken += 1
                super().take_many(begin, taken)
            begin = taken

    def take(self, t_ns: int, message: Any) -> None:
        """Take a reading; what is no number is nothing seen."""
        limits = getattr(message, "min_range", None), getattr(message, "max_range", None)
        self.take_values(t_ns, (self._get(message), *limits))

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take a reading and its limits."""
        value, least, most = map(number, values)
        self._detector.add_range(t_ns, float("nan") if value is None else value, least, most)

    def play(self, t_ns: int) -> None:
        """Take what the sensor measures when the vehicle stands on the ground."""
        spec = self._detector.spec
        self._detector.add_range(t_ns, max(spec.mounting_height_m, spec.min_range_m) / spec.scale)


class TiltFeed(Feed):
    """The attitude of the vehicle for the landing detection; an invalid orientation says nothing."""

    def __init__(self, detector: LandingDetector, reading: Reading) -> None:
        path = reading.fields["orientation"]
        super().__init__(reading.topic, 0, paths=tuple(f"{path}.{axis}" for axis in "xyzw"))
        self._detector, self._get = detector, getter(path)

    def take(self, t_ns: int, message: Any) -> None:
        """Take an orientation."""
        self._take(t_ns, quaternion(self._get(message)))

    def take_many(self, begin: int, end: int) -> None:
        """Take the last one that says something."""
        for place in range(end - 1, begin - 1, -1):
            x, y, z, w = map(float, self.track.rows(place, place + 1)[0])
            parts = orientation((x, y, z, w))
            if parts is not None and isfinite(self._tilt(parts)):
                self._take(self.track.listed[place], parts)
                return

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take its four numbers."""
        x, y, z, w = map(float, values)
        self._take(t_ns, orientation((x, y, z, w)))

    def _take(self, t_ns: int, parts: Optional[Tuple[float, float, float, float]]) -> None:
        if parts is not None:
            self._detector.add_tilt(t_ns, self._tilt(parts))

    @staticmethod
    def _tilt(parts: Tuple[float, float, float, float]) -> float:
        up = up_of_quaternion(*parts)
        return nan if up is None else tilt_of(up)  # NaN is not taken
