"""Does the steps of a command one after the other.

A step is sent, sent again until a heartbeat that came after it shows its effect, and given up at its limit.
Acknowledgements only give the reason: PX4 sends two for one change of mode (ACCEPTED, then TEMPORARILY_REJECTED), and
for some commands none.

While a step waits, the vehicle may fall into a mode that somebody else chose. Then it is the pilot's or the failsafe's,
and nothing more is sent.
"""

from __future__ import annotations

import enum
import math
from typing import List, Sequence

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.missions import PlannerSpec

from .dialect import Message
from .mission_steps import Means, Step
from .modes import is_foreign

__all__ = ["Procedure", "Progress"]

_SILENT_NS = 1_500_000_000  # longer than between two heartbeats
_NO_REASONS = ("MAV_RESULT_ACCEPTED", "MAV_RESULT_IN_PROGRESS")


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
        if watch.mode == self._steps[self._number].mode:
            return False
        if watch.mode == self._start_mode:  # a vehicle stands in any mode before it is armed
            return bool(watch.armed) and watch.pilot
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
