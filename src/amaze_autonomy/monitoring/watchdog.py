"""The watchdog's judgement: every component's code, what to restart, and whether the vehicle may take off.

Rules of this file:

* Nothing is judged before `start`. What arrives is cheap to add; `evaluate` does no work unless a verdict can have
  changed: something said so when it was added, or `next_ns` has come.
* Only here does health become a code (`component.code_of`, by engine.rules.SEVERITIES).
* It asks for restarts (`restart_requests`) and is told how they ended (`restart_outcome`).
"""

from __future__ import annotations

from typing import Callable, Dict, List, Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.events import ComponentStatus, WatchdogAction, WatchdogInfo, made

from ..engine.events import Check, Verdict
from ..engine.rules import Code, Severity
from .component import AnswerMonitor, ComponentMonitor
from .condition import FOREVER_NS
from .errors import UnknownComponentError
from .rate import RateMonitor
from .restart import RestartRequest
from .specs import AutopilotSensor, ComponentSpec

_S = 1_000_000_000


class TakeoffCheck(NamedTuple):
    """The answer to the take-off check (srv/StartWatchdog.srv).

    Args:
        ready: every required component is at code 1 (or at 2 and tolerated), and none that would be landed for has yet
            to come, required or not: it would fail in the air.
        fixable: everything that fails may come up, or be restarted, without a person.
        being_fixed: and that is under way.
        until_ns: when the last of it is given up; None when nothing is under way.
        checks: one row per component.
    """

    ready: bool
    fixable: bool
    being_fixed: bool
    until_ns: Optional[int]
    checks: Tuple[Check, ...]


