"""One bag as a recording: topics, the order of their messages, and their values.

Messages of a topic are in the order (time, publisher, position in the file): the same whatever the compression and the
numbers that a writer gave to its connections. Single messages are decoded by the `rosbags` library, 0.9 on Python 3.8
and 0.11 on newer ones; numbers of many messages at once by `columns`, which says the same.

A bag is opened by our own index, which is fast, and by the rosbags library where that refuses: what our index is strict
about the library may still read; what neither reads our index has the words for, the same as in `amaze-bag`.
"""

from __future__ import annotations

import struct
from collections import OrderedDict
from contextlib import suppress
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, Callable, Collection, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from .arrays import SetBack, by_connection, set_back
from .columns import WHOLE, Wanted, read_columns, wanted_of
from .definitions import types_of
from .errors import BagError, MessageError, NotABagError, OtherBagError, UndecodableError
from .format import MEMORY, decompressed, fields_of, read_at, record_at
from .index import Index, Messages, chunk_head, recovering
from .tapes import Tapes, tapes_of

# --- single messages --------------------------------------------------------------------------------------------------


_UINT32 = struct.Struct("<L")
_CONNECTION, _MESSAGE = 7, 2
_SMALL = 2048
_KEPT_BYTES = (
    64_000_000  # decompressed; recordings whose chunks overlap in time would else be decompressed over and over
)


class ChunkCache:
    """Reads messages by the position of their chunk and their offset in it.

    Args:
        load: returns the data of the chunk at a position, decompressed; raises what it likes.
        peek: returns some bytes from an offset in the data of a chunk on, without loading all of it; None where that
            cannot be, and it must be loaded.
    """

    def __init__(
        self, load: Callable[[int], bytes], peek: Callable[[int, int, int], Optional[bytes]] = lambda *_: None
    ) -> None:
        self._load, self._peek = load, peek
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._size = 0
        self._damaged: Dict[int, str] = {}

    def message(self, chunk: int, offset: int) -> bytes:
        """Return the bytes of one message.

        Raises:
            MessageError: The chunk or the record is damaged.
        """
        if chunk not in self._kept:
            found = self._peeked(chunk, offset)
            if found is not None:
                return found
        data = self._chunk(chunk)
        try:
            op, offset = _skip_header(data, offset)
            while op == _CONNECTION:
                op, offset = _skip_header(data, offset + 4 + _size(data, offset))
            start, size = offset + 4, _size(data, offset)
        except (struct.error, ValueError) as error:
            raise MessageError(f"record at {chunk}+{offset} is damaged: {error}") from error
        if op != _MESSAGE or start + size > len(data):
            raise MessageError(f"record at {chunk}+{offset} is no whole message")
        return data[start : start + size]

    def _peeked(self, chunk: int, offset: int) -> Optional[bytes]:
        """Return the bytes of a small message without its chunk; None when that is not to be had, or not good."""
        data = self._peek(chunk, offset, _SMALL)
        if data is None:
            return None
        try:
            op, place = _skip_header(data, 0)
            start, size = place + 4, _size(data, place)
        except (struct.error, ValueError, IndexError):
            return None
        return data[start : start + size] if op == _MESSAGE and start + size <= len(data) else None

    def _chunk(self, position: int) -> bytes:
        data = self._kept.get(position)
        if data is not None:
            self._kept.move_to_end(position)
            return data
        if position in self._damaged:
            raise MessageError(self._damaged[position])
        try:
            data = self._load(position)
        except Exception as error:  # the decompressors raise what they like
            self._damaged[position] = f"chunk at byte {position} is damaged: {error or type(error).__name__}"
            raise MessageError(self._damaged[position]) from error
        self._keep(position, data)
        return data

    def _keep(self, position: int, data: bytes) -> None:
        self._kept[position] = data
        self._size += len(data)
        while self._size > _KEPT_BYTES and len(self._kept) > 1:
            _, dropped = self._kept.popitem(last=False)
            self._size -= len(dropped)


def _size(data: bytes, offset: int) -> int:
    size: int = _UINT32.unpack_from(data, offset)[0]
    return size


def _skip_header(data: bytes, offset: int) -> Tuple[int, int]:
    """Return the kind of a record and where its data starts."""
    end = offset + 4 + _size(data, offset)
    offset += 4
    op = -1
    while offset < end:
        size = _size(data, offset)
        if data[offset + 4 : offset + 7] == b"op=":
            op = data[offset + 7]
        offset += 4 + size
    if offset != end:
        raise ValueError("header fields do not fit the header")
    return op, end


