"""The autopilots that can be simulated as MAVLink peers, by name: the classes of the craft and of what flies it."""

from __future__ import annotations

from typing import Mapping, Tuple, Type

from .ardupilot import ArduCraft, ArduPilot
from .px4 import Craft, Px4

__all__ = ["AUTOPILOTS"]

AUTOPILOTS: Mapping[str, Tuple[Type[Craft], Type[Px4]]] = {"px4": (Craft, Px4), "ardupilot": (ArduCraft, ArduPilot)}
