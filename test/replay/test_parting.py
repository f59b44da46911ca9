"""Where a replay parts from its flight."""

from __future__ import annotations

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.replay.session import Parting, part

S = 1_000_000_000


def decision(t_s, rule, before="MISSION", after="MISSION"):
    return Decision(t_ns=round(t_s * S), sequence=0, event="Tick", before=before, after=after, step="", rule=rule)


FLIGHT = (decision(1, "takeoff"), decision(2, "hold"), decision(9, "land"))


def test_a_replay_that_decides_as_the_flight_does_not_part_whatever_the_times():
    replay = (decision(1.2, "takeoff"), decision(2.1, "hold"), decision(8.5, "land"))
    assert part(FLIGHT, replay, 10 * S) is None


def test_another_rule_is_a_parting_at_the_earlier_time():
    replay = (decision(1, "takeoff"), decision(3, "land"))
    assert part(FLIGHT, replay, 10 * S) == Parting(1, FLIGHT[1], replay[1], 2 * S)


def test_a_decision_that_is_missing_is_a_parting_unless_it_is_at_the_end():
    assert part(FLIGHT, FLIGHT[:2], 10 * S) == Parting(2, FLIGHT[2], None, 9 * S)
    assert part(FLIGHT[:2], FLIGHT, 10 * S) == Parting(2, None, FLIGHT[2], 9 * S)
    assert part(FLIGHT, FLIGHT[:2], 9 * S) is None
    assert part(FLIGHT[:2], FLIGHT, 9 * S) is None
