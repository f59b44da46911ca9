"""Counting over real sockets: however messages are cut, each is counted once, and seen as far as it is wanted."""

from __future__ import annotations

import errno
import io
import random
import socket
import struct
import threading
from contextlib import suppress
from types import SimpleNamespace
from typing import ClassVar

import pytest

pytest.importorskip("rospy")

import rospy
from std_msgs.msg import String

from amaze_autonomy.ros import rospy_flaws, topic_reader
from amaze_autonomy.ros.topic_reader import ALL, STAMP_BYTES, Tally, TopicReader, TopicStream, message_look


def framed(messages):
    return b"".join(struct.pack("<I", len(message)) + message for message in messages)


class Wire:
    """A publisher and a reader with one connection between them."""

    made: ClassVar[list] = []

    def __init__(self, wanted=0):
        with socket.socket() as server:
            server.bind(("127.0.0.1", 0))
            server.listen(1)
            self.publisher = socket.create_connection(server.getsockname(), timeout=5.0)
            sock, _ = server.accept()
        self.seen, self.closed = [], []
        self.tally = Tally("/topic", wanted)
        self.stream = TopicStream(
            sock, self.tally, lambda data: self.seen.append(bytes(data)), lambda: self.closed.append(True)
        )
        self.reader = TopicReader(slice_s=0.0)
        self.made.append(self)

    def close(self):
        self.publisher.close()
        self.reader.close()

    def begin(self, data=b""):
        self.reader.add(self.stream, data)
        self.reader.wait(0.0)

    def send(self, data):
        """Send everything, while the other side reads."""
        self.publisher.setblocking(False)
        while data:
            try:
                data = data[self.publisher.send(data) :]
            except BlockingIOError:
                self.reader.wait(0.01)

    def wait_for(self, condition):
        for _ in range(500):
            if condition():
                return
            self.reader.wait(0.01)
        raise AssertionError((self.tally.total, self.tally.streams))


@pytest.fixture(autouse=True)
def closed_wires():
    yield
    while Wire.made:
        Wire.made.pop().close()


MESSAGES = [
    bytes([number % 251]) * size for number, size in enumerate((0, 1, 12, 4091, 4092, 4093, 5000, 70000, 1 << 21, 3))
]


@pytest.mark.parametrize("wanted", [0, STAMP_BYTES, ALL])
@pytest.mark.parametrize("seed", range(4))
def test_every_message_is_counted_once_however_it_is_cut(wanted, seed):
    wire, rng = Wire(wanted), random.Random(seed)
    data = framed(MESSAGES)
    first = rng.choice((0, 2, 4, 9))
    wire.begin(data[:first])
    place = first
    while place < len(data):
        size = rng.choice((1, 3, 100, 4096, 100_000, 1_000_000))
        wire.send(data[place : place + size])
        place += size
        wire.reader.wait(0.0)
    wire.wait_for(lambda: wire.tally.total == len(MESSAGES))
    assert wire.tally.take() == len(MESSAGES)
    assert wire.tally.take() == 0
    expected = {0: [], STAMP_BYTES: [message[:STAMP_BYTES] for message in MESSAGES], ALL: MESSAGES}[wanted]
    assert wire.seen == expected


def test_a_message_counts_when_it_is_complete():
    wire = Wire()
    wire.begin()
    wire.send(framed([b"x" * 100_000])[:-1])
    for _ in range(5):
        wire.reader.wait(0.01)
    assert wire.tally.total == 0
    wire.send(b"x")
    wire.wait_for(lambda: wire.tally.total == 1)


@pytest.mark.parametrize("rest", [b"", b"\x05\x00\x00\x00ab"])
def test_a_publisher_that_dies_ends_its_connection(rest):
    wire = Wire()
    wire.begin()
    wire.send(framed([b"abc"]) + rest)
    wire.publisher.close()
    wire.wait_for(lambda: wire.closed)
    assert (wire.tally.total, wire.tally.streams, wire.closed) == (1, 0, [True])


