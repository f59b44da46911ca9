"""The simulated watchdog node: the very watchdog of `monitoring/`, fed with the streams of the world."""

from __future__ import annotations

from typing import Dict, List, Optional

from amaze_autonomy.engine.commands import Request, RunCheck
from amaze_autonomy.engine.events import CheckReply, Event, Outcome, WatchdogAction
from amaze_autonomy.engine.state import evolve
from amaze_autonomy.monitoring.restart import RestartRequest
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec
from amaze_autonomy.monitoring.watchdog import TakeoffCheck, Watchdog

from ...engine.events import Verdict
from ...monitoring.watchdog import Streams
from ..scenario import Subject
from ..sensors.streams import Batch, Content
from .peer import Cadence, Peer, Site, slowness

__all__ = ["SimulatedWatchdog"]

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
        self._polled_ns: Dict[str, int] = {}
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
        if component.node is None and not component.driver:
            return
        if t_ns < self._polled_ns.get(component.name, 0):
            return
        self._polled_ns[component.name] = t_ns + component.polling.node_period_ns
        alive = self.site.faults.active(Subject.COMPONENT, "killed", component.name) is None
        if component.node is not None:
            self._watchdog.add_process(component.name, alive, t_ns, "" if alive else "connection refused")
        if component.driver:
            self._watchdog.add_driver(component.name, alive, t_ns, "" if alive else "no such device")

    def _restart(self, t_ns: int) -> None:
        """Hand requests to the world, and its outcomes to the watchdog."""
        for name, good in self.site.restarted:
            request = self._asked.pop(name, None)
            if request is not None:
                self._watchdog.restart_outcome(request, t_ns, good=good)
        for request in self._watchdog.restart_requests():
            self._asked[request.component] = request
            self.site.restarts.begin(t_ns, request.component)

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
