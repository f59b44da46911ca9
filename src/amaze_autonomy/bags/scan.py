"""A bag looked through from its first byte on, whatever its index says: which chunks are good, and what is damaged.

Only headers and the index records behind each chunk are read, unless the data is asked for; of a chunk whose index
records are missing, or that first describes a connection, the data is read in any case. Where a record is none, the
search goes on at the next chunk.
"""

from __future__ import annotations

import os
import re
import struct
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

from .errors import BagError, RecordError
from .format import (
    CHUNK,
    CHUNK_INFO,
    COMPRESSIONS,
    CONNECTION,
    FIRST_RECORD,
    INDEX,
    INDEX_ENTRY,
    INDEX_FIELDS,
    LARGEST_HEADER,
    MAGIC,
    MESSAGE,
    Connection,
    Record,
    connection_of,
    decompressed,
    our_index_record,
    record_at,
    salvaged,
)
from .index import ChunkHead, Entries, chunk_head, read_head
from .salvage import Kept, kept_by_index, kept_by_walk, rewritten

__all__ = ["Damage", "Found", "Scan", "scan"]

_READ = 1 << 14
_SEARCH = 1 << 22
_OVERLAP = 256
_FIRST_PLACES = (4109, FIRST_RECORD)  # of the first chunk: the rosbags library's, and everybody else's
_LARGEST_CUT = 1 << 28
_CHUNK_FIELD = re.compile(rb"\x04\0\0\0op=\x05|[\x0f\x10]\0\0\0compression=|\x09\0\0\0size=")
_BROKEN = (RecordError, struct.error, ValueError, IndexError)

Progress = Callable[[int, int], None]


class Damage(NamedTuple):
    """Bytes of the file that are not what they should be; `lost` messages, None when nobody knows how many."""

    offset: int
    size: int
    what: str
    lost: Optional[int]

    def __str__(self) -> str:
        """Return one line for a person."""
        lost = "" if self.lost == 0 else f", {'an unknown number of' if self.lost is None else self.lost} messages lost"
        return f"byte {self.offset} to {self.offset + self.size}: {self.what}{lost}"


class Found(NamedTuple):
    """A chunk with messages that can be kept.

    Args:
        position: in the file.
        data_end: where its data ends.
        end: where its index ends.
        start_ns: earliest time.
        end_ns: latest time.
        counts: messages by connection.
        index_bytes: to be written instead of the one in the file; None when that is good.
        data: likewise, not compressed.
        compression: of the chunk in the file.
        drop: connections that are described nowhere; their messages cannot be kept.
    """

    position: int
    data_end: int
    end: int
    start_ns: int
    end_ns: int
    counts: Tuple[Tuple[int, int], ...]
    index_bytes: Optional[bytes]
    data: Optional[bytes]
    compression: str
    drop: Tuple[int, ...] = ()


class Scan(NamedTuple):
    """What was found in a file.

    Args:
        path: of it.
        size: of it.
        closed: whether the bag says that it has an index.
        connections: by number.
        chunks: in the order of the file.
        damages: likewise.
        bytes_read: of the file.
    """

    path: Path
    size: int
    closed: bool
    connections: Dict[int, Connection]
    chunks: List[Found]
    damages: List[Damage]
    bytes_read: int

    @property
    def messages(self) -> int:
        """Count the messages that can be kept."""
        return sum(count for chunk in self.chunks for number, count in chunk.counts if number not in chunk.drop)

    @property
    def lost(self) -> Optional[int]:
        """Count the messages that are lost; None when nobody knows how many."""
        known = [damage.lost for damage in self.damages]
        return None if None in known else sum(lost for lost in known if lost)


def scan(path: Path, *, check_data: bool, progress: Optional[Progress] = None) -> Scan:
    """Look through a file.

    Args:
        path: of a bag, closed or not.
        check_data: whether to read and check the data of all chunks.
        progress: called with bytes passed and all bytes.

    Raises:
        BagError: It cannot be read, or is no bag at all.
    """
    scanner = _Scanner(path, check_data=check_data)
    try:
        scanner.run(progress or (lambda _done, _total: None))
    except OSError as error:
        raise BagError(str(path), f"cannot be read ({error.strerror})", "copy the disk and try there") from error
    finally:
        os.close(scanner.file)
    return scanner.result()


