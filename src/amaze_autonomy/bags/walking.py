"""Chunks walked record by record, without their index."""

from __future__ import annotations

from typing import Dict, List, NamedTuple, Tuple

from .connections import Connection, connection_of
from .errors import RecordError
from .layout import CONNECTION, LARGEST_HEADER, MESSAGE, Buffer, Record, record_at

__all__ = ["Walk", "walk"]


class Walk(NamedTuple):
    """What was found in a chunk without its index.

    Args:
        messages: (time, connection, offset) in the order of the chunk.
        connections: by number.
        end: of the last whole record.
    """

    messages: List[Tuple[int, int, int]]
    connections: Dict[int, Connection]
    end: int


def walk(buffer: Buffer) -> Walk:
    """Return the records at the beginning of a chunk, up to the first that is cut or none."""
    found = Walk([], {}, 0)
    position, limit = 0, len(buffer)
    while position < limit:
        try:
            record = record_at(buffer, position, limit)
            if record.end > limit or not _taken(found, record, position, buffer):
                break
        except RecordError:
            break
        position = record.end
    return found._replace(end=position)


def _taken(found: Walk, record: Record, position: int, buffer: Buffer) -> bool:
    if record.op == MESSAGE:
        found.messages.append((record.time_ns(b"time"), record.number(b"conn"), position))
    elif record.op == CONNECTION and record.size <= LARGEST_HEADER:
        connection = connection_of(record, bytes(buffer[record.data : record.end]))
        found.connections.setdefault(connection.number, connection)
    else:
        return False
    return True
