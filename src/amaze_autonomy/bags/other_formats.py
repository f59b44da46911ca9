"""Recordings that are no ROS 1 bags, with the face of one: MCAP, ROS 2 bags, ULog. Recognised by content.

MCAP files (of ROS 2 and of ROS 1) are read by their index, so that a message costs its own chunk; the bag of ROS 2 is a
folder of MCAP or SQLite files, or one of those alone. Messages are decoded by the rosbags library, with the definitions
in the file; SQLite files of before 2023 have none, then those of ROS 2 Humble are taken. A ULog is read by pyulog, its
topics are named and typed as PX4's are in ROS 2: `/vehicle_status`, px4_msgs/VehicleStatus. Its clock starts when PX4
does; where its GPS tells the time of day, all times are that.
"""

from __future__ import annotations

import re
import sqlite3
import struct
from collections import Counter
from contextlib import redirect_stdout
from functools import cached_property
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple
from urllib.parse import quote

import numpy as np

from amaze_autonomy.files import is_stream

from .arrays import SetBack, set_back
from .definitions import types_of
from .errors import BagError, MessageError, UndecodableError, cut_words
from .format import MEMORY
from .index import ChunkHead
from .mcap_files import MCAP, NONE, Channel, Part, Places, lacking, mcap_part, ros1_name, unzstd
from .recording import Entry, Topic

__all__ = ["Channel", "OtherRecording", "content_files", "is_other", "other_recording"]

_SQLITE, _ULOG = b"SQLite format 3\x00", b"ULog\x01\x12\x35"
_METADATA = "metadata.yaml"
_OF_ULOG = "ulog"


class OtherRecording:
    """A recording of another format, open for reading, with the face of `Recording`.

    Args:
        path: of the file or folder.
        version: what it is, for people.
        channels: by number.
        places: by number, times, positions of chunks, and offsets in them of its messages.
        raw: returns a message by channel, position and offset; raises `MessageError`.
        heads: of its chunks.
        close: closes its files.
        problem: what of it is missing, and what to do; empty: nothing.
        cut: likewise, where nothing but its end is missing.
    """

    def __init__(
        self,
        path: Path,
        version: str,
        channels: Mapping[int, Channel],
        places: Mapping[int, Places],
        raw: Callable[[int, int, int], Any],
        heads: Sequence[ChunkHead] = (),
        close: Callable[[], None] = lambda: None,
        problem: str = "",
        cut: str = "",
    ) -> None:
        self.path, self.version, self.channels, self.heads = path, version, channels, tuple(heads)
        self._places, self._raw, self._close, self.problem, self.cut = places, raw, close, problem, cut
        self._decoders: Dict[int, Callable[[Any], Any]] = {}
        self._entries: Dict[str, List[Entry]] = {}
        self.topics: Tuple[Topic, ...] = tuple(self._topics())

    def __enter__(self) -> OtherRecording:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close its files."""
        self._close()

    @property
    def start_ns(self) -> Optional[int]:
        """Time of the first message; None when there is none."""
        return min((topic.first_ns for topic in self.topics if topic.messages), default=None)

    @property
    def end_ns(self) -> Optional[int]:
        """Time of the last message; None when there is none."""
        return max((topic.last_ns for topic in self.topics if topic.messages), default=None)

    @property
    def bytes(self) -> int:
        """The size of its files."""
        files = [self.path] if self.path.is_file() else [each for each in self.path.iterdir() if each.is_file()]
        return sum(each.stat().st_size for each in files)

    @cached_property
    def set_back(self) -> Optional[SetBack]:
        """Whether its recorder's clock was set back; that of a ULog counts from the start of PX4."""
        recorded = (number for number, channel in self.channels.items() if channel.encoding != _OF_ULOG)
        return set_back(self._places[number] for number in recorded if number in self._places)

    def times(self) -> Tuple[Any, Any]:
        """Return time and channel of every message."""
        numbers = [np.full(len(places[0]), number) for number, places in self._places.items()]
        times = [places[0] for places in self._places.values()]
        return np.concatenate([NONE, *times]), np.concatenate([NONE, *numbers])

    def entries(self, topic: str) -> List[Entry]:
        """Return all messages of a topic in their order."""
        if topic not in self._entries:
            found: List[Entry] = []
            for number, channel in self.channels.items():
                if channel.topic == topic:
                    columns = (column.tolist() for column in self._places.get(number, (NONE,) * 3))
                    found += [Entry(t_ns, 0, chunk, offset, number) for t_ns, chunk, offset in zip(*columns)]
            self._entries[topic] = sorted(found)
        return self._entries[topic]

    def raw(self, entry: Entry) -> Any:
        """Return one message as it was recorded.

        Raises:
            MessageError: It is damaged.
        """
        return self._raw(entry.connection, entry.chunk, entry.offset)

    def message(self, entry: Entry) -> Any:
        """Return one message, decoded.

        Raises:
            MessageError: It is damaged, or of an encoding that is not read.
        """
        raw = self.raw(entry)
        channel = self.channels[entry.connection]
        if channel.encoding == _OF_ULOG:
            return raw
        try:
            if entry.connection not in self._decoders:
                self._decoders[entry.connection] = _decoder(channel)
            return self._decoders[entry.connection](raw)
        except MessageError:
            raise
        except Exception as error:  # the library raises whatever its generated code meets
            raise UndecodableError(f"{channel.kind} cannot be decoded: {error or type(error).__name__}") from error

    def columns(self, wanted: Mapping[str, Any]) -> Dict[str, Any]:  # noqa: ARG002 - the face of a bag
        """Return nothing: every message is read by itself."""
        return {}

    def _topics(self) -> Iterator[Topic]:
        kinds = {channel.topic: channel.kind for channel in self.channels.values()}
        for name in sorted(kinds):
            own = [number for number, channel in self.channels.items() if channel.topic == name]
            times = np.concatenate([NONE, *(self._places[number][0] for number in own if number in self._places)])
            first, last = (int(times.min()), int(times.max())) if len(times) else (0, 0)
            yield Topic(name, kinds[name], len(times), first, last)


