"""Messages in order of time, cut into chunks with their index records."""

from __future__ import annotations

from typing import Any, Iterator, List, NamedTuple, Tuple

import numpy as np

from .arrays import index_data
from .layout import SECOND

__all__ = ["CHUNK_BYTES", "Cut", "cuts"]

CHUNK_BYTES = 768 * 1024  # the recorder's; readers keep one chunk, so larger ones cost them memory and time

_HEADER = 55  # bytes of an index record before its entries
_TEMPLATE = np.frombuffer(index_data(0, np.zeros(0, np.int64), np.zeros(0, np.int64)), np.uint8)
_AT_CONNECTION, _AT_COUNT, _AT_SIZE = 13, 27, 51


class Cut(NamedTuple):
    """One chunk to be written: messages from `first` to `last`, its data's size, and what its index says.

    Args:
        first: number of its first message.
        last: number behind its last message.
        size: of its messages in bytes.
        records: the index to be written behind it.
        start_ns: earliest time.
        end_ns: latest time.
        counts: messages by connection.
    """

    first: int
    last: int
    size: int
    records: Any
    start_ns: int
    end_ns: int
    counts: Tuple[Tuple[int, int], ...]


def cuts(t_ns: Any, connection: Any, length: Any, alone: Any, *, before: int, final: bool) -> Iterator[Cut]:
    """Cut messages into chunks; the last ones are left over unless `final`.

    Args:
        t_ns: times, ascending.
        connection: numbers.
        length: bytes of the records.
        alone: messages that have a chunk of their own.
        before: bytes that will stand before the first message of the first chunk.
        final: whether nothing will follow.
    """
    behind = np.cumsum(length)
    bounds: Any = _bounds(behind, alone, before, final=final)
    if len(bounds) < 2:  # noqa: PLR2004  (no whole chunk)
        return
    total = bounds[-1]
    sizes: Any = np.diff(bounds)
    starts = (behind - length)[bounds[:-1]]
    offsets = (behind - length)[:total] - np.repeat(starts, sizes)
    offsets[: sizes[0]] += before
    blob, records = _index_records(np.repeat(np.arange(len(sizes)), sizes), t_ns[:total], connection[:total], offsets)
    chunk_of, number_of, count_of, place_of = records
    edges: Any = np.searchsorted(chunk_of, np.arange(len(sizes) + 1))
    places = np.append(place_of, len(blob))[edges].tolist()
    counts = list(zip(number_of.tolist(), count_of.tolist()))
    edges = edges.tolist()
    view = memoryview(blob)
    for each, (first, last) in enumerate(zip(bounds[:-1], bounds[1:])):
        yield Cut(
            first,
            last,
            int(behind[last - 1] - starts[each]),
            view[places[each] : places[each + 1]],
            int(t_ns[first]),
            int(t_ns[last - 1]),
            tuple(counts[edges[each] : edges[each + 1]]),
        )


def _bounds(behind: Any, alone: Any, before: int, *, final: bool) -> List[int]:
    """Return where chunks begin and end, as numbers of messages: a chunk ends with the message that fills it."""
    bounds = [0]
    for place in np.flatnonzero(alone).tolist():
        _fill(bounds, behind[:place], before, final=True)
        bounds.append(place + 1)
        before = 0
    _fill(bounds, behind, before, final=final)
    return bounds


def _fill(bounds: List[int], behind: Any, before: int, *, final: bool) -> None:
    """Add bounds up to the last message."""
    count = len(behind)
    written = int(behind[bounds[-1] - 1]) if bounds[-1] else 0
    while bounds[-1] < count and behind[-1] - written + before >= CHUNK_BYTES:
        last = int(np.searchsorted(behind, written + CHUNK_BYTES - before, "left")) + 1
        before = 0
        bounds.append(last)
        written = int(behind[last - 1])
    if final and bounds[-1] != count:
        bounds.append(count)


def _index_records(chunk: Any, t_ns: Any, connection: Any, offsets: Any) -> Tuple[Any, Tuple[Any, Any, Any, Any]]:
    """Return the index records of all chunks as bytes, and for each of them chunk, connection, count, and place."""
    kinds = int(connection.max()) + 1
    key = chunk * kinds + connection
    order = np.argsort(key, kind="stable")
    key = key[order]
    first = np.flatnonzero(np.concatenate(([True], key[1:] != key[:-1])))
    count = np.diff(np.append(first, len(key)))
    size = _HEADER + 12 * count
    place = np.cumsum(size) - size
    blob = np.empty(int(size.sum()), np.uint8)
    blob[place[:, None] + np.arange(_HEADER)] = _TEMPLATE
    numbers = np.ndarray((len(blob) - 3,), "<u4", blob, 0, (1,))
    numbers[place + _AT_CONNECTION] = key[first] % kinds
    numbers[place + _AT_COUNT] = count
    numbers[place + _AT_SIZE] = 12 * count
    entries: Any = np.empty((len(key), 3), "<u4")
    entries[:, 0], entries[:, 1] = np.divmod(t_ns[order], SECOND)
    entries[:, 2] = offsets[order]
    targets = np.repeat(place + _HEADER - 12 * first, count) + 12 * np.arange(len(key))
    np.ndarray((len(blob) - 11,), "V12", blob, 0, (1,))[targets] = entries.view("V12")[:, 0]
    return blob, (key[first] // kinds, key[first] % kinds, count, place)
