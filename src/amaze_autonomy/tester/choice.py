"""Options that several verbs share: which scenarios, and by which configuration."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any, Dict, List, Mapping, Sequence, Tuple

from amaze_autonomy.bags.cli import add_memory
from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.paths import config_folder

from ..replay.errors import ReplayError
from .coverage import read_waivers
from .run import case_of
from .task import Options, Task, tasks_of

__all__ = [
    "add_choice",
    "add_configuration",
    "add_waivers",
    "check_options",
    "chosen",
    "finite",
    "is_full",
    "options_of",
    "waivers_of",
]

_WAIVERS = "waivers.yaml"


def add_choice(parser: argparse.ArgumentParser) -> None:
    """Add what chooses scenarios."""
    words = "scenario files, and folders with *.scenario.yaml"
    parser.add_argument("paths", nargs="+", type=Path, metavar="DIR|FILE", help=words)
    parser.add_argument("--tag", action="append", default=[], help="only scenarios with this tag; repeatable")
    parser.add_argument("--variant", help="only this combination of a matrix")
    add_memory(parser)


def add_configuration(parser: argparse.ArgumentParser) -> None:
    """Add what replaces the scenarios' configuration."""
    parser.add_argument("--config", type=Path, metavar="DIR", help="decide by it instead of each scenario's own")
    words = "replace a value of the configuration; repeatable"
    parser.add_argument("--set", action="append", default=[], metavar="FILE.KEY=VALUE", help=words)


def add_waivers(parser: argparse.ArgumentParser) -> None:
    """Add the file of waivers."""
    words = f"rows and mutants that need not, with reasons; default: {_WAIVERS} beside the scenarios"
    parser.add_argument("--waivers", type=Path, metavar="FILE", help=words)


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
    """Return the tasks that were chosen.

    Raises:
        ReplayError: there is no scenario at one of the paths, or none with this tag and variant.
    """
    tasks = tasks_of(options.paths, run, tuple(options.tag))
    found = tuple(task for task in tasks if options.variant is None or task.variant == options.variant)
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
