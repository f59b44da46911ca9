"""What a person at a terminal sees: colours and a progress bar there, plain text everywhere else."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Callable, Iterator, List, Sequence

from .session import Outcome
from .timeline import Line, LineKind, written

if TYPE_CHECKING:
    from rich.text import Text
import argparse
import os
from pathlib import Path

from amaze_autonomy.bags.tapes import VARIABLE

__all__ = ["add_tapes", "progress_bar", "show_lines", "show_timeline", "use_tapes"]


Report = Callable[[int, int], None]

_KINDS = {LineKind.NOTE: "bold", LineKind.MONITOR: "cyan", LineKind.DECISION: "", LineKind.MESSAGE: "italic"}
_LEVELS = {0: "", 1: "yellow", 2: "red"}


@contextmanager
def progress_bar(what: str) -> Iterator[Report]:
    """Show a progress bar on the standard error stream when it is a terminal; nothing otherwise."""
    if not sys.stderr.isatty():
        yield lambda _done, _total: None
        return
    from rich.console import Console  # noqa: PLC0415  (slow to load, and only terminals need it)
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def show_timeline(outcome: Outcome) -> None:
    """Print the timeline: coloured at a terminal, where what is counterfactual is dim; else plain."""
    if not sys.stdout.isatty():
        show_lines([f"{time}  {source:<10}  {text}" for time, source, text in _rows(outcome)])
        return
    from rich.console import Console  # noqa: PLC0415

    console = Console(highlight=False)
    for line in outcome.timeline:
        console.print(_styled(line, outcome.start_ns), soft_wrap=True)


def _rows(outcome: Outcome) -> List[Sequence[str]]:
    return [written(line, outcome.start_ns) for line in outcome.timeline]


def _styled(line: Line, start_ns: int) -> Text:
    from rich.text import Text  # noqa: PLC0415

    time, source, text = written(line, start_ns)
    base = "dim" if line.counterfactual or line.scripted else ""
    moves = line.kind is LineKind.DECISION and " -> " in text.partition("  by ")[0]
    style = " ".join(part for part in (base, "bold" if moves else _KINDS[line.kind], _LEVELS[line.level]) if part)
    return Text.assemble((f"{time}  ", base or "bold"), (f"{source:<10}  ", "dim"), (text, style))


def show_lines(lines: Sequence[str]) -> None:
    """Print lines as they are."""
    sys.stdout.write("".join(f"{line}\n" for line in lines))


# --- tape option ------------------------------------------------------------------------------------------------------
# The option that says where tapes are kept.


def add_tapes(parser: argparse.ArgumentParser) -> None:
    """Add where tapes are kept."""
    words = f"keep what is taken out of bags, and take it from there the next time; default: ${VARIABLE}, else nowhere"
    parser.add_argument("--tapes", type=Path, metavar="DIR", help=words)


def use_tapes(options: argparse.Namespace) -> None:
    """Tell this process, and those that it starts, where tapes are kept."""
    if options.tapes is not None:
        os.environ[VARIABLE] = str(options.tapes.resolve())
