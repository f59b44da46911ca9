"""What other readers say of a bag: the rosbags library, Debian's and Noetic's rosbag in Python, and librosbag in C++.

Each that is installed is asked in a process of its own, so that none can do harm and none is imported here.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional

from .count import Counted, count
from .errors import BagError

__all__ = ["READERS", "Reading", "disagreements", "read_with"]

READERS = ("rosbags", "rosbag", "librosbag")
_LIMIT_S = 3600

_ROSBAGS = """
import json, sys, zlib
from pathlib import Path
from rosbags.rosbag1 import Reader
with Reader(Path(sys.argv[1])) as reader:
    counts, sums = {}, {}
    for each in reader.connections:
        counts[each.topic] = counts.get(each.topic, 0) + each.msgcount
    if sys.argv[2] == "read":
        counts = dict.fromkeys(counts, 0)
        for connection, _, raw in reader.messages():
            counts[connection.topic] += 1
            sums[connection.topic] = sums.get(connection.topic, 0) + zlib.crc32(raw)
json.dump({"messages": counts, "crc_sums": sums}, sys.stdout)
"""
_ROSBAG = """
import json, sys, zlib
import rosbag
with rosbag.Bag(sys.argv[1]) as bag:
    topics = bag.get_type_and_topic_info().topics
    counts, sums = {name: each.message_count for name, each in topics.items()}, {}
    if sys.argv[2] == "read":
        counts = dict.fromkeys(counts, 0)
        for topic, message, _ in bag.read_messages(raw=True):
            counts[topic] += 1
            sums[topic] = sums.get(topic, 0) + zlib.crc32(message[1])
json.dump({"messages": counts, "crc_sums": sums}, sys.stdout)
"""


class Reading(NamedTuple):
    """What a reader says.

    Args:
        reader: its name.
        messages: by topic; those without messages are left out.
        crc_sums: the sum of the CRC-32 of all messages by topic; empty when they were not read.
        error: why it could not read; "" when it could.
    """

    reader: str
    messages: Dict[str, int]
    crc_sums: Dict[str, int]
    error: str = ""


def read_with(path: Path, *, every_message: bool) -> List[Reading]:
    """Ask all readers that are installed.

    Args:
        path: of the bag.
        every_message: whether each message is to be read, or the index alone.
    """
    readings = []
    for reader, script in (("rosbags", _ROSBAGS), ("rosbag", _ROSBAG)):
        python = _python_with(reader)
        if python:
            readings.append(_asked(reader, [python, "-c", script, str(path), "read" if every_message else "open"]))
    if every_message and _librosbag():
        readings.append(_copied_by_librosbag(path))
    return readings


def disagreements(counted: Counted, readings: List[Reading]) -> List[str]:
    """Return where other readers see something else, one line each."""
    messages: Dict[str, int] = {}
    for (topic, _, _), tally in counted.topics.items():
        messages[topic] = messages.get(topic, 0) + tally.messages
    found = []
    for each in readings:
        if each.error:
            found.append(f"{each.reader} cannot read it: {each.error}")
        elif each.messages != messages:
            found.append(f"{each.reader} counts other messages: {_difference(each.messages, messages)}")
        elif each.crc_sums and each.crc_sums != counted.crc_sums:
            found.append(f"{each.reader} reads other bytes: {_difference(each.crc_sums, counted.crc_sums)}")
    return found


def _difference(one: Dict[str, int], other: Dict[str, int]) -> str:
    topics = [topic for topic in sorted({*one, *other}) if one.get(topic, 0) != other.get(topic, 0)]
    return ", ".join(f"{topic} {one.get(topic, 0)} instead of {other.get(topic, 0)}" for topic in topics)


def _python_with(module: str) -> Optional[str]:
    """Return an interpreter that has a module: this one, else the system's."""
    for python in (sys.executable, "/usr/bin/python3"):
        command = [python, "-c", f"import importlib.util as u; raise SystemExit(u.find_spec({module!r}) is None)"]
        if shutil.which(python) and subprocess.run(command, capture_output=True, check=False).returncode == 0:
            return python
    return None


def _asked(reader: str, command: List[str]) -> Reading:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return Reading(reader, {}, {}, f"no answer within {_LIMIT_S} s")
    if done.returncode:
        return Reading(reader, {}, {}, _last_line(done.stderr))
    said: Dict[str, Any] = json.loads(done.stdout)
    return Reading(reader, {topic: number for topic, number in said["messages"].items() if number}, said["crc_sums"])


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or ["it said nothing"])[-1]


def _librosbag() -> Optional[Path]:
    """Return the only tool of rosbag that is C++ and needs no roscore: it reads all messages and writes them again."""
    rosbag = shutil.which("rosbag")
    if not rosbag:
        return None
    tool = Path(rosbag).resolve().parents[1] / "lib" / "rosbag" / "encrypt"
    return tool if tool.is_file() else None


def _copied_by_librosbag(path: Path) -> Reading:
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".librosbag-") as folder:
        copy = Path(folder) / "copy.bag"
        command = [str(_librosbag()), "-q", "-p", "rosbag/NoEncryptor", str(path), "-o", str(copy)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
        if done.returncode or not copy.is_file():
            return Reading("librosbag", {}, {}, _last_line(done.stderr))
        try:
            counted = count(copy)
        except BagError as error:
            return Reading("librosbag", {}, {}, str(error))
    messages: Dict[str, int] = {}
    for (topic, _, _), tally in counted.topics.items():
        messages[topic] = messages.get(topic, 0) + tally.messages
    return Reading("librosbag", messages, counted.crc_sums)
