"""The conditions of the recording: proven, refused, complete, incomplete."""

from __future__ import annotations

from typing import Optional

from .commands import Seen, Value, because
from .conditions import proves_recording
from .events import Outcome, RecordingPhase
from .guards import holds_if
from .timers import passed
from .turn import Turn

__all__ = [
    "data_complete",
    "data_incomplete",
    "data_lost",
    "nothing_recorded",
    "recording_proven",
    "recording_refused",
    "records",
    "something_recorded",
]

_NS = 1e9
_REFUSED = (Outcome.REFUSED, Outcome.UNAVAILABLE)


def records(turn: Turn) -> bool:
    """Return True when the recorder says, freshly, that files grow on every platform."""
    recorder, heard_ns = turn.state.recorder, turn.state.recorder_ns
    if recorder is None or heard_ns is None or turn.now - heard_ns > turn.limits.recorder_status_limit_ns:
        return False
    return proves_recording(recorder)


def recording_proven(turn: Turn) -> Optional[Seen]:
    """Files grow on every platform, and the lead time has passed."""
    recorder = turn.state.recorder
    if recorder is None or not records(turn) or not passed("recording_lead", turn.state, turn.rules, turn.now):
        return None
    return Seen((Value("platforms that record", len(recorder.platforms)),))


def recording_refused(turn: Turn) -> Optional[Seen]:
    """The recorder refused to start, or says that it failed."""
    state = turn.state
    if state.recording_outcome in _REFUSED:
        return because("recorder", state.recording_message or "refused")
    failed = state.recorder is not None and state.recorder.phase is RecordingPhase.FAILED and state.recording_progressed
    return because("recorder", state.recorder.message if state.recorder is not None else "") if failed else None


def nothing_recorded(turn: Turn) -> Optional[Seen]:
    """No recording was ever asked for in this session."""
    return holds_if(not turn.state.recording_asked, Value("recording", "never started"))


def something_recorded(turn: Turn) -> Optional[Seen]:
    """A recording was asked for in this session."""
    return holds_if(turn.state.recording_asked, Value("recording", "started"))


def data_complete(turn: Turn) -> Optional[Seen]:
    """The recorder says, since it was asked to stop, that everything is written, transferred, merged and verified."""
    recorder, heard_ns = turn.state.recorder, turn.state.recorder_ns
    complete = (
        recorder is not None
        and recorder.phase is RecordingPhase.COMPLETE
        and heard_ns is not None
        and heard_ns > turn.state.entered_ns
    )
    return holds_if(complete, Value("recording", "COMPLETE"), Value("location", turn.state.data_location))


def data_lost(turn: Turn) -> Optional[Seen]:
    """What was recorded is merged and verified, but the recorder names what of the flight is not in it."""
    recorder, complete = turn.state.recorder, data_complete(turn)
    if complete is None or recorder is None or not recorder.lost:
        return None
    return Seen((*complete.values, Value("lost", recorder.lost)))


def data_incomplete(turn: Turn) -> Optional[Seen]:
    """The recorder refused to stop, failed since it was asked, or is silent."""
    state = turn.state
    if state.recording_outcome in _REFUSED:
        return because("recorder", state.recording_message or "refused to stop")
    if passed("recorder_silent", state, turn.rules, turn.now):
        return because("recorder", f"silent for {turn.limits.recorder_status_limit_ns / _NS:g} s")
    if state.recorder is None or state.recorder.phase is not RecordingPhase.FAILED:
        return None
    since = (
        state.recorder_ns is not None and state.recorder_ns - state.entered_ns >= turn.limits.recorder_status_limit_ns
    )
    failed = state.recording_progressed or since
    return because("recorder", state.recorder.message or "FAILED") if failed else None
