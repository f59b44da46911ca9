"""pytest plugin: every `*.scenario.yaml` is collected as tests, one for each combination of its matrix.

`-k`, `-x`, `--lf`, `-n` and `--junitxml` work as with any other test; tags are words for `-k`, and requirements,
margins and the digest of the decisions are properties in the JUnit file. Every verdict but PASS fails; with
`amaze_skip_missing_recordings = true` in pytest's configuration a scenario is a skip, with the reason, where a file of
its recordings is not there. Goldens are accepted by `amaze-replay accept`, never here.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Iterator, Optional, Sequence, Tuple

import pytest

if TYPE_CHECKING:
    from . import Result, Task

_SUFFIX = ".scenario.yaml"
_SKIP = "amaze_skip_missing_recordings"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the key of pytest's configuration."""
    parser.addini(_SKIP, "skip scenarios whose recordings are not there", "bool", default=False)


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> Optional[pytest.Collector]:
    """Collect a scenario file."""
    if not file_path.name.endswith(_SUFFIX):
        return None
    collected: pytest.Collector = ScenarioFile.from_parent(parent, path=file_path)
    return collected


class ScenarioFailedError(Exception):
    """A scenario has another verdict than PASS."""

    def __init__(self, result: Result) -> None:
        super().__init__(result.headline)
        self.result = result


class ScenarioFile(pytest.File):  # type: ignore[misc]  # pytest is not there for mypy
    """One file; a mistake in it is an error of the collection, with its line."""

    def collect(self) -> Iterator[pytest.Item]:
        """Return an item for each case."""
        from amaze_autonomy.config import ConfigError  # noqa: PLC0415

        from . import Task  # noqa: PLC0415
        from .scenario import load_cases  # noqa: PLC0415

        try:
            cases = load_cases(self.path)
        except ConfigError as error:
            raise self.CollectError(str(error)) from error
        for case in cases:
            task, bags = Task(str(self.path), case.variant), [bag.path for bag in case.bags]
            yield ScenarioItem.from_parent(self, name=case.id, task=task, bags=bags, tags=case.tags)


class ScenarioItem(pytest.Item):  # type: ignore[misc]
    """One case.

    Args:
        task: of it.
        bags: its recordings.
        tags: words for `-k`.
    """

    def __init__(self, *, task: Task, bags: Sequence[Path] = (), tags: Tuple[str, ...] = (), **more: Any) -> None:
        super().__init__(**more)
        self.task, self.bags = task, bags
        self.extra_keyword_matches.update(tags)

    def runtest(self) -> None:
        """Run it.

        Raises:
            ScenarioFailedError: its verdict is not PASS.
        """
        from . import Verdict, run_task  # noqa: PLC0415

        result = run_task(self.task)
        self.user_properties += [("requirement", name) for name in result.requirements]
        self.user_properties += [
            ("margin", f"{finding.margin_text}: {finding.expectation}")
            for finding in result.findings
            if finding.margin_text
        ]
        self.user_properties += [("verdict", result.verdict.value), ("digest", result.digest)]
        missing = not all(path.exists() for path in self.bags)
        if missing and result.verdict is Verdict.INCONCLUSIVE and self.config.getini(_SKIP):
            pytest.skip(f"INCONCLUSIVE: {result.headline}")
        if result.verdict is not Verdict.PASS:
            raise ScenarioFailedError(result)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return what is printed of a failure: the result's lines, no traceback."""
        if not isinstance(excinfo.value, ScenarioFailedError):
            return super().repr_failure(excinfo, style)
        from .task import result_lines  # noqa: PLC0415

        return "\n".join(result_lines(excinfo.value.result, verbose=True))

    def reportinfo(self) -> Tuple[Path, int, str]:
        """Return where it stands and what it is called."""
        return self.path, 0, f"scenario {self.name}"
