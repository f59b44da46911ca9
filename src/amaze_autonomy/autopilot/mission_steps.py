"""What is sent for each command of a mission, and how the vehicle shows that it has done it.

A command is a list of steps. A step is sent, sent again until a heartbeat that came after it shows its effect, and
given up at its limit. Acknowledgements only give the reason: PX4 sends two for one change of mode (ACCEPTED, then
TEMPORARILY_REJECTED), and for some commands none.

While a step waits, the vehicle may fall into a mode that somebody else chose. Then it is the pilot's or the failsafe's,
and nothing more is sent.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Callable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.missions import Controller, PlannerSpec

from .dialect import Message, mavlink
from .mission_items import Dialect
from .mission_vehicle import AIRBORNE, HOLD, LAND, MISSION, OFFBOARD, VehicleWatch
from .modes import MANUAL_MODES, NEVER_OURS

__all__ = ["STEPS", "Means", "Procedure", "Progress", "Step", "is_foreign"]

_SET_MODE, _ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
_START, _TAKE_OFF = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_TAKEOFF
_SILENT_NS = 1_500_000_000  # longer than between two heartbeats
_NO_REASONS = ("MAV_RESULT_ACCEPTED", "MAV_RESULT_IN_PROGRESS")


@dataclass
class Means:
    """What steps look at besides the vehicle.

    Args:
        watch: the vehicle.
        lead_ns: how long set-points must have been sent.
        takeoff_height_m: of a climb by command.
        resume_item: item of the mission to go on with; None: whatever the autopilot says.
        stream_ns: since when set-points are sent; None: they are not.
        still: the vehicle stands still by set-points.
        lifted: the vehicle has been in the air, its takeoff over.
    """

    watch: VehicleWatch
    lead_ns: int
    takeoff_height_m: float = 0.0
    resume_item: Optional[int] = None
    stream_ns: Optional[int] = None
    still: bool = False
    lifted: bool = False

    @property
    def streams(self) -> bool:
        """False where no set-point may be sent yet: one during ArduPilot's own takeoff would end it."""
        return self.watch.dialect is Dialect.PX4 or self.lifted


class Step(NamedTuple):
    """One thing to be done.

    Args:
        name: in words.
        done: whether the vehicle shows it; called with the means and the time.
        message: what is sent; None: nothing has to be.
        command: MAV_CMD whose acknowledgement gives the reason; 0: none.
        mode: that it leads to; empty: none.
        always: sent even when the vehicle shows it already, because another command may be under way.
    """

    name: str
    done: Callable[[Means, int], bool]
    message: Callable[[Means], Optional[Message]]
    command: int = 0
    mode: str = ""
    always: bool = True


def is_foreign(mode: str) -> bool:
    """Return whether a mode is one that we never command."""
    return mode in MANUAL_MODES or mode in NEVER_OURS


# --- steps ------------------------------------------------------------------------------------------------------------


def _long(watch: VehicleWatch, command: int, *values: float) -> Message:
    padded = (*values, *(0.0,) * (7 - len(values)))
    return mavlink.MAVLink_command_long_message(*watch.target, command, 0, *padded)


def _enter(mode: str) -> Step:
    def message(means: Means) -> Optional[Message]:
        numbers = means.watch.numbers(mode)
        return _long(means.watch, _SET_MODE, 1.0, *map(float, numbers)) if numbers else None

    return Step(f"change to {mode}", lambda means, _: means.watch.mode == mode, message, _SET_MODE, mode)


def _prepare(means: Means) -> str:
    """Return the mode to arm in."""
    return HOLD if means.watch.dialect is Dialect.PX4 else OFFBOARD


def _prepare_message(means: Means) -> Optional[Message]:
    numbers = means.watch.numbers(_prepare(means))
    return _long(means.watch, _SET_MODE, 1.0, *map(float, numbers)) if numbers else None


def _arming(*, armed: bool) -> Step:
    return Step(
        "arm" if armed else "disarm",
        lambda means, _: means.watch.armed is armed,
        lambda means: _long(means.watch, _ARM, float(armed)),
        _ARM,
    )


def _began(means: Means, command: int) -> bool:
    """Return whether ArduPilot leaves the ground; its takeoff takes longer to show than a command may."""
    accepted = means.watch.results.get(command) == "MAV_RESULT_ACCEPTED"
    return means.watch.dialect is Dialect.PX4 or means.watch.landed in AIRBORNE or accepted


def _lift_message(means: Means) -> Message:
    return _long(means.watch, _TAKE_OFF, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, means.takeoff_height_m)


_PREPARE = Step(
    "change to a mode to arm in", lambda means, _: means.watch.mode == _prepare(means), _prepare_message, _SET_MODE
)
#: ArduPilot in AUTO stays on the ground until it is told to begin, and in GUIDED until it is told to take off
_BEGIN = Step(
    "start of the mission",
    lambda means, _: _began(means, _START),
    lambda means: _long(means.watch, _START),
    _START,
    always=False,
)
_LIFT = Step("takeoff", lambda means, _: _began(means, _TAKE_OFF), _lift_message, _TAKE_OFF, always=False)
_ITEM = Step(
    "return to the item where it stopped",
    lambda means, _: means.resume_item is None or means.watch.current == means.resume_item,
    lambda means: mavlink.MAVLink_mission_set_current_message(*means.watch.target, means.resume_item or 0),
    always=False,
)
_STREAM = Step(
    "stream of set-points",
    lambda means, t_ns: not means.streams or (means.stream_ns is not None and t_ns - means.stream_ns >= means.lead_ns),
    lambda _: None,
    always=False,
)
_STILL = Step("stop", lambda means, _: means.still or not means.streams, lambda _: None, always=False)

