"""From messages to what the vehicle is known to be: its battery, whether it is armed or landed, its height."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, Mapping, Optional, Tuple

from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.monitoring.battery import BatteryMonitor

from .feed import LastCounts
from .fields import Getter, getter, number
from .topic_map import Reading

__all__ = ["BatteryFeed", "Fact", "FactFeed"]

_S = 1_000_000_000


@dataclass(frozen=True)
class Fact:
    """The last thing that the recording said about one property of the vehicle."""

    t_ns: int
    value: Any


class BatteryFeed(LastCounts):
    """The battery: for its check, and for what the vehicle says."""

    def __init__(self, monitor: BatteryMonitor, reading: Reading, facts: Dict[str, Fact]) -> None:
        super().__init__(reading.topic, _S // 2, paths=tuple(reading.fields.values()))
        self._monitor, self._facts, self._scale = monitor, facts, reading.scale
        self._get: Mapping[str, Getter] = {name: getter(path) for name, path in reading.fields.items()}

    def take(self, t_ns: int, message: Any) -> None:
        """Take a level."""
        self.take_values(t_ns, tuple(get(message) for get in self._get.values()))

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take fraction and voltage, as far as there are any."""
        self._take(t_ns, dict(zip(self._get, map(number, values))))

    def _take(self, t_ns: int, values: Mapping[str, Optional[float]]) -> None:
        fraction = values.get("fraction")
        fraction = None if fraction is None else fraction * self._scale
        self._monitor.add(t_ns, fraction, values.get("voltage"))
        self._facts["battery_fraction"] = Fact(t_ns, fraction)
        if "voltage" in values:
            self._facts["battery_voltage_v"] = Fact(t_ns, values["voltage"])

    def play(self, t_ns: int) -> None:
        """Take a charged battery."""
        spec = self._monitor.spec
        self._monitor.add(t_ns, 0.95, 0.5 * (spec.cell_voltage_min_v + spec.cell_voltage_max_v) * (spec.cells or 4))


class FactFeed(LastCounts):
    """A property of the vehicle: armed, landed or height."""

    def __init__(self, name: str, reading: Reading, facts: Dict[str, Fact]) -> None:
        super().__init__(reading.topic, 0, paths=(reading.fields[name],))
        self._name, self._facts = name, facts
        self._get = getter(reading.fields[name])
        self._read = _READ[name](reading)

    def take(self, t_ns: int, message: Any) -> None:
        """Keep it."""
        self.take_values(t_ns, (self._get(message),))

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Keep it."""
        self._facts[_FACTS[self._name]] = Fact(t_ns, self._read(values[0]))


def _height(reading: Reading) -> Callable[[Any], Optional[float]]:
    def read(value: Any) -> Optional[float]:
        metres = number(value)
        return None if metres is None else metres * reading.scale + reading.offset

    return read


def _landed(reading: Reading) -> Callable[[Any], VehicleLanded]:
    return lambda value: VehicleLanded.ON_GROUND if _word(value) in reading.on_ground else VehicleLanded.IN_AIR


def _armed(_: Reading) -> Callable[[Any], bool]:
    return bool


def _word(value: Any) -> str:
    return str(value.item() if hasattr(value, "item") else value)


_READ: Mapping[str, Callable[[Reading], Callable[[Any], Any]]] = {"height": _height, "landed": _landed, "armed": _armed}
_FACTS: Mapping[str, str] = {"height": "height_m", "landed": "landed", "armed": "armed"}
