"""The simulated nodes that judge: the very monitors of `monitoring/`, fed with the streams of the world."""

from __future__ import annotations

from collections import deque
from typing import Deque, Dict, List, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.commands import Request, RunCheck
from amaze_autonomy.engine.events import CheckReply, Event, LandedStatus, Outcome, WatchdogAction
from amaze_autonomy.engine.state import evolve
from amaze_autonomy.monitoring.initialisation import Initialisation
from amaze_autonomy.monitoring.landing import LandingDetector
from amaze_autonomy.monitoring.restart import RestartRequest
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec, RestartPolicy
from amaze_autonomy.monitoring.state_estimation import StateEstimationMonitor
from amaze_autonomy.monitoring.watchdog import TakeoffCheck, Watchdog

from ...engine.events import Check, VehicleLanded, Verdict
from ...monitoring.watchdog import Streams
from ..scenario import Subject
from ..sensors import EstimateReader, ImuReader, RangeReader
from ..streams import Batch, Content
from ..vehicle.vehicle import Pose
from .peer import Cadence, Peer, Site, slowness

# --- the watchdog -----------------------------------------------------------------------------------------------------


_S = 1_000_000_000


class SimulatedWatchdog(Peer):
    """Watches from the first request on; asks the world to restart what failed."""

    name = "watchdog"

    def __init__(self, site: Site) -> None:
        super().__init__(site)
        rate_hz = site.settings.rates.watchdog_action_rate_hz
        self._watchdog = Watchdog(site.settings.components)
        self._streams = Streams(self._watchdog, action_period_ns=round(_S / rate_hz))
        self._cadence = Cadence(rate_hz)
        self._polled_ns: Dict[Tuple[str, str], int] = {}
        self._heard_ns = -1
        self._asked: Dict[str, RestartRequest] = {}
        self._pending: Optional[RunCheck] = None
        self._pending_until_ns = 0
        self._action: Optional[WatchdogAction] = None

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Begin to watch, or make a new take-off check; the first answer waits for the components to come up."""
        if not isinstance(command, RunCheck):
            return super().answer(t_ns, command)
        first = not self._watchdog.started
        mission = self.site.settings.mission(command.mission_id)
        self._watchdog.start(
            t_ns,
            () if mission is None else mission.severities,
            command.required,
            () if mission is None else mission.tolerated,
            command.startup_time_ns,
        )
        if first:
            self.site.note("watched")
        if first or self._pending is not None:
            until_ns = t_ns + command.startup_time_ns if first else self._pending_until_ns
            self._pending, self._pending_until_ns = command, until_ns
            return None
        return self._reply(t_ns, command, self._watchdog.checks(t_ns))

    def step(self, t_ns: int) -> List[Event]:
        """Take in what came, judge, restart, and tell."""
        if self.site.faults.active(Subject.PROCESS, "stuck", self.name) is not None:
            return self._repeat(t_ns)
        self._feed(t_ns)
        if not self._watchdog.started:
            return []
        events = self._tell(t_ns)
        self._restart(t_ns)
        if self._pending is not None:
            check = self._watchdog.checks(t_ns)
            coming_up = any(row.verdict is Verdict.UNKNOWN for row in check.checks)
            if check.ready or not coming_up or t_ns >= self._pending_until_ns:
                events.append(self._reply(t_ns, self._pending, check))
                self._pending = None
        return events

    def _tell(self, t_ns: int) -> List[Event]:
        action, info = self._streams.poll(t_ns)
        self._action = action or self._action
        slow = slowness(self.site, self.name)
        if slow > 1.0:
            due = self._action is not None and self._cadence.due(t_ns, None, slow)
            return [evolve(self._action, t_ns=t_ns)] if due and self._action is not None else []
        return [event for event in (action, info) if event is not None]

    def _repeat(self, t_ns: int) -> List[Event]:
        """Send the last message again: the thread that sends lives, the loop that watches does not."""
        if self._action is None or not self._cadence.due(t_ns, None):
            return []
        self._action = evolve(self._action, t_ns=t_ns, sequence=self._action.sequence + 1)
        return [self._action]

    def _feed(self, t_ns: int) -> None:
        """Hand over samples, answers of nodes and drivers, and what the autopilot said."""
        for component in self.site.settings.components:
            for topic in component.topics:
                for batch in self.site.batches.get(topic.topic, ()):
                    self._watchdog.add_samples(component.name, batch.place_ns, batch.samples, topic.topic)
                    if topic.finite or topic.unchanged_limit_ns is not None:
                        self._content(component.name, topic.topic, batch)
            self._poll(t_ns, component)
        if self.site.autopilot_speaks():
            vehicle = self.site.vehicle
            self._watchdog.add_vehicle(armed=vehicle.armed, on_ground=vehicle.landed is VehicleLanded.ON_GROUND)
        heard = self.site.health
        if heard is not None and heard[0] > self._heard_ns and self.site.autopilot_speaks():
            self._heard_ns = heard[0]
            self._watchdog.add_autopilot(t_ns, {sensor: heard[1].get(sensor.value) for sensor in AutopilotSensor})

    def _content(self, name: str, topic: str, batch: Batch) -> None:
        digest = 0 if batch.content == Content.STUCK else batch.number
        finite = batch.content != Content.NAN
        self._watchdog.add_content(name, batch.place_ns, finite=finite, digest=digest, topic=topic)

    def _poll(self, t_ns: int, component: ComponentSpec) -> None:
        """Ask a component's node, and look at its driver, when that is due."""
        name, polling = component.name, component.polling
        if component.node is not None and self._is_due(t_ns, ("node", name), polling.node_period_ns):
            alive = self.site.component_lives(name)
            self._watchdog.add_process(name, alive, t_ns, "" if alive else "connection refused")
        if component.driver and self._is_due(t_ns, ("driver", name), polling.driver_period_ns):
            alive = self.site.component_lives(name)
            self._watchdog.add_driver(name, alive, t_ns, "" if alive else "no such device")

    def _is_due(self, t_ns: int, what: Tuple[str, str], period_ns: int) -> bool:
        if t_ns < self._polled_ns.get(what, 0):
            return False
        self._polled_ns[what] = t_ns + period_ns
        return True

    def _restart(self, t_ns: int) -> None:
        """Hand requests to the world, and its outcomes to the watchdog."""
        for name, good in self.site.restarted:
            request = self._asked.pop(name, None)
            if request is not None:
                self._watchdog.restart_outcome(request, t_ns, good=good)
        for request in self._watchdog.restart_requests():
            self._asked[request.component] = request
            ended = self.site.of_node(request.component) if request.policy is RestartPolicy.NODE else ()
            self.site.restarts.begin(t_ns, request.component, ended)

    def _reply(self, t_ns: int, command: RunCheck, check: TakeoffCheck) -> CheckReply:
        return CheckReply(
            t_ns=t_ns,
            command_id=command.id,
            check=command.check,
            outcome=Outcome.ACCEPTED,
            ok=check.ready,
            checks=check.checks,
            fixable=check.fixable,
            being_fixed=check.being_fixed,
            until_ns=check.until_ns,
            components=self._watchdog.evaluate(t_ns),
        )


