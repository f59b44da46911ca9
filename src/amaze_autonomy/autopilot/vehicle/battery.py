"""The battery from SYS_STATUS and BATTERY_STATUS: unknown stays unknown, and the autopilot's judgement caps the level.

ArduPilot counts its fraction from the current alone; that the voltage is low is in `charge_state` only. So a state of
LOW or worse caps the fraction. PX4 writes the voltage of the whole pack into the first cell when it knows no cells.

Of several packs the worst level counts, the age of the oldest, and the volts of each, whatever its level. A pack that
was heard once and is silent keeps what it said, which so grows old: its level is unknown, and a critical state stays
critical. It is forgotten when it was unplugged: silent while the vehicle is disarmed. One that fell silent in flight
has failed, and is kept until the autopilot restarts. A monitor of volts alone, of a rail of the avionics say, is no
pack while another one tells its level: it has never told a level, a current, or a state that is bad.
"""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Set, Tuple

from amaze_autonomy.monitoring.battery import PackVolts

from ..link.dialect import mavlink

_UNKNOWN_MV = 65535
_PACK_MV = 6000  # no single cell has so much
_FRESH_NS = 5_000_000_000
_TURN_NS = 1_000_000_000  # for each pack: an ArduPilot tells of one after the other, one a message
_UNPLUGGED_NS = 30_000_000_000
_MOST_BATTERIES = 16  # an ArduPilot has 9 monitors, or more

OK, CHARGING = mavlink.MAV_BATTERY_CHARGE_STATE_OK, mavlink.MAV_BATTERY_CHARGE_STATE_CHARGING
LOW = mavlink.MAV_BATTERY_CHARGE_STATE_LOW
CRITICAL = mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL
EMERGENCY = mavlink.MAV_BATTERY_CHARGE_STATE_EMERGENCY
FAILED = mavlink.MAV_BATTERY_CHARGE_STATE_FAILED
UNHEALTHY = mavlink.MAV_BATTERY_CHARGE_STATE_UNHEALTHY
_CRITICAL_STATES = frozenset((CRITICAL, EMERGENCY, FAILED, UNHEALTHY))
STATE_NAMES: Mapping[int, str] = {
    0: "undefined",
    OK: "ok",
    LOW: "low",
    CRITICAL: "critical",
    EMERGENCY: "emergency",
    FAILED: "failed",
    UNHEALTHY: "unhealthy",
    CHARGING: "charging",
}


class BatteryReading(NamedTuple):
    """What is known of the battery; None is unknown.

    Args:
        t_ns: when it said so; of several packs: when the one said so that was not heard for longest.
        fraction: that is left, 0..1, capped by the charge state.
        voltage_v: of the pack.
        cell_voltage_v: of the lowest cell, of several packs that of all.
        current_a: drawn.
        charge_state: MAV_BATTERY_CHARGE_STATE, 0 undefined.
        cells_v: voltage of each cell of the pack, where they are told one by one.
    """

    t_ns: int
    fraction: Optional[float]
    voltage_v: Optional[float]
    cell_voltage_v: Optional[float] = None
    current_a: Optional[float] = None
    charge_state: int = 0
    cells_v: Tuple[float, ...] = ()


