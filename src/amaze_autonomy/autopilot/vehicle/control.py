"""Who has control: us, the pilot, or the autopilot by a failsafe of its own.

PX4 has the system status CRITICAL while it acts by itself, whatever the mode (a lost OFFBOARD stream leads to POSCTL
without any pilot). ArduPilot has it as soon as a failsafe is triggered, also when nothing is done about it
(BATT_FS_LOW_ACT 0): there a failsafe acts when the mode has meanwhile become one that failsafes choose, and not by our
command. Without a failsafe, a mode that is flown by the sticks, and one that nobody of us ever commands or knows, is
the pilot's; so is any mode after ours was confirmed and left again. Disarmed, the mode shows what the user intended
last and says nothing about control.

The mode is in each HEARTBEAT (PX4: 1 Hz, whatever it is asked) and in CURRENT_MODE, which shows a change within 0.12 s.
"""

from __future__ import annotations

from typing import FrozenSet, Mapping, NamedTuple, Optional, Tuple

from ..link.dialect import Message, mavlink
from .modes import is_foreign, mode_name

__all__ = ["Control", "Heartbeat"]

_FAILSAFE: FrozenSet[int] = frozenset(
    {mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY, mavlink.MAV_STATE_FLIGHT_TERMINATION}
)
_CHOSEN_BY_FAILSAFES: FrozenSet[str] = frozenset({"AUTO.LAND", "AUTO.RTL", "AUTO.LOITER", "ALTCTL"})  # of ArduPilot
_SAME: Mapping[str, Tuple[str, ...]] = {"AUTO.LAND": ("AUTO.PRECLAND",)}


class Heartbeat(NamedTuple):
    """What a heartbeat says; its mode, when CURRENT_MODE told another one later."""

    t_ns: int
    armed: bool
    mode: str
    status: int
    autopilot: int
    vehicle: int = mavlink.MAV_TYPE_QUADROTOR

    @classmethod
    def of(cls, t_ns: int, message: Message) -> Heartbeat:
        """Return what a HEARTBEAT says."""
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        mode = mode_name(message.autopilot, message.custom_mode, message.type)
        return cls(t_ns, armed, mode, int(message.system_status), int(message.autopilot), int(message.type))


class Control:
    """Follows the heartbeats and what we command."""

    def __init__(self) -> None:
        self.beat: Optional[Heartbeat] = None
        self.mode_ns = 0
        self._commanded: Optional[str] = None
        self._confirmed = False
        self._before: Optional[str] = None

    def add(self, beat: Heartbeat) -> None:
        """Take a heartbeat."""
        self.beat, self.mode_ns = beat, beat.t_ns
        if not beat.armed:
            self._commanded, self._confirmed = None, False
        elif beat.mode == self._commanded:
            self._confirmed = True
        if beat.status not in _FAILSAFE:
            self._before = beat.mode

    def add_mode(self, t_ns: int, custom_mode: int) -> bool:
        """Take the mode of a CURRENT_MODE, after the first heartbeat; return whether it is another one."""
        beat = self.beat
        if beat is None:
            return False
        mode, self.mode_ns = mode_name(beat.autopilot, custom_mode, beat.vehicle), t_ns
        self.beat = beat._replace(mode=mode)
        if beat.armed and mode == self._commanded:
            self._confirmed = True
        return mode != beat.mode

    def command(self, mode: str) -> None:
        """Note that we commanded a mode; the same again changes nothing."""
        if mode != self._commanded:
            self._commanded, self._confirmed = mode, False

    @property
    def failsafe(self) -> bool:
        """Whether the autopilot acts by a failsafe of its own."""
        beat = self.beat
        if beat is None or not beat.armed or beat.status not in _FAILSAFE:
            return False
        if beat.autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA or beat.status != mavlink.MAV_STATE_CRITICAL:
            return True
        return beat.mode in _CHOSEN_BY_FAILSAFES and beat.mode not in (self._before, self._commanded)

    @property
    def pilot(self) -> bool:
        """Whether the pilot flies, or has changed the mode."""
        beat = self.beat
        if beat is None or not beat.armed or self.failsafe:
            return False
        if is_foreign(beat.mode):
            return True
        return self._confirmed and beat.mode not in (self._commanded, *_SAME.get(self._commanded or "", ()))

    @property
    def killed(self) -> bool:
        """Whether the kill switch is on: PX4 shows FLIGHT_TERMINATION then."""
        return self.beat is not None and self.beat.status == mavlink.MAV_STATE_FLIGHT_TERMINATION
