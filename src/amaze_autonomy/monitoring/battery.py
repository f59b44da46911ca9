"""Is the battery enough for the next mission? What it does not know stays unknown, and unknown is not enough."""

from __future__ import annotations

from typing import List, NamedTuple, Optional, Sequence, Tuple

from ..engine.events import Check, Verdict, finite
from .specs import BatterySpec

CELL_VOLTAGE = "battery cell voltage"  # name of a row

_S = 1_000_000_000


class PackVolts(NamedTuple):
    """The volts of one pack.

    Args:
        voltage_v: of the whole pack; None: unknown.
        cells_v: of each cell, where they are told one by one.
        name: that the row says; empty: it is the only one.
    """

    voltage_v: Optional[float]
    cells_v: Tuple[float, ...] = ()
    name: str = ""


class _CellVolts(NamedTuple):
    """The volts of a cell: a mean one, or one that was told, in the words of the row."""

    voltage_v: float
    where: str
    pack: str


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
        self._packs: Sequence[PackVolts] = ()

    def add(
        self,
        t_ns: int,
        fraction: Optional[float],
        voltage_v: Optional[float] = None,
        packs: Optional[Sequence[PackVolts]] = None,
    ) -> None:
        """Add a level. A fraction outside 0..1 (-1, -0.53), a voltage not above 0, and NaN are unknown.

        Args:
            t_ns: when it was told.
            fraction: that is left; of several packs that of the worst.
            voltage_v: of that pack.
            packs: the volts of each, whatever its level; None: there is one.
        """
        known = finite(fraction)
        self._t_ns = t_ns
        self._fraction = known if known is not None and 0.0 <= known <= 1.0 else None
        self._voltage_v = _volts(voltage_v)
        self._packs = (PackVolts(voltage_v),) if packs is None else packs

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
        cells = sorted(cell for pack in self._packs for cell in _cells(pack, spec.cells))
        if cells and cells[-1].voltage_v > high:
            cell_v, where, pack = cells[-1]
            doubt = f"is it {spec.cells} cells, and is the power module calibrated?"
            advice = f"{pack}{cell_v:.2f} V {where} cannot be: {doubt}"
            return Check(name, Verdict.FAIL, cell_v, high, "V", age_s, advice, other_limit=low)
        if cells and cells[0].voltage_v < low:
            cell_v, where, pack = cells[0]
            advice = f"{pack}{cell_v:.2f} V {where} of {spec.cells}, limit {low:.2f} V: change or charge the battery"
            return Check(name, Verdict.FAIL, cell_v, low, "V", age_s, advice, other_limit=high)
        unknown = [_named(pack) for pack in self._packs if _volts(pack.voltage_v) is None]
        if unknown or not cells:
            advice = f"{''.join(unknown[:1])}the voltage is unknown: check the power module"
            return Check(name, Verdict.UNKNOWN, None, low, "V", age_s, advice, heals=age_s is None, other_limit=high)
        return Check(name, Verdict.PASS, cells[0].voltage_v, low, "V", age_s, other_limit=high)


def _volts(value: Optional[float]) -> Optional[float]:
    known = finite(value)
    return known if known is not None and known > 0 else None


def _cells(pack: PackVolts, count: int) -> List[_CellVolts]:
    """Return the mean cell of a pack, which shows a wrong number of cells, and each that was told."""
    volts, named = _volts(pack.voltage_v), _named(pack)
    told = [_CellVolts(cell_v, "in one cell", named) for cell_v in pack.cells_v if finite(cell_v) is not None]
    return told if volts is None else [_CellVolts(volts / count, "per cell", named), *told]


def _named(pack: PackVolts) -> str:
    return f"{pack.name}: " if pack.name else ""
