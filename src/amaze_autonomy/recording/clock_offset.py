"""The offset between two computers' clocks, as NTP takes it (RFC 5905, section 8).

The collector sends at t1 (its clock), the platform receives at t2 and answers at t3 (the platform's clock), the answer
arrives at t4. The offset is exact where both ways take the same time, and wrong by at most half the round trip; so of
several exchanges the one with the shortest round trip counts.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Dict, Optional, Sequence

__all__ = ["Exchange", "Offset", "best", "correction_ns"]


@dataclass(frozen=True)
class Exchange:
    """The four times of one exchange, in nanoseconds since 1970 on the clock of whoever took them."""

    sent_ns: int
    received_ns: int
    answered_ns: int
    arrived_ns: int

    @property
    def round_trip_ns(self) -> int:
        """Return the time on the way, both ways together."""
        return (self.arrived_ns - self.sent_ns) - (self.answered_ns - self.received_ns)

    @property
    def offset_ns(self) -> int:
        """Return the platform's clock minus the collector's."""
        return ((self.received_ns - self.sent_ns) + (self.answered_ns - self.arrived_ns)) // 2


@dataclass(frozen=True)
class Offset:
    """A measured offset.

    Args:
        offset_ns: the platform's clock minus the collector's.
        error_ns: by which it may be wrong.
        at_ns: when it was measured, on the collector's clock.
    """

    offset_ns: int
    error_ns: int
    at_ns: int

    def as_json(self) -> Dict[str, int]:
        """Return it as plain values."""
        return asdict(self)


def best(exchanges: Sequence[Exchange]) -> Optional[Offset]:
    """Return the offset by the exchange with the shortest round trip; None when there is no possible one."""
    possible = [each for each in exchanges if each.round_trip_ns >= 0 and each.answered_ns >= each.received_ns]
    if not possible:
        return None
    chosen = min(possible, key=lambda each: (each.round_trip_ns, each.sent_ns))
    return Offset(chosen.offset_ns, (chosen.round_trip_ns + 1) // 2, chosen.arrived_ns)


def correction_ns(start: Optional[Offset], stop: Optional[Offset]) -> int:
    """Return what is to be added to a platform's record times: minus the offset, the mean where it was taken twice."""
    known = [each.offset_ns for each in (start, stop) if each is not None]
    return -(sum(known) // len(known)) if known else 0
