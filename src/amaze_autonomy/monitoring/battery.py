"""Is the battery enough for the next mission? What it does not know stays unknown, and unknown is not enough."""

from __future__ import annotations

from typing import NamedTuple, Optional, Tuple

from ..engine.events import Check, Verdict, finite
from .specs import BatterySpec

CELL_VOLTAGE = "battery cell voltage"  # name of a row

_S = 1_000_000_000


class BatteryVerdict(NamedTuple):
    """The answer of srv/CheckBattery.srv; None is unknown."""

    ok: bool
    fraction: Optional[float]
    voltage_v: Optional[float]
    checks: Tuple[Check, ...]


class BatteryMonitor:
    """The last thing that the battery said."""

    def __init__(self, spec: Optional[BatterySpec] = None) -> None:
        self.spec = spec or BatterySpec()
        self._t_ns: Optional[int] = None
        self._fraction: Optional[float] = None
        self._voltage_v: Optional[float] = None

    def add(self, t_ns: int, fraction: Optional[float], voltage_v: Optional[float] = None) -> None:
        """Add a level. A fraction outside 0..1 (-1, -0.53), a voltage not above 0, and NaN are unknown."""
        known, volts = finite(fraction), finite(voltage_v)
        self._t_ns = t_ns
        self._fraction = known if known is not None and 0.0 <= known <= 1.0 else None
        self._voltage_v = volts if volts is not None and volts > 0 else None

    def check(self, t_ns: int, required_fraction: Optional[float]) -> BatteryVerdict:
        """Return the verdict for a mission that needs a fraction, reserve included; None: nobody knows how much."""
        rows = [self._age_row(t_ns), self._fraction_row(t_ns, required_fraction)]
        if self.spec.cells:
            rows.append(self._voltage_row(t_ns))
        return BatteryVerdict(all(row.passed for row in rows), self._fraction, self._voltage_v, tuple(rows))

    def _age_s(self, t_ns: int) -> Optional[float]:
        return None if self._t_ns is None else (t_ns - self._t_ns) / _S

    def _age_row(self, t_ns: int) -> Check:
        limit_s, age_s = self.spec.age_limit_ns / _S, self._age_s(t_ns)
        if age_s is None:
            advice = "no battery status received: is the autopilot connected?"
            return Check("battery age", Verdict.UNKNOWN, None, limit_s, "s", None, advice, heals=True)
        if abs(age_s) <= limit_s:
            return Check("battery age", Verdict.PASS, age_s, limit_s, "s", age_s)
        how = "old" if age_s > 0 else "in the future, clocks differ"
        advice = f"the battery's last message is {abs(age_s):.3g} s {how}: check the link to the autopilot"
        return Check("battery age", Verdict.FAIL, age_s, limit_s, "s", age_s, advice)

    def _fraction_row(self, t_ns: int, required: Optional[float]) -> Check:
        name, age_s = "battery fraction", self._age_s(t_ns)
        needed = finite(required)
        if needed is None or not 0.0 <= needed <= 1.0:
            advice = "what the mission needs is unknown: give it battery_needed_fraction"
            return Check(name, Verdict.UNKNOWN, self._fraction, None, "fraction", age_s, advice)
        limit = max(needed, self.spec.minimum_fraction)
        if self._fraction is None:
            advice = "the level is unknown: check the power module and its calibration"
            return Check(name, Verdict.UNKNOWN, None, limit, "fraction", age_s, advice, heals=age_s is None)
        if self._fraction >= limit:
            return Check(name, Verdict.PASS, self._fraction, limit, "fraction", age_s)
        why = "the mission needs" if limit == needed else "no mission starts below"
        advice = f"{self._fraction:.0%} is left, {why} {limit:.0%}: change or charge the battery"
        return Check(name, Verdict.FAIL, self._fraction, limit, "fraction", age_s, advice)

    def _voltage_row(self, t_ns: int) -> Check:
        name, spec, age_s = CELL_VOLTAGE, self.spec, self._age_s(t_ns)
        low, high = spec.cell_voltage_min_v, spec.cell_voltage_max_v
        if self._voltage_v is None:
            advice = "the voltage is unknown: check the power module"
            return Check(name, Verdict.UNKNOWN, None, low, "V", age_s, advice, heals=age_s is None, other_limit=high)
        cell_v = self._voltage_v / spec.cells
        if cell_v > high:
            advice = f"{cell_v:.2f} V per cell cannot be: is it {spec.cells} cells, and is the power module calibrated?"
            return Check(name, Verdict.FAIL, cell_v, high, "V", age_s, advice, other_limit=low)
        if cell_v < low:
            advice = f"{cell_v:.2f} V per cell of {spec.cells}, limit {low:.2f} V: change or charge the battery"
            return Check(name, Verdict.FAIL, cell_v, low, "V", age_s, advice, other_limit=high)
        return Check(name, Verdict.PASS, cell_v, low, "V", age_s, other_limit=high)