def test_a_publisher_that_dies_within_a_picture_ends_its_connection():
    wire = Wire()
    wire.begin()
    wire.send(struct.pack("<I", 300_000) + b"x" * 100_000)
    wire.publisher.close()
    wire.wait_for(lambda: wire.closed)
    assert (wire.tally.total, wire.tally.streams) == (0, 0)


def test_a_publisher_that_never_stops_keeps_no_other_waiting():
    """A driver whose device was unplugged, in a busy loop: before what came is looked at there is more."""
    wild, most = Wire(ALL), 300_000
    wild.stream._look = lambda data: wild.seen.append(sum(data))  # it takes its time
    wild.stream._sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)  # as the system grows it by itself
    wild.begin()

    def publish():
        with suppress(OSError):  # the test is over
            for _ in range(most // 1000):
                wild.publisher.sendall(framed([b"x" * 1000]) * 1000)

    publishes = threading.Thread(target=publish, daemon=True)
    publishes.start()
    turns = []
    while len(turns) < 3:
        before = len(wild.seen)
        wild.reader.wait(1.0)
        turns.append(len(wild.seen) - before)
    assert max(turns) < most // 3, turns
    wild.close()
    publishes.join(5.0)


def test_what_is_no_tcpros_ends_the_connection():
    wire = Wire()
    wire.begin()
    wire.send(b"HTTP/1.1 400 Bad Request\r\n\r\n")
    wire.wait_for(lambda: wire.closed)
    assert wire.tally.total == 0


@pytest.mark.parametrize("moment", ["before", "meanwhile"])
def test_waking_ends_the_wait_at_once(moment):
    reader = TopicReader(slice_s=0.0)
    waiting = threading.Thread(target=reader.wait, args=(600.0,), daemon=True)
    if moment == "before":
        reader.wake()
    waiting.start()
    if moment == "meanwhile":
        waiting.join(0.2)
        assert waiting.is_alive(), "nobody has woken it yet"
        reader.wake()
    waiting.join(60.0)
    assert not waiting.is_alive()


@pytest.fixture
def said(monkeypatch):
    """What is said of an error, in a process that has said nothing yet."""
    lines = []
    monkeypatch.setattr(rospy, "logerr", lines.append)
    monkeypatch.setattr(rospy_flaws, "_said_s", {})
    return lines


def test_what_is_no_message_or_cannot_be_used_costs_that_one_alone(monkeypatch, said):
    taken = []
    monkeypatch.setattr(topic_reader, "_SAY_AGAIN_S", 0.0)

    def take(message):
        if message.data == "worse":
            raise ValueError("cannot be used")
        taken.append(message.data)

    look = message_look("/topic", String, take)
    for text in ("good", "worse", "well"):
        out = io.BytesIO()
        String(text).serialize(out)
        look(memoryview(out.getvalue()))
        look(memoryview(b"cut"))
    assert taken == ["good", "well"]
    assert len(said) == 4
    assert "/topic: 9 bytes are no std_msgs/String that can be used (ValueError('cannot be used'))" in said


def test_a_topic_that_is_damaged_all_the_time_does_not_silence_what_is_said_of_another_one(said):
    for _publisher in range(2):  # a look is made for each connection
        for topic in ("/topic", "/another"):
            look = message_look(topic, String, lambda _message: None)
            for _message in range(3):
                look(memoryview(b"cut"))
    assert [line.split(":")[0] for line in said] == ["/topic", "/another"]


def test_a_connection_of_which_there_is_no_duplicate_is_closed():
    """Else it counts as one that is read, and is never made again."""

    class Sock:
        def dup(self):
            raise OSError(errno.EMFILE, "Too many open files")

    closed = []
    connection = SimpleNamespace(
        socket=Sock(), done=False, read_buff=io.BytesIO(), header={}, close=lambda: closed.append(True)
    )
    with pytest.raises(OSError, match="Too many open files"):
        topic_reader._CountedTopic._take_over(SimpleNamespace(_tally=None, _look_for=None, _reader=None), connection)
    assert closed == [True]
