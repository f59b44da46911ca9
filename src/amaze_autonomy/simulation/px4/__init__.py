"""The simulated vehicle as a MAVLink peer: PX4 v1.16 as it was recorded, on the vehicle and battery of the world.

Pure: pymavlink's dialect, but no socket, clock or thread; `simulation/px4_udp.py` puts it on UDP.
"""

from __future__ import annotations

from ..errors import VehicleAddressError
from .craft import Craft, SetPoint
from .px4 import Px4
from .settings import Geography, Place, Px4Settings
from .wire import DESCEND, OFFBOARD, Framing

__all__ = [
    "DESCEND",
    "OFFBOARD",
    "Craft",
    "Framing",
    "Geography",
    "Place",
    "Px4",
    "Px4Settings",
    "SetPoint",
    "VehicleAddressError",
]
