"""The simulated state estimation check: the very monitor of `monitoring/`, on what IMU and estimator said last.

It is asked a few times per flight, so the samples are only made when it is asked: until then their number, their times
and where the vehicle was are kept, for as long as the monitor looks back.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Dict, List, NamedTuple, Optional

from amaze_autonomy.engine.commands import Request, RunCheck
from amaze_autonomy.engine.events import CheckReply, Event, Outcome
from amaze_autonomy.monitoring.state_estimation import StateEstimationMonitor

from .peer import Peer, Site, refused
from .readings import EstimateReader, ImuReader
from .streams import Batch
from .vehicle import Pose

__all__ = ["StateEstimation"]

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

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Tell whether the states are valid."""
        if not isinstance(command, RunCheck):
            return refused(command, "not the state estimation's business")
        self._take_in(t_ns)
        verdict = self._monitor(t_ns).check(t_ns)
        return CheckReply(
            t_ns=t_ns,
            command_id=command.id,
            check=command.check,
            outcome=Outcome.ACCEPTED,
            ok=verdict.valid,
            checks=verdict.checks,
        )

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
