"""Small bags with known contents, and what is in a bag as the rosbags library reads it."""

from __future__ import annotations

import bz2
import hashlib
import os
import re
import signal
import struct
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

from replay_bags import START_NS, make, write_bag
from rosbags.rosbag1 import Reader

from amaze_autonomy.bags.format import CHUNK_INFO, CONNECTION, chunk_header, chunk_info, index_header, record_at
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.write import Output

MS = 1_000_000
ENDS_WITHIN_S = 10.0
COMPRESSIONS = ("none", "lz4", "bz2")
DATA = Path(os.environ.get("AMAZE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))


def text(value):
    return make("std_msgs/msg/String", data=value)


def rows(topic, count, period_ms=10, first_ms=0, tag="", caller=None):
    """Return messages that are all different: number, topic and a filling of changing length."""
    found = []
    for each in range(count):
        t_ns = START_NS + (first_ms + each * period_ms) * MS
        row = (t_ns, topic, text(f"{tag}{topic} {each} " + "x" * (each * 7 % 90)))
        found.append(row if caller is None else (*row, caller))
    return found


def bag(path, *streams, compression="none", chunk_bytes=2000, callers=None):
    """Write a bag of several streams in order of time; return its path."""
    everything = sorted((row for stream in streams for row in stream), key=lambda row: row[0])
    return write_bag(path, everything, compression, callers=callers, chunk_bytes=chunk_bytes)


def contents(path):
    """Return (time, topic, bytes) of all messages, in the order of the rosbags library."""
    with Reader(path) as reader:
        return [(t_ns, connection.topic, bytes(raw)) for connection, t_ns, raw in reader.messages()]


def multiset(*paths):
    return Counter(message for path in paths for message in contents(path))


def digest(path):
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@contextmanager
def ending():
    """Fail what does not end."""

    def fail(*_):
        raise AssertionError(f"it has not ended within {ENDS_WITHIN_S} s")

    before = signal.signal(signal.SIGALRM, fail)
    signal.setitimer(signal.ITIMER_REAL, ENDS_WITHIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def flipped(path, raw, at, bit):
    """Write a file with one wrong bit."""
    path.write_bytes(raw[:at] + bytes([raw[at] ^ 1 << bit]) + raw[at + 1 :])


def left_over(folder):
    """Return the hidden files of a folder: temporary ones that nobody removed."""
    return sorted(path.name for path in Path(folder).iterdir() if path.name.startswith("."))


def message_ends(path):
    """Return where each message of an uncompressed bag ends in the file, in the order of the file."""
    with Index(path) as index:
        messages, ends = index.messages(), []
        raw = Path(path).read_bytes()
        for chunk, offset in zip(messages.chunk.tolist(), messages.offset.tolist()):
            start = index.head(chunk).data + offset
            data = start + 4 + struct.unpack_from("<L", raw, start)[0]
            ends.append(data + 4 + struct.unpack_from("<L", raw, data)[0])
    return sorted(ends)


def chunk_ends(path):
    """Return (end of the data, messages) of each chunk."""
    with Index(path) as index:
        heads = [index.head(each) for each in range(len(index.chunks))]
        return [(head.data + head.stored, chunk.messages) for head, chunk in zip(heads, index.chunks)]


def reindexed(path, output, change):
    """Write a closed bag with another index.

    Args:
        path: of a bag.
        output: path of the other one.
        change: takes the records of connections and those of chunks, and returns those that the index is to have.
    """
    raw = path.read_bytes()
    with Index(path) as index:
        place, position = index.position, index.position
    found = {CONNECTION: [], CHUNK_INFO: []}
    while place < len(raw):
        record = record_at(raw, place, len(raw))
        found[record.op].append(raw[place : record.end])
        place = record.end
    body, counted = raw[:position], change(found[CONNECTION], found[CHUNK_INFO])
    for name, records in zip((b"conn_count=", b"chunk_count="), counted):
        at = body.index(name) + len(name)
        body = body[:at] + struct.pack("<L", len(records)) + body[at + 4 :]
    output.write_bytes(body + b"".join(record for records in counted for record in records))
    return output


def unclosed(path, output, cut=None):
    """Write what is on the disk when a recorder is killed in its last chunk: no index, and no sizes in that chunk."""
    raw = bytearray(path.read_bytes())
    with Index(path) as index:
        last = index.chunks[-1]
        head = index.head(len(index.chunks) - 1)
    del raw[head.data + head.stored :]
    begin = bytes(raw[last.position : head.data])
    at = last.position + begin.index(b"size=") + 5
    raw[at : at + 4] = raw[head.data - 4 : head.data] = bytes(4)
    raw = bytearray(re.sub(rb"index_pos=.{8}", b"index_pos=" + bytes(8), bytes(raw), count=1, flags=re.DOTALL))
    output.write_bytes(raw[: len(raw) - cut] if cut else raw)
    return output


def bomb(path, unpacks, says, message=None):
    """Write a bag of one bz2 chunk that says to have so many bytes, and unpacks to so many.

    Args:
        path: of the bag.
        unpacks: bytes of zeros.
        says: bytes, by the chunk's header.
        message: of the one topic, /a, that its index names.
    """
    one = rows("/a", 1) if message is None else [(START_NS, "/a", message)]
    source = bag(path.with_name("good.bag"), one)
    data = bz2.compress(bytes(unpacks))
    with Index(source) as index, Output(path) as out:
        entries = index_header(0, 1) + struct.pack("<3L", START_NS // 10**9, 0, 0)
        header = chunk_header("bz2", says, len(data))
        out._infos.append(chunk_info(out.position, START_NS, START_NS, [(0, 1)]))
        out.position += out._write([header, data, entries])
        out.close(index.connections)
    return path


CALLS = ("pwrite", "ftruncate", "fsync", "rename", "replace", "unlink", "open")
KILLED = 77


def killed_at(action, call):
    """Do something in a process that is killed at its n-th call that changes something, half way through a write."""
    child = os.fork()
    if child:
        return os.WEXITSTATUS(os.waitpid(child, 0)[1]) == KILLED
    count = [0]

    def wrapped(function):
        def replacement(*arguments, **options):
            count[0] += 1
            if count[0] == call:
                if function is pwrite:
                    function(arguments[0], bytes(arguments[1])[: len(arguments[1]) // 2], *arguments[2:])
                os._exit(KILLED)
            return function(*arguments, **options)

        return replacement

    pwrite = os.pwrite
    for name in CALLS:
        setattr(os, name, wrapped(getattr(os, name)))
    try:
        action()
    finally:
        os._exit(0)


def every_kill(action):
    """Yield after each possible kill of an action; the caller puts things in order for the next."""
    call = 1
    while killed_at(action, call):
        yield call
        call += 1
    assert call > 9  # it did come to all of them
