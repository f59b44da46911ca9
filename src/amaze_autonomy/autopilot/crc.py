"""The checksum of MAVLink (CRC-16/MCRF4XX) at the speed of C.

It is the CCITT polynomial of `binascii.crc_hqx` with all bits in the other order: so bytes go in reversed, and the
result is reversed. https://mavlink.io/en/guide/serialization.html#checksum
"""

from __future__ import annotations

import binascii

__all__ = ["crc16"]

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_START = 0xFFFF


def crc16(data: bytes) -> int:
    """Return the checksum of bytes."""
    turned = binascii.crc_hqx(data.translate(_REVERSED), _START)
    return _REVERSED[turned & 0xFF] << 8 | _REVERSED[turned >> 8]
