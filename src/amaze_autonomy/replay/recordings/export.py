"""Recordings for other programs: MCAP (Foxglove, PlotJuggler), tables in CSV, the track as KML (Google Earth).

Whatever a replay reads can be exported: ROS 1 bags, ROS 2 bags, MCAP, ULogs, telemetry logs, and what is made of them.
Into MCAP messages go as their bytes, with their definitions, where the recording has those (ROS 1 and ROS 2); of logs
the decoded messages are written as JSON. An output is whole or not there.
"""

from __future__ import annotations

import csv
import io
import json
from dataclasses import is_dataclass
from datetime import datetime, timezone
from fnmatch import fnmatchcase
from heapq import merge as merged
from math import isfinite
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple
from xml.sax.saxutils import escape

import numpy as np

from amaze_autonomy.bags import BagError, Entry, Recording
from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.bags.format import MEMORY
from amaze_autonomy.bags.other_formats import OtherRecording, content_files
from amaze_autonomy.files import whole, write_whole

from ..errors import ReplayError
from .sources import problems_of, recordings_of

_S = 1_000_000_000
_LONGEST = 64  # of arrays whose elements are columns of a table


class Exported(NamedTuple):
    """What was written.

    Args:
        files: that are new.
        messages: in them.
        unread: messages that could not be read, by topic; they are missing.
        left_out: fields and topics that a table or a track cannot have, one line each.
        problems: what of the recordings is missing, and why messages cannot be read, one line each.
    """

    files: Tuple[Path, ...]
    messages: int
    unread: Dict[str, int]
    left_out: Tuple[str, ...]
    problems: Tuple[str, ...] = ()


def export(
    paths: Sequence[Path], output: Path, topics: Sequence[str] = (), memory: int = MEMORY, *, replace: bool = False
) -> Exported:
    """Export the recordings of one flight: to MCAP or KML by the name of the output, else tables in a folder.

    Args:
        paths: of the recordings.
        output: `x.mcap`, `x.kml`, or a folder.
        topics: patterns of those that are wanted, as `/camera/*`; none wants all.
        memory: bytes that a chunk may take, decompressed.
        replace: whether files that exist may be replaced; those of the recordings never are.

    Raises:
        BagError: A recording cannot be read, or the output exists, or is one of the recordings.
        ReplayError: No topic is wanted, or none tells where the vehicle is.
        OSError: The output cannot be written.
    """
    recordings = [recording for path in paths for recording in recordings_of(path, memory)]
    try:
        flight = _Flight(recordings, topics)
        write = {".mcap": _write_mcap, ".kml": _write_kml}.get(output.suffix.lower(), _write_tables)
        _check_unused(output, paths)
        if output.exists() and output.is_dir() != (write is _write_tables):
            wrong = "is no folder" if write is _write_tables else "is a folder"
            raise BagError(str(output), wrong, "name a folder for tables, or a file x.mcap or x.kml")
        for file in _tables(flight, output) if write is _write_tables else [output]:
            if file.exists() and not replace:
                raise BagError(str(file), "exists", "choose another name, or say that it may be replaced (--force)")
        return write(flight, output)._replace(problems=(*problems_of(recordings), *flight.reasons.values()))
    finally:
        for recording in recordings:
            recording.close()


def _check_unused(output: Path, paths: Sequence[Path]) -> None:
    """Refuse an output that is one of the recordings, or a file of one that is a folder."""
    for file in (file for path in paths for file in (path, *content_files(path))):
        if output.exists() and output.samefile(file):
            raise BagError(str(output), "is one of the recordings, which are never changed", "choose another name")


