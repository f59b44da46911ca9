"""What a person is shown of the engine: one model for console, page and reports.

`report` makes it of a state: the fields of msg/AutonomyState.msg in Python's terms. `MessageLog` keeps what the engine
says, numbered, in order: a state shows the last message only, and one event may bring several.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Callable, Deque, Dict, Iterable, List, Optional, Tuple

from ..engine.commands import AnswerKind, Command, Level, Notify
from ..engine.context import Context
from ..engine.decide import answer_to, decide
from ..engine.events import Check, Event, RecordingStatus, Tick, UserCommand, Verdict
from ..engine.failsafe import wait_end, waiting
from ..engine.rules import Action, Limits, Rules
from ..engine.state import CheckRecord, EngineState, Failure, FailureKind, State, Step, evolve
from ..engine.timers import state_deadline

_NS = 1e9


@dataclass(frozen=True)
class Telemetry:
    """What the vehicle says of itself, with the limits that count for the mission; None is unknown.

    Args:
        heard_ns: when the autopilot's last status came.
        link_age_s: of the link to the autopilot, as that status said.
        mode, armed, landed: as the autopilot says.
        gps: the watchdog's word on the component `gps`: "nominal", or why it is not; empty: it watches none.
        gps_fix, satellites: kind of fix in words, e.g. "3D", empty when unknown; and how many satellites are seen.
        battery_fraction, battery_voltage_v: what is left; at `battery_limit` it lands.
        altitude_m: above the takeoff place; above `altitude_limit_m` it lands.
        position_x_m, position_y_m: east and north of it; farther away than `distance_limit_m` it lands.
        speed_m_s, climb_m_s: over ground, and upwards.
        flight_time_s: since the takeoff command; after `flight_time_limit_s` it lands.
    """

    heard_ns: Optional[int] = None
    link_age_s: Optional[float] = None
    mode: str = ""
    armed: Optional[bool] = None
    landed: str = "UNKNOWN"
    gps: str = ""
    gps_fix: str = ""
    satellites: Optional[float] = None
    battery_fraction: Optional[float] = None
    battery_limit: Optional[float] = None
    battery_voltage_v: Optional[float] = None
    altitude_m: Optional[float] = None
    altitude_limit_m: Optional[float] = None
    position_x_m: Optional[float] = None
    position_y_m: Optional[float] = None
    distance_m: Optional[float] = None
    distance_limit_m: Optional[float] = None
    speed_m_s: Optional[float] = None
    climb_m_s: Optional[float] = None
    flight_time_s: Optional[float] = None
    flight_time_limit_s: Optional[float] = None


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong now.

    Args:
        name: component, or row of FAILSAFE_CONDITIONS.
        code: the watchdog's code; 0 for what is not a component.
        action: what is done about it now.
        fallback: what is done when a wait has ended; None: it is not waited for.
        end_ns: when the wait ends at the latest, on the clock that decides.
        limit: which limit that is: "wait limit" or "restart limit".
        cause: what this and others have in common, in words; empty: it stands alone.
        reason: in words.
    """

    name: str
    code: int
    action: Action
    fallback: Optional[Action] = None
    end_ns: Optional[int] = None
    limit: str = ""
    cause: str = ""
    reason: str = ""


@dataclass(frozen=True)
class CommandAnswer:
    """What the engine would answer to a command now."""

    command: UserCommand
    answer: AnswerKind
    text: str


@dataclass(frozen=True)
class Report:
    """One look at the engine. Times are nanoseconds on the clock that decides; None is unknown or not applicable.

    Args:
        state: name of the state.
        step: within it; may be empty.
        session_id, mission_id, mission_description, file_index, files, repetition, repetitions: what is flown.
        in_flight: from the TAKEOFF command until disarmed and ON_GROUND, freshly.
        checks: the pre-flight table; each row's name starts with its check, e.g. "battery: level".
        faults: everything that is wrong now; a hold that the operator asked for is none.
        waiting_for: one sentence; empty when it waits for nothing.
        deadline: name of the limit that ends the state first; empty when it has none.
        deadline_ns: its end.
        message, message_level, advice: the last message to the user.
        answers: what the engine would answer to each command now.
        waypoint, waypoints: progress as the planner says.
        recording_phase, recording_progress, data_location: the data.
        result: how the mission ended; empty before.
        data_result: what became of its data: COMPLETE or INCOMPLETE; empty before, and where nothing was recorded.
        queue: ids of the missions that are flown after this one.
        telemetry: of the vehicle.
    """

    state: str
    step: str
    session_id: str
    mission_id: str
    mission_description: str
    file_index: int
    files: int
    repetition: int
    repetitions: int
    in_flight: bool
    checks: Tuple[Check, ...]
    faults: Tuple[Fault, ...]
    waiting_for: str
    deadline: str
    deadline_ns: Optional[int]
    message: str
    message_level: Level
    advice: str
    answers: Tuple[CommandAnswer, ...]
    waypoint: int
    waypoints: int
    recording_phase: str
    recording_progress: Optional[float]
    data_location: str
    result: str
    data_result: str
    queue: Tuple[str, ...]
    telemetry: Telemetry


