"""Did the recorded vehicle do what the engine says? After the first command that it did not get, all is counterfactual.

Only what the recording tells counts. Where it tells nothing of the vehicle, no command is known to have been got.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, NamedTuple, Optional

from amaze_autonomy.engine.commands import (
    MissionAction,
)
from amaze_autonomy.engine.events import (
    MissionPhase,
    VehicleLanded,
)
from amaze_autonomy.engine.rules import Limits

from ...engine.context import LANDING_MODES

_S = 1_000_000_000
_DESCENT_M, _TOUCHED_M = 0.5, 0.3
_LAND_LIMIT_NS = 5 * _S
_LANDING_PHASES = (MissionPhase.LANDING, MissionPhase.LANDED)


class Observed(NamedTuple):
    """What the recording shows at a time; None: nothing."""

    t_ns: int
    landed: Optional[VehicleLanded] = None
    height_m: Optional[float] = None
    mode: Optional[str] = None
    phase: Optional[MissionPhase] = None


@dataclass
class _Waiting:
    t_ns: int
    action: MissionAction
    until_ns: int
    height_m: Optional[float]
    lowest_m: Optional[float] = None
    sinks: bool = False


class Evidence:
    """Waits for the recorded vehicle to show each command.

    Args:
        limits: within which a command must show.

    Attributes:
        height_m: that the recording showed last; while nobody waits, it is all that counts of it.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._waiting: List[_Waiting] = []
        self.height_m: Optional[float] = None
        self.counterfactual_ns: Optional[int] = None
        self.action: Optional[MissionAction] = None

    @property
    def waits(self) -> bool:
        """True when what the recording shows may be what a command waits for."""
        return bool(self._waiting)

    def command(self, t_ns: int, action: MissionAction) -> None:
        """Note a command of motion; LAND is repeated, the first one counts."""
        if self.counterfactual_ns is None and all(each.action is not action for each in self._waiting):
            self._waiting.append(_Waiting(t_ns, action, t_ns + self._limit_ns(action), self.height_m))

    def observe(self, seen: Observed) -> None:
        """Take what the recording shows now."""
        self.height_m = seen.height_m
        if not self._waiting:
            return
        self._waiting = [each for each in self._waiting if not self._shows(each, seen)]
        for each in self._waiting:
            if seen.t_ns >= each.until_ns and not each.sinks:
                self._miss(each)

    def end(self) -> None:
        """Take the end of the recording: what has not shown by now never did, but a descent may go on."""
        for each in self._waiting:
            if not (each.sinks and (each.lowest_m or 0.0) <= self._limits.landing_height_m):
                self._miss(each)

    def _miss(self, waiting: _Waiting) -> None:
        if self.counterfactual_ns is None or waiting.t_ns < self.counterfactual_ns:
            self.counterfactual_ns, self.action = waiting.t_ns, waiting.action

    def _limit_ns(self, action: MissionAction) -> int:
        limits = {
            MissionAction.TAKEOFF: self._limits.takeoff_limit_ns,
            MissionAction.HOLD: self._limits.hold_confirm_limit_ns,
            MissionAction.RESUME: self._limits.resume_confirm_limit_ns,
        }
        return limits.get(action, _LAND_LIMIT_NS)

    def _shows(self, waiting: _Waiting, seen: Observed) -> bool:
        if waiting.action is MissionAction.TAKEOFF:
            return self._flies(seen)
        if waiting.action is MissionAction.HOLD:
            return seen.phase is MissionPhase.HOLDING
        if waiting.action is MissionAction.RESUME:
            return seen.phase is MissionPhase.FLYING
        return self._lands(waiting, seen)

    def _flies(self, seen: Observed) -> bool:
        if seen.landed is not None and seen.landed is not VehicleLanded.UNKNOWN:
            return seen.landed is not VehicleLanded.ON_GROUND
        return seen.height_m is not None and seen.height_m >= self._limits.takeoff_height_m

    def _lands(self, waiting: _Waiting, seen: Observed) -> bool:
        if seen.phase in _LANDING_PHASES or seen.mode in LANDING_MODES:
            return True
        if seen.landed in (VehicleLanded.ON_GROUND, VehicleLanded.LANDING):
            return True
        if seen.mode:
            return False
        return self._sinks_to_the_ground(waiting, seen.height_m)

    def _sinks_to_the_ground(self, waiting: _Waiting, height_m: Optional[float]) -> bool:
        """Return True when it has come down: a descent that ends above the ground, or rises again, is none."""
        if waiting.height_m is None or height_m is None:
            return False
        lowest_m = waiting.height_m if waiting.lowest_m is None else waiting.lowest_m
        if height_m > lowest_m + _DESCENT_M:
            waiting.sinks = False
        waiting.lowest_m = min(lowest_m, height_m)
        waiting.sinks |= waiting.height_m - height_m >= _DESCENT_M
        return waiting.sinks and height_m <= _TOUCHED_M
