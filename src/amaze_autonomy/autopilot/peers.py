"""Who is who on a link: our vehicle, other vehicles, and others that use our own address. Pure."""

from __future__ import annotations

from typing import Any, List, Optional, Tuple

from .dialect import Message, mavlink, source_of
from .sources import Sources

__all__ = ["Identity", "Peers"]

_KEPT = 16
_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1


class Identity:
    """Own address, and whom it listens to.

    Args:
        system: own system id; that of the vehicle, by convention.
        component: own component id, another for each node.
        vehicle: system id of the vehicle; 0: of the first autopilot that is heard.
    """

    def __init__(self, system: int, component: int, vehicle: int = 1) -> None:
        self.system, self.component, self.vehicle = system, component, vehicle


class Peers:
    """Tells the messages of our vehicle, to us, from all others.

    Args:
        identity: own address.
    """

    def __init__(self, identity: Identity) -> None:
        self._identity = identity
        self.vehicle: Optional[int] = identity.vehicle or None
        self.heartbeat_ns: Optional[int] = None
        self.others: List[int] = []
        self.doubles = 0
        self.sources = Sources()

    def take(self, t_ns: int, message: Message, place: Any = None) -> bool:
        """Return whether a message is from our vehicle's autopilot, and for us.

        Args:
            t_ns: now.
            message: that came.
            place: address that it came from; None: there is only one.
        """
        source, is_heartbeat = source_of(message), message.get_type() == "HEARTBEAT"
        if source == (self._identity.system, self._identity.component):
            self.doubles += 1
            return False
        if source[1] != _AUTOPILOT or (is_heartbeat and not _is_vehicle(message)):
            return False
        if is_heartbeat and self.vehicle is None:
            self.vehicle = source[0]
        if source[0] != self.vehicle:
            if is_heartbeat:
                self._note(source[0])
            return False
        boot_ms = getattr(message, "time_boot_ms", None)
        if not self.sources.take(t_ns, place, message.get_seq(), boot_ms):
            return False
        if is_heartbeat:
            self.heartbeat_ns = t_ns
            self.sources.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        return self._for_us(message)

    def pass_over(self, t_ns: int, source: Tuple[int, int], sequence: int, place: Any) -> None:
        """Note that a message came that nobody wants: its number belongs to the run of its sender."""
        if source == (self.vehicle, _AUTOPILOT) and self.heartbeat_ns is not None:
            self.sources.take(t_ns, place, sequence)

    def age_ns(self, t_ns: int) -> Optional[int]:
        """Return the time since the last heartbeat of the vehicle; None: never."""
        return None if self.heartbeat_ns is None else t_ns - self.heartbeat_ns

    @property
    def address(self) -> Tuple[int, int]:
        """System and component to address the vehicle by; system 0, all, while it is not known."""
        return self.vehicle or 0, _AUTOPILOT

    def _note(self, system: int) -> None:
        if system not in self.others and len(self.others) < _KEPT:
            self.others.append(system)

    def _for_us(self, message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self._identity.system) and component in (0, self._identity.component)


def _is_vehicle(heartbeat: Message) -> bool:
    """Tell an autopilot from ground stations, gimbals and companions."""
    return bool(heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID and heartbeat.type != mavlink.MAV_TYPE_GCS)
