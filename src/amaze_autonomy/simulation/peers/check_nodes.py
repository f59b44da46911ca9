"""The simulated landing detection node: the very detector of `monitoring/`, fed with the simulated range finder."""

from __future__ import annotations

from collections import deque
from typing import Deque, Dict, List, NamedTuple, Tuple

from amaze_autonomy.engine.commands import RunCheck
from amaze_autonomy.engine.events import Event, LandedStatus
from amaze_autonomy.monitoring.landing import LandingDetector
from amaze_autonomy.monitoring.state_estimation import StateEstimationMonitor

from ...engine.events import Check
from ..sensors.readings import EstimateReader, ImuReader, RangeReader
from ..sensors.streams import Batch
from ..vehicle.vehicle import Pose
from .peer import Cadence, Peer, Site, slowness

__all__ = ["LandingDetection", "StateEstimation"]


class LandingDetection(Peer):
    """Looks at the range, the tilt, and what the autopilot says."""

    name = "landing_detection"

    def __init__(self, site: Site) -> None:
        super().__init__(site)
        self._detector = LandingDetector(site.settings.landing)
        self._reader = RangeReader(site.settings.landing, site.noise(self.name))
        self._cadence = Cadence(site.settings.rates.landing_detection_rate_hz)

    def checks(self, t_ns: int, command: RunCheck) -> Tuple[Check, ...]:  # noqa: ARG002
        """Tell whether the vehicle is on the ground."""
        return self._detector.checks(t_ns)

    def step(self, t_ns: int) -> List[Event]:
        """Take in what came, judge, and tell."""
        self._feed(t_ns)
        verdict = self._detector.evaluate(t_ns)
        if not self._cadence.due(t_ns, verdict.landed, slowness(self.site, self.name)):
            return []
        distance = None if verdict.distance_m is None else round(verdict.distance_m, 4)
        return [LandedStatus(t_ns=t_ns, landed=verdict.landed, distance_m=distance, reason=verdict.reason)]

    def _feed(self, t_ns: int) -> None:
        vehicle, topic = self.site.vehicle, self.site.settings.landing.topic
        self._detector.add_tilt(t_ns, vehicle.tilt_rad)
        if self.site.autopilot_speaks():
            self._detector.add_vertical_speed(t_ns, vehicle.velocity_m_s[2])
            self._detector.add_autopilot(t_ns, vehicle.landed)
        pose = vehicle.pose
        for batch in self.site.batches.get(topic, ()):
            for stamp_ns in self.site.streams[topic].stamps(batch):
                self._detector.add_range(stamp_ns, self._reader.read(pose, batch))


# --- state estimation -------------------------------------------------------------------------------------------------
# The simulated state estimation check: the very monitor of `monitoring/`, on what IMU and estimator said last.
#
# It is asked a few times per flight, so the samples are only made when it is asked: until then their number, their
# times and where the vehicle was are kept, for as long as the monitor looks back.


_S = 1_000_000_000
_MORE_NS = 2 * _S  # than the monitor looks back: its rate needs a while to be known


class _Seen(NamedTuple):
    """Samples that came, and where the vehicle was."""

    topic: str
    batch: Batch
    pose: Pose


class StateEstimation(Peer):
    """Remembers what came; judges when asked."""

    name = "state_estimation"

    def __init__(self, site: Site) -> None:
        super().__init__(site)
        spec = site.settings.state_estimation
        self._topics = tuple(topic for topic in (spec.topic, spec.imu_topic) if topic)
        self._span_ns = max(spec.still_ns, spec.window_ns) + _MORE_NS
        self._seen: Deque[_Seen] = deque()
        self._last: Dict[str, _Seen] = {}
        self._imu = ImuReader(spec, site.noise("imu"))
        self._estimate = EstimateReader(site.noise("estimate"))

    def checks(self, t_ns: int, command: RunCheck) -> Tuple[Check, ...]:  # noqa: ARG002
        """Tell whether the states are valid."""
        self._take_in(t_ns)
        return self._monitor(t_ns).check(t_ns).checks

    def step(self, t_ns: int) -> List[Event]:
        """Remember what came."""
        self._take_in(t_ns)
        return []

    def _take_in(self, t_ns: int) -> None:
        pose = self.site.vehicle.pose
        for topic in self._topics:
            known = self._last.get(topic)
            for batch in self.site.batches.get(topic, ()):
                if known is None or batch.number > known.batch.number:
                    known = self._last[topic] = _Seen(topic, batch, pose)
                    self._seen.append(known)
        while self._seen and self._seen[0].batch.last_ns < t_ns - self._span_ns:
            self._seen.popleft()

    def _monitor(self, t_ns: int) -> StateEstimationMonitor:
        """Return a monitor that has heard everything it looks back at."""
        spec = self.site.settings.state_estimation
        monitor = StateEstimationMonitor(spec)
        oldest_ns = t_ns - self._span_ns
        silent = [seen for seen in self._last.values() if seen.batch.last_ns < oldest_ns]
        for seen in (*silent, *self._seen):
            for stamp_ns in self.site.streams[seen.topic].stamps(seen.batch):
                if seen.topic == spec.topic:
                    monitor.add_estimate(stamp_ns, self._estimate.read(seen.pose, seen.batch))
                else:
                    reading = self._imu.read(seen.pose, seen.batch)
                    monitor.add_imu(stamp_ns, reading.force, reading.turn_rate)
        return monitor