_Key = Tuple[Controller, MissionAction]
STEPS: Mapping[_Key, Tuple[Step, ...]] = {
    (Controller.MISSION, MissionAction.TAKEOFF): (_PREPARE, _arming(armed=True), _enter(MISSION), _BEGIN),
    (Controller.MISSION, MissionAction.HOLD): (_enter(HOLD),),
    (Controller.MISSION, MissionAction.RESUME): (_ITEM, _enter(MISSION), _BEGIN),
    (Controller.MISSION, MissionAction.LAND): (_enter(LAND),),
    (Controller.MISSION, MissionAction.ABORT): (_arming(armed=False),),  # on the ground; airborne it is LAND
    (Controller.OFFBOARD, MissionAction.TAKEOFF): (_STREAM, _enter(OFFBOARD), _arming(armed=True), _LIFT),
    (Controller.OFFBOARD, MissionAction.HOLD): (_STREAM, _enter(OFFBOARD), _STILL),
    (Controller.OFFBOARD, MissionAction.RESUME): (_STREAM, _enter(OFFBOARD)),
    (Controller.OFFBOARD, MissionAction.LAND): (_enter(LAND),),
    (Controller.OFFBOARD, MissionAction.ABORT): (_arming(armed=False),),
}


# --- doing them -------------------------------------------------------------------------------------------------------


class Progress(enum.Enum):
    """How far a procedure is."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    TAKEN = "taken"  # somebody else has chosen another mode


class Procedure:
    """Does steps one after the other.

    Args:
        action: that it carries out.
        steps: of it.
        means: what they look at.
        spec: pauses and limits.
        t_ns: now.
        persistent: goes on after its limit (a landing).
    """

    def __init__(
        self,
        action: MissionAction,
        steps: Sequence[Step],
        means: Means,
        spec: PlannerSpec,
        t_ns: int,
        *,
        persistent: bool = False,
    ) -> None:
        self.action, self.progress, self.reason = action, Progress.RUNNING, ""
        self._steps, self._means, self._spec, self._persistent = tuple(steps), means, spec, persistent
        self._number = 0
        self._start_mode = means.watch.mode
        self._since_ns = self._woken_ns = t_ns
        self._paused_ns = 0
        self._sent_ns: float = -math.inf
        self._first_ns: float = math.inf
        self._forget_result()

    @property
    def running(self) -> bool:
        """True until it has ended."""
        return self.progress is Progress.RUNNING

    def wake(self, t_ns: int) -> List[Message]:
        """Look at the vehicle and the time; return what is to be sent."""
        if not self.running:
            return []
        self._pause(t_ns)
        while self._shown(t_ns):
            self._number += 1
            if self._number == len(self._steps):
                self.progress, self.reason = Progress.DONE, ""
                return []
            self._since_ns, self._sent_ns, self._first_ns = t_ns, -math.inf, math.inf
            self._forget_result()
        if self._taken():
            self.progress, self.reason = Progress.TAKEN, f"the vehicle went to {self._means.watch.mode} by itself"
            return []
        if t_ns - self._since_ns >= self._spec.command_limit_ns:
            self._late(t_ns)
        return self._send(t_ns) if self.running else []

    def _forget_result(self) -> None:
        """Forget how an earlier command was acknowledged."""
        self._means.watch.results.pop(self._steps[self._number].command, None)

    def _pause(self, t_ns: int) -> None:
        """Stop the clock of the limit while the vehicle is silent, at most for two limits: nothing can show then."""
        passed_ns, self._woken_ns = t_ns - self._woken_ns, t_ns
        heard_ns = self._means.watch.heartbeat_ns
        silent = heard_ns is None or t_ns - heard_ns > _SILENT_NS
        if silent and self._paused_ns + passed_ns <= 2 * self._spec.command_limit_ns:
            self._paused_ns += passed_ns
            self._since_ns += passed_ns

    def _shown(self, t_ns: int) -> bool:
        """Return whether the vehicle shows the effect, by a heartbeat that came after the command."""
        step, heartbeat_ns = self._steps[self._number], self._means.watch.heartbeat_ns
        after = not step.always or (heartbeat_ns is not None and heartbeat_ns > self._first_ns)
        return after and step.done(self._means, t_ns)

    def _taken(self) -> bool:
        watch = self._means.watch
        if watch.mode in (self._start_mode, self._steps[self._number].mode):
            return False
        return is_foreign(watch.mode) or (watch.failsafe and bool(watch.armed))

    def _late(self, t_ns: int) -> None:
        step, watch = self._steps[self._number], self._means.watch
        result = watch.results.get(step.command, "")
        said = [each for each in (watch.complaint(t_ns, self._since_ns), result) if each and each not in _NO_REASONS]
        shown = f"mode {watch.mode or 'unknown'}, {'armed' if watch.armed else 'not armed'}"
        limit_s = self._spec.command_limit_ns / 1e9
        self.reason = f"{step.name}: not shown within {limit_s:g} s ({'; '.join(said) or shown})"
        if not self._persistent:
            self.progress = Progress.FAILED

    def _send(self, t_ns: int) -> List[Message]:
        if t_ns - self._sent_ns < self._spec.command_retry_ns:
            return []
        step = self._steps[self._number]
        self._sent_ns = t_ns
        self._first_ns = min(self._first_ns, t_ns)
        message = step.message(self._means)
        return [] if message is None else [message]
