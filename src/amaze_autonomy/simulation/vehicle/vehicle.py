"""The simulated vehicle: its battery; arming, takeoff and disarming as PX4 does them; who may command it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.missions import Waypoint

from .flight import LANDING_MODES, Flags, Flight, Mode, Pose, VehicleSettings, descent

__all__ = ["LANDING_MODES", "Flags", "Mode", "Pose", "Power", "PowerSettings", "Vehicle", "VehicleSettings"]

# --- the battery ------------------------------------------------------------------------------------------------------


_NS = 1e-9
_FULL_CELL_V, _EMPTY_CELL_V, _SAG_CELL_V = 4.2, 3.3, 0.12


@dataclass(frozen=True)
class PowerSettings:
    """How the battery behaves.

    Args:
        fraction: level at the start, 0..1.
        flight_endurance_s: how long a full battery flies.
        idle_endurance_s: how long a full battery feeds the computers on the ground.
        cells: in series.
    """

    fraction: float = 1.0
    flight_endurance_s: float = 1000.0
    idle_endurance_s: float = 14400.0
    cells: int = 6


class Power:
    """A battery that is used up; `fraction` never rises."""

    def __init__(self, settings: PowerSettings) -> None:
        self.fraction = settings.fraction
        self.known = True
        self._settings = settings
        self._drain_per_s = 0.0
        self._drain_to = 0.0

    @property
    def cells(self) -> int:
        """How many cells are in series."""
        return self._settings.cells

    def advance(self, elapsed_ns: int, *, flying: bool) -> None:
        """Use up what a time of flight, or of standing, needs."""
        endurance = self._settings.flight_endurance_s if flying else self._settings.idle_endurance_s
        seconds = elapsed_ns * _NS
        if self._drain_per_s > 0.0 and self.fraction > self._drain_to:
            self.fraction = max(self._drain_to, self.fraction - self._drain_per_s * seconds)
        self.fraction = max(0.0, self.fraction - seconds / endurance)

    def drop_to(self, fraction: float) -> None:
        """Lose charge at once; a level above the present one changes nothing."""
        self.fraction = min(self.fraction, max(0.0, fraction))

    def drain_to(self, fraction: float, over_s: float) -> None:
        """Lose charge evenly until a level is reached, beside what is used."""
        self._drain_to = fraction
        self._drain_per_s = max(0.0, self.fraction - fraction) / over_s

    def stop_draining(self) -> None:
        """Lose no more than what is used."""
        self._drain_per_s = 0.0

    def voltage_v(self, *, flying: bool) -> Optional[float]:
        """Return the voltage, lower in flight; None when unknown."""
        if not self.known:
            return None
        cell = _EMPTY_CELL_V + (_FULL_CELL_V - _EMPTY_CELL_V) * self.fraction
        return self._settings.cells * (cell - _SAG_CELL_V if flying else cell)


# --- the vehicle ------------------------------------------------------------------------------------------------------
# It obeys like PX4: a mode is a wish until the vehicle can follow it, it detects the ground and disarms by itself after
# a landing, and nobody overrules the pilot.


_FALL_M_S = 6.0  # without motors, on the way down from a few metres


class Vehicle(Flight):
    """The one vehicle of the world; commands return why they are refused, or nothing."""

    def __init__(self, settings: VehicleSettings, t_ns: int = 0) -> None:
        super().__init__(settings, t_ns)
        self.armed = False
        self.failsafe = False
        self._arm_at: Optional[int] = None
        self._lift_at: Optional[int] = None
        self._blind_at: Optional[int] = None
        self._flew = False

    # --- commands -------------------------------------------------------------------------------------------------

    def upload(self, waypoints: Tuple[Waypoint, ...]) -> str:
        """Take the waypoints of the next flight."""
        if self.armed:
            return "armed: no new waypoints"
        self.waypoints, self.reached, self._leave_at = waypoints, 0, None
        return ""

    def take_off(self) -> str:
        """Arm, climb to the takeoff height and follow the waypoints."""
        if self.pilot:
            return "the pilot has control"
        if self.armed or self._arm_at is not None:
            return "already armed"
        if not self.waypoints:
            return "no waypoints"
        if self.flags.not_ready:
            return "arming denied: " + ", ".join(sorted(self.flags.not_ready.values()))
        self._arm_at = self.t_ns + self.settings.arm_ns
        return ""

    def hold(self) -> str:
        """Stay where it is."""
        return self._command(Mode.LOITER)

    def resume(self) -> str:
        """Follow the waypoints from where it stopped."""
        if not self.armed:
            return "not armed"
        return self._command(Mode.MISSION)

    def land(self) -> str:
        """Land where it is."""
        if not self.armed and self._arm_at is None:
            return "not armed"
        self._arm_at = None
        return self._command(Mode.LAND) if self.armed else ""

    def disarm(self) -> str:
        """Stop the motors, on the ground only."""
        if self.airborne:
            return "denied: not on the ground"
        if self.flags.does_not_disarm:
            return "denied"
        self._arm_at = None
        self._set_disarmed()
        return ""

    def cut_motors(self) -> str:
        """Stop the motors wherever it is; in the air it falls."""
        if self.flags.does_not_disarm:
            return "denied"
        self._arm_at = None
        said = self.landed
        self._set_disarmed()
        if self.airborne:
            self.landed = said
            self._stop()
        return ""

    def _command(self, mode: str) -> str:
        if self.pilot:
            return "the pilot has control"
        if self.failsafe:
            return "the autopilot is in a failsafe mode"
        if mode in self.flags.ignores:
            return ""
        self._set_mode(mode)
        return ""

    # --- what others do to it -------------------------------------------------------------------------------------

    def pilot_takes_over(self, mode: str, land_after_ns: int) -> None:
        """Let the pilot fly: he stays where he is, lands after a time, and disarms."""
        self.pilot = True
        self._arm_at = None
        self._pilot_lands_at = self.t_ns + land_after_ns
        self._set_mode(mode)

    def pilot_gives_back(self) -> None:
        """Let the pilot switch back to a mode of the autopilot: it loiters."""
        self.pilot = False
        self._pilot_lands_at = None
        self._set_mode(Mode.LOITER)

    def pilot_arms(self) -> None:
        """Let somebody arm who was not asked to."""
        if not self.armed:
            self._set_armed()

    def enter_failsafe(self, mode: str) -> None:
        """Let the autopilot act by a failsafe of its own."""
        if self.armed and not self.pilot:
            self.failsafe = True
            self._set_mode(mode)

    def leave_failsafe(self) -> None:
        """Let the autopilot's failsafe end in the air: it loiters."""
        if self.failsafe:
            self.failsafe = False
            if self.armed and not self.pilot:
                self._set_mode(Mode.LOITER)

    def lose_gps(self) -> None:
        """Take the GPS away: some seconds later the autopilot gives its position up."""
        self.flags.gps_lost = True
        self._blind_at = self.t_ns + self.settings.blind_ns

    def find_gps(self) -> None:
        """Give the GPS back."""
        self.flags.gps_lost = False
        self._blind_at = None

    # --- motion ---------------------------------------------------------------------------------------------------

    def advance(self, t_ns: int) -> None:
        """Fly on to a later time; what happened on the way is appended to `happened`."""
        while self.t_ns < t_ns:
            self._step(t_ns)

    def _step(self, end_ns: int) -> None:
        """Go on to `end_ns`, or to the next moment at which something changes."""
        if self._arm_at is not None:
            end_ns = min(end_ns, max(self._arm_at, self.t_ns))
            if self._arm_at <= self.t_ns:
                self._arm()
                return
        if not self.armed:
            (self._fall if self.airborne else self._stay)(end_ns)
            return
        if self._blind_at is not None and self.airborne:
            end_ns = min(end_ns, max(self._blind_at, self.t_ns))
            if self._blind_at <= self.t_ns:
                self._blind_at = None
                self.enter_failsafe(Mode.LAND)
                return
        if self.airborne:
            self._fly(end_ns)
        else:
            self._stand(end_ns)

    def _fall(self, end_ns: int) -> None:
        if self._go(self._leg or descent(self.position_m, _FALL_M_S, self.t_ns), end_ns):
            self._touch()
            self.landed = VehicleLanded.ON_GROUND
            self.happened.append("landed")

    def _arm(self) -> None:
        self._arm_at = None
        if self.flags.does_not_arm:
            return
        self._set_armed()
        self._lift_at = self.t_ns + self.settings.spin_up_ns
        self._set_mode(Mode.TAKEOFF)
        self.happened.append("takeoff")

    def _stand(self, end_ns: int) -> None:
        """Stand on the ground, armed: wait for lift-off, or for the automatic disarming."""
        self._stop()
        if self._lift_at is not None and self._wants_up() and not self.flags.does_not_lift_off:
            if self._lift_at <= self.t_ns:
                self._lift_at, self._flew = None, True
                self._lift_off()
                return
            end_ns = min(end_ns, self._lift_at)
        self.t_ns = min(end_ns, self._settle(end_ns))

    def _settle(self, end_ns: int) -> int:
        """Detect the ground, then disarm; return when the next of them is due."""
        if self.landed != VehicleLanded.ON_GROUND:
            due = self._ground_since + self.settings.ground_ns
            if due <= self.t_ns:
                self.landed = VehicleLanded.ON_GROUND
                self.happened.append("landed")
                return self.t_ns
            return due
        if self.flags.does_not_disarm or (self._lift_at is not None and self._wants_up()):
            return end_ns
        due = self._ground_since + self._disarm_wait_ns()
        if due <= self.t_ns:
            self._set_disarmed()
            return self.t_ns
        return due

    def _wants_up(self) -> bool:
        return self.mode in (Mode.TAKEOFF, Mode.MISSION)

    def _disarm_wait_ns(self) -> int:
        """Return how long after touching the ground it disarms by itself."""
        if not self._flew and self.mode != Mode.LAND:
            return self.settings.idle_disarm_ns
        return self.settings.ground_ns + self.settings.disarm_ns

    def _set_armed(self) -> None:
        self.armed = True
        self._ground_since = self.t_ns
        self._lift_at, self._flew = None, False
        self.happened.append("armed")

    def _set_disarmed(self) -> None:
        self._lift_at = None
        if not self.armed:
            return
        self.armed = False
        self.failsafe = False
        self.landed = VehicleLanded.ON_GROUND
        self.happened.append("disarmed")
