"""What can go wrong in the simulated world.

    SimulationError          base
    +-- SimulatedTimeError   time went backwards
    +-- UnknownTargetError   a fault names something that this world does not have
    +-- NoEffectError        a fault cannot do anything to what it names

Mistakes in a scenario file are `amaze_autonomy.config.errors.ConfigError`, with file and line.
"""

from __future__ import annotations

from difflib import get_close_matches
from typing import Mapping, Tuple


class SimulationError(Exception):
    """Base of the errors of the simulated world."""


class SimulatedTimeError(SimulationError):
    """Time went backwards.

    Args:
        now_ns: where the world is.
        asked_ns: where it was asked to be.
    """

    def __init__(self, now_ns: int, asked_ns: int) -> None:
        super().__init__(f"the simulated world is at {now_ns} ns and cannot go back to {asked_ns} ns")
        self.now_ns, self.asked_ns = now_ns, asked_ns


class UnknownTargetError(SimulationError):
    """A scenario names something that this world does not have.

    Args:
        what: kind of thing, e.g. "component".
        name: the name that was given.
        known: names that there are.
        where: file and line; empty when it did not come from a file.
    """

    def __init__(self, what: str, name: str, known: Tuple[str, ...], where: str = "") -> None:
        place = f"{where}: " if where else ""
        close = get_close_matches(name, known, 1)
        right = f"did you mean {close[0]}?" if close else f"there is {', '.join(known) or 'none'}"
        super().__init__(f"{place}there is no {what} {name!r}; {right}")
        self.what, self.name, self.known, self.where = what, name, known, where


class NoEffectError(SimulationError):
    """A fault cannot do anything to what it names: it would be a scenario that tests nothing.

    Args:
        fault: what it is, in words.
        why: why it would do nothing.
        where: file and line; empty when it did not come from a file.
    """

    def __init__(self, fault: str, why: str, where: str = "") -> None:
        place = f"{where}: " if where else ""
        super().__init__(f"{place}{fault} would do nothing: {why}")
        self.fault, self.why, self.where = fault, why, where


# --- errors -----------------------------------------------------------------------------------------------------------
# What can go wrong around the simulated PX4.
#
# SimulationError (of `amaze_autonomy.simulation`)
# ├── VehicleAddressError
# └── UnsupportedParameterError


class VehicleAddressError(SimulationError):
    """An address at which the simulated vehicle cannot be reached.

    Args:
        address: as it was given.
        problem: what is wrong with it.
    """

    def __init__(self, address: str, problem: str) -> None:
        super().__init__(f"{address}: {problem}")
        self.address, self.problem = address, problem


class UnsupportedParameterError(SimulationError):
    """A parameter has a value with which the simulated vehicle would do something else than a real one.

    Args:
        name: of the parameter.
        value: that it has.
        known: value that can be simulated -> what it means.
    """

    def __init__(self, name: str, value: float, known: Mapping[int, str]) -> None:
        *others, last = (f"{number} ({meaning})" for number, meaning in sorted(known.items()))
        wanted = f"must be {', '.join(others)} or {last} for the simulated PX4"
        super().__init__(f"{name} {value:g}: {wanted}; override autopilot.parameters.{name} to simulate")
        self.name, self.value = name, value
