"""A few flights whose links are cut and that must land at any moment; two hundred: ./run soak-cuts."""

from __future__ import annotations

import pytest
from cut_flights import CutFlights
from soak import S

from amaze_autonomy.autopilot.vehicle.client import set_mode
from amaze_autonomy.engine.events import WatchdogAction
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.engine.state import State

pytestmark = pytest.mark.long


def test_nothing_commands_against_a_landing_and_no_landing_is_late():
    flights = CutFlights(seed=2)
    flown = [flights.fly_once(number) for number in range(6)]
    assert [each.problems for each in flown] == [[]] * 6
    assert sum(each.delay_ns is not None for each in flown) > 0, "no flight had to land while it was commanded"
    assert sum(each.cuts for each in flown) > 6


@pytest.mark.night
def test_it_sees_a_node_that_goes_on_after_a_landing_was_commanded():
    flights = CutFlights(seed=2)
    wake = flights.planner.wake

    def repeats_its_mission(t_ns):
        mission = set_mode(1, 1, *flights.planner.watch.numbers("AUTO.MISSION"))
        return [*wake(t_ns), *([mission] if flights.state.state is State.LAND else [])]

    flights.planner.wake = repeats_its_mission
    said = [problem for number in range(4) for problem in flights.fly_once(number).problems]
    assert any(problem.startswith("planner sends command") and problem.endswith("after LAND") for problem in said)


@pytest.mark.night
def test_it_sees_a_landing_that_leaves_late():
    flights, failed_ns = CutFlights(seed=2), []
    decide = flights._decide

    def half_a_second_late(event):
        if isinstance(event, WatchdogAction) and event.code is Code.ABORT:
            failed_ns.append(event.t_ns)
            if event.t_ns - failed_ns[0] < S // 2:
                return
        decide(event)

    flights._decide = half_a_second_late
    said = [problem for number in range(12) for problem in flights.fly_once(number).problems]
    assert any(problem.startswith("LAND left 0.") for problem in said)
