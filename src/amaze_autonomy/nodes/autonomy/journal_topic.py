"""~journal: every line to every listener, in order and from the first on, whenever it comes and however slow it is.

Each listener has a thread of its own. It reads the journal in slices, the end of it from memory and what is older from
the file, and waits where its listener does not read. So a listener that comes late to a long journal, or stands still,
costs a slice of memory and delays nobody: no lock is held while a file is read or a socket written.
"""

from __future__ import annotations

import logging
import threading
import time
import warnings
from collections import deque
from io import BytesIO
from pathlib import Path
from typing import Any, Callable, Deque, List, NamedTuple, Sequence, Tuple

import rospy
from rospy.msg import serialize_message

from amaze_autonomy import msg

from ...ros.interface import ros_time

_SLICE = 64 * 1024
_MOST_LINES = 20  # at once: rosbag's recorder holds 100 messages of a topic, and drops what comes faster than it takes
_RECENT = 1024 * 1024  # bytes in memory for listeners that keep up
_MOST_UNWRITTEN = 16 * 1024 * 1024  # bytes in memory while no disk takes them
_PAUSE_S = 0.02  # between two slices: who catches up gets 1000 lines a second, and may stand still for 0.1 s meanwhile
_LOOK_AGAIN_S = 0.5

_log = logging.getLogger(__name__)


class Cursor(NamedTuple):
    """Where a listener is: the number of its next line, and where that one begins in the file."""

    number: int = 0
    place: int = 0


class JournalLines:
    """The lines of a journal, for many readers at their own pace.

    Args:
        path: returns where the file is now.
        written: returns how many lines are in it.
        first: number of the next line that is added.
    """

    def __init__(self, path: Callable[[], Path], written: Callable[[], int], first: int) -> None:
        self._path, self._written = path, written
        self._recent: Deque[bytes] = deque()
        self._bytes, self._next = 0, first
        self.changed = threading.Condition()

    def add(self, line: str) -> None:
        """Add the next line."""
        data = line.encode() + b"\n"
        with self.changed:
            self._recent.append(data)
            self._bytes, self._next = self._bytes + len(data), self._next + 1
            written = self._written()
            while self._bytes > _RECENT and (self._first < written or self._bytes > _MOST_UNWRITTEN):
                self._bytes -= len(self._recent.popleft())
            self.changed.notify_all()

    @property
    def _first(self) -> int:
        return self._next - len(self._recent)

    def ended(self, cursor: Cursor) -> bool:
        """Return whether there is nothing behind a cursor; whoever asks holds `changed`."""
        return cursor.number >= self._next

    def read(self, cursor: Cursor) -> Tuple[List[str], Cursor]:
        """Return a slice of lines from a cursor on, and the cursor behind it."""
        with self.changed:
            first, end = self._first, self._next
            if cursor.number >= first:
                found = _slice_of(self._recent, cursor.number - first)
                return _after(cursor, found)
        found = self._of_file(cursor, first)
        if found:
            return _after(cursor, found)
        lost = Cursor(first, cursor.place)  # of a disk that was gone for long: they are nowhere
        return [], lost if first < end else cursor

    def _of_file(self, cursor: Cursor, first: int) -> List[bytes]:
        """Return whole lines of the file, none of them beyond what is in memory."""
        try:
            with self._path().open("rb") as file:
                file.seek(cursor.place)
                data = file.read(_SLICE)
                if data and b"\n" not in data:
                    data += file.readline()
        except OSError:
            return []
        return data[: data.rfind(b"\n") + 1].splitlines(keepends=True)[: min(_MOST_LINES, first - cursor.number)]


def _slice_of(recent: Sequence[bytes], begin: int) -> List[bytes]:
    found: List[bytes] = []
    size = 0
    for index in range(begin, len(recent)):
        found.append(recent[index])
        size += len(recent[index])
        if size >= _SLICE or len(found) == _MOST_LINES:
            break
    return found


def _after(cursor: Cursor, found: Sequence[bytes]) -> Tuple[List[str], Cursor]:
    behind = Cursor(cursor.number + len(found), cursor.place + sum(map(len, found)))
    return [each[:-1].decode("ascii") for each in found], behind


# --- topic ------------------------------------------------------------------------------------------------------------


class JournalTopic(rospy.SubscribeListener):
    """The topic.

    Args:
        lines: of the journal.
        ros_ns: returns the time of stamps.
    """

    def __init__(self, lines: JournalLines, ros_ns: Callable[[], int]) -> None:
        super().__init__()
        self._lines, self._ros_ns = lines, ros_ns
        self._fed: List[Any] = []
        self._lock = threading.Lock()
        self._stopping = False
        with warnings.catch_warnings():  # rospy warns of publishers without a queue; here each listener has a thread
            warnings.simplefilter("ignore", SyntaxWarning)
            self._publisher = rospy.Publisher("~journal", msg.JournalEntry, self, queue_size=None)

    def peer_subscribe(self, _topic: str, _publish: Any, _publish_one: Any) -> None:
        """Feed each connection that is not fed yet."""
        with self._lock:
            new = [each for each in self._publisher.impl.connections if each not in self._fed]
            self._fed += new
        for connection in new:
            threading.Thread(target=self._feed, args=(connection,), name="journal", daemon=True).start()

    def _feed(self, connection: Any) -> None:
        cursor, buffer = Cursor(), BytesIO()
        try:
            while not self._is_over(cursor):
                lines, behind = self._lines.read(cursor)
                if lines:
                    self._write(connection, buffer, cursor.number, lines)
                cursor = behind
                if len(lines) in (0, _MOST_LINES):
                    time.sleep(_PAUSE_S)
        except Exception as error:  # rospy raises whatever sockets and its transports do: the listener has gone
            _log.debug("a listener of the journal has gone: %s", error)
            self._publisher.impl.remove_connection(connection)
            connection.close()
        with self._lock:
            self._fed.remove(connection)

    def _is_over(self, cursor: Cursor) -> bool:
        """Wait until there is something behind a cursor; return whether there will be nothing any more."""
        with self._lines.changed:
            while self._lines.ended(cursor):
                if self._stopping:
                    return True
                self._lines.changed.wait(_LOOK_AGAIN_S)
        return False

    def _write(self, connection: Any, buffer: BytesIO, number: int, lines: Sequence[str]) -> None:
        stamp = ros_time(self._ros_ns())
        for offset, line in enumerate(lines):
            entry = msg.JournalEntry(sequence=number + offset, kind=_kind(line), line=line)
            entry.header.stamp = stamp
            serialize_message(buffer, number + offset, entry)
        connection.write_data(buffer.getvalue())
        buffer.seek(0)
        buffer.truncate()

    def close(self, limit_s: float) -> None:
        """Let listeners that keep up have the last lines."""
        self._stopping = True
        deadline_s = time.monotonic() + limit_s
        with self._lines.changed:
            self._lines.changed.notify_all()
        while self._fed and time.monotonic() < deadline_s:
            time.sleep(_PAUSE_S)


def _kind(line: str) -> str:
    """Return the kind of a line of the journal; a canonical line has it between its keys."""
    return next((kind for kind in ("decision", "header") if f'"kind":"{kind}"' in line), "event")
