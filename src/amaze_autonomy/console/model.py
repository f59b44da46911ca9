"""What the console knows: frozen, without ROS. `Snapshot` mirrors msg/AutonomyState.msg; unknown is None.

All texts in here are clean (`text.clean`): `wire` makes these values from messages, `dialog` from the keyboard.
Times named `_s` without another word are seconds on the console's own monotonic clock.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from math import floor
from typing import Dict, List, Optional, Tuple

from ..engine.events import Check, UserCommand

DEFAULT_ENGINE = "autonomy"
"""The engine's node, in the name space of the console or page."""
STALE_AFTER_S = 3.0
"""The engine publishes its state at 2 Hz; silence for longer than this is shown as lost contact."""


class Verdict(enum.Enum):
    """What became of a request; the first three as in srv/UserCommand.srv."""

    DONE = "DONE"
    REFUSED = "REFUSED"
    ALREADY = "ALREADY"
    NO_ANSWER = "NO ANSWER"  # the service does not exist, or died in mid-call


@dataclass(frozen=True)
class CommandAnswer:
    """What the engine would answer to a command now; fields as in msg/UserAnswer.msg."""

    command: str
    verdict: Verdict
    message: str = ""


@dataclass(frozen=True)
class PendingFailure:
    """One thing that is wrong now; fields as in msg/PendingFailure.msg, `time_left_s` at the stamp of the snapshot."""

    name: str
    code: int = 0
    action: str = ""
    fallback: str = ""
    time_left_s: Optional[float] = None
    limit: str = ""
    cause: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Telemetry:
    """What the vehicle says of itself; fields as in msg/Telemetry.msg."""

    age: Optional[float] = None
    link_age: Optional[float] = None
    mode: str = ""
    armed: bool = False
    armed_known: bool = False
    landed: str = ""
    gps: str = ""
    gps_fix: str = ""
    satellites: Optional[float] = None
    battery_fraction: Optional[float] = None
    battery_limit: Optional[float] = None
    battery_voltage: Optional[float] = None
    altitude: Optional[float] = None
    altitude_limit: Optional[float] = None
    position_x: Optional[float] = None
    position_y: Optional[float] = None
    distance: Optional[float] = None
    distance_limit: Optional[float] = None
    speed: Optional[float] = None
    climb: Optional[float] = None
    flight_time: Optional[float] = None
    flight_time_limit: Optional[float] = None


@dataclass(frozen=True)
class MissionRow:
    """One mission that can be selected; fields as in msg/MissionInfo.msg."""

    id: str
    description: str = ""
    files: int = 1
    repetitions: int = 1
    duration_s: Optional[float] = None
    battery_needed: Optional[float] = None
    error: str = ""


@dataclass(frozen=True)
class Snapshot:
    """The engine's state at one moment; fields as in msg/AutonomyState.msg."""

    state: str
    step: str = ""
    session_id: str = ""
    mission_id: str = ""
    mission_description: str = ""
    file_index: int = 0
    files: int = 0
    repetition: int = 0
    repetitions: int = 0
    in_flight: bool = False
    checks: Tuple[Check, ...] = ()
    failures: Tuple[PendingFailure, ...] = ()
    waiting_for: str = ""
    time_left_s: Optional[float] = None
    limit: str = ""
    message: str = ""
    message_level: int = 0
    advice: str = ""
    user_commands: Tuple[str, ...] = ()
    waypoint: int = 0
    waypoints: int = 0
    recording_phase: str = ""
    recording_progress: Optional[float] = None
    data_location: str = ""
    result: str = ""
    data_result: str = ""
    answers: Tuple[CommandAnswer, ...] = ()
    queue: Tuple[str, ...] = ()
    telemetry: Telemetry = Telemetry()

    @property
    def takes_mission(self) -> bool:
        """True when the engine takes a mission now."""
        return self.state in ("MISSION_INPUT", "MISSION_ENDED")

    def fault_groups(self) -> Tuple[Tuple[PendingFailure, ...], ...]:
        """Return the active faults, those of one cause together; the worst and most urgent first."""
        groups: Dict[str, List[PendingFailure]] = {}
        for each in sorted(self.failures, key=_urgency):
            groups.setdefault(each.cause or f" {each.name}", []).append(each)
        return tuple(map(tuple, groups.values()))

    def answer_to(self, command: UserCommand) -> Optional[CommandAnswer]:
        """Return what the engine would answer to a command now; None: it did not say."""
        return next((each for each in self.answers if each.command == command.value), None)


