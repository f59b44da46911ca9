"""What can go wrong around the simulated PX4.

SimulationError (of `amaze_autonomy.simulation`)
└── VehicleAddressError
"""

from __future__ import annotations

from amaze_autonomy.simulation.errors import SimulationError

__all__ = ["VehicleAddressError"]


class VehicleAddressError(SimulationError):
    """An address at which the simulated vehicle cannot be reached.

    Args:
        address: as it was given.
        problem: what is wrong with it.
    """

    def __init__(self, address: str, problem: str) -> None:
        super().__init__(f"{address}: {problem}")
        self.address, self.problem = address, problem
