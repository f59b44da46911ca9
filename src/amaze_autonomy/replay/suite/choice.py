"""Options that several verbs share: which scenarios, and by which configuration."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Dict, Mapping, Tuple

from .coverage import read_waivers
from .task import Options, Task, tasks_of

__all__ = ["add_choice", "add_configuration", "add_waivers", "chosen", "is_full", "options_of", "waivers_of"]

_WAIVERS = "waivers.yaml"


def add_choice(parser: argparse.ArgumentParser) -> None:
    """Add what chooses scenarios."""
    words = "scenario files, and folders with *.scenario.yaml"
    parser.add_argument("paths", nargs="+", type=Path, metavar="DIR|FILE", help=words)
    parser.add_argument("--tag", action="append", default=[], help="only scenarios with this tag; repeatable")
    parser.add_argument("--variant", help="only this combination of a matrix")


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
        ReplayError: there is no scenario at one of the paths.
    """
    tasks = tasks_of(options.paths, run, tuple(options.tag))
    return tuple(task for task in tasks if options.variant is None or task.variant == options.variant)


def is_full(options: argparse.Namespace) -> bool:
    """Tell whether all scenarios of whole folders are run."""
    return all(path.is_dir() for path in options.paths) and not options.tag and options.variant is None


def options_of(options: argparse.Namespace, **more: Any) -> Options:
    """Return what is asked of the run."""
    folder = str(options.config) if options.config is not None else ""
    return Options(configuration=folder, overrides=tuple(options.set), **more)
