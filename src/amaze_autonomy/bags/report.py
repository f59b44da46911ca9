"""What `amaze-bag` says: as lines for people, as JSON for programs."""

from __future__ import annotations

import json
import sys
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Sequence

if TYPE_CHECKING:  # loading them all would be a good part of a short run
    from .merge import Merged
    from .recover import Recovered
    from .scan import Scan
    from .verify import Verified

__all__ = [
    "info_lines",
    "merge_lines",
    "recover_lines",
    "scan_lines",
    "scan_result",
    "show",
    "verify_lines",
]


def show(lines: Sequence[str], result: Any, *, as_json: bool) -> None:
    """Print one or the other; a topic whose name is not UTF-8 is shown with escapes."""
    text = json.dumps(result, indent=2) if as_json else "\n".join(lines)
    sys.stdout.write(text.encode("utf-8", "backslashreplace").decode() + "\n")


def info_lines(result: Dict[str, Any]) -> List[str]:
    """Return a bag as a table."""
    start, end = result["start_ns"], result["end_ns"]
    length = f", {(end - start) / 1e9:.2f} s from {_date(start)}" if start is not None else ""
    chunks = ", ".join(f"{count} {kind}" for kind, count in result["chunks"].items()) or "no chunks"
    lines = [
        result["file"],
        f"  {result['messages']:,} messages{length}; {_size(result['bytes'])}; chunks: {chunks}",
    ]
    wide = max((len(row["topic"]) for row in result["topics"]), default=0)
    kinds = max((len(row["type"]) for row in result["topics"]), default=0)
    for row in result["topics"]:
        rate = "" if row["rate_hz"] is None else f"{row['rate_hz']:9.2f} Hz   longest gap {row['longest_gap_s']:.3f} s"
        several = f"   {row['connections']} publishers" if row["connections"] > 1 else ""
        lines.append(f"  {row['topic']:<{wide}}  {row['type']:<{kinds}}  {row['messages']:>9,}{rate}{several}")
    return lines


def _date(t_ns: int) -> str:
    return datetime.fromtimestamp(t_ns // 1_000_000_000, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")


def _size(size: int) -> str:
    return f"{size / 1e6:,.1f} MB"


def _lost(lost: Optional[int]) -> str:
    return "an unknown number of messages" if lost is None else f"{lost:,} messages"


def scan_result(found: Scan) -> Dict[str, Any]:
    """Return what was found in a file."""
    return {
        "file": str(found.path),
        "bytes": found.size,
        "closed": found.closed,
        "chunks": len(found.chunks),
        "messages": found.messages,
        "lost": found.lost,
        "damages": [each._asdict() for each in found.damages],
        "bytes_read": found.bytes_read,
    }


def scan_lines(found: Scan) -> List[str]:
    """Return the damages of a file."""
    verdict = "is good" if not found.damages and found.closed else f"lost: {_lost(found.lost)}"
    head = f"{found.path}: {found.messages:,} messages in {len(found.chunks):,} chunks; {verdict}"
    return [head, *(f"  {each}" for each in found.damages)]


def recover_lines(done: Recovered) -> List[str]:
    """Return what was recovered."""
    head = f"{done.path}: {done.scan.messages:,} messages, {_size(done.size)}; lost: {_lost(done.scan.lost)}"
    return [head, *(f"  {each}" for each in done.scan.damages)]


def merge_lines(merged: Merged) -> List[str]:
    """Return what was merged."""
    return [
        f"{merged.path}: {merged.messages:,} messages, {_size(merged.size)}",
        *(f"  warning: {line}" for line in merged.warnings),
    ]


def verify_lines(verified: Verified) -> List[str]:
    """Return the verdict, the problems, and who was asked."""
    output = verified.output
    of = f" of {len(verified.inputs)} inputs" if verified.inputs else ""
    verdict = f"{len(verified.problems)} problems" if verified.problems else "verified"
    lines = [f"{output.path}: {output.messages:,} messages{of}: {verdict}"]
    lines += [f"  problem: {line}" for line in verified.problems]
    for each in verified.readings:
        lines.append(f"  {each.reader}: {each.error or f'{sum(each.messages.values()):,} messages'}")
    return lines
