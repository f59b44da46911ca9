"""What monitors say, as lines of the timeline: each only when it is another than before."""

from __future__ import annotations

from typing import Callable, Dict, Optional, Tuple

from amaze_autonomy.engine.events import ComponentStatus, Landed
from amaze_autonomy.engine.severity import Code

from .timeline import Source

__all__ = ["Notes", "Say"]

Say = Callable[[int, Source, str, int], None]


class Notes:
    """Remembers what was noted last.

    Args:
        say: writes a line of the timeline: time, source, text, level.
    """

    def __init__(self, say: Say) -> None:
        self._say = say
        self._components: Dict[str, ComponentStatus] = {}
        self._judged: Optional[Landed] = None

    def components(self, components: Tuple[ComponentStatus, ...], t_ns: int, source: Source) -> None:
        """Note each component whose code, or the reason of it, is another than before."""
        for status in components:
            before = self._components.get(status.name)
            code = before.code if before is not None else None
            self._components[status.name] = status
            if code is not status.code or (before is not None and before.reason != status.reason):
                reason = f"  {status.reason}" if status.reason else ""
                move = f"code {status.code}" if code is None or code is status.code else f"code {code} -> {status.code}"
                level = 0 if status.code is Code.NOMINAL else 1 if status.code is Code.NON_CRITICAL else 2
                self._say(t_ns, source, f"watchdog: {status.name} {move}{reason}", level)

    def landed(self, landed: Landed, reason: str, t_ns: int, source: Source) -> None:
        """Note a judgement of the landing detection that is another than before."""
        if landed is not self._judged:
            self._judged = landed
            self._say(
                t_ns, source, f"landing detection: {landed.name}  {reason}", 0 if landed is not Landed.UNKNOWN else 1
            )
