"""The vehicle as ArduCopter flies it: what lifts off when, and where a mission begins."""

from __future__ import annotations

from typing import Optional

from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.simulation.flight import Mode, VehicleSettings
from amaze_autonomy.simulation.px4.craft import Craft
from amaze_autonomy.simulation.px4.geography import Geography

from .modes import ARMABLE, GUIDED, STABILIZE

__all__ = ["ArduCraft"]


class ArduCraft(Craft):
    """It begins in STABILIZE. Item 0 of a mission is home; in AUTO it waits on the ground for MISSION_START.

    Args:
        settings: how it flies.
        t_ns: when it begins.
        geography: where its local frame lies.
    """

    after_takeoff = GUIDED

    def __init__(self, settings: VehicleSettings, t_ns: int = 0, geography: Optional[Geography] = None) -> None:
        super().__init__(settings, t_ns, geography)
        self.mode = self.intended = STABILIZE
        self.started = False

    def arm(self) -> str:
        """Turn the motors on, on the ground."""
        if self.mode not in ARMABLE:
            return "Mode not armable"
        if not self.armed and not self.flags.does_not_arm:
            self._set_armed()
        return ""

    def set_current(self, number: int) -> None:
        """Go on with an item; with 0, home, the mission begins anew, at 1."""
        super().set_current(1 if number == 0 and len(self.items) > 1 else number)

    def fall_into(self, mode: str) -> None:
        """Enter a mode, whoever wants it."""
        if mode == Mode.MISSION and self.current == 0:
            self.set_current(0)
        if mode != Mode.MISSION:
            self.started = False
        super().fall_into(mode)

    def start_mission(self) -> None:
        """Let it lift off in AUTO."""
        self.started = True
        self._prepare_lift()

    def interrupt_takeoff(self) -> None:
        """Take a set-point during a takeoff in GUIDED: the takeoff is over, wherever it is."""
        if self.mode == Mode.TAKEOFF:
            self.mode, self._lift_at, self._leg = GUIDED, None, None
            if self.airborne:
                self.landed = VehicleLanded.IN_AIR

    def _wants_up(self) -> bool:
        if self.mode == GUIDED or (self.mode == Mode.MISSION and not self.started):
            return False
        return super()._wants_up()

    def _finish_on_ground(self) -> None:
        if self.started:  # else it only waits
            super()._finish_on_ground()

    def _set_disarmed(self) -> None:
        mode = self.mode
        super()._set_disarmed()
        self.mode = self.intended = mode
        self.started = False
