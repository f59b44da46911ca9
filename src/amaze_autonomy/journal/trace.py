"""A run as expectations and pages see it: decisions, states and codes over time, read from its journal alone.

So a simulation, a replayed bag and a journal from disk are judged by the same code.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Dict, Iterable, List, Mapping, NamedTuple, Optional, Tuple, Union

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import AutopilotStatus, ComponentStatus, Event, WatchdogAction, WatchdogInfo
from amaze_autonomy.engine.state import State

from ..engine.rules import Code
from .journal import decode

READINGS = (
    *("height_m", "battery_fraction", "position_x_m", "position_y_m", "distance_m", "vertical_speed_m_s"),
    "tilt_deg",
)
"""Fields of the autopilot's status whose crossing of a level can be an anchor."""


class Span(NamedTuple):
    """Something that was so for a time, in [begin, end); a state may be left at the moment when it is entered."""

    begin_ns: int
    end_ns: int
    value: str


@dataclass(frozen=True)
class Trace:
    """A run.

    Args:
        start_ns: zero of all times that a scenario says.
        end_ns: of the run.
        decisions: in order.
        states: "STATE/step" over time.
        codes: of each component over time, as text.
        readings: (time, value) of each of READINGS.
        faults: when each began, in the order of the scenario; None: it never did.
        begin_ns: of the run, where it begins later than its zero: it is a part of a recording.
        blind: losses, and the state PILOT, that nothing in the run can show, by name, and why.
    """

    start_ns: int
    end_ns: int
    decisions: Tuple[Decision, ...] = ()
    states: Tuple[Span, ...] = ()
    codes: Mapping[str, Tuple[Span, ...]] = field(default_factory=dict)
    readings: Mapping[str, Tuple[Tuple[int, float], ...]] = field(default_factory=dict)
    faults: Tuple[Optional[int], ...] = ()
    begin_ns: int = 0
    blind: Mapping[str, str] = field(default_factory=dict)

    def seconds(self, t_ns: int) -> float:
        """Return a time as seconds from the start."""
        return (t_ns - self.start_ns) / 1e9


class _Changes:
    """Values over time, from their changes."""

    def __init__(self) -> None:
        self._spans: List[Span] = []
        self._now: Optional[Tuple[int, str]] = None

    def put(self, t_ns: int, value: str) -> None:
        if self._now is not None and self._now[1] == value:
            return
        self.end(t_ns)
        self._now = (t_ns, value)

    def end(self, t_ns: int) -> Tuple[Span, ...]:
        if self._now is not None and t_ns >= self._now[0]:
            self._spans.append(Span(self._now[0], t_ns, self._now[1]))
        return tuple(self._spans)


def trace_of(
    lines: Iterable[Union[str, object]],
    start_ns: Optional[int] = None,
    end_ns: Optional[int] = None,
    faults: Tuple[Optional[int], ...] = (),
) -> Trace:
    """Read a run from the lines of its journal.

    Args:
        lines: with or without its header; or what they hold, where somebody has decoded them already.
        start_ns: zero of the scenario's times; None: the first event.
        end_ns: of the run; None: the last event.
        faults: when each fault of the scenario began.

    Raises:
        JournalError: a line is damaged.
    """
    reading = _Reading()
    for number, line in enumerate(lines, 1):
        reading.take(decode(line, number).payload if isinstance(line, str) else line)
    return reading.trace(start_ns, end_ns, faults)


class _Reading:
    """A trace in the making."""

    def __init__(self) -> None:
        self._first_ns: Optional[int] = None
        self._last_ns = 0
        self._decisions: List[Decision] = []
        self._states = _Changes()
        self._codes: Dict[str, _Changes] = {}
        self._values: Dict[str, List[Tuple[int, float]]] = {name: [] for name in READINGS}

    def take(self, payload: object) -> None:
        if isinstance(payload, Decision):
            self._decisions.append(payload)
            self._states.put(payload.t_ns, f"{payload.after}/{payload.step}")
        elif isinstance(payload, Event):
            self._take_event(payload)

    def _take_event(self, event: Event) -> None:
        if self._first_ns is None:
            self._first_ns = event.t_ns
            self._states.put(event.t_ns, f"{State.MISSION_INPUT.value}/")
        self._last_ns = max(self._last_ns, event.t_ns)
        if isinstance(event, WatchdogInfo):
            self._note(event.t_ns, event.components, whole=True)
        elif isinstance(event, WatchdogAction):
            self._note(event.t_ns, event.components, whole=False)
        elif isinstance(event, AutopilotStatus):
            for name, values in self._values.items():
                value = getattr(event, name)
                if value is not None:
                    values.append((event.t_ns, value))

    def _note(self, t_ns: int, components: Tuple[ComponentStatus, ...], *, whole: bool) -> None:
        """Note codes; the action stream lists those at INCONVENIENT or above, so that what it leaves out is below."""
        listed = {each.name: int(each.code) for each in components}
        for name, code in listed.items():
            self._codes.setdefault(name, _Changes()).put(t_ns, str(code))
        if whole:
            return
        for name, changes in self._codes.items():
            now = changes._now  # noqa: SLF001
            if name not in listed and now is not None and int(now[1]) >= Code.INCONVENIENT:
                changes.put(t_ns, str(int(Code.NOMINAL)))

    def trace(self, start_ns: Optional[int], end_ns: Optional[int], faults: Tuple[Optional[int], ...]) -> Trace:
        end = self._last_ns if end_ns is None else max(end_ns, self._last_ns)
        first = self._first_ns or 0
        return Trace(
            start_ns=first if start_ns is None else start_ns,
            end_ns=end,
            decisions=tuple(self._decisions),
            states=self._states.end(end + 1),
            codes={name: changes.end(end + 1) for name, changes in sorted(self._codes.items())},
            readings={name: tuple(values) for name, values in self._values.items()},
            faults=faults,
        )
