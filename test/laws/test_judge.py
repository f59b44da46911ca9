"""A judge sees a whole sequence: what each law said, where one was broken first and how often, and it forgets nothing.

That each law can be broken at all is shown by the defects of test/proof.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from amaze_autonomy.engine.commands import Answer, AnswerKind, AutopilotDisarm, Decision, MissionAction, StartRecording
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    EngineStarted,
    Mission,
    MissionSelected,
    Tick,
    UserCommand,
    UserRequest,
    VehicleLanded,
)
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, Flight, State
from amaze_autonomy.laws import LAWS, Broken, BrokenLawError, Judge, Judged, Witness, check, judge, observed

S = 1_000_000_000
RULES = Rules()
DISARM = AutopilotDisarm(id=1, limit_ns=RULES.limits.command_reply_limit_ns)
WRITTEN = Decision(
    t_ns=S,
    sequence=0,
    event="Tick",
    before="MISSION_INPUT",
    after="MISSION_INPUT",
    step="",
    rule="disarm_on_ground",
    commands=("AutopilotDisarm()#1",),
)


def at(t_ns):
    return EngineState(t_ns=t_ns)


def test_what_is_kept_is_counted():
    sound = Judge(RULES)
    state = EngineState()
    for event in (
        EngineStarted(t_ns=S),
        AutopilotStatus(t_ns=S + 1, armed=False, landed=VehicleLanded.ON_GROUND),
        Tick(t_ns=2 * S),
    ):
        after, commands = decide(state, event, RULES)
        sound.watch(state, event, commands, after)
        state = after
    assert sound.judged() == Judged(3, {"time_never_runs_back": 3}, ())


def test_a_broken_law_is_told_once_with_its_first_moment_and_how_often():
    judge_ = Judge(RULES)
    judge_.watch(at(0), Tick(t_ns=S), (), at(S))
    for number, t_ns in enumerate((2 * S, 3 * S), 1):
        sent, written = replace(DISARM, id=number), replace(WRITTEN, commands=(f"AutopilotDisarm()#{number}",))
        judge_.watch(at(t_ns - S), Tick(t_ns=t_ns), (sent, written), at(t_ns))
    why = "disarm although the vehicle does not say, freshly, armed and ON_GROUND"
    assert judge_.judged().broken == (Broken(LAWS["disarm_on_the_ground_only"], why, 2 * S, "Tick", 2, times=2),)
    assert judge_.judged().applied == {
        "everything_is_written_down": 2,
        "no_request_twice": 2,
        "requests_say_what_they_mean": 2,
        "the_engine_restarts_nothing": 2,
        "the_most_needed_goes_first": 2,
        "time_never_runs_back": 3,
    }


def test_the_explorer_stops_at_the_first_broken_law():
    moment = observed(Witness(), at(0), Tick(t_ns=S), (DISARM, WRITTEN), at(S), RULES)
    applied = {}
    with pytest.raises(BrokenLawError, match="disarm although the vehicle does not say") as caught:
        judge(applied)(moment)
    assert (caught.value.law, caught.value.event) == ("disarm_on_the_ground_only", Tick(t_ns=S))


def test_a_law_that_does_not_apply_says_nothing():
    moment = observed(Witness(), at(0), Tick(t_ns=S), (), at(S), RULES)
    assert [(law.name, why) for law, why in check(moment)] == [("time_never_runs_back", "")]


def test_an_engine_that_begins_anew_is_judged_anew():
    watched = Judge(RULES)
    early = AutopilotStatus(t_ns=9 * S, armed=True, landed=VehicleLanded.ON_GROUND)
    watched.watch(at(9 * S), early, (), at(9 * S))
    watched.begin()
    watched.watch(at(0), Tick(t_ns=9 * S), (DISARM, WRITTEN), at(9 * S))
    assert [broken.law.name for broken in watched.judged().broken] == ["disarm_on_the_ground_only"]


def test_every_law_names_its_rule():
    assert [law.name for law in LAWS.values() if not law.source or not law.words.endswith(".")] == []


@pytest.mark.parametrize("age_ns, agrees", [(0, True), (S + 1, False), (-S // 5 - 1, False)])
def test_a_status_that_the_engine_does_not_take_agrees_with_none_before_it(age_ns, agrees):
    said = AutopilotStatus(t_ns=9 * S, armed=True, landed=VehicleLanded.ON_GROUND, mode="AUTO.LOITER", link_age_s=0.0)
    later = replace(said, t_ns=said.t_ns + RULES.limits.flight_end_confirm_ns, age_ns=age_ns)
    held = replace(EngineState(), t_ns=later.t_ns, state=State.HOLD, flight=replace(Flight(), active=True))
    seen = Witness(now=said.t_ns, vehicle=said, vehicle_ns=said.t_ns, ground_ns=said.t_ns)
    broken = [law.name for law, why in check(observed(seen, held, later, (), held, RULES)) if why]
    assert ("a_hold_ends_on_the_ground" in broken) is agrees


@pytest.mark.parametrize("motion, taken", [(MissionAction.HOLD, False), (MissionAction.TAKEOFF, True)])
def test_a_failsafes_flag_in_a_hold_of_ours_is_no_takeover_and_a_hold_of_its_own_is_one(motion, taken):
    """ArduCopter says CRITICAL of a low battery while it holds for us: our own hold is not its failsafe's."""
    said = AutopilotStatus(
        t_ns=9 * S, armed=True, landed=VehicleLanded.IN_AIR, mode="AUTO.LOITER", failsafe=True, link_age_s=0.0
    )
    held = replace(EngineState(), t_ns=said.t_ns, state=State.HOLD, flight=replace(Flight(), active=True))
    seen = Witness(now=8 * S, motion=motion, motion_ns=7 * S, answered=True, flight="armed", airborne=True)
    broken = []
    for event in (said, replace(said, t_ns=said.t_ns + RULES.limits.pilot_confirm_ns)):
        moment = observed(seen, held, event, (), held, RULES)
        broken, seen = [law.name for law, why in check(moment) if why], moment.seen
    assert ("the_pilot_has_control" in broken) is taken


