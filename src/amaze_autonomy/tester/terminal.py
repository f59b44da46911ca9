"""What the verbs share at a terminal: options that choose, and what a person sees there.

Colours and a progress bar at a terminal, plain text everywhere else.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterator, List, Mapping, Sequence, Tuple

from amaze_autonomy.bags.cli import add_memory
from amaze_autonomy.bags.tapes import VARIABLE
from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.paths import config_folder
from amaze_autonomy.replay.session import Outcome
from amaze_autonomy.replay.timeline import Line, LineKind, written

from ..paths import expanded
from ..replay.errors import ReplayError
from .coverage import read_waivers
from .run import case_of
from .task import Options, Task, tasks_of

if TYPE_CHECKING:
    from rich.text import Text

# --- what is shown ----------------------------------------------------------------------------------------------------


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
    parser.add_argument("--tapes", type=expanded, metavar="DIR", help=words)


def use_tapes(options: argparse.Namespace) -> None:
    """Tell this process, and those that it starts, where tapes are kept."""
    if options.tapes is not None:
        os.environ[VARIABLE] = str(options.tapes.resolve())


# --- options that several verbs share ---------------------------------------------------------------------------------


_WAIVERS = "waivers.yaml"


def add_choice(parser: argparse.ArgumentParser) -> None:
    """Add what chooses scenarios."""
    words = "scenario files, and folders with *.scenario.yaml"
    parser.add_argument("paths", nargs="+", type=expanded, metavar="DIR|FILE", help=words)
    parser.add_argument("--tag", action="append", default=[], help="only scenarios with this tag; repeatable")
    parser.add_argument("--variant", help="only this combination of a matrix")
    add_memory(parser)


def add_configuration(parser: argparse.ArgumentParser) -> None:
    """Add what replaces the scenarios' configuration."""
    parser.add_argument("--config", type=expanded, metavar="DIR", help="decide by it instead of each scenario's own")
    words = "replace a value of the configuration; repeatable"
    parser.add_argument("--set", action="append", default=[], metavar="FILE.KEY=VALUE", help=words)


def add_waivers(parser: argparse.ArgumentParser) -> None:
    """Add the file of waivers."""
    words = f"rows and mutants that need not, with reasons; default: {_WAIVERS} beside the scenarios"
    parser.add_argument("--waivers", type=expanded, metavar="FILE", help=words)


def waivers_of(options: argparse.Namespace) -> Mapping[str, str]:
    """Return the reason of each waiver, by name: of the file that was given, else of those beside the scenarios.

    Raises:
        ConfigError: the first mistake in a file.
    """
    folders = [path if path.is_dir() else path.parent for path in options.paths]
    beside = [folder / _WAIVERS for folder in dict.fromkeys(folders) if (folder / _WAIVERS).is_file()]
    found: Dict[str, str] = {}
    for path in [options.waivers] if options.waivers is not None else beside:
        found.update(read_waivers(path))
    return found


def chosen(options: argparse.Namespace, run: Options) -> Tuple[Task, ...]:
    """Return the tasks that were chosen; a file with a mistake is one of them, whatever variant it may have.

    Raises:
        ReplayError: there is no scenario at one of the paths, or none with this tag and variant.
    """
    tasks = tasks_of(options.paths, run, tuple(options.tag))
    found = tuple(task for task in tasks if options.variant is None or task.error or task.variant == options.variant)
    if not found:
        variants = dict.fromkeys(repr(task.variant) for task in tasks if task.variant)
        known = f"; the variants are {', '.join(variants)}" if tasks and variants else ""
        raise ReplayError(f"no scenario was chosen{known}")
    return found


def check_options(run: Options, tasks: Sequence[Task]) -> None:
    """Refuse a configuration that fits none of the tasks: a mistyped key is wrong use, not an error of each scenario.

    Raises:
        ConfigError: the folder is none, or an override names or gives what cannot be, for all of them.
    """
    if not (run.configuration or run.overrides):
        return
    own = [] if run.configuration else [case_of(task).configuration for task in tasks if not task.error]
    wrong: List[ConfigError] = []
    folders = dict.fromkeys(run.configuration or folder or config_folder() for folder in own or [None])
    for folder in folders:
        try:
            load_configuration(folder, run.overrides)
        except ConfigError as error:
            wrong.append(error)
    if len(wrong) == len(folders) and (run.configuration or wrong[0].file.startswith("override ")):
        raise wrong[0]


def finite(text: str) -> float:
    """Return a number of the command line; NaN and infinity are none."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is no number of seconds")
    return value


def is_full(options: argparse.Namespace) -> bool:
    """Tell whether all scenarios of whole folders are run."""
    return all(path.is_dir() for path in options.paths) and not options.tag and options.variant is None


def options_of(options: argparse.Namespace, **more: Any) -> Options:
    """Return what is asked of the run."""
    folder = str(options.config) if options.config is not None else ""
    before = "" if folder else None
    return Options(folder, tuple(options.set), before, memory=options.memory, **more)
