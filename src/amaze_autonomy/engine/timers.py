"""Every wait of the engine: where it applies, when it ends, and what it is called. There is no other one.

Guards ask `passed` by name; the shell asks `next_deadline` when to wake the engine; `state_deadline` is what people are
shown. A timer whose time has come and that changed nothing does not wake the engine again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Dict, Iterator, Mapping, Optional, Tuple, Union

from .events import CHECKS, CheckName, checks_of
from .failsafe import FAILSAFE_CONDITIONS, Silent, listens_until_ns
from .rules import Rules
from .state import EngineState, FailureKind, State, Step

_NS = 1_000_000_000
Place = Union[State, Tuple[State, Step]]
When = Callable[[EngineState, Rules], Optional[int]]


@dataclass(frozen=True)
class Timer:
    """One wait.

    Args:
        name: as guards and journal call it; the limit of the same name is in autonomy.yaml where it has one.
        places: states, or (state, step), where it applies.
        when: its end in nanoseconds; None when it is not running.
        ends_state: it ends the state (or the step) by itself: part of what a person is shown as deadline.
    """

    name: str
    places: Tuple[Place, ...]
    when: When
    ends_state: bool = False


def _after(since: Optional[int], limit: int) -> Optional[int]:
    return None if since is None else since + limit


def _step(limit: str) -> When:
    return lambda s, r: s.step_ns + int(getattr(r.limits, limit))


def _entered(limit: str) -> When:
    return lambda s, r: s.entered_ns + int(getattr(r.limits, limit))


def check_limit_ns(state: EngineState, rules: Rules, check: CheckName) -> int:
    """Return how long the answer to a check may take; the watchdog's first one starts its watching."""
    first = CHECKS[check].watches and state.peers.watchdog_started_ns is None
    return rules.reply_limit_ns(check.value) + (rules.limits.watchdog_startup_time_ns if first else 0)


def _check_reply(state: EngineState, rules: Rules) -> Optional[int]:
    ends = [r.asked_ns + check_limit_ns(state, rules, r.check) for r in state.preflight.checks if r.outcome is None]
    return min(ends) if ends else None


def _check_age(state: EngineState, rules: Rules) -> Optional[int]:
    checks = state.preflight.checks
    ends = [r.replied_ns + rules.max_age_ns(r.check.value) for r in checks if r.replied_ns is not None]
    return min(ends) + 1 if ends else None


def _check_poll(state: EngineState, rules: Rules) -> Optional[int]:
    replied = [r.replied_ns for r in state.preflight.checks if r.replied_ns is not None]
    return max(replied) + rules.limits.preflight_fix_poll_ns if len(replied) == len(checks_of(rules)) else None


def _wait(state: EngineState, rules: Rules) -> Optional[int]:
    ends = [f.deadline_ns for f in state.failures if f.deadline_ns is not None and f.kind is not FailureKind.USER]
    return max(min(ends), listens_until_ns(state, rules)) if ends else None


def _disarm(state: EngineState, rules: Rules) -> Optional[int]:
    if state.landing.disarm_sent_ns is not None:
        return state.landing.disarm_sent_ns + rules.limits.ground_disarm_period_ns
    since_ns = state.flight.grounded_ns
    if since_ns is not None and state.landing.since_ns is not None and state.flight.was_airborne:
        since_ns = max(since_ns, state.landing.since_ns)  # a LAND has its time first
    return _after(since_ns, rules.limits.ground_disarm_after_ns)


def _down_since(state: EngineState) -> Optional[int]:
    """Return since when it is down for good: motors that turned on for a while do not count."""
    return state.flight.grounded_ns if state.vehicle.down is None else state.vehicle.down.since_ns


def _takeover_silent(state: EngineState, rules: Rules) -> Optional[int]:
    """Return when a vehicle that somebody else seems to have is no longer heard: then nothing is in doubt any more."""
    if state.vehicle.takeover is None or state.peers.autopilot_ns is None:
        return None
    ends = (
        state.peers.autopilot_ns + rules.limits.autopilot_status_limit_ns + 1,
        time_of("autopilot_link_limit", state, rules),
    )
    return min(end for end in ends if end is not None)


