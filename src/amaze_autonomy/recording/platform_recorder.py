r"""The recorder of one platform: which processes shall run, what they prove, and what becomes of their files.

    IDLE -> STARTING -> RECORDING -> STOPPING -> RECOVERING -> COMPLETE
                                                     \-> FAILED -> (asked to stop again) RECOVERING
                                                         COMPLETE -> (asked to stop again) RECOVERING

A storage that is full but for its reserve ends the recorders, so that their files are closed; with space they go on.
STARTING becomes RECORDING when every group proves that it records, and never falls back: what fails later is told by
`growing` and `message`. It has no limit of its own; whoever asked for the recording has one. A recorder that dies is
started again into a new file at once, for as long as the recording lasts. While a session is recorded, a start for
another one is refused: who wants that has to stop this one first. No recorder ever writes over a file: its number is
higher than that of any file of its group in the session's folder, whoever wrote that and whatever is remembered of it.
COMPLETE means that this platform's part is closed and listed; to make one of all parts is the collector's job. Where
that has failed, it asks to stop once more, and the part is listed anew: a disk may have lost what was listed. Of a list
that is still right nothing is written, so that whoever fetches the part meanwhile is not disturbed.

Where a recorder of a group ended, or said that it stopped to write, while it should record, there is a gap: from the
last growth of its files to the next, or to the end of the recording. So there is where its process was stopped (it is
told to go on), and where a recording was stopped and goes on, or its computer was started anew. That files do not grow
is no gap: of a few small messages nothing is written for long; what a slow disk loses, the recorder says in its log,
and headers count it. A gap of a negative length proves that the clock was set back: how long it was nobody knows. What
is known of a session is kept when another one begins: it may be taken up again. So is what is known of a group that is
not in the configuration any more: its recorder is ended, and the rest of the session is a gap of it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Callable, Deque, Dict, List, Mapping, Optional, Tuple

from amaze_autonomy.engine.events import RecordingPhase as Phase
from amaze_autonomy.units import MB, SECOND

from .status import (
    STOPPED,
    UNWANTED,
    WRITING,
    Answer,
    Command,
    Configured,
    GroupStatus,
    PlatformStatus,
    ProcessStatus,
    Recover,
    Signal,
    StartChild,
    Status,
    common,
    configured,
    lacking,
    lacking_words,
)
from .storage import time_left_s

# --- do files grow ----------------------------------------------------------------------------------------------------


_WINDOW_NS = 3 * SECOND  # over which a rate is taken


class Growth:
    """Follows one size in bytes."""

    def __init__(self) -> None:
        self._seen: Deque[Tuple[int, int]] = deque()
        self.size = 0
        self.grew_ns: Optional[int] = None

    def add(self, t_ns: int, size: int) -> None:
        """Take a size."""
        if size > self.size:
            self.grew_ns = t_ns
        self.size = size
        self._seen.append((t_ns, size))
        while len(self._seen) > 1 and t_ns - self._seen[0][0] > _WINDOW_NS:
            self._seen.popleft()

    def grows(self, t_ns: int, limit_ns: int) -> bool:
        """Return whether it grew within the limit."""
        return self.grew_ns is not None and t_ns - self.grew_ns <= limit_ns

    @property
    def rate(self) -> float:
        """Return bytes per second over the window; 0 when nothing is known yet."""
        (first_ns, first), (last_ns, last) = (self._seen[0], self._seen[-1]) if self._seen else ((0, 0), (0, 0))
        return max(0, last - first) * SECOND / (last_ns - first_ns) if last_ns > first_ns else 0.0


# --- one group --------------------------------------------------------------------------------------------------------


_AGAIN_NS = 1 * SECOND  # between two starts of a recorder that dies at once
_START_NS = 5 * SECOND  # a process that was asked for is there by then
_HEAD_BYTES = 4200  # of an empty bag
_FLUSH_BYTES = 1 << 20  # what may still reach the disk after a recorder stopped to write

_FULL = "the storage was full"
_REMOVED = "its files were removed"
_ANEW = "its computer was started anew"
_HALTED = "its process was stopped"
_UNKNOWN = "an unknown time is missing (its clock was set back)"

_UNSEEN: Mapping[str, Optional[int]] = {"file": None, "from_ns": None, "to_ns": None}

Gap = Dict[str, Any]


class Group:
    """One group.

    Args:
        name: of the group.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.number = 0
        self.running = self.writes = False
        self.dropped = 0
        self.gaps: List[Gap] = []
        self.shift_ns: Optional[int] = None  # from this machine's time to what messages are stamped with
        self.told: Optional[Configured] = None  # what all its recorders were told to record
        self.span = dict(_UNSEEN)  # number of the first recorder that was subscribed, and since when; until when
        self._seen = GroupStatus(running=False)
        self._asked_ns: Optional[int] = None
        self._ended_ns: Optional[int] = None
        self._born_size: Optional[int] = None  # of what lay there before its recorder
        self._asked_size = 0
        self._grew_ns: Optional[int] = None
        self._gap_ns: Optional[int] = None
        self._full_size = 0
        self._told = self._taken_over = self._halted = False
        self._began_ns: Optional[int] = None
        self._looked_ns: Optional[int] = None

    def begin(self, t_ns: int, ending: str = STOPPED) -> None:
        """Forget the last recorder: a recording begins, or goes on after a gap; `ending` is the cause of that."""
        self._asked_ns = self._ended_ns = self._gap_ns = self._grew_ns = None
        self.writes = False
        until_ns, self.span["to_ns"] = self.span["to_ns"], None
        if until_ns is None and self.span["file"] is not None:  # nobody saw it end: its files say how far they go
            until_ns, ending = self.span["from_ns"], _ANEW
        if until_ns is not None:
            self._grew_ns = None if self.shift_ns is None else until_ns - self.shift_ns
            self._open_gap(t_ns, ending, self.number + 1)
            self._grew_ns = None

    def end(self, t_ns: int) -> None:
        """Take notice that the recording ends: so does a gap."""
        self._close_gap(t_ns)
        if self.span["file"] is not None and self.shift_ns is not None:
            self.span["to_ns"] = t_ns + self.shift_ns

    def take_number(self, t_ns: int, told: Optional[Configured]) -> int:
        """Return the number of the next file; a recorder for it is started now, and told what to record."""
        self.number += 1
        if told is not None:
            self.told = told if self.told is None else common(self.told, told)
        self._began_ns = t_ns if self._began_ns is None else self._began_ns
        self._asked_ns, self._born_size, self.writes = t_ns, None, False
        self._asked_size = self._seen.size
        return self.number

    def stop(self) -> bool:
        """Return whether its recorder is to be ended: asked once."""
        told, self._told = self._told, self.running
        return self.running and not told

    def stop_for_space(self, t_ns: int) -> bool:
        """Return whether its recorder is to be ended because the storage is full: asked once."""
        asked = self.stop()
        if asked and self._gap_ns is None:
            self._open_gap(t_ns, _FULL, self.number + 1)
        return asked

    def stop_for_removal(self, t_ns: int) -> bool:
        """Return whether its recorder is to be ended because its files were removed: all that they held is a gap."""
        if not self.running or not self._seen.removed or self._told:
            return False
        self._told = True
        if self._gap_ns is None:
            self._grew_ns = self._began_ns
            self._open_gap(t_ns, _REMOVED, self.number + 1)
        return True

    def wants_child(self, t_ns: int) -> bool:
        """Return whether a recorder is to be started: none is there, and none is on its way."""
        if self.running:
            return False
        if self._asked_ns is None:
            return True
        return t_ns - self._asked_ns >= (_AGAIN_NS if self._ended_ns is not None else _START_NS)

    def see(self, t_ns: int, seen: GroupStatus, *, writing: bool) -> None:
        """Take what is seen of it; `writing`: it shall record."""
        before, self._seen = self._seen, seen
        self.number = max(self.number, seen.number)
        if seen.size > before.size:
            self._grew_ns = t_ns if not self._taken_over or seen.idle_ns is None else t_ns - seen.idle_ns
            self._taken_over = False
        if self.running and not seen.running:
            self._died(t_ns, writing=writing)
        elif writing and seen.full and not before.full and self._gap_ns is None:
            self._full_size = seen.size
            self._open_gap(t_ns, _FULL, self.number)
            self.gaps[-1]["inside"] = True
        elif writing and seen.halted and self._gap_ns is None:
            self._grew_ns, self._halted = self._looked_ns, True
            self._open_gap(t_ns, _HALTED, self.number)
            self.gaps[-1]["inside"] = True
        self._looked_ns = t_ns
        if seen.running and self._born_size is None:
            self._came(t_ns, seen.size)
        self.running = seen.running
        self.dropped = max(self.dropped, seen.dropped)
        self._see_writing(t_ns, seen)

    def _see_writing(self, t_ns: int, seen: GroupStatus) -> None:
        subscribed = self._born_size is not None and seen.missing == ()
        if subscribed and self.span["file"] is None and self.shift_ns is not None:
            self.span.update(file=self.number, from_ns=t_ns + self.shift_ns)
        if self._halted:
            self._halted = seen.halted
            if seen.running and not seen.halted:
                self._close_gap(t_ns)
        elif self._born_size is not None and seen.size - self._born_size > _HEAD_BYTES:
            if not self.writes or (self._full_size and seen.size - self._full_size > _FLUSH_BYTES):
                self._close_gap(t_ns)
            self.writes = True
        elif subscribed and seen.silent and not self._full_size and not self._told:
            self._close_gap(t_ns)  # it would write if anybody published

    def _came(self, t_ns: int, size: int) -> None:
        if self._asked_ns is None:  # it was there before this process, and has written its head
            self._asked_ns, self._asked_size = t_ns, max(0, size - _HEAD_BYTES)
        self._born_size, self._ended_ns = self._asked_size, None

    def _died(self, t_ns: int, *, writing: bool) -> None:
        self._ended_ns, self._born_size, self.writes = t_ns, None, False
        if writing and self._gap_ns is None:
            self._open_gap(t_ns, self._seen.ending or "it ended", self.number + 1)
        self._told = False

    def _open_gap(self, t_ns: int, ending: str, number: int) -> None:
        self._gap_ns = t_ns if self._grew_ns is None else self._grew_ns
        self.gaps.append({"group": self.name, "file": number, "seconds": 0.0, "ending": ending})
        if self.shift_ns is not None:
            self.gaps[-1]["from_ns"] = self._gap_ns + self.shift_ns

    def _close_gap(self, t_ns: int) -> None:
        if self._gap_ns is not None:
            self.gaps[-1]["seconds"] = (t_ns - self._gap_ns) / SECOND
            if "from_ns" in self.gaps[-1]:
                self.gaps[-1]["to_ns"] = self.gaps[-1]["from_ns"] + t_ns - self._gap_ns
        self._gap_ns, self._full_size = None, 0

    @property
    def halted(self) -> bool:
        """Whether somebody stopped its process, which is still there (SIGSTOP)."""
        return self._seen.halted

    @property
    def proven(self) -> bool:
        """Return whether it records, or would if anybody published what it is subscribed to."""
        return self.running and self._seen.missing == () and (self.writes or self._seen.silent)

    def troubles(self, *, writing: bool) -> List[str]:
        """Return what is wrong with it, one line each."""
        found = [self._trouble()] if writing and self._trouble() else []
        closed = self.gaps[:-1] if self._gap_ns is not None else self.gaps
        if closed:
            times = "once" if len(closed) == 1 else f"{len(closed)} times"
            lost_s, set_back = sum(each["seconds"] for each in closed), any(each["seconds"] < 0 for each in closed)
            missing = _UNKNOWN if set_back else f"{lost_s:.1f} s are missing"
            found.append(f"{self.name}: its recording was interrupted {times}, {missing}")
        if self.dropped:
            found.append(f"{self.name}: messages were dropped, at least {self.dropped}")
        return found

    def _trouble(self) -> str:
        """Return why it does not record now; an empty text when it does."""
        seen = self._seen
        rows: Tuple[Tuple[bool, str], ...] = (
            (
                not self.running and self._ended_ns is not None,
                f"its recorder ended ({seen.ending or 'it ended'})",
            ),
            (not self.running, "its recorder has not started yet"),
            (seen.removed, "its files were removed: it begins a new one"),
            (seen.halted, "its process was stopped: it is told to go on"),
            (bool(self._full_size), "its recorder stopped to write: the storage is full"),
            (bool(seen.missing), f"not subscribed to {', '.join(seen.missing or ())}"),
            (seen.missing is None, "the master does not say what is subscribed"),
            (seen.silent, "nobody publishes its topics"),
            (not self.writes, "nothing is written yet"),
        )
        return next((f"{self.name}: {words}" for wrong, words in rows if wrong), "")

    def memory(self) -> Dict[str, Any]:
        """Return what must outlive the process."""
        gaps = [dict(each) for each in self.gaps]
        numbers = {"number": self.number, "dropped": self.dropped}
        return {**numbers, "gaps": gaps, "seen": dict(self.span), "configured": self.told}

    @classmethod
    def of_memory(cls, name: str, memory: Mapping[str, Any], *, writing: bool) -> Group:
        """Return a group as another process left it."""
        group = cls(name)
        group.number, group.dropped = int(memory["number"]), int(memory["dropped"])
        group.gaps = [dict(each) for each in memory["gaps"]]
        group.span = dict(memory.get("seen", _UNSEEN))
        told = memory.get("configured")
        group.told = None if told is None else configured(**told)
        group.running = writing  # if it is not any more, that is seen
        group._taken_over = True  # nobody saw when its files grew last; they know
        return group


