"""~journal: whoever comes late gets every line, in slices; who does not read delays nobody."""

from __future__ import annotations

import threading
from io import BytesIO
from types import SimpleNamespace

import pytest
from waiting import wait_for

pytest.importorskip("rospy")

from amaze_autonomy import msg
from amaze_autonomy.nodes.autonomy import journal_topic
from amaze_autonomy.nodes.autonomy.journal_file import create
from amaze_autonomy.nodes.autonomy.journal_topic import Cursor, JournalLines, JournalTopic
from amaze_autonomy.nodes.autonomy.run_folder import Place

HEADER = '{"kind":"header"}'


class Journal:
    """A journal in a folder, and its lines as listeners read them."""

    def __init__(self, folder):
        self.file = create(folder, HEADER, Place().elsewhere)
        self.lines = JournalLines(lambda: self.file.path, lambda: self.file.written, self.file.lines)

    def write(self, *lines, flush=True):
        for line in lines:
            self.file.append(line)
            self.lines.add(line)
        if flush:
            self.file.flush()

    def read_all(self, cursor=Cursor()):  # noqa: B008  (it is a value)
        """Return everything behind a cursor, and how many slices it took."""
        found, slices = [], 0
        while not self.lines.ended(cursor):
            lines, cursor = self.lines.read(cursor)
            found += lines
            slices += 1
        return found, slices


@pytest.fixture
def journal(tmp_path):
    made = Journal(tmp_path)
    yield made
    made.file.close()


def test_a_listener_gets_the_file_and_then_what_comes(journal):
    journal.write("a", "b")
    assert journal.lines.read(Cursor()) == ([HEADER], Cursor(1, len(HEADER) + 1))
    behind = Cursor(3, len(HEADER) + 5)
    assert journal.lines.read(Cursor(1, len(HEADER) + 1)) == (["a", "b"], behind)
    assert journal.lines.ended(behind)
    journal.write("c", flush=False)
    assert journal.lines.read(behind)[0] == ["c"], "before it is in the file"


def test_a_long_journal_is_read_in_slices_and_little_of_it_is_kept(journal, monkeypatch):
    monkeypatch.setattr(journal_topic, "_RECENT", 1000)
    monkeypatch.setattr(journal_topic, "_SLICE", 500)
    lines = [f"{number:06d}" + "x" * (number % 50) for number in range(2000)]
    journal.write(*lines)
    found, slices = journal.read_all()
    assert found == [HEADER, *lines]
    assert slices > 2000 * 30 / 500
    assert sum(map(len, journal.lines._recent)) > 1000, "nothing is forgotten that is in no file yet"
    journal.write("last")
    assert sum(map(len, journal.lines._recent)) <= 1000
    assert journal.read_all()[0] == [HEADER, *lines, "last"]


def test_a_slice_holds_a_line_that_is_longer_than_it(journal, monkeypatch):
    monkeypatch.setattr(journal_topic, "_RECENT", 10)
    monkeypatch.setattr(journal_topic, "_SLICE", 10)
    journal.write("y" * 100, "z")
    journal.write("end")
    assert journal.read_all()[0] == [HEADER, "y" * 100, "z", "end"]


def test_what_no_disk_took_for_long_is_left_out_and_the_rest_goes_on(journal, monkeypatch):
    monkeypatch.setattr(journal_topic, "_RECENT", 10)
    monkeypatch.setattr(journal_topic, "_MOST_UNWRITTEN", 10)
    journal.write("not in the file", "neither is this", "the end", flush=False)
    found, _ = journal.read_all()
    assert found == [HEADER, "the end"]


class Listener:
    """A connection whose other end reads, stands still, or has gone."""

    def __init__(self, *, stands=False, gone=False):
        self.numbers, self.goes_on, self._gone, self.closed = [], threading.Event(), gone, False
        if not stands:
            self.goes_on.set()

    def write_data(self, data):
        self.goes_on.wait(10.0)
        if self._gone:
            raise OSError(32, "Broken pipe")
        stream = BytesIO(data)
        while stream.tell() < len(data):
            size = int.from_bytes(stream.read(4), "little")
            entry = msg.JournalEntry().deserialize(stream.read(size))
            self.numbers.append((entry.sequence, entry.kind, entry.line))

    def close(self):
        self.closed = True


@pytest.fixture
def topic(journal, monkeypatch):
    connections = []
    impl = SimpleNamespace(connections=connections, remove_connection=connections.remove)
    monkeypatch.setattr(journal_topic.rospy, "Publisher", lambda *_, **__: SimpleNamespace(impl=impl))
    made = JournalTopic(journal.lines, lambda: 5)

    def subscribe(listener):
        connections.append(listener)
        made.peer_subscribe("", None, None)
        return listener

    yield SimpleNamespace(subscribe=subscribe, close=made.close, connections=connections)
    made.close(2.0)


def test_no_more_lines_are_sent_at_once_than_a_recorder_holds(journal):
    journal.write(*(f"{number}" for number in range(500)))
    found, slices = journal.read_all()
    assert (len(found), slices) == (501, 26)


def test_every_listener_gets_every_line_in_order_whatever_another_one_does(journal, topic):
    standing, gone = topic.subscribe(Listener(stands=True)), topic.subscribe(Listener(gone=True))
    journal.write('{"kind":"event"}')
    late = topic.subscribe(Listener())
    journal.write('{"kind":"decision"}')
    expected = [(0, "header", HEADER), (1, "event", '{"kind":"event"}'), (2, "decision", '{"kind":"decision"}')]
    wait_for(lambda: late.numbers == expected)
    wait_for(lambda: gone.closed and topic.connections == [standing, late])
    assert standing.numbers == []
    standing.goes_on.set()
    wait_for(lambda: standing.numbers == expected)


def test_the_last_lines_are_delivered_before_the_end(journal, topic):
    listener = topic.subscribe(Listener())
    journal.write(*(f"{number}" for number in range(2500)))
    topic.close(10.0)
    assert [number for number, _, _ in listener.numbers] == list(range(2501))
