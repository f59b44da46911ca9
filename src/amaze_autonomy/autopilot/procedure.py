"""Does the steps of a command one after the other.

A step is sent, sent again until a heartbeat that came after it shows its effect, and given up at its limit.
Acknowledgements only give the reason: PX4 sends two for one change of mode (ACCEPTED, then TEMPORARILY_REJECTED), and
for some commands none.

While a step waits, the vehicle may fall into a mode that somebody else chose. Then it is the pilot's or the failsafe's,
and nothing more is sent. The same where somebody else lands it. What waits ends with a silence of the vehicle, a
landing excepted: nobody knows what has become of the vehicle meanwhile, and whoever commanded it must say what is next.
"""

from __future__ import annotations

import enum
import math
from typing import List, Sequence

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.missions import PlannerSpec

from .dialect import Message
from .mission_steps import Means, Step
from .modes import LANDING_MODES, is_foreign

__all__ = ["Procedure", "Progress"]

_SILENT_NS = 1_500_000_000  # longer than between two heartbeats
_NO_REASONS = ("MAV_RESULT_ACCEPTED", "MAV_RESULT_IN_PROGRESS")


class Progress(enum.Enum):
    """How far a procedure is."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    TAKEN = "taken"  # somebody else has chosen another mode
    SILENT = "silent"  # the vehicle was not heard for too long


class Procedure:
    """Does steps one after the other.

    Args:
        action: that it carries out.
        steps: of it.
        means: what they look at.
        spec: pauses and limits.
        t_ns: now.
        persistent: goes on after its limit, and through a silence (a landing).
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
        limit_ns = self._spec.vehicle_age_limit_ns
        if not self._persistent and not self._means.watch.known(t_ns, limit_ns):
            return self._end(Progress.SILENT, f"the vehicle was silent for {limit_ns / 1e9:g} s")
        self._pause(t_ns)
        while self._shown(t_ns):
            self._number += 1
            if self._number == len(self._steps):
                return self._end(Progress.DONE)
            self._since_ns, self._sent_ns, self._first_ns = t_ns, -math.inf, math.inf
            self._forget_result()
        heard = self._means.watch.known(t_ns, limit_ns)
        taken = self._taken() if heard else ""
        if taken:
            return self._end(Progress.TAKEN, taken)
        if self._steps[self._number].limited and t_ns - self._since_ns >= self._spec.command_limit_ns:
            self._late(t_ns)
        blind = not heard and self._means.watch.pilot  # the last that was heard: whether he still flies is not known
        return self._send(t_ns) if self.running and not blind else []

    def cease(self, reason: str) -> None:
        """End it: somebody else lands."""
        if self.running:
            self._end(Progress.TAKEN, reason)

    def fail(self, reason: str) -> None:
        """End it: it cannot be done."""
        if self.running:
            self.progress, self.reason = Progress.FAILED, reason

    def _end(self, progress: Progress, why: str = "") -> List[Message]:
        self.progress = progress
        self.reason = f"{self.action.name.lower()} ended: {why}" if why else ""
        return []

    def _forget_result(self) -> None:
        """Forget how an earlier command was acknowledged."""
        self._means.watch.results.pop(self._steps[self._number].command, None)

    def _pause(self, t_ns: int) -> None:
        """Stop the clock of the limit while the vehicle is silent: nothing can show then."""
        passed_ns, self._woken_ns = t_ns - self._woken_ns, t_ns
        if not self._means.watch.known(t_ns, _SILENT_NS):
            self._since_ns += passed_ns

    def _shown(self, t_ns: int) -> bool:
        """Return whether the vehicle shows the effect, by a heartbeat (a mode: CURRENT_MODE, too) after the command.

        A mode that is shown is not sent again: a pilot may choose another one in the second until the next heartbeat.
        """
        step, watch = self._steps[self._number], self._means.watch
        said_ns = watch.mode_ns if step.mode else watch.heartbeat_ns
        after = not step.always or (said_ns is not None and said_ns > self._first_ns)
        return after and step.done(self._means, t_ns)

    def _taken(self) -> str:
        """Return who has chosen what the vehicle does, in words; empty: nobody but us."""
        watch, step = self._means.watch, self._steps[self._number]
        if watch.mode == step.mode:
            return ""
        if watch.armed and not self._persistent and (watch.mode in LANDING_MODES or watch.lands):
            return f"the vehicle lands (mode {watch.mode})"
        if watch.mode == self._start_mode:  # a vehicle stands in any mode before it is armed
            taken = bool(watch.armed) and watch.pilot
        else:
            by_failsafe = watch.failsafe and bool(watch.armed) and watch.mode not in self._means.commanded
            taken = is_foreign(watch.mode) or by_failsafe
        return f"the vehicle went to {watch.mode} by itself" if taken else ""

    def _late(self, t_ns: int) -> None:
        step, watch = self._steps[self._number], self._means.watch
        result = watch.results.get(step.command, "")
        answer = "" if result in _NO_REASONS else result.replace("MAV_RESULT_", "", 1)
        shown = f"mode {watch.mode or 'unknown'}, {'armed' if watch.armed else 'not armed'}"
        said = watch.complaints(t_ns, self._since_ns)
        limit_s, words = self._spec.command_limit_ns / 1e9, f": {'; '.join(said)}" if said else ""
        self.reason = f"{step.name}: not shown within {limit_s:g} s ({answer or shown}){words}"
        if not self._persistent:
            self.progress = Progress.FAILED

    def _send(self, t_ns: int) -> List[Message]:
        if t_ns - self._sent_ns < self._spec.command_retry_ns:
            return []
        message = self._steps[self._number].message(self._means)
        self._first_ns = min(self._first_ns, t_ns)
        if message is None:
            return []
        self._sent_ns = t_ns
        return [message]
