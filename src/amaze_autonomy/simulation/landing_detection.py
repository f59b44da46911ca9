"""The simulated landing detection node: the very detector of `monitoring/`, fed with the simulated range finder."""

from __future__ import annotations

from typing import List, Optional

from amaze_autonomy.engine.commands import Request, RunCheck
from amaze_autonomy.engine.events import CheckReply, Event, LandedStatus, Outcome
from amaze_autonomy.monitoring.landing import LandingDetector

from .peer import Cadence, Peer, Site, refused, slowness
from .readings import RangeReader

__all__ = ["LandingDetection"]


class LandingDetection(Peer):
    """Looks at the range, the tilt, and what the autopilot says."""

    name = "landing_detection"

    def __init__(self, site: Site) -> None:
        super().__init__(site)
        self._detector = LandingDetector(site.settings.landing)
        self._reader = RangeReader(site.settings.landing, site.noise(self.name))
        self._cadence = Cadence(site.settings.rates.landing_detection_rate_hz)

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Tell whether the vehicle is on the ground."""
        if not isinstance(command, RunCheck):
            return refused(command, "not the landing detection's business")
        rows = self._detector.checks(t_ns)
        return CheckReply(
            t_ns=t_ns,
            command_id=command.id,
            check=command.check,
            outcome=Outcome.ACCEPTED,
            ok=all(row.passed for row in rows),
            checks=rows,
        )

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
