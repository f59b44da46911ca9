"""The laws of every moment: requests, time, waits, words."""

from __future__ import annotations

from typing import Any, Optional, Tuple

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import (
    Answer,
    AnswerKind,
    AutopilotDisarm,
    AutopilotLand,
    Decision,
    LoadMission,
    MissionAction,
    MissionCommand,
    Notify,
    RunCheck,
    StartRecording,
    StopRecording,
)
from amaze_autonomy.engine.state import State, Step, evolve, put
from amaze_autonomy.engine.timers import next_deadline

from ..engine.events import Mission
from .moment import ENDLESS, Moment, Verdict, law, shows_landing

A = MissionAction

# --- requests, time, words --------------------------------------------------------------------------------------------


@law("4.1", "No request is sent twice without a cause, LAND excepted.")
def no_request_twice(m: Moment) -> Verdict:
    if not m.requests:
        return None
    kinds = [(type(r), getattr(r, "action", None), getattr(r, "check", None)) for r in m.requests]
    kinds = [kind for kind in kinds if A.LAND not in kind]
    if len(set(kinds)) != len(kinds):
        return "the same request twice at once"
    for request in m.requests:
        why = _repeated(m, request)
        if why:
            return why
    return True


@law("6", "A request has a new id and its limit, and says session, mission, file and repetition as they are.")
def requests_say_what_they_mean(m: Moment) -> Verdict:
    if not m.requests:
        return None
    identities = sorted(request.id for request in m.requests)
    if identities[0] <= m.was.last_id or len(set(identities)) != len(identities):
        return f"ids {identities} after {m.was.last_id}"
    for request in m.requests:
        wrong = _limit_of(m, request) or _content_of(m, request)
        if wrong:
            return f"{type(request).__name__}: {wrong}"
    return True


def _limit_of(m: Moment, request: Any) -> str:
    """Return what is wrong with the limit of a request; empty: nothing."""
    limits, expected = m.rules.limits, m.rules.limits.command_reply_limit_ns
    if isinstance(request, LoadMission):
        expected = limits.load_limit_ns
    if isinstance(request, RunCheck):
        first = request.check.value == "watchdog" and not m.saw.watching
        expected = _reply_limit_ns(m, request) + (limits.watchdog_startup_time_ns if first else 0)
    return "" if request.limit_ns == expected else f"its limit is {request.limit_ns}, not {expected}"


def _reply_limit_ns(m: Moment, request: RunCheck) -> int:
    own = [limit_ns for name, limit_ns in m.rules.reply_limits_ns if name == request.check.value]
    return own[0] if own else m.rules.limits.check_reply_limit_ns


def _content_of(m: Moment, request: Any) -> str:
    """Return what is wrong with the rest of a request; empty: nothing."""
    sessions, mission = (m.before.session.id, m.after.session.id), m.mission
    if getattr(request, "session_id", sessions[0]) not in sessions:  # one event may end one and begin the next
        return f"session {request.session_id!r}, not {sessions[1]!r}"
    if getattr(request, "mission_id", None) not in (None, mission.id if mission is not None else ""):
        return f"mission {request.mission_id!r}"
    if isinstance(request, LoadMission):
        said = (request.repetition, request.file_index)
        return "" if said in _legs(m, mission) else f"repetition and file {said}"
    return _question_of(m, request, mission) if isinstance(request, RunCheck) else ""


def _question_of(m: Moment, request: RunCheck, mission: Optional[Mission]) -> str:
    watchdog, battery = request.check.value == "watchdog", request.check.value == "battery"
    needed = _still_needed(m, mission) if mission is not None and battery else None
    required = mission.required if mission is not None and watchdog else ()
    startup = m.rules.limits.watchdog_startup_time_ns if watchdog and not m.saw.watching else 0
    said, expected = (request.required_fraction, request.required, request.startup_time_ns), (needed, required, startup)
    return "" if said == expected else f"asks {said}, not {expected}"


def _still_needed(m: Moment, mission: Mission) -> Optional[float]:
    """Return what of the battery the takeoffs that are still to come need, reserve included."""
    whole, reserve = mission.battery_needed_fraction, m.rules.limits.battery_reserve_fraction
    flown = m.after.session.file_index + m.after.session.repetition * mission.files
    if whole is None or not flown or flown >= len(mission.still_needed):
        return whole
    return round(reserve + max(0.0, whole - reserve) * mission.still_needed[flown], 6)


