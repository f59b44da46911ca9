"""The option that says where tapes are kept."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from amaze_autonomy.bags.tapes import VARIABLE

__all__ = ["add_tapes", "use_tapes"]


def add_tapes(parser: argparse.ArgumentParser) -> None:
    """Add where tapes are kept."""
    words = f"keep what is taken out of bags, and take it from there the next time; default: ${VARIABLE}, else nowhere"
    parser.add_argument("--tapes", type=Path, metavar="DIR", help=words)


def use_tapes(options: argparse.Namespace) -> None:
    """Tell this process, and those that it starts, where tapes are kept."""
    if options.tapes is not None:
        os.environ[VARIABLE] = str(options.tapes.resolve())
