"""What is wrong now, and what is done about each: the verbs, the waits and their budgets.

A wait ends when its component is back, when its budget for this flight is spent, or when the watchdog has given up
restarting it. Then the second verb holds: `land`, or `continue` without it for the rest of the flight.
"""

from __future__ import annotations

from typing import Dict, List, Mapping, NamedTuple, Tuple

from .commands import Value
from .conditions import FAILSAFE_CONDITIONS
from .events import ComponentStatus
from .rules import Rules
from .severity import SEVERITIES, Code, Restart, Severity, Verb, row_of_code, verb_of
from .state import EngineState, Failure, FailureKind, State, Step, evolve
from .turn import Turn

__all__ = [
    "Change",
    "clocks_words",
    "flown_without",
    "limit_of",
    "severity_of",
    "update",
    "values_of",
    "waiting",
    "worst",
]

USER_HOLD = "user_hold"
_NS = 1e9


class Change(NamedTuple):
    """A failure that appeared, changed its verb, was dropped, or is over: `rule` names which, `values` say why."""

    rule: str
    failure: Failure


def severity_of(name: str, code: Code, state: EngineState, rules: Rules) -> Severity:
    """Return a component's severity: the mission's own, else the decision table's, else the row of its code."""
    if state.mission is not None:
        for component, severity in state.mission.severities:
            if component == name:
                return severity
    for rule in rules.components:
        if rule.name == name:
            return rule.severity
    return row_of_code(code)


def limit_of(name: str, rules: Rules) -> int:
    """Return the budget of waiting for a component, in nanoseconds per flight."""
    for rule in rules.components:
        if rule.name == name:
            return rule.wait_limit_ns
    return rules.limits.unlisted_wait_limit_ns


def update(turn: Turn) -> Tuple[Change, ...]:
    """Bring `state.failures`, the budgets and what is flown without up to date; return what changed in flight."""
    state = turn.state
    old, without = state.failures, state.flown_without
    bad = [status for status in state.components if status.code > Code.NOMINAL]
    lost = _lost(turn, old) if state.in_flight else []
    if not (bad or lost or old or state.user_hold_ns is not None):
        return ()
    ledger = _Ledger(turn, old)
    new = [ledger.component(status) for status in bad] + lost
    if state.in_flight:
        new += _user_hold(turn)
    ledger.close(new)
    if not new and not old:
        return ()
    turn.set(
        failures=tuple(new), spent=tuple(sorted(ledger.spent.items())), flown_without=tuple(sorted(ledger.without))
    )
    return _changes(old, turn.state, without) if turn.state.in_flight else ()


def flown_without(turn: Turn) -> Tuple[str, ...]:
    """Return what a takeoff now flies without: it failed, is not required, and would not be landed for."""
    names = []
    for status in turn.state.components:
        severity = severity_of(status.name, status.code, turn.state, turn.rules)
        waits = verb_of(severity, status.code) is Verb.WAIT
        if waits and SEVERITIES[severity].then is Verb.CONTINUE:
            names.append(status.name)
    return tuple(sorted(names))


def _can_wait(state: EngineState) -> bool:
    """Return True where a wait can be kept: in flight, and neither landing nor in the pilot's hands."""
    if not state.in_flight:
        return False
    return state.state in (State.TAKEOFF, State.HOLD) or (state.state is State.MISSION and state.step is Step.FLYING)


_FLOOR: Mapping[State, Verb] = {State.LAND: Verb.LAND, State.PILOT: Verb.PILOT}
"""Where nothing is waited for any more: a failure that would be waited for is answered by what is done already."""