# --- the landing detection --------------------------------------------------------------------------------------------


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


_MORE_NS = 2 * _S  # than the monitor looks back: its rate needs a while to be known
_ANSWER_NS = _S // 5  # of the service that initialises the estimator


class _Seen(NamedTuple):
    """Samples that came, and where the vehicle was."""

    topic: str
    batch: Batch
    pose: Pose


class StateEstimation(Peer):
    """Remembers what came; judges when asked, and has an estimator begin that must be told to."""

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
        self._initialisation = Initialisation(site.settings.initialisation, _S)
        self._answer: Optional[Tuple[int, str]] = None

    def checks(self, t_ns: int, command: RunCheck) -> Tuple[Check, ...]:  # noqa: ARG002
        """Tell whether the states are valid."""
        self._take_in(t_ns)
        rows, due = self._initialisation.check(t_ns, self._monitor(t_ns).check(t_ns).checks)
        if due:
            self._answer = self._initialise(t_ns)
        return rows

    def entered(self, state: str) -> None:
        """Take notice of a pre-flight that begins."""
        self._initialisation.entered(state)

    def step(self, t_ns: int) -> List[Event]:
        """Remember what came; take the answer of the estimator."""
        self._take_in(t_ns)
        if self.site.autopilot_speaks():
            self._initialisation.heard(t_ns, armed=self.site.vehicle.armed)
        if self._answer is not None and t_ns >= self._answer[0]:
            self._initialisation.answered(t_ns, self._answer[1])
            self._answer = None
        return []

    def _initialise(self, t_ns: int) -> Tuple[int, str]:
        """Ask the estimator to begin; return when its answer is there, and why it did not, or nothing."""
        spec = self.site.settings.initialisation
        why = self.site.estimator.initialise()
        if why is None:
            return t_ns + spec.limit_ns, f"{spec.service}: no answer within {spec.limit_ns / _S:g} s"
        return t_ns + _ANSWER_NS, f"{spec.service}: {why}" if why else ""

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
