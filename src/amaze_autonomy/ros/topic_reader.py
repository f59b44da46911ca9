"""Count or take the messages of many topics on one thread, reading no more of them than is wanted.

rospy has a thread per connection, copies every message twice and hands it to Python: 65 us for a small message, 250 to
500 us for a picture of 300 kB. What only needs counting needs the four bytes of its length. Here one `epoll` waits for
all connections, and the kernel throws the rest of a message away (`MSG_TRUNC`, tcp(7)) without copying it anywhere.
What is taken whole wakes the thread once for all that came within a slice, not once for each message.

TCPROS after its handshake is a sequence of: length (uint32, little endian), message (http://wiki.ros.org/ROS/TCPROS).
"""

from __future__ import annotations

import logging
import mmap
import os
import select
import socket
import struct
import time
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any, Callable, Dict, Mapping, Optional, Tuple, Type

import rospy
from rospy.impl.registration import Registration
from rospy.topics import _SubscriberImpl, get_topic_manager

from .errors import StartError
from .rospy_flaws import logerr_seldom

_log = logging.getLogger(__name__)

ALL = -1  # of each message, as what is wanted
STAMP_BYTES = 12  # a header's sequence number and stamp
_LENGTH = struct.Struct("<I")
_LONGEST = 1 << 30  # bytes
_GLANCE_BYTES = 4096  # one read of a topic that is only counted: the small messages, the front of a large one
_GULP_BYTES = 1 << 20  # one read of a topic that is looked at as a whole
_READ_S = 0.05  # one stream is read for so long at most, so that one that never ends keeps no other waiting
_BITE_BYTES = 65536  # one read of small messages that are looked at
_WHOLE_BYTES = 32768  # from here on the rest of a message is waited for as a whole
_VOID_BYTES = 1 << 24
_SAY_AGAIN_S = 10.0
_VOID = memoryview(mmap.mmap(-1, _VOID_BYTES))  # never written to, so it has no memory behind it

#: Takes the part of a message that is wanted.
Look = Callable[[memoryview], None]


class Tally:
    """The messages of one topic since somebody asked.

    Args:
        topic: resolved name.
        wanted: how many bytes of the front of each message are looked at; ALL: the whole.
        longest: bytes; what says that it is longer is no message, and ends its connection.
    """

    def __init__(self, topic: str, wanted: int = 0, longest: int = _LONGEST) -> None:
        self.topic, self.wanted, self.longest = topic, wanted, longest
        self.count = 0
        self.total = 0
        self.streams = 0

    def take(self) -> int:
        """Return how many messages came since the last call."""
        count, self.count = self.count, 0
        return count