class Watchdog:
    """Every component that is watched.

    Args:
        specs: the components; their order is the order of everything that comes out.
        new_check_after_ns: a `start` that comes so long after the one before is a new take-off check: components whose
            restarts were given up get new attempts.

    Raises:
        RestartRefusedError: a component of the PX4 has a restart.
    """

    def __init__(self, specs: Tuple[ComponentSpec, ...], new_check_after_ns: int = 5 * _S) -> None:
        self._components: Dict[str, ComponentMonitor] = {spec.name: ComponentMonitor(spec) for spec in specs}
        self._monitors: Tuple[ComponentMonitor, ...] = tuple(self._components.values())
        self._first_rates: Dict[str, RateMonitor] = {
            spec.name: self._components[spec.name].rate(None) for spec in specs if spec.topics
        }
        self._autopilot: Dict[AutopilotSensor, List[AnswerMonitor]] = {sensor: [] for sensor in AutopilotSensor}
        for monitor in self._monitors:
            if monitor.autopilot is not None and monitor.spec.autopilot is not None:
                self._autopilot[monitor.spec.autopilot].append(monitor.autopilot)
        self._new_check_after_ns = new_check_after_ns
        self._started_ns: Optional[int] = None
        self._in_flight = False
        self._reported: Dict[AutopilotSensor, int] = {}
        self._required: Tuple[str, ...] = ()
        self._tolerated: Tuple[str, ...] = ()
        self._statuses: Tuple[ComponentStatus, ...] = ()
        self._requests: List[RestartRequest] = []
        self._dirty = True
        self._evaluated_ns = 0
        self._next_ns = FOREVER_NS
        self.loop_counter = 0
        self.changes = 0
        self.latest_component = ""

    @property
    def started(self) -> bool:
        """True once the watching has begun."""
        return self._started_ns is not None

    @property
    def in_flight(self) -> bool:
        """True while the vehicle may fly, as far as it was heard."""
        return self._in_flight

    @property
    def next_ns(self) -> int:
        """When a verdict can change if nothing arrives; FOREVER_NS when none can. It may turn out that none has."""
        return self._next_ns

    @property
    def names(self) -> Tuple[str, ...]:
        """Names of the components."""
        return tuple(self._components)

    def start(
        self,
        t_ns: int,
        severities: Tuple[Tuple[str, Severity], ...] = (),
        required: Tuple[str, ...] = (),
        tolerated: Tuple[str, ...] = (),
        startup_ns: int = 10 * _S,
    ) -> None:
        """Begin to watch, or ask again for another mission; components not heard of have `startup_ns` to come up.

        In flight nothing is asked anew: whoever asks then, and for whatever, does not change what the flight is judged
        by.

        Args:
            t_ns: time of the request.
            severities: of the mission, in place of the specifications'.
            required: components that must be at code 1; empty: those whose specification says so. A component that
                would be landed for must have come before a takeoff, whether it is among them or not.
            tolerated: components that may be at code 2.
            startup_ns: counts from the first start only.
        """
        own = dict(severities)
        for name in own:
            self._component(name)
        if self.started and self._in_flight:
            return
        first, last_ns = self._started_ns is None, self._started_ns
        for monitor in self._monitors:
            monitor.severity = own.get(monitor.spec.name, monitor.spec.severity)
            if first:
                monitor.start(t_ns, startup_ns)
            if last_ns is not None and t_ns - last_ns >= self._new_check_after_ns:
                monitor.restarts.forget()
        self._started_ns, self._dirty = t_ns, True
        listed = tuple(monitor.spec.name for monitor in self._monitors if monitor.spec.required)
        self._required, self._tolerated = required or listed, tolerated

    def add_samples(self, name: str, last_t_ns: int, count: int = 1, topic: Optional[str] = None) -> None:
        """Add messages of a component's topic (the first one, or the one named), the last of which came at a time."""
        if topic is None and name in self._first_rates:
            monitor = self._first_rates[name]
        else:
            monitor = self._component(name).rate(topic)
        if monitor.add(last_t_ns, count):
            self._dirty = True

    def counter(self, name: str, topic: Optional[str] = None) -> Callable[[int], None]:
        """Return what adds one message at a time, as `add_samples` does, for those who add very many."""
        add = self._component(name).rate(topic).add

        def count(t_ns: int) -> None:
            if add(t_ns):
                self._dirty = True

        return count

    def rate(self, name: str, topic: Optional[str] = None) -> RateMonitor:
        """Return the monitor that `counter` adds to."""
        return self._component(name).rate(topic)

    @property
    def disturbed(self) -> bool:
        """True when something has said that a verdict may have changed, and nobody has looked yet."""
        return self._dirty

    @property
    def steady(self) -> bool:
        """True while every component is as intended, by its rates alone, and was so at the last look."""
        return self.started and not self._dirty and all(monitor.steady for monitor in self._monitors)

    def rest(self, until_ns: int) -> None:
        """Say that no verdict changes before a time: for who knows what comes."""
        self._next_ns = until_ns

    def add_content(self, name: str, t_ns: int, *, finite: bool, digest: int, topic: Optional[str] = None) -> None:
        """Add what a message says: are all its numbers finite, and a digest of its content."""
        self._dirty |= self._component(name).content(topic).add(t_ns, finite=finite, digest=digest)

    def add_stamp(self, name: str, t_ns: int, stamp_ns: int, topic: Optional[str] = None) -> None:
        """Add the header stamp of a message that came at a time."""
        self._dirty |= self._component(name).content(topic).add_stamp(t_ns, stamp_ns)

    def add_process(self, name: str, alive: Optional[bool], t_ns: int, message: str = "") -> None:  # noqa: FBT001
        """Add the answer of a component's node; False: refused or gone; None: it did not answer in time."""
        self._add_answer(self._component(name).node, f"node of {name}", alive, t_ns, message)

    def add_driver(self, name: str, good: bool, t_ns: int, message: str = "") -> None:  # noqa: FBT001
        """Add the outcome of a look at a component's driver; a run that took too long is False."""
        self._add_answer(self._component(name).driver, f"driver of {name}", good, t_ns, message)

    def add_autopilot(
        self,
        t_ns: int,
        health: Mapping[AutopilotSensor, Optional[bool]],
        *,
        link_age_s: float = 0.0,
        sequences: Mapping[AutopilotSensor, int] = {},
    ) -> None:
        """Add what a status says of the autopilot's sensors.

        Args:
            t_ns: when it came.
            health: of each sensor; None: the autopilot does not know, which is silence.
            link_age_s: for how long the vehicle had not been heard; what is said over a dead link is silence.
            sequences: of each sensor, number of the autopilot's own report that the status repeats. Each counts once:
                what is told again is neither a second report nor a young one. 0: it is not told, and each status
                counts as one.
        """
        for sensor in AutopilotSensor:
            sequence = sequences.get(sensor, 0)
            again, self._reported[sensor] = 0 != sequence == self._reported.get(sensor), sequence
            if again:
                continue
            for monitor in self._autopilot[sensor]:
                good = health.get(sensor) if link_age_s * _S <= monitor.age_limit_ns else None
                self._dirty |= monitor.add(t_ns, good, "the autopilot says that it has failed")

    def add_vehicle(self, *, armed: Optional[bool], on_ground: bool) -> None:
        """Add what the autopilot says of the vehicle; it flies from armed on until it is disarmed and on the ground."""
        if armed:
            self._in_flight = True
        elif armed is False and on_ground:
            self._in_flight = False

    def evaluate(self, t_ns: int) -> Tuple[ComponentStatus, ...]:
        """Return the condition of every component at a time; nothing before `start`."""
        self.loop_counter += 1
        if self._dirty or not self._evaluated_ns <= t_ns < self._next_ns:
            self._judge(t_ns)
        self._evaluated_ns = t_ns
        return self._statuses

    def restart_requests(self) -> Tuple[RestartRequest, ...]:
        """Return the restarts to be made now, each once."""
        requests, self._requests = tuple(self._requests), []
        return requests

    def restart_outcome(self, request: RestartRequest, t_ns: int, *, good: bool) -> None:
        """Say how a restart ended: it was carried out, or it could not be."""
        self._component(request.component).restarts.tell(t_ns, request.attempt, good=good)
        self._dirty = True

    def checks(self, t_ns: int) -> TakeoffCheck:
        """Return the answer to the take-off check at a time."""
        self._judge(t_ns)
        unknown = [name for name in self._required if name not in self._components]
        missing = tuple(
            Check(name, Verdict.UNKNOWN, advice=f"{name} is not watched: add it to sensors.yaml") for name in unknown
        )
        rows = tuple(self._row(monitor) for monitor in self._monitors)
        bad = [monitor for monitor, row in zip(self._monitors, rows) if not row.passed]
        ready = self.started and not bad and not missing
        fixable = bool(bad) and not missing and all(monitor.fixable() for monitor in bad)
        limits = [limit for limit in (monitor.fixed_by_ns() for monitor in bad) if limit is not None]
        under_way = fixable and bool(limits)
        return TakeoffCheck(ready, fixable, under_way, max(limits) if under_way else None, rows + missing)

    def _judge(self, t_ns: int) -> None:
        if self._started_ns is None:
            return
        before = self._statuses
        for monitor in self._monitors:
            request = monitor.evaluate(t_ns)
            if request is not None:
                self._requests.append(request)
        self._next_ns = min((monitor.changes_at_ns for monitor in self._monitors), default=FOREVER_NS)
        self._dirty = False
        statuses = tuple(monitor.status for monitor in self._monitors)
        if statuses != before:
            self._note_change(before, statuses)
            self._statuses = statuses

    def _note_change(self, before: Tuple[ComponentStatus, ...], after: Tuple[ComponentStatus, ...]) -> None:
        """Remember that something changed, and which component: of several the one with the highest code."""
        self.changes += 1
        changed = [new for index, new in enumerate(after) if index >= len(before) or before[index] != new]
        failing = [status for status in changed if before or status.code is not Code.NOMINAL]
        if failing:
            self.latest_component = max(failing, key=lambda status: status.code).name

    def _row(self, monitor: ComponentMonitor) -> Check:
        name = monitor.spec.name
        return monitor.row(required=name in self._required, tolerated=name in self._tolerated)

    def _add_answer(
        self,
        monitor: Optional[AnswerMonitor],
        what: str,
        good: Optional[bool],  # noqa: FBT001
        t_ns: int,
        message: str,
    ) -> None:
        if monitor is None:
            raise UnknownComponentError(what, self.names)
        self._dirty |= monitor.add(t_ns, good, message)

    def _component(self, name: str) -> ComponentMonitor:
        try:
            return self._components[name]
        except KeyError:
            raise UnknownComponentError(name, self.names) from None


