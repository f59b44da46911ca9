"""The simulated PX4 in the process of a test, in real time: the test may be its pilot and its faults."""

from __future__ import annotations

import threading
import time
from typing import Any, Callable, List, Tuple, Type

from amaze_autonomy.missions import FlightModel
from amaze_autonomy.simulation.power import Power, PowerSettings
from amaze_autonomy.simulation.px4 import Craft, Px4, Px4Settings
from amaze_autonomy.simulation.px4_udp import VehicleServer
from amaze_autonomy.simulation.vehicle import VehicleSettings

__all__ = ["MISSIONS", "QUICK", "Px4Vehicle"]

QUICK = FlightModel(
    cruise_speed_m_s=5.0,
    climb_speed_m_s=4.0,
    descent_speed_m_s=4.0,
    landing_speed_m_s=2.0,
    acceleration_m_s2=10.0,
    turn_rate_rad_s=8.0,
)
MISSIONS = f"""\
flight:
  cruise_speed_m_s: {QUICK.cruise_speed_m_s}
  climb_speed_m_s: {QUICK.climb_speed_m_s}
  descent_speed_m_s: {QUICK.descent_speed_m_s}
  landing_speed_m_s: {QUICK.landing_speed_m_s}
  acceleration_m_s2: {QUICK.acceleration_m_s2}
  turn_rate_rad_s: {QUICK.turn_rate_rad_s}
missions:
  "hop":
    description: Up, around, down
    files: [trajectories/hop.csv]
  "indoors":
    description: The same without GPS
    files: [trajectories/hop.csv]
    controller: offboard
  "twice":
    description: Up, around, down, and once more
    files: [trajectories/hop.csv]
    repetitions: 2
"""


class Px4Vehicle:
    """A vehicle on UDP; each address is one endpoint.

    Args:
        addresses: e.g. udpout:127.0.0.1:14541.
        kind: classes of craft and autopilot.
    """

    def __init__(self, *addresses: str, kind: Tuple[Type[Craft], Type[Px4]] = (Craft, Px4)) -> None:
        self.lock = threading.Lock()
        make_craft, make_autopilot = kind
        self.craft = make_craft(VehicleSettings(model=QUICK), time.monotonic_ns())
        px4 = make_autopilot(
            self.craft, Power(PowerSettings()), time.monotonic_ns(), Px4Settings(), unix_ns=time.time_ns()
        )
        self._server = VehicleServer(px4, addresses, self)
        self._server.start()

    def exchange(self, act: Callable[[int], List[Tuple[str, Any]]]) -> List[Tuple[str, Any]]:
        """Let time pass until now, and act."""
        with self.lock:
            now_ns = time.monotonic_ns()
            self.craft.advance(now_ns)
            return act(now_ns)

    def stop(self) -> None:
        """End it."""
        self._server.stop()
