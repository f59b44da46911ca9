"""One component: its sources, the worst of them, and the code and row of the table that follow."""

from __future__ import annotations

from typing import Dict, Optional, Tuple

from amaze_autonomy.engine.checks import Check, Verdict
from amaze_autonomy.engine.events import ComponentStatus
from amaze_autonomy.engine.severity import SEVERITIES, Code, Restart, Severity

from .condition import FOREVER_NS, Condition, Level, Source
from .content import ContentMonitor
from .errors import UnknownComponentError
from .process import AnswerMonitor
from .rate import RateMonitor
from .restart import RestartMachine, RestartRequest
from .specs import ComponentSpec

__all__ = ["ComponentMonitor", "code_of"]

_S = 1_000_000_000


def code_of(level: Level, severity: Severity, restart: Restart) -> Code:
    """Return the code of a component: SEVERITIES when it failed, 2 when it is off, or too early to tell."""
    if level is Level.GOOD:
        return Code.NOMINAL
    if level is not Level.FAILED:
        return Code.NON_CRITICAL
    row = SEVERITIES[severity]
    return row.code_given_up if restart is Restart.GIVEN_UP else row.code


class ComponentMonitor:
    """What is known of one component."""

    def __init__(self, spec: ComponentSpec) -> None:
        samples, polling = spec.restart.good_samples, spec.polling
        self.spec = spec
        self.severity = spec.severity
        self.restarts = RestartMachine(spec)
        self.rates: Dict[str, RateMonitor] = {topic.topic: RateMonitor(topic, samples) for topic in spec.topics}
        self.contents: Dict[str, ContentMonitor] = {
            topic.topic: ContentMonitor(topic, samples) for topic in spec.topics
        }
        self.node = AnswerMonitor(f"node {spec.node}", polling.node_age_limit_ns) if spec.node else None
        self.driver = (
            AnswerMonitor(f"driver check {spec.driver[0]}", polling.driver_age_limit_ns) if spec.driver else None
        )
        self.autopilot = (
            AnswerMonitor(
                f"the autopilot's {spec.autopilot.value}", polling.autopilot_age_limit_ns, polling.autopilot_reports
            )
            if spec.autopilot
            else None
        )
        self._sources: Tuple[Source, ...] = self._all_sources()
        self.condition = Condition(Level.STARTING)
        self.status = ComponentStatus(spec.name, Code.NOMINAL)
        self.changes_at_ns = FOREVER_NS
        self._grace_end_ns = 0

    def start(self, t_ns: int, grace_ns: int) -> None:
        """Begin to watch."""
        self._grace_end_ns = t_ns + grace_ns
        for source in self._sources:
            source.start(t_ns, grace_ns)

    def rate(self, topic: Optional[str]) -> RateMonitor:
        """Return the monitor of a topic; None: of the first."""
        return self.rates[self._topic(topic)]

    def content(self, topic: Optional[str]) -> ContentMonitor:
        """Return the monitor of a topic's content; None: of the first topic."""
        return self.contents[self._topic(topic)]

    def evaluate(self, t_ns: int) -> Optional[RestartRequest]:
        """Judge the component at a time: `condition`, `status` and `changes_at_ns`. Return a restart to be made now."""
        worst: Optional[Condition] = None
        changes_at_ns = FOREVER_NS
        for source in self._sources:
            condition = source.evaluate(t_ns)
            changes_at_ns = min(changes_at_ns, condition.changes_at_ns)
            if worst is None or condition.level > worst.level:
                worst = condition
        self.condition = worst if worst is not None else self.condition
        request = self.restarts.update(t_ns, failed=self.condition.level is Level.FAILED)
        self.changes_at_ns = min(changes_at_ns, self.restarts.changes_at_ns)
        self._update_status()
        return request

    @property
    def steady(self) -> bool:
        """True when its rates, and nothing else, say that it is as intended, and it is not being restarted."""
        rates = len(self._sources) == len(self.rates) > 0
        return rates and self.condition.level is Level.GOOD and self.restarts.restart is Restart.NONE

    def fixable(self) -> bool:
        """Return True when it is on its way: it starts up, or the watchdog may still restart it."""
        if self.condition.level is Level.STARTING:
            return True
        failed = self.condition.level is Level.FAILED
        return failed and self.restarts.possible and self.restarts.restart is not Restart.GIVEN_UP

    def fixed_by_ns(self) -> Optional[int]:
        """Return when it is given up, or has come up, at the latest; None when nothing is under way."""
        if self.condition.level is Level.STARTING:
            return max(self._grace_end_ns, self.changes_at_ns)
        return self.restarts.until_ns

    def row(self, *, required: bool, tolerated: bool) -> Check:
        """Return its row of the pre-flight table."""
        condition = self.condition
        age_s = None if condition.age_ns is None else condition.age_ns / _S
        verdict = self._verdict(required=required, tolerated=tolerated)
        comes = self.condition.level is Level.STARTING
        advice = self._advice(verdict)
        return Check(
            self.spec.name, verdict, condition.value, condition.limit, condition.unit, age_s, advice, heals=comes
        )

    def _verdict(self, *, required: bool, tolerated: bool) -> Verdict:
        if self.condition.level is Level.GOOD:
            return Verdict.PASS
        if not required or (
            tolerated and self.status.code is Code.NON_CRITICAL and self.condition.level is not Level.STARTING
        ):
            return Verdict.WARN
        return Verdict.UNKNOWN if self.condition.level is Level.STARTING else Verdict.FAIL

    def _advice(self, verdict: Verdict) -> str:
        if verdict is Verdict.PASS:
            return ""
        return f"{self.condition.reason}; {self._what_to_do()}"

    def _what_to_do(self) -> str:
        if self.condition.level is Level.STARTING:
            return "it is starting up, wait"
        if self.restarts.restart is Restart.TRYING:
            return "the watchdog is restarting it, wait"
        if self.restarts.restart is Restart.GIVEN_UP:
            return "restarting it did not help: check its cable, power and log, then retry"
        if self.condition.level is Level.OFF:
            return "check its configuration and the load of the computer"
        if self.spec.group == "px4":
            return "the PX4 is never restarted by the watchdog: check it with its ground station"
        return "it is not restarted by the watchdog: check its cable, power and log, then retry"

    def _update_status(self) -> None:
        restart = self.restarts.restart
        code = code_of(self.condition.level, self.severity, restart)
        reason = self.condition.reason if code is not Code.NOMINAL else ""
        status = ComponentStatus(self.spec.name, code, restart, self.restarts.until_ns, reason)
        if status != self.status:
            self.status = status

    def _topic(self, topic: Optional[str]) -> str:
        if topic is None and self.spec.topics:
            return self.spec.topics[0].topic
        if topic in self.rates:
            return str(topic)
        raise UnknownComponentError(f"topic {topic} of {self.spec.name}", tuple(self.rates))

    def _all_sources(self) -> Tuple[Source, ...]:
        contents = [
            content
            for content in self.contents.values()
            if content.wanted or content.spec.stamp_tolerance_ns is not None
        ]
        answers = [monitor for monitor in (self.node, self.driver, self.autopilot) if monitor is not None]
        return (*self.rates.values(), *contents, *answers)
