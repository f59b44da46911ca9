"""An estimator of the world that must be told to begin: it is silent until then, and does as its fault says."""

from __future__ import annotations

import pytest
from simulation_tools import Driver, S, scenario, small_settings

from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.events import CheckName, Verdict
from amaze_autonomy.engine.state import DataResult, Result, State
from amaze_autonomy.monitoring.initialisation import ROW, InitialisationSpec
from amaze_autonomy.simulation.run import run

SPEC = InitialisationSpec(service="/estimator/init_service", limit_ns=5 * S)


def driver(faults="", **changes):
    return Driver(faults, settings=small_settings(initialisation=InitialisationSpec(**{**vars(SPEC), **changes})))


def asked(world, seconds=0.0):
    """Ask for the check of the states after some seconds; return the row of the initialisation, if there is one."""
    world.go_on(seconds)
    reply = world.ask_state()
    return next(((row.verdict, row.advice, row.heals) for row in reply.checks if row.name == ROW), None), reply.ok


def test_without_a_service_nothing_is_said_of_it():
    world = Driver()
    assert asked(world, 4.0) == (None, True)


def test_it_is_silent_until_it_is_asked_by_the_check_and_valid_then():
    world = driver()
    under_way = (Verdict.UNKNOWN, "the estimator is being initialised", True)
    assert asked(world, 4.0) == (under_way, False)
    assert asked(world, 0.05) == (under_way, False)
    assert asked(world, 0.5) == ((Verdict.PASS, "", False), False)  # its first estimates are too few
    assert asked(world, 3.0) == (None, True)


REFUSED = "/estimator/init_service: the estimator refuses"
FAILURES = (
    ("refuses", 1.0, REFUSED),
    ("hangs", 6.0, "/estimator/init_service: no answer within 5 s"),
    ("lies", 6.0, "/estimator/init_service was asked, and the states did not become valid"),
)


@pytest.mark.parametrize("how, after_s, advice", FAILURES)
def test_it_fails_with_the_reason_and_is_asked_again_when_somebody_asks_again(how, after_s, advice):
    world = driver(f"fault: not_initialised, how: {how}, for_s: 20")
    asked(world, 4.0)
    assert asked(world, after_s) == ((Verdict.FAIL, advice, False), False)
    (verdict, _, _), _ = asked(world, 20.0)
    assert verdict is Verdict.UNKNOWN  # the fault is over: it is asked anew
    assert asked(world, 3.0) == (None, True)


def test_a_vehicle_that_is_armed_is_not_asked():
    world = driver("fault: pilot_arms, at_s: 1")
    assert asked(world, 4.0) == ((Verdict.FAIL, "the vehicle is armed", False), False)


def test_always_asks_in_each_pre_flight_though_the_states_are_valid():
    world = driver(always=True)
    asked(world, 4.0)
    asked(world, 3.0)
    assert asked(world) == (None, True)
    world.world.observe_state(world.world.now_ns, State.MISSION_INPUT.value)
    world.world.observe_state(world.world.now_ns, State.PREFLIGHT.value)
    (verdict, _, _), ok = asked(world)
    assert (verdict, ok) == (Verdict.UNKNOWN, False)


@pytest.mark.parametrize("how, _, advice", FAILURES)
def test_a_mission_is_not_flown_until_the_estimator_is_initialised_on_a_retry(config_folder, how, _, advice):
    overrides = ("sensors.initialisation.service=/estimator/init_service", "sensors.initialisation.limit_s=5.0")
    configuration = load_configuration(config_folder, overrides)
    story = scenario(
        f"fault: not_initialised, how: {how}, for_s: 60", "request: retry, after: {state: OUTREACH, delay_s: 60}"
    )
    flight = run(configuration, (configuration.plan("1").mission,), story)
    assert flight.results == (("1", Result.COMPLETE, DataResult.COMPLETE),)
    states = [decision.after for decision in flight.decisions if decision.after != decision.before]
    assert states[:6] == ["PREFLIGHT", "OUTREACH", "PREFLIGHT", "READY", "START_RECORDING", "LOAD_MISSION"]
    assert any(advice in line for line in flight.lines)


def test_what_is_never_initialised_is_never_flown(config_folder):
    configuration = load_configuration(config_folder, ("sensors.initialisation.service=/estimator/init_service",))
    flight = run(configuration, (configuration.plan("1").mission,), scenario("fault: not_initialised"))
    assert flight.state.state is State.OUTREACH
    rows = [row for record in flight.state.preflight.checks for row in record.rows]
    assert [row.advice for row in rows if row.name == ROW] == [REFUSED]


def test_a_check_that_is_not_the_one_of_the_states_asks_nothing():
    world = driver()
    world.go_on(4.0)
    assert world.check(CheckName.ON_GROUND).ok
    assert asked(world, 3.0)[0] == (Verdict.UNKNOWN, "the estimator is being initialised", True)
