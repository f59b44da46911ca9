"""The table of faults on recorded data. What a recording shares with the simulated world has the same word there.

A fault of a `component` is one of all its topics; of a `topic`, of that topic alone; of a `process`, of what a peer
says; of a `service`, of what the scripted peers answer; of none of them, of the recording as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict, Mapping, Optional, Tuple

from amaze_autonomy.config.kinds import Kind, Text
from amaze_autonomy.simulation import KINDS, Fault, FaultKind, Subject
from amaze_autonomy.simulation.scenario import Parameter
from amaze_autonomy.simulation.scenario_file import SUBJECTS, FaultEntry

from ...config.schemas.sensors import TOPIC_NAME
from ..recordings.fields import FIELD_PATH

TOPIC = "topic"
_FIELD = Parameter("field", None, "path of the field, e.g. linear_acceleration.z", pattern=FIELD_PATH)
_BOUND = 1e12


def _number(name: str, words: str, low: float = -_BOUND) -> Parameter:
    return Parameter(name, None, words, low=low, high=_BOUND)


_SAMPLES: Tuple[Tuple[str, str, Tuple[Parameter, ...]], ...] = (
    ("silent", "its messages do not come", ()),
    (
        "slow",
        "a part of its messages comes, evenly",
        (Parameter("rate_fraction", None, "part that is left", high=1.0),),
    ),
    (
        "flapping",
        "is silent and sends again, over and over; it begins with silence",
        (
            Parameter("off_s", None, "how long it is silent", low=0.001),
            Parameter("on_s", None, "how long it sends", low=0.001),
        ),
    ),
    (
        "dropped",
        "a part of its messages is lost, by chance",
        (Parameter("fraction", None, "part that is lost", high=1.0),),
    ),
    (
        "delayed",
        "its messages come late",
        (
            Parameter("delay_s", None, "how late", high=600.0),
            Parameter("jitter_s", 0.0, "up to so much later, by chance", high=600.0),
            Parameter("order", "kept", "whether one may overtake another", choices=("kept", "free")),
        ),
    ),
    ("bursting", "its messages are held back, and come all at once when the fault ends", ()),
    ("duplicated", "each of its messages comes again", (Parameter("copies", 1.0, "how often", low=1.0, high=100.0),)),
    (
        "reordered",
        "its messages come in another order, by chance",
        (Parameter("within_s", None, "no message moves further than this", low=0.0001, high=600.0),),
    ),
)
_VALUES: Tuple[Tuple[str, str, Tuple[Parameter, ...]], ...] = (
    (
        "stuck",
        "its messages repeat the one of the moment at which it stuck",
        (Parameter("stamp", "running", "whether their times go on", choices=("running", "frozen")),),
    ),
    ("nan", "a number in it is NaN", (_FIELD,)),
    ("infinite", "a number in it is infinite", (_FIELD,)),
    ("garbage", "a number in it is one that no reader expects, a list is empty, yes is no", (_FIELD,)),
    (
        "undefined",
        "a number in it that stands for a word, e.g. a phase, stands for none",
        (_FIELD, Parameter("value", 255.0, "the number", low=0.0, high=4294967295.0)),
    ),
    ("biased", "a number in it is off by a constant", (_FIELD, _number("by", "added, in the unit of the field"))),
    ("drifting", "a number in it is off by more and more", (_FIELD, _number("by_per_s", "added for each second"))),
    ("noisy", "a number in it is off by chance", (_FIELD, _number("sigma", "standard deviation", 0.0))),
    (
        "scaled",
        "a number in it has another unit or gain",
        (_FIELD, _number("factor", "e.g. 0.001 for a sensor that suddenly sends kilometres")),
    ),
    (
        "saturated",
        "a number in it ends at its bounds",
        (_FIELD, _number("lowest", "bound"), _number("highest", "bound")),
    ),
    (
        "swapped",
        "two numbers in it have changed places",
        (_FIELD, Parameter("with", None, "path of the other one", pattern=FIELD_PATH)),
    ),
    (
        "stamped",
        "its header's time is wrong",
        (
            Parameter("to", None, "what it is", choices=("zero", "offset", "backwards")),
            Parameter("by_s", 0.0, "with offset: added, negative for the past", low=-1e9),
        ),
    ),
)
_WHOLE = (
    FaultKind(
        Subject.WORLD,
        "clock_jumps",
        "the recorder's clock is set: all later messages are later, or earlier",
        (Parameter("by_s", None, "how far", low=-3000.0, high=3000.0),),
    ),
    FaultKind(
        Subject.WORLD,
        "clock_warps",
        "the recorder's clock runs at another speed until the fault ends",
        (Parameter("factor", None, "seconds it counts for each true one", low=0.01, high=100.0),),
    ),
    FaultKind(Subject.WORLD, "storage_full", "the scripted recorder's files do not grow any more"),
)
_SHARED = (
    *((Subject.SERVICE, name) for name in ("refuses", "hangs", "vanishes", "breaks", "lies", "slow")),
    (Subject.PROCESS, "silent"),
    (Subject.PROCESS, "restarted"),
    (Subject.PROCESS, "interrupted"),
)


def _table() -> Dict[Tuple[str, str], FaultKind]:
    rows = [
        FaultKind(subject, name, words, parameters)
        for subject in (Subject.COMPONENT, TOPIC)
        for name, words, parameters in _SAMPLES
    ]
    rows += [FaultKind(TOPIC, name, words, parameters) for name, words, parameters in _VALUES]
    rows += [KINDS[key] for key in _SHARED]
    rows += _WHOLE
    return {(row.subject, row.name): row for row in rows}


RECORDED_KINDS: Mapping[Tuple[str, str], FaultKind] = _table()
"""By subject and name."""

_SUBJECTS: Mapping[str, Tuple[Kind, str]] = {
    **SUBJECTS,
    TOPIC: (Text("the name of a topic", TOPIC_NAME), "which topic fails"),
}
RECORDED_FAULT = FaultEntry(RECORDED_KINDS, _SUBJECTS)


# --- acting -----------------------------------------------------------------------------------------------------------
# A fault of a scenario that is on a recording: with its time, and the topics that it is about.


@dataclass(frozen=True)
class Acting:
    """A fault with its time.

    Args:
        fault: of the scenario.
        begin_ns: when it begins.
        end_ns: when it ends; None: at the end of the recording.
        topics: that it is about.
    """

    fault: Fault
    begin_ns: int
    end_ns: Optional[int]
    topics: Tuple[str, ...] = ()

    def holds(self, t_ns: int) -> bool:
        """Tell whether it acts at a time."""
        return self.begin_ns <= t_ns and (self.end_ns is None or t_ns < self.end_ns)
