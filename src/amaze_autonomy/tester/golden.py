"""Goldens on disk: a folder `goldens` beside the scenario, one JSON Lines file for each case, its decisions as decided.

The first line is a header: which case, and why it was accepted. No wall time, no path: the same run is the same file.
"""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Iterable, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.files import write_whole
from amaze_autonomy.journal.journal import JournalError, decode
from amaze_autonomy.replay.errors import GoldenError

from .difference import align, is_same, told
from .scenario.files import scenario_name
from .scenario.model import Case

FOLDER = "goldens"
_VERSION = 1
_SUFFIX = ".golden.jsonl"


@dataclass(frozen=True)
class Golden:
    """What was accepted.

    Args:
        reason: why.
        lines: of the decisions.
        decisions: the same, read.
    """

    reason: str
    lines: Tuple[str, ...]
    decisions: Tuple[Decision, ...]


def golden_path(case: Case) -> Path:
    """Return where the golden of a case lies."""
    variant = re.sub(r"[^A-Za-z0-9=._-]", "_", case.variant)
    return case.path.parent / FOLDER / (case.name + (f"@{variant}" if variant else "") + _SUFFIX)


def read_golden(path: Path) -> Optional[Golden]:
    """Read a golden; None: there is none.

    Raises:
        GoldenError: it is damaged.
    """
    if not path.is_file():
        return None
    try:
        head, *lines = path.read_text("ascii").splitlines()
        header = _checked(json.loads(head))
        decisions = tuple(_decision(line, number) for number, line in enumerate(lines, 2))
    except (ValueError, KeyError, TypeError, JournalError) as error:
        raise GoldenError(
            f"{path}: is no golden ({error}); accept the run anew, or take it from version control"
        ) from error
    return Golden(str(header.get("reason", "")), tuple(lines), decisions)


def write_golden(case: Case, lines: Sequence[str], reason: str) -> Path:
    """Write the golden of a case and return where it lies.

    Raises:
        OSError: it cannot be written.
    """
    path = golden_path(case)
    path.parent.mkdir(exist_ok=True)
    header = {"kind": "golden", "version": _VERSION, "case": case.id, "reason": reason}
    head = json.dumps(header, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    write_whole(path, "".join(f"{line}\n" for line in (head, *lines)))
    return path


def orphans(cases: Iterable[Case]) -> Tuple[Path, ...]:
    """Return the goldens, beside the files of these cases, that belong to none of them."""
    known = [golden_path(case) for case in cases]
    folders: List[Path] = list(dict.fromkeys(path.parent for path in known))
    found = (path for folder in folders for path in sorted(folder.glob(f"*{_SUFFIX}")))
    return tuple(path for path in found if path not in known)


def may_be_of(golden: Path, scenario: Path) -> bool:
    """Tell whether a golden may be of the file of a scenario, whose variants nobody knows while it has a mistake."""
    name = scenario_name(scenario)
    beside = golden.parent == scenario.parent / FOLDER
    return beside and (golden.name == f"{name}{_SUFFIX}" or golden.name.startswith(f"{name}@"))


def _checked(header: Any) -> Mapping[str, Any]:
    if header["kind"] != "golden" or header["version"] != _VERSION:
        raise ValueError(f"is version {header['version']!r} of {header['kind']!r}")
    return dict(header)


def _decision(line: str, number: int) -> Decision:
    decision = decode(line, number).payload
    if not isinstance(decision, Decision):
        raise ValueError(f"line {number} is no decision")  # noqa: TRY004
    return decision


# --- gate -------------------------------------------------------------------------------------------------------------
# Compares a run with its golden. A golden that is not there is a difference.


def compare_with_golden(case: Case, lines: Sequence[str], command: str, start_ns: int) -> Tuple[str, ...]:
    """Return how a run differs from its golden, the headline first; empty: it does not.

    Raises:
        GoldenError: the golden is damaged.
    """
    path = golden_path(case)
    golden = read_golden(path)
    if golden is None:
        return (
            f"there is no golden ({path.name}); look at the run, then: amaze-replay accept {case.path} --reason ...",
        )
    if golden.lines == tuple(lines):
        return ()
    changes = align(golden.decisions, decisions_of(lines))
    return () if is_same(changes) else told(changes, start_ns, command)


def decisions_of(lines: Sequence[str]) -> Tuple[Decision, ...]:
    """Read lines of decisions."""
    payloads = (decode(line, number).payload for number, line in enumerate(lines, 1))
    return tuple(payload for payload in payloads if isinstance(payload, Decision))


# --- reason -----------------------------------------------------------------------------------------------------------
# What is accepted is accepted by a person, at a desk, who says why.


_LEAST = 10
#: any of them in the environment: it runs in CI
CI_VARIABLES = ("CI", "CONTINUOUS_INTEGRATION", "GITHUB_ACTIONS", "GITLAB_CI", "JENKINS_URL", "BUILD_NUMBER")


def check_reason(reason: str, what: str, environment: Optional[Mapping[str, str]] = None) -> None:
    """Let a person accept something who says why.

    Args:
        reason: as given.
        what: is accepted, in the plural, e.g. "goldens".
        environment: of the process; None: its own.

    Raises:
        GoldenError: Nobody says why, or this is no desk.
    """
    given = os.environ if environment is None else environment
    found = next((name for name in CI_VARIABLES if given.get(name)), None)
    if found is not None:
        raise GoldenError(f"{what} are not accepted in CI ({found} is set); accept them at a desk and commit them")
    if len(reason.strip()) < _LEAST:
        least = f"a sentence of {_LEAST} letters or more"
        raise GoldenError(f"why are these {what} right now? Say it with --reason, in {least}")
