"""A bag looked through from its first byte on, whatever its index says: which chunks are good, and what is damaged.

A bag says everything several times: where a chunk ends and how many messages it has is said by the chunk's own header,
by the index records behind it (a count, and a length), by the bag's index at its end, and by the data. None is believed
alone. Where they contradict each other the data is looked at, and what most say counts; where a record is none, the
search goes on at whatever record comes next. Bytes that were passed over are a damage, and what was lost with them is
counted by the bag's index, or said to be unknown: never nothing.

All data is read and checked, unless it is to be trusted: then only headers and the index records behind each chunk are
read, and of a chunk whose index records are missing, or that first describes a connection, the data.
"""

from __future__ import annotations

import contextlib
import os
import struct
from pathlib import Path
from typing import Any, Callable, Dict, FrozenSet, List, NamedTuple, Optional, Set, Tuple

from ..errors import BagError, OtherBagError, RecordError
from ..format import (
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
    MEMORY,
    MESSAGE,
    UNREADABLE,
    Connection,
    Name,
    Record,
    check_memory,
    chunk_header,
    connection_of,
    decompressed,
    our_index_record,
    record_at,
    unpacked,
)
from ..index import (
    LARGEST_NUMBER,
    LOST_RETURNS,
    OTHERWISE,
    ChunkHead,
    Entries,
    Index,
    chunk_head,
    contradicts,
    has_lost_returns,
    read_head,
)
from .salvage import Kept, Row, headers, rewritten, salvaged

_READ = 1 << 14
_SEARCH = 1 << 22
_OVERLAP = 1 << 12
_FIRST_PLACES = (4109, FIRST_RECORD)  # of the first chunk: the rosbags library's, and everybody else's
_FRAMES = ((b"\x04\x22\x4d\x18", "lz4"), (b"BZh", "bz2"))  # how compressed data begins
_BEGINNING = 256  # bytes in which that is looked for behind a header that is destroyed
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
        checked: whether all data was looked at.
    """

    path: Path
    size: int
    closed: bool
    connections: Dict[int, Connection]
    chunks: List[Found]
    damages: List[Damage]
    bytes_read: int
    checked: bool = True

    @property
    def messages(self) -> int:
        """Count the messages that can be kept."""
        return sum(count for chunk in self.chunks for number, count in chunk.counts if number not in chunk.drop)

    @property
    def lost(self) -> Optional[int]:
        """Count the messages that are lost; None when nobody knows how many."""
        known = [damage.lost for damage in self.damages]
        return None if None in known else sum(lost for lost in known if lost)

    @property
    def lost_inside(self) -> Optional[int]:
        """Count those of them that are not lost at the end, behind all that is kept; None when nobody knows."""
        last = max((chunk.position for chunk in self.chunks), default=-1)
        inside = [each for each in self.damages if each.offset <= last or each.offset + each.size < self.size]
        return self._replace(damages=inside).lost


def scan(path: Path, *, check_data: bool = True, memory: int = MEMORY, progress: Optional[Progress] = None) -> Scan:
    """Look through a file.

    Args:
        path: of a bag, closed or not.
        check_data: whether to read and check the data of all chunks.
        memory: bytes that the data of a chunk may take.
        progress: called with bytes passed and all bytes.

    Raises:
        BagError: It cannot be read, or is no bag at all.
    """
    scanner = _Scanner(path, check_data=check_data, memory=memory)
    try:
        scanner.run(progress or (lambda _done, _total: None))
    except OSError as error:
        raise BagError(str(path), f"cannot be read ({error.strerror})", "copy the disk and try there") from error
    finally:
        if scanner.file >= 0:
            os.close(scanner.file)
    return scanner.result()


class _Reader:
    """Records of a file, read a piece at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file = -1
        self.size = self.bytes_read = 0
        self.window, self.window_at = b"", 0
        self._seen: Tuple[int, Record] = (-1, Record({}, 0, 0))  # the last one: what ends an index begins a chunk

    def read(self, position: int, size: int) -> bytes:
        """Return bytes of the file; fewer at its end."""
        found = os.pread(self.file, size, position)
        self.bytes_read += len(found)
        return found

    def data_of(self, data: int, size: int) -> bytes:
        """Return bytes of which a part may have been read."""
        begin = data - self.window_at
        if begin >= 0 and begin + size <= len(self.window):
            return self.window[begin : begin + size]
        return self.read(data, size)

    def record(self, position: int) -> Record:
        """Return the record at a place in the file; its data's place is one in the file, too."""
        if position == self._seen[0]:
            return self._seen[1]
        at = position - self.window_at
        if not 0 <= at <= len(self.window) - min(_BEGINNING, self.size - position):
            self.window, self.window_at, at = self.read(position, _READ), position, 0
        window = self.window
        try:
            record = record_at(window, at, len(window))
        except RecordError:
            need = 8 + int.from_bytes(window[at : at + 4], "little")
            if not len(window) - at < need <= min(LARGEST_HEADER, self.size - position):
                raise
            window, at = self.read(position, need), 0
            record = record_at(window, at, len(window))
        record = Record(record.fields, record.data - at + position, record.size)
        self._seen = position, record
        return record

    def op(self, position: int) -> int:
        """Return what kind of record is at a place; 0 when there is no whole one, but for an index record."""
        try:
            record = self.record(position)
        except _BROKEN:
            return 0
        return record.op if record.op == INDEX or record.end <= self.size else 0