def _takeover(state: EngineState, rules: Rules) -> Optional[int]:
    agreed = state.vehicle.takeover
    return None if agreed is None else agreed.since_ns + rules.limits.pilot_confirm_ns


def _second_route(state: EngineState, rules: Rules) -> Optional[int]:
    return _after(state.landing.since_ns, rules.limits.land_second_route_after_ns)


_CHECKED = (State.PREFLIGHT, State.LOAD_MISSION, (State.MISSION, Step.TOUCHDOWN))
_TAKING_BACK = (State.READY, State.START_RECORDING, State.LOAD_MISSION, (State.MISSION, Step.TOUCHDOWN))
_FLYING = (State.TAKEOFF, (State.MISSION, Step.FLYING), State.HOLD)
_WATCHED = (*_FLYING, State.LAND)
_BEFORE_TAKEOFF = (State.PREFLIGHT, *_TAKING_BACK)


def _failsafe_timers() -> Iterator[Timer]:
    """Yield the waits that follow from what can be silent: nothing that can be lost has to be remembered here."""
    for row in FAILSAFE_CONDITIONS:
        places = (*_BEFORE_TAKEOFF, *_WATCHED) if row.on_ground else _WATCHED
        for condition in row.when:
            if isinstance(condition, Silent):  # what ends a flight ends nothing more while it lands
                there = _FLYING if condition.ends_flight else places
                yield Timer(condition.timer, there, condition.end_ns, condition.ends_flight)


TIMERS: Tuple[Timer, ...] = (
    Timer("check_reply_limit", _CHECKED, _check_reply),
    Timer("preflight_fix_poll", (State.PREFLIGHT,), _check_poll),
    Timer("preflight_fix_limit", (State.PREFLIGHT,), lambda s, _: s.preflight.fix_deadline_ns, ends_state=True),
    Timer("check_max_age", (State.LOAD_MISSION, (State.MISSION, Step.TOUCHDOWN)), _check_age),
    Timer("ready_limit", (State.READY,), _entered("ready_limit_ns"), ends_state=True),
    Timer(
        "recording_lead",
        (State.START_RECORDING, State.LOAD_MISSION, (State.MISSION, Step.TOUCHDOWN)),
        lambda s, r: _after(s.recording.since_ns, r.limits.recording_lead_ns),
    ),
    Timer("recording_start_limit", (State.START_RECORDING,), _entered("recording_start_limit_ns"), ends_state=True),
    Timer("load_limit", (State.LOAD_MISSION, (State.MISSION, Step.TOUCHDOWN)), _step("load_limit_ns"), ends_state=True),
    Timer("arm_limit", ((State.TAKEOFF, Step.ARMING),), _step("arm_limit_ns"), ends_state=True),
    Timer("lift_off_limit", ((State.TAKEOFF, Step.LIFTING_OFF),), _step("lift_off_limit_ns"), ends_state=True),
    Timer("takeoff_limit", ((State.TAKEOFF, Step.CLIMBING),), _step("takeoff_limit_ns"), ends_state=True),
    Timer("cancel_limit", ((State.TAKEOFF, Step.CANCELLING),), _step("cancel_limit_ns"), ends_state=True),
    Timer("hold_confirm_limit", ((State.HOLD, Step.CONFIRMING),), _step("hold_confirm_limit_ns"), ends_state=True),
    Timer(
        "hold_repeat_after",
        ((State.HOLD, Step.CONFIRMING),),
        lambda s, r: None if s.flight.hold_repeated else s.step_ns + r.limits.hold_repeat_after_ns,
    ),
    Timer("moving", ((State.HOLD, Step.HOLDING),), lambda s, r: _after(s.vehicle.adrift_ns, r.limits.descent_time_ns)),
    Timer("resume_confirm_limit", ((State.HOLD, Step.RESUMING),), _step("resume_confirm_limit_ns"), ends_state=True),
    Timer("wait_limit", _FLYING, _wait, ends_state=True),
    Timer(
        "user_hold_limit",
        (State.HOLD,),
        lambda s, r: _after(s.flight.user_hold_ns, r.limits.user_hold_limit_ns),
        ends_state=True,
    ),
    *_failsafe_timers(),
    Timer(
        "confirm_limit",
        ((State.TAKEOFF, Step.CLIMBING), (State.MISSION, Step.FLYING), State.HOLD),
        lambda s, r: None if s.flight.active else _after(_down_since(s), r.limits.confirm_limit_ns),
        ends_state=True,
    ),
    Timer(
        "stays_armed",
        ((State.TAKEOFF, Step.CLIMBING), (State.MISSION, Step.FLYING), State.LAND),
        lambda s, r: None if s.vehicle.spinning is None else s.vehicle.spinning.since_ns + r.limits.confirm_limit_ns,
    ),
    Timer("takeover_silent", (*_BEFORE_TAKEOFF, State.DATA_CLEANUP), _takeover_silent),
    Timer("pilot_confirm", (*_BEFORE_TAKEOFF, *_WATCHED, State.DATA_CLEANUP), _takeover),
    Timer("land_repeat_period", (State.LAND,), lambda s, r: s.landing.sent_ns + r.limits.land_repeat_period_ns),
    Timer("land_second_route_after", ((State.LAND, Step.COMMANDING),), _second_route),
    Timer("land_alarm_after", ((State.LAND, Step.COMMANDING),), _step("land_alarm_after_ns")),
    Timer("descent_time", (State.LAND,), lambda s, r: _after(s.vehicle.descending_ns, r.limits.descent_time_ns)),
    Timer(
        "land_limit", (State.LAND,), lambda s, r: _after(s.landing.since_ns, r.limits.land_limit_ns), ends_state=True
    ),
    Timer("ground_disarm_after", (State.LAND, (State.MISSION, Step.FLYING)), _disarm),
    Timer(
        "never_armed",
        (State.LAND,),
        lambda s, r: None if s.flight.was_armed else _after(s.landing.since_ns, r.limits.arm_limit_ns),
    ),
    Timer(
        "recorder_silent",
        (State.DATA_CLEANUP,),
        lambda s, r: max(s.peers.recorder_ns or 0, s.entered_ns) + r.limits.recorder_status_limit_ns + 1,
    ),
    Timer("data_cleanup_limit", (State.DATA_CLEANUP,), _entered("data_cleanup_limit_ns"), ends_state=True),
)