class _Scanner:
    def __init__(self, path: Path, *, check_data: bool) -> None:
        self.path, self._check_data = path, check_data
        self._damages: List[Damage] = []
        self._bytes_read = 0
        self._window, self._window_at = b"", 0
        self._seen: Tuple[int, Record] = (-1, Record({}, 0, 0))  # the last one: what ends an index begins a chunk
        self.file, self._size, self._first, self._index_at, self._chunk_count = self._opened()
        self._connections: Dict[int, Connection] = {}
        self._chunks: List[Found] = []
        self._indexed: Dict[int, int] = {}  # messages by position of the chunk, as the bag's index says

    def _opened(self) -> Tuple[int, int, int, int, int]:
        """Return the file, its size, places of the first record and of the index, and the number of chunks."""
        try:
            file, size, header = read_head(self.path)
        except BagError as error:
            return (*self._opened_without_header(error), 0, 0)
        try:
            return file, size, header.end, header.number(b"index_pos"), header.number(b"chunk_count")
        except RecordError:
            return file, size, header.end, 0, 0

    def _opened_without_header(self, error: BagError) -> Tuple[int, int, int]:
        """Open a file of which only the beginning is damaged."""
        if not isinstance(error.__cause__, RecordError) or "encrypted" in error.wrong or "version" in error.wrong:
            raise error
        file = os.open(self.path, os.O_RDONLY | os.O_CLOEXEC)
        size = os.fstat(file).st_size
        self._size = size
        self.file = file
        if os.pread(file, len(MAGIC), 0) != MAGIC and not any(map(self._is_chunk, _FIRST_PLACES)):
            os.close(file)
            raise error
        return file, size, len(MAGIC)

    def _read(self, position: int, size: int) -> bytes:
        self._bytes_read += size
        return os.pread(self.file, size, position)

    def _record(self, position: int) -> Record:
        """Return the record at a place in the file; its data's place is one in the file, too."""
        if position == self._seen[0]:
            return self._seen[1]
        at = position - self._window_at
        if not 0 <= at <= len(self._window) - min(_OVERLAP, self._size - position):
            self._window, self._window_at, at = self._read(position, _READ), position, 0
        window = self._window
        try:
            record = record_at(window, at, len(window))
        except RecordError:
            need = 8 + int.from_bytes(window[at : at + 4], "little")
            if not len(window) - at < need <= min(LARGEST_HEADER, self._size - position):
                raise
            window, at = self._read(position, need), 0
            record = record_at(window, at, len(window))
        record = Record(record.fields, record.data - at + position, record.size)
        self._seen = position, record
        return record

    def run(self, progress: Progress) -> None:
        """Look through the file."""
        position = self._first
        while position < self._size:
            try:
                position = self._step(position)
            except _BROKEN as error:
                position = self._search(position, str(error))
            progress(min(position, self._size), self._size)

    def result(self) -> Scan:
        """Return what was found, without messages of which nobody knows what they are."""
        closed = 0 < self._index_at <= self._size and len(self._indexed) == self._chunk_count
        if not closed and not any(damage.offset + damage.size == self._size for damage in self._damages):
            self._damage(self._size, self._size, "the bag was not closed", 0)
        damages = sorted(self._counted(each) if closed else each for each in self._damages)
        chunks = [self._described(each) for each in self._chunks]
        damages += [each for each in map(self._undescribed, chunks) if each]
        return Scan(self.path, self._size, closed, self._connections, chunks, damages, self._bytes_read)

    def _counted(self, damage: Damage) -> Damage:
        """Return a damage with the number of messages that the bag's index counted there."""
        if damage.lost is not None:
            return damage
        places = range(damage.offset, damage.offset + damage.size)
        kept = sum(count for chunk in self._chunks if chunk.position in places for _, count in chunk.counts)
        return damage._replace(lost=max(0, sum(self._indexed[each] for each in self._indexed if each in places) - kept))

    def _step(self, position: int) -> int:
        record = self._record(position)
        if record.op == CHUNK:
            return self._chunk(position, chunk_head(record))
        if record.op not in (INDEX, CONNECTION, CHUNK_INFO):
            raise RecordError("a record stands where none can")
        if record.end > self._size:
            raise RecordError("the file ends within its index")
        if record.op == CHUNK_INFO:
            pairs = struct.iter_unpack("<2L", self._data_of(record.data, record.size - record.size % 8))
            self._indexed[record.number(b"chunk_pos")] = sum(count for _, count in pairs)
        if record.op == CONNECTION:
            self._meet(connection_of(record, self._read(record.data, record.size)))
        return record.end

    def _chunk(self, position: int, head: ChunkHead) -> int:
        end = head.data + head.stored
        if head.compression not in COMPRESSIONS:
            raise RecordError(f"a chunk is compressed by {head.compression[:20]}, which is not known")
        if head.stored == 0 or end > self._size:
            return self._keep_cut(position, head)
        entries = self._entries(end)
        if entries.trusted and self._all_known(entries) and not self._check_data:
            self._keep_whole(position, end, entries, head)
        else:
            self._keep_checked(position, head, entries)
        return entries.end

    def _entries(self, position: int) -> Entries:
        """Return the index records behind a chunk."""
        parts: List[Tuple[int, bytes]] = []
        trusted = foreign = False
        while position < self._size:
            found = our_index_record(self._window, position - self._window_at)
            if found is None:
                try:
                    record = self._record(position)
                except _BROKEN:
                    break
                if record.op != INDEX or record.end > self._size:
                    trusted = record.op in (CHUNK, CONNECTION)
                    break
                foreign = foreign or tuple(record.fields) != INDEX_FIELDS
                number, data, size = record.number(b"conn"), record.data, record.size
            else:
                number, data, size = found[0], self._window_at + found[1], found[2]
                if data + size > self._size:
                    break
            parts.append((number, self._data_of(data, size - size % INDEX_ENTRY)))
            position = data + size
        return Entries(tuple(parts), position, trusted, foreign)

    def _data_of(self, data: int, size: int) -> bytes:
        begin = data - self._window_at
        if begin >= 0 and begin + size <= len(self._window):
            return self._window[begin : begin + size]
        return self._read(data, size)

    def _keep_whole(self, position: int, end: int, entries: Entries, head: ChunkHead) -> None:
        if not entries.messages:
            return
        index = None
        if entries.foreign:  # see there: they must not be mixed with ours
            from .read import index_records  # noqa: PLC0415  (needs numpy, slow to load and seldom wanted)

            index = index_records(*entries.columns())
        found = Found(position, end, entries.end, *entries.times(), entries.counts(), index, None, head.compression)
        self._chunks.append(found)

    def _keep_checked(self, position: int, head: ChunkHead, entries: Entries) -> None:
        raw = self._read(head.data, head.stored)
        end, count = head.data + head.stored, entries.messages
        try:
            data = decompressed(head.compression, raw, head.size)
        except RecordError as error:
            # bz2 alone has checksums of its parts; what of lz4 is good nobody knows.
            data = b"" if head.compression == "lz4" else salvaged(head.compression, raw)
            kept = kept_by_index(data, [*entries.rows()]) if entries.trusted else kept_by_walk(data)
            self._add(position, end, entries.end, kept, data, head)
            self._damage(position, end, f"in a chunk, {error}", count - len(kept.rows) if count else None)
            return
        if entries.trusted:
            self._keep_compared(position, head, entries, data)
            return
        walked = kept_by_walk(data)
        self._add(position, end, entries.end, walked, data, head)
        if walked.end != len(data):
            self._damage(position, end, "a chunk is damaged, and the index behind it", None)
        elif count != len(walked.rows):
            self._damage(end, entries.end, "the index behind a chunk is cut, it was made anew", 0)

    def _keep_compared(self, position: int, head: ChunkHead, entries: Entries, data: Any) -> None:
        """Keep what a chunk and the index behind it agree on."""
        end = head.data + head.stored
        error = self._contradiction(entries, data)
        if error is None:
            self._keep_whole(position, end, entries, head)
            return
        kept, walked = kept_by_index(data, [*entries.rows()]), kept_by_walk(data)
        if 2 * len(kept.rows) < len(walked.rows):  # the index is damaged, not the messages
            kept = walked
        self._add(position, end, entries.end, kept, data, head)
        self._damage(position, end, f"in a chunk, {error}", max(0, entries.messages - len(kept.rows)))

    def _contradiction(self, entries: Entries, data: Any) -> Optional[Exception]:
        """Return what is wrong where a chunk's data is not what its index says; learn its connections."""
        if not self._all_known(entries):
            walked = kept_by_walk(data)
            self._learn(walked)
            if walked.end == len(data) and sorted(walked.rows) == sorted(entries.rows()):
                return None
        from .read import Span, tabulate  # noqa: PLC0415  (needs numpy, slow to load and not always wanted)

        try:
            tabulate(data, [Span(0, len(data))], *entries.columns())
        except _BROKEN as error:
            return error
        return None

    def _all_known(self, entries: Entries) -> bool:
        """Return whether there is nothing to be learnt; a chunk without messages may be there for its connections."""
        return entries.messages > 0 and all(number in self._connections for number, _ in entries.counts())

    def _learn(self, kept: Optional[Kept]) -> None:
        for each in (kept.connections if kept else {}).values():
            self._meet(each)

    def _meet(self, connection: Connection) -> None:
        """Remember a connection; of its two descriptions, in a chunk and in the index, the one that looks good."""
        known = self._connections.get(connection.number)
        if known is None or (connection.plausible and not known.plausible):
            self._connections[connection.number] = connection

    def _keep_cut(self, position: int, head: ChunkHead) -> int:
        """Keep what is there of a chunk that was not finished, that is cut, or whose length is damaged."""
        raw = self._read(head.data, min(self._size - head.data, _LARGEST_CUT))
        data = salvaged(head.compression, raw)
        kept = kept_by_walk(data)
        self._add(position, self._size, self._size, kept, data, head._replace(size=-1))
        end = head.data + kept.end if head.compression == "none" else head.data
        return self._search(end, "a chunk is not whole") if end < self._size else end

    def _add(self, position: int, end: int, index_end: int, kept: Kept, data: Any, head: ChunkHead) -> None:
        """Keep messages of a chunk that cannot stay as it is."""
        self._learn(kept)
        if not kept.rows:
            return
        walked = kept_by_walk(data)
        complete = walked.end == len(data) == head.size and walked.rows == kept.rows
        new = None
        if not complete:
            new, kept = rewritten(data, kept)
        self._chunks.append(
            Found(position, end, index_end, *kept.times(), kept.counts(), kept.index_bytes(), new, head.compression)
        )

    def _described(self, chunk: Found) -> Found:
        """Return a chunk with what to drop of it."""
        return chunk._replace(drop=tuple(number for number, _ in chunk.counts if number not in self._connections))

    @staticmethod
    def _undescribed(chunk: Found) -> Optional[Damage]:
        if not chunk.drop:
            return None
        lost = sum(count for number, count in chunk.counts if number in chunk.drop)
        what = f"a chunk has messages of connections that are described nowhere ({', '.join(map(str, chunk.drop))})"
        return Damage(chunk.position, chunk.end - chunk.position, what, lost)

    def _damage(self, start: int, end: int, what: str, lost: Optional[int]) -> None:
        self._damages.append(Damage(start, end - start, what, lost))

    def _search(self, position: int, what: str) -> int:
        """Return where the next chunk or the index begins, or the end of the file."""
        found = self._next_chunk(position)
        if found is None and position < self._index_at < self._size and self._is_index(self._index_at):
            found = self._index_at
        in_index = 0 < self._index_at <= position
        stop = self._size if found is None else found
        self._damage(position, stop, "the index is damaged or cut" if in_index else what, 0 if in_index else None)
        return stop

    def _next_chunk(self, position: int) -> Optional[int]:
        begin = position + 1
        while begin < self._size:
            window = self._read(begin, _SEARCH)
            for match in _CHUNK_FIELD.finditer(window):
                candidate = begin + match.start() - 4
                if candidate > position and self._is_chunk(candidate):
                    return candidate
            if begin + len(window) >= self._size:
                break
            begin += len(window) - _OVERLAP
        return None

    def _is_index(self, position: int) -> bool:
        try:
            return self._record(position).op in (CONNECTION, CHUNK_INFO)
        except _BROKEN:
            return False

    def _is_chunk(self, position: int) -> bool:
        try:
            head = chunk_head(self._record(position))
            if head.compression not in COMPRESSIONS:
                return False
            end = head.data + head.stored
            if end < self._size and head.stored:
                return self._record(end).op == INDEX
            return head.compression != "none" or self._record(head.data).op in (MESSAGE, CONNECTION)
        except _BROKEN:
            return False
