"""Bytes to messages and messages to bytes; pure, one for each link.

Only messages that somebody wants are decoded: of the others the checksum alone is looked at, which costs a tenth.
"""

from __future__ import annotations

import hashlib
import hmac
import stat
from pathlib import Path
from typing import Any, Dict, FrozenSet, Iterable, Iterator, List, Optional, Protocol, Tuple

from ..errors import KeyFileError
from .dialect import Message, mavlink, message_id
from .framing import Frame, FrameReader, FrameTally

# --- signing ----------------------------------------------------------------------------------------------------------
# https://mavlink.io/en/guide/message_signing.html: 6 bytes of SHA-256 over key, frame, link id and a time stamp of 10
# us since 2015 that must grow in each stream (system, component, link). The time of a stream that is heard for the
# first time may lie at most a minute behind ours.


KEY_BYTES = 32
_EPOCH_2015_S = 1_420_070_400
_UNIT_NS = 10_000
_MINUTE = 60 * 100_000
_TAIL = 6
_STREAMS_KEPT = 64
_NEVER_SIGNED = (mavlink.MAVLINK_MSG_ID_RADIO_STATUS,)  # made by the radio, which has no key
_FORM = "must be 64 hexadecimal digits, or 32 bytes as they are"

SigningKey = bytes


def read_key(path: Path) -> SigningKey:
    """Return the key in a file of 64 hexadecimal digits or of exactly 32 bytes.

    Raises:
        KeyFileError: It cannot be read, is no key, or others may read it.
    """
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):  # whoever opens a FIFO waits for ever, and a device never ends
            raise KeyFileError(str(path), "is no file", "must be a file with the key")
        content = path.read_bytes()
    except OSError as error:
        raise KeyFileError(str(path), error.strerror or "cannot be read", "must be a file with the key") from None
    if stat.S_IMODE(mode) & 0o077:
        raise KeyFileError(str(path), "others may read or write the key", f"do: chmod 600 {path}")
    if len(content) == KEY_BYTES:
        return content
    try:
        key = bytes.fromhex(content.decode("ascii").strip())
    except ValueError:
        raise KeyFileError(str(path), "holds no key", _FORM) from None
    if len(key) != KEY_BYTES:
        raise KeyFileError(str(path), f"holds {len(key)} bytes", _FORM)
    return key


