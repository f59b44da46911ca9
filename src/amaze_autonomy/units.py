"""Times and sizes as they are counted: nanoseconds and bytes."""

from __future__ import annotations

SECOND = 1_000_000_000
"""Nanoseconds."""

MB, GB = 1_000_000, 1_000_000_000
"""Bytes."""
