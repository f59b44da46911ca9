"""Where is down? Gravity and tilt from an IMU, and from the orientation of an estimate.

Frames as in REP-103: x forward, y left, z up. At rest an accelerometer measures the specific force that holds it up,
(0, 0, +g) when level; gravity is its negative. *Up* is a unit vector in the vehicle frame throughout this file.

Samples are summed in buckets of `BUCKET_NS`: adding one costs a few additions, whatever the window.
"""

from __future__ import annotations

from collections import deque
from math import acos, atan2, cos, degrees, inf, isfinite, nan, pi, sin, sqrt
from typing import Deque, List, NamedTuple, Optional, Sequence, Tuple

Vector = Tuple[float, float, float]
Matrix = Tuple[Vector, Vector, Vector]
Quaternion = Tuple[float, float, float, float]  # x, y, z, w

BUCKET_NS = 1_000_000_000 // 20
_NEAR = 0.2  # a unit is recognised when the magnitude is off by less than this fraction
PLAUSIBLE_M2_S4 = 1e12  # beyond it no sensor measures
_UPSIDE_DOWN_RAD = 3 * pi / 4
_GAP_NS = 1_000_000_000 // 2
_SIDE = sin(pi / 8)  # of eight directions each covers 45 degrees
_LASTS_NS = 3 * 1_000_000_000 // 10
_LEAST_SAMPLES = 3


def norm(vector: Vector) -> float:
    """Return the length of a vector."""
    x, y, z = vector
    return sqrt(x * x + y * y + z * z)


def rotation_from_rpy(rpy_rad: Vector) -> Matrix:
    """Return the rotation Rz(yaw) Ry(pitch) Rx(roll) that takes a vector of the sensor into the vehicle frame."""
    (cr, sr), (cp, sp), (cy, sy) = ((cos(angle), sin(angle)) for angle in rpy_rad)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def rotate(rotation: Matrix, vector: Vector) -> Vector:
    """Return the rotated vector."""
    x, y, z = (row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] for row in rotation)
    return x, y, z


def up_of_quaternion(x: float, y: float, z: float, w: float) -> Optional[Vector]:
    """Return up in the frame whose orientation in the world is a quaternion; None when it is none (NaN, all zero)."""
    length = sqrt(x * x + y * y + z * z + w * w)
    if not isfinite(length) or length <= 0:
        return None
    x, y, z, w = x / length, y / length, z / length, w / length
    return 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


def tilt_of(up: Vector) -> float:
    """Return the angle between the vehicle's z axis and up, 0..pi rad; up need not be a unit vector."""
    return atan2(_across(up), up[2])


def tilt_of_rpy(roll_rad: float, pitch_rad: float) -> float:
    """Return the same of two angles, whatever their signs; NaN when one of them is not finite."""
    if not (isfinite(roll_rad) and isfinite(pitch_rad)):
        return nan
    return tilt_of(rotation_from_rpy((roll_rad, pitch_rad, 0.0))[2])


class LastingTilt:
    """The tilt that has lasted: the least of the last 0.3 s, and of three samples at least.

    A tilt beyond its limit lands the vehicle. That is the safe side, but it ends a mission: neither one wrong sample
    nor the peak of a gust may do it, and a vehicle that falls over stays tilted for longer. So it is known 0.3 s late,
    and unknown where samples are missing.

    Args:
        age_limit_ns: longest pause between two samples, and longest age of the last.
    """

    def __init__(self, age_limit_ns: int) -> None:
        self._age_limit_ns = age_limit_ns
        self._samples: Deque[Tuple[int, float]] = deque()

    def add(self, t_ns: int, tilt_rad: float) -> None:
        """Take a sample; NaN is none."""
        if not isfinite(tilt_rad):
            return
        samples = self._samples
        if samples and not 0 <= t_ns - samples[-1][0] <= self._age_limit_ns:
            samples.clear()
        samples.append((t_ns, tilt_rad))
        while len(samples) > _LEAST_SAMPLES and samples[1][0] <= t_ns - _LASTS_NS:
            samples.popleft()

    def tilt_rad(self, t_ns: int) -> Optional[float]:
        """Return it, 0..pi rad; None: unknown."""
        samples = self._samples
        if len(samples) < _LEAST_SAMPLES or t_ns - samples[-1][0] > self._age_limit_ns:
            return None
        if samples[-1][0] - samples[0][0] < _LASTS_NS:
            return None
        return min(tilt_rad for _, tilt_rad in samples)


def _across(up: Vector) -> float:
    """Return the part of a vector across the z axis; `hypot` rounds differently on Python 3.8 and 3.11."""
    return sqrt(up[0] * up[0] + up[1] * up[1])


def angle_between(first: Vector, second: Vector) -> float:
    """Return the angle between two vectors, 0..pi rad; pi when one of them is zero or not finite: they do not agree."""
    lengths = norm(first) * norm(second)
    if not 0 < lengths < inf:
        return pi
    cosine = sum(a * b for a, b in zip(first, second)) / lengths
    return acos(max(-1.0, min(1.0, cosine)))


def turn_between(first: Quaternion, second: Quaternion) -> float:
    """Return the angle by which one orientation is turned against another, 0..pi rad; pi when one of them is none."""
    lengths = sqrt(sum(part * part for part in first)) * sqrt(sum(part * part for part in second))
    if not 0 < lengths < inf:
        return pi
    cosine = sum(a * b for a, b in zip(first, second)) / lengths
    return 2 * acos(min(1.0, abs(cosine)))  # a quaternion and its negative are the same orientation