def time_stamp(unix_ns: int) -> int:
    """Return a wall time as signatures have it."""
    return max(0, (unix_ns - _EPOCH_2015_S * 1_000_000_000) // _UNIT_NS)


class Stamps(Protocol):
    """Whoever keeps the time stamp over a restart."""

    newest: int

    def use(self, stamp: int) -> None:
        """Note that a time stamp is used."""

    def close(self) -> None:
        """Note that none will follow."""


class Verifier:
    """Judges the signatures of what comes in, and keeps the time stamp of what goes out.

    Args:
        key: shared with the vehicle.
        stamps: where the time stamp is kept; None: in memory.
    """

    def __init__(self, key: SigningKey, stamps: Optional[Stamps] = None) -> None:
        self.key = key
        self.refused = 0
        self._stamps = stamps
        self._newest = 0 if stamps is None else stamps.newest
        self._streams: Dict[Tuple[int, int, int], int] = {}

    def accepts(self, frame: Frame, unix_ns: int) -> bool:
        """Tell whether a frame is from somebody who has the key, and new."""
        good = frame.number in _NEVER_SIGNED or (frame.signed and self._verified(frame, unix_ns))
        self.refused += not good
        return good

    def stamp(self, unix_ns: int) -> int:
        """Return the time stamp of the next frame that goes out."""
        self._newest = max(self._newest + 1, time_stamp(unix_ns))
        if self._stamps is not None:
            self._stamps.use(self._newest)
        return self._newest

    def close(self) -> None:
        """Keep the time stamp; nothing more goes out."""
        if self._stamps is not None:
            self._stamps.close()

    def _verified(self, frame: Frame, unix_ns: int) -> bool:
        signed, tail = frame.raw[:-_TAIL], frame.raw[-_TAIL:]
        if not hmac.compare_digest(hashlib.sha256(self.key + signed).digest()[:_TAIL], tail):
            return False
        stamp = int.from_bytes(signed[-6:], "little")
        stream = (frame.system, frame.component, signed[-7])
        before = self._streams.get(stream)
        if not self._fresh(stamp, before, unix_ns) or (before is None and len(self._streams) >= _STREAMS_KEPT):
            return False
        self._streams[stream] = stamp
        self._newest = max(self._newest, stamp)
        return True

    def _fresh(self, stamp: int, before: Optional[int], unix_ns: int) -> bool:
        if before is not None:
            return stamp > before
        return stamp + _MINUTE >= max(self._newest, time_stamp(unix_ns))


# --- one link ---------------------------------------------------------------------------------------------------------


_SOURCES_KEPT = 16


class Wire:
    """One end of a MAVLink link.

    Args:
        system: own system id.
        component: own component id.
        wanted: names of the messages to decode; None: all.
        key: for signing; None: neither signed nor verified.
        stamps: where the time stamp of signatures is kept; None: in memory.
    """

    def __init__(
        self,
        system: int,
        component: int,
        wanted: Optional[Iterable[str]] = None,
        key: Optional[SigningKey] = None,
        stamps: Optional[Stamps] = None,
    ) -> None:
        self.tally = FrameTally()
        self.verifier = None if key is None else Verifier(key, stamps)
        self._wanted: Optional[FrozenSet[int]] = None if wanted is None else frozenset(map(message_id, wanted))
        self._readers: Dict[Any, FrameReader] = {}
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.link_id = component
            self._mav.signing.sign_outgoing = True

    @property
    def kept(self) -> int:
        """How many bytes wait for the rest of their frame."""
        return sum(reader.kept for reader in self._readers.values())

    def receive(self, data: bytes, source: Any = None, unix_ns: int = 0) -> List[Message]:
        """Return the wanted messages that these bytes complete.

        Args:
            data: as they came.
            source: whom from; bytes of different sources are never put together.
            unix_ns: wall time, for signatures.
        """
        return [message for _, message in self.each(data, source, unix_ns) if message is not None]

    def each(self, data: bytes, source: Any = None, unix_ns: int = 0) -> Iterator[Tuple[Frame, Optional[Message]]]:
        """Yield each good frame that these bytes complete, well signed where there is a key; its message, if wanted."""
        for frame in self._reader(source).feed(data):
            if self.verifier is None or self.verifier.accepts(frame, unix_ns):
                yield frame, self._message(frame)

    def send(self, message: Message, unix_ns: int = 0) -> bytes:
        """Return a message as bytes, signed when there is a key."""
        if self.verifier is not None:
            self._mav.signing.timestamp = self.verifier.stamp(unix_ns)
        packed: bytes = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return packed

    def forget(self) -> None:
        """Forget half frames; for a link that was opened again."""
        self._readers.clear()

    def _reader(self, source: Any) -> FrameReader:
        reader = self._readers.get(source)
        if reader is None:
            if len(self._readers) >= _SOURCES_KEPT:
                del self._readers[next(iter(self._readers))]
            reader = self._readers[source] = FrameReader(self.tally)
        return reader

    def _message(self, frame: Frame) -> Optional[Message]:
        if self._wanted is not None and frame.number not in self._wanted:
            return None
        return decode(frame)


def decode(frame: Frame) -> Message:
    """Return the message of a frame."""
    kind = mavlink.mavlink_map[frame.number]
    size = kind.unpacker.size
    values = kind.unpacker.unpack(frame.payload[:size].ljust(size, b"\0"))
    message = kind(*_fields(kind, values))
    message._header = mavlink.MAVLink_header(  # noqa: SLF001 - as pymavlink's own decoder does
        frame.number, mlen=len(frame.payload), seq=frame.sequence, srcSystem=frame.system, srcComponent=frame.component
    )
    message._signed = frame.signed  # noqa: SLF001
    return message


_Slot = Tuple[int, int]  # where its value stands, and how many make an array (0: none)
_PLACES: Dict[int, List[_Slot]] = {}


def _fields(kind: Any, values: Tuple[Any, ...]) -> List[Any]:
    """Return the values of a payload in the order of the message's fields."""
    places = _PLACES.get(kind.id)
    if places is None:
        places = _PLACES[kind.id] = _slots(kind)
    return [_text(values[at]) if not count else list(values[at : at + count]) for at, count in places]


def _slots(kind: Any) -> List[_Slot]:
    at, slots = 0, []
    for length, array in zip(kind.lengths, kind.array_lengths):
        is_text = length == 1
        slots.append((at, 0 if is_text else array))
        at += length
    return [slots[order] for order in kind.orders]


def _text(value: Any) -> Any:
    return value.rstrip(b"\0") if isinstance(value, bytes) else value
