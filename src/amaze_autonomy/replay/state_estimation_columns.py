"""At which looks at the state check does every row that is followed surely pass? Those need no look.

Computed for all looks of a recording at once, and with a margin beside which all rounding is nothing: what is not sure
is looked at by the check itself, so that its rows, words and values never come from here.
"""

from __future__ import annotations

from typing import Any, Optional, Tuple

import numpy as np

from amaze_autonomy.monitoring.gravity import BUCKET_NS, PLAUSIBLE_M2_S4, rotation_from_rpy
from amaze_autonomy.monitoring.specs import StateEstimationSpec

from .topic_columns import Track

__all__ = ["unsure_looks"]

_S = 1_000_000_000
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
