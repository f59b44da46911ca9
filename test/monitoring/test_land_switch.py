"""A switch of the transmitter that means: land. Held, its transmitter still heard; asked for in flight, and again."""

from __future__ import annotations

import pytest

from amaze_autonomy.engine.events import Mission, UserCommand, UserRequest
from amaze_autonomy.engine.state import EngineState, Flight, Session, State, Step, evolve, put
from amaze_autonomy.monitoring.land_switch import LandRequests, LandSwitchMonitor, LandSwitchSpec

S, MS = 1_000_000_000, 1_000_000
ON, OFF = 1900.0, 1100.0
IN_FLIGHT = EngineState(
    state=State.MISSION, t_ns=5 * S, flight=Flight(active=True), session=Session(mission=Mission(id="1"))
)


def land(t_ns):
    return UserRequest(t_ns=t_ns, command=UserCommand.LAND, by="the transmitter's land switch")


def heard(*readings, begin_ns=0, **limits):
    """Return a switch that has heard (milliseconds, width, reports on the transmitter so far) each."""
    switch = LandSwitchMonitor(LandSwitchSpec(channel=7, **limits))
    for t_ms, width_us, reports in readings:
        switch.add(begin_ns + t_ms * MS, width_us, reports)
    return switch


@pytest.mark.parametrize("begin_ns", [0, 1_000 * S])  # a clock may have begun at any time
@pytest.mark.parametrize(
    "readings, on",
    [
        ([], None),
        ([(0, OFF, 1)], False),
        ([(0, ON, 1)], False),  # not long enough yet
        ([(0, ON, 1), (699, ON, 2)], False),
        ([(0, ON, 1), (700, ON, 1)], None),  # held, and nobody has said since that the transmitter is heard
        ([(0, ON, 1), (699, ON, 1), (900, ON, 2)], None),  # that may have been said a moment too soon
        ([(0, ON, 1), (700, ON, 1), (900, ON, 2)], True),
        ([(0, ON, 1), (700, ON, 1), (900, ON, 2), (1000, ON, 2)], True),
        ([(0, ON, 1), (700, ON, 1), (900, ON, 2), (1000, OFF, 2)], False),
        ([(0, ON, 1), (700, ON, 1), (900, ON, 2), (1000, OFF, 2), (1100, ON, 2), (1800, ON, 2)], None),
        ([(0, ON, 1), (700, ON, 1), (900, None, 2)], None),  # not heard by that report, or no pulse: no reading
        ([(0, ON, 1), (200, OFF, 1), (400, ON, 2), (1000, ON, 3)], False),  # a single reading begins anew
        ([(0, ON, 1), (700, 1700.0, 1), (900, 1700.0, 2)], False),  # not above
        ([(0, ON, 1), (700, ON, 1), (1701, ON, 3)], False),  # nothing is known of the time between
    ],
)
def test_it_is_on_when_it_was_held_and_its_transmitter_is_still_heard(readings, on, begin_ns):
    last_ms = readings[-1][0] if readings else 0
    assert heard(*readings, begin_ns=begin_ns).on(begin_ns + last_ms * MS) is on


def test_what_is_old_says_nothing():
    switch = heard((0, ON, 1), (700, ON, 1), (900, ON, 2))
    assert switch.on(1900 * MS) is True
    assert switch.on(1901 * MS) is None


def test_time_alone_does_not_hold_it():
    assert heard((0, ON, 1)).on(900 * MS) is False


def test_it_asks_for_a_landing_in_flight_and_again_while_it_is_held():
    assert LandRequests(frozenset()).answer(IN_FLIGHT, 0, on=True) == land(0)
    requests = LandRequests(frozenset())
    assert requests.answer(IN_FLIGHT, 5 * S, on=False) is None
    assert requests.answer(IN_FLIGHT, 5 * S, on=True) == land(5 * S)
    assert requests.answer(IN_FLIGHT, 6 * S - 1, on=True) is None
    assert requests.answer(IN_FLIGHT, 6 * S, on=True) == land(6 * S)


@pytest.mark.parametrize("state", [State.TAKEOFF, State.MISSION, State.HOLD])
def test_it_counts_in_every_part_of_a_flight(state):
    assert LandRequests(frozenset()).answer(evolve(IN_FLIGHT, state=state), 5 * S, on=True) == land(5 * S)


FLIGHT, BEFORE = (State.TAKEOFF, State.MISSION, State.HOLD), (State.START_RECORDING, State.LOAD_MISSION)


@pytest.mark.parametrize("state", BEFORE)
def test_behind_the_go_it_calls_the_takeoff_off(state):
    before = put(evolve(IN_FLIGHT, state=state), "flight.active", False)
    asked = UserRequest(t_ns=5 * S, command=UserCommand.LAND, by="the transmitter's land switch")
    assert LandRequests(frozenset()).answer(before, 5 * S, on=True) == asked
    assert LandRequests(frozenset({"1"})).answer(before, 5 * S, on=True) is None


def test_between_two_files_it_ends_the_mission():
    between = evolve(put(IN_FLIGHT, "flight.active", False), step=Step.TOUCHDOWN)
    assert LandRequests(frozenset()).answer(between, 5 * S, on=True) == land(5 * S)


@pytest.mark.parametrize("state", [each for each in State if each not in (*FLIGHT, *BEFORE)])
def test_it_asks_for_nothing_elsewhere(state):
    assert LandRequests(frozenset()).answer(evolve(IN_FLIGHT, state=state), 5 * S, on=True) is None


def test_it_asks_for_nothing_of_what_seems_to_have_landed_nor_in_a_mission_without_it():
    assert LandRequests(frozenset()).answer(put(IN_FLIGHT, "flight.active", False), 5 * S, on=True) is None
    assert LandRequests(frozenset({"1"})).answer(IN_FLIGHT, 5 * S, on=True) is None
