"""What every way to the vehicle does for its client: one lock, questions under it, waiting for what comes, errors told.

A client is pure: it is given times and messages and returns the messages to send. All of its methods are called under
the lock of its host, so that other threads may ask it and wait for what becomes of it.
"""

from __future__ import annotations

import threading
from typing import Callable, Iterable, Protocol, Sequence, Tuple, TypeVar

from .dialect import Message

__all__ = ["Client", "ClientHost"]

T = TypeVar("T")


class Client(Protocol):
    """What lives on a link. Both return the messages to send; the link addresses and sequences nothing else."""

    def receive(self, t_ns: int, message: Message) -> Iterable[Message]:
        """Take a message of the vehicle."""

    def wake(self, t_ns: int) -> Iterable[Message]:
        """Look at the time, 20 times a second."""


class ClientHost:
    """Holds a client; who inherits from it sends what `_transmit` is given.

    Args:
        client: what lives on the link.
        now_ns: the clock that stamps what the client is given.
        complain: is told of each new kind of problem.
    """

    def __init__(self, client: Client, now_ns: Callable[[], int], complain: Callable[[str], None]) -> None:
        self._client, self._now_ns, self._complain = client, now_ns, complain
        self._changed = threading.Condition(threading.RLock())
        self._errors, self._complaint = 0, ""

    def ask(self, question: Callable[[int], Tuple[T, Sequence[Message]]]) -> T:
        """Call a function of the client with the time, under the lock; it returns an answer and messages to send."""
        with self._changed:
            answer, messages = question(self._now_ns())
            self._transmit(messages)
            self._changed.notify_all()
            return answer

    def wait_for(self, condition: Callable[[], T], limit_s: float) -> T:
        """Wait until a condition on the client is true; return its last value. It is looked at on each message."""
        with self._changed:
            return self._changed.wait_for(condition, limit_s)

    def _transmit(self, messages: Iterable[Message]) -> None:
        """Send messages; called under the lock."""
        raise NotImplementedError

    def _tell(self, call: Callable[[], Iterable[Message]]) -> None:
        """Call the client; a defect in it must not cost the heartbeat and all the rest."""
        try:
            self._transmit(call())
        except Exception as error:  # noqa: BLE001 - whatever it is
            self._errors += 1
            self._say(f"{type(error).__name__}: {error}")

    def _say(self, words: str) -> None:
        """Complain, once of the same."""
        if words != self._complaint:
            self._complaint = words
            self._complain(words)
