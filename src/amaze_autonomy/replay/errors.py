"""What can end a replay before it has an answer. Each is one line for the user and exit status 2.

ReplayError          base
  FieldError         a field that the topic map names is not in the message
  EditError          a fault asks for a value that a field cannot have
  UnknownTopicError  a topic that the map needs is not in any of the bags
  NoMessagesError    the bags hold no message that the map needs
  JournalGapError    lines are missing in a journal from a bag
  DamagedInputError  a recording is not the one that a scenario names
  GoldenError        a golden cannot be read, or may not be accepted
"""

from __future__ import annotations

from typing import Tuple


class ReplayError(ValueError):
    """A replay cannot be done."""


class FieldError(ReplayError):
    """A field that the topic map names is not in the message.

    Args:
        path: of the field, as in the map.
        kind: type of the message, or of the part of it that lacks the field.
        known: what it has.
    """

    def __init__(self, path: str, kind: str, known: Tuple[str, ...]) -> None:
        super().__init__(f"{path}: {kind} has no such field; it has {', '.join(known) or 'none'}")
        self.path, self.kind, self.known = path, kind, known


class EditError(ReplayError):
    """A fault of a scenario asks for a value that a field of the messages cannot have.

    Args:
        path: of the field.
        fault: its kind.
        reason: what does not fit, and what would.
    """

    def __init__(self, path: str, fault: str, reason: str) -> None:
        super().__init__(f"fault {fault}: {path} {reason}")
        self.path, self.fault, self.reason = path, fault, reason


class MisfitError(ReplayError):
    """Messages of a topic are not what the map takes them for.

    Args:
        topic: its name.
        kind: type of its messages.
        reason: what does not fit.
    """

    def __init__(self, topic: str, kind: str, reason: str) -> None:
        super().__init__(f"{topic}: {kind} is not what the map takes it for: {reason}")
        self.topic, self.kind, self.reason = topic, kind, reason


class UnknownTopicError(ReplayError):
    """A topic that was named is in none of the bags.

    Args:
        topic: the one that was named.
        known: the topics that are there.
    """

    def __init__(self, topic: str, known: Tuple[str, ...]) -> None:
        super().__init__(f"{topic}: no bag has this topic; there are {', '.join(known) or 'none'}")
        self.topic, self.known = topic, known


class NoMessagesError(ReplayError):
    """The bags hold no message that the map needs."""


class TimeJumpError(ReplayError):
    """There is nothing for hours between two messages.

    Args:
        before_ns: time of the message before.
        after_ns: time of the message after.
    """

    def __init__(self, names: str, before_ns: int, after_ns: int) -> None:
        gap = f"{(after_ns - before_ns) / 3.6e12:,.1f} h"
        words = f"between {before_ns / 1e9:.3f} s and {after_ns / 1e9:.3f} s: a clock was set, or the index is damaged"
        super().__init__(f"{names}: no message for {gap} {words}; cut it there with `amaze-bag cut`")
        self.before_ns, self.after_ns = before_ns, after_ns


class JournalGapError(ReplayError):
    """Lines are missing in a journal from a bag."""


class DamagedInputError(ReplayError):
    """A recording is not the one that a scenario was written for: its content has another hash."""


class GoldenError(ReplayError):
    """A golden cannot be read, or may not be accepted now."""
