"""Messages made into the console's values: texts cleaned, NaN and infinity None, sizes bounded, nothing trusted.

Works on anything that has the fields of the messages; knows no ROS. A field that a message of another version lacks, or
that holds nonsense, becomes unknown: a console that shows most of it is better in flight than one that has crashed.
"""

from __future__ import annotations

import re
import time
import unicodedata
from dataclasses import fields
from typing import Any, Dict, Optional, Tuple, Type, TypeVar

from amaze_autonomy.engine.events import RecordingPhase

from ..engine.events import Check, finite
from ..engine.events import Verdict as CheckVerdict
from .model import Collecting, CommandAnswer, MissionRow, Note, PendingFailure, Platform, Snapshot, Telemetry, Verdict

# --- text -------------------------------------------------------------------------------------------------------------
# Texts from elsewhere made harmless: nothing that comes over the wire or the keyboard may steer a terminal.


LIMIT = 500
"""Longest text that is shown, in characters."""

# Escape sequences as a terminal reads them (ECMA-48): CSI; the strings OSC, DCS, SOS, PM and APC; two-byte ones.
_SEQUENCE = re.compile(
    r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]?"
    r"|(?:\x1b[\]PX^_]|[\x9d\x90\x98\x9e\x9f])[^\x07\x1b\x9c]*(?:\x07|\x1b\\|\x9c)?"
    r"|\x1b[ -/]*[0-~]?"
)
_SPACE = re.compile(r"\s+")
# Cc: C0 and C1 controls. Cf: invisible ones, some turn the direction of writing. Cs, Co, Cn: not characters.
_HARMFUL = ("Cc", "Cf", "Cs", "Co", "Cn")


def clean(text: str, limit: int = LIMIT) -> str:
    """Return the text on one line, without what a terminal would obey or hide, cut to `limit` characters.

    Escape sequences vanish, white space of any kind becomes one blank, other controls become "?".
    """
    text = _SPACE.sub(" ", _SEQUENCE.sub("", text[: 4 * limit])).strip()
    text = "".join("?" if unicodedata.category(letter) in _HARMFUL else letter for letter in text)
    return text if len(text) <= limit else text[: limit - 3] + "..."


# --- wire -------------------------------------------------------------------------------------------------------------


_ROWS = 200
_CHECK_VERDICTS = {1: CheckVerdict.PASS, 2: CheckVerdict.WARN, 3: CheckVerdict.FAIL, 4: CheckVerdict.UNKNOWN}
_PHASES = {phase.value: phase.name for phase in RecordingPhase}
_VERDICTS = {1: Verdict.DONE, 2: Verdict.REFUSED, 3: Verdict.ALREADY}


def _text(message: Any, field: str, limit: int = 500) -> str:
    value = getattr(message, field, "")
    return clean(value, limit) if isinstance(value, str) else ""


def _number(message: Any, field: str) -> Optional[float]:
    value = getattr(message, field, None)
    return finite(float(value)) if isinstance(value, (int, float)) else None


def _count(message: Any, field: str) -> int:
    value = getattr(message, field, 0)
    return value if isinstance(value, int) else 0


def _rows(message: Any, field: str) -> Tuple[Any, ...]:
    return tuple(getattr(message, field, ()))[:_ROWS]


def _check(message: Any) -> Check:
    return Check(
        name=_text(message, "name", 60),
        verdict=_CHECK_VERDICTS.get(_count(message, "verdict"), CheckVerdict.UNKNOWN),
        value=_number(message, "value"),
        limit=_number(message, "limit"),
        unit=_text(message, "unit", 12),
        age_s=_number(message, "age"),
        advice=_text(message, "advice"),
        other_limit=_number(message, "other_limit"),
    )


def _failure(message: Any) -> PendingFailure:
    return PendingFailure(
        name=_text(message, "name", 60),
        code=_count(message, "code"),
        action=_text(message, "action", 20),
        fallback=_text(message, "fallback", 20),
        time_left_s=_number(message, "time_left"),
        limit=_text(message, "limit", 30),
        cause=_text(message, "cause", 120),
        reason=_text(message, "reason"),
    )


