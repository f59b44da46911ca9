"""A compressed chunk that is almost all one message gets another beginning, without being decompressed.

Recorders close a chunk with the message that fills it, so a chunk of a camera is a few small messages and one image. A
merge has to put the small ones elsewhere, and to write another connection into the image's header. But lz4 refers back:
nothing in a compressed block can be changed or taken out. It can be hidden. A header may have fields that nobody
knows, and so the frame gets one more block in front, with the beginning of a new header:

    length, conn=, op=, time=, pad=<some bytes>, was=     the new block
    the small messages and the image's old header          } the old blocks:
    the image's length, the image                          } not a byte of them is changed

All that stood before the image's length is now the value of `was`, and the image is the only message of its chunk. The
checksum of the whole content is told from the old one by the bytes of `pad`, see xxh32. Where frame or chunk are not
just so, nothing is done, and the chunk has to be decompressed.
"""

from __future__ import annotations

import struct
from typing import List, NamedTuple, Optional, Tuple

from .blocks import block_beginning, block_end
from .errors import RecordError
from .layout import MESSAGE, Record, message_fields, pack_field, record_at, u32
from .xxh32 import STRIPE, lengthened, neutral_stripe

__all__ = ["HIDDEN", "LARGE", "ROOM", "Message", "Wrapped", "wrapped"]

LARGE = 64 << 10  # bytes of a message that are worth it
HIDDEN = 16  # times less is hidden at most
_HEADER = 512  # bytes of a message's header, mostly
_FRAME = b"\x04\x22\x4d\x18\x64"  # what roslz4 reads: independent blocks, a checksum of the content, nothing else
_FRAME_HEADER = 7
_PLAIN = 1 << 31  # set in the size of a block that is not compressed
_PREFIX = 96  # bytes of the new beginning
_STRIPE_AT = 64
ROOM = _PREFIX + 4  # bytes that are needed in front of a frame


class Message(NamedTuple):
    """What an index says of a message."""

    t_ns: int
    connection: int
    offset: int


class Wrapped(NamedTuple):
    """A frame with a new beginning.

    Args:
        start: where it begins in the buffer; where it ends has not changed.
        size: of its content.
        hidden: the old content up to the large message.
    """

    start: int
    size: int
    hidden: bytes


_Blocks = List[Tuple[memoryview, bool]]  # what is stored of each, and whether it is compressed


def wrapped(
    buffer: bytearray, start: int, end: int, size: int, message: Message, target: Optional[Message]
) -> Optional[Wrapped]:
    """Give a frame a new beginning in place; None where that is not possible, and nothing was changed.

    Args:
        buffer: with the frame, and ROOM bytes before it.
        start: where the frame begins.
        end: where it ends.
        size: of its content.
        message: the large one, last of the chunk, as the index says.
        target: as it is to be; None to leave the frame as it is, when nothing else is in it.
    """
    blocks = _blocks(buffer, start, end)
    if not blocks:
        return None
    content = _beginning(blocks, message.offset, size // HIDDEN)
    record = _record(content, message)
    if record is None or record.end != size or record.size < LARGE:
        return None
    if target is None and message.offset == 0:
        return Wrapped(start, size, b"")
    tail = _tail(blocks, size % STRIPE)
    if tail is None:
        return None
    checksum = lengthened(u32(buffer, end - 4), _PREFIX, tail)
    prefix = _prefix(target or message, record.data - 4)
    head = bytes(buffer[start : start + _FRAME_HEADER]) + struct.pack("<L", _PREFIX | _PLAIN) + prefix
    buffer[start - ROOM : start + _FRAME_HEADER] = head
    buffer[end - 4 : end] = struct.pack("<L", checksum)
    return Wrapped(start - ROOM, size + _PREFIX, content[: message.offset])


def _blocks(buffer: bytearray, start: int, end: int) -> _Blocks:
    """Return the blocks of a frame of the expected kind; none of any other."""
    found: _Blocks = []
    place, view = start + _FRAME_HEADER, memoryview(buffer)
    if view[start : start + len(_FRAME)] != _FRAME:
        return found
    while place <= end - 8:
        size = u32(buffer, place) & ~_PLAIN
        if not size:
            break
        found.append((view[place + 4 : place + 4 + size], size == u32(buffer, place)))
        place += 4 + size
    return found if place == end - 8 else []


def _beginning(blocks: _Blocks, offset: int, most: int) -> bytes:
    """Return the first bytes of the content, with the header at an offset; nothing when that is too far away."""
    content = _first(blocks, offset + _HEADER)
    if offset + 4 > len(content):
        return b""
    end = offset + 8 + u32(content, offset)
    if max(offset, end) > most:
        return b""
    return content if end <= len(content) else _first(blocks, end)


def _first(blocks: _Blocks, size: int) -> bytes:
    """Return so many bytes, fewer where there are no more."""
    content = b""
    for stored, is_compressed in blocks:
        missing = size - len(content)
        if missing <= 0:
            break
        content += block_beginning(stored, missing) if is_compressed else bytes(stored[:missing])
    return content


def _tail(blocks: _Blocks, size: int) -> Optional[bytes]:
    stored, is_compressed = blocks[-1]
    tail = block_end(stored, size) if is_compressed else bytes(stored[len(stored) - size :])
    return tail if tail is not None and len(tail) == size else None


def _record(content: bytes, message: Message) -> Optional[Record]:
    try:
        record = record_at(content, message.offset, len(content))
        said = record.op, record.number(b"conn"), record.time_ns(b"time")
    except (RecordError, struct.error):
        return None
    return record if said == (MESSAGE, message.connection, message.t_ns) else None


def _prefix(message: Message, hidden: int) -> bytes:
    """Return the beginning of a record whose header goes on for some bytes."""
    fields = message_fields(message.connection, message.t_ns)
    length = struct.pack("<L", _PREFIX - 4 + hidden)
    was = struct.pack("<L", len(b"was=") + hidden) + b"was="
    pad = _PREFIX - len(length) - len(fields) - len(was) - len(pack_field(b"pad", b""))
    whole = length + fields + pack_field(b"pad", bytes(pad)) + was
    before, behind = whole[:_STRIPE_AT], whole[_STRIPE_AT + STRIPE :]
    return before + neutral_stripe(before, behind) + behind
