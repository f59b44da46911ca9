"""How far things are: waypoints in flight, the recording while it is collected, the result at the end."""

from __future__ import annotations

from typing import List, Optional

from rich.console import Group, RenderableType
from rich.padding import Padding

from .model import Desk, Snapshot
from .style import Style, Tone
from .words import fraction, seconds

__all__ = ["progress"]

_COLLECTING = ("STOPPING", "RECOVERING", "TRANSFERRING", "MERGING", "VERIFYING", "COMPLETE")
_TROUBLE = "recorder   "
_FLYING = ("TAKEOFF", "MISSION", "HOLD", "LAND", "PILOT")


def progress(desk: Desk, snapshot: Snapshot, now_s: float, width: int, style: Style) -> List[RenderableType]:
    """Return the lines of progress that matter in the present state."""
    left_s = desk.remaining_s(now_s)
    bar = min(40, max(10, width - 45))
    lines: List[str] = []
    if snapshot.state in _FLYING and snapshot.waypoints > 0:
        done = min(1.0, snapshot.waypoint / snapshot.waypoints)
        lines.append(f"waypoint   {style.bar(done, bar)}  {snapshot.waypoint} of {snapshot.waypoints}")
    if snapshot.recording_phase not in ("", "IDLE"):
        lines.append(f"recording  {_recording(snapshot, bar, style)}")
        if left_s is not None and snapshot.recording_phase in _COLLECTING:
            lines.append(f"time left  about {seconds(left_s)} of this step")
    lines.extend(f"{_TROUBLE}{trouble}" for trouble in desk.troubles(now_s))
    if snapshot.data_location:
        lines.append(f"data       {snapshot.data_location}")
    texts = [style.text(line, _tone(snapshot, line)) for line in lines]
    return ["", Padding(Group(*texts), (0, 1))] if lines else []


def _tone(snapshot: Snapshot, line: str) -> Tone:
    if line.startswith(_TROUBLE):
        return Tone.WARN
    return Tone.STRONG if snapshot.state == "MISSION_ENDED" and line.startswith("data") else Tone.PLAIN


def _recording(snapshot: Snapshot, bar: int, style: Style) -> str:
    phase, done = snapshot.recording_phase, snapshot.recording_progress
    place = _step(phase)
    if done is None or phase not in _COLLECTING:
        return f"{'running' if phase == 'RECORDING' else phase.lower()}{place}"
    return f"{style.bar(done, bar)}  {fraction(done)} {phase.lower()}{place}"


def _step(phase: str) -> str:
    number: Optional[int] = _COLLECTING.index(phase) + 1 if phase in _COLLECTING[:-1] else None
    return "" if number is None else f", step {number} of {len(_COLLECTING) - 1}"