class _Flight:
    """The wanted topics of several recordings."""

    def __init__(self, recordings: Sequence[Any], patterns: Sequence[str]) -> None:
        self.unread: Dict[str, int] = {}
        self.reasons: Dict[str, str] = {}
        self.topics: List[Tuple[Any, Any]] = [
            (recording, topic)
            for recording in recordings
            for topic in recording.topics
            if topic.messages and (not patterns or any(fnmatchcase(topic.name, each) for each in patterns))
        ]
        if not self.topics:
            there = ", ".join(sorted({topic.name for each in recordings for topic in each.topics if topic.messages}))
            raise ReplayError(f"there is no message of such a topic; there are {there or 'none at all'}")

    def messages(self, recording: Any, topic: Any) -> Iterator[Tuple[Entry, Any]]:
        """Yield the messages of a topic, decoded."""
        for entry in recording.entries(topic.name):
            try:
                yield entry, recording.message(entry)
            except MessageError as error:
                self.leave_out(topic, error)

    def leave_out(self, topic: Any, error: MessageError) -> None:
        """Note that a message cannot be read; of the first of its topic also why."""
        self.unread[topic.name] = self.unread.get(topic.name, 0) + 1
        self.reasons.setdefault(topic.name, f"{topic.name}: {error}")

    def in_order(self) -> Iterator[Tuple[Entry, int]]:
        """Yield all messages in order of time, each with the number of its topic."""

        def numbered(number: int, recording: Any, topic: Any) -> Iterator[Tuple[int, int, Entry]]:
            return ((entry.t_ns, number, entry) for entry in recording.entries(topic.name))

        for _, number, entry in merged(*(numbered(place, *each) for place, each in enumerate(self.topics))):
            yield entry, number


# --- MCAP -------------------------------------------------------------------------------------------------------------


def _write_mcap(flight: _Flight, output: Path) -> Exported:
    """Write all messages in order of time; the summary has an index, so that players can seek."""
    try:
        from mcap.writer import Writer  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise BagError(str(output), "needs a library for MCAP", "pip install 'amaze_autonomy[mcap]'") from error
    count = 0
    with whole(output) as file:
        writer = Writer(file)
        writer.start(_profile(flight), "amaze-replay")
        channels = _Channels(writer)
        for entry, number in flight.in_order():
            recording, topic = flight.topics[number]
            try:
                data = channels.data(recording, entry)
            except MessageError as error:
                flight.leave_out(topic, error)
                continue
            count += 1
            writer.add_message(channels.of(recording, topic, entry), entry.t_ns, data, entry.t_ns, count)
        writer.finish()
    return Exported((output,), count, flight.unread, ())


def _profile(flight: _Flight) -> str:
    """Return the profile of a file: where all messages are of one ROS, that; readers of ROS 2 ask for it."""
    encodings: Set[str] = set()
    for recording, topic in flight.topics:
        channels = getattr(recording, "channels", {}).values()
        own = {each.encoding if each.definition else "json" for each in channels if each.topic == topic.name}
        encodings |= {"ros1"} if isinstance(recording, Recording) else own or {"json"}
    return {"ros1": "ros1", "cdr": "ros2"}.get(encodings.pop(), "") if len(encodings) == 1 else ""


