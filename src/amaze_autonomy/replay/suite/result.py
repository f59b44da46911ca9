"""What came of one test."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Any, Dict, Iterable, Optional, Tuple

from ..expect.model import Finding

__all__ = ["EXIT_STATUS", "Figures", "Result", "Verdict", "exit_status"]


class Verdict(enum.Enum):
    """The five verdicts."""

    PASS = "PASS"  # noqa: S105
    FAIL = "FAIL"  # an expectation, or the golden, is not met
    INCONCLUSIVE = "INCONCLUSIVE"  # the recording does not offer what the test needs, or is damaged
    ERROR = "ERROR"  # the test could not be run
    VACUOUS = "VACUOUS"  # an expectation evaluated nothing, or a fault touched nothing: a failure


EXIT_STATUS = {
    Verdict.PASS: 0,
    Verdict.FAIL: 1,
    Verdict.ERROR: 1,
    Verdict.VACUOUS: 1,
    Verdict.INCONCLUSIVE: 3,
}


def exit_status(verdicts: Iterable[Verdict]) -> int:
    """Return the exit status for several tests: a failure outweighs what is inconclusive."""
    found = {EXIT_STATUS[verdict] for verdict in verdicts}
    return 1 if 1 in found else 3 if 3 in found else 0  # noqa: PLR2004


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
            "decisions": len(self.lines),
            "digest": self.digest,
            "command": self.command,
            "tags": list(self.tags),
            "requirements": list(self.requirements),
            "figures": dict(vars(self.figures)),
        }
