"""Options that several verbs share: which scenarios, and by which configuration."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Tuple

from .task import Options, Task, tasks_of

__all__ = ["add_choice", "add_configuration", "chosen", "is_full", "options_of"]


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
