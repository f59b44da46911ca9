"""One component: its sources, the worst of them, and the code and row of the table that follow."""

from __future__ import annotations

from typing import Dict, Optional, Tuple

from amaze_autonomy.engine.events import ComponentStatus

from ..engine.events import Check, Verdict
from ..engine.rules import SEVERITIES, Action, Code, Restart, Severity
from .condition import FOREVER_NS, Condition, Level, Source, seconds
from .errors import UnknownComponentError
from .rate import RateMonitor, return_time_ns
from .restart import RestartMachine, RestartRequest
from .specs import ComponentSpec, TopicSpec

# --- process ----------------------------------------------------------------------------------------------------------
# Does a node answer, does the look at a driver succeed, does the autopilot call its sensor healthy?
#
# A refusal fails at once; silence fails when the last good answer is too old. The autopilot's word changes the
# verdict only when it is said some times in a row.


_S = 1_000_000_000


class AnswerMonitor(Source):
    """The verdict on something that says yes, no, or nothing.

    Args:
        what: for the reasons, e.g. "node /camera".
        age_limit_ns: longest time without a yes or no.
        reports: yes or no so many times in a row changes the verdict; the first of all counts at once.
    """

    def __init__(self, what: str, age_limit_ns: int, reports: int = 1) -> None:
        super().__init__()
        self.what, self.age_limit_ns, self._reports = what, age_limit_ns, reports
        self._last_ns: Optional[int] = None
        self._good: Optional[bool] = None
        self._in_a_row = 0
        self._stale = False
        self._message = ""

    def add(self, t_ns: int, good: Optional[bool], message: str = "") -> bool:  # noqa: FBT001
        """Add an answer; None when it did not come or says nothing. Return True when that may change the verdict."""
        if good is None:
            return False
        was_stale, self._stale, self._last_ns = self._stale, False, t_ns
        self._in_a_row = self._in_a_row + 1 if good is not self._good else 0
        if self._good is not None and not was_stale and self._in_a_row < self._reports:
            return False
        self._good, self._message, self._in_a_row = good, message, 0
        return True

    def evaluate(self, t_ns: int) -> Condition:
        """Return the verdict at a time."""
        if self._last_ns is None:
            return self._absent(t_ns, f"{self.what}: no answer")
        self._last_ns = min(self._last_ns, t_ns)
        age_ns = t_ns - self._last_ns
        if age_ns > self.age_limit_ns:
            self._stale = True
            reason = f"{self.what}: no answer for longer than {seconds(self.age_limit_ns)}"
            return Condition(Level.FAILED, reason, age_ns / _S, self.age_limit_ns / _S, "s", age_ns, FOREVER_NS)
        changes_at_ns = self._last_ns + self.age_limit_ns + 1
        if self._good:
            return Condition(Level.GOOD, age_ns=age_ns, changes_at_ns=changes_at_ns)
        return Condition(
            Level.FAILED, f"{self.what}: {self._message or 'failed'}", age_ns=age_ns, changes_at_ns=changes_at_ns
        )


# --- content ----------------------------------------------------------------------------------------------------------
# Is what a topic says usable? Finite, changing, and stamped with the present.
#
# What is not finite counts as not having come, so that one NaN is no failure and only NaN is silence. A picture or a
# distance that never changes is a sensor that hangs. A stamp is off after some in a row, and right again likewise.


_STAMPS = 5  # in a row that change the verdict on the clock


