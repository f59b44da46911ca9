"""ROS 1 bags: recordings to be read, and whole bags to be looked into, recovered, merged and verified.

`Recording` decodes messages and needs the rosbags library; all the rest works on chunks and does without, so that
library is loaded when it is first asked for. `merge/` makes one bag of several, or a part of one, and proves it;
`recover/` finds damage, and keeps what is good.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .errors import BagError

if TYPE_CHECKING:
    from .recording import Entry, Recording, Topic

__all__ = ["BagError", "Entry", "Recording", "Topic"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import recording  # noqa: PLC0415

    return getattr(recording, name)
