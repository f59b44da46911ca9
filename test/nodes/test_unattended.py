"""Nobody is there: what is answered in a user's place, and when."""

from __future__ import annotations

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.engine.events import AutopilotStatus, UserCommand, VehicleLanded
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import Agreement, EngineState, Flight, Peers, State, evolve, put
from amaze_autonomy.nodes.autonomy.users import Unattended

S = 1_000_000_000
DOWN = AutopilotStatus(t_ns=5 * S, armed=False, landed=VehicleLanded.ON_GROUND, link_age_s=0.0)
AGREED = Agreement(4 * S, 5 * S, 2)
FLYING = evolve(DOWN, armed=True, landed=VehicleLanded.IN_AIR)
HEARD = Peers(autopilot=FLYING, autopilot_ns=5 * S)
PILOT = EngineState(state=State.PILOT, t_ns=5 * S, flight=Flight(active=True), peers=HEARD)


def test_a_pilots_landing_is_acknowledged_once_the_flight_is_over():
    desk = Unattended(Rules())
    assert desk.answer(PILOT) is None
    assert desk.answer(put(PILOT, "peers.autopilot", DOWN)) is None, "one status does not end a flight"
    over = put(put(PILOT, "peers.autopilot", DOWN), "flight.active", False)
    assert desk.answer(over) is None, "nor what flies, and was never a flight of ours"
    assert desk.answer(put(over, "vehicle.down", AGREED)) is UserCommand.ACKNOWLEDGE


def test_a_pilot_who_has_armed_on_the_ground_is_waited_for():
    desk = Unattended(Rules())
    armed = put(put(PILOT, "peers.autopilot", evolve(DOWN, armed=True)), "flight.active", False)
    assert desk.answer(armed) is None
    assert desk.answer(put(put(armed, "peers.autopilot", DOWN), "vehicle.down", AGREED)) is UserCommand.ACKNOWLEDGE


def test_where_a_person_is_wanted_it_gives_up():
    assert Unattended(Rules()).answer(EngineState(state=State.OUTREACH, t_ns=S)) is UserCommand.GIVE_UP


def test_it_asks_once_and_again_after_a_second():
    desk, outreach = Unattended(Rules()), EngineState(state=State.OUTREACH, t_ns=S)
    asked = [desk.answer(evolve(outreach, t_ns=S + step * S // 4)) for step in range(9)]
    assert [step for step, command in enumerate(asked) if command is not None] == [0, 4, 8]


def test_each_state_is_answered_at_once():
    desk = Unattended(Rules())
    outreach = EngineState(state=State.OUTREACH, t_ns=S)
    assert desk.answer(outreach) is UserCommand.GIVE_UP
    assert desk.answer(EngineState(state=State.MISSION_INPUT, t_ns=S)) is None
    assert desk.answer(outreach) is UserCommand.GIVE_UP


@pytest.mark.parametrize("state", [each for each in State if each not in (State.OUTREACH, State.PILOT)])
def test_elsewhere_nothing_is_answered(state):
    heard = Peers(autopilot=DOWN, autopilot_ns=S)
    assert Unattended(Rules()).answer(EngineState(state=state, t_ns=S, peers=heard)) is None
