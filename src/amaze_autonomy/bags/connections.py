"""Connections: the publishers of topics, and which of them are the same in several bags."""

from __future__ import annotations

import re
from typing import NamedTuple, Tuple

from .errors import RecordError
from .layout import Record, fields_of

__all__ = ["Connection", "Identity", "connection_of"]

Identity = Tuple[str, str, str, bool, str]


class Connection(NamedTuple):
    """One publisher of a topic, as a recorder saw it.

    Args:
        number: in its bag.
        topic: its name; bytes that are not UTF-8 are kept as surrogates.
        kind: the type of its messages, e.g. "sensor_msgs/Imu".
        md5: of the type's definition.
        caller: name of the publishing node; "" when the bag does not say.
        latching: whether late subscribers get its last message.
        header: all that was recorded about it, the definition included.
    """

    number: int
    topic: str
    kind: str
    md5: str
    caller: str
    latching: bool
    header: bytes

    @property
    def plausible(self) -> bool:
        """Return whether nothing in it looks damaged."""
        texts = (self.topic, self.kind, self.caller)
        damaged = any(not text.isprintable() for text in texts)  # surrogates, bytes that are no UTF-8, are not
        complete = b"message_definition=" in self.header and "/" in self.kind
        return complete and not damaged and re.fullmatch("[0-9a-f]{32}", self.md5) is not None

    def identity(self, *, publishers_apart: bool = True) -> Identity:
        """Return what two connections have in common when they are the same one."""
        return self.topic, self.kind, self.md5, self.latching, self.caller if publishers_apart else ""


def connection_of(record: Record, header: bytes) -> Connection:
    """Return the connection that a record describes.

    Raises:
        RecordError: It does not say which type on which topic.
    """
    fields = fields_of(header, 0, len(header))
    topic = record.fields.get(b"topic", fields.get(b"topic"))
    if topic is None or b"type" not in fields or b"md5sum" not in fields:
        raise RecordError("a connection does not say its topic and type")
    return Connection(
        number=record.number(b"conn"),
        topic=_text(topic),
        kind=_text(fields[b"type"]),
        md5=_text(fields[b"md5sum"]),
        caller=_text(fields.get(b"callerid", b"")),
        latching=fields.get(b"latching") == b"1",
        header=header,
    )


def _text(value: bytes) -> str:
    return value.decode("utf-8", "surrogateescape")
