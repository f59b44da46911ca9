"""The simulated PX4 on UDP sockets, with the computer's clock: a server, a command, and a relay that loses packets."""

from __future__ import annotations

from .relay import BadRelay
from .server import VehicleServer, VehicleTime

__all__ = ["BadRelay", "VehicleServer", "VehicleTime"]