# --- the platform -----------------------------------------------------------------------------------------------------


_SHORT_LEFT_S = 60.0
_KILL_AFTER_NS = 2 * SECOND
_TRIES = 25  # of a recovery that is killed
_LEFT = 8  # sessions that were left and of which something is known


@dataclass(frozen=True)
class GroupSetup:
    """One group.

    Args:
        name: of the group.
        topics: that its recorder must be subscribed to.
        match: expressions of others that it records.
        exclude: expression of those that it does not, where there is `match`.
    """

    name: str
    topics: Tuple[str, ...]
    match: Tuple[str, ...] = ()
    exclude: str = ""

    @property
    def configured(self) -> Configured:
        """Return what its recorders are told to record."""
        return configured(self.topics, self.match, self.exclude)


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
    growth_limit_ns: int = 3 * SECOND
    stop_limit_ns: int = 30 * SECOND
    reserve_bytes: int = 0


class PlatformRecorder:
    """The machine. Requests are answered at once; `step` is called after each look at the processes.

    `step` returns what is to be done.

    Args:
        setup: of the platform.
    """

    def __init__(self, setup: PlatformSetup) -> None:
        self.setup = setup
        self.phase = Phase.IDLE
        self.session_id = self.mission_id = self.location = ""
        self.groups: Dict[str, Group] = {}
        self._left: Dict[str, Dict[str, Any]] = {}  # what is known of the groups of sessions that were left
        self._shift_ns: Optional[int] = None
        self._since_ns = 0
        self._next: Optional[Tuple[str, str]] = None
        self._growth = Growth()
        self._processes = ProcessStatus()
        self._recovering = self._full = self._anew = False
        self._progress: Optional[float] = None
        self._message = ""
        self._lacks: List[str] = []
        self._escalation = self._tries = 0

    # --- requests -------------------------------------------------------------------------------------------------

    def start(self, t_ns: int, session_id: str, mission_id: str, problem: str = "") -> Answer:
        """Begin a session, or go on with it; `problem` says why the storage does not permit it."""
        if not session_id:
            return Answer(accepted=False, message="a recording needs a session")
        if session_id == self.session_id and self.phase in WRITING:
            return Answer(accepted=True, message="already so")
        if self.phase in WRITING:
            return Answer(accepted=False, message=f"records {self.session_id}; stop that one first")
        if problem:
            return Answer(accepted=False, message=problem)
        if self.phase in (Phase.STOPPING, Phase.RECOVERING):
            self._next = (session_id, mission_id)
            return Answer(accepted=True, message=f"session {self.session_id} is closed first")
        self._begin(t_ns, session_id, mission_id)
        return Answer(accepted=True)

    def stop(self, t_ns: int, session_id: str) -> Answer:
        """End the session, and make its part whole; again after FAILED, and anew after COMPLETE."""
        if self._next is not None and session_id == self._next[0]:
            self._next = None
            return Answer(accepted=True, message="it had not begun")
        if not session_id or session_id != self.session_id:
            return Answer(accepted=False, message=f"session {session_id!r} was not recorded here")
        if self.phase in WRITING:
            self._enter(Phase.STOPPING, t_ns)
        elif self.phase in (Phase.FAILED, Phase.COMPLETE):
            self._anew = self._anew or self.phase is Phase.COMPLETE
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
            self._leave_for(session_id)
            self._growth = Growth()
        self.session_id, self.mission_id, self.location, self._anew = session_id, mission_id, "", False
        for each in self.setup.groups:
            self.groups.setdefault(each.name, Group(each.name))
        for name, group in self.groups.items():
            group.shift_ns = self._shift_ns
            group.begin(t_ns, STOPPED if self._is_wanted(name) else UNWANTED)
        self._enter(Phase.STARTING, t_ns)

    def _leave_for(self, session_id: str) -> None:
        """Keep what is known of this session, and take up what is known of another one."""
        if self.session_id:
            self._left[self.session_id] = {name: group.memory() for name, group in self.groups.items()}
        known = self._left.pop(session_id, {})
        self.groups = {name: Group.of_memory(name, value, writing=False) for name, value in known.items()}
        for oldest in list(self._left)[:-_LEFT]:
            del self._left[oldest]

    def _enter(self, phase: Phase, t_ns: int) -> None:
        self.phase, self._since_ns = phase, t_ns
        self._recovering, self._progress, self._escalation, self._tries = False, None, 0, 0
        if phase in (Phase.STARTING, Phase.RECOVERING):
            self._message = ""
        if phase is Phase.STOPPING:
            for group in self.groups.values():
                group.end(t_ns)

    # --- what happens ---------------------------------------------------------------------------------------------

    def compare(self, wanted: Mapping[str, Configured]) -> List[str]:
        """Take what the collector's configuration has of this platform; return what this copy lacks, one line each.

        Raises:
            AttributeError, KeyError, TypeError: It is none.
        """
        self._lacks = lacking_words(*lacking({"configured": self._configured}, wanted))
        return self._lacks

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

    def step(self, t_ns: int, processes: ProcessStatus) -> Tuple[Command, ...]:
        """Go on with what is seen now; return what is to be done."""
        self._processes = processes
        self._shift_ns = None if processes.stamp_ns is None else processes.stamp_ns - t_ns
        self._growth.add(t_ns, sum(each.size for each in processes.groups.values()))
        for name, group in self.groups.items():
            group.shift_ns = self._shift_ns
            group.see(t_ns, processes.groups.get(name, GroupStatus(running=False)), writing=self.phase in WRITING)
        turn = _TURNS.get(self.phase)
        return tuple(turn(self, t_ns)) if turn is not None else ()

    def _write(self, t_ns: int) -> List[Command]:
        """Keep every wanted group's recorder running, as long as there is space for what it writes."""
        self._look_at_space()
        told = [group for group in self._unwanted if group.stop()]
        if self._full:
            told += [group for group in self._wanted if group.stop_for_space(t_ns)]
            return [*self._wake(), *(Signal(group.name, "INT") for group in told)]
        told += [group for group in self._wanted if group.stop_for_removal(t_ns)]
        wanting = [group for group in self._wanted if group.wants_child(t_ns)]
        commands: List[Command] = [*self._wake(), *(Signal(group.name, "INT") for group in told)]
        now = self._configured
        commands += [StartChild(group.name, group.take_number(t_ns, now.get(group.name))) for group in wanting]
        if self.phase is Phase.STARTING and self._proven():
            self._enter(Phase.RECORDING, t_ns)
        return commands

    def _wake(self) -> List[Command]:
        """Have recorders go on that somebody stopped."""
        return [Signal(group.name, "CONT") for group in self.groups.values() if group.halted]

    def _look_at_space(self) -> None:
        """See whether the storage is full; it is not any more when twice the reserve is free."""
        space, reserve = self._processes.space, self.setup.reserve_bytes
        if space is not None:
            self._full = space.free_bytes <= (2 * reserve if self._full else reserve)

    def _close(self, t_ns: int) -> List[Command]:
        """Have every recorder close its file: asked once, and made to in the end."""
        running = [group.name for group in self.groups.values() if group.running]
        if not running:
            self._enter(Phase.RECOVERING, t_ns)
            return self._recover(t_ns)
        steps = ((0, "INT"), (self.setup.stop_limit_ns, "TERM"), (self.setup.stop_limit_ns + _KILL_AFTER_NS, "KILL"))
        commands: List[Command] = self._wake()
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
        return all(group.proven for group in self._wanted) and any(group.writes for group in self._wanted)

    @property
    def _wanted(self) -> List[Group]:
        """Return the groups of the configuration."""
        return [group for name, group in self.groups.items() if self._is_wanted(name)]

    @property
    def _unwanted(self) -> List[Group]:
        """Return the other ones: the configuration has changed since the session began."""
        return [group for name, group in self.groups.items() if not self._is_wanted(name)]

    def _is_wanted(self, name: str) -> bool:
        return any(each.name == name for each in self.setup.groups)

    # --- status ---------------------------------------------------------------------------------------------------

    def grows(self, t_ns: int) -> bool:
        """Return whether it records now: every group, and the files grow."""
        running = self.phase in WRITING and self._proven()
        return running and self._growth.grows(t_ns, self.setup.growth_limit_ns)

    def status(self, t_ns: int) -> Status:
        """Return the status of this platform."""
        space = self._processes.space
        part = PlatformStatus(
            platform=self.setup.name,
            growing=self.grows(t_ns),
            written_bytes=self._growth.size,
            byte_rate=self._growth.rate if self.phase in WRITING else 0.0,
            free_fraction=None if space is None else space.free_fraction,
            location=self.location,
            message="; ".join(self._troubles(t_ns)),
            dropped=self.dropped,
            cpu_fraction=self._processes.cpu_fraction,
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

    @property
    def _configured(self) -> Dict[str, Configured]:
        return {each.name: each.configured for each in self.setup.groups}

    def facts(self) -> Dict[str, Any]:
        """Return what the list of its part says of the recording."""
        told = {name: group.told or self._configured.get(name) for name, group in self.groups.items()}
        return {
            "session_id": self.session_id,
            "platform": self.setup.name,
            "topics": {each.name: list(each.topics) for each in self.setup.groups if not each.match},
            "configured": {name: each for name, each in told.items() if each is not None},
            "gaps": [gap for group in self.groups.values() for gap in group.gaps],
            "seen": {name: dict(group.span) for name, group in self.groups.items()},
            "dropped": self.dropped,
            **({"anew": True} if self._anew else {}),
        }

    def _troubles(self, t_ns: int) -> List[str]:
        if self.phase is Phase.IDLE:
            return []
        found = [self._message] if self._message else []
        if self.phase in WRITING:
            found += self._lacks + self._space_troubles() + [f"{group.name}: {UNWANTED}" for group in self._unwanted]
            if self.phase is Phase.RECORDING and not self._growth.grows(t_ns, self.setup.growth_limit_ns):
                found.append("its files do not grow")
        for name, group in self.groups.items():
            found += group.troubles(writing=self.phase in WRITING and self._is_wanted(name))
        return found

    def _space_troubles(self) -> List[str]:
        left_s = time_left_s(self._processes.space, self._growth.rate, self.setup.reserve_bytes)
        if self._full and self._processes.space is not None:
            return [
                f"the storage is full ({self._processes.space.free_bytes / MB:.0f} MB are free): recording has stopped"
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
            "anew": self._anew,
            "groups": {name: group.memory() for name, group in self.groups.items()},
            "left": [[session_id, groups] for session_id, groups in self._left.items()],
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
        for each in self.setup.groups if writing else ():
            self.groups.setdefault(each.name, Group(each.name))
        self._left = {str(session_id): dict(groups) for session_id, groups in memory.get("left", ())}
        self._enter(phase, t_ns)
        self._message, self._anew = str(memory["message"]), bool(memory.get("anew"))


_TURNS: Mapping[Phase, Callable[[PlatformRecorder, int], List[Command]]] = {
    Phase.STARTING: PlatformRecorder._write,  # noqa: SLF001  (the table of this machine)
    Phase.RECORDING: PlatformRecorder._write,  # noqa: SLF001
    Phase.STOPPING: PlatformRecorder._close,  # noqa: SLF001
    Phase.RECOVERING: PlatformRecorder._recover,  # noqa: SLF001
}
