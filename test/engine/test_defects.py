"""Would these tests notice? Deliberate defects, each in the engine for the length of one story that must then fail.

Every row of the transition table is left out once, every timer never ends once, and what else could go wrong is listed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Callable, NamedTuple

import engine_story
import pytest
import test_decision_table
import test_double_failures
import test_ending
import test_landing
import test_losses
import test_messages_in
import test_pilot
import test_preflight
import test_transitions
import test_waits
from engine_beginnings import BEGINNINGS, at

from amaze_autonomy.engine import context, events, failsafe, flight_guards, guards, rules, timers, update
from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine.commands import Seen
from amaze_autonomy.engine.events import Outcome, Reply, VehicleLanded
from amaze_autonomy.engine.guards import both
from amaze_autonomy.engine.rules import Action, Code, Severity, SeverityRow
from amaze_autonomy.engine.state import State, evolve, put

Patch = Callable[[pytest.MonkeyPatch], None]


class Defect(NamedTuple):
    """What is broken, how, and the story that notices."""

    words: str
    breaks: Patch
    story: Callable[[], object]


@pytest.fixture(autouse=True)
def sound_beginnings(monkeypatch):
    """Tell every beginning while the engine is sound, and let no law help the story to notice."""
    for place in BEGINNINGS:
        at(place)
    monkeypatch.setattr(engine_story, "ALWAYS", [])


def notices(story: Callable[[], object]) -> bool:
    try:
        story()
    except Exception:  # noqa: BLE001 - a defect may show in any way
        return True
    return False


# --- every row, every timer -------------------------------------------------------------------------------------------


def without(rule: str) -> Patch:
    """Leave a row out of the transition table."""

    def breaks(patch: pytest.MonkeyPatch) -> None:
        rows = {place: tuple(r for r in found if r.rule != rule) for place, found in engine.ROWS_AT.items()}
        patch.setattr(engine, "ROWS_AT", rows)

    return breaks


@pytest.mark.parametrize("row", test_transitions.ROWS, ids=[row.rule for row in test_transitions.ROWS])
def test_each_row_that_is_left_out_is_missed(row, monkeypatch):
    without(row.rule)(monkeypatch)
    assert notices(lambda: test_transitions.test_row(row))


@pytest.mark.parametrize("wait", test_waits.WAITS, ids=[wait.timer for wait in test_waits.WAITS])
def test_each_timer_that_never_ends_is_missed(wait, monkeypatch):
    def never(timer: Any) -> Any:
        return replace(timer, when=lambda *_: None) if timer.name == wait.timer else timer

    monkeypatch.setattr(timers, "_BY_NAME", {name: never(timer) for name, timer in timers._BY_NAME.items()})
    monkeypatch.setattr(timers, "_AT", {place: tuple(map(never, found)) for place, found in timers._AT.items()})
    assert notices(lambda: test_waits.test_a_wait_runs_out_at_its_limit_and_not_before(wait))


# --- what else could go wrong -----------------------------------------------------------------------------------------


def row(rule: str, **changes: Any) -> Patch:
    """Change a row of the transition table."""

    def breaks(patch: pytest.MonkeyPatch) -> None:
        rows = {
            place: tuple(replace(r, **changes) if r.rule == rule else r for r in found)
            for place, found in engine.ROWS_AT.items()
        }
        patch.setattr(engine, "ROWS_AT", rows)

    return breaks


def severity_row(name: Severity, *fields: Any) -> Patch:
    return lambda patch: patch.setitem(rules.SEVERITIES, name, SeverityRow(*fields))


def attribute(owner: Any, name: str, value: Any) -> Patch:
    return lambda patch: patch.setattr(owner, name, value)


def takes(kind: Any, take: Any) -> Patch:
    return lambda patch: patch.setitem(update._UPDATES, kind, take)


def landing_is_left(patch: pytest.MonkeyPatch) -> None:
    """Let a landing go back to the mission when nothing is wrong any more."""
    back = replace(
        next(r for r in engine.ROWS_AT[State.HOLD, _step("holding")] if r.rule == "resume"),
        guard=lambda t: None if t.state.failures else Seen(),
    )
    rows = {place: (back, *found) if place[0] is State.LAND else found for place, found in engine.ROWS_AT.items()}
    patch.setattr(engine, "ROWS_AT", rows)


def _step(name: str) -> Any:
    return next(step for state, step in engine.ROWS_AT if state is State.HOLD and step.value == name)


def nan_is_a_number(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(events, "isfinite", lambda _: True)
    row("at_takeoff_height", guard=lambda t: None if (t.vehicle().height_m or 0.0) < 1.0 else Seen())(patch)


def any_reply(t: Any, event: Reply) -> None:
    for path in ("flight.motion.outcome", "preflight.load.outcome", "recording.request.outcome"):
        t.state = put(t.state, path, event.outcome)


def any_session(t: Any, event: Any) -> None:
    t.put("peers", planner=event, planner_ns=t.now)


def any_action(t: Any, event: Any) -> None:
    t.put("peers", action=event, heartbeat_ns=t.now, components=event.components)


def ages_are_ignored(t: Any) -> Any:
    return Seen() if all(record.ok for record in t.state.preflight.checks) else None


def down_unless_armed(self: Any) -> bool:
    status = self.vehicle()
    return status is not None and status.armed is not True and status.landed is not VehicleLanded.IN_AIR


def ground_unless_flying(self: Any) -> bool:
    status = self.vehicle()
    return status is not None and status.landed is not VehicleLanded.IN_AIR


def vehicle_of_any_age(self: Any) -> Any:
    return self.state.peers.autopilot


def ok_is_believed(record: Any, event: Any, now_ns: int) -> Any:
    return evolve(record, replied_ns=now_ns, outcome=event.outcome, ok=event.ok, rows=event.checks)


def sixteen_is_eight(name: Severity, code: Code) -> Any:
    return None if code == Code.NOMINAL else rules.SEVERITIES[name].action


def the_users_refused_request_is_carried_out(self: Any) -> None:
    """Forget nothing."""


def spends_nothing(self: Any, new: Any) -> None:
    """Write nothing down."""


def waits_for_ever(*_: Any) -> int:
    return 10**18


_moderate = Severity.MODERATE
DEFECTS = (
    Defect(
        "a moderate one is landed for",
        severity_row(_moderate, Code.INCONVENIENT, Code.INCONVENIENT, Action.LAND, None),
        lambda: test_decision_table.test_component_fails_in_flight("barometer", "MISSION flying"),
    ),
    Defect(
        "a moderate one is landed for at its limit",
        severity_row(_moderate, Code.INCONVENIENT, Code.INCONVENIENT, Action.WAIT, Action.LAND),
        lambda: test_decision_table.test_not_back_in_time_the_second_verb("barometer", "MISSION flying"),
    ),
    Defect(
        "a high one is flown on without",
        severity_row(Severity.HIGH, Code.HOLD, Code.ABORT, Action.WAIT, Action.CONTINUE),
        lambda: test_decision_table.test_not_back_in_time_the_second_verb("lrf", "MISSION flying"),
    ),
    Defect(
        "the highest is waited for",
        severity_row(Severity.HIGHEST, Code.ABORT, Code.ABORT, Action.WAIT, Action.LAND),
        test_decision_table.test_a_mission_that_judges_a_component_highest_lands_at_once,
    ),
    Defect(
        "code 16 is like 8",
        attribute(failsafe, "action_of", sixteen_is_eight),
        lambda: test_decision_table.test_every_code_in_every_phase_of_flight("MISSION flying", 16, True),
    ),
    Defect(
        "a mission's own severities are ignored",
        attribute(failsafe, "severity_of", lambda *_: Severity.LOW),
        test_decision_table.test_a_mission_may_judge_a_component_otherwise,
    ),
    Defect(
        "a landing goes back to the mission",
        landing_is_left,
        lambda: test_double_failures.test_a_landing_goes_on_whatever_fails_and_comes_back("imu", 16),
    ),
    Defect(
        "the land command is not first",
        attribute(engine, "_rank", lambda command: 0 if type(command).__name__ == "Notify" else 1),
        test_losses.test_the_land_command_comes_before_every_message,
    ),
    Defect(
        "NaN is high enough",
        nan_is_a_number,
        lambda: test_messages_in.test_unknown_height_in_the_climb_is_not_takeoff_height(float("nan")),
    ),
    Defect(
        "any reply is the current one",
        takes(Reply, any_reply),
        test_messages_in.test_a_late_refusal_of_an_earlier_command_changes_nothing,
    ),
    Defect(
        "any session is this one",
        takes(events.MissionStatus, any_session),
        lambda: test_messages_in.test_a_planner_of_another_session_confirms_nothing("other"),
    ),
    Defect(
        "a status may be of any age",
        attribute(update, "_credible", lambda *_: True),
        lambda: test_messages_in.test_a_stale_or_future_status_is_no_sign_of_life(10**10),
    ),
    Defect(
        "a vehicle's status is true for ever",
        attribute(context.Context, "vehicle", vehicle_of_any_age),
        lambda: test_landing.test_never_disarmed_while_airborne_or_unknown({"link_age_s": None}),
    ),
    Defect(
        "a stuck loop is a heartbeat",
        takes(events.WatchdogAction, any_action),
        test_losses.test_a_loop_counter_that_stands_still_is_no_heartbeat,
    ),
    Defect(
        "a legacy watchdog's code is ignored",
        attribute(update, "_listed", lambda event: event.components),
        lambda: test_messages_in.test_a_legacy_watchdog_says_only_a_code_and_the_latest_component(16, "imu", "LAND"),
    ),
    Defect(
        "flapping spends nothing",
        attribute(failsafe._Ledger, "close", spends_nothing),
        test_double_failures.test_flapping_spends_the_budget_of_a_flight,
    ),
    Defect(
        "a wait has no limit",
        attribute(failsafe._Ledger, "_deadline", waits_for_ever),
        lambda: test_decision_table.test_not_back_in_time_the_second_verb("lrf", "MISSION flying"),
    ),
    Defect(
        "GIVEN_UP is not heard",
        attribute(failsafe, "Restart", type("Deaf", (), {"GIVEN_UP": None, "TRYING": failsafe.Restart.TRYING})),
        test_decision_table.test_given_up_at_code_8_lands_too,
    ),
    Defect(
        "one route is both",
        attribute(flight_guards, "_BOTH_ROUTES", frozenset()),
        lambda: test_losses.test_lost_in_flight("planner_status", "MISSION flying"),
    ),
    Defect(
        "the autopilot is lost quietly",
        attribute(flight_guards, "_ALARM", frozenset()),
        lambda: test_losses.test_lost_in_flight("autopilot_status", "MISSION flying"),
    ),
    Defect(
        "takes off with what it lands for",
        row("takeoff", guard=both(guards.all_checks_passed, guards.planner_confirmed)),
        lambda: test_preflight.test_nothing_takes_off_to_land_at_once(test_preflight.FORBIDDING["battery critical"]),
    ),
    Defect(
        "takes off with checks of any age",
        row("takeoff", guard=both(ages_are_ignored, guards.planner_confirmed)),
        test_preflight.test_checks_one_nanosecond_older_do_not,
    ),
    Defect(
        "takes off without the planner",
        row("takeoff", guard=guards.all_checks_passed),
        lambda: test_preflight.test_a_planner_that_has_loaded_something_else_confirms_nothing({"mission_id": "2"}),
    ),
    Defect(
        "ok is believed without its rows",
        attribute(update, "answer_of", ok_is_believed),
        lambda: test_messages_in.test_ok_is_believed_only_when_every_row_passed(test_messages_in.Verdict.FAIL),
    ),
    Defect(
        "unknown is landed",
        attribute(context.Context, "down", down_unless_armed),
        lambda: test_messages_in.test_unknown_is_not_landed({"armed": None}),
    ),
    Defect(
        "unknown is on the ground",
        attribute(context.Context, "on_ground", ground_unless_flying),
        lambda: test_landing.test_never_disarmed_while_airborne_or_unknown({"landed": VehicleLanded.UNKNOWN}),
    ),
    Defect(
        "every mode is ours",
        attribute(update, "ours", lambda *_, **__: True),
        lambda: test_pilot.test_takeover_in_every_phase_stops_commanding("MISSION flying", {"mode": "POSCTL"}),
    ),
    Defect(
        "only the last mode is ours",
        attribute(update, "ours", lambda *_, **__: False),
        test_pilot.test_the_old_mode_goes_on_until_the_command_takes_effect,
    ),
    Defect(
        "the failsafe flag is ignored",
        row("pilot_took_over", guard=lambda t: Seen() if t.vehicle() and t.vehicle().pilot_in_control else None),
        lambda: test_pilot.test_takeover_in_every_phase_stops_commanding(
            "MISSION flying", {"failsafe": True, "mode": "AUTO.LOITER"}
        ),
    ),
    Defect(
        "the pilot's hands are not seen while landing",
        row("pilot_took_over", guard=lambda t: None if t.state.state is State.LAND else flight_guards.taken_over(t)),
        lambda: test_pilot.test_takeover_in_every_phase_stops_commanding("LAND descending", {"pilot_in_control": True}),
    ),
    Defect(
        "what the user is refused is done",
        attribute(context.Context, "consume", the_users_refused_request_is_carried_out),
        test_double_failures.test_a_component_fails_in_the_moment_of_the_users_hold,
    ),
    Defect(
        "what was said before a restart is known",
        takes(events.EngineStarted, lambda *_: None),
        lambda: test_ending.test_a_restart_resumes_where_it_was_and_sends_nothing_twice("MISSION flying", 0.1),
    ),
    Defect(
        "a shutdown forgets the second route",
        row("shutdown_in_flight", sets={}),
        lambda: test_ending.test_told_to_end("MISSION flying", "SIGTERM"),
    ),
    Defect(
        "accepted is enough",
        row("hold_confirmed", guard=lambda t: Seen() if t.state.flight.motion.outcome is Outcome.ACCEPTED else None),
        test_messages_in.test_accepted_alone_is_no_hold,
    ),
)


@pytest.mark.parametrize("defect", DEFECTS, ids=[defect.words for defect in DEFECTS])
def test_each_defect_is_noticed(defect, monkeypatch):
    assert not notices(defect.story), "the story holds while the engine is sound"
    defect.breaks(monkeypatch)
    assert notices(defect.story), "and not with this defect"
