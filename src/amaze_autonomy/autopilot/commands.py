"""Land and disarm: sent, sent again, and confirmed by what the heartbeats show, never by an acknowledgement.

PX4 answers one DO_SET_MODE with two acknowledgements (ACCEPTED, then TEMPORARILY_REJECTED) and some commands with none.
So they only lend their words to the reason when the state does not change in time.
"""

from __future__ import annotations

import enum
from typing import Callable, Dict, List, NamedTuple, Optional

from .dialect import Message, mavlink

__all__ = ["Confirmed", "Progress", "command_long", "set_mode"]

_RESULTS: Dict[int, str] = {
    mavlink.MAV_RESULT_ACCEPTED: "accepted",
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED: "temporarily rejected",
    mavlink.MAV_RESULT_DENIED: "denied",
    mavlink.MAV_RESULT_UNSUPPORTED: "not supported",
    mavlink.MAV_RESULT_FAILED: "failed",
    mavlink.MAV_RESULT_IN_PROGRESS: "in progress",
}


class Progress(enum.Enum):
    """How far a command is."""

    IDLE = "idle"
    SENT = "sent"
    CONFIRMED = "confirmed"
    GIVEN_UP = "given up"


class CommandLimits(NamedTuple):
    """Time between two sendings, and the time after which it is given up."""

    repeat_ns: int
    limit_ns: int


def command_long(system: int, component: int, command: int, *parameters: float) -> Message:
    """Return a COMMAND_LONG; parameters that are not given are 0."""
    given = [*parameters, *[0.0] * (7 - len(parameters))]
    return mavlink.MAVLink_command_long_message(system, component, command, 0, *given)


def set_mode(system: int, component: int, main: int, sub: int) -> Message:
    """Return the command for a flight mode."""
    custom = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    return command_long(system, component, mavlink.MAV_CMD_DO_SET_MODE, custom, main, sub)


class Confirmed:
    """One command until its effect is seen.

    Args:
        make: returns the message to send.
        done: whether the vehicle shows it.
        limits: see there.
        stands: it is sent on after its limit, until it is done or stopped.
    """

    def __init__(
        self,
        make: Callable[[], Optional[Message]],
        done: Callable[[], bool],
        limits: CommandLimits,
        *,
        stands: bool = False,
    ) -> None:
        self._make, self._done, self._limits, self._stands = make, done, limits, stands
        self.progress = Progress.IDLE
        self.answer = ""
        self._began_ns = self._due_ns = 0

    def ask(self, t_ns: int) -> List[Message]:
        """Begin, or go on when it is under way; return what to send now."""
        if not self.sending:
            self._due_ns, self.answer = t_ns, ""
        self.progress = Progress.SENT
        self._began_ns = t_ns
        return self.wake(t_ns)

    def stop(self) -> None:
        """Send no more."""
        self.progress = Progress.IDLE

    @property
    def sending(self) -> bool:
        """True while it is sent."""
        return self.progress is Progress.SENT or (self._stands and self.progress is Progress.GIVEN_UP)

    def wake(self, t_ns: int) -> List[Message]:
        """Look whether it is done; return what is due."""
        if not self.sending:
            return []
        if self._done():
            self.progress = Progress.CONFIRMED
        elif t_ns - self._began_ns > self._limits.limit_ns:
            self.progress = Progress.GIVEN_UP
        if not self.sending or t_ns < self._due_ns:
            return []
        message = self._make()
        if message is None:
            return []
        self._due_ns = t_ns + self._limits.repeat_ns
        return [message]

    def acknowledged(self, result: int) -> None:
        """Keep the words of an acknowledgement; a refusal is kept over an acceptance."""
        if self.progress is Progress.SENT and (result != mavlink.MAV_RESULT_ACCEPTED or not self.answer):
            self.answer = _RESULTS.get(result, f"result {result}")