def describe_tilt(up: Vector) -> str:
    """Return a tilt for a person, e.g. "14 deg to the left": the side that is down."""
    tilt_rad = tilt_of(up)
    if not isfinite(tilt_rad):
        return "by an unknown angle"
    if tilt_rad > _UPSIDE_DOWN_RAD:
        return f"{degrees(tilt_rad):.0f} deg, upside down"
    length = _across(up) or 1.0
    words: List[str] = []
    if abs(up[0]) / length > _SIDE:
        words.append("forward" if up[0] < 0 else "backward")
    if abs(up[1]) / length > _SIDE:
        words.append("to the left" if up[1] < 0 else "to the right")
    return " ".join([f"{degrees(tilt_rad):.0f} deg", " and ".join(words)]).strip()


def likely_mistake(magnitude: float, gravity_m_s2: float) -> str:
    """Return what is likely wrong when the magnitude of gravity is; never empty.

    A thousandth of g and a centimetre per second squared differ by 2 %, less than sensors do: both are named.
    """
    units = (("g", 1.0), ("milli-g", 1000.0), ("cm/s^2", 100 * gravity_m_s2), ("mm/s^2", 1000 * gravity_m_s2))
    near = [unit for unit, expected in units if abs(magnitude / expected - 1) < _NEAR]
    if near:
        return f"it looks like {' or '.join(near)}: the driver must publish m/s^2"
    if magnitude < _NEAR * gravity_m_s2:
        return "it measures next to nothing: is gravity already subtracted, or is the sensor dead?"
    return "calibrate the accelerometer, and keep the vehicle still"


class ImuStatistics(NamedTuple):
    """What an IMU measured over a window, in its own frame.

    Args:
        samples: how many.
        acceleration: mean specific force, m/s^2.
        deviation: standard deviation of the specific force, all axes together, m/s^2.
        turn_rate: magnitude of the mean turn rate, rad/s; None when it has none.
    """

    samples: int
    acceleration: Vector
    deviation: float
    turn_rate: Optional[float]


class _Bucket:
    """Sums over one bucket of time."""

    __slots__ = ("count", "gx", "gy", "gz", "number", "squares", "turns", "x", "y", "z")

    def __init__(self, number: int) -> None:
        self.number = number
        self.count = self.turns = 0
        self.x = self.y = self.z = self.squares = self.gx = self.gy = self.gz = 0.0


class GravityWindow:
    """Sliding sums of an IMU.

    Args:
        span_ns: how much is kept.
    """

    def __init__(self, span_ns: int) -> None:
        self._span_ns = span_ns
        self._buckets: Deque[_Bucket] = deque()
        self.last_ns: Optional[int] = None
        self.first_ns: Optional[int] = None

    def add(self, t_ns: int, acceleration: Vector, turn_rate: Optional[Vector] = None) -> None:
        """Add a sample. One that is not finite, or beyond any sensor, is not added."""
        x, y, z = acceleration
        squares = x * x + y * y + z * z
        if not squares < PLAUSIBLE_M2_S4:
            return
        bucket = self._bucket(t_ns)
        bucket.count += 1
        bucket.x += x
        bucket.y += y
        bucket.z += z
        bucket.squares += squares
        if turn_rate is not None and isfinite(sum(turn_rate)):
            bucket.turns += 1
            bucket.gx += turn_rate[0]
            bucket.gy += turn_rate[1]
            bucket.gz += turn_rate[2]

    @property
    def span_ns(self) -> int:
        """How much is kept."""
        return self._span_ns

    def skip(self, times: Sequence[int]) -> None:
        """Add samples that are too old to be kept: only when they came counts, in order, good ones alone."""
        for t_ns in times:
            if self.last_ns is None or t_ns - self.last_ns > _GAP_NS:
                self.first_ns = t_ns
            self.last_ns = t_ns

    def statistics(self, t_ns: int, window_ns: int) -> Optional[ImuStatistics]:
        """Return what was measured in the window that ends at a time; None when nothing was."""
        first, last = (t_ns - window_ns) // BUCKET_NS, t_ns // BUCKET_NS
        count = turns = 0
        x = y = z = squares = gx = gy = gz = 0.0
        for bucket in self._buckets:
            if first <= bucket.number <= last:
                count += bucket.count
                x += bucket.x
                y += bucket.y
                z += bucket.z
                squares += bucket.squares
                turns += bucket.turns
                gx += bucket.gx
                gy += bucket.gy
                gz += bucket.gz
        if not count:
            return None
        x, y, z = x / count, y / count, z / count
        variance = squares / count - (x * x + y * y + z * z)
        turn_rate = norm((gx / turns, gy / turns, gz / turns)) if turns else None
        return ImuStatistics(count, (x, y, z), sqrt(max(0.0, variance)), turn_rate)

    def _bucket(self, t_ns: int) -> _Bucket:
        """Return the bucket of a time, and drop what is too old; time that jumps backwards empties the window."""
        number, buckets = t_ns // BUCKET_NS, self._buckets
        if self.last_ns is None or (buckets and number < buckets[-1].number):
            buckets.clear()
            self.first_ns = t_ns
        elif t_ns - self.last_ns > _GAP_NS:
            self.first_ns = t_ns  # what came before the gap does not tell what was in it
        self.last_ns = t_ns
        if not buckets or buckets[-1].number != number:
            buckets.append(_Bucket(number))
            oldest = (t_ns - self._span_ns) // BUCKET_NS
            while buckets[0].number < oldest:
                buckets.popleft()
        return buckets[-1]
