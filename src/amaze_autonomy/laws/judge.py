"""Applies the laws to a sequence: state before, event, commands, state after, one after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterator, List, Tuple

from amaze_autonomy.engine.events import Event
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState

from . import flight, ground, requests  # noqa: F401  (what they hold registers itself)
from .moment import LAWS, Law, Moment
from .witness import Witness, hear, see

_ALL = tuple(LAWS.values())
_QUIET = tuple(law for law in LAWS.values() if law.always)


class BrokenLawError(Exception):
    """A law does not hold.

    Args:
        law: its name.
        why: in words.
        event: after which.
    """

    def __init__(self, law: str, why: str, event: Event) -> None:
        super().__init__(f"{law}: {why}")
        self.law, self.why, self.event = law, why, event


@dataclass(frozen=True)
class Broken:
    """Where a law was broken for the first time.

    Args:
        law: which.
        why: in words.
        t_ns: when.
        event: name of the event's class.
        number: of the event in its sequence, from 1.
        times: after how many events of the sequence it was broken.
    """

    law: Law
    why: str
    t_ns: int
    event: str
    number: int
    times: int = 1


@dataclass(frozen=True)
class Judged:
    """What came of a sequence.

    Args:
        events: how many.
        applied: law -> after how many of them it had something to say and was kept.
        broken: laws, in the order in which they were broken first.
    """

    events: int
    applied: Dict[str, int]
    broken: Tuple[Broken, ...]


def observed(
    witness: Witness, before: EngineState, event: Event, commands: Tuple[Any, ...], after: EngineState, rules: Rules
) -> Moment:
    """Return the moment of an event; its `seen` is the witness for the next one."""
    saw = see(witness, event, before, rules.limits)
    shown = commands or after.state is not before.state or after.session.id != saw.session
    return Moment(
        before, event, commands, after, (witness, saw, hear(saw, event, commands, after) if shown else saw), rules
    )


def check(moment: Moment) -> Iterator[Tuple[Law, str]]:
    """Yield each law that has something to say, and how it is broken; empty: it is kept."""
    for law in _ALL if moment.commands else _QUIET:
        verdict = law.check(moment)
        if verdict is not None:
            yield law, "" if verdict is True else str(verdict)


def judge(applied: Dict[str, int]) -> Callable[[Moment], None]:
    """Return what checks every law on a moment, counts how often each applied, and raises at the first broken one."""

    def observe(moment: Moment) -> None:
        for law, why in check(moment):
            if why:
                raise BrokenLawError(law.name, why, moment.event)
            applied[law.name] = applied.get(law.name, 0) + 1

    return observe


class Judge:
    """Watches a sequence to its end, whatever is broken on the way.

    Args:
        rules: that the engine decides by.
    """

    def __init__(self, rules: Rules) -> None:
        self._rules, self._witness, self._events = rules, Witness(), 0
        self._applied: Dict[str, int] = {}
        self._broken: Dict[str, Broken] = {}

    def begin(self) -> None:
        """Forget what was seen: an engine has started that knows nothing of it either."""
        self._witness = Witness()

    def watch(self, before: EngineState, event: Event, commands: Tuple[Any, ...], after: EngineState) -> None:
        """Look at one event and its answer."""
        moment = observed(self._witness, before, event, commands, after, self._rules)
        self._witness = moment.seen
        self._events += 1
        for law, why in check(moment):
            if why:
                self._note(law, why, moment)
            else:
                self._applied[law.name] = self._applied.get(law.name, 0) + 1

    def _note(self, law: Law, why: str, moment: Moment) -> None:
        first = self._broken.get(law.name)
        times = 1 if first is None else first.times + 1
        if first is None:
            first = Broken(law, why, moment.after.t_ns, type(moment.event).__name__, self._events)
        self._broken[law.name] = Broken(law, first.why, first.t_ns, first.event, first.number, times)

    def judged(self) -> Judged:
        """Return what was found so far."""
        broken: List[Broken] = sorted(self._broken.values(), key=lambda each: each.number)
        return Judged(self._events, dict(self._applied), tuple(broken))