class Battery:
    """The battery, or the worst of several.

    Args:
        caps: greatest fraction that is believed in a charge state.
        cells: in series, for the voltage per cell; 0: unknown.
    """

    def __init__(self, caps: Mapping[int, float], cells: int = 0) -> None:
        self._caps, self._cells = caps, cells
        self._system: Optional[BatteryReading] = None
        self._packs: Dict[int, BatteryReading] = {}
        self._lost: Set[int] = set()  # fell silent in flight
        self._judged: Set[int] = set()  # have told a level, a current or a bad state
        self._disarmed = False

    def watch(self, t_ns: int, *, armed: bool, disarmed: bool) -> None:
        """Take whether the vehicle is armed, or surely disarmed: only then may a pack have been unplugged.

        Args:
            t_ns: now.
            armed: what falls silent has failed.
            disarmed: what is silent is forgotten after a while.
        """
        self._disarmed = disarmed
        if armed:
            self._lost.update(self.silent(t_ns))
        if disarmed:
            for number in self.silent(t_ns):
                if number not in self._lost and t_ns - self._packs[number].t_ns > _UNPLUGGED_NS:
                    del self._packs[number]

    def restarted(self) -> None:
        """Take that the autopilot was without power: what failed before may have been repaired or unplugged."""
        self._lost.clear()

    def add_system(self, t_ns: int, message: Any) -> None:
        """Take a SYS_STATUS."""
        volts = None if message.voltage_battery in (0, _UNKNOWN_MV) else message.voltage_battery / 1000
        current = None if message.current_battery < 0 else message.current_battery / 100
        fraction = _fraction(message.battery_remaining)
        self._system = BatteryReading(t_ns, fraction, volts, self._per_cell(volts), current)

    def add_pack(self, t_ns: int, message: Any) -> None:
        """Take a BATTERY_STATUS."""
        if message.id not in self._packs and len(self._packs) >= _MOST_BATTERIES:
            return
        volts, cells = self._voltages([*message.voltages, *(mv or _UNKNOWN_MV for mv in message.voltages_ext)])
        lowest = min(cells) if cells else self._per_cell(volts)
        state = self._charge_state(message)
        fraction = _fraction(message.battery_remaining)
        cap = self._caps.get(state)
        if fraction is not None and cap is not None:
            fraction = min(fraction, cap)
        current = None if message.current_battery < 0 else message.current_battery / 100
        self._packs[message.id] = BatteryReading(t_ns, fraction, volts, lowest, current, state, cells)
        self._lost.discard(message.id)
        if fraction is not None or current is not None or LOW <= state < CHARGING:
            self._judged.add(message.id)

    def reading(self) -> Optional[BatteryReading]:
        """Return the worst pack, as old as the oldest, else what SYS_STATUS said; None: nothing was ever said."""
        packs = list(self._that_count().values())
        if not packs:
            return self._system
        known = [pack.cell_voltage_v for pack in packs if pack.cell_voltage_v is not None]
        oldest_ns, lowest = min(pack.t_ns for pack in packs), min(known, default=None)
        worst = min(packs, key=_badness)._replace(t_ns=oldest_ns, cell_voltage_v=lowest)
        return worst if worst.voltage_v is not None or self._system is None else _with_voltage(worst, self._system)

    def volts(self) -> Tuple[PackVolts, ...]:
        """Return the volts of each pack that counts; of several SYS_STATUS does not say which it is of."""
        packs = self._that_count()
        if len(packs) > 1:
            return tuple(PackVolts(pack.voltage_v, pack.cells_v, f"battery {each}") for each, pack in packs.items())
        only = self.reading()
        return () if only is None else (PackVolts(only.voltage_v, only.cells_v),)

    @property
    def critical(self) -> bool:
        """Whether the last word of the autopilot on any pack is critical or worse, whatever its level."""
        return any(pack.charge_state in _CRITICAL_STATES for pack in self._packs.values())

    def silent(self, t_ns: int) -> Tuple[int, ...]:
        """Return the numbers of the packs that were heard once and are silent."""
        fresh_ns = max(_FRESH_NS, _TURN_NS * len(self._packs))
        return tuple(number for number in sorted(self._packs) if t_ns - self._packs[number].t_ns > fresh_ns)

    def _that_count(self) -> Dict[int, BatteryReading]:
        """Return the packs by their numbers, without monitors of volts alone while a pack tells its level."""
        judged = {number: self._packs[number] for number in sorted(self._judged & set(self._packs))}
        told = any(pack.fraction is not None for pack in judged.values())
        return judged if told else {number: self._packs[number] for number in sorted(self._packs)}

    def _charge_state(self, message: Any) -> int:
        """Return the charge state of a pack; where none is told any more, in flight, what was bad stays so."""
        state, before = int(message.charge_state), self._packs.get(message.id)
        told = OK <= state <= CHARGING
        if told or self._disarmed or before is None or not LOW <= before.charge_state < CHARGING:
            return state
        return before.charge_state

    def _voltages(self, told_mv: List[int]) -> Tuple[Optional[float], Tuple[float, ...]]:
        """Return the voltage of the pack and of its cells; the latter only when they are told one by one.

        A cell of 0 V is dead; beyond the number of cells there is none.
        """
        known = [mv for place, mv in enumerate(told_mv) if mv != _UNKNOWN_MV and (mv or place < self._cells)]
        if not sum(known):
            return None, ()
        if len(known) == 1 or known[0] > _PACK_MV:
            return sum(known) / 1000, ()
        return sum(known) / 1000, tuple(mv / 1000 for mv in known)

    def _per_cell(self, volts: Optional[float]) -> Optional[float]:
        return volts / self._cells if volts is not None and self._cells else None


def _badness(reading: BatteryReading) -> Tuple[bool, float, int]:
    """Order readings: an unknown level first, then the lowest."""
    return reading.fraction is not None, reading.fraction or 0.0, -reading.charge_state


def _with_voltage(reading: BatteryReading, system: BatteryReading) -> BatteryReading:
    lowest = system.cell_voltage_v if reading.cell_voltage_v is None else reading.cell_voltage_v
    return reading._replace(voltage_v=system.voltage_v, cell_voltage_v=lowest)


def _fraction(percent: int) -> Optional[float]:
    """Return a fraction; -1, and what is no percentage, is unknown."""
    return percent / 100 if 0 <= percent <= 100 else None  # noqa: PLR2004 - per cent
