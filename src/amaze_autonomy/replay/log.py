"""What people asked of the engine in the recorded flight, out of the journal in its bag: what no sensor can tell.

The journal's times are those of the clock that decided; the bag's are those of its recorder. A line reaches the
recorder a little after its event, and the lines from before the recording much later, so that the shortest of all ways
is the difference of the two clocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

from amaze_autonomy.bags import Recording
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import EngineStarted, Event, MissionRejected, MissionSelected, Shutdown, UserRequest
from amaze_autonomy.engine.journal import decode
from amaze_autonomy.engine.state import evolve

from .journal_source import lines_of_bag

__all__ = ["FlightLog", "read_log"]

_ASKED = (MissionSelected, MissionRejected, UserRequest, Shutdown)


@dataclass(frozen=True)
class FlightLog:
    """What was asked.

    Args:
        label: of the recorded engine's sessions.
        events: in the bag's time, in order.
        decisions: that were made in flight, in the bag's time, in order.
        end_ns: time of the last event, whatever it is, in the bag's time.
    """

    label: str
    events: Tuple[Event, ...]
    decisions: Tuple[Decision, ...] = ()
    end_ns: int = 0


def read_log(recordings: Tuple[Recording, ...], topic: str) -> Optional[FlightLog]:
    """Return what was asked in a flight; None when the journal is not in its bags.

    Raises:
        JournalError: A line is damaged.
        MessageError: A message is damaged.
    """
    label = ""
    found: Dict[int, Event] = {}
    decided: Dict[int, Decision] = {}
    ways: List[int] = []
    last_ns = 0
    for recording in recordings:
        for t_ns, sequence, line in lines_of_bag(recording, topic):
            event = decode(line, sequence + 1).payload
            if isinstance(event, Decision):
                decided[sequence] = event
            if not isinstance(event, Event):
                continue
            ways.append(t_ns - event.t_ns)
            last_ns = max(last_ns, event.t_ns)
            if isinstance(event, EngineStarted) and not label:
                label = event.label
            elif isinstance(event, _ASKED):
                found[sequence] = event
    if not ways:
        return None
    offset_ns = min(ways)
    asked = tuple(evolve(found[key], t_ns=max(0, found[key].t_ns + offset_ns)) for key in sorted(found))
    made = tuple(evolve(decided[key], t_ns=max(0, decided[key].t_ns + offset_ns)) for key in sorted(decided))
    return FlightLog(label, asked, made, last_ns + offset_ns)
