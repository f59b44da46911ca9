"""One test, and what came of it: values that can be sent to another process."""

from __future__ import annotations

import enum
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, Iterable, List, Optional, Sequence, Tuple
from xml.etree import ElementTree as ET

from amaze_autonomy.bags.format import MEMORY
from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.files import Kind, beginning

from .expect.model import Finding
from .scenario import find_files, load_cases

# --- the test ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Options:
    """What is asked of a run, for all its tests.

    Args:
        configuration: folder to decide by instead of each scenario's own; empty: its own.
        overrides: "file.key=value" on top of each scenario's own.
        before: folder whose differences from `configuration` are followed; empty: each scenario's own; None: none.
        compared: two configurations are compared, so it is said when the differences cannot be followed.
        goldens: compare with the goldens; False: judge expectations alone.
        story: return the whole journal of each run.
        memory: bytes that a chunk of a bag may take, decompressed.
    """

    configuration: str = ""
    overrides: Tuple[str, ...] = ()
    before: Optional[str] = None
    compared: bool = False
    goldens: bool = True
    story: bool = False
    memory: int = MEMORY


@dataclass(frozen=True)
class Task:
    """One test.

    Args:
        path: of the scenario file.
        variant: of its matrix; empty: it has none.
        options: of the run.
        weight: how long it may take, for the order in which tasks are begun; any unit.
        error: the file cannot be read: why; the result is an ERROR.
    """

    path: str
    variant: str = ""
    options: Options = field(default_factory=Options)
    weight: float = 0.0
    error: str = ""


def tasks_of(paths: Iterable[Path], options: Options = Options(), tags: Tuple[str, ...] = ()) -> Tuple[Task, ...]:  # noqa: B008
    """Return a task for each case of each scenario file; a file with a mistake is one task that will be an ERROR.

    Args:
        paths: of files and folders.
        options: of the run.
        tags: only scenarios that have one of them; empty: all.

    Raises:
        ReplayError: there is no scenario at one of the paths.
    """
    tasks: List[Task] = []
    for path in find_files(paths):
        try:
            cases = load_cases(path)
        except ConfigError as error:
            tasks.append(Task(str(path), options=options, error=str(error)))
            continue
        for case in cases:
            if not tags or any(tag in tags for tag in case.tags):
                weight = sum(bag.path.stat().st_size for bag in case.bags if bag.path.is_file()) / 1e6
                tasks.append(Task(str(path), case.variant, options, weight))
    return tuple(tasks)


# --- what came of it --------------------------------------------------------------------------------------------------


class Verdict(enum.Enum):
    """The five verdicts."""

    PASS = "PASS"  # noqa: S105
    FAIL = "FAIL"  # an expectation, or the golden, is not met
    INCONCLUSIVE = "INCONCLUSIVE"  # the recording does not offer what the test needs, or is damaged
    ERROR = "ERROR"  # the test could not be run
    VACUOUS = "VACUOUS"  # nothing was tested: an expectation evaluated, a fault touched, a key changed nothing


EXIT_STATUS = {
    Verdict.PASS: 0,
    Verdict.FAIL: 1,
    Verdict.ERROR: 1,
    Verdict.VACUOUS: 4,
    Verdict.INCONCLUSIVE: 3,
}
_ORDER = (1, 4, 3)


def exit_status(verdicts: Iterable[Verdict]) -> int:
    """Return the exit status for several tests: a failure outweighs a vacuous one, that an inconclusive one."""
    found = {EXIT_STATUS[verdict] for verdict in verdicts}
    return next((status for status in _ORDER if status in found), 0)


@dataclass(frozen=True)
class Figures:
    """How much was done, and how long it took; not part of what is compared.

    Args:
        flown_s: length of what was replayed or simulated.
        wall_s: that it took.
        cpu_s: of one core.
        peak_mb: of the process, so far.
    """

    flown_s: float = 0.0
    wall_s: float = 0.0
    cpu_s: float = 0.0
    peak_mb: float = 0.0