class TopicStream:
    """One connection to one publisher.

    Args:
        sock: after the handshake; belongs to the stream.
        tally: of its topic.
        look: gets the wanted part of each message; on the reader's thread.
        closed: called once, when the connection has ended.
    """

    def __init__(
        self, sock: socket.socket, tally: Tally, look: Optional[Look] = None, closed: Callable[[], None] = lambda: None
    ) -> None:
        self._sock, self._tally, self._look, self._closed = sock, tally, look, closed
        self._wanted = tally.wanted if look is not None else 0
        self._pending = b""
        self._skip = 0
        self._least = 1  # bytes that wake the reader
        sock.setblocking(False)
        self.fd, self.whole = sock.fileno(), self._wanted == ALL

    def read(self, buffer: memoryview) -> bool:
        """Read what has come, or a part of too much; False when the connection has ended."""
        until_s = time.monotonic() + _READ_S
        try:
            while time.monotonic() < until_s:
                if self._skip:
                    count = self._discard()
                    self._wake_for(self._skip)
                    if self._skip:
                        return count > 0
                    continue
                room = len(buffer) if len(self._pending) >= _BITE_BYTES else min(len(buffer), _BITE_BYTES)
                count = self._sock.recv_into(buffer, room)
                if not self._parse(buffer[:count]) or count == 0:
                    return False
                if not self._skip and count < room:
                    break
        except BlockingIOError:
            pass  # all of it was read
        except OSError:
            return False
        return True

    def begin(self, data: bytes) -> bool:
        """Take what came together with the handshake; False when it is not TCPROS."""
        self._tally.streams += 1
        return self._parse(memoryview(data))

    def close(self) -> None:
        """Close the connection."""
        self._tally.streams -= 1
        self._sock.close()
        self._closed()

    def _discard(self) -> int:
        """Have the kernel throw away what has come of a message that nobody looks at; return how much that was."""
        count = self._sock.recv_into(_VOID, min(self._skip, _VOID_BYTES), socket.MSG_TRUNC)
        self._skip -= count
        if self._skip == 0:
            self._count()
        return count

    def _wake_for(self, rest: int) -> None:
        """Be woken once for the rest of a large message, not for each part; the kernel makes room for it as well."""
        least = rest if rest >= _WHOLE_BYTES else 1
        if least != self._least:
            self._least = least
            self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, least)

    def _parse(self, data: memoryview) -> bool:
        """Count the messages in what has come; False when it is not TCPROS."""
        if self._pending:
            data, self._pending = memoryview(self._pending + bytes(data)), b""
        place, end, wanted = 0, len(data), self._wanted
        while end - place >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(data, place)
            if length > self._tally.longest:
                _log.error("%s: a message of %d bytes is none", self._tally.topic, length)
                return False
            there = end - place - _LENGTH.size
            if wanted:
                front = length if wanted == ALL else min(length, wanted)
                if there < front:
                    break
                self._show(data[place + _LENGTH.size : place + _LENGTH.size + front])
            if there < length:
                self._skip = length - there
                return True
            self._count()
            place += _LENGTH.size + length
        if place < end:
            self._pending = bytes(data[place:])
        return True

    def _show(self, front: memoryview) -> None:
        if self._look is not None:
            self._look(front)

    def _count(self) -> None:
        self._tally.count += 1
        self._tally.total += 1


class TopicReader:
    """All connections, read by the thread that calls `wait`.

    Args:
        slice_s: it looks at the connections at most so often, so that many small messages cost one turn.
    """

    def __init__(self, slice_s: float = 0.02) -> None:
        self._slice_s = slice_s
        self._epoll = select.epoll()
        self._streams: Dict[int, TopicStream] = {}
        self._new: SimpleQueue[Tuple[TopicStream, bytes]] = SimpleQueue()
        self._glance = memoryview(bytearray(_GLANCE_BYTES))
        self._gulp: Optional[memoryview] = None
        self._bell, self._ring = os.pipe()
        for fd in (self._bell, self._ring):
            os.set_blocking(fd, False)
        self._epoll.register(self._bell, select.EPOLLIN)

    def add(self, stream: TopicStream, data: bytes = b"") -> None:
        """Read a stream from now on, after what came together with its handshake; from any thread."""
        self._new.put((stream, data))
        self.wake()

    def wake(self) -> None:
        """Have `wait` return now, or the next call at once; from any thread."""
        with suppress(BlockingIOError):  # it has been woken often enough
            os.write(self._ring, b"!")

    def wait(self, limit_s: float) -> None:
        """Wait for messages for a time, and count them."""
        pause_s = min(self._slice_s, limit_s)
        if pause_s > 0:
            time.sleep(pause_s)
        # a second look: when the process was stopped meanwhile, the first one ends by its limit and sees nothing
        for fd, _ in self._epoll.poll(max(0.0, limit_s - pause_s)) or self._epoll.poll(0.0):
            if fd == self._bell:
                self._silence_bell()
                self._admit()
                continue
            stream = self._streams.get(fd)
            if stream is not None and not stream.read(self._buffer(stream)):
                self._remove(stream)

    def close(self) -> None:
        """Close all connections."""
        for stream in list(self._streams.values()):
            self._remove(stream)

    def _admit(self) -> None:
        """Take in the streams that were added."""
        while True:
            try:
                stream, data = self._new.get_nowait()
            except Empty:
                return
            self._streams[stream.fd] = stream
            self._epoll.register(stream.fd, select.EPOLLIN | select.EPOLLRDHUP)
            if not stream.begin(data):
                self._remove(stream)

    def _silence_bell(self) -> None:
        with suppress(BlockingIOError):
            while os.read(self._bell, _GLANCE_BYTES):
                pass

    def _buffer(self, stream: TopicStream) -> memoryview:
        if not stream.whole:
            return self._glance
        if self._gulp is None:
            self._gulp = memoryview(mmap.mmap(-1, _GULP_BYTES))  # has memory as far as it was written to
        return self._gulp

    def _remove(self, stream: TopicStream) -> None:
        del self._streams[stream.fd]
        self._epoll.unregister(stream.fd)
        stream.close()


