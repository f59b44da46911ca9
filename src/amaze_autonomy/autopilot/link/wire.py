"""Bytes to messages and messages to bytes; pure, one for each link.

Only messages that somebody wants are decoded: of the others the checksum alone is looked at, which costs a tenth.
"""

from __future__ import annotations

from typing import Any, Dict, FrozenSet, Iterable, Iterator, List, Optional, Tuple

from .dialect import Message, mavlink, message_id
from .framing import Frame, FrameReader, FrameTally
from .signing import SigningKey, Stamps, Verifier

__all__ = ["Wire"]

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
        """Yield each good frame that these bytes complete, and its message; None: not wanted, or not well signed."""
        for frame in self._reader(source).feed(data):
            yield frame, self._message(frame, unix_ns)

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

    def _message(self, frame: Frame, unix_ns: int) -> Optional[Message]:
        if self._wanted is not None and frame.number not in self._wanted:
            return None
        if self.verifier is not None and not self.verifier.accepts(frame, unix_ns):
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
