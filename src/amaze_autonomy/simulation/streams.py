"""The simulated sensors as streams: when samples come, how many came, and what goes wrong with them.

A healthy stream is computed by count: one addition per step, however many samples it had. What a sample holds is made
only for those who look at it (`sensors.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, NamedTuple, Optional

from .faults import Faults, flapping_ns
from .scenario import Fault, Subject

_S = 1_000_000_000
_MIX = 0x9E3779B1
_WORD = 0xFFFFFFFF


class SampleKind:
    """What a stream's messages are, by ROS type."""

    IMAGE = "sensor_msgs/Image"
    IMU = "sensor_msgs/Imu"
    RANGE = "sensor_msgs/Range"
    SCAN = "sensor_msgs/LaserScan"
    FLOAT = "std_msgs/Float32"
    POSE = "geometry_msgs/PoseStamped"
    POSE_WITH_COVARIANCE = "geometry_msgs/PoseWithCovarianceStamped"
    ODOMETRY = "nav_msgs/Odometry"
    FIX = "sensor_msgs/NavSatFix"
    FIELD = "sensor_msgs/MagneticField"
    PRESSURE = "sensor_msgs/FluidPressure"


class Content:
    """What is wrong with the content of a stream's samples; GOOD when nothing is."""

    GOOD = "good"
    NAN = "nan"
    STUCK = "stuck"
    READS = "reads"


@dataclass(frozen=True)
class StreamSettings:
    """One stream.

    Args:
        component: whose it is; empty for one that no component has (the state estimate).
        topic: where it is published.
        kind: one of SampleKind.
        rate_hz: samples per second.
        jitter: how far a stamp is off its place, as a fraction of the period.
    """

    component: str
    topic: str
    kind: str
    rate_hz: float
    jitter: float = 0.1


class Batch(NamedTuple):
    """Samples that came in one step.

    Args:
        samples: how many, at least 1.
        last_ns: stamp of the last one.
        place_ns: where that would be without jitter.
        period_ns: from one to the next.
        number: of the last one, from 1.
        content: what is wrong with what they say.
        value: what a sensor reads that reads one value only.
    """

    samples: int
    last_ns: int
    place_ns: int
    period_ns: int
    number: int
    content: str
    value: float


class Stream:
    """Counts the samples of one sensor while faults come and go."""

    def __init__(self, settings: StreamSettings, start_ns: int, seed: int) -> None:
        self.settings = settings
        self._period_ns = max(1, round(_S / settings.rate_hz))
        self._salt = (seed * 2654435761 + sum(ord(letter) * 131**n for n, letter in enumerate(settings.topic))) & _WORD
        self._next_ns = start_ns + round(settings.jitter * self._period_ns) + self._salt % self._period_ns
        self._number = 0

    def take(self, t_ns: int, faults: Faults, *, lives: bool = True) -> Optional[Batch]:
        """Return the samples up to a time that were not taken before; None when there are none."""
        if not lives:
            self._next_ns = max(self._next_ns, t_ns + 1)
            return None
        acting = faults.on(Subject.COMPONENT, self.settings.component) if self.settings.component else ()
        if not acting:
            return self._count(t_ns, self._period_ns, Content.GOOD, 0.0)
        if any(_silences(fault, since, t_ns) for fault, since in acting):
            self._next_ns = max(self._next_ns, t_ns + 1)
            return None
        period = self._period_ns
        content, value = Content.GOOD, 0.0
        for fault, _ in acting:
            if fault.kind.name == "slow":
                fraction = fault.number("rate_fraction")
                if fraction <= 0.0:
                    self._next_ns = max(self._next_ns, t_ns + 1)
                    return None
                period = round(period / fraction)
            elif fault.kind.name in _CONTENTS:
                content = fault.kind.name
                value = fault.number("value_m") if content == Content.READS else 0.0
        return self._count(t_ns, period, content, value)

    def stamps(self, batch: Batch) -> List[int]:
        """Return the stamp of every sample of a batch."""
        return [
            batch.place_ns - before * batch.period_ns - self._jitter(batch.number - before)
            for before in range(batch.samples - 1, -1, -1)
        ]

    def _count(self, t_ns: int, period_ns: int, content: str, value: float) -> Optional[Batch]:
        if t_ns < self._next_ns:
            return None
        count = (t_ns - self._next_ns) // period_ns + 1
        place = self._next_ns + (count - 1) * period_ns
        self._next_ns = place + period_ns
        self._number += count
        last = place - self._jitter(self._number)
        return Batch(count, last, place, period_ns, self._number, content, value)

    def _jitter(self, number: int) -> int:
        """Return by how much a stamp is early: deterministic, from the number of the sample."""
        mixed = ((number * _MIX) ^ self._salt) & _WORD
        return int(self.settings.jitter * self._period_ns * (mixed / (_WORD + 1)))


_CONTENTS = (Content.NAN, Content.STUCK, Content.READS)


def _silences(fault: Fault, since_ns: int, t_ns: int) -> bool:
    """Tell whether a fault lets no sample through just before a time; the world's steps end where that changes."""
    if fault.kind.name in ("silent", "killed"):
        return True
    if fault.kind.name != "flapping":
        return False
    off_ns, on_ns = flapping_ns(fault)
    return (t_ns - 1 - since_ns) % (off_ns + on_ns) < off_ns
