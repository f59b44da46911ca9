"""What a law is, and the moment that it judges: an event, what the engine commanded, and where it is then.

A law returns None where it does not apply, True where it is kept, and a sentence where it is broken. It may look at the
event, the commands, the place that the engine shows, and the witness; hardly ever at the engine's inside. `source` is
the rule of the specification that it is written from: "4.3" is rule 3 of section 4, "5 HOLD" the row HOLD of section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, Tuple, Union

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import MissionCommand, Request
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, State

from .witness import Witness

__all__ = ["ENDLESS", "FLIGHT", "GROUND", "LANDING_MODES", "LAWS", "Law", "Moment", "Verdict", "law", "shows_landing"]

Verdict = Union[None, bool, str]
GROUND = (
    State.MISSION_INPUT,
    State.PREFLIGHT,
    State.OUTREACH,
    State.READY,
    State.START_RECORDING,
    State.LOAD_MISSION,
    State.DATA_CLEANUP,
    State.MISSION_ENDED,
)
FLIGHT = (State.TAKEOFF, State.MISSION, State.HOLD, State.LAND)
ENDLESS = (State.MISSION_INPUT, State.OUTREACH, State.PILOT, State.MISSION_ENDED)
LANDING_MODES = ("AUTO.LAND", "AUTO.PRECLAND")


class Moment:
    """One event and its answer: the witness as it `was`, as it `saw` the event, and as it has `seen` the commands."""

    __slots__ = ("after", "before", "commands", "event", "motions", "requests", "rules", "saw", "seen", "was")

    def __init__(
        self,
        before: EngineState,
        event: ev.Event,
        commands: Tuple[Any, ...],
        after: EngineState,
        witnesses: Tuple[Witness, Witness, Witness],
        rules: Rules,
    ) -> None:
        self.before, self.event, self.commands, self.after, self.rules = before, event, commands, after, rules
        self.was, self.saw, self.seen = witnesses
        self.requests = [c for c in commands if isinstance(c, Request)] if commands else []
        self.motions = [c.action for c in self.requests if isinstance(c, MissionCommand)]

    @property
    def moved(self) -> bool:
        """True when the engine is in another state than before."""
        return self.before.state is not self.after.state

    def sent(self, kind: type) -> bool:
        """Return True when a request of a kind went out."""
        return any(isinstance(request, kind) for request in self.requests)


@dataclass(frozen=True)
class Law:
    """One law; `always`: it also has to be looked at when the engine said nothing."""

    name: str
    source: str
    words: str
    check: Callable[[Moment], Verdict]
    always: bool = False


LAWS: Dict[str, Law] = {}


def law(source: str, words: str, *, always: bool = False) -> Callable[[Callable[[Moment], Verdict]], Any]:
    """Register a law."""

    def register(check: Callable[[Moment], Verdict]) -> Callable[[Moment], Verdict]:
        LAWS[check.__name__] = Law(check.__name__, source, words, check, always)
        return check

    return register


def shows_landing(saw: Witness, rules: Rules) -> bool:
    """Return True when the vehicle shows that it lands, or is down."""
    status = saw.fresh(rules.limits)
    if status is None:
        return False
    sinks = saw.descending_ns is not None and saw.now - saw.descending_ns >= rules.limits.descent_time_ns
    landed = status.landed in (ev.VehicleLanded.ON_GROUND, ev.VehicleLanded.LANDING)
    return status.mode in LANDING_MODES or landed or sinks
