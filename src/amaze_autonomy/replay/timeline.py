"""What a replay has to say, line by line: when, from which input, what."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from typing import Callable, Dict, Iterable, List, Optional, Tuple

from amaze_autonomy.engine.commands import Decision, Value
from amaze_autonomy.engine.events import ComponentStatus, Landed

from ..engine.rules import Code

_S = 1_000_000_000


class Source(enum.Flag):
    """Where an input came from."""

    NONE = 0
    BAG = 1  # a sample or a status in the recording
    LOG = 2  # the flight's own journal
    SCRIPT = 4  # the scripted world

    @property
    def words(self) -> str:
        """Its name, or the names of all that took part."""
        return "+".join(str(each.name).lower() for each in (Source.BAG, Source.LOG, Source.SCRIPT) if each in self)


class LineKind(enum.Enum):
    """What a line is about."""

    NOTE = "note"  # about the recording itself
    MONITOR = "monitor"  # a verdict of watchdog, landing detection, state check
    DECISION = "decision"  # of the engine
    MESSAGE = "message"  # of the engine to the user


@dataclass(frozen=True)
class Line:
    """One line.

    Args:
        t_ns: when.
        source: of the input that led to it.
        kind: what it is about.
        text: what happened.
        level: 0 good or neutral, 1 worth a look, 2 bad.
        times: how often it happened in a row.
        until_ns: when it happened for the last time.
        counterfactual: the recorded vehicle had already not done what the engine said.
    """

    t_ns: int
    source: Source
    kind: LineKind
    text: str
    level: int = 0
    times: int = 1
    until_ns: int = 0
    counterfactual: bool = False

    @property
    def scripted(self) -> bool:
        """True when the script had a part in it."""
        return Source.SCRIPT in self.source


def joined(lines: Iterable[Line]) -> List[Line]:
    """Return the lines with equal ones in a row made one."""
    out: List[Line] = []
    for line in lines:
        last = out[-1] if out else None
        if last is not None and (last.kind, last.text, last.source) == (line.kind, line.text, line.source):
            out[-1] = replace(last, times=last.times + 1, until_ns=line.t_ns)
        else:
            out.append(line)
    return out


def marked(lines: Iterable[Line], counterfactual_ns: Optional[int]) -> List[Line]:
    """Return the lines with those after the first command that the recorded vehicle did not get marked."""
    if counterfactual_ns is None:
        return list(lines)
    return [replace(line, counterfactual=line.t_ns > counterfactual_ns) for line in lines]


def decision_text(decision: Decision, start_ns: int = 0) -> str:
    """Return a decision as one line: states, rule, what it looked at, commands; times count from `start_ns`."""
    move = decision.before if decision.before == decision.after else f"{decision.before} -> {decision.after}"
    step = f"/{decision.step}" if decision.step else ""
    values = "; ".join(value_text(value, start_ns) for value in decision.values)
    commands = ", ".join(decision.commands)
    return (
        f"{move}{step}  by {decision.rule}"
        + (f" ({values})" if values else "")
        + (f"  => {commands}" if commands else "")
    )


def value_text(value: Value, start_ns: int = 0) -> str:
    """Return a value with its limit and unit, e.g. "age 0.61 s, limit 0.6 s"; times count from `start_ns`."""
    if value.unit == "ns" and isinstance(value.value, int):
        return f"{value.name} at {(value.value - start_ns) / _S:+.3f} s"
    unit = f" {value.unit}" if value.unit else ""
    text = f"{value.name} {_plain(value.value)}{unit}"
    return text if value.limit is None else f"{text}, limit {_plain(value.limit)}{unit}"


def _plain(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def written(line: Line, start_ns: int) -> Tuple[str, str, str]:
    """Return time, source and text of a line as they are printed; scripted and counterfactual ones begin with "~"."""
    time = f"{'~' if line.counterfactual or line.scripted else ' '}{(line.t_ns - start_ns) / _S:+9.3f}"
    more = "" if line.times == 1 else f"  [{line.times} times until {(line.until_ns - start_ns) / _S:+.3f}]"
    return time, line.source.words, line.text + more


# --- notes ------------------------------------------------------------------------------------------------------------
# What monitors say, as lines of the timeline: each only when it is another than before.


Say = Callable[[int, Source, str, int], None]


class Notes:
    """Remembers what was noted last.

    Args:
        say: writes a line of the timeline: time, source, text, level.
    """

    def __init__(self, say: Say) -> None:
        self._say = say
        self._components: Dict[str, ComponentStatus] = {}
        self._judged: Optional[Landed] = None

    def components(self, components: Tuple[ComponentStatus, ...], t_ns: int, source: Source) -> None:
        """Note each component whose code, or the reason of it, is another than before."""
        for status in components:
            before = self._components.get(status.name)
            code = before.code if before is not None else None
            self._components[status.name] = status
            if code is not status.code or (before is not None and before.reason != status.reason):
                reason = f"  {status.reason}" if status.reason else ""
                move = f"code {status.code}" if code is None or code is status.code else f"code {code} -> {status.code}"
                level = 0 if status.code is Code.NOMINAL else 1 if status.code is Code.NON_CRITICAL else 2
                self._say(t_ns, source, f"watchdog: {status.name} {move}{reason}", level)

    def landed(self, landed: Landed, reason: str, t_ns: int, source: Source) -> None:
        """Note a judgement of the landing detection that is another than before."""
        if landed is not self._judged:
            self._judged = landed
            self._say(
                t_ns, source, f"landing detection: {landed.name}  {reason}", 0 if landed is not Landed.UNKNOWN else 1
            )