class ContentMonitor(Source):
    """The verdict on the content of one topic, as far as its specification asks for it.

    Args:
        spec: what is intended.
        good_samples: usable messages in a row after a failure until it counts as back.
    """

    def __init__(self, spec: TopicSpec, good_samples: int = 5) -> None:
        super().__init__()
        self.spec, self._good_samples = spec, good_samples
        self._finite_ns: Optional[int] = None
        self._change_ns: Optional[int] = None
        self._digest: Optional[int] = None
        self._recovering = False
        self._good = 0
        self._stamps_off = False
        self._stamps_in_a_row = 0
        self._stamp_error_ns = 0

    @property
    def wanted(self) -> bool:
        """True when the specification asks for the content; otherwise nobody need look at it."""
        return self.spec.finite or self.spec.unchanged_limit_ns is not None

    def add(self, t_ns: int, *, finite: bool, digest: int) -> bool:
        """Add one message: are its numbers finite, and a digest of it. Return True when that may change the verdict."""
        unknown = self._finite_ns is None
        if self._overdue(t_ns):
            self._recovering, self._good = True, 0
        if self._digest != digest or self._change_ns is None or t_ns < self._change_ns:
            self._change_ns = t_ns
        self._digest = digest
        if finite:
            self._finite_ns = t_ns
        self._good = self._good + 1 if finite and self._fresh(t_ns) else 0
        recovered = self._recovering and self._good >= self._good_samples
        self._recovering = self._recovering and not recovered
        return unknown or recovered

    def add_stamp(self, t_ns: int, stamp_ns: int) -> bool:
        """Add the header stamp of a message that came at a time. True when that changes the verdict."""
        limit_ns = self.spec.stamp_tolerance_ns
        if limit_ns is None:
            return False
        self._stamp_error_ns = t_ns - stamp_ns
        off = abs(self._stamp_error_ns) > limit_ns
        self._stamps_in_a_row = self._stamps_in_a_row + 1 if off is not self._stamps_off else 0
        if self._stamps_in_a_row < _STAMPS:
            return False
        self._stamps_off, self._stamps_in_a_row = off, 0
        return True

    def evaluate(self, t_ns: int) -> Condition:
        """Return the verdict at a time: on the content first, then on the clock."""
        content = self._content(t_ns) if self.wanted else Condition(Level.GOOD)
        if content.level is not Level.GOOD or not self._stamps_off:
            return content
        limit_ns = self.spec.stamp_tolerance_ns or 0
        reason = f"stamps on {self.spec.topic} are more than {seconds(limit_ns)} off the clock"
        value_s = self._stamp_error_ns / _S
        limit_s = limit_ns / _S
        return content._replace(
            level=Level.OFF, reason=reason, value=value_s, limit=limit_s, unit="s", other_limit=-limit_s
        )

    def _overdue(self, t_ns: int) -> bool:
        """Return True when the content had failed before the message that comes now."""
        if self.spec.finite and self._finite_ns is not None and t_ns - self._finite_ns > self.spec.silence_limit_ns:
            return True
        return not self._fresh(t_ns)

    def _fresh(self, t_ns: int) -> bool:
        limit_ns = self.spec.unchanged_limit_ns
        return limit_ns is None or self._change_ns is None or t_ns - self._change_ns <= limit_ns

    def _content(self, t_ns: int) -> Condition:
        if self._finite_ns is None and self._change_ns is None:
            return self._absent(t_ns, f"no content of {self.spec.topic}")
        conditions = [self._finite(t_ns), self._changing(t_ns)]
        worst = max(conditions, key=lambda condition: condition.level)
        if worst.level is Level.FAILED:
            self._recovering, self._good = True, 0
        elif self._recovering and worst.level is Level.GOOD:
            worst = Condition(
                Level.FAILED, f"the content of {self.spec.topic} is usable again, not yet for long enough"
            )
        return worst._replace(changes_at_ns=min(condition.changes_at_ns for condition in conditions))

    def _finite(self, t_ns: int) -> Condition:
        if not self.spec.finite:
            return Condition(Level.GOOD)
        if self._finite_ns is None:
            return self._absent(t_ns, f"no finite value on {self.spec.topic}")
        self._finite_ns = min(self._finite_ns, t_ns)
        limit_ns = self.spec.silence_limit_ns
        return _aged(t_ns - self._finite_ns, limit_ns, t_ns, f"nothing but NaN or infinity on {self.spec.topic}")

    def _changing(self, t_ns: int) -> Condition:
        limit_ns = self.spec.unchanged_limit_ns
        if limit_ns is None or self._change_ns is None:
            return Condition(Level.GOOD)
        self._change_ns = min(self._change_ns, t_ns)
        return _aged(t_ns - self._change_ns, limit_ns, t_ns, f"the content of {self.spec.topic} has not changed")


def _aged(age_ns: int, limit_ns: int, t_ns: int, what: str) -> Condition:
    """Return the verdict on something that must not grow older than a limit."""
    if age_ns > limit_ns:
        reason = f"{what} for longer than {seconds(limit_ns)}"
        return Condition(Level.FAILED, reason, age_ns / _S, limit_ns / _S, "s", age_ns, FOREVER_NS)
    return Condition(Level.GOOD, "", age_ns / _S, limit_ns / _S, "s", age_ns, t_ns - age_ns + limit_ns + 1)


