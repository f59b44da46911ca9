"""One turn of the engine: the state in the making, the event, the rules, and the commands collected so far.

A `Turn` lives inside one call of `decide` and is never seen outside the engine. Guards read it, effects change it.

It also knows when the table need not be asked again, because most events of a flight say once more what is known:

* The state is *settled* when failures and guards have just been gone through and nothing came of it. Nothing can come
  of the next event either, as long as they would see the same values and compare with the same outcome.
* The same values: all that the event changes in the state are times at which something was heard (`Stamp`), and of a
  status what guards compare with limits only (`Figure`) or never look at (`NEUTRAL`). Anything else is *news*.
* The same outcome of limits: guards compare a figure by `above` and its like, which keep the limits next to it.
* The same outcome of times: guards compare times by `reached`, which keeps the nearest end that is to come, and the
  latest that has gone by. Until the nearest nothing ends. What has gone by could only begin again with a stream that it
  is counted from; a stream that was heard since the latest is none of those.

What nobody has thought of is news: a new field, condition or timer needs no word here. That `decide` comes to the same
without leaving early is asserted at every event of the stories of test/engine and of the proof, and that no guard
compares in other ways by test/engine/test_settled.py.
"""

from __future__ import annotations

from copy import copy
from dataclasses import fields
from operator import attrgetter
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Type

from .commands import Command, Notify, Request, Value
from .events import (
    AutopilotStatus,
    Event,
    Landed,
    LandedStatus,
    MissionSelected,
    MissionStatus,
    RecordingStatus,
    Shutdown,
    UserCommand,
    UserRequest,
    VehicleLanded,
    WatchdogAction,
)
from .messages import MESSAGES
from .mission import Mission
from .rules import Limits, Rules
from .state import STAMPS, EngineState, FailureKind, Settled, evolve
from .timers import next_deadline, time_of

__all__ = ["Turn"]

_NEVER_NS = 1 << 62
_INFINITE = float("inf")
_UNASKED = object()
_STAMPS = frozenset(STAMPS)


def _deciding(kind: Type[Any]) -> Callable[[Any], Any]:
    """Return what takes out of a status, or of a part of one, all that is news as soon as it is another."""
    entries = [each for each in fields(kind) if each.name != "t_ns" and each.type != "Figure"]
    parts = [each for each in entries if "parts" in each.metadata]
    own = attrgetter(*(each.name for each in entries if not each.metadata))
    if not parts:
        return own
    (lists,) = parts
    listed, part = attrgetter(lists.name), _deciding(lists.metadata["parts"])
    return lambda status: (own(status), *map(part, listed(status)))


_UNSETTLED = Settled()
_STATUSES = (AutopilotStatus, LandedStatus, MissionStatus, RecordingStatus, WatchdogAction)
_DECIDING: Dict[Type[Any], Callable[[Any], Any]] = {kind: _deciding(kind) for kind in _STATUSES}


def _within(status: Event, bounds: Mapping[str, Optional[Tuple[float, float]]]) -> bool:
    for name, between in bounds.items():
        value = getattr(status, name)
        if (value is None) is not (between is None):
            return False
        if between is not None and not between[0] < value < between[1]:
            return False
    return True