class _Ledger:
    """The budgets of one update."""

    def __init__(self, turn: Turn, old: Tuple[Failure, ...]) -> None:
        self.turn = turn
        self.old: Dict[str, Failure] = {failure.name: failure for failure in old}
        self.spent: Dict[str, int] = dict(turn.state.spent)
        self.without: List[str] = list(turn.state.flown_without)
        self.can_wait = _can_wait(turn.state)

    def component(self, status: ComponentStatus) -> Failure:
        """Return the failure that a component's status means."""
        turn, name = self.turn, status.name
        severity = severity_of(name, status.code, turn.state, turn.rules)
        verb = verb_of(severity, status.code) or Verb.CONTINUE
        before = self.old.get(name)
        failure = Failure(
            name=name,
            kind=FailureKind.COMPONENT,
            code=int(status.code),
            verb=verb,
            since_ns=before.since_ns if before is not None else turn.now,
            reason=status.reason,
        )
        if verb is Verb.WAIT:
            return self._wait(failure, severity, status.restart)
        in_hands = verb is Verb.LAND and self.turn.state.state is State.PILOT
        return evolve(failure, verb=Verb.PILOT) if in_hands else failure

    def _wait(self, failure: Failure, severity: Severity, restart: Restart) -> Failure:
        then = SEVERITIES[severity].then or Verb.LAND
        if failure.name in self.without:
            return evolve(failure, verb=then)
        if not self.can_wait:
            return evolve(failure, verb=_FLOOR.get(self.turn.state.state, Verb.WAIT), then=None)
        deadline = self._deadline(failure.name)
        if restart is not Restart.GIVEN_UP and self.turn.now < deadline:
            return evolve(failure, then=then, deadline_ns=deadline)
        if then is Verb.CONTINUE:
            self.without.append(failure.name)
        return evolve(failure, verb=then)

    def _deadline(self, name: str) -> int:
        before = self.old.get(name)
        if before is not None and before.deadline_ns is not None:
            return before.deadline_ns
        return self.turn.now + max(0, limit_of(name, self.turn.rules) - self.spent.get(name, 0))

    def close(self, new: List[Failure]) -> None:
        """Write down what each wait that is over has spent of its budget."""
        still = {failure.name for failure in new if failure.deadline_ns is not None}
        for name, failure in self.old.items():
            if failure.deadline_ns is None or name in still or failure.kind is not FailureKind.COMPONENT:
                continue
            limit = limit_of(name, self.turn.rules)
            self.spent[name] = min(limit, max(0, limit - (failure.deadline_ns - self.turn.now)))


def _lost(turn: Turn, old: Tuple[Failure, ...]) -> List[Failure]:
    found, known = [], {failure.name: failure for failure in old}
    for row in FAILSAFE_CONDITIONS:
        seen = row.holds(turn)
        if seen is None:
            continue
        before = known.get(row.name)
        reason = clocks_words(turn, row.peer) or f"{row.words} ({_words(seen.values)})"
        since = before.since_ns if before is not None else turn.now
        verb = Verb.PILOT if row.action is Verb.LAND and turn.state.state is State.PILOT else row.action
        found.append(Failure(row.name, FailureKind.LOSS, 0, verb, since_ns=since, reason=reason))
    return found


def clocks_words(turn: Turn, peer: str) -> str:
    """Return that a peer's clock is another one, where that is why its statuses are not believed; else nothing."""
    for apart in turn.state.clocks_apart:
        if apart.peer == peer:
            far, side = abs(apart.age_ns) / _NS, "in the future" if apart.age_ns < 0 else "old"
            limits = turn.limits
            limit = (limits.clock_tolerance_ns if apart.age_ns < 0 else limits.status_max_age_ns) / _NS
            return (
                f"stamps of the {peer} are {far:.3f} s {side} (limit {limit:g} s): old statuses, or clocks that differ"
            )
    return ""


def _words(values: Tuple[Value, ...]) -> str:
    return ", ".join(
        f"{v.name} {v.value}{' ' + v.unit if v.unit else ''}" + (f", limit {v.limit}" if v.limit is not None else "")
        for v in values
    )


def _user_hold(turn: Turn) -> List[Failure]:
    since = turn.state.user_hold_ns
    if since is None:
        return []
    deadline = since + turn.limits.user_hold_limit_ns
    hold = Failure(USER_HOLD, FailureKind.USER, 0, Verb.WAIT, Verb.LAND, since, deadline, "the user asked for a hold")
    return [hold if turn.now < deadline else evolve(hold, verb=Verb.LAND, then=None, deadline_ns=None)]


def _changes(old: Tuple[Failure, ...], state: EngineState, without: Tuple[str, ...]) -> Tuple[Change, ...]:
    before = {failure.name: failure for failure in old}
    changes = []
    for failure in state.failures:
        known = before.pop(failure.name, None)
        if known is not None and (known.verb is failure.verb or state.state in _FLOOR):
            continue
        dropped = failure.name in state.flown_without and failure.name not in without
        changes.append(Change("flown_without" if dropped else f"failure_{failure.verb.name.lower()}", failure))
    changes += [
        Change("failure_back", failure) for failure in old if failure.name in before and failure.name != USER_HOLD
    ]
    return tuple(changes)


def values_of(failure: Failure, now_ns: int) -> Tuple[Value, ...]:
    """Return what a decision about a failure looked at."""
    values = [Value("failure", failure.name), Value("code", failure.code), Value("verb", failure.verb.name.lower())]
    if failure.deadline_ns is not None:
        values.append(Value("waits at most", round((failure.deadline_ns - now_ns) / _NS, 3), None, "s"))
    if failure.reason:
        values.append(Value("reason", failure.reason))
    return tuple(values)


def waiting(state: EngineState) -> Tuple[Failure, ...]:
    """Return the failures that are waited for."""
    return tuple(failure for failure in state.failures if failure.verb is Verb.WAIT)


def worst(state: EngineState) -> Tuple[Failure, ...]:
    """Return the failures that mean to land."""
    return tuple(failure for failure in state.failures if failure.verb is Verb.LAND)
