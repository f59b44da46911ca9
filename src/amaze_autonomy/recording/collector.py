r"""The collector: it has every platform record, and makes one verified recording of what they recorded.

    IDLE -> STARTING -> RECORDING -> STOPPING -> RECOVERING -> TRANSFERRING -> MERGING -> VERIFYING -> COMPLETE
               \                        \            \              \           \           \-> FAILED

It asks each platform's recorder, its own among them, over the same two requests, and believes only their statuses.
Every wait has a limit. FAILED names what is missing and where the parts lie; asked to stop again, it goes on with the
first thing that is not done: parts that are here are not fetched again, and a file that is whole is not made again.
Where the parts were closed and could not be collected, each platform is asked to list its part anew before.

Another session begins when none is recorded, or on the ground: while one is recorded, the engine's last status must be
a fresh one that says so; in flight, whatever is recorded, only the engine's own session begins. Platforms refuse
another session while they record one; the collector has them stop it first.

The offset between two computers' clocks is taken as NTP does (RFC 5905, section 8). The collector sends at t1 (its
clock), the platform receives at t2 and answers at t3 (the platform's clock), the answer arrives at t4. The offset is
exact where both ways take the same time, and wrong by at most half the round trip; so of several exchanges the one with
the shortest round trip counts.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from itertools import combinations
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.engine.events import RecordingPhase as Phase
from amaze_autonomy.units import SECOND

from .status import (
    WRITING,
    Answer,
    Ask,
    Collect,
    Command,
    CopyJournal,
    MeasureClock,
    PlatformStatus,
    Status,
    StopTransfer,
    Transfer,
)

# --- the offset between two clocks ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Exchange:
    """The four times of one exchange, in nanoseconds since 1970 on the clock of whoever took them."""

    sent_ns: int
    received_ns: int
    answered_ns: int
    arrived_ns: int

    @property
    def round_trip_ns(self) -> int:
        """Return the time on the way, both ways together."""
        return (self.arrived_ns - self.sent_ns) - (self.answered_ns - self.received_ns)

    @property
    def offset_ns(self) -> int:
        """Return the platform's clock minus the collector's."""
        return ((self.received_ns - self.sent_ns) + (self.answered_ns - self.arrived_ns)) // 2


@dataclass(frozen=True)
class Offset:
    """A measured offset.

    Args:
        offset_ns: the platform's clock minus the collector's.
        error_ns: by which it may be wrong.
        at_ns: when it was measured, on the collector's clock.
    """

    offset_ns: int
    error_ns: int
    at_ns: int

    def as_json(self) -> Dict[str, int]:
        """Return it as plain values."""
        return asdict(self)


def best(exchanges: Sequence[Exchange]) -> Optional[Offset]:
    """Return the offset by the exchange with the shortest round trip; None when there is no possible one."""
    possible = [each for each in exchanges if each.round_trip_ns >= 0 and each.answered_ns >= each.received_ns]
    if not possible:
        return None
    chosen = min(possible, key=lambda each: (each.round_trip_ns, each.sent_ns))
    return Offset(chosen.offset_ns, (chosen.round_trip_ns + 1) // 2, chosen.arrived_ns)


def moment(when: str, begun: int) -> str:
    """Return the name of an offset: that of the start or the stop, of the session as often as it was begun."""
    return when if begun == 1 else f"{when}-{begun}"


_DRIFT_PPM = 500  # NTP slews a clock by no more (RFC 5905, MAXFREQ); a crystal drifts by a tenth of that
_LAST_KEPT_NS = 10 * SECOND  # as often the next process is told the time: what it is told is put on the disk
_LEAST_STEP_NS = 100_000_000  # chrony slews faster, to take away a little offset; what is shorter is told of no gap


def clock_step_ns(offsets: Sequence[Offset]) -> int:
    """Return by how much offsets of one clock contradict each other: it was stepped meanwhile. 0: it only drifted."""
    return max((_contradiction_ns(one, other) for one, other in combinations(offsets, 2)), default=0)


def _contradiction_ns(one: Offset, other: Offset) -> int:
    drift_ns = abs(one.at_ns - other.at_ns) * _DRIFT_PPM // 1_000_000
    step_ns = abs(one.offset_ns - other.offset_ns)
    return step_ns if step_ns > _LEAST_STEP_NS + one.error_ns + other.error_ns + drift_ns else 0


def correction_ns(offsets: Sequence[Offset]) -> int:
    """Return what is to be added to a platform's record times: minus the mean of the offsets of its clock.

    Nothing where the clock was stepped in between: nobody knows when, and what is right before is wrong after it.
    """
    if not offsets or clock_step_ns(offsets):
        return 0
    return -(sum(each.offset_ns for each in offsets) // len(offsets))


# --- one platform as the collector sees it ----------------------------------------------------------------------------


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
        self.measure_again_ns = 0
        self.fetching = 0  # number of the fetch that is waited for; 0: none is
        self.fetched = False
        self.fetched_fraction = 0.0
        self.fetch_again_ns = self.fetch_moved_ns = 0
        self.begins = False  # it was asked to record, and has not said since that it does
        self.anew = False  # it is to be asked to list its part anew
        self.anew_ns: Optional[int] = None  # when it said that it does

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


# --- the collector ----------------------------------------------------------------------------------------------------


_ASK_AGAIN_NS = 1 * SECOND
_TRANSFER_AGAIN_NS = 2 * SECOND
_MEASURE_AGAIN_NS = 5 * SECOND
_MEASURE_LIMIT_NS = 5 * SECOND  # that a merge waits for a clock: unmeasured, all that its platform lacks counts
_JOB_TRIES = 25
_CLOSING = (Phase.STOPPING, Phase.RECOVERING)
_COLLECTING = (Phase.TRANSFERRING, Phase.MERGING, Phase.VERIFYING)


def _of_computer(part: PlatformStatus, said: PlatformStatus) -> PlatformStatus:
    """Return a platform's status with what another one says of its computer, whatever that records."""
    free, cpu, clock_s = said.free_fraction, said.cpu_fraction, said.clock_age_s
    return replace(part, free_fraction=free, cpu_fraction=cpu, clock_age_s=clock_s)