# --- streams ----------------------------------------------------------------------------------------------------------
# The watchdog's two streams: action (issues and heartbeat) and info (everything), at their periods and on a change.


_Poll = Tuple[Optional[WatchdogAction], Optional[WatchdogInfo]]


class Streams:
    """Builds the messages of a watchdog. Level-based: each says the whole present.

    Args:
        watchdog: whose loop this is; `poll` is one turn of it.
        action_period_ns: of the action stream, which is the heartbeat.
        info_period_ns: of the info stream.
    """

    def __init__(self, watchdog: Watchdog, action_period_ns: int = _S // 5, info_period_ns: int = _S) -> None:
        self._watchdog = watchdog
        self._action_period_ns, self._info_period_ns = action_period_ns, info_period_ns
        self._action_due_ns = self._info_due_ns = 0
        self._action_sequence = self._info_sequence = 0
        self._sent: Tuple[ComponentStatus, ...] = ()
        self._judged: Tuple[ComponentStatus, ...] = ()
        self._issues: Tuple[ComponentStatus, ...] = ()  # of those that were judged last

    @property
    def next_ns(self) -> int:
        """When `poll` must be called again, unless something arrives before."""
        return min(self.due_ns, self._watchdog.next_ns)

    @property
    def due_ns(self) -> int:
        """When the next message is due, if nothing changes."""
        return min(self._action_due_ns, self._info_due_ns)

    def poll(self, t_ns: int) -> _Poll:
        """Turn the loop once: evaluate, and return the messages that are due; None for one that is not."""
        statuses = self._watchdog.evaluate(t_ns)
        if not self._watchdog.started:
            return None, None
        changed = statuses is not self._sent
        due = changed or not self._action_due_ns - self._action_period_ns <= t_ns < self._action_due_ns
        action = self._action(t_ns, statuses) if due else None
        due = changed or not self._info_due_ns - self._info_period_ns <= t_ns < self._info_due_ns
        info = self._info(t_ns, statuses) if due else None
        self._sent = statuses
        return action, info

    def _action(self, t_ns: int, statuses: Tuple[ComponentStatus, ...]) -> WatchdogAction:
        self._action_due_ns = t_ns + self._action_period_ns
        if statuses is not self._judged:
            self._judged, self._issues = statuses, tuple(each for each in statuses if each.code >= Code.INCONVENIENT)
        self._action_sequence += 1
        return made(
            WatchdogAction,
            t_ns=t_ns,
            sequence=self._action_sequence,
            loop_counter=self._watchdog.loop_counter,
            code=max(status.code for status in self._issues) if self._issues else Code.NOMINAL,
            latest_component=self._watchdog.latest_component,
            components=self._issues,
            publisher="",
            age_ns=0,
        )

    def _info(self, t_ns: int, statuses: Tuple[ComponentStatus, ...]) -> WatchdogInfo:
        self._info_due_ns = t_ns + self._info_period_ns
        changed: Tuple[str, ...] = ()
        if statuses is not self._sent:
            sent = {status.name: status for status in self._sent}
            changed = tuple(status.name for status in statuses if sent.get(status.name) != status)
        self._info_sequence += 1
        return WatchdogInfo(t_ns=t_ns, sequence=self._info_sequence, changed=changed, components=statuses)
