"""What the commands of `amaze-bag` do that only look; each returns whether something is damaged."""

from __future__ import annotations

import argparse
from typing import List

from .report import info_lines, scan_lines, scan_result, show
from .terminal import progress_bar

__all__ = ["doctor", "info"]


def info(options: argparse.Namespace) -> bool:
    """Show topics, counts, times and rates."""
    from .informing import info_result  # noqa: PLC0415  (each of the two needs what the other does not)

    results = [info_result(path) for path in options.bags]
    lines: List[str] = []
    for result in results:
        lines += [*([""] if lines else []), *info_lines(result)]
    show(lines, results, as_json=options.json)
    return False


def doctor(options: argparse.Namespace) -> bool:
    """Show what is damaged."""
    from .scan import scan  # noqa: PLC0415  (see above)

    lines, results, damaged = [], [], False
    for path in options.bags:
        with progress_bar(f"look through {path.name}") as progress:
            found = scan(path, check_data=not options.quick, progress=progress)
        lines += scan_lines(found)
        results.append(scan_result(found))
        damaged = damaged or bool(found.damages) or not found.closed
    show(lines, results, as_json=options.json)
    return damaged
