"""The simulated vehicle as an ArduCopter: what ArduPilot does in another way than PX4, on the same craft and links.

Sources: https://ardupilot.org/dev/docs/mavlink-commands.html, https://mavlink.io/en/services/mission.html, and what
ArduPilot 4.5.6 was seen to do in its own simulation.
"""

from __future__ import annotations

from .ardupilot import ArduPilot
from .craft import ArduCraft

__all__ = ["ArduCraft", "ArduPilot"]
