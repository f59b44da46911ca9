"""What can be wrong with a bag.

BagError           the bag as a whole cannot be read, or a new one not be made of it
  NotClosedError   it was not closed, nothing else is wrong
MessageError       one message cannot be read; the rest can
RecordError        bytes are not what the format says they are; turned into one of the others, or into damage
"""

from __future__ import annotations


def cut_words(name: str, end: int, size: int) -> str:
    """Return that a log was cut: what follows its last whole record; empty when it ends with that.

    Args:
        name: of the file.
        end: of its last whole record.
        size: of the file.
    """
    if end == size:
        return ""
    return f"{name}: its last {size - end} bytes, from byte {end} on, are no whole record: it was cut there"


class BagError(ValueError):
    """A bag cannot be read. Its text is one line: `file: what is wrong; what to do`.

    Args:
        path: the file.
        wrong: what is wrong.
        remedy: what to do about it.
    """

    def __init__(self, path: str, wrong: str, remedy: str) -> None:
        super().__init__(f"{path}: {wrong}; {remedy}")
        self.path, self.wrong, self.remedy = path, wrong, remedy


class NotClosedError(BagError):
    """A bag was not closed: it has no index, and nothing else is wrong with it."""


class MessageError(ValueError):
    """One message cannot be read: its chunk is damaged, or its bytes are not what its definition says."""


class UndecodableError(MessageError):
    """A message is whole, but in an encoding, or of a type, that nobody here decodes."""


class RecordError(ValueError):
    """Bytes are no record, or not the one that they should be."""


class NotABagError(RecordError):
    """A file does not begin as a bag does.

    Args:
        other: what it is, and what can be done with it; empty: nobody knows.
        empty: there is nothing in it.
    """

    def __init__(self, other: str = "", *, empty: bool = False) -> None:
        super().__init__("is empty" if empty else f"is no bag but {other}" if other else "is no bag")
        self.other, self.empty = other, empty


class OtherBagError(RecordError):
    """A file is a bag that is not read: encrypted, of another version, or converted as if it were text."""
