"""Who has control: us, the pilot, or the autopilot by a failsafe of its own.

The failsafe flag is the system status CRITICAL, or worse, while armed: PX4 sets it when it acts by itself, whatever the
mode (a lost OFFBOARD stream leads to POSCTL without any pilot). Without it, a mode that is flown by the sticks, and one
that nobody of us ever commands or knows, is the pilot's; so is any mode after ours was confirmed and left again.
Disarmed, the mode shows what the user intended last and says nothing about control.
"""

from __future__ import annotations

from typing import FrozenSet, Mapping, NamedTuple, Optional, Tuple

from .dialect import Message, mavlink
from .modes import is_foreign, mode_name

__all__ = ["Control", "Heartbeat"]

_FAILSAFE: FrozenSet[int] = frozenset(
    {mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY, mavlink.MAV_STATE_FLIGHT_TERMINATION}
)
_SAME: Mapping[str, Tuple[str, ...]] = {"AUTO.LAND": ("AUTO.PRECLAND",)}


class Heartbeat(NamedTuple):
    """What a heartbeat says."""

    t_ns: int
    armed: bool
    mode: str
    status: int
    autopilot: int

    @classmethod
    def of(cls, t_ns: int, message: Message) -> Heartbeat:
        """Return what a HEARTBEAT says."""
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        mode = mode_name(message.autopilot, message.custom_mode)
        return cls(t_ns, armed, mode, int(message.system_status), int(message.autopilot))


class Control:
    """Follows the heartbeats and what we command."""

    def __init__(self) -> None:
        self.beat: Optional[Heartbeat] = None
        self._commanded: Optional[str] = None
        self._confirmed = False

    def add(self, beat: Heartbeat) -> None:
        """Take a heartbeat."""
        self.beat = beat
        if not beat.armed:
            self._commanded, self._confirmed = None, False
        elif beat.mode == self._commanded:
            self._confirmed = True

    def command(self, mode: str) -> None:
        """Note that we commanded a mode; the same again changes nothing."""
        if mode != self._commanded:
            self._commanded, self._confirmed = mode, False

    @property
    def failsafe(self) -> bool:
        """Whether the autopilot acts by a failsafe of its own."""
        beat = self.beat
        return beat is not None and beat.armed and beat.status in _FAILSAFE

    @property
    def pilot(self) -> bool:
        """Whether the pilot flies, or has changed the mode."""
        beat = self.beat
        if beat is None or not beat.armed or beat.status in _FAILSAFE:
            return False
        if is_foreign(beat.mode):
            return True
        return self._confirmed and beat.mode not in (self._commanded, *_SAME.get(self._commanded or "", ()))

    @property
    def killed(self) -> bool:
        """Whether the kill switch is on: PX4 shows FLIGHT_TERMINATION then."""
        return self.beat is not None and self.beat.status == mavlink.MAV_STATE_FLIGHT_TERMINATION