_BY_NAME: Dict[str, Timer] = {timer.name: timer for timer in TIMERS}


def _index() -> Mapping[Tuple[State, Step], Tuple[Timer, ...]]:
    return {
        (state, step): tuple(t for t in TIMERS if state in t.places or (state, step) in t.places)
        for state in State
        for step in Step
    }


_AT: Mapping[Tuple[State, Step], Tuple[Timer, ...]] = _index()


def time_of(name: str, state: EngineState, rules: Rules) -> Optional[int]:
    """Return when a timer ends; None when it is not running."""
    return _BY_NAME[name].when(state, rules)


def passed(name: str, state: EngineState, rules: Rules, now_ns: int) -> bool:
    """Return True when a timer has ended at `now_ns`."""
    end = _BY_NAME[name].when(state, rules)
    return end is not None and now_ns >= end


def next_deadline(state: EngineState, rules: Rules) -> Optional[int]:
    """Return the next time after the state's own at which the shell must send `Tick`; None: no need to."""
    soonest: Optional[int] = None
    now = state.t_ns
    for timer in _AT[state.state, state.step]:
        end = timer.when(state, rules)
        if end is not None and end > now and (soonest is None or end < soonest):
            soonest = end
    return soonest


def state_deadline(state: EngineState, rules: Rules) -> Optional[Tuple[str, int]]:
    """Return name and time of the first timer that ends the present state; None where a person is waited for."""
    ends = [
        (end, timer.name)
        for timer in _AT[state.state, state.step]
        if timer.ends_state
        for end in (timer.when(state, rules),)
        if end is not None
    ]
    if not ends:
        return None
    end, name = min(ends)
    return name, end
