"""When an estimator is asked to initialise itself, and what the check says meanwhile."""

from __future__ import annotations

from typing import List, Sequence, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from monitoring_feed import S

from amaze_autonomy.engine.events import Check, Verdict
from amaze_autonomy.monitoring.errors import SpecError
from amaze_autonomy.monitoring.initialisation import ROW, Initialisation, InitialisationSpec

GOOD, BAD = Check("estimate age", Verdict.PASS), Check("estimate age", Verdict.FAIL, advice="silent")
SPEC = InitialisationSpec(service="/mars/init_service", limit_ns=10 * S)


def said(rows: Tuple[Check, ...]) -> List[Tuple[str, Verdict, bool]]:
    return [(row.name, row.verdict, row.heals) for row in rows]


def disarmed(spec: InitialisationSpec = SPEC) -> Initialisation:
    """Return one of a vehicle that says that it is disarmed, for as long as a test lasts."""
    initialisation = Initialisation(spec, 100 * S)
    initialisation.heard(0, armed=False)
    return initialisation


def asked(spec: InitialisationSpec = SPEC) -> Initialisation:
    """Return one whose estimator was asked at 1 s."""
    initialisation = disarmed(spec)
    rows, due = initialisation.check(1 * S, (BAD,))
    assert (due, said(rows)) == (True, [(ROW, Verdict.UNKNOWN, True), ("estimate age", Verdict.FAIL, True)])
    return initialisation


def test_without_a_service_and_with_valid_states_nothing_is_asked():
    assert disarmed(InitialisationSpec()).check(0, (BAD,)) == ((BAD,), False)
    assert disarmed().check(0, (GOOD,)) == ((GOOD,), False)


def test_it_is_asked_once_and_what_is_lacking_comes_by_itself_until_a_limit():
    initialisation = asked()
    assert not initialisation.check(2 * S, (BAD,))[1]
    initialisation.answered(3 * S)
    rows, due = initialisation.check(13 * S - 1, (BAD,))
    assert (due, said(rows)) == (False, [(ROW, Verdict.PASS, False), ("estimate age", Verdict.FAIL, True)])
    rows, due = initialisation.check(13 * S, (BAD,))
    assert (due, said(rows)) == (False, [(ROW, Verdict.FAIL, False), ("estimate age", Verdict.FAIL, False)])
    assert rows[0].advice == "/mars/init_service was asked, and the states did not become valid"


def test_states_that_became_valid_and_are_not_any_more_are_asked_for_anew():
    initialisation = Initialisation(SPEC, 2 * S)
    for begin_s in (0, 1800):
        initialisation.heard(begin_s * S, armed=False)
        rows, due = initialisation.check(begin_s * S, (BAD,))
        assert (due, said(rows)[0]) == (True, (ROW, Verdict.UNKNOWN, True))
        initialisation.answered((begin_s + 1) * S)
        assert initialisation.check((begin_s + 2) * S, (GOOD,)) == ((GOOD,), False)


def test_a_refusal_is_said_once_and_a_retry_asks_again():
    initialisation = asked()
    initialisation.answered(3 * S, "/mars/init_service: not yet")
    rows, due = initialisation.check(4 * S, (BAD,))
    assert (due, rows[0]) == (False, Check(ROW, Verdict.FAIL, advice="/mars/init_service: not yet"))
    assert initialisation.check(5 * S, (BAD,))[1]


def test_only_a_vehicle_that_says_that_it_is_disarmed_is_initialised():
    for armed, row in ((None, (ROW, Verdict.UNKNOWN, True)), (True, (ROW, Verdict.FAIL, False))):
        initialisation = Initialisation(SPEC, 2 * S)
        initialisation.heard(S, armed=armed)
        rows, due = initialisation.check(S, (BAD,))
        assert (due, said(rows)[0]) == (False, row)
    initialisation.heard(S, armed=False)
    assert said(initialisation.check(3 * S + 1, (BAD,))[0])[0] == (ROW, Verdict.UNKNOWN, True), "an old word is none"
    assert initialisation.check(3 * S, (BAD,))[1]


def test_what_begins_in_the_air_is_asked_for_at_each_takeoff_that_becomes_a_mission():
    flown = ("READY", "TAKEOFF", "MISSION", "HOLD", "MISSION", "TAKEOFF", "HOLD", "TAKEOFF", "MISSION", "LAND")
    second = InitialisationSpec(in_flight_service="/second/initialise")
    for spec, asked_at in ((second, [2, 8]), (SPEC, [])):
        initialisation = Initialisation(spec, S)
        assert [at for at, state in enumerate(flown) if initialisation.entered(state)] == asked_at


