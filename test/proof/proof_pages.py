"""docs/safety.md: the laws, the numbers, the assumptions, what is not covered."""

from __future__ import annotations

from typing import Dict, Iterable, List, Optional, Sequence

from proof_defects import Caught
from proof_run import BOUND, LARGE, Proof, expected_coverage
from proof_worlds import WORLDS

from amaze_autonomy.laws import LAWS

__all__ = ["defects", "explored", "page"]

_HEAD = """\
# Is there an order of events that leads to an unsafe decision?

<!-- This page is generated, with its numbers, by `./run proof`; CI compares it. -->

The engine is a pure function and its state is a value. So its states can be enumerated: an explorer (`test/proof/`)
plays every peer, every user, time and restarts against the very code that flies, breadth first, and checks every law
below at every single event. This is a proof within its bounds, which stand below with what they cut off; it is not a
proof of the vehicle.

```
./run proof                 # this page: the bounded proof and its self-test (about a minute)
./run proof large           # the same worlds, some 60 times larger (about 20 minutes)
./run proof large takeoff   # one world
```

Large, last run: 1,118,512 states, 5,999,609 transitions, 11,393,909 events, 46 laws checked 48 million times where they
apply, none broken; 21 of the 30 worlds complete, the others cut off after the layer that passed 400,000 transitions;
20 minutes of one core.

A broken law is printed with the shortest way to it, and written as a scenario file with its journal into
`test/proof/found/`: `amaze-replay test` decides it, and from then on `./run test` checks every law on it, and that the
decisions are those which were accepted once the engine was mended.
"""
_ABSTRACTS = """\
## What is abstracted

* Time goes in units; every limit is 1 to 5 of them. So the order of any two deadlines, and whether a peer spoke before
  or after one, is explored, and ties; how long a unit is does not matter. In one unit any number of events happens.
  Exact limits, to the nanosecond, are tested in `test/engine`.
* A peer that is not silent says its status once in each unit, and at once when it changes. Statuses are taken from
  lists (`proof_peers.py`): what a vehicle does, and contradictions: disarmed in the air, unknown, NaN, an old link.
* One component stands for each row of the decision table. The others of a row differ in nothing but their names.
* In most worlds two or fewer of the five checks are answered in every way; the others pass. All five go the same way
  through the same code, which does not look at their names but for the watchdog's.
* A restart is the state as it was (`test_resume.py` decides journals again and compares), a unit of time in which
  nothing was heard, and the event of the start. It can happen after every move in the worlds that have it.
* Two states are one when their times have the same ages, up to the longest limit that they are compared with; ids,
  texts and counters are left out. Samples of such pairs are compared in all their next moves.
"""
_ASSUMES = """\
## What is assumed

* The shell gives every event to `decide`, one after the other, and wakes it at each deadline: tested over a real
  master.
* Commands reach the peers in the order in which they are decided. A peer may do anything with them.
* The watchdog, the landing detection and the other checks compute what they say correctly: `test/monitoring`.

## What is not covered

* A vehicle that says something that is wrong but consistent, such as ON_GROUND and disarmed in the air, is believed.
* Combinations of what different worlds vary, beyond what the table of worlds says; three components failing at once.
* Sequences longer than the depth of a world that is not complete. `./run proof large` goes deeper.
* The shells: threads, ROS, the MAVLink link, files. They are tested (`test/ros`), not proven.
* A queue of more than two missions, more than two waypoint files, and repetitions.
"""


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(map(str, row)) + " |" for row in rows)]) + "\n"


def page(proof: Proof, caught: Dict[str, Optional[Caught]]) -> str:
    """Return the whole page."""
    return "\n".join([*explored(proof), defects(caught), _ASSUMES]).rstrip() + "\n"


def explored(proof: Proof) -> Sequence[str]:
    """Return the parts of the page before the defects."""
    return (_HEAD, _laws(proof), _worlds(proof), _ABSTRACTS)


def _laws(proof: Proof) -> str:
    rows = [(f"`{law.name}`", law.words, law.source, proof.applied[name]) for name, law in LAWS.items()]
    rows += [(f"`{name}`", words, source, count) for name, words, source, count in _of_the_explorer(proof)]
    return f"## The laws\n\n{_LAWS}\n\n" + _table(("Law", "In words", "Source", "Checked"), rows)


_LAWS = """\
`Source` is the rule of the specification: section.rule, or the row of a state in section 5. `Checked` counts the events
at which a law had something to say, in the bounded proof."""


def _of_the_explorer(proof: Proof) -> Sequence[Sequence[object]]:
    """Return the laws that need more than one moment."""
    rests = "From every state, when peers answer or their limits pass, it comes to rest: no cycle of time and answers."
    let_go = "LAND and PILOT end once the vehicle is down, heard, and acknowledged."
    one_future = "Two states that count as one have the same future (a check of the explorer)."
    compared = sum(stats.compared for stats in proof.stats.values())
    return (
        ("no_loop_without_progress", rests, "4.5", "each state"),
        ("a_landed_vehicle_is_let_go", let_go, "5", "each state"),
        ("decide_never_fails", "No event makes `decide` raise.", "3", "each event"),
        ("same_key_same_future", one_future, "", compared),
    )


def _worlds(proof: Proof) -> str:
    rows: List[Sequence[object]] = []
    for name, stats in proof.stats.items():
        cut = f"{stats.cut} states" if stats.cut else "complete"
        rows.append((name, WORLDS[name].words, stats.states, stats.transitions, stats.depth, stats.stopped, cut))
    total = proof.stats.values()
    rows.append(("together", "", sum(s.states for s in total), sum(s.transitions for s in total), "", "", ""))
    expected = expected_coverage()
    words = f"""\
A world begins no further layer after {BOUND} transitions ({LARGE} with `large`). `Depth` counts moves after the world's
beginning; `handed over` are states from which another world goes on; `cut off` those that are not gone on from.
Together they reach all {len(expected.rules)} rules (every row of the transition table, every change of a failure), all
{len(expected.places)} places, and {len(expected.failures)} pairs of a failure and its verb; CI asserts it."""
    head = ("World", "What happens in it", "States", "Transitions", "Depth", "Handed over", "Cut off")
    return f"## What was explored\n\n{words}\n\n" + _table(head, rows)


def defects(caught: Dict[str, Optional[Caught]]) -> str:
    """Return the part of the page about the self-test."""
    rows = [(words, f"`{c.law}`", c.world, c.moves) for words, c in caught.items() if c is not None]
    words = f"Would it notice? {len(rows)} deliberate defects are put into the engine, one at a time; each is caught."
    head = ("Defect", "Caught by", "In the world", "Moves")
    return f"## The proof proves itself\n\n{words}\n\n" + _table(head, rows)
