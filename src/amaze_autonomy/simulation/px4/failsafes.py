"""The failsafes that the simulated PX4 has: position lost, battery, set-points that stop, transmitter lost."""

from __future__ import annotations

from typing import Callable, Optional

from amaze_autonomy.simulation.vehicle.flight import Mode

from .craft import Craft
from .health import Health
from .modes import DESCEND, OFFBOARD
from .parameters import Parameters

__all__ = ["BATTERY_LEVELS", "Failsafes"]

_S = 1_000_000_000

BATTERY_LEVELS = ("ok", "low", "critical", "emergency")
_BATTERY_TEXTS = ("", "Low battery\t", "Critical battery\t", "Emergency battery level\t")
_EMERGENCY, _CRITICAL, _INFO = 0, 2, 6
_WITH_POSITION = (Mode.MISSION, Mode.LOITER, Mode.TAKEOFF, Mode.RTL, Mode.LAND, OFFBOARD)
_LAND_AT = {2: 2, 3: 3}  # COM_LOW_BAT_ACT -> level at which it lands
_RETURN_AT = {1: 2, 3: 2}  # COM_LOW_BAT_ACT -> level at which it returns

_AFTER_OFFBOARD = {3: Mode.RTL, 4: Mode.LAND, 5: Mode.LOITER}  # COM_OBL_RC_ACT

_Say = Callable[[int, str], None]


class Failsafes:
    """Acts on its own when it must; each action once.

    Args:
        craft: the vehicle.
        health: of its sensors.
        parameters: what is done in which case.
        say: tells a text: (severity, text).
    """

    def __init__(self, craft: Craft, health: Health, parameters: Parameters, say: _Say) -> None:
        self._craft, self._health, self._parameters, self._say = craft, health, parameters, say
        self.level = 0
        self.set_point_ns: Optional[int] = None
        self._after_hold: Optional[str] = None
        self._hold_until_ns: Optional[int] = None
        self._transmitter_lost = False

    def offboard_ready(self, t_ns: int) -> bool:
        """Tell whether set-points come."""
        limit_ns = round(float(self._parameters["COM_OF_LOSS_T"]) * _S)
        return self.set_point_ns is not None and t_ns - self.set_point_ns < limit_ns

    def advance(self, t_ns: int, fraction: Optional[float], *, transmitter: bool) -> None:
        """Look at everything, and act."""
        self._follow_battery(t_ns, fraction)
        self._follow_transmitter(t_ns, transmitter=transmitter)
        if not self._craft.armed:
            self._hold_until_ns = None
            return
        if self._hold_until_ns is not None and not self._craft.failsafe:
            self._hold_until_ns = None  # somebody chose another mode meanwhile
        if self._craft.mode == OFFBOARD and not self.offboard_ready(t_ns):
            self._act(_AFTER_OFFBOARD.get(int(self._parameters["COM_OBL_RC_ACT"]), Mode.POSITION))
        elif self._health.position_lost and self._craft.airborne and self._craft.mode in _WITH_POSITION:
            self._act(DESCEND)
        elif self._hold_until_ns is not None and t_ns >= self._hold_until_ns and self._after_hold is not None:
            self._hold_until_ns = None
            self._act(self._after_hold)

    def _act(self, mode: str, text: str = "Failsafe activated\t") -> None:
        if self._craft.pilot:
            return
        self._say(_CRITICAL, text)
        self._craft.failsafe = True
        self._craft.fall_into(mode)

    def _delay(self, t_ns: int, mode: str) -> None:
        """Hold for a while, so that the pilot can take over, then act."""
        wait_s = float(self._parameters["COM_FAIL_ACT_T"])
        self._after_hold = mode
        if self._hold_until_ns is None:
            self._hold_until_ns = t_ns + round(wait_s * _S)
            self._act(Mode.LOITER, f"Failsafe activated: entering Hold for {wait_s:.0f} seconds\t")

    def _follow_battery(self, t_ns: int, fraction: Optional[float]) -> None:
        if fraction is None:
            return
        thresholds = (float(self._parameters[name]) for name in ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"))
        level = sum(fraction < threshold for threshold in thresholds)
        worse, self.level = level > self.level, level
        if not worse:
            return
        self._say(_EMERGENCY, _BATTERY_TEXTS[level])
        if not self._craft.armed:
            return
        if level == 1:
            self._say(_CRITICAL, "Failsafe activated\t")
        action = int(self._parameters["COM_LOW_BAT_ACT"])
        if self._craft.mode in (Mode.LAND, DESCEND) or not self._craft.airborne:
            return
        if level >= _LAND_AT.get(action, 9):
            self._delay(t_ns, Mode.LAND)
        elif level >= _RETURN_AT.get(action, 9):
            self._delay(t_ns, Mode.RTL)

    def _follow_transmitter(self, t_ns: int, *, transmitter: bool) -> None:
        lost = not transmitter
        newly, self._transmitter_lost = lost and not self._transmitter_lost, lost
        exempt = (Mode.MISSION, OFFBOARD, Mode.LAND, Mode.RTL)
        if newly and self._craft.airborne and self._craft.mode not in exempt:
            self._say(_EMERGENCY, "Manual control lost\t")
            if int(self._parameters["NAV_RCL_ACT"]) == 2:  # noqa: PLR2004 - RTL
                self._delay(t_ns, Mode.RTL)