def _legs(m: Moment, mission: Optional[Mission]) -> Tuple[Tuple[int, int], ...]:
    """Return the (repetition, file) that may be loaded: the first; the same until it is flown; then the next."""
    load, files = m.was.load, mission.files if mission is not None else 1
    if load is None:
        return ((0, 0),)
    repetition, file = load.leg
    following = (repetition, file + 1) if file + 1 < files else (repetition + 1, 0)
    touched = m.before.step is Step.TOUCHDOWN or any(
        isinstance(c, Decision) and c.step == Step.TOUCHDOWN.value for c in m.commands
    )
    return (following,) if touched else (load.leg,)


def _repeated(m: Moment, request: Any) -> str:
    same_place = (m.before.state, m.before.step) == (m.after.state, m.after.step)
    if isinstance(request, RunCheck):
        asked = dict(m.saw.checks).get(request.check.value)
        open_still = asked is not None and asked.answered_ns is None and m.before.state is m.after.state
        waited = asked is not None and m.saw.now - asked.asked_ns >= _reply_limit_ns(m, request)
        return "a check is asked again while its answer is waited for" if open_still and not waited else ""
    if isinstance(request, (LoadMission, StartRecording)) and same_place:
        return f"{type(request).__name__} again without a step in between"
    if isinstance(request, StartRecording) and m.was.recording == "asked" and _records(m):
        return "StartRecording although it records"
    if isinstance(request, MissionCommand) and request.action is m.was.motion and request.action is not A.LAND:
        planner = m.saw.planner
        undone = planner is not None and planner.phase in (ev.MissionPhase.FLYING, ev.MissionPhase.TAKING_OFF)
        new_flight = request.action in (A.TAKEOFF, A.ABORT) and not same_place
        waited = m.saw.now - m.was.motion_ns >= m.rules.limits.hold_repeat_after_ns
        undone = (
            undone or (waited and not m.before.flight.hold_repeated) or m.before.step is Step.HOLDING
        )  # it was held
        return "" if new_flight or (request.action is A.HOLD and undone) else f"{request.action.name} again"
    if isinstance(request, MissionCommand) and request.action is A.LAND and m.was.landing and m.was.flight == "armed":
        soon = m.saw.now - m.was.sent_ns < m.rules.limits.land_repeat_period_ns
        cause = m.sent(AutopilotLand) or isinstance(m.event, _NEW_LANDING) or m.after.landing.both_routes
        return "LAND again before its period" if soon and not cause else ""
    if isinstance(request, AutopilotDisarm) and m.was.disarmed_ns is not None and m.saw.airborne:
        soon = m.saw.now - m.was.disarmed_ns < m.rules.limits.ground_disarm_period_ns
        return "disarm again before its period" if soon and m.was.on_ground(m.rules.limits) else ""
    return ""


_NEW_LANDING = (ev.Shutdown, ev.AutopilotStatus, ev.LandedStatus, ev.EngineStarted)
"""What a landing is commanded for at once: a signal, a vehicle that no longer shows it, or whose landing detection
contradicts what it shows, an engine that starts anew."""


def _records(m: Moment) -> bool:
    fresh = m.saw.now - m.saw.recorder_ns <= m.rules.limits.recorder_status_limit_ns
    return m.saw.growing_ns is not None and fresh


@law("3, 6", "A late, foreign, stale or future message changes nothing, but that its clock is named.", always=True)
def late_and_foreign_change_nothing(m: Moment) -> Verdict:
    if not _is_noise(m):
        return None
    # Whose stamps are off is known, and said where he is missed; nothing else follows from it.
    heard = put(m.before, "peers.clocks_apart", m.after.peers.clocks_apart)
    heard = evolve(heard, failures=m.after.failures)
    before, after = ([(f.name, f.action, f.deadline_ns) for f in s.failures] for s in (m.before, m.after))
    same = m.commands == () and heard == m.after and before == after
    return True if same else f"a {type(m.event).__name__} that does not count was listened to"


def _is_noise(m: Moment) -> bool:
    event, was, limits = m.event, m.was, m.rules.limits
    if event.t_ns != m.before.t_ns:
        return False
    if not -limits.clock_tolerance_ns <= getattr(event, "age_ns", 0) <= limits.status_max_age_ns:
        return True
    if isinstance(event, (ev.MissionStatus, ev.RecordingStatus)):
        return event.session_id != was.session or not was.session
    if isinstance(event, ev.CheckReply):
        asked = dict(was.checks).get(event.check.value)
        return asked is None or asked.id != event.command_id or asked.answered_ns is not None
    if isinstance(event, ev.Reply):
        current = (was.motion_id, was.load.id if was.load else 0, m.before.recording.request.id)
        return event.command_id not in current
    return False