def report(state: EngineState, rules: Rules, computers: Tuple[Check, ...] = ()) -> Report:
    """Return what a person is shown of a state.

    Args:
        state: of the engine.
        rules: the configuration it decides by.
        computers: rows about the computers; they are shown with the checks, and decide nothing.
    """
    mission, planner, recorder = state.session.mission, state.peers.planner, state.peers.recorder
    faults, deadline = _faults(state), state_deadline(state, rules)
    ends = [(fault.end_ns, fault.limit) for fault in faults if fault.end_ns is not None]
    if deadline is not None and ends and state.state is State.HOLD:
        deadline = min((deadline[1], deadline[0]), *ends)[::-1]
    return Report(
        state=state.state.value,
        step=state.step.value,
        session_id=state.session.id,
        mission_id=mission.id if mission is not None else "",
        mission_description=mission.description if mission is not None else "",
        file_index=state.session.file_index,
        files=mission.files if mission is not None else 0,
        repetition=state.session.repetition,
        repetitions=mission.repetitions if mission is not None else 0,
        in_flight=state.flight.active,
        checks=_checks(state, rules, computers),
        faults=faults,
        waiting_for=_waiting_for(state),
        deadline=deadline[0] if deadline is not None else "",
        deadline_ns=deadline[1] if deadline is not None else None,
        message=state.shown.text,
        message_level=state.shown.level,
        advice=state.shown.advice,
        answers=_answers(state, rules),
        waypoint=planner.waypoint if planner is not None else 0,
        waypoints=planner.waypoints if planner is not None else 0,
        recording_phase=recorder.phase.name if recorder is not None else "",
        recording_progress=recorder.progress if recorder is not None else None,
        data_location=state.recording.location,
        result=state.session.result.value,
        data_result=state.session.data_result.value,
        queue=tuple(mission.id for mission in state.queue),
        telemetry=_telemetry(state, rules),
    )


def end_on_the_way(before: EngineState, event: Event, after: EngineState, rules: Rules) -> Optional[EngineState]:
    """Return the state in which a mission ended where one event ended it and began the next in the queue, else None.

    With nothing in the queue the engine stops there, and everything else about the end is the same.

    Args:
        before: the event.
        event: that was decided.
        after: it.
        rules: by which it was decided.
    """
    if not before.queue or not before.session.id or after.session.id in ("", before.session.id):
        return None
    ended, _ = decide(evolve(before, queue=()), event, rules)
    return evolve(ended, queue=before.queue) if ended.state is State.MISSION_ENDED else None


def mission_end(before: EngineState, event: Event, after: EngineState, rules: Rules) -> Optional[EngineState]:
    """Return the state in which an event ended a mission, whether or not it then began the next; None: it ended none.

    Args:
        before: the event.
        event: that was decided.
        after: it.
        rules: by which it was decided.
    """
    if before.state is State.MISSION_ENDED:
        return None
    return after if after.state is State.MISSION_ENDED else end_on_the_way(before, event, after, rules)


def _answers(state: EngineState, rules: Rules) -> Tuple[CommandAnswer, ...]:
    context = Context(state, Tick(t_ns=state.t_ns), rules)
    cases = {command: answer_to(context, command) for command in UserCommand}
    return tuple(CommandAnswer(command, case.answer, case.text) for command, case in cases.items())


def _telemetry(state: EngineState, rules: Rules) -> Telemetry:
    status, flight, mission = state.peers.autopilot, state.flight, state.session.mission
    own = {
        name: getattr(mission, name, None) or getattr(rules.limits, name)
        for name in ("max_height_m", "max_distance_m", "max_flight_time_ns")
    }
    flying = flight.active and flight.started_ns is not None
    limits = Telemetry(
        heard_ns=state.peers.autopilot_ns,
        gps=next((each.reason or each.code.name.lower() for each in state.peers.components if each.name == "gps"), ""),
        battery_limit=rules.limits.battery_critical_fraction,
        altitude_limit_m=own["max_height_m"],
        distance_limit_m=own["max_distance_m"],
        flight_time_limit_s=own["max_flight_time_ns"] / _NS,
        flight_time_s=(state.t_ns - (flight.started_ns or 0)) / _NS if flying else None,
    )
    if status is None:
        return limits
    return evolve(
        limits,
        link_age_s=status.link_age_s,
        mode=status.mode,
        armed=status.armed,
        landed=status.landed.name,
        gps_fix=status.gps_fix,
        satellites=status.satellites,
        battery_fraction=status.battery_fraction,
        battery_voltage_v=status.battery_voltage_v,
        altitude_m=status.height_m,
        position_x_m=status.position_x_m,
        position_y_m=status.position_y_m,
        distance_m=status.distance_m,
        speed_m_s=status.horizontal_speed_m_s,
        climb_m_s=status.vertical_speed_m_s,
    )


