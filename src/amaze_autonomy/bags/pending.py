"""Messages that were loaded and are waiting for their turn."""

from __future__ import annotations

from typing import Any, Dict, List, NamedTuple, Optional, Set

import numpy as np

from .arrays import distinct
from .loading import Block, Pool

__all__ = ["Pending", "Rows"]


class Rows(NamedTuple):
    """Messages as arrays of one length: time, connection, record and payload in the buffer of a block, input.

    `origin` is where a record begins in the file of its input, when only its beginning is in the buffer; else -1.
    `whole` is the size of a compressed chunk that is in the buffer instead of a record; else 0.
    """

    t_ns: Any
    connection: Any
    start: Any
    payload: Any
    end: Any
    block: Any
    source: Any
    origin: Any
    whole: Any

    def where(self, which: Any) -> Rows:
        """Return some of them."""
        return Rows(*(column[which] for column in self))


def nothing() -> Rows:
    """Return no messages."""
    return Rows(*(np.zeros(0, np.int64) for _ in Rows._fields))


def joined(parts: List[Rows]) -> Rows:
    """Return messages one after another."""
    return Rows(*(np.concatenate(columns) for columns in zip(*parts))) if len(parts) > 1 else parts[0]


class Pending:
    """Loaded messages and their buffers. Ready are those before which nothing more can come."""

    def __init__(self) -> None:
        self.buffers: Dict[int, Any] = {}
        self._blocks: Dict[int, Block] = {}
        self._waiting: Dict[int, List[Rows]] = {}  # by input
        self._count = 0

    def add(self, block: Block) -> None:
        """Take the messages of a block."""
        table, number = block.table, self._count
        self._count += 1
        self._blocks[number], self.buffers[number] = block, block.buffer
        count = len(table.t_ns)
        rows = Rows(
            table.t_ns,
            table.connection,
            table.start,
            table.payload,
            table.end,
            np.full(count, number),
            np.full(count, block.source),
            block.origin,
            block.whole,
        )
        self._waiting.setdefault(block.source, []).append(rows)

    def ready(self, limit_ns: Optional[int]) -> Rows:
        """Return the messages before a time in order of time, then input, then file; all when there is no limit."""
        parts = [rows for source in sorted(self._waiting) for rows in self._waiting[source]]
        if not parts:
            return nothing()
        rows = joined(parts)
        rows = rows.where(np.argsort(rows.t_ns, kind="stable"))
        count = len(rows.t_ns) if limit_ns is None else int(np.searchsorted(rows.t_ns, limit_ns, "left"))
        self._waiting = _by_source(rows.where(slice(count, None)))
        return rows.where(slice(0, count))

    def release(self, held: Set[int], pool: Pool) -> None:
        """Give back the buffers of which no message is waiting or held."""
        for parts in self._waiting.values():
            for rows in parts:
                held.update(distinct(rows.block))
        for number in [number for number in self.buffers if number not in held]:
            del self.buffers[number]
            block = self._blocks.pop(number)
            pool.put(block.buffer)


def _by_source(rows: Rows) -> Dict[int, List[Rows]]:
    return {source: [rows.where(rows.source == source)] for source in distinct(rows.source)}