@law("3", "One moment is decided once: the same moment again changes nothing.", always=True)
def a_moment_is_decided_once(m: Moment) -> Verdict:
    if not isinstance(m.event, ev.Tick) or m.event.t_ns > m.before.t_ns or m.event.away_ns:
        return None
    return True if m.commands == () and m.before == m.after else "the engine had not come to rest"


@law("4.5, 5", "Every state but MISSION_INPUT, OUTREACH, PILOT and MISSION_ENDED has a deadline.", always=True)
def every_wait_has_an_end(m: Moment) -> Verdict:
    if m.after.state in ENDLESS:
        return None
    end = next_deadline(m.after, m.rules)
    if end is not None:
        return True if end > m.after.t_ns else f"the deadline {end} has passed"
    if m.after.state is State.LAND and shows_landing(m.saw, m.rules):
        return None
    return f"{m.after.state.value} {m.after.step.value} waits for ever"


@law("3", "Time never runs back.", always=True)
def time_never_runs_back(m: Moment) -> Verdict:
    return True if m.after.t_ns == max(m.before.t_ns, m.event.t_ns) else "it does"


@law("5", "Every user command is answered once, and one that is not done does nothing.")
def every_user_is_answered(m: Moment) -> Verdict:
    if not isinstance(m.event, (ev.UserRequest, ev.MissionSelected)):
        return None
    answers = [c for c in m.commands if isinstance(c, Answer)]
    if len(answers) != 1 or answers[0].request_id != m.event.request_id or not answers[0].message:
        return f"{len(answers)} answers"
    others = m.requests or m.before.state is not m.after.state
    done = answers[0].answer is AnswerKind.DONE
    return True if done or not others or m.event.t_ns > m.before.t_ns else "not done, yet it does something"


@law("5", "A user who lands or aborts in flight is obeyed at once.")
def the_user_lands(m: Moment) -> Verdict:
    if not isinstance(m.event, ev.UserRequest) or m.saw.flight != "armed" or not m.saw.airborne:
        return None
    if m.event.command not in (ev.UserCommand.LAND, ev.UserCommand.ABORT) or m.before.state is State.PILOT:
        return None
    if m.in_doubt or m.saw.on_ground(m.rules.limits):
        return None
    return True if m.after.state in (State.LAND, State.PILOT) or not m.before.flight.active else "not landing"


@law("5", "Every change of place, and every request, stands in exactly one decision of the journal.")
def everything_is_written_down(m: Moment) -> Verdict:
    decisions = [c for c in m.commands if isinstance(c, Decision)]
    written = [text for decision in decisions for text in decision.commands]
    numbers = sorted(int(text.rpartition("#")[2]) for text in written)
    if numbers != sorted(request.id for request in m.requests):
        return f"sent {[r.id for r in m.requests]}, written down {numbers}"
    place = m.before.state.value
    for decision in decisions:
        if decision.before != place:
            return f"from {place} to {decision.before} unwritten"
        place = decision.after
    return True if place == m.after.state.value else f"{m.after.state.value} is not written down"


@law("3, 4.1, 4.3", "Land first, tidy later: LAND, its second route, disarm, requests, answer, words, decisions.")
def the_most_needed_goes_first(m: Moment) -> Verdict:
    if len(m.commands) < 2:
        return None
    needs = [_need(command) for command in m.commands]
    for first, second, need, next_need in zip(m.commands, m.commands[1:], needs, needs[1:]):
        if need > next_need:
            return f"{type(first).__name__} before {type(second).__name__}"
    return True


def _need(command: Any) -> int:
    kind = "LAND" if getattr(command, "action", None) is A.LAND else type(command).__name__
    return next((place for place, kinds in enumerate(_BY_NEED) if kind in kinds), len(_BY_NEED))


_BY_NEED = (
    ("LAND",),
    ("AutopilotLand",),
    ("AutopilotDisarm",),
    ("MissionCommand",),
    ("LoadMission", "RunCheck", "StartRecording", "StopRecording"),
    ("Answer",),
    ("Notify",),
    ("Decision",),
)


@law("3, 4", "Nothing but the watchdog restarts anything: the engine has no such command, and asks for no other.")
def the_engine_restarts_nothing(m: Moment) -> Verdict:
    for command in m.commands:
        if type(command) not in _COMMANDS:
            return f"{type(command).__name__} is no command of the engine"
    return True


_COMMANDS = frozenset(
    {
        Answer,
        AutopilotDisarm,
        AutopilotLand,
        Decision,
        LoadMission,
        MissionCommand,
        Notify,
        RunCheck,
        StartRecording,
        StopRecording,
    }
)
