"""What the index of a bag says of its topics; of one that has none, what can be told from its chunks' own."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Tuple

import numpy as np

from amaze_autonomy.units import SECOND

from .arrays import SetBack, by_connection, joined_parts, repeated, set_back
from .errors import BagError, NotClosedError
from .format import MEMORY, read_at, record_at
from .index import ChunkHead, Index, Messages, chunk_head, index_parts
from .other_formats import is_other, other_recording
from .recover.scan import Scan, scan

_HEAD_BYTES = 4096


def info_result(path: Path, memory: int = MEMORY) -> Dict[str, Any]:
    """Return what a bag has.

    Args:
        path: of the bag; one that was not closed, or whose index is damaged, is looked through. MCAP, ROS 2 bags and
            ULogs are told of as well.
        memory: bytes that the data of a chunk may take where it has to be looked at.

    Raises:
        BagError: It is no bag.
    """
    if is_other(path):
        with other_recording(path, memory) as recording:
            t_ns, channel = recording.times()
            about = _about(recording.channels, t_ns, channel, recording.heads)
            size, version, problem = recording.bytes, recording.version, recording.problem or recording.cut
        closed = {"closed": not problem, "problem": problem}
        return {"file": str(path), "bytes": size, **closed, **about, "version": version}
    try:
        with Index(path) as index:
            messages = index.messages()
            heads = [index.head(number) for number in range(len(index.chunks))]
            about = _about(index.connections, messages.t_ns, messages.connection, heads)
            return {"file": str(path), "bytes": index.size, "closed": True, "problem": "", **about}
    except BagError as error:
        found = scan(path, check_data=False, memory=memory)
        messages, heads = _columns(found)
        about = _about(found.connections, messages.t_ns, messages.connection, heads)
        wrong = {"closed": False, "problem": error.wrong, "damaged": not isinstance(error, NotClosedError)}
        return {"file": str(path), "bytes": found.size, **wrong, **about}


def clock_set_back(found: Scan) -> Tuple[Optional[SetBack], int]:
    """Return whether the clock of a bag that was looked through was set back, and the time of its first message."""
    messages, _ = _columns(found)
    if not len(messages.t_ns):
        return None, 0
    columns = (messages.t_ns, messages.chunk, messages.offset)
    rows = by_connection(messages.connection).values()
    return set_back(tuple(column[each] for column in columns) for each in rows), int(messages.t_ns.min())


def _columns(found: Scan) -> Tuple[Messages, List[ChunkHead]]:
    """Return all messages that can be kept, and the headers of their chunks."""
    parts: List[Any] = []
    heads: List[ChunkHead] = []
    counts: List[int] = []
    file = os.open(found.path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        for chunk in found.chunks:
            raw = chunk.index_bytes
            if raw is None:
                raw = read_at(file, chunk.end - chunk.data_end, chunk.data_end)
            parts += index_parts(raw, 0, len(raw), dict(chunk.counts))[0]
            counts.append(sum(count for _, count in chunk.counts))
            heads.append(_head(file, chunk.position, chunk.compression, chunk.data))
    finally:
        os.close(file)
    t_ns, connection, offset = joined_parts(parts)
    return Messages(t_ns, connection, repeated(list(range(len(counts))), counts), offset), heads


def _head(file: int, position: int, compression: str, data: Any) -> ChunkHead:
    if data is not None:
        return ChunkHead(compression, position, len(data), len(data))
    begin = read_at(file, _HEAD_BYTES, position)
    return chunk_head(record_at(begin, 0, len(begin)))


def _about(connections: Mapping[int, Any], t_ns: Any, connection: Any, heads: Iterable[ChunkHead]) -> Dict[str, Any]:
    """Return what messages and chunks come to."""
    kinds: Dict[str, Dict[str, int]] = {}
    for head in heads:
        known = kinds.setdefault(head.compression, {"chunks": 0, "stored": 0, "size": 0})
        for name, value in (("chunks", 1), ("stored", head.stored), ("size", head.size)):
            known[name] += value
    return {
        "version": "2.0",
        "messages": len(t_ns),
        "start_ns": int(t_ns.min()) if len(t_ns) else None,
        "end_ns": int(t_ns.max()) if len(t_ns) else None,
        "chunks": {kind: known["chunks"] for kind, known in sorted(kinds.items())},
        "compression": dict(sorted(kinds.items())),
        "types": {each.kind: each.md5 for each in sorted(connections.values(), key=lambda each: each.kind)},
        "topics": list(_topics(connections, t_ns, connection)),
    }


def _topics(connections: Mapping[int, Any], t_ns: Any, connection: Any) -> Iterator[Dict[str, Any]]:
    """Yield each topic with its count, rate and silence; in a time that grows with messages and topics, not both."""
    publishers = Counter((each.topic, each.kind) for each in connections.values())
    names = sorted(publishers)
    places = {name: place for place, name in enumerate(names)}
    numbers: Any = np.array(sorted(connections), np.int64)
    place_of: Any = np.array(
        [places[connections[each].topic, connections[each].kind] for each in numbers] or [-1], np.int64
    )
    found: Any = np.searchsorted(numbers, connection)
    described = np.isin(connection, numbers)  # of a damaged bag some may be described nowhere
    topic = np.where(described, place_of[np.where(described, found, 0)], -1)
    order = np.lexsort((t_ns, topic))
    times = t_ns[order]
    begins: Any = np.searchsorted(topic[order], np.arange(len(names) + 1))
    bounds: List[int] = begins.tolist()
    whole = (int(t_ns.min()), int(t_ns.max())) if len(t_ns) else (0, 0)
    for name, first, last in zip(names, bounds, bounds[1:]):
        rhythm = _rhythm(times[first:last], whole)
        yield {"topic": name[0], "type": name[1], "connections": publishers[name], **rhythm}


def _rhythm(times: Any, whole: Tuple[int, int]) -> Dict[str, Any]:
    """Return count, mean rate, and longest silence between the first and the last message of the bag."""
    if not len(times):
        return {"messages": 0, "rate_hz": None, "longest_gap_s": None}
    first, last = int(times[0]), int(times[-1])
    steps = np.diff(times)
    longest = max(first - whole[0], whole[1] - last, int(steps.max()) if len(steps) else 0)
    length_s = (last - first) / SECOND
    return {
        "messages": len(times),
        "rate_hz": round(len(steps) / length_s, 3) if length_s else None,
        "longest_gap_s": round(longest / SECOND, 6),
    }
