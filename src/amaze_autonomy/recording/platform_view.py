"""One platform as the collector sees it."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Optional

from .clock_offset import Offset
from .status import PlatformStatus, Status

__all__ = ["PlatformView"]


class PlatformView:
    """What is known of a platform, and what it was asked.

    Args:
        name: of the platform.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.status, self.heard_ns = Status(), None  # type: Status, Optional[int]
        self.part = PlatformStatus(name)
        self.began = self.asking = self.removed = False
        self.asked_ns: Optional[int] = None
        self.refusal = self.problem = ""
        self.offsets: Dict[str, Offset] = {}
        self.measured: List[str] = []
        self.measuring = False
        self.fetching = self.fetched = False
        self.fetched_fraction = 0.0
        self.fetch_again_ns = 0

    def fresh(self) -> PlatformView:
        """Return the view for a new session: only the status stays."""
        view = PlatformView(self.name)
        view.status, view.heard_ns = self.status, self.heard_ns
        return view

    def session(self, session_id: str) -> bool:
        """Return whether its last status is of this session."""
        return bool(session_id) and self.status.session_id == session_id

    def may_ask(self, t_ns: int, period_ns: int) -> bool:
        """Return whether it may be asked again: no question is open, and the last one is some time ago."""
        return not self.asking and (self.asked_ns is None or t_ns - self.asked_ns >= period_ns)

    def note_removal(self) -> bool:
        """Take notice that it is asked to remove its part."""
        self.removed = True
        return True

    def memory(self) -> Dict[str, Any]:
        """Return what must outlive the process."""
        return {
            "began": self.began,
            "fetched": self.fetched,
            "removed": self.removed,
            "refusal": self.refusal,
            "part": {"platform": self.name, "location": self.part.location},
            "offsets": {when: offset.as_json() for when, offset in sorted(self.offsets.items())},
        }

    @classmethod
    def of_memory(cls, name: str, memory: Mapping[str, Any]) -> PlatformView:
        """Return a view as another process left it."""
        view = cls(name)
        view.began, view.fetched = bool(memory["began"]), bool(memory["fetched"])
        view.removed, view.refusal = bool(memory["removed"]), str(memory["refusal"])
        view.part = PlatformStatus(**memory["part"])
        view.offsets = {when: Offset(**value) for when, value in memory["offsets"].items()}
        view.measured = list(view.offsets)
        return view