# --- faults -----------------------------------------------------------------------------------------------------------
# What is wrong, each with what it shares with others: one cable or one computer is one sentence, not seven.

_OF_THE_LINK = ("autopilot_status", "battery_unknown", "position_unknown")
_OF_THE_AUTOPILOT = "the autopilot's "  # how the watchdog begins what it says of a sensor of the autopilot
_LATE = ("no message on ", "no answer", " Hz on ", "connection refused")
_TOGETHER_NS, _TOGETHER = 2_000_000_000, 4


def _faults(state: EngineState) -> Tuple[Fault, ...]:
    found = [each for each in state.failures if each.kind is not FailureKind.USER]
    causes = _causes(found)
    return tuple(_fault(each, state, causes.get(each.name, "")) for each in found)


def _fault(failure: Failure, state: EngineState, cause: str) -> Fault:
    end = wait_end(failure, state)
    return Fault(
        name=failure.name,
        code=failure.code,
        action=failure.action,
        fallback=failure.fallback,
        end_ns=None if end is None else end[0],
        limit="" if end is None else end[1],
        cause=cause,
        reason=failure.reason,
    )


def _causes(failures: List[Failure]) -> Dict[str, str]:
    """Return what several faults have in common, by their names; who stands alone has no entry."""
    names = {each.name for each in failures}
    if "clock" in names:
        return dict.fromkeys(names, "/clock stands still") if len(names) > 1 else {}
    causes: Dict[str, str] = {}
    if "autopilot_status" in names:
        sensors = [each.name for each in failures if each.reason.startswith(_OF_THE_AUTOPILOT)]
        without = [*sensors, *(names & set(_OF_THE_LINK))]
        if len(without) > 1:
            causes.update(dict.fromkeys(without, "no link to the autopilot"))
    late = [each for each in failures if each.name not in causes and any(word in each.reason for word in _LATE)]
    for first in late:
        same = [each for each in late if 0 <= each.since_ns - first.since_ns <= _TOGETHER_NS]
        if len(same) >= _TOGETHER:
            words = f"{len(same)} components late within 2 s: their computer is overloaded, or is cut off"
            causes.update({each.name: words for each in same if each.name not in causes})
            break
    return causes


def _checks(state: EngineState, rules: Rules, computers: Tuple[Check, ...]) -> Tuple[Check, ...]:
    """Return the pre-flight table; while nothing is checked there is none."""
    records = state.preflight.checks
    if not records:
        return ()
    return (*(row for record in records for row in _rows(record)), *_clock_rows(state, rules), *computers)


def _rows(record: CheckRecord) -> Tuple[Check, ...]:
    """Return the rows of one check; one row of its own while, or because, there is no answer."""
    name = record.check.value.replace("_", " ")
    if record.rows and record.outcome is not None and (record.ok or any(not row.passed for row in record.rows)):
        return tuple(_named(name, row) for row in record.rows)
    if record.outcome is None and record.rows:
        return tuple(_named(name, row) for row in record.rows)
    verdict = Verdict.PASS if record.ok else Verdict.UNKNOWN if record.outcome is None else Verdict.FAIL
    own = Check(name=name, verdict=verdict, advice="asked, no answer yet" if record.outcome is None else record.message)
    return (*(_named(name, row) for row in record.rows), own)


def _clock_rows(state: EngineState, rules: Rules) -> Tuple[Check, ...]:
    """Return a row for each peer that was heard: how far its stamps are from the time at which they arrive."""
    heard = {
        "watchdog": state.peers.action,
        "autopilot": state.peers.autopilot,
        "planner": state.peers.planner,
        "landing detection": state.peers.landing,
        "recorder": state.peers.recorder,
    }
    ages = {peer: status.age_ns for peer, status in heard.items() if status is not None}
    apart = {each.peer: each.age_ns for each in state.peers.clocks_apart}
    return tuple(
        _clock_row(f"clocks: {peer}", age_ns, rules.limits, Verdict.FAIL if peer in apart else Verdict.PASS)
        for peer, age_ns in {**ages, **apart}.items()
    )


