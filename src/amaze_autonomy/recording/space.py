"""Is there space for a mission, and how long will it last: sizes in, one line or nothing out."""

from __future__ import annotations

from typing import Optional, Sequence

from amaze_autonomy.config.recording_schema import Storage, TopicGroup

from .sight import Space

__all__ = ["needed_bytes", "reserve_bytes", "time_left_s", "too_little"]

_MB, _GB = 1_000_000, 1_000_000_000
_MARGIN = 1.5  # a mission holds, and collects


def reserve_bytes(storage: Storage) -> int:
    """Return the free space at which recording stops."""
    return storage.reserve_mb * _MB


def needed_bytes(storage: Storage, groups: Sequence[TopicGroup], duration_s: float) -> int:
    """Return the free space that a mission of this length needs on a platform that records these groups."""
    expected = sum(group.expected_mb_s for group in groups) * _MB * duration_s * _MARGIN
    return max(round(storage.min_free_gb * _GB), reserve_bytes(storage) + round(expected))


def too_little(storage: Storage, needed: int, space: Space, folder: str) -> str:
    """Return why there is too little space to begin; an empty text when there is enough."""
    if space.free_bytes < needed:
        return (
            f"{space.free_bytes / _GB:.2f} GB are free in {folder}, {needed / _GB:.2f} GB are needed for this mission: "
            "make space"
        )
    if space.free_fraction < storage.min_free_fraction:
        return (
            f"{space.free_fraction:.1%} of the storage of {folder} is free, at least {storage.min_free_fraction:.1%} "
            "must be: make space"
        )
    return ""


def time_left_s(space: Optional[Space], rate: float, reserve: int) -> Optional[float]:
    """Return how long the space lasts at a rate in bytes per second; None when that is unknown."""
    if space is None or not rate > 0.0:
        return None
    return max(0, space.free_bytes - reserve) / rate