class Turn:
    """What guards and effects work on."""

    user: Optional[UserCommand] = None
    selected: Tuple[Mission, ...] = ()
    signal = ""
    foreign_mode: Tuple[Value, ...] = ()
    news = False
    _vehicle: Any = _UNASKED

    def __init__(self, state: EngineState, event: Event, rules: Rules) -> None:
        self.state, self.event, self.rules = state, event, rules
        self.limits: Limits = rules.limits
        self.now: int = max(event.t_ns, state.t_ns)
        self.commands: List[Command] = []
        self._settled = state.settled if state.settled.rules is rules else _UNSETTLED
        self._ends = [_NEVER_NS, 0]  # the nearest that is to come, the latest that has gone by
        self._bounds: Dict[Type[Any], Dict[str, Optional[Tuple[float, float]]]] = {}
        if isinstance(event, UserRequest):
            self.user = event.command
        elif isinstance(event, MissionSelected):
            self.selected = event.missions
        elif isinstance(event, Shutdown):
            self.signal = event.signal

    def set(self, **changes: Any) -> None:
        """Change fields of the state."""
        known, other = self.state.__dict__, False
        for name, value in changes.items():
            old = known[name]
            if value is not old:
                other = True
                if not self.news:
                    self.news = self._is_news(name, value, old)
        if other:
            self._vehicle = _UNASKED
            self.state = evolve(self.state, t_ns=self.now, **changes)

    # --- is the table asked? ------------------------------------------------------------------------------------------

    def _is_news(self, name: str, value: Any, old: Any) -> bool:
        if old is None or value is None:
            return True
        if name in _STAMPS:
            return value < old or not self._since_the_last_end(old)
        deciding = _DECIDING.get(type(value))
        if deciding is None or type(old) is not type(value):
            return bool(value != old)
        if deciding(value) != deciding(old) or not self._since_the_last_end(old.t_ns):
            return True
        bounds = self._settled.bounds.get(type(value))
        return bounds is not None and not _within(value, bounds)

    def _since_the_last_end(self, heard_ns: int) -> bool:
        return heard_ns > self._settled.after_ns

    def quiet(self) -> bool:
        """Return True when the state was settled, and nothing of this event can change that."""
        asked = self.commands or self.user or self.selected or self.signal or self.foreign_mode
        return not self.news and not asked and self.now < self._settled.until_ns

    def settle(self, *, nothing_came: bool) -> None:
        """Write down how far the state is settled; words of how long a loss lasts are other ones each time."""
        settled = _UNSETTLED
        if nothing_came and not any(failure.kind is FailureKind.LOSS for failure in self.state.failures):
            deadline_ns = next_deadline(self.state, self.rules)
            until_ns, after_ns = self._ends
            until_ns = until_ns if deadline_ns is None else min(until_ns, deadline_ns)
            settled = Settled(self.rules, until_ns, after_ns, self._bounds)
        if settled is not self.state.settled:
            self.state = evolve(self.state, settled=settled)

    def reached(self, end_ns: int, moment_ns: Optional[int] = None) -> bool:
        """Return True when `end_ns` is not later than now, or than the moment at which something was heard."""
        now, ends = self.now, self._ends
        if now < end_ns < ends[0]:
            ends[0] = end_ns
        elif now >= end_ns > ends[1]:
            ends[1] = end_ns
        return end_ns <= (now if moment_ns is None else moment_ns)

    def older(self, since_ns: int, limit_ns: int) -> bool:
        """Return True when something is longer ago than a limit."""
        return self.reached(since_ns + limit_ns + 1)

    def passed(self, name: str) -> bool:
        """Return True when a timer of the table `TIMERS` has ended."""
        end_ns = time_of(name, self.state, self.rules)
        return end_ns is not None and self.reached(end_ns)

    def above(self, status: Event, figure: str, limit: float) -> bool:
        """Return True when a figure of a status is known and above a limit."""
        value = self._figure(status, figure, limit)
        return value is not None and value > limit

    def at_least(self, status: Event, figure: str, limit: float) -> bool:
        """Return True when a figure of a status is known and not below a limit."""
        value = self._figure(status, figure, limit)
        return value is not None and value >= limit

    def at_most(self, status: Event, figure: str, limit: float) -> bool:
        """Return True when a figure of a status is known and not above a limit."""
        value = self._figure(status, figure, limit)
        return value is not None and value <= limit

    def _figure(self, status: Event, figure: str, limit: float) -> Optional[float]:
        bounds, value = self._bounds.setdefault(type(status), {}), getattr(status, figure)
        low, high = bounds.get(figure) or (-_INFINITE, _INFINITE)
        if value is None:
            bounds[figure] = None
            return None
        bounds[figure] = (max(low, limit), high) if value > limit else (low, min(high, limit))
        return float(value)

    def supposing(self, **changes: Any) -> Turn:
        """Return this turn, supposed that some fields of the state were others."""
        other = copy(self)
        other.state = evolve(self.state, **changes)
        return other

    # --- what is sent and told ----------------------------------------------------------------------------------------

    def consume(self) -> None:
        """Forget what the event asks for: a request is carried out once."""
        self.user, self.selected, self.signal = None, (), ""

    def take_id(self) -> int:
        """Return a new id for a request."""
        identity = self.state.next_id
        self.set(next_id=identity + 1)
        return identity

    def send(self, request: Request) -> int:
        """Send a request to a peer and return its id."""
        self.commands.append(request)
        return request.id

    def notify(self, key: str, **values: object) -> None:
        """Tell the user by an entry of the table of messages; ignore the empty key."""
        if not key:
            return
        entry = MESSAGES[key]
        text = entry.text.format(**values)
        self.set(message=text, message_level=entry.level, advice=entry.advice)
        self.commands.append(Notify(level=entry.level, key=key, text=text, advice=entry.advice))

    # --- the vehicle, as far as it is known freshly -------------------------------------------------------------------

    def vehicle(self) -> Optional[AutopilotStatus]:
        """Return the autopilot's status if it is fresh: the stream and the link behind it; else None."""
        if self._vehicle is _UNASKED:
            self._vehicle = self._fresh_vehicle()
        return self._vehicle  # type: ignore[no-any-return]

    def _fresh_vehicle(self) -> Optional[AutopilotStatus]:
        status, heard_ns = self.state.autopilot, self.state.autopilot_ns
        linked_ns = self.state.linked_ns
        if status is None or heard_ns is None or linked_ns is None:
            return None
        silent = self.older(heard_ns, self.limits.autopilot_status_limit_ns)
        return None if silent or self.older(linked_ns, self.limits.autopilot_link_limit_ns) else status

    def armed(self) -> bool:
        """Return True when the vehicle says, freshly, that it is armed."""
        status = self.vehicle()
        return status is not None and status.armed is True

    def down(self) -> bool:
        """Return True when the vehicle says, freshly, both disarmed and ON_GROUND. Unknown is not down."""
        status = self.vehicle()
        return status is not None and status.armed is False and status.landed is VehicleLanded.ON_GROUND

    def last_heard_down(self) -> bool:
        """Return True when the last word of the vehicle was disarmed and ON_GROUND, however old.

        Enough for a person who stands beside a vehicle that was switched off and acknowledges that it has landed.
        """
        status = self.state.autopilot
        return status is not None and status.armed is False and status.landed is VehicleLanded.ON_GROUND

    def on_ground(self) -> bool:
        """Return True when the vehicle says, freshly, ON_GROUND."""
        status = self.vehicle()
        return status is not None and status.landed is VehicleLanded.ON_GROUND

    def detection(self) -> Landed:
        """Return what the landing detection says, freshly; UNKNOWN when it is silent."""
        status, seen_ns = self.state.landing, self.state.landing_ns
        if status is None or seen_ns is None or self.older(seen_ns, self.limits.landing_detection_limit_ns):
            return Landed.UNKNOWN
        return status.landed

    def airborne(self) -> bool:
        """Return True when the vehicle says, freshly, that it has left the ground."""
        status = self.vehicle()
        return status is not None and status.landed not in (VehicleLanded.ON_GROUND, VehicleLanded.UNKNOWN)

    def flies_again(self) -> bool:
        """Return True when the vehicle says, freshly, what contradicts that its flight is over."""
        status = self.vehicle()
        return status is not None and (status.armed is True or (self.airborne() and status.armed is not False))