def _clock_row(name: str, age_ns: int, limits: Limits, verdict: Verdict) -> Check:
    nearer, other = limits.status_max_age_ns / _NS, -limits.clock_tolerance_ns / _NS
    if age_ns < 0:
        nearer, other = other, nearer
    advice = "" if verdict is Verdict.PASS else "set the clocks of both computers by chrony"
    return Check(name, verdict, round(age_ns / _NS, 3), nearer, "s", advice=advice, other_limit=other)


def computer_rows(said: RecordingStatus, least_free: float, limits: Limits) -> Tuple[Check, ...]:
    """Return of each computer its clock, how busy it is and what is free of its storage, as far as it is known.

    Args:
        said: by the recorder, about whatever session; it tells of all platforms.
        least_free: fraction below which no recording starts.
        limits: how old a status may be.
    """
    rows: List[Check] = []
    for each in said.platforms:
        if each.clock_age_s is not None:
            age_ns = round(each.clock_age_s * _NS)
            verdict = Verdict.PASS if limits.is_present(age_ns) else Verdict.WARN
            rows.append(_clock_row(f"computers: {each.platform} clock", age_ns, limits, verdict))
        if each.cpu_fraction is not None:
            rows.append(Check(f"computers: {each.platform} CPU load", Verdict.PASS, each.cpu_fraction, unit="fraction"))
        if each.free_fraction is not None:
            few = each.free_fraction < least_free
            verdict, advice = (Verdict.WARN, "make space: no recording starts") if few else (Verdict.PASS, "")
            name = f"computers: {each.platform} free storage"
            rows.append(Check(name, verdict, each.free_fraction, least_free, "fraction", advice=advice))
    return tuple(rows)


def limit_words(row: Check, words: Callable[[float], str]) -> str:
    """Return between what the value of a row must be, e.g. "8 Hz" or "3.5 ... 6.5 Hz"; empty: it has no limit.

    Args:
        row: of the pre-flight table.
        words: writes one limit, its unit behind a blank.
    """
    known = sorted(each for each in (row.limit, row.other_limit) if each is not None)
    return " ... ".join(words(each).split(" ")[0] if each is not known[-1] else words(each) for each in known)


def _named(check: str, row: Check) -> Check:
    return row if row.name.startswith(check) else evolve(row, name=f"{check}: {row.name}")


WAITS = {
    State.MISSION_INPUT: "a mission to be selected",
    State.PREFLIGHT: "the answers to the pre-flight checks",
    State.OUTREACH: "you: retry or give up",
    State.START_RECORDING: "the recording to start, and its lead time",
    State.LOAD_MISSION: "the mission planner to accept it, and the checks once more",
    State.LAND: "landed and disarmed",
    State.PILOT: "on the ground, disarmed, and your acknowledgement",
    State.DATA_CLEANUP: "the data to be complete",
    State.MISSION_ENDED: "the next mission to be selected",
}
"""What each state waits for, where its step does not say it better."""
_STEP_WAITS = {
    Step.ARMING: "the vehicle to arm",
    Step.LIFTING_OFF: "lift-off",
    Step.CLIMBING: "the takeoff altitude",
    Step.CANCELLING: "the vehicle to be disarmed",
    Step.FLYING: "the last waypoint, landed and disarmed",
    Step.TOUCHDOWN: "the planner to accept the next file, and the checks once more",
    Step.CONFIRMING: "the planner to hold",
    Step.RESUMING: "the planner to resume",
}


def _waiting_for(state: EngineState) -> str:
    held = ", ".join("you: resume or land" if f.kind is FailureKind.USER else f.name for f in waiting(state))
    if state.state is State.HOLD and state.step is Step.HOLDING:
        return held
    if state.state is State.READY:
        return "the operator's go"
    return _STEP_WAITS.get(state.step) or WAITS.get(state.state, "")


# --- messages ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class OperatorMessage:
    """One message of the engine to its user; `number` counts from 1, `t_ns` is on the clock that decides."""

    number: int
    t_ns: int
    level: Level
    text: str
    advice: str = ""
    key: str = ""


class MessageLog:
    """The last messages of a run, numbered: who was away asks for those after the last number that it has."""

    MOST = 200

    def __init__(self) -> None:
        self._messages: Deque[OperatorMessage] = deque(maxlen=self.MOST)
        self._last = 0

    def take(self, t_ns: int, commands: Iterable[Command]) -> bool:
        """Take what one event has brought; return True when there is anything new."""
        said = [command for command in commands if isinstance(command, Notify)]
        for notify in said:
            self._last += 1
            told = OperatorMessage(self._last, t_ns, notify.level, notify.text, notify.advice, notify.key)
            self._messages.append(told)
        return bool(said)

    def after(self, number: int) -> Tuple[OperatorMessage, ...]:
        """Return all messages with a higher number that are kept, oldest first."""
        return tuple(each for each in self._messages if each.number > number)