def is_other(path: Path) -> bool:
    """Return whether a file or folder is of a format that is read here."""
    return path.is_dir() or bool(_format(path))


def content_files(path: Path) -> List[Path]:
    """Return the files that hold the messages of a recording: itself, or those of a folder as its metadata lists them.

    Without metadata they are in the order of their names.

    Raises:
        BagError: It is a folder without a recording, or lacks one of its files.
    """
    return _files_of(path)[0] if path.is_dir() else [path]


def other_recording(path: Path, memory: int = MEMORY) -> OtherRecording:
    """Open a recording that is no ROS 1 bag.

    Args:
        path: of the file, or of the folder of a ROS 2 bag.
        memory: bytes that a chunk may take, decompressed.

    Raises:
        BagError: It cannot be read, or is damaged.
    """
    if path.is_dir():
        return _joined(path, *_files_of(path), memory)
    kind = _format(path)
    return _ulog(path) if kind is _ULOG else _joined(path, [path], "", memory)


def _format(path: Path) -> bytes:
    if is_stream(path):
        return b""
    try:
        with path.open("rb") as file:
            begin = file.read(16)
    except OSError:
        return b""
    return next((magic for magic in (MCAP, _SQLITE, _ULOG) if begin.startswith(magic)), b"")


# --- ROS 2 bags and MCAP ----------------------------------------------------------------------------------------------