class _Channels:
    """The channels of an MCAP file: one for each connection of a bag, one for each topic of a log."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._schemas: Dict[Tuple[str, str, str], int] = {}
        self._channels: Dict[Tuple[int, int, str], int] = {}

    def data(self, recording: Any, entry: Entry) -> bytes:
        """Return a message as it is written."""
        if isinstance(recording, Recording):
            return recording.raw(entry)
        if isinstance(recording, OtherRecording) and recording.channels[entry.connection].definition:
            return bytes(recording.raw(entry))
        return json.dumps(_plain(recording.message(entry)), default=str).encode()

    def of(self, recording: Any, topic: Any, entry: Entry) -> int:
        """Return the channel of a message."""
        key = (id(recording), entry.connection, topic.name)
        if key not in self._channels:
            self._channels[key] = self._made(recording, topic, entry)
        return self._channels[key]

    def _made(self, recording: Any, topic: Any, entry: Entry) -> int:
        if isinstance(recording, Recording):
            link = recording.link(entry.connection)
            about = {"callerid": link.caller, "md5sum": link.md5, "latching": "1" if link.latching else "0"}
            schema = self._schema(link.kind, "ros1msg", link.definition)
            channel = self._writer.register_channel(topic.name, "ros1", schema, about)
        elif isinstance(recording, OtherRecording) and recording.channels[entry.connection].definition:
            there = recording.channels[entry.connection]
            kind = there.kind if there.encoding == "ros1" else there.kind.replace("/", "/msg/")
            schema = self._schema(kind, there.schema, there.definition)
            channel = self._writer.register_channel(topic.name, there.encoding, schema)
        else:
            schema = self._schema(topic.kind, "jsonschema", '{"type": "object"}')
            channel = self._writer.register_channel(topic.name, "json", schema)
        return int(channel)

    def _schema(self, kind: str, encoding: str, definition: str) -> int:
        key = (kind, encoding, definition)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(kind, encoding, definition.encode())
        return self._schemas[key]


def _plain(value: Any) -> Any:
    """Return a message as dictionaries, lists, numbers and texts; what is no number as JSON has it is None."""
    if isinstance(value, np.ndarray):
        return [_plain(each) for each in value.tolist()]
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, bytes):
        return value.split(b"\0")[0].decode("utf-8", "replace")
    if isinstance(value, float):
        return value if isfinite(value) else None
    names = _names(value)
    return {name: _plain(getattr(value, name)) for name in names} if names else value


def _names(value: Any) -> Tuple[str, ...]:
    """Return the names of the fields of a message of any library."""
    if hasattr(value, "get_fieldnames"):  # of pymavlink
        return tuple(value.get_fieldnames())
    if isinstance(value, SimpleNamespace):
        return tuple(vars(value))
    if is_dataclass(value):
        return tuple(name for name in value.__dataclass_fields__ if name[:2] != "__" and not name.isupper())
    return ()


# --- tables -----------------------------------------------------------------------------------------------------------


def _tables(flight: _Flight, folder: Path) -> List[Path]:
    """Return the file of each topic's table."""
    files: List[Path] = []
    for _, topic in flight.topics:
        name = topic.name.strip("/").replace("/", "__") or "root"
        file, number = folder / f"{name}.csv", len(files)
        while file in files:  # the same topic of another recording, or one with nearly the same name
            file, number = folder / f"{name}__{number}.csv", number + 1
        files.append(file)
    return files


def _write_tables(flight: _Flight, folder: Path) -> Exported:
    """Write a table for each topic: a row for each message, a column for each field, times in seconds since 1970."""
    folder.mkdir(parents=True, exist_ok=True)
    files = _tables(flight, folder)
    left_out: List[str] = []
    count = 0
    for file, (recording, topic) in zip(files, flight.topics):
        rows: List[Dict[str, Any]] = []
        columns: Dict[str, None] = {"t_s": None}
        long: Dict[str, None] = {}
        for entry, message in flight.messages(recording, topic):
            row = {"t_s": f"{entry.t_ns // _S}.{entry.t_ns % _S:09d}", **dict(_cells(message, "", long))}
            columns.update(dict.fromkeys(row))
            rows.append(row)
        left_out += [f"{topic.name}: {name} has more than {_LONGEST} elements" for name in long]
        write_whole(file, _table(list(columns), rows))
        count += len(rows)
    return Exported(tuple(files), count, flight.unread, tuple(left_out))