# --- a bag opened by our index, or by the rosbags library -------------------------------------------------------------


_Place = Tuple[Any, Any, Any]
_NO_ROWS: Any = np.zeros(0, np.int64)


class Link(NamedTuple):
    """A connection: its number, topic, publisher ("" when unknown), type as ROS 1 names it, and definition."""

    number: int
    topic: str
    caller: str
    kind: str
    definition: str
    md5: str = ""
    latching: bool = False


class Indexed:
    """A bag by its index.

    Args:
        path: of the bag.
        memory: bytes that the data of a chunk may take, decompressed.

    Raises:
        BagError: the index is not as it should be.
    """

    def __init__(self, path: Path, memory: int = MEMORY) -> None:
        self.index = Index(path, memory)
        try:
            self.messages: Messages = self.index.messages()
        except BagError:
            self.index.close()
            raise
        self._rows = by_connection(self.messages.connection)
        self._places: Dict[int, _Place] = {}
        self._chunk_positions: Any = np.array([chunk.position for chunk in self.index.chunks], np.int64)
        self._numbers = {chunk.position: number for number, chunk in enumerate(self.index.chunks)}
        self.links: Tuple[Link, ...] = tuple(
            Link(each.number, each.topic, each.caller, each.kind, _definition(each.header), each.md5, each.latching)
            for each in self.index.connections.values()
        )

    def rows(self, number: int) -> Any:
        """Return the places of a connection's messages in `messages`."""
        return self._rows.get(number, _NO_ROWS)

    def places(self, number: int) -> _Place:
        """Return times, positions of chunks, and offsets in them of a connection's messages."""
        if number not in self._places:
            rows, found = self.rows(number), self.messages
            self._places[number] = found.t_ns[rows], self._chunk_positions[found.chunk[rows]], found.offset[rows]
        return self._places[number]

    def load(self, position: int) -> bytes:
        """Return the data of a chunk, decompressed."""
        head = self.index.compressed_head(self._numbers[position])
        stored = read_at(self.index.file, head.stored, head.data)
        if len(stored) != head.stored:
            raise EOFError(f"{len(stored)} bytes of {head.stored}")
        return bytes(decompressed(head.compression, stored, head.size, self.index.memory))

    def peek(self, position: int, offset: int, size: int) -> Optional[bytes]:
        """Return up to some bytes from an offset in the data of a chunk on; None when it is compressed."""
        head = self.index.head(self._numbers[position])
        if head.compression != "none" or head.stored != head.size:
            return None
        return read_at(self.index.file, max(0, min(size, head.stored - offset)), head.data + offset)

    def close(self) -> None:
        """Close the file."""
        self.index.close()


class Library:
    """A bag by the rosbags library.

    Args:
        path: of the bag.
        memory: bytes that the data of a chunk may take, decompressed.

    Raises:
        BagError: the library cannot read it either.
    """

    def __init__(self, path: Path, memory: int = MEMORY) -> None:
        self._reader, self._memory = _reader(path), memory
        self.links: Tuple[Link, ...] = tuple(
            Link(
                each.id,
                each.topic,
                each.ext.callerid or "",
                each.msgtype.replace("/msg/", "/"),
                getattr(each.msgdef, "data", each.msgdef),  # a str in 0.9, an object in 0.11
                each.digest,
                bool(each.ext.latching),
            )
            for each in self._reader.connections
        )

    def places(self, number: int) -> _Place:
        """Return times, positions of chunks, and offsets in them of a connection's messages."""
        entries: List[Tuple[int, int, int]] = [tuple(each) for each in self._reader.indexes.get(number, ())]
        columns: Any = np.array(entries, np.int64).reshape(-1, 3)
        return columns[:, 0], columns[:, 1], columns[:, 2]

    def load(self, position: int) -> bytes:
        """Return the data of a chunk, decompressed."""
        chunk, file = self._reader.chunks[position], self._reader.bio
        file.seek(position)
        begin = file.read(chunk.datapos - position)
        head = chunk_head(record_at(begin, 0, len(begin)))
        file.seek(chunk.datapos)
        stored = file.read(chunk.datasize)
        if len(stored) != chunk.datasize:
            raise EOFError(f"{len(stored)} bytes of {chunk.datasize}")
        return bytes(decompressed(head.compression, stored, head.size, self._memory))

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


