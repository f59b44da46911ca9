"""What `amaze-bag recover` does: a new bag, or the old one in place, or that undone; returns whether data was lost."""

from __future__ import annotations

import argparse
from typing import Any

from .inplace import recover_in_place
from .recover import Recovered, recover, recovered_name
from .report import recover_lines, scan_result, show
from .terminal import progress_bar
from .undo import restore

__all__ = ["recover_bag"]


def recover_bag(options: argparse.Namespace) -> bool:
    """Write what is good into a new bag, or close a bag in place, or undo that."""
    if options.undo:
        original = restore(options.bag)
        show([f"{original}: as it was"], {"file": str(original), "restored": True}, as_json=options.json)
        return False
    with progress_bar(f"recover {options.bag.name}") as progress:
        done = _recovered(options, progress)
    result = {**scan_result(done.scan), "output": str(done.path), "output_bytes": done.size}
    show(recover_lines(done), result, as_json=options.json)
    return not done.complete


def _recovered(options: argparse.Namespace, progress: Any) -> Recovered:
    if options.in_place:
        return recover_in_place(options.bag, check_data=options.check_data, progress=progress)
    output = options.output or recovered_name(options.bag)
    return recover(options.bag, output, check_data=options.check_data, replace=options.force, progress=progress)