def _table(columns: Sequence[str], rows: Iterable[Dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _cells(value: Any, path: str, long: Dict[str, None]) -> Iterator[Tuple[str, Any]]:
    """Yield the fields of a message with their paths, as a topic map names them; note in `long` what is left out."""
    names = _names(value)
    if names:
        for name in names:
            yield from _cells(getattr(value, name), f"{path}.{name}" if path else name, long)
    elif isinstance(value, (list, tuple, np.ndarray)):
        if len(value) > _LONGEST:
            long[path] = None
            return
        for place, each in enumerate(value):
            yield from _cells(each, f"{path}[{place}]", long)
    else:
        yield path, _plain(value) if isinstance(value, bytes) else value


# --- the track over ground --------------------------------------------------------------------------------------------


class _Place(NamedTuple):
    t_ns: int
    longitude_deg: float
    latitude_deg: float
    altitude_m: float


def _of_fix(message: Any) -> Optional[Tuple[float, float, float]]:
    known = int(message.status.status) >= 0
    return (message.longitude, message.latitude, message.altitude) if known else None


def _of_gps_raw(message: Any) -> Optional[Tuple[float, float, float]]:
    known = int(message.fix_type) >= 3  # noqa: PLR2004  (in three dimensions)
    return (message.lon / 1e7, message.lat / 1e7, message.alt / 1e3) if known else None


def _of_global(message: Any) -> Optional[Tuple[float, float, float]]:
    return (message.lon / 1e7, message.lat / 1e7, message.alt / 1e3) if message.lat or message.lon else None


def _of_px4_gps(message: Any) -> Optional[Tuple[float, float, float]]:
    if hasattr(message, "latitude_deg"):
        known = int(message.fix_type) >= 3  # noqa: PLR2004
        return (message.longitude_deg, message.latitude_deg, message.altitude_msl_m) if known else None
    return _of_gps_raw(message)


def _of_px4_global(message: Any) -> Optional[Tuple[float, float, float]]:
    return message.lon, message.lat, message.alt


_PLACES: Dict[str, Callable[[Any], Optional[Tuple[float, float, float]]]] = {
    "mavlink/GLOBAL_POSITION_INT": _of_global,
    "px4_msgs/VehicleGlobalPosition": _of_px4_global,
    "sensor_msgs/NavSatFix": _of_fix,
    "px4_msgs/VehicleGpsPosition": _of_px4_gps,
    "px4_msgs/SensorGps": _of_px4_gps,
    "mavlink/GPS_RAW_INT": _of_gps_raw,
}
_APART_NS = _S // 10  # a track has at most ten places a second


def _write_kml(flight: _Flight, output: Path) -> Exported:
    """Write where each topic that tells it says that the vehicle was, with times."""
    tracks: List[str] = []
    count = 0
    left_out: List[str] = []
    for recording, topic in flight.topics:
        if topic.kind in _PLACES:
            places = list(_places(flight, recording, topic))
            count += len(places)
            tracks += [_track(topic.name, places)] if places else []
            left_out += [] if places else [f"{topic.name} has no fix"]
    if not tracks:
        raise ReplayError(f"no topic tells where the vehicle is: {', '.join(left_out) or 'none is of such a type'}")
    name = escape(output.stem)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
    head += f'xmlns:gx="http://www.google.com/kml/ext/2.2">\n<Document>\n<name>{name}</name>\n'
    write_whole(output, head + "".join(tracks) + "</Document>\n</kml>\n")
    return Exported((output,), count, flight.unread, tuple(left_out))


def _places(flight: _Flight, recording: Any, topic: Any) -> Iterator[_Place]:
    due_ns = 0
    for entry, message in flight.messages(recording, topic):
        place = _PLACES[topic.kind](message) if entry.t_ns >= due_ns else None
        if place is not None and all(isfinite(each) for each in place):
            due_ns = entry.t_ns + _APART_NS
            yield _Place(entry.t_ns, *place)


def _track(name: str, places: Sequence[_Place]) -> str:
    lines = ["<Placemark>", f"<name>{escape(name)}</name>", "<gx:Track>", "<altitudeMode>absolute</altitudeMode>"]
    for each in places:
        when = datetime.fromtimestamp(each.t_ns // _S, timezone.utc).strftime("%Y-%m-%dT%H:%M:%S")
        lines.append(f"<when>{when}.{each.t_ns % _S // 1_000_000:03d}Z</when>")
    lines += [f"<gx:coord>{p.longitude_deg:.7f} {p.latitude_deg:.7f} {p.altitude_m:.3f}</gx:coord>" for p in places]
    return "\n".join([*lines, "</gx:Track>", "</Placemark>", ""])