@dataclass(frozen=True)
class CollectorSetup:
    """The collector.

    Args:
        own: name of its own platform.
        platforms: all, its own among them.
        fetched: those whose parts must be fetched.
        start_limit_ns: time in which all must prove that they record.
        silent_ns: a status that is older is none.
        stop_limit_ns: time in which a platform must have heard that it shall stop.
        transfer_limit_ns: time in which everything must be here; what still comes is waited for until nothing more came
            for as long.
        keep_parts: whether parts are kept in the end.
        wanted: the groups of each platform, as its recorders are told them (`configured` of status.py).
    """

    own: str
    platforms: Tuple[str, ...]
    fetched: Tuple[str, ...] = ()
    start_limit_ns: int = 12 * SECOND
    silent_ns: int = 5 * SECOND
    stop_limit_ns: int = 30 * SECOND
    transfer_limit_ns: int = 900 * SECOND
    keep_parts: bool = True
    wanted: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


class Collector:
    """The machine. Requests are answered at once; `step` returns what is to be done.

    Args:
        setup: of the collector.
    """

    def __init__(self, setup: CollectorSetup) -> None:
        self.setup = setup
        self.phase = Phase.IDLE
        self.session_id = self.mission_id = self.location = ""
        self.views: Dict[str, PlatformView] = {name: PlatformView(name) for name in setup.platforms}
        self.taken_out: Dict[str, PlatformView] = {}  # of this session, and not in the setup any more: nobody is asked
        self._since_ns = self._t_ns = 0
        self._message = ""
        self._progress: Optional[float] = None
        self._job = False
        self._tries = 0
        self._copied = self._uncollected = False
        self._fetches = 0
        self._summary: Mapping[str, Any] = {}
        self.begun = 0  # how often the session was: it may go on after its end
        self.stopped_ns: Optional[int] = None
        self.flights: Optional[List[List[Optional[int]]]] = None  # from takeoff to landing; None: nobody said
        self.wanted = setup.wanted  # when the session began: who collects it later may have another configuration
        self.keep_parts = setup.keep_parts  # likewise
        self._engine_ns: Optional[int] = None
        self._last_ns: Optional[int] = None  # the last time that was heard of the clock that stamps
        self.set_back_ns = 0  # by how much that was set back while the session was recorded
        self._engine: Optional[Tuple[int, str, bool]] = None  # its last status: when it came, session, in flight

    @property
    def of_session(self) -> Dict[str, PlatformView]:
        """Return all that have, or should have, a part of the session, by name."""
        return {**self.views, **self.taken_out}

    # --- requests -------------------------------------------------------------------------------------------------

    def start(self, t_ns: int, session_id: str, mission_id: str) -> Answer:
        """Begin a session, or go on with it."""
        if not session_id:
            return Answer(accepted=False, message="a recording needs a session")
        if session_id == self.session_id and self.phase in WRITING:
            return Answer(accepted=True, message="already so")
        if self.phase in (*_CLOSING, *_COLLECTING):
            return Answer(accepted=False, message=f"busy with session {self.session_id} ({self.phase.name})")
        if session_id != self.session_id:
            problem = self._occupied(t_ns, session_id)
            if problem:
                return Answer(accepted=False, message=problem)
            self.views, self.taken_out = {name: view.fresh() for name, view in self.views.items()}, {}
            self.location, self._copied, self._summary = "", False, {}
            self.flights = self._engine_ns = None
            self.set_back_ns = 0
            self.begun, self.wanted, self.keep_parts = 0, self.setup.wanted, self.setup.keep_parts
        self.begun += 1
        self.session_id, self.mission_id, self.stopped_ns, self._last_ns = session_id, mission_id, None, None
        self._uncollected = False
        for view in self.views.values():
            view.refusal = ""
        self._enter(Phase.STARTING, t_ns)
        return Answer(accepted=True)

    def _occupied(self, t_ns: int, session_id: str) -> str:
        """Return why another session may not begin now; an empty text when it may."""
        heard_ns, flying, in_flight = self._engine or (0, "", False)
        known = self._engine is not None and t_ns - heard_ns <= self.setup.silent_ns
        if self.phase in WRITING and (in_flight or not known):
            return f"records {self.session_id}; stop that one first"
        if known and in_flight and flying not in ("", session_id):
            return f"session {flying} is in flight"
        return ""

    def stop(self, t_ns: int, session_id: str, wall_ns: Optional[int] = None) -> Answer:
        """End the session and collect it; after FAILED go on where it stopped. `wall_ns` is the clock that stamps."""
        if not session_id or session_id != self.session_id:
            return Answer(accepted=False, message=f"session {session_id!r} was not recorded here")
        if self.phase in (*WRITING, Phase.FAILED):
            if self.phase in WRITING:
                self._see_clock(wall_ns)
            self.stopped_ns = wall_ns if self.stopped_ns is None else self.stopped_ns
            for view in self.views.values():
                view.refusal, view.asked_ns = "", None
                view.fetched, view.fetched_fraction, view.fetch_again_ns = False, 0.0, 0
                view.anew, view.anew_ns = self.phase is Phase.FAILED and self._uncollected, None
            self._enter(Phase.STOPPING, t_ns)
        return Answer(accepted=True)

    # --- what happens ---------------------------------------------------------------------------------------------

    def heard(self, t_ns: int, platform: str, status: Status) -> None:
        """Take a platform's status."""
        view = self.views[platform]
        view.status, view.heard_ns = status, t_ns
        said = next((each for each in status.platforms if each.platform == platform), view.part)
        if status.session_id == self.session_id and status.session_id:
            view.began = view.began or status.phase is not Phase.IDLE
            view.begins = view.begins and status.phase not in WRITING
            view.part = said
        else:  # of the computer, whatever it records
            view.part = _of_computer(view.part, said)

    def heard_engine(self, stamp_ns: int, came_ns: int, session_id: str, *, in_flight: bool) -> None:
        """Take what the engine says of the flight; a takeoff lies behind its last status on the ground.

        The flight lasts from the earlier to the later one of a status' own time and the time at which it came, on the
        same clock: a stamp that is wrong makes it longer, so that what was lost counts, and never shorter.
        """
        self._engine = (self._t_ns, session_id, in_flight)
        if not session_id or session_id != self.session_id:
            return
        if self.flights is None:
            self.flights = []
        flies = bool(self.flights) and self.flights[-1][1] is None
        if flies or self.phase in WRITING:
            self._see_clock(came_ns)
        if in_flight and not flies:
            self.flights.append([self._engine_ns or 0, None])
        elif flies and not in_flight:
            self.flights[-1][1] = max(stamp_ns, came_ns)
        self._engine_ns = min(stamp_ns, came_ns)

    def _see_clock(self, wall_ns: Optional[int]) -> None:
        """Take a time of the clock that stamps: one that is before the last says that the clock was set back."""
        if wall_ns is None:
            return
        back_ns = (self._last_ns or wall_ns) - wall_ns
        self.set_back_ns = max(self.set_back_ns, back_ns if back_ns > _LEAST_STEP_NS else 0)
        self._last_ns = wall_ns

    def answered(self, platform: str, verb: str, session_id: str, answer: Answer) -> None:
        """Take the answer of a platform to what it was asked."""
        view = self.views[platform]
        view.asking = False
        if session_id != self.session_id:
            return
        if verb == "start" and answer.accepted:
            view.began = True
        if verb == "start" and not answer.accepted:
            view.begins = False
        if verb == "stop" and answer.accepted and (view.anew or view.begins):
            view.anew, view.begins, view.anew_ns = False, False, self._t_ns
        view.refusal = "" if answer.accepted else f"{platform}: {answer.message}"

    def unanswered(self, platform: str, problem: str) -> None:
        """Take notice that a platform could not be asked."""
        self.views[platform].asking = False
        self.views[platform].problem = problem

    def clock_measured(self, platform: str, when: str, offset: Optional[Offset]) -> None:
        """Take the offset of a platform's clock; None: it could not be measured, and is asked for again."""
        view = self.views[platform]
        view.measuring = False
        if offset is not None:
            view.offsets[when] = offset
        elif when in view.measured:
            view.measured.remove(when)
            view.measure_again_ns = self._t_ns + _MEASURE_AGAIN_NS

    def transfer_progress(self, t_ns: int, platform: str, number: int, fraction: float) -> None:
        """Take the progress of a transfer; that of one which was given up says nothing."""
        view = self.views[platform]
        if view.fetching != number:
            return
        if fraction > view.fetched_fraction:
            view.fetch_moved_ns = t_ns
        view.fetched_fraction = fraction

    def transfer_ended(self, t_ns: int, platform: str, number: int, problem: str) -> None:
        """Take the end of a transfer, an empty text when all is here; that of one which was given up says nothing."""
        view = self.views[platform]
        if view.fetching != number:
            return
        view.fetching, view.fetched, view.problem = 0, not problem, problem
        view.fetch_again_ns = t_ns + _TRANSFER_AGAIN_NS

    def job_progress(self, t_ns: int, phase: Phase, fraction: float) -> None:
        """Take the progress of the job that merges and verifies."""
        if phase is not self.phase and self.phase in _COLLECTING and phase in _COLLECTING:
            self.phase, self._since_ns = phase, t_ns
        self._progress = fraction

    def job_ended(self, t_ns: int, problem: str, summary: Mapping[str, Any], *, killed: bool = False) -> None:
        """Take the end of that job: its summary, or why it failed; one that was killed is started again."""
        self._job = False
        if self.phase not in _COLLECTING:
            return
        if problem and killed and self._tries < _JOB_TRIES:
            self._progress = None
            return
        if problem:
            self._fail(t_ns, problem)
            return
        self._summary = dict(summary)
        self._enter(Phase.COMPLETE, t_ns)
        self.location, self._message = str(summary.get("location", "")), str(summary.get("message", ""))

    def interrupted(self, t_ns: int, wall_ns: Optional[int] = None) -> None:
        """Take notice that the process ends: what it recorded waits for somebody to ask for it."""
        if self.phase in WRITING:
            self._see_clock(wall_ns)
            self.stopped_ns = wall_ns
            self._fail(t_ns, "the recorder node was ended while it recorded; its part is closed, retry collects it")

    def step(self, t_ns: int) -> Tuple[Command, ...]:
        """Go on; return what is to be done."""
        self._t_ns = t_ns
        turn = _TURNS.get(self.phase)
        return tuple(turn(self, t_ns)) if turn is not None else ()

    # --- phases ---------------------------------------------------------------------------------------------------

    def _enter(self, phase: Phase, t_ns: int) -> None:
        self.phase, self._since_ns, self._progress = phase, t_ns, None
        self._message = ""
        if phase is Phase.TRANSFERRING:
            self._tries, self._uncollected = 0, False

    def _fail(self, t_ns: int, problem: str) -> None:
        self._uncollected = self._uncollected or self.phase in _COLLECTING
        self._enter(Phase.FAILED, t_ns)
        self._message = problem
        self.location = ", ".join(f"{name}:{location}" for name, location in self._lie().items())

    def _start(self, t_ns: int) -> List[Command]:
        """Have all platforms record; all must prove it within the limit."""
        commands = self._ask_to_record(t_ns)
        refused = [view.refusal for view in self.views.values() if view.refusal]
        if all(self._records(view, t_ns) for view in self.views.values()):
            self._enter(Phase.RECORDING, t_ns)
        elif refused:
            self._fail(t_ns, "; ".join(refused))
        elif t_ns - self._since_ns >= self.setup.start_limit_ns:
            late = [view for view in self.views.values() if not self._records(view, t_ns)]
            self._fail(t_ns, "; ".join(self._why_not(view, t_ns) for view in late))
        return commands

    def _record(self, t_ns: int) -> List[Command]:
        """Keep all platforms recording: one that was started anew, or records something else, is asked again."""
        return self._ask_to_record(t_ns)

    def _ask_to_record(self, t_ns: int) -> List[Command]:
        commands: List[Command] = []
        for view in self.views.values():
            writes = view.status.session_id if view.status.phase in WRITING else ""
            works = writes == self.session_id
            if not works and view.may_ask(t_ns, _ASK_AGAIN_NS):
                commands.append(self._ask(view, "stop", t_ns, writes) if writes else self._ask(view, "start", t_ns))
            if works:
                commands += self._measure(view, "start")
        return commands

    def _stop(self, t_ns: int) -> List[Command]:
        """Have all platforms close their parts."""
        commands: List[Command] = []
        for view in self.views.values():
            view.anew = view.anew and not self._lost(view, t_ns)  # then its list has to do as it is
            again = view.asked_ns is None or not self._failed(view)
            if (view.begins or not self._closing(view)) and again and view.may_ask(t_ns, _ASK_AGAIN_NS):
                commands.append(self._ask(view, "stop", t_ns))
            if self._closing(view):
                commands += self._measure(view, "stop")
        waiting = [view for view in self.views.values() if not self._closed(view)]
        if not waiting:
            self._enter(Phase.TRANSFERRING, t_ns)
            return [*commands, *self._transfer(t_ns)]
        if all(self._lost(view, t_ns) or self._failed_again(view, t_ns) for view in waiting):
            self._fail(t_ns, self._missing(waiting, t_ns))
        elif all(self._closing(view) and view.status.phase is not Phase.STOPPING for view in waiting):
            self.phase = Phase.RECOVERING
            done = [1.0 if self._closed(view) else view.status.progress or 0.0 for view in self.views.values()]
            self._progress = sum(done) / len(done)
        return commands

    def _failed(self, view: PlatformView) -> bool:
        return view.session(self.session_id) and view.status.phase is Phase.FAILED

    def _failed_again(self, view: PlatformView, t_ns: int) -> bool:
        """Return whether a platform failed after it was asked: its last word may be older than that."""
        answered = view.asked_ns is not None and not view.asking and t_ns - view.asked_ns >= _ASK_AGAIN_NS
        return self._failed(view) and answered and (view.heard_ns or 0) > (view.asked_ns or 0)

    def _lost(self, view: PlatformView, t_ns: int) -> bool:
        """Return whether a platform is not to be waited for any longer."""
        if t_ns - self._since_ns < self.setup.silent_ns:
            return False
        silent = view.heard_ns is None or t_ns - view.heard_ns > self.setup.silent_ns
        forgot = not silent and not view.session(self.session_id)
        return (silent or forgot) and t_ns - self._since_ns >= self.setup.stop_limit_ns

    def _closing(self, view: PlatformView) -> bool:
        return self._closed(view) or (view.session(self.session_id) and view.status.phase in _CLOSING)

    def _closed(self, view: PlatformView) -> bool:
        """Return whether a platform's part is closed, or it never had one.

        Asked to list it anew it says so at once; what it said before may still be on its way. Asked to record it may do
        so, whatever it said before, until it has heard that it shall stop.
        """
        if view.session(self.session_id) and view.status.phase is Phase.COMPLETE:
            known = view.anew_ns is None or (view.heard_ns or 0) - view.anew_ns >= _ASK_AGAIN_NS
            return known and not view.anew and not view.begins
        return not view.began and bool(view.refusal)

    def _transfer(self, t_ns: int) -> List[Command]:
        """Fetch the parts, all at the same time; what fails is tried again within the limit."""
        parts = [self.views[name] for name in self.setup.fetched if self.views[name].began]
        clocks = [command for view in parts if self._fresh(view, t_ns) for command in self._measure(view, "stop")]
        waiting = [view for view in parts if not view.fetched]
        if not waiting and (t_ns - self._since_ns >= _MEASURE_LIMIT_NS or not any(view.measuring for view in parts)):
            self._enter(Phase.MERGING, t_ns)
            return [*clocks, *self._collect(t_ns)]
        late = t_ns - self._since_ns >= self.setup.transfer_limit_ns
        if waiting and late and not any(self._comes(view, t_ns) for view in waiting):
            return self._give_up(waiting, t_ns)
        commands: List[Command] = clocks + [
            self._fetch(view, t_ns) for view in waiting if not view.fetching and t_ns >= view.fetch_again_ns
        ]
        self._progress = sum(1.0 if view.fetched else view.fetched_fraction for view in parts) / len(parts)
        return commands

    def _fetch(self, view: PlatformView, t_ns: int) -> Transfer:
        """Begin to fetch a part. The number is one of all sessions: a fetch that hangs may end in another one."""
        self._fetches += 1
        view.fetching, view.fetched_fraction, view.fetch_moved_ns = self._fetches, 0.0, t_ns
        return Transfer(view.name, view.part.location, self._fetches)

    def _comes(self, view: PlatformView, t_ns: int) -> bool:
        """Return whether a part is being fetched, and some of it came within the limit."""
        return view.fetching > 0 and t_ns - view.fetch_moved_ns < self.setup.transfer_limit_ns

    def _give_up(self, waiting: List[PlatformView], t_ns: int) -> List[Command]:
        """Fail; a fetch that hangs is ended, and when it ends after all, that says nothing any more."""
        hanging = [view for view in waiting if view.fetching]
        for view in hanging:
            view.problem = f"nothing more of it came for {(t_ns - view.fetch_moved_ns) / SECOND:.0f} s"
            view.fetching = 0
        self._fail(t_ns, self._missing(waiting, t_ns))
        return [StopTransfer(view.name) for view in hanging]

    def _collect(self, _t_ns: int) -> List[Command]:
        """Have the job done; again when it was killed."""
        commands: List[Command] = []
        if not self._copied:
            self._copied = True
            commands.append(CopyJournal())
        if not self._job:
            self._job = True
            self._tries += 1
            commands.append(Collect())
        return commands

    def _end(self, t_ns: int) -> List[Command]:
        """Have parts removed that are in the verified recording, if that was wanted at their beginning and is now."""
        if self.keep_parts or self.setup.keep_parts or not self._summary.get("verified"):
            return []
        return [
            self._ask(view, "remove", t_ns)
            for view in self.views.values()
            if view.began and not view.removed and view.may_ask(t_ns, _ASK_AGAIN_NS) and view.note_removal()
        ]

    def _ask(self, view: PlatformView, verb: str, t_ns: int, session_id: str = "") -> Ask:
        view.asking, view.asked_ns = True, t_ns
        view.begins = view.begins or verb == "start"
        return Ask(view.name, verb, session_id)

    def _measure(self, view: PlatformView, when: str) -> List[Command]:
        """Measure a clock, once at each start and stop: a computer may come back with another one."""
        when = moment(when, self.begun)
        if view.name == self.setup.own or when in view.measured or self._t_ns < view.measure_again_ns:
            return []
        view.measured.append(when)
        view.measuring = True
        return [MeasureClock(view.name, when)]

    # --- words ----------------------------------------------------------------------------------------------------

    def _fresh(self, view: PlatformView, t_ns: int) -> bool:
        return view.heard_ns is not None and t_ns - view.heard_ns <= self.setup.silent_ns

    def _records(self, view: PlatformView, t_ns: int) -> bool:
        good = self._fresh(view, t_ns) and view.session(self.session_id)
        return good and view.status.phase is Phase.RECORDING and view.part.growing

    def _why_not(self, view: PlatformView, t_ns: int) -> str:
        if view.heard_ns is None or not self._fresh(view, t_ns):
            problem = f" ({view.problem})" if view.problem else ""
            return f"{view.name} does not answer{problem}: is its data_recorder running, and its network up?"
        if not view.session(self.session_id):
            return view.refusal or f"{view.name} has not begun the session"
        return f"{view.name}: {view.part.message or view.status.message or 'it does not record'}"

    def _missing(self, views: List[PlatformView], t_ns: int) -> str:
        """Return what is missing, and where everything lies."""
        missing = "; ".join(f"the part of {view.name} is missing: {self._why_missing(view, t_ns)}" for view in views)
        lies = "; ".join(f"{name}: {location}" for name, location in self._lie().items())
        return f"{missing}. Nothing was removed{'; the parts lie at ' + lies if lies else ''}"

    def _lie(self) -> Dict[str, str]:
        """Return where the parts lie, as far as that is known."""
        return {name: view.part.location for name, view in self.of_session.items() if view.part.location}

    def _why_missing(self, view: PlatformView, t_ns: int) -> str:
        if self.phase is Phase.TRANSFERRING:
            return view.problem or "it was not transferred in time"
        if not self._fresh(view, t_ns):
            return f"{view.name} does not answer" + (f" ({view.problem})" if view.problem else "")
        if not view.session(self.session_id):
            return view.refusal or f"{view.name} knows nothing of session {self.session_id}"
        return view.status.message or "its recorder failed"

    # --- status ---------------------------------------------------------------------------------------------------

    def status(self, t_ns: int) -> Status:
        """Return the status of all platforms."""
        return Status(
            session_id=self.session_id,
            phase=self.phase,
            progress=1.0 if self.phase is Phase.COMPLETE else self._progress,
            remaining_s=self._remaining_s(t_ns),
            platforms=tuple(self._part(view, t_ns) for view in self.views.values()),
            location=self.location,
            message=self._message,
            lost="; ".join(self._summary.get("lost_in_flight", ())) if self.phase is Phase.COMPLETE else "",
        )

    def _remaining_s(self, t_ns: int) -> Optional[float]:
        if self.phase not in _COLLECTING or self._progress is None or not 0.0 < self._progress < 1.0:
            return None  # also at its end: what is left to do then, e.g. by other readers of the bag, has no measure
        return (t_ns - self._since_ns) / SECOND * (1.0 - self._progress) / self._progress

    def _part(self, view: PlatformView, t_ns: int) -> PlatformStatus:
        part = view.part
        if not self._fresh(view, t_ns):  # what its computer was like then is not what it is like now
            part = _of_computer(part, PlatformStatus(part.platform))
        if self.phase is Phase.TRANSFERRING and view.fetch_again_ns and not view.fetched:
            left_s = max(0, self._since_ns + self.setup.transfer_limit_ns - t_ns) / SECOND
            words = f"its part does not come ({view.problem}); tried again for {left_s:.0f} s"
            return replace(part, growing=False, message=words)
        if self.phase not in WRITING or self._records(view, t_ns):
            return replace(part, growing=part.growing and self.phase in WRITING)
        return replace(part, growing=False, message=self._why_not(view, t_ns))

    # --- memory ---------------------------------------------------------------------------------------------------

    def memory(self) -> Dict[str, Any]:
        """Return what must outlive the process."""
        return {
            "session_id": self.session_id,
            "mission_id": self.mission_id,
            "begun": self.begun,
            "phase": self.phase.name,
            "location": self.location,
            "message": self._message,
            "uncollected": self._uncollected,
            "summary": dict(self._summary),
            "stopped_ns": self.stopped_ns,
            "set_back_ns": self.set_back_ns,
            "last_ns": None if self._last_ns is None else self._last_ns // _LAST_KEPT_NS * _LAST_KEPT_NS,
            "flights": None if self.flights is None else [list(each) for each in self.flights],
            "wanted": {name: dict(groups) for name, groups in self.wanted.items()},
            "keep_parts": self.keep_parts,
            "platforms": {name: view.memory() for name, view in self.of_session.items()},
        }

    def remember(self, t_ns: int, memory: Mapping[str, Any]) -> None:
        """Go on where another process ended; what was being fetched or merged is taken up again."""
        self.session_id, self.mission_id = str(memory["session_id"]), str(memory["mission_id"])
        for name, value in memory["platforms"].items():
            (self.views if name in self.views else self.taken_out)[name] = PlatformView.of_memory(name, value)
        self.begun = int(memory.get("begun", 1))
        phase = Phase[memory["phase"]]
        if phase is Phase.RECOVERING:
            phase = Phase.STOPPING
        elif phase in _COLLECTING:
            phase = Phase.TRANSFERRING
        self._enter(phase, t_ns)
        self.location, self._message = str(memory["location"]), str(memory["message"])
        self._uncollected = bool(memory.get("uncollected"))
        for view in self.views.values():
            view.anew = phase is Phase.STOPPING and self._uncollected
        self._summary, self.stopped_ns = dict(memory["summary"]), memory.get("stopped_ns")
        self.flights, self.set_back_ns = memory.get("flights"), int(memory.get("set_back_ns", 0))
        self._last_ns = memory.get("last_ns")
        self.wanted = {str(name): dict(groups) for name, groups in memory.get("wanted", self.setup.wanted).items()}
        self.keep_parts = bool(memory.get("keep_parts", True))


_TURNS: Mapping[Phase, Callable[[Collector, int], List[Command]]] = {
    Phase.STARTING: Collector._start,  # noqa: SLF001  (the table of this machine)
    Phase.RECORDING: Collector._record,  # noqa: SLF001
    Phase.STOPPING: Collector._stop,  # noqa: SLF001
    Phase.RECOVERING: Collector._stop,  # noqa: SLF001
    Phase.TRANSFERRING: Collector._transfer,  # noqa: SLF001
    Phase.MERGING: Collector._collect,  # noqa: SLF001
    Phase.VERIFYING: Collector._collect,  # noqa: SLF001
    Phase.COMPLETE: Collector._end,  # noqa: SLF001
}