def opened(path: Path, memory: int = MEMORY) -> Any:
    """Open a bag: `Indexed` where that can be, else `Library`.

    Raises:
        BagError: it is no bag, not indexed, encrypted, of another version, or its index is damaged.
    """
    if (path / "metadata.yaml").is_file():
        words = "is the folder of a ROS 2 bag; rosbags-convert makes a ROS 1 bag of it"
        raise BagError(str(path), words, "name a ROS 1 bag of version 2.0")
    if not path.is_file():
        raise BagError(str(path), "is no file", "name a bag")
    try:
        return Indexed(path, memory)
    except BagError as error:
        if isinstance(error.__cause__, (NotABagError, OtherBagError)):
            raise
        with suppress(BagError):
            return Library(path, memory)
        raise


def _definition(header: bytes) -> str:
    fields: Dict[bytes, bytes] = fields_of(header, 0, len(header))
    return fields.get(b"message_definition", b"").decode("utf-8", "replace")


def _reader(path: Path) -> Any:
    from rosbags.rosbag1 import Reader  # noqa: PLC0415  (slow to load, and seldom wanted)

    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:  # a damaged index may raise anything, bare AssertionError included
        words = f"the rosbags library cannot read it ({error or type(error).__name__})"
        raise BagError(str(path), words, recovering(path)) from error
    return reader


# --- the recording ----------------------------------------------------------------------------------------------------


_Decode = Callable[[bytes], Any]


class Topic(NamedTuple):
    """One topic of a recording; `kind` is its type as ROS 1 names it, e.g. "sensor_msgs/Imu"."""

    name: str
    kind: str
    messages: int
    first_ns: int
    last_ns: int


class Entry(NamedTuple):
    """One message, not read yet. Entries of one topic sort into the order of the recording.

    Args:
        t_ns: when it was recorded.
        publisher: rank of its publisher among the topic's publishers, by name.
        chunk: where its chunk lies in the file.
        offset: where it lies in the chunk.
        connection: of the library.
    """

    t_ns: int
    publisher: int
    chunk: int
    offset: int
    connection: int


class Table(NamedTuple):
    """All messages of a topic in the order of the recording: arrays, named as in `Entry`."""

    t_ns: Any
    publisher: Any
    chunk: Any
    offset: Any
    connection: Any


class Numbers(NamedTuple):
    """Numbers of the messages of a topic.

    Args:
        messages: of the topic, in the order of its table.
        parts: places in that order, and a column for each path: of every connection that has them.
    """

    messages: int
    parts: Tuple[Tuple[Any, List[Any]], ...]

    def rows(self) -> List[Optional[Tuple[Any, ...]]]:
        """Return for each message the values; None where it has none."""
        found: List[Optional[Tuple[Any, ...]]] = [None] * self.messages
        for where, columns in self.parts:
            for place, values in zip(where.tolist(), zip(*map(_listed, columns))):
                found[place] = values
        return found

    def columns(self) -> Optional[List[Any]]:
        """Return a column for each path; None when a message has no values, or not all have the same types."""
        if sum(len(where) for where, _ in self.parts) != self.messages:
            return None
        if len({tuple(_type_of(column) for column in columns) for _, columns in self.parts}) != 1:
            return None
        if len(self.parts) == 1 and (np.diff(self.parts[0][0]) > 0).all():
            return self.parts[0][1]
        order = np.argsort(np.concatenate([where for where, _ in self.parts]), kind="stable")
        return [np.concatenate(each)[order] for each in zip(*(columns for _, columns in self.parts))]


def _listed(column: Any) -> List[Any]:
    """Return a column as Python's numbers or texts."""
    values: List[Any] = column.tolist()
    if column.dtype.kind != "S":
        return values
    known = {value: value.decode("ascii") for value in set(values)}
    return [known[value] for value in values]


def _type_of(column: Any) -> str:
    """Return the type of a column; texts of all lengths are of one."""
    return str(column.dtype.kind if column.dtype.kind == "S" else column.dtype.str)