@dataclass(frozen=True)
class Result:
    """What came of one test.

    Args:
        id: of the case, e.g. "lrf[severity=low]".
        path: of the scenario file.
        variant: combination of its matrix.
        description: one line.
        verdict: of it.
        headline: one line: the first thing that is wrong, else what was found.
        findings: of each expectation, in the order of the file.
        problems: other things that are wrong, one line each: faults that touched nothing, needs that are not met.
        difference: from the golden, as lines for a person; empty: there is none.
        lines: the canonical journal: the decisions.
        digest: SHA-256 of those lines.
        unread: changed keys of the configuration that nothing looked at, each with its reason.
        story: journal lines of the whole run, for reports; empty unless asked for.
        marks: what the report draws beside: ("fault", begin in s, end in s or None, text).
        start_ns: zero of all times in seconds.
        command: that runs this test alone again.
        tags: of the scenario.
        requirements: of the scenario.
        figures: of the run.
    """

    id: str
    path: str
    variant: str
    description: str
    verdict: Verdict
    headline: str
    findings: Tuple[Finding, ...] = ()
    problems: Tuple[str, ...] = ()
    difference: Tuple[str, ...] = ()
    lines: Tuple[str, ...] = ()
    digest: str = ""
    unread: Tuple[Tuple[str, str], ...] = ()
    story: Tuple[str, ...] = ()
    marks: Tuple[Tuple[str, float, Optional[float], str], ...] = ()
    start_ns: int = 0
    command: str = ""
    tags: Tuple[str, ...] = ()
    requirements: Tuple[str, ...] = ()
    figures: Figures = field(default_factory=Figures)

    def plain(self) -> Dict[str, Any]:
        """Return it as JSON values, without the journal."""
        return {
            "id": self.id,
            "path": self.path,
            "variant": self.variant,
            "description": self.description,
            "verdict": self.verdict.value,
            "headline": self.headline,
            "expectations": [
                {
                    "expectation": finding.expectation,
                    "grade": finding.grade.value,
                    "text": finding.text,
                    "margin": finding.margin,
                    "limit": finding.limit,
                    "unit": finding.unit,
                    "where": finding.where,
                }
                for finding in self.findings
            ],
            "problems": list(self.problems),
            "difference": list(self.difference),
            "not_looked_at": [{"key": key, "reason": reason} for key, reason in self.unread],
            "decisions": len(self.lines),
            "digest": self.digest,
            "command": self.command,
            "tags": list(self.tags),
            "requirements": list(self.requirements),
            "figures": dict(vars(self.figures)),
        }


# --- told -------------------------------------------------------------------------------------------------------------
# Results for people and for programs: lines, JSON, JUnit, Markdown.


_WIDE = 12
NOT_COMPARED = "; goldens not compared: they are of each scenario's own configuration"


def result_lines(result: Result, *, verbose: bool = False) -> List[str]:
    """Return what is printed of one test: a line; more when it failed, or when asked for."""
    lines = [f"{result.verdict.value:<{_WIDE}} {result.id}: {result.headline}"]
    if result.verdict is Verdict.PASS and not verbose:
        return lines
    lines += [
        f"    {finding.grade.value:<8} {finding.expectation}: {finding.text}"
        + (f" ({finding.margin_text})" if finding.margin_text else "")
        for finding in result.findings
    ]
    lines += [
        f"    NOTE     from {begin_s:+.3f} s on, {words}: what is judged after that is another flight's"
        for kind, begin_s, _, words in result.marks
        if kind == "counterfactual"
    ]
    lines += [f"    {problem}" for problem in result.problems]
    lines += [f"    {line}" for line in result.difference]
    if result.verdict is not Verdict.PASS and not any("reproduce:" in line for line in result.difference):
        lines.append(f"    reproduce: {result.command}")
    return lines


def summary_line(results: Sequence[Result], wall_s: float) -> str:
    """Return how many tests have which verdict, and how fast it went."""
    counts = {verdict: sum(result.verdict is verdict for result in results) for verdict in Verdict}
    said = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count) or "no tests"
    flown_s = sum(result.figures.flown_s for result in results)
    return f"{said}; {flown_s:.0f} s of flight in {wall_s:.1f} s ({flown_s / max(wall_s, 1e-9):.0f} x real time)"


