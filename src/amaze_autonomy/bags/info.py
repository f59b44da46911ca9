"""What the index of a bag says of its topics."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict

import numpy as np

from amaze_autonomy.units import SECOND

from .index import Index

__all__ = ["info_result"]


def info_result(path: Path) -> Dict[str, Any]:
    """Return what the index says of a bag."""
    with Index(path) as index:
        messages = index.messages()
        topics = []
        for topic, kind in sorted({(each.topic, each.kind) for each in index.connections.values()}):
            numbers = [each.number for each in index.connections.values() if (each.topic, each.kind) == (topic, kind)]
            times = np.sort(messages.t_ns[np.isin(messages.connection, numbers)])
            topics.append({"topic": topic, "type": kind, "connections": len(numbers), **_rhythm(times)})
        compressions = [index.head(number).compression for number in range(len(index.chunks))]
        return {
            "file": str(path),
            "bytes": index.size,
            "messages": len(messages.t_ns),
            "start_ns": int(messages.t_ns.min()) if len(messages.t_ns) else None,
            "end_ns": int(messages.t_ns.max()) if len(messages.t_ns) else None,
            "chunks": {kind: compressions.count(kind) for kind in sorted(set(compressions))},
            "topics": topics,
        }


def _rhythm(times: Any) -> Dict[str, Any]:
    """Return count, mean rate and longest silence of messages."""
    steps = np.diff(times)
    length_s = int(times[-1] - times[0]) / SECOND if len(times) else 0.0
    return {
        "messages": len(times),
        "rate_hz": round(len(steps) / length_s, 3) if length_s else None,
        "longest_gap_s": round(int(steps.max()) / SECOND, 6) if len(steps) else None,
    }
