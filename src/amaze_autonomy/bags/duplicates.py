"""Messages that several computers recorded, found by their bytes.

Two messages are the same one when they come from different inputs, on the same connection but for its publisher if one
of the inputs does not know it, have the same bytes, and were recorded within a window of time. Each message is the
partner of one other at most in each input, so that a publisher that repeats itself keeps as many messages as the
recording with the most of them.
"""

from __future__ import annotations

import zlib
from collections import deque
from typing import Any, Deque, Dict, NamedTuple, Set, Tuple

import numpy as np

__all__ = ["Duplicates"]

_Key = Tuple[int, int, int, bytes]


class _Seen(NamedTuple):
    t_ns: int
    sources: Set[int]


class Duplicates:
    """Finds messages that were seen before in another input; they come in order of time.

    Args:
        shared: connections of the output that come from several inputs; the same number for those that are to be
            compared with each other.
        window_ns: how far apart in time two records of one message are.
    """

    def __init__(self, shared: Dict[int, int], window_ns: int) -> None:
        self._shared, self._window_ns = shared, window_ns
        self._seen: Dict[_Key, Deque[_Seen]] = {}
        self._order: Deque[Tuple[int, _Key]] = deque()
        self._compared = np.array(sorted(shared), np.int64)

    def candidates(self, connection: Any) -> Any:
        """Return the places of messages that could be duplicates."""
        return np.flatnonzero(np.isin(connection, self._compared)) if len(self._compared) else np.zeros(0, np.int64)

    def known(self, t_ns: int, connection: int, source: int, payload: Any) -> bool:
        """Return whether a message was seen before in another input; remember it. Times ascend."""
        self._forget(t_ns - self._window_ns)
        key = (self._shared[connection], len(payload), zlib.crc32(payload), bytes(payload[:16]))
        seen = self._seen.setdefault(key, deque())
        for each in seen:
            if source not in each.sources:
                each.sources.add(source)
                return True
        seen.append(_Seen(t_ns, {source}))
        self._order.append((t_ns, key))
        return False

    def _forget(self, before_ns: int) -> None:
        while self._order and self._order[0][0] < before_ns:
            _, key = self._order.popleft()
            seen = self._seen[key]
            seen.popleft()
            if not seen:
                del self._seen[key]
