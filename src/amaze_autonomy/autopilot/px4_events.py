"""PX4's EVENTs that say why it does not arm, in words: they come on every link, unlike its texts.

An event has no words, but the hash of its name: 24 bits of FNV-1a, below the id of its component. The words are those
of PX4's own texts, so that what comes both ways is said once. https://mavlink.io/en/services/events.html
"""

from __future__ import annotations

from typing import Any, Mapping, NamedTuple, Optional

__all__ = ["Event", "event_id", "event_of"]

_ID_BITS = 0xFFFFFF
_OURS = 1 << 3 | 1 << 4  # navigation states AUTO.MISSION and AUTO.LOITER, in which we arm
_CHECK = "check_"

_WORDS: Mapping[str, str] = {
    "commander_arm_denied_resolve_failures": "Arming denied: Resolve system health failures first",
    "commander_arm_denied_throttle_high": "Arming denied: throttle above center",
    "commander_arm_denied_not_manual": "Arming denied: switch to manual mode first",
    "check_estimator_gps_fix_too_low": "Preflight: GPS fix too low",
    "check_modes_local_pos": "Preflight: no valid local position estimate",
    "check_modes_global_pos": "Preflight: no valid global position estimate",
}


class Event(NamedTuple):
    """How severe (0 emergency to 7 debug), and what."""

    severity: int
    words: str


def event_id(name: str) -> int:
    """Return the id of an event of this name, without its component."""
    value = 0x811C9DC5
    for byte in name.encode("ascii"):
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return value & _ID_BITS


_BY_ID = {event_id(name): name for name in _WORDS}


def event_of(message: Any) -> Optional[Event]:
    """Return what an EVENT says; None: nothing about arming in the modes that we arm in."""
    name = _BY_ID.get(message.id & _ID_BITS)
    if name is None:
        return None
    modes = int.from_bytes(bytes(message.arguments[:4]), "little")
    if name.startswith(_CHECK) and not modes & _OURS:
        return None
    return Event(message.log_levels & 0xF, _WORDS[name])