def plain(results: Sequence[Result], **more: Any) -> Dict[str, Any]:
    """Return all results as JSON values."""
    verdicts = [result.verdict for result in results]
    overall = {0: Verdict.PASS, 1: Verdict.FAIL, 3: Verdict.INCONCLUSIVE, 4: Verdict.VACUOUS}[exit_status(verdicts)]
    return {"version": 1, "verdict": overall.value, "tests": [result.plain() for result in results], **more}


RESULTS = Kind("result of scenarios", beginning(r'\{\s*"version": 1,\s*"verdict": "[A-Z]+",\s*"(tests|headline)": '))
JUNIT = Kind("JUnit file of amaze-replay", beginning(r'<\?xml [^>]*\?>\s*<testsuite name="amaze-replay"'))
SUMMARY = Kind("summary of scenarios", beginning("# Scenarios\n"))
"""What is written here, and may be replaced by what is written here."""


def as_json(results: Sequence[Result], **more: Any) -> str:
    """Return all results as JSON."""
    return json.dumps(plain(results, **more), indent=1) + "\n"


def as_junit(results: Sequence[Result]) -> str:
    """Return all results as JUnit XML; ids, tags and margins are properties."""
    bad = [result for result in results if result.verdict in (Verdict.FAIL, Verdict.VACUOUS)]
    errors = [result for result in results if result.verdict is Verdict.ERROR]
    skipped = [result for result in results if result.verdict is Verdict.INCONCLUSIVE]
    suite = ET.Element(
        "testsuite",
        name="amaze-replay",
        tests=str(len(results)),
        failures=str(len(bad)),
        errors=str(len(errors)),
        skipped=str(len(skipped)),
        time=f"{sum(result.figures.wall_s for result in results):.3f}",
    )
    for result in results:
        _junit_case(suite, result)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(suite, encoding="unicode") + "\n"


_TAGS = {
    Verdict.FAIL: "failure",
    Verdict.VACUOUS: "failure",
    Verdict.ERROR: "error",
    Verdict.INCONCLUSIVE: "skipped",
}


def _junit_case(suite: ET.Element, result: Result) -> None:
    case = ET.SubElement(suite, "testcase", classname=result.path, name=result.id, time=f"{result.figures.wall_s:.3f}")
    properties = ET.SubElement(case, "properties")
    pairs = [("requirement", name) for name in result.requirements] + [("tag", name) for name in result.tags]
    pairs += [("margin", f"{f.margin_text}: {f.expectation}") for f in result.findings if f.margin_text]
    pairs += [("verdict", result.verdict.value), ("digest", result.digest)]
    for name, value in pairs:
        ET.SubElement(properties, "property", name=name, value=_clean(value))
    tag = _TAGS.get(result.verdict)
    if tag is not None:
        kind = ET.SubElement(case, tag, message=_clean(result.headline), type=result.verdict.value)
        kind.text = _clean("\n".join(result_lines(result)))


def _clean(text: str) -> str:
    """Leave out what XML cannot hold."""
    return "".join(char for char in text if char in "\n\t" or char.isprintable())


def as_markdown(results: Sequence[Result], wall_s: float) -> str:
    """Return a summary for a page of CI: the failures first, with their differences."""
    lines = ["# Scenarios", "", f"{summary_line(results, wall_s)}.", ""]
    bad = [result for result in results if result.verdict is not Verdict.PASS]
    for result in bad:
        lines += [f"## {result.verdict.value}: {result.id}", "", f"{_escaped(result.headline)}", ""]
        lines += ["```", *result_lines(result)[1:], "```", ""]
    lines += ["| Verdict | Scenario | Decisions | Closest |", "|---|---|---|---|"]
    lines += [
        f"| {result.verdict.value} | {_escaped(result.id)} | {len(result.lines)} | {_escaped(_closest(result))} |"
        for result in (*bad, *(result for result in results if result.verdict is Verdict.PASS))
    ]
    return "\n".join(lines) + "\n"


def _closest(result: Result) -> str:
    tight = [
        (finding.margin / finding.limit, finding.margin_text)
        for finding in result.findings
        if finding.margin is not None and finding.limit
    ]
    return min(tight)[1] if tight else ""


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")
