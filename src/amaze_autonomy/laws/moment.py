"""What a law is, and the moment that it judges: an event, what the engine commanded, and where it is then.

A law returns None where it does not apply, True where it is kept, and a sentence where it is broken. It may look at the
event, the commands, the place that the engine shows, and the witness; hardly ever at the engine's inside. `source` is
the rule of the specification that it is written from: "4.3" is rule 3 of section 4, "5 HOLD" the row HOLD of section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, Optional, Tuple, Union

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import MissionCommand, Request
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, State

from ..engine.events import Mission
from .witness import MOVING, Witness

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
_ROW_OF_CODE = {1: "low", 2: "low", 4: "moderate", 8: "high", 16: "highest"}
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

    def severity(self, name: str, code: int) -> str:
        """Return a component's severity: the mission's own, else the table's, else the row of its code."""
        own = self.mission.severities if self.mission is not None else ()
        listed = (*own, *((rule.name, rule.severity) for rule in self.rules.components))
        return next((severity.value for each, severity in listed if each == name), _ROW_OF_CODE[code])

    def budget_ns(self, name: str) -> int:
        """Return how long a component may be waited for in one flight."""
        budgets = (rule.wait_limit_ns for rule in self.rules.components if rule.name == name)
        return next(budgets, self.rules.limits.unlisted_wait_limit_ns)

    def is_spent(self, name: str) -> bool:
        """Return True when the budget is spent, and a restarted engine has, or could have, heard the watchdog."""
        saw, limit_ns = self.saw, self.rules.limits.watchdog_heartbeat_limit_ns
        heard = (saw.beat_ns or 0) > saw.started_ns or saw.now - saw.started_ns >= limit_ns
        return heard and dict(self.saw.waited).get(name, 0) >= self.budget_ns(name)

    def limit(self, name: str) -> float:
        """Return a limit of the flight: the mission's own, else the configuration's."""
        own = getattr(self.mission, name, None) if self.mission is not None else None
        return float(getattr(self.rules.limits, name) if own is None else own)

    @property
    def checks(self) -> int:
        """How many checks must pass before a takeoff."""
        return len(self.rules.checks or ev.CheckName)

    @property
    def mission(self) -> Optional[Mission]:
        """Return the mission that is flown."""
        return self.after.session.mission if self.after.session.mission is not None else self.before.session.mission

    @property
    def moved(self) -> bool:
        """True when the engine is in another state than before."""
        return self.before.state is not self.after.state

    @property
    def in_doubt(self) -> bool:
        """True while it is not clear whether somebody else has control: no longer than until statuses could agree."""
        shown, limits, status = self.after.vehicle.takeover, self.rules.limits, self.saw.fresh(self.rules.limits)
        if self.saw.vehicle is None and self.after.flight.active:  # restarted: not heard yet
            return self.saw.now - self.saw.vehicle_ns <= limits.autopilot_status_limit_ns
        if shown is None or status is None:
            return False
        agreed = shown.statuses > 1 and status.armed is not False  # the last one, too
        return not agreed or self.saw.now - shown.since_ns < limits.pilot_confirm_ns

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
    planner = saw.planner
    by_planner = planner is not None and planner.phase in (ev.MissionPhase.LANDING, ev.MissionPhase.LANDED)
    sinks = sinks and (by_planner or status.mode not in MOVING)
    stands = saw.stalled_ns is not None and saw.now - saw.stalled_ns > rules.limits.landing_stall_limit_ns
    says = status.mode in LANDING_MODES or status.landed is ev.VehicleLanded.LANDING
    grounded = status.landed is ev.VehicleLanded.ON_GROUND and not saw.contradicted(rules.limits)
    return grounded or (says and not stands) or sinks


def lands(moment: Moment, name: str, code: int) -> bool:
    """Return True when a component at a code is landed for, at once or after a wait."""
    return code == 16 or (code >= 4 and moment.severity(name, code) in ("high", "highest"))
