"""XXH32, the checksum of lz4 frames, of contents of which only the ends are known.

The checksum (github.com/Cyan4973/xxHash, doc/xxhash_spec.md) goes through stripes of 16 bytes, four numbers each: for
every one of these there is an accumulator. A step can be gone backwards, and for any two values of an accumulator there
is one number that leads from one to the other. So a stripe can be found behind which the accumulators are as they were
at the beginning; what follows it then comes to the same, and the checksum of the longer content can be told from that
of the shorter one: only the length, and the bytes behind the last stripe, are mixed in later.
"""

from __future__ import annotations

import struct
from typing import List, Sequence, Tuple

__all__ = ["STRIPE", "lengthened", "neutral_stripe"]

STRIPE = 16
_MASK = 0xFFFFFFFF
_P1, _P2, _P3, _P4, _P5 = 2654435761, 2246822519, 3266489917, 668265263, 374761393
_Q1, _Q2, _Q3, _Q4 = (pow(prime, (1 << 31) - 1, 1 << 32) for prime in (_P1, _P2, _P3, _P4))  # times them it is 1
_BEGINNING = ((_P1 + _P2) & _MASK, _P2, 0, -_P1 & _MASK)


def neutral_stripe(before: bytes, behind: bytes) -> bytes:
    """Return the stripe that makes a beginning of a content invisible to what follows.

    Args:
        before: whole stripes, from the first byte of the content on.
        behind: whole stripes that follow the one that is returned.
    """
    first, last = struct.unpack(f"<{len(before) // 4}L", before), struct.unpack(f"<{len(behind) // 4}L", behind)
    words = []
    for lane, beginning in enumerate(_BEGINNING):
        there, back = _forward(beginning, first[lane::4]), _backward(beginning, last[lane::4])
        words.append((_backward(back, (0,)) - there) * _Q2 & _MASK)
    return struct.pack("<4L", *words)


def _forward(value: int, words: Sequence[int]) -> int:
    for word in words:
        value = (value + word * _P2) & _MASK
        value = ((value << 13 | value >> 19) & _MASK) * _P1 & _MASK
    return value


def _backward(value: int, words: Sequence[int]) -> int:
    for word in reversed(words):
        value = value * _Q1 & _MASK
        value = ((value >> 13 | value << 19) - word * _P2) & _MASK
    return value


def lengthened(checksum: int, by: int, end: bytes) -> int:
    """Return the checksum of a content, of at least one stripe, behind a beginning that is invisible to it.

    Args:
        checksum: of the content.
        by: bytes of the beginning, whole stripes.
        end: last bytes of the content: those behind its last whole stripe.
    """
    steps = _steps(end)
    value = _unavalanched(checksum)
    for number, _, rotation, inverse in reversed(steps):
        value = value * inverse & _MASK
        value = ((value >> rotation | value << 32 - rotation) - number) & _MASK
    value += by
    for number, factor, rotation, _ in steps:
        value = (value + number) & _MASK
        value = ((value << rotation | value >> 32 - rotation) & _MASK) * factor & _MASK
    return _avalanched(value & _MASK)


def _steps(end: bytes) -> List[Tuple[int, int, int, int]]:
    """Return what is done with each number of the end: (added, factor, rotation before, inverse of the factor)."""
    whole = len(end) // 4
    words = [(word * _P3, _P4, 17, _Q4) for word in struct.unpack_from(f"<{whole}L", end)]
    return words + [(byte * _P5, _P1, 11, _Q1) for byte in end[4 * whole :]]


def _avalanched(value: int) -> int:
    value = (value ^ value >> 15) * _P2 & _MASK
    value = (value ^ value >> 13) * _P3 & _MASK
    return value ^ value >> 16


def _unavalanched(value: int) -> int:
    value = (value ^ value >> 16) * _Q3 & _MASK
    value = (value ^ value >> 13 ^ value >> 26) * _Q2 & _MASK
    return value ^ value >> 15 ^ value >> 30