def _urgency(failure: PendingFailure) -> Tuple[int, float, str]:
    order = ("pilot", "land", "wait", "continue")
    rank = order.index(failure.action) if failure.action in order else 0
    left = failure.time_left_s
    return rank, float("inf") if left is None else floor(left), failure.name


@dataclass(frozen=True)
class Platform:
    """The recording on one companion computer; fields as in msg/PlatformRecording.msg."""

    platform: str = ""
    growing: bool = False
    bytes: int = 0
    byte_rate: Optional[float] = None
    free_fraction: Optional[float] = None
    location: str = ""
    message: str = ""
    dropped: int = 0
    cpu_fraction: Optional[float] = None


@dataclass(frozen=True)
class Collecting:
    """What the recorder says of the phase that it is in; fields as in msg/RecordingStatus.msg.

    Args:
        session_id: of the recording.
        phase: by its name.
        remaining_s: time left of the phase; None: unknown.
        at_s: when it was new: when it came, or before.
        platforms: the recording on each.
    """

    session_id: str = ""
    phase: str = ""
    remaining_s: Optional[float] = None
    at_s: float = 0.0
    platforms: Tuple[Platform, ...] = ()

    @property
    def troubles(self) -> Tuple[str, ...]:
        """What is wrong on which platform, a line each; one that names itself is not named twice."""
        return tuple(
            each.message if each.message.startswith(f"{each.platform}: ") else f"{each.platform}: {each.message}"
            for each in self.platforms
            if each.message
        )


@dataclass(frozen=True)
class Answer:
    """The engine's answer to a request, when it came, and in which state."""

    request: str
    verdict: Verdict
    message: str = ""
    at_s: float = 0.0
    state: str = ""


class RequestKind(enum.Enum):
    """What the console can ask for."""

    COMMAND = "command"
    SELECT = "select"
    LIST = "list"
    QUIT = "quit"


@dataclass(frozen=True)
class Request:
    """Something to be sent, or to be done by the shell.

    Args:
        kind: which.
        id: number of the request; its answer carries it.
        command: of a COMMAND.
        missions: ids, of a SELECT.
        sent_s: when it was sent.
    """

    kind: RequestKind
    id: int = 0
    command: Optional[UserCommand] = None
    missions: Tuple[str, ...] = ()
    sent_s: float = 0.0

    @property
    def words(self) -> str:
        """What is asked for, e.g. "give up" or "mission 1, 2"."""
        if self.command is not None:
            return self.command.value.replace("_", " ")
        if self.kind is RequestKind.SELECT:
            return "mission " + ", ".join(self.missions)
        return {RequestKind.LIST: "list of missions", RequestKind.QUIT: "close this console"}.get(self.kind, "")


@dataclass(frozen=True)
class Question:
    """A request that waits for the user's yes."""

    text: str
    request: Request
    asked_s: float = 0.0
    enter_is_yes: bool = True


@dataclass(frozen=True)
class Note:
    """One message of the engine; `clock` is the wall time as it is shown, `level` as in `Snapshot`, `key` its name."""

    clock: str
    level: int
    text: str
    advice: str = ""
    number: int = 0
    key: str = ""


