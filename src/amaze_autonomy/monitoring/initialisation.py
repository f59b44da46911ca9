"""An estimator that must be told to begin: when it is asked to initialise itself, and what the check says meanwhile.

On the ground only, of a vehicle that says that it is disarmed: an estimate that begins anew in flight is a jump. It is
asked when the check of the states fails, once for each time that somebody asks for the checks: a retry asks it again.
With `always` it is asked once in each pre-flight, before the states are judged: what looks valid may be of before. The
checks right before a takeoff are of the same pre-flight. Where it answers yes, what the check still lacks comes by
itself for a while. Pure.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from typing import Optional, Sequence, Tuple

from ..engine.events import Check, Verdict
from ..engine.state import State
from .preflight_specs import Checked

ROW = "estimator initialisation"
_S = 1_000_000_000
_UNDER_WAY = "the estimator is being initialised"
_BEFORE_PREFLIGHT = frozenset(
    state.value for state in (State.MISSION_INPUT, State.READY, State.OUTREACH, State.DATA_CLEANUP, State.MISSION_ENDED)
)
_BEFORE_TAKEOFF = frozenset(state.value for state in (State.START_RECORDING, State.LOAD_MISSION))


class InitialisationType(enum.Enum):
    """The type of a service that initialises an estimator."""

    TRIGGER = "trigger"  # std_srvs/Trigger
    SET_BOOL = "set_bool"  # std_srvs/SetBool, with true
    EMPTY = "empty"  # std_srvs/Empty


@dataclass(frozen=True)
class InitialisationSpec(Checked):
    """What initialises an estimator.

    Args:
        service: on the ground, before the states are checked; empty: it needs none.
        type: of it.
        always: asked in each pre-flight, valid states or not; false: only when they are not valid.
        limit_ns: time in which it must answer, and then the states must be valid.
        in_flight_service: of a second sensor or estimator, once the mission is flown; empty: there is none.
        in_flight_type: of it.
    """

    service: str = ""
    type: InitialisationType = InitialisationType.TRIGGER
    always: bool = False
    limit_ns: int = 10 * _S
    in_flight_service: str = ""
    in_flight_type: InitialisationType = InitialisationType.TRIGGER

    def __post_init__(self) -> None:
        self._whole("limit_ns")


class Initialisation:
    """Decides when the estimator is asked.

    Args:
        spec: what initialises it, by when.
        status_limit_ns: what the vehicle has said is believed for so long.
    """

    def __init__(self, spec: InitialisationSpec, status_limit_ns: int) -> None:
        self.spec, self._status_limit_ns = spec, status_limit_ns
        self._asked, self._failure, self._state = False, "", ""
        self._due = spec.always  # whatever the states look like; without an engine for the first check alone
        self._initialised_ns: Optional[int] = None
        self._armed: Optional[bool] = None
        self._heard_ns = 0

    def heard(self, t_ns: int, *, armed: Optional[bool]) -> None:
        """Take what the vehicle says; None: it is not known."""
        self._heard_ns, self._armed = t_ns, armed

    def entered(self, state: str) -> bool:
        """Take the engine's state; return whether to ask for what begins in the air now."""
        before, self._state = self._state, state
        if state != State.PREFLIGHT.value:
            self._due = self.spec.always and state in _BEFORE_PREFLIGHT
        elif before in _BEFORE_TAKEOFF:  # from elsewhere it is due already: its check may be here before its name
            self._due = self.spec.always
        return bool(self.spec.in_flight_service) and (before, state) == (State.TAKEOFF.value, State.MISSION.value)

    def check(self, t_ns: int, rows: Sequence[Check]) -> Tuple[Tuple[Check, ...], bool]:
        """Return the rows of a check with what is said of the initialisation, and whether to ask for it now.

        Args:
            t_ns: now.
            rows: of the check of the states.
        """
        judged = not (self.spec.always and (self._due or self._asked or self._failure))
        if not self.spec.service:
            return tuple(rows), False
        if judged and all(row.passed for row in rows):
            if not self.spec.always:
                self._initialised_ns = None  # it has done its work: states that fail later are asked for anew
            return tuple(rows), False
        if self._asked:
            return _waiting(rows, Verdict.UNKNOWN, _UNDER_WAY), False
        if self._failure:
            failure, self._failure = self._failure, ""
            return _failed(rows, failure), False
        if self._initialised_ns is not None and not self._due:
            if t_ns - self._initialised_ns < self.spec.limit_ns:
                return _waiting(rows, Verdict.PASS, ""), False
            self._initialised_ns = None
            return _failed(rows, f"{self.spec.service} was asked, and the states did not become valid"), False
        armed = self._armed if t_ns - self._heard_ns <= self._status_limit_ns else None
        if armed is None:
            return _waiting(rows, Verdict.UNKNOWN, "it is not known whether the vehicle is disarmed"), False
        if armed:
            return _failed(rows, "the vehicle is armed"), False
        self._asked, self._due, self._initialised_ns = True, False, None
        return _waiting(rows, Verdict.UNKNOWN, _UNDER_WAY), True

    def answered(self, t_ns: int, failure: str = "") -> None:
        """Take the answer: empty when it is yes, else why not."""
        self._asked, self._failure = False, failure
        self._due = self._due or (self.spec.always and bool(failure))
        self._initialised_ns = None if failure else t_ns


def _failed(rows: Sequence[Check], advice: str) -> Tuple[Check, ...]:
    return (Check(ROW, Verdict.FAIL, advice=advice), *rows)


def _waiting(rows: Sequence[Check], verdict: Verdict, advice: str) -> Tuple[Check, ...]:
    """Return rows of which what has not passed comes by itself."""
    own = Check(ROW, verdict, advice=advice, heals=verdict is not Verdict.PASS)
    return (own, *(row if row.passed else replace(row, heals=True) for row in rows))
