"""Series of a flight for a page: numbers of recorded messages, thinned without losing a peak, and packed.

A page holds more points than a screen has columns, so that one may zoom in, and fewer than a recording has: of each
bucket of neighbouring samples the first, the least, the greatest and the last are kept, and every gap.
"""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.monitoring.specs import EstimateSource

from ..replay.monitors.upsets import columns_of, tilt_deg
from ..replay.recordings.sources import Recordings

MOST_POINTS = 20_000
_KEPT = 4  # of each bucket: first, least, greatest, last
_S = 1e9
_MOST_BINS = 600
_GAP_PERIODS, _GAP_S = 5.0, 0.5
_MOST_GAPS = 200
_PER_RATE = 5  # messages that make a rate


@dataclass(frozen=True)
class Series:
    """One line of a plot.

    Args:
        name: in words, with the unit where the plot has several.
        t_s: seconds from the first message of the recording.
        values: NaN where there is a gap.
        scripted: it is not recorded: the scripted world said so.
        steps: a value stands until the next one.
        right: it has the axis on the right.
    """

    name: str
    t_s: Any
    values: Any
    scripted: bool = False
    steps: bool = False
    right: bool = False

    @property
    def known(self) -> bool:
        """True when it says anything."""
        return bool(np.isfinite(self.values).any())

    def plain(self, most: int = MOST_POINTS) -> Dict[str, Any]:
        """Return it for the page."""
        t_s, values = thinned(self.t_s, self.values, most)
        return {
            "name": self.name,
            "t": packed(t_s),
            "v": packed(values),
            "scripted": self.scripted,
            "steps": self.steps,
            "right": self.right,
        }


@dataclass(frozen=True)
class TopicRate:
    """How one watched topic came.

    Args:
        topic: its name.
        component: that it belongs to; empty: none.
        expected_hz: None: nobody says.
        messages: how many.
        rate_hz: from the first to the last; None for fewer than two messages.
        bins: messages per second in each bin.
        gaps: (begin, end) of each silence beyond the limit, the longest ones.
        longest_s: longest silence, and its begin; None for fewer than two messages.
        longest_at_s: see above.
    """

    topic: str
    component: str
    expected_hz: Optional[float]
    messages: int
    rate_hz: Optional[float]
    bins: Tuple[float, ...]
    gaps: Tuple[Tuple[float, float], ...]
    longest_s: Optional[float]
    longest_at_s: Optional[float]


def packed(values: Any) -> str:
    """Return numbers as the page takes them: 32-bit floats, little-endian, in base64."""
    return b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")


