"""One bag as a recording: the only module that knows the `rosbags` library, 0.9 on Python 3.8 and 0.11 on newer ones.

The library reads the index; the order of messages and what happens to damaged ones is ours. Messages of a topic are in
the order (time, publisher, position in the file): the same whatever the compression, the library and the numbers that a
writer gave to its connections.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

from rosbags.rosbag1 import Reader, ReaderError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from .chunks import ChunkCache
from .errors import BagError, MessageError

__all__ = ["Entry", "Recording", "Topic"]

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


class Recording:
    """A bag that is open for reading.

    Args:
        path: of the bag.

    Raises:
        BagError: It is no bag, not indexed, encrypted, of another version, or its index is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._reader = _opened(path)
        self._chunks = ChunkCache(self._reader)
        self._connections: Dict[int, Any] = {each.id: each for each in self._reader.connections}
        self._decoders: Dict[int, _Decode] = {}
        self.topics: Tuple[Topic, ...] = tuple(self._topics())

    def __enter__(self) -> Recording:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    @property
    def start_ns(self) -> Optional[int]:
        """Time of the first message; None when there is none."""
        return min((topic.first_ns for topic in self.topics if topic.messages), default=None)

    @property
    def end_ns(self) -> Optional[int]:
        """Time of the last message; None when there is none."""
        return max((topic.last_ns for topic in self.topics if topic.messages), default=None)

    def entries(self, topic: str) -> List[Entry]:
        """Return all messages of a topic in the order of the recording, from the index alone."""
        found: List[Entry] = []
        for rank, connections in enumerate(self._publishers(topic)):
            for connection in connections:
                for t_ns, chunk, offset in self._reader.indexes.get(connection, ()):
                    found.append(Entry(t_ns, rank, chunk, offset, connection))
        found.sort()
        return found

    def message(self, entry: Entry) -> Any:
        """Return one message, decoded by the definition that the bag carries.

        Raises:
            MessageError: It is damaged.
        """
        raw = self._chunks.message(entry.chunk, entry.offset)
        try:
            decode = self._decoders.get(entry.connection) or self._decoder(entry.connection)
            return decode(raw)
        except Exception as error:  # the library raises whatever its generated code meets
            kind = _ros1_kind(self._connections[entry.connection].msgtype)
            raise MessageError(f"{kind} cannot be decoded: {error or type(error).__name__}") from error

    def _decoder(self, connection: int) -> _Decode:
        kind = self._connections[connection].msgtype
        definition = self._connections[connection].msgdef
        store: Any = get_typestore(Stores.EMPTY)  # one per connection: two publishers may define one type differently
        text = getattr(definition, "data", definition)  # a str in 0.9, an object in 0.11
        store.register(get_types_from_msg(text, kind))
        self._decoders[connection] = lambda raw: store.deserialize_ros1(raw, kind)
        return self._decoders[connection]

    def _publishers(self, topic: str) -> List[List[int]]:
        """Return the connections of a topic by publisher, publishers by name."""
        names: Dict[str, List[int]] = {}
        for connection in self._connections.values():
            if connection.topic == topic:
                names.setdefault(connection.ext.callerid or "", []).append(connection.id)
        return [names[name] for name in sorted(names)]

    def _topics(self) -> List[Topic]:
        topics: Dict[str, Topic] = {}
        for connection in self._connections.values():
            times = [entry.time for entry in self._reader.indexes.get(connection.id, ())]
            first, last = (min(times), max(times)) if times else (0, 0)
            topic = Topic(connection.topic, _ros1_kind(connection.msgtype), len(times), first, last)
            topics[topic.name] = _joined(topics[topic.name], topic) if topic.name in topics else topic
        return [topics[name] for name in sorted(topics)]


def _joined(one: Topic, other: Topic) -> Topic:
    if not one.messages or not other.messages:
        return one if one.messages else other
    first, last = min(one.first_ns, other.first_ns), max(one.last_ns, other.last_ns)
    return one._replace(messages=one.messages + other.messages, first_ns=first, last_ns=last)


def _ros1_kind(kind: str) -> str:
    return kind.replace("/msg/", "/")


def _opened(path: Path) -> Any:
    if not path.is_file():
        raise BagError(str(path), "is no file", "name a bag")
    try:
        reader = Reader(path)
        reader.open()
    except OSError as error:
        raise BagError(str(path), f"cannot be read ({error.strerror})", "name a bag that you may read") from error
    except ReaderError as error:
        raise BagError(str(path), _without_dot(str(error)), _remedy(str(error))) from error
    except Exception as error:  # a damaged index may raise anything, bare AssertionError included
        words = f"the index is damaged ({type(error).__name__}{': ' if str(error) else ''}{error})"
        raise BagError(str(path), words, "make a new one with `rosbag reindex`") from error
    return reader


def _without_dot(text: str) -> str:
    return text[:1].lower() + text[1:].rstrip(".")


def _remedy(text: str) -> str:
    if "not indexed" in text or "index" in text:
        return "make a new index with `rosbag reindex`"
    if "version" in text:
        return "convert it with `rosbag fix` or `rosbag migrate`"
    if "encrypt" in text:
        return "decrypt it with `rosbag decompress` and its key"
    return "name a ROS 1 bag of version 2.0"