@pytest.mark.parametrize("answer", list(AnswerKind))
@pytest.mark.parametrize(
    "asked",
    [
        MissionSelected(t_ns=S, missions=(Mission(id="b"),), request_id=7),
        UserRequest(t_ns=S, command=UserCommand.RETRY, request_id=7),
        UserRequest(t_ns=S, command=UserCommand.GO, request_id=7),
    ],
    ids=["select", "retry", "go"],
)
def test_who_asks_for_what_is_not_done_has_asked_for_no_takeoff(asked, answer):
    """The next mission of a queue takes off by itself behind a landing of ours: the law must go on seeing that."""
    seen = Witness(unasked=True)
    seen = observed(seen, at(0), asked, (Answer(request_id=7, answer=answer),), at(S), RULES).seen
    begins = StartRecording(id=1, limit_ns=1, session_id="b", mission_id="b")
    moment = observed(seen, at(S), Tick(t_ns=2 * S), (begins,), at(2 * S), RULES)
    broken = [law.name for law, why in check(moment) if why]
    assert ("a_person_asks" in broken) is (answer is not AnswerKind.DONE)


@pytest.mark.parametrize("x_m, far", [(100.0004, False), (100.0006, True)])
def test_a_distance_counts_to_the_millimetre_for_the_law_as_for_the_engine(x_m, far):
    said = AutopilotStatus(
        t_ns=9 * S,
        armed=True,
        landed=VehicleLanded.IN_AIR,
        mode="AUTO.MISSION",
        link_age_s=0.0,
        position_x_m=x_m,
        position_y_m=0.0,
    )
    flies = replace(EngineState(), t_ns=said.t_ns, state=State.MISSION, flight=replace(Flight(), active=True))
    seen = Witness(
        now=8 * S, motion=MissionAction.TAKEOFF, motion_ns=7 * S, flight="armed", airborne=True, beat_ns=8 * S
    )
    broken = [why for law, why in check(observed(seen, flies, said, (), flies, RULES)) if why]
    assert any("too far" in why for why in broken) is far