class Recording:
    """A bag that is open for reading.

    Args:
        path: of the bag.
        memory: bytes that the data of a chunk may take, decompressed.

    Raises:
        BagError: It is no bag, not indexed, encrypted, of another version, or its index is damaged.
    """

    def __init__(self, path: Path, memory: int = MEMORY) -> None:
        self.path = path
        self._bag = opened(path, memory)
        self._chunks = ChunkCache(self._bag.load, *([self._bag.peek] if isinstance(self._bag, Indexed) else []))
        self._links: Dict[int, Link] = {each.number: each for each in self._bag.links}
        self._by_topic: Dict[str, List[Link]] = {}
        self._decoders: Dict[int, _Decode] = {}
        self._tapes = tapes_of(path)
        self._kept: Dict[Tuple[int, int], bytes] = {}
        self._tables: Dict[str, Table] = {}
        self.topics: Tuple[Topic, ...] = tuple(self._topics())

    def __enter__(self) -> Recording:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._bag.close()

    @property
    def links(self) -> Tuple[Link, ...]:
        """Its connections."""
        return tuple(self._links.values())

    @property
    def tapes(self) -> Optional[Tapes]:
        """Tapes of the bag; None where none are wanted."""
        return self._tapes

    @property
    def start_ns(self) -> Optional[int]:
        """Time of the first message; None when there is none."""
        return min((topic.first_ns for topic in self.topics if topic.messages), default=None)

    @property
    def end_ns(self) -> Optional[int]:
        """Time of the last message; None when there is none."""
        return max((topic.last_ns for topic in self.topics if topic.messages), default=None)

    @cached_property
    def set_back(self) -> Optional[SetBack]:
        """Whether its recorder's clock was set back, from the index alone."""
        return set_back(self._bag.places(number) for number in self._links)

    def entries(self, topic: str) -> List[Entry]:
        """Return all messages of a topic in the order of the recording, from the index alone."""
        return list(map(partial(tuple.__new__, Entry), zip(*(column.tolist() for column in self.table(topic)))))

    def table(self, topic: str) -> Table:
        """Return the same as arrays."""
        if topic not in self._tables:
            self._tables[topic] = self._table(topic)
        return self._tables[topic]

    def _table(self, topic: str) -> Table:
        parts: List[Tuple[Any, ...]] = []
        for rank, numbers in enumerate(self._publishers(topic)):
            for number in numbers:
                t_ns, chunk, offset = self._bag.places(number)
                parts.append((t_ns, np.full(len(t_ns), rank), chunk, offset, np.full(len(t_ns), number)))
        if not parts:
            return Table(*(np.zeros(0, np.int64) for _ in Table._fields))
        columns = list(parts[0]) if len(parts) == 1 else [np.concatenate(each) for each in zip(*parts)]
        if (np.diff(columns[0]) > 0).all():
            return Table(*columns)
        order = np.lexsort(tuple(reversed(columns)))
        return Table(*(column[order] for column in columns))

    def message(self, entry: Entry) -> Any:
        """Return one message, decoded by the definition that the bag carries.

        Raises:
            MessageError: It is damaged.
        """
        raw = self._kept.get((entry.chunk, entry.offset))
        if raw is None:
            raw = self._chunks.message(entry.chunk, entry.offset)
        try:
            decode = self._decoders.get(entry.connection) or self._decoder(entry.connection)
            return decode(raw)
        except Exception as error:  # the library raises whatever its generated code meets
            kind = self._links[entry.connection].kind
            raise UndecodableError(f"{kind} cannot be decoded: {error or type(error).__name__}") from error

    def raw(self, entry: Entry) -> bytes:
        """Return one message as it was recorded.

        Raises:
            MessageError: It is damaged.
        """
        return self._chunks.message(entry.chunk, entry.offset)

    def link(self, connection: int) -> Link:
        """Return what is known of a connection."""
        return self._links[connection]

    def caller(self, connection: int) -> str:
        """Return the node that published on a connection; empty when unknown."""
        return self._links[connection].caller

    def columns(self, wanted: Mapping[str, Sequence[str]]) -> Dict[str, List[Optional[Tuple[Any, ...]]]]:
        """Return numbers of all messages of some topics, much faster than message by message.

        Args:
            wanted: by topic, paths of numbers in its messages, e.g. "pose.pose.position.z" or "values[5]".

        Returns:
            By topic, for each of its entries the values of the paths; None where `message` must be asked: it is
            damaged, or irregular. Topics of which no message has these paths as columns are left out.
        """
        return {topic: found.rows() for topic, found in self.numbers(wanted).items()}

    def numbers(self, wanted: Mapping[str, Sequence[str]], texts: Collection[str] = ()) -> Dict[str, Numbers]:
        """Return the same, not yet put into rows; of the topics in `texts` the paths may be those of texts, too.

        The path `columns.WHOLE` is that of the message itself, whatever it holds.
        """
        if not isinstance(self._bag, Indexed):
            return {}
        numbers: Dict[int, Wanted] = {}
        for topic, paths in wanted.items():
            for link in self._links.values():
                if link.topic == topic:
                    found = wanted_of(link.definition, link.kind, tuple(paths), texts=topic in texts)
                    numbers.update({} if found is None else {link.number: found})
        read = self._columns(numbers) if numbers else {}
        topics = [topic for topic in wanted if any(self._links[number].topic == topic for number in read)]
        return {topic: self._placed(topic, read) for topic in topics}

    def _columns(self, wanted: Dict[int, Wanted]) -> Dict[int, Tuple[Any, List[Any]]]:
        """Return columns from a tape; without one, read them, and keep them where tapes are wanted."""
        if self._tapes is None:
            return read_columns(self._bag.index, self._bag.messages, wanted)
        taped = {number: each for number, each in wanted.items() if each.paths != WHOLE}
        what = {number: each.paths for number, each in taped.items()}
        found = self._tapes.columns(what)
        if found is None:
            found = read_columns(self._bag.index, self._bag.messages, taped)
            self._tapes.keep_columns(what, found)
        rest = {number: each for number, each in wanted.items() if each.paths == WHOLE}
        return {**found, **(read_columns(self._bag.index, self._bag.messages, rest) if rest else {})}

    def keep(self, topics: Sequence[str]) -> None:
        """Make `message` of some topics fast where tapes are wanted: all of them will be asked for."""
        topics = [topic.name for topic in self.topics if topic.name in topics]
        if self._tapes is None or not topics:
            return
        kept = self._tapes.messages(topics)
        if kept is None:
            kept = {}
            for entry in (entry for topic in topics for entry in self.entries(topic)):
                with suppress(MessageError):  # `message` says what is wrong with it
                    kept[entry.chunk, entry.offset] = self._chunks.message(entry.chunk, entry.offset)
            self._tapes.keep_messages(topics, kept)
        self._kept.update(kept)

    def _placed(self, topic: str, read: Dict[int, Tuple[Any, List[Any]]]) -> Numbers:
        """Return numbers with their places in the order of the entries."""
        table = self.table(topic)
        parts: List[Tuple[Any, List[Any]]] = []
        for number, (rows, columns) in read.items():
            if self._links[number].topic != topic:
                continue
            own = np.flatnonzero(table.connection == number)  # same messages in another order
            places = self._bag.rows(number)
            t_ns, chunk, offset = self._bag.places(number)
            rank = own
            if not (np.diff(t_ns) > 0).all():
                rank = np.empty(len(places), np.int64)
                rank[np.lexsort((offset, chunk, t_ns))] = own
            parts.append((rank if np.array_equal(places, rows) else rank[np.searchsorted(places, rows)], columns))
        return Numbers(len(table.t_ns), tuple(parts))

    def _decoder(self, connection: int) -> _Decode:
        link = self._links[connection]
        self._decoders[connection] = _decoder(link.kind.replace("/", "/msg/"), link.definition)
        return self._decoders[connection]

    def _publishers(self, topic: str) -> List[List[int]]:
        """Return the connections of a topic by publisher, publishers by name."""
        if not self._by_topic:
            for link in self._links.values():
                self._by_topic.setdefault(link.topic, []).append(link)
        names: Dict[str, List[int]] = {}
        for link in self._by_topic.get(topic, ()):
            names.setdefault(link.caller, []).append(link.number)
        return [names[name] for name in sorted(names)]

    def _topics(self) -> List[Topic]:
        topics: Dict[str, Topic] = {}
        for link in self._links.values():
            times = self._bag.places(link.number)[0]
            first, last = (int(times.min()), int(times.max())) if len(times) else (0, 0)
            topic = Topic(link.topic, link.kind, len(times), first, last)
            topics[topic.name] = _joined(topics[topic.name], topic) if topic.name in topics else topic
        return [topics[name] for name in sorted(topics)]


@lru_cache(maxsize=256)
def _decoder(kind: str, definition: str) -> _Decode:
    """Return what decodes messages of a type; two publishers may define one type differently."""
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415  (slow to load)

    store: Any = get_typestore(Stores.EMPTY)
    store.register(types_of(definition, kind))
    return lambda raw: store.deserialize_ros1(raw, kind)


def _joined(one: Topic, other: Topic) -> Topic:
    if not one.messages or not other.messages:
        return one if one.messages else other
    first, last = min(one.first_ns, other.first_ns), max(one.last_ns, other.last_ns)
    return one._replace(messages=one.messages + other.messages, first_ns=first, last_ns=last)