T = TypeVar("T", Platform, Telemetry)


def _same(kind: Type[T], message: Any) -> T:
    """Make a type whose fields have the names of the message's, by their annotations."""
    read: Dict[str, Any] = {
        "str": _text,
        "bool": lambda each, name: bool(getattr(each, name, False)),
        "int": _count,
        "Optional[float]": _number,
    }
    return kind(**{field.name: read[str(field.type)](message, field.name) for field in fields(kind)})


def snapshot_of(message: Any) -> Snapshot:
    """Make a snapshot of an AutonomyState."""
    return Snapshot(
        state=_text(message, "state", 20),
        step=_text(message, "step", 20),
        session_id=_text(message, "session_id", 60),
        mission_id=_text(message, "mission_id", 40),
        mission_description=_text(message, "mission_description", 120),
        file_index=_count(message, "file_index"),
        files=_count(message, "files"),
        repetition=_count(message, "repetition"),
        repetitions=_count(message, "repetitions"),
        in_flight=bool(getattr(message, "in_flight", True)),
        checks=tuple(_check(row) for row in _rows(message, "checks")),
        failures=tuple(_failure(row) for row in _rows(message, "failures")),
        waiting_for=_text(message, "waiting_for"),
        time_left_s=_number(message, "time_left"),
        limit=_text(message, "limit", 60),
        message=_text(message, "message"),
        message_level=_count(message, "message_level"),
        advice=_text(message, "advice"),
        user_commands=tuple(clean(str(name), 20) for name in _rows(message, "user_commands")),
        waypoint=_count(message, "waypoint"),
        waypoints=_count(message, "waypoints"),
        recording_phase=_text(message, "recording_phase", 20),
        recording_progress=_number(message, "recording_progress"),
        data_location=_text(message, "data_location"),
        result=_text(message, "result", 20),
        data_result=_text(message, "data_result", 20),
        answers=tuple(
            CommandAnswer(_text(row, "command", 20), verdict_of(_count(row, "answer")), _text(row, "message"))
            for row in _rows(message, "answers")
        ),
        queue=tuple(clean(str(name), 40) for name in _rows(message, "queue")),
        telemetry=_same(Telemetry, getattr(message, "telemetry", None)),
    )


def collecting_of(message: Any) -> Collecting:
    """Make what the recorder says of its phase of a RecordingStatus."""
    remaining_s = _number(message, "remaining")
    return Collecting(
        session_id=_text(message, "session_id", 60),
        phase=_PHASES.get(_count(message, "phase"), ""),
        remaining_s=remaining_s if remaining_s is not None and remaining_s >= 0.0 else None,
        platforms=tuple(_same(Platform, row) for row in _rows(message, "platforms")),
    )


def missions_of(message: Any) -> Tuple[MissionRow, ...]:
    """Make the rows of a ListMissions reply."""
    return tuple(
        MissionRow(
            id=_text(row, "id", 40),
            description=_text(row, "description", 120),
            files=_count(row, "files"),
            repetitions=_count(row, "repetitions"),
            duration_s=_number(row, "estimated_duration"),
            battery_needed=_number(row, "battery_needed"),
            error=_text(row, "error"),
        )
        for row in _rows(message, "missions")
    )


def notes_of(message: Any) -> Tuple[str, Tuple[Note, ...]]:
    """Return the run of an OperatorMessages and its messages."""
    notes = tuple(
        Note(
            clock=time.strftime("%H:%M:%S", time.localtime(max(0, row.stamp.secs))),
            level=_count(row, "level"),
            text=_text(row, "text"),
            advice=_text(row, "advice"),
            number=_count(row, "number"),
            key=_text(row, "key"),
        )
        for row in tuple(getattr(message, "messages", ()))[-_ROWS:]
    )
    return _text(message, "run", 60), notes


def verdict_of(answer: Any) -> Verdict:
    """Return what the answer of a UserCommand says; a number that nobody knows is no answer."""
    return _VERDICTS.get(answer, Verdict.NO_ANSWER)
