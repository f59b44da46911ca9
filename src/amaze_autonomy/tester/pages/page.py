"""Puts page.html, page.css, page.js and the content together into one file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.whole_file import write_whole

from ...journal.journal import JournalError
from ...journal.trace import Span, Trace, trace_of
from ...pages.contents import STATE_COLOURS
from ...replay.errors import ReplayError
from ...replay.timeline import value_text
from ..coverage import Coverage
from ..golden import align, read_golden
from ..golden.align import without_numbers
from ..golden.store import golden_path
from ..result import Result, Verdict
from ..scenario import load_cases

__all__ = ["STATE_COLOURS", "page_content", "write_page"]

# --- content ----------------------------------------------------------------------------------------------------------
# What the page shows, as plain values: lanes over time, decisions with their values, coverage, speed.


_RANK = {Verdict.FAIL: 0, Verdict.ERROR: 1, Verdict.VACUOUS: 2, Verdict.INCONCLUSIVE: 3, Verdict.PASS: 4}
_Bar = Tuple[float, float, str]


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
        return {"end_s": 0.0, "states": [], "golden": [], "codes": {}, "quiet": [], "moments": [], "height": []}
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
        "height": _thinned([(round(trace.seconds(t), 2), round(v, 2)) for t, v in trace.readings.get("height_m", ())]),
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


def _thinned(points: List[Tuple[float, float]], most: int = 300) -> List[Tuple[float, float]]:
    step = max(1, len(points) // most)
    return points[::step]


# --- page -------------------------------------------------------------------------------------------------------------


_HERE = Path(__file__).parent


def write_page(path: Path, results: Sequence[Result], coverage: Optional[Coverage], wall_s: float) -> None:
    """Write the report.

    Args:
        path: of the file.
        results: with their stories.
        coverage: of them; None: it is not shown.
        wall_s: how long the run took.

    Raises:
        OSError: it cannot be written.
    """
    content = json.dumps(page_content(results, coverage, wall_s), separators=(",", ":"), allow_nan=False)
    page = (_HERE / "page.html").read_text("utf-8")
    parts = {"css": "page.css", "js": "page.js"}
    for mark, name in parts.items():
        page = page.replace(f"@{mark}@", (_HERE / name).read_text("utf-8"))
    # "</script>" inside a text would end the script; JSON allows to write "<" as an escape.
    write_whole(path, page.replace("@content@", content.replace("<", "\\u003c")))
