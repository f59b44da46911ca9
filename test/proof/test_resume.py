"""Killed after any event of a flight and started again: its journal decided again is its state; it goes on."""

from __future__ import annotations

from typing import List, Tuple

import pytest
from proof_moves import BOOT, Node, perform
from proof_worlds import SEEDS, WORLDS

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine.commands import AutopilotDisarm, LoadMission, MissionAction, MissionCommand, StartRecording
from amaze_autonomy.engine.events import EngineStarted, Event
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, State
from amaze_autonomy.journal import journal
from amaze_autonomy.laws import Moment, Witness, judge, observed

WAYS = {
    **SEEDS,
    **{f"{name} {number}": seed for name, world in WORLDS.items() for number, seed in enumerate(world.seeds)},
}


def told(way, rules: Rules) -> Tuple[List[Event], List[EngineState]]:
    """Return every event of a way, and the state after each."""
    events, states = [], []

    def observe(moment: Moment) -> None:
        events.append(moment.event)
        states.append(moment.after)

    node = BOOT
    for move in way:
        node = perform(node, move, rules, observe)
    return events, states


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_the_journal_decided_again_is_the_state_after_every_event(way):
    rules = WORLDS["start"].rules
    events, states = told(way, rules)
    state = EngineState()
    assert len(events) == len(states) > 0
    for event, expected in zip(events, states):
        again = journal.decode(journal.encode_event(event)).payload
        state, _ = engine.decide(state, again, rules)
        assert state == expected


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_killed_after_every_event_it_resumes_and_starts_nothing_anew(way):
    rules = WORLDS["start"].rules
    states = told(way, rules)[1]
    assert states
    for number, state in enumerate(states):
        for later in (0, 1, 500_000_000, 2_000_000_000):
            event = EngineStarted(t_ns=state.t_ns + later, label="again", resumed=True)
            after, commands = engine.decide(state, event, rules)
            anew = [c for c in commands if isinstance(c, (LoadMission, StartRecording, AutopilotDisarm))]
            motions = [c.action for c in commands if isinstance(c, MissionCommand)]
            assert (number, anew) == (number, [])
            assert MissionAction.TAKEOFF not in motions
            assert MissionAction.RESUME not in motions
            if state.flight.active:
                assert after.state in (state.state, State.LAND, State.PILOT, State.HOLD)
                assert after.session.id == state.session.id


def test_a_restart_in_the_middle_of_a_moment_that_was_not_written_is_that_moment_again():
    """The last line of the journal is lost with the process: the world goes on, the engine decides on what it hears."""
    rules, way = WORLDS["start"].rules, SEEDS["cleaning"]
    events, states = told(way, rules)
    applied = {}
    for number in range(3, len(events)):
        node = _lost_the_last(events, number, rules)
        node = perform(node, ("restart",), rules, judge(applied))
        for move in (("vehicle", "flying"), ("wait",), ("wait",), ("wait",)):
            node = perform(node, move, rules, judge(applied))
        flew = states[number - 1].flight.active
        assert not flew or node.state.state in (State.TAKEOFF, State.MISSION, State.LAND, State.PILOT, State.HOLD)
    assert applied["a_restart_starts_nothing"] == len(events) - 3


def _lost_the_last(events: List[Event], number: int, rules: Rules) -> Node:
    """Return what is known when all but one of the first events were written down; the witness saw the same."""
    state, witness = EngineState(), Witness()
    for event in events[:number]:
        after, commands = engine.decide(state, event, rules)
        witness = observed(witness, state, event, commands, after, rules).seen
        state = after
    return Node(state, BOOT.peers._replace(vehicle="ground"), witness)


@pytest.mark.parametrize(
    "name, place, session",
    [
        ("next flight 0", ("MISSION", "flying"), "proof-002"),
        ("lies 1", ("HOLD", "holding"), "proof-001"),
        ("data 1", ("OUTREACH", ""), "proof-001"),
    ],
)
def test_a_long_way_leads_where_its_world_begins(name, place, session):
    """A step of it that the engine no longer follows would leave another world under the same name."""
    begun = told(WAYS[name], WORLDS["start"].rules)[1][-1]
    assert ((begun.state.value, begun.step.value), begun.session.id) == (place, session)
