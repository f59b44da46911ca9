"""The simulated vehicle as an ArduCopter: what ArduPilot does in another way than PX4, on the same craft and links.

Sources: https://ardupilot.org/dev/docs/mavlink-commands.html, https://mavlink.io/en/services/mission.html, and what
ArduPilot 4.5.6 was seen to do in its own simulation.
"""

from __future__ import annotations

from typing import Mapping, Tuple, Type

from ..px4 import Craft, Px4
from .ardupilot import ArduPilot
from .craft import ArduCraft

__all__ = ["AUTOPILOTS", "ArduCraft", "ArduPilot"]

AUTOPILOTS: Mapping[str, Tuple[Type[Craft], Type[Px4]]] = {"px4": (Craft, Px4), "ardupilot": (ArduCraft, ArduPilot)}
"""The autopilots that can be simulated as MAVLink peers, by name: the classes of the craft and of what flies it."""