# --- counting subscriber ----------------------------------------------------------------------------------------------
# A subscriber that counts: rospy registers it, finds the publishers and shakes hands; `topic_reader` reads.
#  rospy has no public way to another transport. This file knows rospy's insides: its table of subscriptions
# (`rospy.topics`), as `reconnector` does, and the loop of a connection that is replaced
# (`TCPROSTransport.receive_loop`).


#: Makes the look at the messages of one publisher from the header of its connection; None: they are only counted.
LookFor = Callable[[Mapping[str, str]], Optional[Look]]


class _CountedTopic(_SubscriberImpl):
    """rospy's side of one topic: connections that are made here are read elsewhere."""

    def __init__(self, name: str, kind: Type[Any], reader: TopicReader, tally: Tally, look_for: LookFor) -> None:
        super().__init__(name, kind)
        self._reader, self._tally, self._look_for = reader, tally, look_for
        self.set_tcp_nodelay(True)

    def add_connection(self, connection: Any) -> Any:
        """Have a connection hand itself over once its handshake is done; on rospy's threads."""
        connection.receive_loop = lambda _callback: self._take_over(connection)
        return super().add_connection(connection)

    def get_stats(self) -> Any:
        """Return what getBusStats says of it; messages are counted by topic, here on the first connection."""
        counts = [self._tally.total] + [0] * len(self.connections)
        rows = [(c.id, c.stat_bytes, count, -1, not c.done) for c, count in zip(self.connections, counts)]
        return self.resolved_name, rows

    def _take_over(self, connection: Any) -> None:
        sock, buffer = connection.socket, connection.read_buff
        if sock is None or connection.done:
            return
        # a duplicate: rospy may close its own at any time, which ends this one by shutdown
        try:
            stream = TopicStream(sock.dup(), self._tally, self._look_for(connection.header), connection.close)
        except BaseException:
            connection.close()  # else it counts as one that is read, and is never made again
            raise
        self._reader.add(stream, buffer.getvalue()[: buffer.tell()])


def subscribe(
    topic: str,
    reader: TopicReader,
    tally: Tally,
    look_for: LookFor = lambda _header: None,
    kind: Type[Any] = rospy.AnyMsg,
) -> None:
    """Count the messages of a topic from now on.

    Args:
        topic: resolved name.
        reader: that reads its connections.
        tally: that counts.
        look_for: makes the look at the messages of each publisher.
        kind: of its messages; publishers of another kind are not connected.

    Raises:
        StartError: This process already subscribes to it otherwise.
    """
    manager = get_topic_manager()
    with manager.lock:
        if manager.get_subscriber_impl(topic) is not None:
            raise StartError(f"{topic} is read by this node for itself and cannot be watched")
        counted = _CountedTopic(topic, kind, reader, tally, look_for)
        counted.ref_count += 1
        manager._add(counted, manager.subs, Registration.SUB)


def take_messages(topic: str, kind: Type[Any], reader: TopicReader, take: Callable[[Any], None]) -> None:
    """Have every message of a topic taken by the thread that reads.

    Args:
        topic: its name, resolved here.
        kind: of its messages.
        reader: that reads its connections.
        take: gets each message; what it raises costs this message alone.

    Raises:
        StartError: This process already subscribes to it otherwise.
    """
    name = rospy.resolve_name(topic)
    subscribe(name, reader, Tally(name, ALL), lambda _header: message_look(name, kind, take), kind)


def message_look(topic: str, kind: Type[Any], take: Callable[[Any], None]) -> Look:
    """Return a look that takes each message, and says what is none; the publisher may go on."""

    def look(data: memoryview) -> None:
        try:
            take(kind().deserialize(bytes(data)))
        except Exception as error:  # genpy raises whatever struct, codecs and its own code raise
            words = f"{topic}: {len(data)} bytes are no {kind._type} that can be used ({error!r})"
            logerr_seldom(_SAY_AGAIN_S, topic, words)

    return look