def _files_of(folder: Path) -> Tuple[List[Path], str]:
    """Return the files of a ROS 2 bag, and how each message in them is compressed."""
    import yaml  # noqa: PLC0415  (only for these)

    place = folder / _METADATA
    if not place.is_file():
        files = sorted(each for each in folder.iterdir() if each.is_file() and _format(each) in (MCAP, _SQLITE))
        if not files:
            raise BagError(str(folder), "is a folder without a recording", "name a bag, or the folder of a ROS 2 bag")
        return files, ""
    try:
        about = yaml.safe_load(place.read_text("utf-8"))["rosbag2_bagfile_information"]
        files = [folder / Path(name).name for name in about["relative_file_paths"]]
        mode = str(about.get("compression_mode") or "").lower()
    except (OSError, yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        raise BagError(str(place), "does not describe a ROS 2 bag", "name the file in its folder instead") from error
    missing = [each.name for each in files if not each.is_file()]
    if missing:
        raise BagError(str(folder), f"lacks its {', '.join(missing)}", "name the files that are there, one by one")
    if mode == "file":
        raise BagError(
            str(folder), "has files that are compressed as a whole", "unpack them: zstd -d FILE, then name one"
        )
    return files, "zstd" if mode == "message" else ""


def _joined(path: Path, files: Sequence[Path], compressed: str, memory: int) -> OtherRecording:
    """Return several files as one recording; `compressed`: how each message is."""
    parts: List[Part] = []
    try:
        parts.extend(
            {MCAP: mcap_part, _SQLITE: _sqlite}.get(_format(file), _unreadable)(file, memory) for file in files
        )
    except BaseException:
        for part in parts:
            part.close()
        raise
    channels: Dict[int, Channel] = {}
    places: Dict[int, Places] = {}
    raws: Dict[int, Callable[[int, int], bytes]] = {}
    for part in parts:
        for own, channel in part.channels.items():
            number = len(channels)
            channels[number], raws[number] = channel, part.raw
            places[number] = part.places.get(own, (NONE,) * 3)

    def raw(number: int, chunk: int, offset: int) -> bytes:
        data = raws[number](chunk, offset)
        if not compressed:
            return data
        try:
            return unzstd(data, memory)
        except Exception as error:  # the decompressor raises what it likes
            raise MessageError(f"a message is damaged: {error or type(error).__name__}") from error

    def close() -> None:
        for part in parts:
            part.close()

    version = " and ".join(dict.fromkeys(part.version for part in parts)) + (", folder" if path.is_dir() else "")
    heads = [head for part in parts for head in part.heads]
    problem = "; ".join(part.problem for part in parts if part.problem)
    return OtherRecording(path, version, channels, places, raw, heads, close, problem)


def _unreadable(path: Path, _: int) -> Part:
    raise BagError(str(path), "is neither MCAP nor SQLite", "name a ROS 2 bag")


def _sqlite(path: Path, _: int) -> Part:
    """Open an SQLite file of a ROS 2 bag; one that a recorder did not close is read as far as it goes."""
    open_log = path.with_name(f"{path.name}-wal")
    how = "mode=ro" if open_log.is_file() and open_log.stat().st_size else "mode=ro&immutable=1"
    try:
        base = sqlite3.connect(f"file:{quote(str(path.resolve()))}?{how}", uri=True)
        topics = base.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id").fetchall()
        rows: Any = np.array(
            base.execute("SELECT topic_id, timestamp, id FROM messages ORDER BY timestamp, id").fetchall(), np.int64
        ).reshape(-1, 3)
        tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        told = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        definitions = {row[0]: row[1:] for row in base.execute(told)} if "message_definitions" in tables else {}
    except sqlite3.Error as error:
        raise BagError(str(path), f"is no readable SQLite file of a ROS 2 bag ({error})", "name another") from error
    channels = {
        number: Channel(name, ros1_name(kind), "", encoding, *definitions.get(kind, ("", "")))
        for number, name, kind, encoding in topics
    }
    places: Dict[int, Places] = {
        number: (own[:, 1], np.zeros(len(own), np.int64), own[:, 2])
        for number in channels
        for own in (rows[rows[:, 0] == number],)
    }

    def raw(_: int, row: int) -> bytes:
        try:
            data: bytes = base.execute("SELECT data FROM messages WHERE id = ?", (row,)).fetchone()[0]
        except sqlite3.Error as error:
            raise MessageError(f"row {row} is damaged: {error}") from error
        return data

    return Part("ROS 2 (SQLite)", channels, places, raw, (), base.close)


_KNOWN = {  # to some writers
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/msg/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
}


def _decoder(channel: Channel) -> Callable[[Any], Any]:
    """Return what decodes the messages of a channel, by its definition."""
    from rosbags.typesys import Stores, get_types_from_idl, get_typestore  # noqa: PLC0415  (slow to load)

    if channel.encoding not in ("cdr", "ros1"):
        raise UndecodableError(f"messages in {channel.encoding or 'no encoding'} are not read")
    kind = channel.kind.replace("/", "/msg/")
    store: Any = get_typestore(Stores.EMPTY if channel.definition else Stores.ROS2_HUMBLE)
    if not channel.definition:
        if kind not in store.types:
            raise UndecodableError(f"its type {channel.kind} is not defined in the file, and not one of ROS 2's own")
    else:
        idl = channel.schema == "ros2idl"
        types = get_types_from_idl(channel.definition) if idl else types_of(channel.definition, kind)
        for name, text in _KNOWN.items():
            types.setdefault(name, types_of(text, name)[name])
        store.register(types)
    read = store.deserialize_ros1 if channel.encoding == "ros1" else store.deserialize_cdr
    return lambda raw: read(raw, kind)


# --- ULog -------------------------------------------------------------------------------------------------------------


_ULOG_HEADER, _ULOG_NAME = 16, 6  # where the first record begins; in one of kind A, the name of the topic
_APPENDED = struct.Struct("<3Q")  # in the flags: where data was appended after a crash
_GPS = ("vehicle_gps_position", "sensor_gps")
_TEXTS = "/logged_messages"
_LATEST_US = 1 << 53  # after 285 years; where a record was damaged, what is found behind it may be no text
_FIX_3D = 3
_STEP = re.compile(r"\w+|\[\d+\]")


def _parsed(path: Path, data: bytes) -> Tuple[Any, List[str]]:
    """Return what pyulog reads of a ULog, and the topics that were left out, as their messages have no time.

    Raises:
        BagError: It cannot be read.
    """
    try:
        from pyulog.core import ULog, ULogException  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise lacking(path, "a ULog of PX4", "ulog") from error
    try:
        with redirect_stdout(StringIO()):  # it prints what it thinks of the file
            log: Any = ULog(str(path))
            timeless = _timeless(log, data)
            if timeless:  # at the first message of one, pyulog would end
                log = ULog(str(path), [name for name in log.message_formats if name not in timeless])
    except (ULogException, OSError, ValueError, IndexError, KeyError, struct.error, TypeError) as error:
        raise BagError(str(path), f"is a damaged ULog ({error or type(error).__name__})", "name another") from error
    if log.file_corruption and not log.data_list:
        raise BagError(str(path), "is a damaged ULog: nothing in it can be read", "name another")
    return log, timeless


def _ulog(path: Path) -> OtherRecording:
    """Open a ULog: pyulog reads all of it."""
    data = path.read_bytes()
    log, timeless = _parsed(path, data)
    offset_ns = _day_ns(log)
    channels: Dict[int, Channel] = {}
    places: Dict[int, Places] = {}
    for number, each in enumerate(log.data_list):
        times = each.data["timestamp"].astype(np.int64) * 1000 + offset_ns
        order = np.argsort(times, kind="stable")
        channels[number] = Channel(
            _ulog_topic(each.name, each.multi_id), f"px4_msgs/{_camel(each.name)}", encoding=_OF_ULOG
        )
        places[number] = (times[order], np.zeros(len(order), np.int64), order)
    texts = [each for each in log.logged_messages if each.timestamp < _LATEST_US]
    if texts:
        times = np.array([each.timestamp * 1000 + offset_ns for each in texts], np.int64)
        channels[len(channels)] = Channel(_TEXTS, "px4_msgs/LoggedMessage", encoding=_OF_ULOG)
        places[len(places)] = (times, np.zeros(len(texts), np.int64), np.arange(len(texts)))
    fields = [_Fields(each) for each in log.data_list]

    def raw(number: int, _: int, row: int) -> Any:
        if number == len(fields):
            return SimpleNamespace(text=texts[row].message, severity=texts[row].log_level - ord("0"))
        return fields[number].message(row)

    problem = "; ".join([*(f"/{name} has no times, and is not read" for name in timeless), *_ulog_damage(log, data)])
    if problem:
        problem = f"{path.name}: {problem}"
        return OtherRecording(path, "ULog, damaged in places", channels, places, raw, problem=problem)
    end = max((end for _, end in _ulog_records(data)), default=_ULOG_HEADER)
    return OtherRecording(path, "ULog", channels, places, raw, cut=cut_words(path.name, end, len(data)))


def _ulog_damage(log: Any, data: bytes) -> List[str]:
    """Return what of a ULog could not be read, in one line; nothing when all could."""
    places = _ulog_damages(data, corrupt=log.file_corruption)
    if not log.file_corruption and not places:
        return []
    where = f": {'; '.join(places)}" if places else ""
    return [f"is damaged in places, what could not be read there is missing{where}"]


def _ulog_topic(name: str, instance: int) -> str:
    return f"/{name}" + (f"_{instance}" if instance else "")


def _timeless(log: Any, data: bytes) -> List[str]:
    """Return the topics of which messages are logged, and have no time."""
    names = dict.fromkeys(name for name, _ in _ulog_subscriptions(data).values())
    formats = log.message_formats
    return [
        name for name in names if name in formats and all(field != "timestamp" for *_, field in formats[name].fields)
    ]


def _ulog_subscriptions(data: bytes) -> Dict[int, Tuple[str, int]]:
    """Return name and instance of each topic by its number."""
    found: Dict[int, Tuple[str, int]] = {}
    for at, end in _ulog_records(data):
        if data[at + 2 : at + 3] == b"A" and end - at > _ULOG_NAME:
            number = int.from_bytes(data[at + 4 : at + 6], "little")
            found[number] = (data[at + _ULOG_NAME : end].decode("utf-8", "replace"), data[at + 3])
    return found


def _ulog_damages(data: bytes, *, corrupt: bool) -> List[str]:
    """Return where a ULog is damaged, which pyulog does not say: what is no record, and wrong messages by topic.

    Args:
        data: of the file.
        corrupt: whether pyulog met something that it could not read; a record of no kind it passes over.
    """
    found: Dict[int, List[Tuple[int, int]]] = {}
    said: List[str] = []
    for at, end in _ulog_records(data):
        kind, number = data[at + 2], int.from_bytes(data[at + 3 : at + 5], "little")
        if kind == ord("D"):
            found.setdefault(number, []).append((at, end - at))
        elif not chr(kind).isascii() or not chr(kind).isalpha():  # another letter may be a kind that is yet to come
            said.append(f"no record at byte {at}")
            if not kind:  # what follows is found again by pyulog, and nobody knows what lay between
                break
    names = {number: _ulog_topic(*each) for number, each in _ulog_subscriptions(data).items()}
    for number, messages in found.items() if corrupt else ():
        usual = Counter(size for _, size in messages).most_common(1)[0][0]
        wrong = [at for at, size in messages if size != usual or number not in names]
        of = f"{names[number]} of a wrong size" if number in names else f"topic {number}, which is none"
        if wrong:
            said.append(f"{len(wrong)} messages of {of}, {'from' if len(wrong) > 1 else 'at'} byte {wrong[0]}")
    return said


def _ulog_records(data: bytes) -> Iterator[Tuple[int, int]]:
    """Yield where the whole records of a ULog begin and end, up to the first that is cut."""
    size, at = len(data), _ULOG_HEADER
    appended = (
        [each for each in _APPENDED.unpack_from(data, at + 3 + 16) if each]
        if data[at + 2 : at + 3] == b"B" and size >= at + 3 + 40
        else []
    )
    while at + 3 <= size:
        end = at + 3 + (data[at] | data[at + 1] << 8)
        if appended and end > appended[0]:  # PX4 goes on there after a crash, whatever it was writing
            end = appended.pop(0)
        if end > size:
            break
        yield at, end
        at = end


def _day_ns(log: Any) -> int:
    """Return what must be added to the log's times to have the time of day; 0: nothing tells it."""
    for name in _GPS:
        for data in log.data_list:
            if data.name != name or not {"time_utc_usec", "fix_type", "timestamp"} <= data.data.keys():
                continue
            told = np.flatnonzero((data.data["time_utc_usec"] > 0) & (data.data["fix_type"] >= _FIX_3D))
            if len(told):
                first = told[0]
                return (int(data.data["time_utc_usec"][first]) - int(data.data["timestamp"][first])) * 1000
    return 0


def _camel(name: str) -> str:
    return "".join(word[:1].upper() + word[1:] for word in name.split("_"))


class _Fields:
    """The fields of a topic of a ULog: pyulog names them flat, `esc[0].rpm`, here they are nested as in ROS."""

    def __init__(self, data: Any) -> None:
        self._columns: List[Tuple[List[str], Any]] = [
            (_STEP.findall(name), column) for name, column in data.data.items() if "_padding" not in name
        ]

    def message(self, row: int) -> Any:
        """Return a message."""
        whole: Dict[str, Any] = {}
        for steps, column in self._columns:
            place = whole
            for step in steps[:-1]:
                place = place.setdefault(step, {})
            place[steps[-1]] = column[row].item()
        return _nested(whole)


def _nested(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if next(iter(value))[0] == "[":
        return [_nested(each) for each in value.values()]
    return SimpleNamespace(**{name: _nested(each) for name, each in value.items()})
