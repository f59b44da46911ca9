r"""The recorder of one platform: which processes shall run, what they prove, and what becomes of their files.

    IDLE -> STARTING -> RECORDING -> STOPPING -> RECOVERING -> COMPLETE
                                                     \-> FAILED -> (asked to stop again) RECOVERING

A storage that is full but for its reserve ends the recorders, so that their files are closed; with space they go on.
STARTING becomes RECORDING when every group proves that it records, and never falls back: what fails later is told by
`growing` and `message`. It has no limit of its own; whoever asked for the recording has one. A recorder that dies is
started again into a new file at once, for as long as the recording lasts. A start for another session ends this one.
COMPLETE means that this platform's part is closed and listed; to make one of all parts is the collector's job.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from amaze_autonomy.engine.events import RecordingPhase as Phase

from .commands import Answer, Command, Recover, Signal, StartChild
from .group import Group
from .growth import Growth
from .sight import GroupSight, Sight
from .space import time_left_s
from .status import WRITING, PlatformStatus, Status

__all__ = ["GroupSetup", "PlatformRecorder", "PlatformSetup"]

_S = 1_000_000_000
_SHORT_LEFT_S = 60.0
_KILL_AFTER_NS = 2 * _S
_TRIES = 25  # of a recovery that is killed


@dataclass(frozen=True)
class GroupSetup:
    """One group: its name, and the topics that its recorder must be subscribed to."""

    name: str
    topics: Tuple[str, ...]


@dataclass(frozen=True)
class PlatformSetup:
    """One platform.

    Args:
        name: as in recording.yaml.
        groups: one recorder each.
        growth_limit_ns: files that have not grown for so long are not being written.
        stop_limit_ns: how long a recorder may take to close its file before it is made to end.
        reserve_bytes: free space at which rosbag stops to write.
    """

    name: str
    groups: Tuple[GroupSetup, ...]
    growth_limit_ns: int = 3 * _S
    stop_limit_ns: int = 30 * _S
    reserve_bytes: int = 0


class PlatformRecorder:
    """The machine. Requests are answered at once; `step` is called after each sight, and returns what is to be done.

    Args:
        setup: of the platform.
    """

    def __init__(self, setup: PlatformSetup) -> None:
        self.setup = setup
        self.phase = Phase.IDLE
        self.session_id = self.mission_id = self.location = ""
        self.groups: Dict[str, Group] = {}
        self._since_ns = 0
        self._next: Optional[Tuple[str, str]] = None
        self._growth = Growth()
        self._sight = Sight()
        self._recovering = self._full = False
        self._progress: Optional[float] = None
        self._message = ""
        self._escalation = self._tries = 0

    # --- requests -------------------------------------------------------------------------------------------------

    def start(self, t_ns: int, session_id: str, mission_id: str, problem: str = "") -> Answer:
        """Begin a session, or go on with it; `problem` says why the storage does not permit it."""
        if not session_id:
            return Answer(accepted=False, message="a recording needs a session")
        if session_id == self.session_id and self.phase in WRITING:
            return Answer(accepted=True, message="already so")
        if problem:
            return Answer(accepted=False, message=problem)
        if self.phase in (*WRITING, Phase.STOPPING, Phase.RECOVERING):
            self._next = (session_id, mission_id)
            if self.phase in WRITING:
                self._enter(Phase.STOPPING, t_ns)
            return Answer(accepted=True, message=f"session {self.session_id} is closed first")
        self._begin(t_ns, session_id, mission_id)
        return Answer(accepted=True)

    def stop(self, t_ns: int, session_id: str) -> Answer:
        """End the session, and make its part whole; again after FAILED."""
        if self._next is not None and session_id == self._next[0]:
            self._next = None
            return Answer(accepted=True, message="it had not begun")
        if not session_id or session_id != self.session_id:
            return Answer(accepted=False, message=f"session {session_id!r} was not recorded here")
        if self.phase in WRITING:
            self._enter(Phase.STOPPING, t_ns)
        elif self.phase is Phase.FAILED:
            self._enter(Phase.RECOVERING, t_ns)
        return Answer(accepted=True)

    def may_remove(self, session_id: str, *, keep: bool) -> Answer:
        """Return whether the part of a session may be removed; `keep`: parts are to be kept."""
        if keep:
            return Answer(accepted=False, message="the configuration says keep_parts: true")
        if session_id != self.session_id or self.phase is not Phase.COMPLETE:
            return Answer(accepted=False, message=f"session {session_id!r} is not complete here")
        return Answer(accepted=True)

    def _begin(self, t_ns: int, session_id: str, mission_id: str) -> None:
        if session_id != self.session_id:
            self.groups = {}
            self._growth = Growth()
        self.session_id, self.mission_id, self.location = session_id, mission_id, ""
        for each in self.setup.groups:
            group = self.groups.setdefault(each.name, Group(each.name))
            group.begin()
        self._enter(Phase.STARTING, t_ns)

    def _enter(self, phase: Phase, t_ns: int) -> None:
        self.phase, self._since_ns = phase, t_ns
        self._recovering, self._progress, self._escalation, self._tries = False, None, 0, 0
        if phase in (Phase.STARTING, Phase.RECOVERING):
            self._message = ""
        if phase is Phase.STOPPING:
            for group in self.groups.values():
                group.end(t_ns)

    # --- what happens ---------------------------------------------------------------------------------------------

    def recovery_progress(self, fraction: float) -> None:
        """Take the progress of the recovery."""
        self._progress = fraction

    def recovery_ended(self, t_ns: int, problem: str, *, killed: bool = False) -> None:
        """Take the end of the recovery: an empty text when all is well; one that was killed is started again."""
        if self.phase is not Phase.RECOVERING:
            return
        if problem and killed and self._tries < _TRIES:
            self._recovering = False
            return
        self._enter(Phase.FAILED if problem else Phase.COMPLETE, t_ns)
        self._message = problem
        if self._next is not None:
            session_id, mission_id = self._next
            self._next = None
            self._begin(t_ns, session_id, mission_id)

    def step(self, t_ns: int, sight: Sight) -> Tuple[Command, ...]:
        """Go on with what is seen now; return what is to be done."""
        self._sight = sight
        self._growth.add(t_ns, sum(each.size for each in sight.groups.values()))
        for name, group in self.groups.items():
            group.see(t_ns, sight.groups.get(name, GroupSight(running=False)), writing=self.phase in WRITING)
        turn = _TURNS.get(self.phase)
        return tuple(turn(self, t_ns)) if turn is not None else ()

    def _write(self, t_ns: int) -> List[Command]:
        """Keep every group's recorder running, as long as there is space for what it writes."""
        self._look_at_space()
        if self._full:
            told = [group for group in self.groups.values() if group.stop_for_space(t_ns)]
            return [Signal(group.name, "INT") for group in told]
        wanting = [group for group in self.groups.values() if group.wants_child(t_ns)]
        commands: List[Command] = [StartChild(group.name, group.take_number(t_ns)) for group in wanting]
        if self.phase is Phase.STARTING and self.groups and self._proven():
            self._enter(Phase.RECORDING, t_ns)
        return commands

    def _look_at_space(self) -> None:
        """See whether the storage is full; it is not any more when twice the reserve is free."""
        space, reserve = self._sight.space, self.setup.reserve_bytes
        if space is not None:
            self._full = space.free_bytes <= (2 * reserve if self._full else reserve)

    def _close(self, t_ns: int) -> List[Command]:
        """Have every recorder close its file: asked once, and made to in the end."""
        running = [group.name for group in self.groups.values() if group.running]
        if not running:
            self._enter(Phase.RECOVERING, t_ns)
            return self._recover(t_ns)
        steps = ((0, "INT"), (self.setup.stop_limit_ns, "TERM"), (self.setup.stop_limit_ns + _KILL_AFTER_NS, "KILL"))
        commands: List[Command] = []
        while self._escalation < len(steps) and t_ns >= self._since_ns + steps[self._escalation][0]:
            commands += [Signal(name, steps[self._escalation][1]) for name in running]
            self._escalation += 1
        return commands

    def _recover(self, _t_ns: int) -> List[Command]:
        """Have the part made whole, once."""
        if self._recovering:
            return []
        self._recovering = True
        self._tries += 1
        return [Recover()]

    def _proven(self) -> bool:
        groups = self.groups.values()
        return all(group.proven for group in groups) and any(group.writes for group in groups)

    # --- status ---------------------------------------------------------------------------------------------------

    def grows(self, t_ns: int) -> bool:
        """Return whether it records now: every group, and the files grow."""
        running = self.phase in WRITING and bool(self.groups) and self._proven()
        return running and self._growth.grows(t_ns, self.setup.growth_limit_ns)

    def status(self, t_ns: int) -> Status:
        """Return the status of this platform."""
        space = self._sight.space
        part = PlatformStatus(
            platform=self.setup.name,
            growing=self.grows(t_ns),
            written_bytes=self._growth.size,
            byte_rate=self._growth.rate if self.phase in WRITING else 0.0,
            free_fraction=None if space is None else space.free_fraction,
            location=self.location,
            message="; ".join(self._troubles(t_ns)),
            dropped=self.dropped,
        )
        return Status(
            session_id=self.session_id,
            phase=self.phase,
            progress=1.0 if self.phase is Phase.COMPLETE else self._progress,
            platforms=(part,),
            location=self.location,
            message=self._message,
        )

    @property
    def dropped(self) -> int:
        """Return how many messages were dropped, at least: a recorder warns once in five seconds."""
        return sum(group.dropped for group in self.groups.values())

    def facts(self) -> Dict[str, Any]:
        """Return what the list of its part says of the recording."""
        return {
            "session_id": self.session_id,
            "platform": self.setup.name,
            "gaps": [gap for group in self.groups.values() for gap in group.gaps],
            "dropped": self.dropped,
        }

    def _troubles(self, t_ns: int) -> List[str]:
        if self.phase is Phase.IDLE:
            return []
        found = [self._message] if self._message else []
        if self.phase in WRITING:
            found += self._space_troubles()
            if self.phase is Phase.RECORDING and not self._growth.grows(t_ns, self.setup.growth_limit_ns):
                found.append("its files do not grow")
        for group in self.groups.values():
            found += group.troubles(writing=self.phase in WRITING)
        return found

    def _space_troubles(self) -> List[str]:
        left_s = time_left_s(self._sight.space, self._growth.rate, self.setup.reserve_bytes)
        if self._full and self._sight.space is not None:
            return [
                f"the storage is full ({self._sight.space.free_bytes / 1e6:.0f} MB are free): recording has stopped"
            ]
        if left_s is not None and left_s < _SHORT_LEFT_S:
            return [f"the storage is full in {left_s:.0f} s"]
        return []

    # --- memory ---------------------------------------------------------------------------------------------------

    def memory(self) -> Dict[str, Any]:
        """Return what must outlive the process."""
        return {
            "session_id": self.session_id,
            "mission_id": self.mission_id,
            "location": self.location,
            "phase": self.phase.name,
            "message": self._message,
            "groups": {name: group.memory() for name, group in self.groups.items()},
        }

    def remember(self, t_ns: int, memory: Mapping[str, Any], *, same_boot: bool) -> None:
        """Go on where another process ended. After a start of the system nobody asks for that recording any more."""
        self.session_id, self.mission_id = str(memory["session_id"]), str(memory["mission_id"])
        self.location = str(memory["location"])
        phase = Phase[memory["phase"]]
        if phase in (*WRITING, Phase.STOPPING) and not same_boot:
            phase = Phase.RECOVERING
        writing = phase in WRITING
        self.groups = {name: Group.of_memory(name, value, writing=writing) for name, value in memory["groups"].items()}
        self._enter(phase, t_ns)
        self._message = str(memory["message"])


_TURNS: Mapping[Phase, Callable[[PlatformRecorder, int], List[Command]]] = {
    Phase.STARTING: PlatformRecorder._write,  # noqa: SLF001  (the table of this machine)
    Phase.RECORDING: PlatformRecorder._write,  # noqa: SLF001
    Phase.STOPPING: PlatformRecorder._close,  # noqa: SLF001
    Phase.RECOVERING: PlatformRecorder._recover,  # noqa: SLF001
}
