"""The self-test of the proof: deliberate defects in the engine, each of which some law must catch.

How a defect is put in, and many of the defects, are shared with `test/engine/test_defects.py`, where a story notices
it; here nobody tells a story: the explorer has to find its own way to the moment in which the defect does harm.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Dict, NamedTuple, Optional, Tuple

import proof_peers
import pytest
import test_defects as stories
from proof_explorer import Broken, explore
from proof_liveness import loops
from proof_worlds import WORLDS
from test_defects import Patch, attribute, row, takes, without

from amaze_autonomy.engine import context, effects, events, failsafe, flight_guards, guards, timers, update
from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine import guards as data
from amaze_autonomy.engine.commands import AnswerKind, AutopilotLand, MissionAction, MissionCommand, Seen
from amaze_autonomy.engine.decide import Case
from amaze_autonomy.engine.events import Outcome
from amaze_autonomy.engine.failsafe import Says
from amaze_autonomy.engine.state import EngineState, State, Step, put

LIMIT = 12_000
"""Transitions after which a world begins no further layer; what it has not caught by then it has missed."""


class Defect(NamedTuple):
    """What is broken, how, and the worlds in which it is looked for."""

    words: str
    breaks: Patch
    worlds: Tuple[str, ...]


class Caught(NamedTuple):
    """Which law caught a defect, where, and after how many moves of the shortest way."""

    law: str
    world: str
    moves: int


def caught_by(defect: Defect, limit: int = LIMIT) -> Optional[Caught]:
    """Put a defect into the engine, explore, take it out again; return what caught it."""
    with pytest.MonkeyPatch.context() as patch:
        defect.breaks(patch)
        patch.setattr(proof_peers, "_KEPT", {})
        for name in defect.worlds:
            found = explore(WORLDS[name], limit, compare=False)
            broken: Optional[Broken] = found.broken
            if broken is not None:
                return Caught(broken.law, name, len(broken.path))
            stuck = loops(found)
            if stuck:
                return Caught("no_loop_without_progress", name, len(found.path(stuck[0])))
    return None


def never_ends(name: str) -> Patch:
    """Let a timer never end; where it is that of a silence, nobody notices the silence."""

    def breaks(patch: pytest.MonkeyPatch) -> None:
        def never(timer: Any) -> Any:
            return replace(timer, when=lambda *_: None) if timer.name == name else timer

        def noticed(row: Any) -> Any:
            return replace(row, when=tuple(each for each in row.when if getattr(each, "timer", "") != name))

        patch.setattr(timers, "_BY_NAME", {key: never(timer) for key, timer in timers._BY_NAME.items()})
        patch.setattr(timers, "_AT", {place: tuple(map(never, found)) for place, found in timers._AT.items()})
        patch.setattr(failsafe, "FAILSAFE_CONDITIONS", tuple(map(noticed, failsafe.FAILSAFE_CONDITIONS)))

    return breaks


def entering(place: Tuple[State, Step], effect: Any) -> Patch:
    """Do something else on the way into a state."""
    return lambda patch: patch.setitem(effects.ENTER, place, effect)


def both(*patches: Patch) -> Patch:
    def breaks(patch: pytest.MonkeyPatch) -> None:
        for each in patches:
            each(patch)

    return breaks


def swapped(first: str, second: str) -> Patch:
    """Try two rows in the other order."""

    def breaks(patch: pytest.MonkeyPatch) -> None:
        rows = dict(engine.ROWS_AT)
        for place, found in engine.ROWS_AT.items():
            names = [r.rule for r in found]
            if first in names and second in names:
                one, other = names.index(first), names.index(second)
                rows[place] = _exchanged(found, one, other)
        patch.setattr(engine, "ROWS_AT", rows)

    return breaks


def _exchanged(rows: Tuple[Any, ...], one: int, other: int) -> Tuple[Any, ...]:
    order = list(rows)
    order[one], order[other] = order[other], order[one]
    return tuple(order)


def _no_alarm(t: Any) -> None:
    """Tell nobody."""


def _land_by_one_route(t: Any) -> None:
    since = t.now if t.state.landing.since_ns is None else t.state.landing.since_ns
    t.put("landing", since_ns=since, sent_ns=t.now)
    effects._motion(t, MissionAction.LAND)


def _disarm_at_once(t: Any) -> Any:
    return Seen() if t.armed() and t.state.peers.autopilot.vertical_speed_m_s is not None else None


def _reply_without_id(t: Any, event: Any) -> None:
    t.state = put(t.state, "flight.motion.outcome", event.outcome)


def _check_without_id(t: Any, event: Any) -> None:
    records = tuple(
        update.answer_of(r, event, t.now) if r.check is event.check and r.outcome is None else r
        for r in t.state.preflight.checks
    )
    t.put("preflight", checks=records)


def _restart_forgets(t: Any, event: Any) -> None:
    if event.resumed:
        t.state = EngineState(t_ns=t.now)
    t.set(label=event.label, started_ns=t.now)


def _restart_takes_off(t: Any, event: Any) -> None:
    t.set(started_ns=t.now)
    if event.resumed and t.state.state is State.TAKEOFF:
        effects._motion(t, MissionAction.TAKEOFF)


def _restart_loads(t: Any, event: Any) -> None:
    t.set(started_ns=t.now)
    if event.resumed and t.state.state is State.LOAD_MISSION:
        effects.load_mission(t)


def _forgets_that_it_flew(patch: pytest.MonkeyPatch) -> None:
    """Believe neither the vehicle nor the planner that it flies."""
    patch.setattr(update, "_remember_flight", lambda t: t.put("flight", was_airborne=True, was_armed=True))
    patch.setattr(context.Context, "planner_flew", lambda _: False)


def _always_in_flight(t: Any) -> None:
    if t.state.flight.active and t.armed():
        t.put("flight", was_armed=True)


def _repeats_takeoff(t: Any) -> Any:
    return Seen() if t.state.step is Step.ARMING and t.state.flight.motion.outcome is Outcome.TIMED_OUT else None


def _again(patch: pytest.MonkeyPatch) -> None:
    """Send TAKEOFF again when the first one was not answered."""
    sample = next(r for r in engine.ROWS_AT[State.TAKEOFF, Step.ARMING] if r.rule == "not_armed")
    again = replace(sample, rule="again", guard=_repeats_takeoff, target=(State.TAKEOFF, Step.ARMING), message="")
    place = (State.TAKEOFF, Step.ARMING)
    patch.setattr(engine, "ROWS_AT", {**engine.ROWS_AT, place: (again, *engine.ROWS_AT[place])})


def _says_recording(status: Any) -> bool:
    return bool(status.phase is events.RecordingPhase.RECORDING)


def _not_low(t: Any) -> Any:
    status = t.vehicle()
    return None if status is None or status.height_m is None or status.height_m < t.limits.takeoff_height_m else Seen()


def _level_of_nothing(t: Any) -> Any:
    status, limit = t.state.peers.autopilot, t.limits.battery_critical_fraction
    return Seen() if status is not None and (status.battery_fraction or 0.0) > 1 - limit else None


def _landed_by_word(t: Any) -> Any:
    return Seen() if t.state.flight.motion.outcome is Outcome.ACCEPTED else None


def _commands_in_pilot(t: Any) -> None:
    effects.pilot(t)
    effects._motion(t, MissionAction.LAND)


def _skips_the_stop(t: Any) -> None:
    t.put("flight", active=False)
    t.put("landing", since_ns=None)


def _silent_landing(t: Any) -> None:
    t.put("landing", since_ns=t.now, sent_ns=t.now)


def judged(name: str, holds: Any) -> Patch:
    """Judge one of the failsafe conditions otherwise."""
    rows = tuple(
        replace(row, when=(Says(holds),), only="") if row.name == name else row for row in failsafe.FAILSAFE_CONDITIONS
    )
    return attribute(failsafe, "FAILSAFE_CONDITIONS", rows)


def _done() -> Any:
    return Case(AnswerKind.DONE, "Done.")


_TAKEOFF, _LAND = "takeoff", "landing"
_PASSED = (guards.all_checks_passed, guards.planner_confirmed)
_SHARED: Dict[str, Tuple[str, ...]] = {
    "a moderate one is landed for": ("flight with barometer",),
    "a moderate one is landed for at its limit": ("flight with barometer",),
    "a high one is flown on without": ("flight with lrf",),
    "the highest is waited for": ("severities",),
    "code 16 is like 8": ("severities",),
    "a landing goes back to the mission": ("flight with lrf",),
    "the land command is not first": ("flight with imu",),
    "any reply is the current one": ("users",),
    "any session is this one": ("users",),
    "a status may be of any age": ("users",),
    "a vehicle's status is true for ever": ("silence", "limits"),
    "a stuck loop is a heartbeat": ("silence",),
    "flapping spends nothing": ("flapping",),
    "a wait has no limit": ("flight with lrf",),
    "GIVEN_UP is not heard": ("severities",),
    "one route is both": ("silence",),
    "the autopilot is lost quietly": ("silence",),
    "takes off with what it lands for": ("unfit",),
    "takes off with checks of any age": ("loading",),
    "takes off without the planner": ("loading",),
    "ok is believed without its rows": ("checks",),
    "unknown is landed": ("landing",),
    "unknown is on the ground": ("landing",),
    "every mode is ours": ("pilot",),
    "only the last mode is ours": ("flight with lrf",),
    "the failsafe flag is ignored": ("pilot",),
    "the pilot's hands are not seen while landing": ("pilot",),
    "what the user is refused is done": ("users",),
    "what was said before a restart is known": ("flight with lrf",),
    "a shutdown forgets the second route": ("severities",),
    "accepted is enough": ("flight with lrf",),
}
"""The defects that the stories of test/engine notice as well, and where the explorer looks for them."""

DEFECTS: Tuple[Defect, ...] = (
    *(Defect(d.words, d.breaks, _SHARED[d.words]) for d in stories.DEFECTS if d.words in _SHARED),
    Defect(
        "NaN is high enough",
        both(attribute(events, "isfinite", lambda _: True), row("at_takeoff_height", guard=_not_low)),
        ("limits",),
    ),
    Defect("`land` is left out", without("land"), ("flight with imu",)),
    Defect(
        "`both_routes_needed` and `land_by_both_routes` are left out",
        both(without("both_routes_needed"), without("land_by_both_routes")),
        ("silence",),
    ),
    Defect("`pilot_took_over` is left out", without("pilot_took_over"), ("pilot",)),
    Defect("`ready_revoked` is left out", without("ready_revoked"), ("ready",)),
    Defect("`was_away` is left out", without("was_away"), ("away",)),
    Defect("`land_repeat` is left out", without("land_repeat"), (_LAND,)),
    Defect("`land_alarm` is left out", without("land_alarm"), (_LAND,)),
    Defect("`landing_not_shown` is left out", without("landing_not_shown"), (_LAND,)),
    Defect("`landed` is left out", without("landed"), (_LAND,)),
    Defect("`hold` is left out", without("hold"), ("flight with lrf",)),
    Defect("`user_land` is left out", without("user_land"), ("users",)),
    Defect("`grounded_while_holding` is left out", without("grounded_while_holding"), ("users",)),
    Defect("`hold_unconfirmed` is left out", without("hold_unconfirmed"), ("flapping",)),
    Defect("`checks_failed` is left out", without("checks_failed"), ("checks",)),
    Defect(
        "`data_limit` is left out, and silence is patient",
        both(without("data_limit"), without("data_incomplete")),
        ("data",),
    ),
    Defect("`landed_unexpectedly` is left out", without("landed_unexpectedly"), ("gps and imu",)),
    Defect("`resume` comes before `land`", swapped("land", "resume"), ("flight with lrf",)),
    Defect("the timer of READY never ends", never_ends("ready_limit"), ("ready",)),
    Defect("the timer of arming never ends", never_ends("arm_limit"), (_TAKEOFF,)),
    Defect("the timer of the recording's start never ends", never_ends("recording_start_limit"), ("recording",)),
    Defect("the timer of the hold's confirmation never ends", never_ends("hold_confirm_limit"), ("flapping",)),
    Defect("the heartbeat has no limit", never_ends("watchdog_heartbeat_limit"), ("silence",)),
    Defect("the battery may be unknown for ever", never_ends("battery_age_limit"), ("silence",)),
    Defect("the flight time has no limit", never_ends("flight_time"), ("limits",)),
    Defect("a takeoff needs no recording", attribute(guards, "recording_proven", lambda _: Seen()), ("unfit",)),
    Defect(
        "a recorder that says RECORDING is believed",
        both(
            attribute(data, "proves_recording", _says_recording), attribute(update, "proves_recording", _says_recording)
        ),
        ("unfit",),
    ),
    Defect("checks are not asked again before takeoff", attribute(effects, "run_checks", lambda _: None), ("checks",)),
    Defect(
        "a takeoff needs no word of the vehicle",
        attribute(context.Context, "down", lambda self: self.state.peers.autopilot is not None and not self.armed()),
        ("unfit",),
    ),
    Defect("TAKEOFF is repeated when nobody answers", _again, (_TAKEOFF,)),
    Defect("a reply without its id is taken", takes(events.Reply, _reply_without_id), ("takeoff", "users")),
    Defect("a check's late reply is taken", takes(events.CheckReply, _check_without_id), ("checks",)),
    Defect(
        "LAND goes out by one route only",
        both(
            entering((State.LAND, Step.COMMANDING), _land_by_one_route), attribute(effects, "_second_route", _no_alarm)
        ),
        (_LAND,),
    ),
    Defect(
        "LAND is entered and not sent", entering((State.LAND, Step.COMMANDING), _silent_landing), ("flight with imu",)
    ),
    Defect(
        "LAND goes out last",
        attribute(engine, "_rank", lambda c: 9 if isinstance(c, (MissionCommand, AutopilotLand)) else 1),
        ("flight with imu",),
    ),
    Defect(
        "the second route goes out before LAND",
        attribute(engine, "_rank", lambda c: 0 if isinstance(c, AutopilotLand) else 1),
        ("silence",),
    ),
    Defect("it disarms whatever is armed", row("disarm_on_ground", guard=_disarm_at_once), (_LAND,)),
    Defect("landed is what a reply says", row("landed", guard=_landed_by_word), ("severities",)),
    Defect(
        "the landing detection's word is enough",
        row("landed", guard=lambda t: Seen() if t.detection().name == "ON_GROUND" else None),
        (_LAND,),
    ),
    Defect(
        "a planner's word ends the mission", attribute(flight_guards, "touched_down", lambda _: Seen()), ("last file",)
    ),
    Defect("every file is the last", row("mission_complete", guard=flight_guards.file_done), ("next file",)),
    Defect("PILOT commands a landing", entering((State.PILOT, Step.NONE), _commands_in_pilot), ("pilot",)),
    Defect(
        "an acknowledgement in the air is taken",
        both(
            attribute(engine, "answer_to", lambda *_: _done()),
            row("acknowledged", guard=lambda t: Seen() if t.user is events.UserCommand.ACKNOWLEDGE else None),
        ),
        ("pilot",),
    ),
    Defect("the recording is not stopped", entering((State.DATA_CLEANUP, Step.NONE), _skips_the_stop), ("data", _LAND)),
    Defect(
        "a merge that failed is complete",
        row("data_complete", guard=lambda t: Seen() if t.state.peers.recorder else None),
        ("data",),
    ),
    Defect("what the flight lacks is kept quiet", without("data_lost"), ("data",)),
    Defect("what flew is said not to be flown", _forgets_that_it_flew, ("data",)),
    Defect("data is given up in silence", row("give_up_data", sets={}), ("data",)),
    Defect("a restart forgets the flight", takes(events.EngineStarted, _restart_forgets), ("flight with lrf",)),
    Defect("a restart takes off again", takes(events.EngineStarted, _restart_takes_off), (_TAKEOFF,)),
    Defect("a restart uploads again", takes(events.EngineStarted, _restart_loads), ("loading",)),
    Defect("a flight never ends", attribute(update, "_flight", _always_in_flight), ("last file", _LAND)),
    Defect(
        "the battery is judged the other way round",
        judged("battery_critical", _level_of_nothing),
        ("silence",),
    ),
    Defect("height has no limit", judged("height", lambda _: None), ("limits",)),
    Defect("distance has no limit", judged("distance", lambda _: None), ("limits",)),
    Defect("tilt has no limit", judged("tilt", lambda _: None), ("limits",)),
    Defect("a lost link is no loss", judged("autopilot_status", lambda _: None), ("limits",)),
    Defect(
        "a planner that failed is not heard",
        judged("planner_failed", lambda _: None),
        ("silence",),
    ),
    Defect("decisions are not written down", attribute(engine, "_write_down", lambda *_: None), ("checks",)),
    Defect("the user is not answered", attribute(engine, "_answer", lambda _: None), ("users",)),
)