@dataclass(frozen=True)
class Desk:
    """Everything that one console knows and shows.

    Args:
        engine: name space of the engine, for the user.
        started_s: when the console started.
        snapshot: the engine's last state; None: never heard of it.
        received_s: when it was new: when it came, or before.
        judged_s: of each row of its pre-flight table, when that row was new.
        collecting: what the recorder said last; None: never heard of it.
        link: what the connection waits for, in words; empty when nothing.
        missions: that can be selected; None: not known yet.
        listed_s: when they were asked for.
        wanted: missions given by parameter, until they are selected.
        entry: what is being typed.
        cut_s: when the last key came of a line that was dropped while it was typed; None: its end has come.
        error: what was wrong with the last input.
        error_since: that error, and when it was first seen.
        question: that waits for a yes.
        requests: sent and not answered.
        answer: the last one.
        run: of the engine whose messages are numbered.
        notes: its last messages, oldest first.
        next_id: of the next request.
        interactive: there is somebody who can type.
        scroll: lines of the middle of the screen that are above its top.
        page: address of the operator's page; empty: not known.
    """

    engine: str = f"/{DEFAULT_ENGINE}"
    started_s: float = 0.0
    snapshot: Optional[Snapshot] = None
    received_s: float = 0.0
    judged_s: Tuple[float, ...] = ()
    collecting: Optional[Collecting] = None
    link: str = ""
    missions: Optional[Tuple[MissionRow, ...]] = None
    listed_s: Optional[float] = None
    wanted: Tuple[str, ...] = ()
    entry: str = ""
    cut_s: Optional[float] = None
    error: str = ""
    error_since: Tuple[str, float] = ("", 0.0)
    question: Optional[Question] = None
    requests: Tuple[Request, ...] = ()
    answer: Optional[Answer] = None
    run: str = ""
    notes: Tuple[Note, ...] = ()
    next_id: int = 1
    interactive: bool = True
    scroll: int = 0
    page: str = ""

    def age_s(self, now_s: float) -> float:
        """Return how old the last state is."""
        return max(0.0, now_s - self.received_s)

    def with_state(self, snapshot: Snapshot, new_s: float) -> Desk:
        """Return it with a state that was new then; a row of its table that is as it was is not judged anew."""
        known = dict(zip(() if self.snapshot is None else self.snapshot.checks, self.judged_s))
        judged_s = tuple(known.get(each, new_s) for each in snapshot.checks)
        return replace(self, snapshot=snapshot, received_s=new_s, judged_s=judged_s, link="")

    def notes_since(self, before: Desk) -> Tuple[Note, ...]:
        """Return the messages that an earlier desk does not have; all of them when the engine was started anew."""
        seen = before.notes[-1].number if before.notes and before.run == self.run else 0
        return tuple(note for note in self.notes if note.number > seen)

    def checks(self, now_s: float) -> Tuple[Check, ...]:
        """Return the pre-flight table; the ages, which are told of the moment of the judgement, are of now."""
        rows = () if self.snapshot is None else self.snapshot.checks
        since_s = self.judged_s or (self.received_s,) * len(rows)
        return tuple(
            row if row.age_s is None else replace(row, age_s=row.age_s + max(0.0, now_s - judged_s))
            for row, judged_s in zip(rows, since_s)
        )

    def remaining_s(self, now_s: float) -> Optional[float]:
        """Return the time left of the recording's phase that is shown; None: unknown, or the recorder is silent."""
        said, shown = self.collecting, self.snapshot
        if said is None or shown is None or said.remaining_s is None or now_s - said.at_s > STALE_AFTER_S:
            return None
        if (said.session_id, said.phase) != (shown.session_id, shown.recording_phase):
            return None
        return max(0.0, said.remaining_s - max(0.0, now_s - said.at_s))

    def troubles(self, now_s: float) -> Tuple[str, ...]:
        """Return what is wrong with the recording of this session, a line each; a silent recorder says nothing."""
        said, shown = self.collecting, self.snapshot
        if said is None or shown is None or now_s - said.at_s > STALE_AFTER_S or said.session_id != shown.session_id:
            return ()
        return said.troubles

    def stale(self, now_s: float) -> bool:
        """Return True when the engine was heard and is silent now."""
        return self.snapshot is not None and self.age_s(now_s) > STALE_AFTER_S

    def heard(self, now_s: float) -> bool:
        """Return True while the last state is how the engine is now."""
        return self.snapshot is not None and not self.stale(now_s)