# --- component --------------------------------------------------------------------------------------------------------


def code_of(level: Level, severity: Severity, restart: Restart) -> Code:
    """Return the code of a component: SEVERITIES when it failed, 2 when it is off, or too early to tell."""
    if level is Level.GOOD:
        return Code.NOMINAL
    if level is not Level.FAILED:
        return Code.NON_CRITICAL
    row = SEVERITIES[severity]
    return row.code_given_up if restart is Restart.GIVEN_UP else row.code


def return_time(spec: ComponentSpec) -> Tuple[int, str]:
    """Return how long a component that works again needs until it is back, and which of its sources needs longest.

    What the autopilot says is not counted: how often it does is not ours.
    """
    polling, samples = spec.polling, spec.restart.good_samples
    times = [
        (return_time_ns(topic, samples), f"{topic.topic} at {topic.rate_hz:g} Hz (good_samples: {samples})")
        for topic in spec.topics
    ]
    if spec.node:
        times.append((polling.node_period_ns + polling.node_answer_limit_ns, f"node {spec.node}"))
    if spec.driver:
        times.append((polling.driver_period_ns + polling.driver_run_limit_ns, f"driver check {spec.driver[0]}"))
    return max(times, default=(0, ""))


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
        self._grace_end_ns, self._in_grace = 0, False
        self._unheard = False  # something of it has not come yet, and has the time to

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
        self._in_grace = t_ns < self._grace_end_ns
        worst: Optional[Condition] = None
        changes_at_ns = FOREVER_NS
        self._unheard = False
        for source in self._sources:
            condition = source.evaluate(t_ns)
            self._unheard |= condition.level is Level.STARTING
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

    @property
    def _comes(self) -> bool:
        """True while it comes up by itself: it starts, or is off in the time that it has for that (a burst, a gap)."""
        return self._starting or (self.condition.level is Level.OFF and self._in_grace)

    @property
    def _starting(self) -> bool:
        """True while something of it has not come yet, and nothing of it has failed; what is off may hide it."""
        level = self.condition.level
        return level is Level.STARTING or (level is Level.OFF and self._unheard)

    @property
    def landed_for(self) -> bool:
        """True when its failure would be landed for, at once or after a wait."""
        row = SEVERITIES[self.severity]
        return Action.LAND in (row.action, row.fallback)

    def fixable(self) -> bool:
        """Return True when it is on its way: it comes up, or the watchdog may still restart it."""
        if self._comes:
            return True
        failed = self.condition.level is Level.FAILED
        return failed and self.restarts.possible and self.restarts.restart is not Restart.GIVEN_UP

    def fixed_by_ns(self) -> Optional[int]:
        """Return when it is given up, or has come up, at the latest; None when nothing is under way."""
        if self._starting:
            return max(self._grace_end_ns, self.changes_at_ns)
        return self._grace_end_ns if self._comes else self.restarts.until_ns

    def row(self, *, required: bool, tolerated: bool) -> Check:
        """Return its row of the pre-flight table."""
        condition = self.condition
        age_s = None if condition.age_ns is None else condition.age_ns / _S
        verdict = self._verdict(required=required, tolerated=tolerated)
        advice = self._advice(verdict)
        return Check(
            self.spec.name,
            verdict,
            condition.value,
            condition.limit,
            condition.unit,
            age_s,
            advice,
            heals=self._comes,
            other_limit=condition.other_limit,
        )

    def _verdict(self, *, required: bool, tolerated: bool) -> Verdict:
        if self.condition.level is Level.GOOD:
            return Verdict.PASS
        if self._starting and (required or self.landed_for):
            return Verdict.UNKNOWN
        if not required or (tolerated and self.status.code is Code.NON_CRITICAL):
            return Verdict.WARN
        return Verdict.FAIL

    def _advice(self, verdict: Verdict) -> str:
        if verdict is Verdict.PASS:
            return ""
        return f"{self.condition.reason}; {self._what_to_do()}"

    def _what_to_do(self) -> str:
        if self._starting:
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