def test_a_limit_is_a_time():
    with pytest.raises(SpecError, match="limit_ns"):
        InitialisationSpec(limit_ns=0)


@given(st.lists(st.tuples(st.sampled_from(("valid", "invalid", "yes", "no")), st.none() | st.booleans()), max_size=40))
def test_it_is_never_asked_while_armed_or_twice_at_once_and_states_that_are_not_valid_never_pass(steps: list):
    initialisation, waits = Initialisation(SPEC, S), False
    for second, (what, armed) in enumerate(steps):
        if what in ("yes", "no"):
            if waits:
                initialisation.answered(second * S, "" if what == "yes" else "no")
                waits = False
            continue
        initialisation.heard(second * S, armed=armed)
        rows, due = initialisation.check(second * S, (GOOD if what == "valid" else BAD,))
        assert not due or (armed is False and not waits)
        assert all(row.passed for row in rows) == (what == "valid")
        waits = waits or due


ALWAYS = InitialisationSpec(service="/mars/init_service", always=True, limit_ns=10 * S)


def asked_at(checks: Sequence[str], spec: InitialisationSpec = ALWAYS) -> List[int]:
    """Return the places of the checks of valid states that ask; a word is a state that the engine enters."""
    initialisation, found = disarmed(spec), []
    for place, what in enumerate(checks):
        if what != "check":
            initialisation.entered(what)
        elif initialisation.check(place * S, (GOOD,))[1]:
            found.append(place)
            initialisation.answered(place * S)
    return found


def test_valid_states_are_asked_for_in_every_pre_flight_once_and_not_before_a_takeoff():
    nominal = ("MISSION_INPUT", "PREFLIGHT", "check", "check", "READY", "START_RECORDING", "LOAD_MISSION", "check")
    flown = ("TAKEOFF", "MISSION", "check", "LAND", "DATA_CLEANUP")  # the one in MISSION is after a touchdown
    assert asked_at((*nominal, *flown, "PREFLIGHT", "check", "check")) == [2, 14]
    assert asked_at(nominal, SPEC) == []
    assert asked_at(("check", "check")) == [0], "without an engine the first check alone asks"


@pytest.mark.parametrize("before", ["OUTREACH", "READY"])
def test_a_check_that_is_here_before_the_name_of_its_pre_flight_asks_all_the_same_and_once(before: str):
    assert asked_at(("check", before, "check", "PREFLIGHT", "check")) == [0, 2]


@pytest.mark.parametrize("before", ["START_RECORDING", "LOAD_MISSION"])
def test_a_takeoff_that_was_called_off_on_the_ground_begins_a_pre_flight_anew(before: str):
    assert asked_at(("check", before, "check", "PREFLIGHT", "check", "check")) == [0, 4]


def test_valid_states_wait_for_the_answer_and_for_a_no_there_is_a_retry():
    initialisation = disarmed(ALWAYS)
    assert said(initialisation.check(S, (GOOD,))[0]) == [(ROW, Verdict.UNKNOWN, True), said((GOOD,))[0]]
    assert said(initialisation.check(2 * S, (GOOD,))[0])[0] == (ROW, Verdict.UNKNOWN, True)
    initialisation.answered(3 * S, "/mars/init_service: not yet")
    rows, due = initialisation.check(4 * S, (GOOD,))
    assert (due, rows[0]) == (False, Check(ROW, Verdict.FAIL, advice="/mars/init_service: not yet"))
    assert initialisation.check(5 * S, (GOOD,))[1]
    initialisation.answered(6 * S)
    assert initialisation.check(7 * S, (GOOD,)) == ((GOOD,), False)
    assert said(initialisation.check(7 * S, (BAD,))[0])[0] == (ROW, Verdict.PASS, False), "it comes by itself"


def test_valid_states_of_a_vehicle_that_is_not_known_to_be_disarmed_wait_too():
    for armed, row in ((None, (ROW, Verdict.UNKNOWN, True)), (True, (ROW, Verdict.FAIL, False))):
        initialisation = Initialisation(ALWAYS, 100 * S)
        initialisation.heard(S, armed=armed)
        rows, due = initialisation.check(S, (GOOD,))
        assert (due, said(rows)[0]) == (False, row)
