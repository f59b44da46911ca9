"""The simulated battery: it only ever gets emptier."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional

__all__ = ["Power", "PowerSettings"]

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
