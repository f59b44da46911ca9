"""The report of a suite, and the map of a sweep, as one HTML page each, of the parts of every page (`pages/`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision

from ..journal.journal import JournalError
from ..journal.trace import Span, Trace, trace_of
from ..pages.contents import STATE_COLOURS
from ..pages.document import write_document
from ..pages.readings import Series
from ..replay.errors import ReplayError
from ..replay.timeline import value_text
from .coverage import Coverage
from .difference import align, without_numbers
from .golden import golden_path, read_golden
from .scenario import load_cases
from .task import Result, Verdict
from .whatif import Flight, Sweep, letters_of

# --- content ----------------------------------------------------------------------------------------------------------
# What the page shows, as plain values: lanes over time, decisions with their values, coverage, speed.


_RANK = {Verdict.FAIL: 0, Verdict.ERROR: 1, Verdict.VACUOUS: 2, Verdict.INCONCLUSIVE: 3, Verdict.PASS: 4}
_Bar = Tuple[float, float, str]
_MOST_POINTS = 1000

REPORT_TITLE = "Scenarios"


def page_content(results: Sequence[Result], coverage: Optional[Coverage], wall_s: float) -> Dict[str, Any]:
    """Return all that the page shows; failed scenarios first, then those that could not be run."""
    ordered = sorted(results, key=lambda result: _RANK[result.verdict])
    return {
        "tests": [_test(result) for result in ordered],
        "colours": dict(STATE_COLOURS),
        "wall_s": round(wall_s, 1),
        "flown_s": round(sum(result.figures.flown_s for result in results), 1),
        "coverage": []
        if coverage is None
        else [[i.name, list(i.scenarios), i.values, i.waiver] for i in coverage.items],
    }


def _test(result: Result) -> Dict[str, Any]:
    plain = result.plain()
    plain["margins"] = [finding.margin_text for finding in result.findings]
    plain["windows"] = [[finding.begin_s, finding.end_s] for finding in result.findings]
    plain["marks"] = [list(mark) for mark in result.marks]
    plain.update(_lanes(result))
    return plain


def _lanes(result: Result) -> Dict[str, Any]:
    """Return what is drawn; nothing for a test that did not run."""
    if not result.story:
        return {"end_s": 0.0, "states": [], "golden": [], "codes": {}, "quiet": [], "moments": [], "height": None}
    trace = trace_of(result.story, result.start_ns)
    golden = _golden(result)
    before = {} if golden is None else {change.after: change.kind.value for change in align(golden, trace.decisions)}
    lost = [] if golden is None else [c.before for c in align(golden, trace.decisions) if c.after is None and c.before]
    return {
        "end_s": round(trace.seconds(trace.end_ns), 3),
        "states": _bars(trace.states, trace),
        "golden": [] if golden is None else _golden_bars(golden, trace),
        "codes": {
            name: _bars(spans, trace) for name, spans in trace.codes.items() if any(s.value != "1" for s in spans)
        },
        "quiet": [name for name, spans in trace.codes.items() if all(s.value == "1" for s in spans)],
        "moments": [_moment(each, trace, before.get(each, "")) for each in trace.decisions]
        + [_moment(each, trace, "removed") for each in lost],
        "height": _height(trace),
    }


def _golden(result: Result) -> Optional[Tuple[Decision, ...]]:
    try:
        cases = [case for case in load_cases(Path(result.path)) if case.variant == result.variant]
        golden = read_golden(golden_path(cases[0])) if cases else None
    except (ReplayError, JournalError, ValueError, OSError):
        return None
    return None if golden is None else golden.decisions


def _bars(spans: Sequence[Span], trace: Trace) -> List[_Bar]:
    return [
        (round(trace.seconds(s.begin_ns), 3), round(trace.seconds(s.end_ns), 3), s.value.rstrip("/")) for s in spans
    ]


def _golden_bars(decisions: Sequence[Decision], trace: Trace) -> List[_Bar]:
    bars: List[_Bar] = []
    begin, value = 0.0, "MISSION_INPUT"
    for decision in decisions:
        t_s = round(trace.seconds(decision.t_ns), 3)
        after = f"{decision.after}/{decision.step}".rstrip("/")
        if after != value:
            bars.append((begin, t_s, value))
            begin, value = t_s, after
    end = max(begin, round(trace.seconds(trace.end_ns), 3))
    return [*bars, (begin, end, value)]


def _moment(decision: Decision, trace: Trace, change: str) -> Dict[str, Any]:
    after = f"{decision.after}/{decision.step}".rstrip("/")
    return {
        "t": round(trace.seconds(decision.t_ns), 3),
        "move": after if decision.before == decision.after else f"{decision.before} -> {after}",
        "rule": decision.rule,
        "event": decision.event,
        "values": [value_text(value, trace.start_ns) for value in decision.values],
        "commands": list(without_numbers(decision.commands)),
        "change": change if change not in ("same", "renumbered") else "",
    }


def _height(trace: Trace) -> Optional[Dict[str, Any]]:
    """Return the plot of the height; None where nobody tells it."""
    points = trace.readings.get("height_m", ())
    if not points:
        return None
    line = Series("height", [trace.seconds(t_ns) for t_ns, _ in points], [value for _, value in points])
    return {"title": "Height", "unit": "m", "series": [line.plain(_MOST_POINTS)], "limits": []}


def write_page(path: Path, results: Sequence[Result], coverage: Optional[Coverage], wall_s: float) -> None:
    """Write the report.

    Args:
        path: of the file.
        results: with their stories.
        coverage: of them; None: it is not shown.
        wall_s: how long the run took.

    Raises:
        OSError: it cannot be written.
        PageError: the plot library is not installed.
    """
    write_document(path, REPORT_TITLE, ("report",), page_content(results, coverage, wall_s))


# --- sweep ------------------------------------------------------------------------------------------------------------


def write_sweep_page(path: Path, title: str, result: Sweep) -> None:
    """Write the map of a sweep: the state over flight time for each time of the fault, with the boundaries.

    Args:
        path: of the file.
        title: what was swept: the scenario.
        result: of the sweep.

    Raises:
        OSError: it cannot be written.
        PageError: the plot library is not installed.
    """
    write_document(path, title, ("sweep",), sweep_content(title, result))


def sweep_content(title: str, result: Sweep) -> Dict[str, Any]:
    """Return all that the map shows: a bar for each state of each flight, as wide as half-way to its neighbours."""
    outcomes = list(dict.fromkeys(flight.outcome for flight in result.flights))
    columns = list(zip(result.flights, _columns(result.flights)))
    boundaries = [(each.after_s, each.before_s, *each.outcomes) for each in result.boundaries]
    letters = letters_of(outcomes)
    return {
        "title": title,
        "about": f"{result.fault}. {result.runs} runs, {len(outcomes)} outcomes, {len(boundaries)} boundaries.",
        "clock": result.clock,
        "colours": dict(STATE_COLOURS),
        "letters": {outcome: letters[outcome] for outcome in outcomes},
        "runs": {outcome: sum(flight.outcome == outcome for flight in result.flights) for outcome in outcomes},
        "bars": [
            ((left + right) / 2, right - left, begin_s, end_s, state, flight.t_s)
            for flight, (left, right) in columns
            for begin_s, end_s, state in flight.states
        ],
        "began": [(flight.t_s, flight.began_s) for flight in result.flights if flight.began_s is not None],
        "regions": _regions(result.flights),
        "boundaries": boundaries,
    }


def _regions(flights: Sequence[Flight]) -> List[Tuple[float, float, str]]:
    """Return from where to where there is which outcome: half-way between neighbours that differ."""
    edges = [(one, other) for one, other in zip(flights, flights[1:]) if one.outcome != other.outcome]
    ends = [flights[0].t_s, *((one.t_s + other.t_s) / 2 for one, other in edges), flights[-1].t_s]
    return list(zip(ends, ends[1:], [*(one.outcome for one, _ in edges), flights[-1].outcome]))


def _columns(flights: Sequence[Flight]) -> List[Tuple[float, float]]:
    """Return from where to where each flight stands: half-way to its neighbours."""
    times = [flight.t_s for flight in flights]
    middles = [(one + other) / 2 for one, other in zip(times, times[1:])]
    return list(zip([times[0], *middles], [*middles, times[-1]]))