class _Scanner:
    def __init__(self, path: Path, *, check_data: bool, memory: int) -> None:
        self._check_data, self._memory = check_data, memory
        self._reader = _Reader(path)
        self._damages: List[Damage] = []
        self._connections: Dict[int, Connection] = {}
        self._settled: Set[int] = set()  # connections of which nothing better is to be expected
        self._learnt: Set[int] = set()  # connections that chunks describe
        self._indexed: Dict[int, Connection] = {}  # connections as the bag's index has them
        self._named: Dict[int, Connection] = {}  # those of them that have a number of their own
        self._names: Set[Name] = set()  # what all of them are known by
        self._doubtful: Set[int] = set()  # numbers that are those of several connections there
        self._chunks: List[Found] = []
        self._before: FrozenSet[Tuple[int, int]] = frozenset()  # times and connections of the last damaged chunk
        self._visited: Set[int] = set()  # positions of chunks
        self._told: Dict[int, Dict[int, int]] = {}  # messages by connection, by position of the chunk: the bag's index
        self._agreed: Dict[int, int] = {}  # messages of a chunk whose data and index agree, and the bag's does not
        self._told_late: Dict[int, int] = {}  # messages by position, of an index that is not where the header says
        self._index_at = self._said_at = self._chunk_count = 0
        self._first = 0

    @property
    def file(self) -> int:
        return self._reader.file

    @property
    def _size(self) -> int:
        return self._reader.size

    def _opened(self) -> int:
        """Open the file; return the place of the first record."""
        reader = self._reader
        try:
            reader.file, reader.size, header = read_head(reader.path)
        except BagError as error:
            return self._opened_without_header(reader.path, error)
        try:
            self._index_at, self._chunk_count = header.number(b"index_pos"), header.number(b"chunk_count")
        except RecordError:
            self._index_at = 0
        self._said_at = self._index_at
        return header.end

    def _opened_without_header(self, path: Path, error: BagError) -> int:
        """Open a file of which only the beginning is damaged."""
        if not isinstance(error.__cause__, RecordError) or isinstance(error.__cause__, OtherBagError):
            raise error
        reader = self._reader
        reader.file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        reader.size = os.fstat(reader.file).st_size
        if os.pread(reader.file, len(MAGIC), 0) != MAGIC and not any(map(self._is_chunk, _FIRST_PLACES)):
            raise error
        return len(MAGIC)

    def _read_index(self) -> None:
        """Read what the bag's index says, as far as it is good; where it is none, there is none."""
        place = self._index_at
        if not self._first <= place <= self._size or self._reader.op(place) not in (CONNECTION, CHUNK_INFO):
            self._index_at = place if place == self._size and not self._chunk_count else 0
            return
        with contextlib.suppress(*_BROKEN):  # it is said when the walk comes there
            while place < self._size:
                record = self._reader.record(place)
                if record.op not in (CONNECTION, CHUNK_INFO) or record.end > self._size:
                    break
                self._note(record)
                place = record.end

    def _note(self, record: Record) -> None:
        """Take what a record of the index says."""
        data = self._reader.data_of(record.data, record.size)
        if record.op == CONNECTION:
            self._note_connection(connection_of(record, data), record.data)
            return
        counts = {number: count for number, count in struct.iter_unpack("<2L", data[: len(data) & ~7]) if count}
        if self._index_at:
            self._told[record.number(b"chunk_pos")] = counts
        else:  # bytes are missing before it, or its places are otherwise not those of this file
            self._told_late[record.number(b"chunk_pos")] = sum(counts.values())

    def _note_connection(self, connection: Connection, position: int) -> None:
        """Take a connection of the index; where two have one number, what chunks say of it counts."""
        number = connection.number
        self._names.add(connection.name)
        if self._indexed.setdefault(number, connection) != connection:
            self._doubtful.add(number)
            self._named.pop(number, None)
            if number not in self._learnt:
                self._connections.pop(number, None)
                self._settled.discard(number)
        elif number not in self._doubtful:
            self._named[number] = connection
            self._meet(connection, position)

    def run(self, progress: Progress) -> None:
        """Look through the file."""
        position = self._first = self._opened()
        self._read_index()
        while position < self._size:
            try:
                position = self._step(position)
            except _BROKEN as error:
                position = self._lost_way(position, str(error))
            progress(min(position, self._size), self._size)
        if self._said_at and not self._index_at and has_lost_returns(self.file, self._size, self._first):
            self._damage(0, self._size, LOST_RETURNS, 0)

    def result(self) -> Scan:
        """Return what was found, without messages of which nobody knows what they are."""
        closed = len(self._told or self._told_late) == self._chunk_count and (
            self._index_at > 0 or bool(self._told_late)
        )
        if closed and not self._index_at:
            self._damage(0, self._first, "the header does not say where the index is", 0)
        met = len(self._visited.union(chunk.position for chunk in self._chunks))
        if not closed and not self._index_at and met < self._chunk_count:  # 0 while it is being recorded
            what = f"the file is cut: its header counts {self._chunk_count} chunks, and {met} were found"
            self._damage(self._size, self._size, what, None)
        if not closed and not any(damage.offset + damage.size == self._size for damage in self._damages):
            self._damage(self._size, self._size, "the bag was not closed", 0)
        chunks = [self._described(each) for each in self._chunks]
        self._damages += [each for each in map(self._undescribed, chunks) if each]
        self._damages += self._not_found()
        if closed and not self._damages:
            self._ask_index()
        damages = self._balanced() if closed else self._damages
        unreadable = [each.topic for each in self._connections.values() if not each.is_readable]
        to_do = "`recover` and `merge` write it as text"  # nothing is changed here
        damages += [Damage(0, self._size, f"{topic}: {UNREADABLE}; {to_do}", 0) for topic in unreadable]
        reader = self._reader
        return Scan(
            reader.path,
            reader.size,
            closed,
            self._connections,
            chunks,
            sorted(damages, key=lambda each: each[:2]),
            reader.bytes_read,
            self._check_data,
        )

    def _ask_index(self) -> None:
        """See whether those can use the bag who go by its index alone: what they refuse is never called good."""
        from ..arrays import check_index  # noqa: PLC0415  (needs numpy, slow to load and not always wanted)

        try:
            with Index(self._reader.path, self._memory) as index:
                check_index(index)
        except BagError as error:
            self._damage(self._index_at, self._size, error.wrong, 0)

    def _not_found(self) -> List[Damage]:
        """Return chunks that the bag's index names, that were not come to, and that no damage accounts for."""
        within = [range(each.offset, each.offset + each.size) for each in self._damages]
        return [
            Damage(place, 0, "the bag's index names a chunk where none was found", sum(counts.values()))
            for place, counts in sorted(self._told.items())
            if counts and place not in self._visited and not any(place in each for each in within)
        ]

    def _balanced(self) -> List[Damage]:
        """Return damages with what the bag's index counted there: what it counts in all is kept, or is lost."""
        damages = [self._counted(each) for each in self._damages]
        told = sum(self._agreed.get(place, sum(counts.values())) for place, counts in self._told.items())
        told += sum(self._told_late.values())
        kept = sum(count for chunk in self._chunks for _, count in chunk.counts)
        missing = told - kept - sum(each.lost or 0 for each in damages if "described nowhere" not in each.what)
        unknown = [each for each in damages if each.lost is None]
        if missing <= 0 or len(unknown) == 1:
            return [each._replace(lost=max(0, missing)) if each.lost is None else each for each in damages]
        if not unknown:
            damages.append(Damage(0, self._size, "the bag's index counts messages that were not found", missing))
        return damages

    def _counted(self, damage: Damage) -> Damage:
        """Return a damage with the number of messages that the bag's index counted in chunks that begin there."""
        places = range(damage.offset, damage.offset + damage.size)
        told = [sum(counts.values()) for place, counts in self._told.items() if place in places]
        if damage.lost is not None or not told:
            return damage
        kept = sum(count for chunk in self._chunks if chunk.position in places for _, count in chunk.counts)
        return damage._replace(lost=max(0, sum(told) - kept))

    def _step(self, position: int) -> int:
        record = self._reader.record(position)
        if record.op == CHUNK:
            return self._chunk(position, chunk_head(record))
        if record.op not in (INDEX, CONNECTION, CHUNK_INFO):
            raise RecordError("a record stands where none can")
        if record.end > self._size:
            raise RecordError("the file ends within its index")
        if record.op != INDEX:
            self._note(record)
        return record.end

    # --- one chunk ------------------------------------------------------------------------------------------------

    def _chunk(self, position: int, head: ChunkHead) -> int:
        self._visited.add(position)
        end = head.data + head.stored
        if not head.stored and self._is_behind(head.data):
            return self._entries(position, end).end  # it is empty
        known = head.compression in COMPRESSIONS
        if not known:
            head = head._replace(compression=self._kind_at(head.data))
        if not head.stored or not self._is_behind(end):
            return self._keep_loose(position, head, known=known)
        entries = self._entries(position, end)
        if not known or self._check_data or not entries.trusted or not self._all_known(entries):
            self._keep_checked(position, head, entries, known=known)
        else:
            self._keep_whole(position, end, entries, head)
        return entries.end

    def _is_behind(self, place: int) -> bool:
        """Return whether what may stand behind a chunk's data stands at a place."""
        if place == self._size:
            return True
        op = self._reader.op(place)
        return op in (INDEX, CHUNK, CHUNK_INFO) or (op == CONNECTION and place == self._index_at)

    def _kind_at(self, data: int) -> str:
        """Return how data is compressed, by its beginning."""
        begin = self._reader.read(data, 4)
        return next((kind for magic, kind in _FRAMES if begin.startswith(magic)), "none")

    def _entries(self, chunk: int, position: int) -> Entries:
        """Return the index records behind a chunk."""
        reader = self._reader
        parts: List[Tuple[int, bytes]] = []
        told = self._told.get(chunk)
        trusted = foreign = False
        while position < self._size:
            found = our_index_record(reader.window, position - reader.window_at)
            if found is None:
                try:
                    record = reader.record(position)
                    if record.op != INDEX:
                        trusted = record.op in (CHUNK, CONNECTION, CHUNK_INFO)
                        break
                    number, data = record.number(b"conn"), record.data
                    size = self._index_size(record, told)
                except _BROKEN:
                    break
                otherwise = size != record.size or size != INDEX_ENTRY * record.number(b"count")
                foreign = foreign or otherwise or tuple(record.fields) != INDEX_FIELDS
            else:
                number, data, size = found[0], reader.window_at + found[1], found[2]
                if data + size > self._size:
                    break
            parts.append((number, reader.data_of(data, size)))
            position = data + size
        if parts and not trusted and position < self._size and self._has_swallowed(parts[-1][1], chunk):
            position -= len(parts.pop()[1])  # with what is not its own; its header is passed over
        filled = [number for number, part in parts if part]
        if len(set(filled)) < len(filled):  # which nobody expects
            self._damage(chunk, position, "a chunk has several index records of one connection", 0)
            foreign = True
        entries = Entries(tuple(parts), position, trusted, foreign)
        if told is not None and dict(entries.counts()) != told:
            entries = entries._replace(trusted=False)
        return entries

    def _has_swallowed(self, part: bytes, chunk: int) -> bool:
        """Return whether an index record has something else in it: places that are not in the chunk."""
        try:
            size = chunk_head(self._reader.record(chunk)).size
        except _BROKEN:
            return True
        return any(offset >= size for _, _, offset in struct.iter_unpack("<3L", part))

    def _index_size(self, record: Record, told: Optional[Dict[int, int]]) -> int:
        """Return how long an index record is: its length, its count and the bag's index say so, what follows decides.

        Raises:
            RecordError: It is as none of them says.
        """
        count, number = record.number(b"count"), record.number(b"conn")
        said = [record.size, INDEX_ENTRY * count]
        said += [INDEX_ENTRY * told[number]] if told and number in told else []
        possible = [
            (self._is_behind(record.data + size) + said.count(size), size)
            for size in said
            if size % INDEX_ENTRY == 0 and record.data + size <= self._size
        ]
        if not possible:
            raise RecordError("an index record contradicts itself")
        size = max(possible)[1]
        if size != record.size:
            self._damage(record.data - 4, record.data, f"an index record says {record.size} bytes and has {size}", 0)
        elif size != INDEX_ENTRY * count:  # which no other reader takes
            what = f"an index record counts {count} messages and has {size // INDEX_ENTRY}"
            self._damage(record.data - 4, record.data, what, 0)
        return size

    def _keep_whole(self, position: int, end: int, entries: Entries, head: ChunkHead) -> None:
        if not entries.messages:
            return
        index = None
        if entries.foreign:  # see there: they must not be mixed with ours
            from ..arrays import index_records  # noqa: PLC0415  (needs numpy, slow to load and seldom wanted)

            index = index_records(*entries.columns())
        found = Found(position, end, entries.end, *entries.times(), entries.counts(), index, None, head.compression)
        self._chunks.append(found)

    def _keep_checked(self, position: int, head: ChunkHead, entries: Entries, *, known: bool) -> None:
        """Keep of a chunk what its data and the index behind it agree on."""
        end = head.data + head.stored
        try:
            check_memory(head.stored, self._memory)
            data = decompressed(head.compression, self._reader.read(head.data, head.stored), head.size, self._memory)
        except RecordError as error:
            self._keep_broken(position, head, entries, error)
            return
        wrong: Optional[Exception] = self._contradiction(position, entries, data)
        if not known:
            wrong = RecordError("its header does not say how it is compressed")
        if wrong is None:
            self._keep_whole(position, end, entries, head)
            if dict(entries.counts()) != self._told.get(position, dict(entries.counts())):
                self._damage(position, end, "the bag's index counts other messages in a chunk than it has", 0)
                self._agreed[position] = entries.messages
            return
        anew = head if known else head._replace(size=-1)
        self._keep_salvaged(position, anew, entries, data, str(wrong), whole=True)

    def _keep_broken(self, position: int, head: ChunkHead, entries: Entries, error: RecordError) -> None:
        """Keep what can be decompressed of a chunk; one that has another size than it says may be good."""
        data: Any = b""
        whole = False
        if head.stored <= self._memory and (head.compression == "none" or head.size <= self._memory):
            raw = self._reader.read(head.data, head.stored)
            data, whole = unpacked(head.compression, raw, self._memory)
            if not whole and head.compression == "lz4":
                data = b""  # bz2 alone has checksums of its parts; what of lz4 is good nobody knows
        self._keep_salvaged(position, head._replace(size=-1), entries, data, str(error), whole=whole)

    def _keep_salvaged(
        self, position: int, head: ChunkHead, entries: Entries, data: Any, wrong: str, *, whole: bool
    ) -> None:
        """Keep what is good in the data of a chunk, and say what is lost; `whole`: it is all of the data."""
        end, kept = head.data + head.stored, salvaged(data, list(entries.rows()))
        self._add(position, end, entries.end, kept, data, head)
        what = f"in a chunk, {wrong}"
        if not entries.parts:
            what = "a chunk is damaged, and the index behind it" if kept.gaps or not whole else "a chunk has no index"
        self._damage(position, end, what, self._lost(position, entries, kept, whole=whole))

    def _lost(self, position: int, entries: Entries, kept: Kept, *, whole: bool) -> Optional[int]:
        """Return how many messages of a chunk were not kept, by what most say that it had; None when nobody knows.

        Args:
            position: of the chunk.
            entries: the index behind it.
            kept: of it.
            whole: whether all of its data was there.
        """
        said = [entries.messages] if entries.parts else []
        said += [sum(self._told[position].values())] if position in self._told else []
        if whole and not kept.gaps:
            said.append(len(kept.rows))
            return max(0, max(said, key=lambda count: (said.count(count), count == len(kept.rows))) - len(kept.rows))
        lost = max(said, default=0) - len(kept.rows)
        return lost if lost > 0 or (lost == 0 and said and min(said) == max(said)) else None

    def _contradiction(self, position: int, entries: Entries, data: Any) -> Optional[Exception]:
        """Return what is wrong where the data of the chunk at a place is not what its index says; learn connections."""
        if not self._all_known(entries):
            kept = salvaged(data, list(entries.rows()))
            self._learn(kept, position)
            self._settled.update(number for number, _ in entries.counts())
            if not kept.gaps and sorted(kept.rows) == sorted(entries.rows()):
                return RecordError(OTHERWISE) if self._contradicted(kept, self._named) else None
        from ..arrays import Span, tabulate  # noqa: PLC0415  (needs numpy, slow to load and not always wanted)

        try:
            tabulate(data, [Span(0, len(data))], *entries.columns(), known=self._named)
        except _BROKEN as error:
            return error
        return None

    def _all_known(self, entries: Entries) -> bool:
        """Return whether there is nothing to be learnt; a chunk without messages may be there for its connections."""
        numbers = [number for number, _ in entries.counts()]
        return bool(numbers) and self._settled.issuperset(numbers) and self._doubtful.isdisjoint(numbers)

    def _learn(self, kept: Kept, position: int) -> None:
        for each in kept.connections.values():
            self._tell_other(each, position)
            self._learnt.add(each.number)
            self._meet(each, position)
        for each in kept.others:
            self._tell_other(each, position)
        for each in self._contradicted(kept, self._named):
            if self._witnesses(each) >= self._witnesses(self._named[each.number]):
                self._connections[each.number] = each

    def _tell_other(self, connection: Connection, position: int) -> None:
        """Tell of a connection in a chunk that has the number of another one, where no index says whose that is."""
        number, known = connection.number, self._connections.get(connection.number)
        if known is None or known.name == connection.name or number not in self._learnt or number in self._named:
            return
        what = (
            f"two connections have the number {number}, {known.topic} and {connection.topic}: the first is kept, "
            "messages of it from there on may be the other's"
        )
        damage = Damage(position, 0, what, 0)
        self._damages += [damage] if damage not in self._damages else []  # a chunk may be looked at twice

    def _contradicted(self, kept: Kept, known: Dict[int, Connection]) -> List[Connection]:
        """Return what a chunk describes that the bag's index has, otherwise than it is known."""
        used = dict(kept.counts())
        named = [each for number, each in kept.connections.items() if number in self._named]
        return [each for each in named if contradicts(each, known.get(each.number), self._names, used)]

    def _witnesses(self, connection: Connection) -> Tuple[bool, int]:
        """Return what speaks for a description: that it looks good, and how much else says the same."""
        others = (each for each in self._indexed.values() if each.number != connection.number)
        alike = any((each.kind, each.md5) == (connection.kind, connection.md5) for each in others)
        return connection.plausible, connection.agrees + alike

    def _meet(self, connection: Connection, position: int) -> None:
        """Remember a connection; of its two descriptions, in a chunk and in the index, the one that looks good.

        Args:
            connection: as it is described.
            position: of its record, or of the chunk with it.
        """
        if connection.number > LARGEST_NUMBER:  # nobody could read the bag that has it
            damage = Damage(position, 0, f"a connection has the number {connection.number}", 0)
            self._damages += [damage] if damage not in self._damages else []  # an index is read twice
            return
        known = self._connections.get(connection.number)
        if known is None or (connection.plausible and not known.plausible):
            self._connections[connection.number] = connection
        if connection.plausible:
            self._settled.add(connection.number)

    # --- chunks without an end, or without a beginning ------------------------------------------------------------

    def _lost_loose(
        self, position: int, entries: Entries, kept: Kept, *, whole: bool, placed: Optional[List[Row]] = None
    ) -> Optional[int]:
        """Return the same of a chunk that ends where the next place was found: all bytes before that were passed over.

        There may have been another chunk in them, and the index may be that one's: unless it has what was kept, or the
        bag's index names all chunks, nobody knows.

        Args:
            position: of the chunk.
            entries: the index at the next place.
            kept: before it.
            whole: whether all of the data was there.
            placed: what was kept as the index must have it, if it is that of a chunk at the position; None: as it is.
        """
        if self._is_all_named or (whole and not kept.gaps and not entries.parts):
            return self._lost(position, entries, kept, whole=whole)
        found = set(kept.rows if placed is None else placed)
        return self._lost(position, entries, kept, whole=whole) if found and found.issubset(entries.rows()) else None

    @property
    def _is_all_named(self) -> bool:
        """Return whether the bag's index is known to name each chunk: the next place is never behind one of them."""
        return len(self._told) == self._chunk_count > 0

    def _keep_loose(self, position: int, head: ChunkHead, *, known: bool) -> int:
        """Keep what is there of a chunk that was not finished, that is cut, or whose length is damaged."""
        if head.stored and head.data + head.stored <= self._size:
            end = self._keep_ended(position, head, known=known)
            if end:
                return end
        stop = self._next_place(head.data)
        entries = self._entries(position, stop)
        raw = self._reader.read(head.data, min(stop - head.data, self._memory))
        data, whole = unpacked(head.compression, raw, self._memory)
        if head.compression == "lz4" and not whole and stop < self._size:
            data = b""
        kept = salvaged(data, list(entries.rows()) or None)
        self._add(position, stop, entries.end, kept, data, head._replace(size=-1))
        ended = bool(entries.parts) or stop == self._size >= head.data + head.stored  # else something is missing
        whole = whole and ended and len(raw) == stop - head.data
        if stop < self._size or entries.parts or not whole or kept.gaps:
            plain = head.compression == "none" and kept.gaps and not entries.parts
            begin = head.data + kept.gaps[0][0] if plain else position
            if stop == self._size:  # where something is kept behind it, it is not the end that is damaged
                behind = kept.gaps and kept.rows and kept.rows[-1][2] > kept.gaps[0][0]
                begin = position if behind else max(begin, head.data)
            self._damage(begin, stop, "a chunk is not whole", self._lost_loose(position, entries, kept, whole=whole))
        return entries.end

    def _keep_ended(self, position: int, head: ChunkHead, *, known: bool) -> int:
        """Keep a chunk that is good although what should follow it does not; return where what follows ends, or 0."""
        end = head.data + head.stored
        try:
            check_memory(head.stored, self._memory)
            data = decompressed(head.compression, self._reader.read(head.data, head.stored), head.size, self._memory)
        except RecordError:
            return 0
        kept = salvaged(data)
        if kept.gaps or self._next_found(max(head.data, end - _OVERLAP)) < end:  # it has fewer bytes than it says
            return 0
        stop = self._next_place(end)
        behind = self._reader.read(end, min(stop - end, self._memory))
        other = bool(salvaged(behind).rows) or any(magic in behind for magic, _ in _FRAMES)
        entries = Entries((), end, trusted=False, foreign=False) if other else self._entries(position, stop)
        self._add(position, end, entries.end, kept, data, head if known else head._replace(size=-1))
        if not other:
            lost = self._lost(position, Entries((), end, trusted=False, foreign=False), kept, whole=True)
            missing = len(kept.index_bytes()) - (entries.end - end)
            if not self._is_all_named and missing and (missing < 0 or stop < self._size):
                lost = None  # there was more, or less, than this index
            self._damage(end, stop, "the index behind a chunk is damaged, it was made anew", lost)
        return entries.end

    def _lost_way(self, position: int, what: str) -> int:
        """Go on behind what is no record; keep the messages there of a chunk whose header is destroyed."""
        stop = self._next_place(position + 1)
        if 0 < self._index_at <= position or self._is_index_due(position):
            self._damage(position, stop, "the index is damaged or cut", 0)
            return stop
        entries, before = self._entries(position, stop), self._before
        kept, data, placed = self._headless(position, stop, entries)
        if kept.rows:
            self._add(position, stop, entries.end, kept, data, ChunkHead("none", position, stop - position, -1))
        lost = self._lost_loose(position, entries, kept, whole=False, placed=placed)
        if not kept.rows and entries.parts and before.issuperset(row[:2] for row in entries.rows()):
            lost = 0  # it is the rest of the index of the chunk before, all of which was looked at
        self._damage(position, stop, what, lost)
        return entries.end

    def _is_index_due(self, position: int) -> bool:
        """Return whether the index should begin here: the header says so, and all chunks that it counts were met."""
        return position == self._said_at and len(self._visited) == self._chunk_count

    def _headless(self, position: int, stop: int, entries: Entries) -> Tuple[Kept, Any, List[Row]]:
        """Return the messages of a chunk whose header is destroyed, the data that they are in, and where in the chunk.

        The last are places for a header of its usual size; without one, what was passed over is more than a header.
        """
        rows = [(*row[:2], -1) for row in entries.rows()]  # where its data began is not known
        raw = self._reader.read(position, min(stop - position, self._memory))
        for magic, kind in _FRAMES:
            begin = raw.find(magic, 0, _BEGINNING)
            if begin >= 0:
                data, whole = unpacked(kind, raw[begin:], self._memory)
                if len(data) and (whole or kind == "bz2"):
                    kept = salvaged(data, list(entries.rows()) or None)
                    return kept, data, kept.rows if begin == len(chunk_header(kind, 0, 0)) else []
        kept, header = salvaged(raw, rows or None), len(chunk_header("none", 0, 0))
        return kept, raw, [(t_ns, connection, offset - header) for t_ns, connection, offset in kept.rows]

    def _add(self, position: int, end: int, index_end: int, kept: Kept, data: Any, head: ChunkHead) -> None:
        """Keep messages of a chunk that cannot stay as it is."""
        self._learn(kept, position)
        if not kept.rows:
            return
        self._before = frozenset(row[:2] for row in kept.rows)
        new, wrong = None, [each.number for each in self._contradicted(kept, self._connections)]
        good = {number: self._connections[number] for number in wrong}
        kept = kept._replace(connections={**kept.connections, **good})
        if wrong or kept.gaps or kept.end != len(data) or len(data) != head.size:
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

    # --- where the next record is ---------------------------------------------------------------------------------

    def _next_place(self, begin: int) -> int:
        """Return where, from a place on, the next record stands that is in no chunk, or the end of the file."""
        return min([self._next_found(begin), *(place for place in self._told if place >= begin)])

    def _next_found(self, begin: int) -> int:
        while begin < self._size:
            window = self._reader.read(begin, _SEARCH)
            for start in headers(window, 0, (INDEX, CHUNK, CHUNK_INFO)):
                if self._is_outer(begin + start):
                    return begin + start
            if begin <= self._index_at < begin + len(window):
                return self._index_at
            if begin + len(window) >= self._size:
                break
            begin += len(window) - _OVERLAP
        return self._size

    def _is_outer(self, position: int) -> bool:
        try:
            record = self._reader.record(position)
            if record.op == INDEX:
                record.number(b"conn")
                return record.end <= self._size and record.size == INDEX_ENTRY * record.number(b"count")
            if record.op == CHUNK_INFO:
                return record.end <= self._size and record.number(b"chunk_pos") < position
        except _BROKEN:
            return False
        return self._is_chunk(position)

    def _is_chunk(self, position: int) -> bool:
        """Return whether a chunk begins at a place: its header is one, and its beginning or its end is."""
        if position in self._told:
            return True
        try:
            head = chunk_head(self._reader.record(position))
            if head.compression not in COMPRESSIONS:
                return False
            end = head.data + head.stored
            if head.stored and end <= self._size and self._is_behind(end):
                return True
            if head.compression != "none":
                return self._kind_at(head.data) == head.compression or head.data == self._size
            return self._reader.op(head.data) in (MESSAGE, CONNECTION) or head.data >= self._size - 8
        except _BROKEN:
            return False