def thinned(t_s: Any, values: Any, most: int = MOST_POINTS) -> Tuple[Any, Any]:
    """Return at most about `most` points: of each bucket the first, the least, the greatest, the last; and all gaps."""
    t_s, values = np.asarray(t_s, float), np.asarray(values, float)
    count = len(values)
    if count <= most:
        return t_s, values
    size = -(-count * _KEPT // most)
    buckets = -(-count // size)
    padded = np.full(buckets * size, np.nan)
    padded[:count] = values
    rows, starts = padded.reshape(buckets, size), np.arange(buckets) * size
    least = starts + np.where(np.isnan(rows), np.inf, rows).argmin(axis=1)
    greatest = starts + np.where(np.isnan(rows), -np.inf, rows).argmax(axis=1)
    last = np.minimum(starts + size - 1, count - 1)
    kept = np.unique(np.concatenate((starts, least, greatest, last, _edges(values))))
    kept = kept[kept < count]
    return t_s[kept], values[kept]


def _edges(values: Any) -> Any:
    """Return the first places of gaps."""
    gone = np.isnan(values)
    return np.flatnonzero(gone & ~np.concatenate(([False], gone[:-1])))


def with_gaps(t_s: Any, values: Any) -> Tuple[Any, Any]:
    """Return the points with a NaN in each silence, so that no line is drawn across it."""
    t_s, values = np.asarray(t_s, float), np.asarray(values, float)
    if len(t_s) < 3:  # noqa: PLR2004
        return t_s, values
    steps = np.diff(t_s)
    limit = max(float(np.median(steps)) * _GAP_PERIODS, _GAP_S)
    after = np.flatnonzero(steps > limit) + 1
    return np.insert(t_s, after, t_s[after - 1] + 1e-3), np.insert(values, after, np.nan)


# --- estimate ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Estimates:
    """What a recorded estimator said: positions and tilt, and the speed where its message has one; all as arrays."""

    t_s: Any
    x: Any
    y: Any
    z: Any
    tilt: Any
    speed: Optional[Any] = None


def estimates_of(recordings: Recordings, topic: str, source: EstimateSource, start_ns: int) -> Optional[Estimates]:
    """Return the recorded estimates; None when there are none."""
    pose = "pose" if source is EstimateSource.POSE else "pose.pose"
    paths = [f"{pose}.position.{axis}" for axis in "xyz"] + [f"{pose}.orientation.{axis}" for axis in "xyzw"]
    moves = source is EstimateSource.ODOMETRY
    t_s, found = columns_of(
        recordings, topic, [*paths, *((f"twist.twist.linear.{axis}" for axis in "xyz") if moves else ())], start_ns
    )
    if not len(t_s):
        return None
    speed = np.sqrt(sum(column * column for column in found[7:10])) if moves else None
    return Estimates(t_s, found[0], found[1], found[2], tilt_deg(*found[3:7]), speed)


# --- rates ------------------------------------------------------------------------------------------------------------


def rates_of(
    recordings: Recordings, watched: Sequence[Tuple[str, str, Optional[float], Optional[float]]], bin_s: float
) -> List[TopicRate]:
    """Return how each watched topic came.

    Args:
        recordings: open.
        watched: topic, its component, expected rate, silence that is too long in seconds.
        bin_s: over which rates are counted.
    """
    start_ns, end_ns = recordings.start_ns, recordings.end_ns
    length_s = max((end_ns - start_ns) / _S, bin_s)
    edges = np.arange(0.0, length_s + bin_s * 0.999, bin_s)
    found: List[TopicRate] = []
    for topic, component, expected_hz, limit_s in watched:
        there = topic in recordings.topics and topic not in recordings.missing
        t_ns = recordings.times(recordings.topics.index(topic)) if there else np.zeros(0, np.int64)
        found.append(_rate((t_ns - start_ns) / _S, (topic, component, expected_hz, limit_s), edges, length_s))
    return found


def _rate(t_s: Any, about: Tuple[str, str, Optional[float], Optional[float]], edges: Any, length_s: float) -> TopicRate:
    topic, component, expected_hz, limit_s = about
    bins = _binned(t_s, edges, length_s, expected_hz)
    if len(t_s) < 2 or t_s[-1] <= t_s[0]:  # noqa: PLR2004
        return TopicRate(topic, component, expected_hz, len(t_s), None, bins, (), None, None)
    steps = np.diff(t_s)
    rate_hz = (len(t_s) - 1) / float(t_s[-1] - t_s[0])
    limit = max(limit_s or 0.0, _GAP_PERIODS / (expected_hz or rate_hz))
    long = np.flatnonzero(steps > limit)
    long = np.sort(long[np.argsort(-steps[long], kind="stable")[:_MOST_GAPS]])
    longest = int(steps.argmax())
    return TopicRate(
        topic,
        component,
        expected_hz,
        len(t_s),
        rate_hz,
        bins,
        tuple((round(float(t_s[place]), 3), round(float(t_s[place + 1]), 3)) for place in long),
        float(steps[longest]),
        float(t_s[longest]),
    )


def _binned(t_s: Any, edges: Any, length_s: float, expected_hz: Optional[float]) -> Tuple[float, ...]:
    """Return the rate in each bin, over as many neighbours as it takes for some messages to be expected.

    The recording ends within the last bin: only what is recorded of it counts, together with the bin before where that
    is less than half of it.
    """
    bin_s = float(edges[1] - edges[0])
    wide = 1 if not expected_hz else max(1, int(np.ceil(_PER_RATE / (expected_hz * bin_s))))
    counts = np.histogram(t_s, edges)[0]
    recorded_s = np.diff(np.minimum(edges, length_s))
    window = np.ones(min(wide, len(counts)))
    rates = np.convolve(counts, window, "same") / np.convolve(recorded_s, window, "same")
    if wide == 1 and recorded_s[-1] < bin_s / 2:
        rates[-1] = counts[-2:].sum() / recorded_s[-2:].sum()
    return tuple(round(float(each), 2) for each in rates)


def bin_of(length_s: float) -> float:
    """Return the width of the bins of a recording: a second, or more where it is long."""
    return max(1.0, float(np.ceil(length_s / _MOST_BINS)))
