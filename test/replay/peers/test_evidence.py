"""Did the recorded vehicle do what was commanded? Only what the recording tells counts."""

from __future__ import annotations

import pytest

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase, VehicleLanded
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.replay.peers.evidence import Evidence, Observed

S = 1_000_000_000


def followed(action, *seen, before=None):
    """Command at 10 s, then observe; return the time in seconds from which all is counterfactual."""
    evidence = Evidence(Limits())
    evidence.observe(before or Observed(9 * S))
    evidence.command(10 * S, action)
    for each in seen:
        evidence.observe(each)
    evidence.end()
    return None if evidence.counterfactual_ns is None else evidence.counterfactual_ns / S


@pytest.mark.parametrize(
    "action,seen",
    [
        (MissionAction.TAKEOFF, Observed(30 * S, landed=VehicleLanded.IN_AIR)),
        (MissionAction.TAKEOFF, Observed(30 * S, height_m=1.0)),
        (MissionAction.HOLD, Observed(12 * S, phase=MissionPhase.HOLDING)),
        (MissionAction.RESUME, Observed(12 * S, phase=MissionPhase.FLYING)),
        (MissionAction.LAND, Observed(12 * S, phase=MissionPhase.LANDING)),
        (MissionAction.LAND, Observed(12 * S, mode="AUTO.LAND")),
        (MissionAction.LAND, Observed(12 * S, landed=VehicleLanded.ON_GROUND)),
        (MissionAction.ABORT, Observed(12 * S, landed=VehicleLanded.ON_GROUND)),
    ],
)
def test_a_vehicle_that_shows_it_in_time_got_the_command(action, seen):
    assert followed(action, seen) is None


@pytest.mark.parametrize(
    "action,seen",
    [
        (MissionAction.TAKEOFF, Observed(30 * S, landed=VehicleLanded.ON_GROUND, height_m=5.0)),
        (MissionAction.TAKEOFF, Observed(30 * S, height_m=0.9)),
        (MissionAction.TAKEOFF, Observed(30 * S, landed=VehicleLanded.UNKNOWN)),
        (MissionAction.HOLD, Observed(12 * S, phase=MissionPhase.FLYING)),
        (MissionAction.LAND, Observed(12 * S, mode="AUTO.MISSION", landed=VehicleLanded.IN_AIR)),
        (MissionAction.LAND, Observed(12 * S)),
    ],
)
def test_a_vehicle_that_does_not_show_it_did_not_get_the_command(action, seen):
    assert followed(action, seen) == 10


def test_showing_it_too_late_is_not_getting_it():
    late = Observed(10 * S + Limits().hold_confirm_limit_ns, phase=MissionPhase.FLYING)
    assert followed(MissionAction.HOLD, late, Observed(20 * S, phase=MissionPhase.HOLDING)) == 10


def test_a_descent_of_half_a_metre_is_a_landing():
    before = Observed(9 * S, height_m=2.0)
    assert followed(MissionAction.LAND, Observed(12 * S, height_m=1.4), before=before) is None
    assert followed(MissionAction.LAND, Observed(12 * S, height_m=1.6), before=before) == 10


def test_of_several_commands_the_first_that_was_missed_counts():
    evidence = Evidence(Limits())
    evidence.command(10 * S, MissionAction.HOLD)
    evidence.command(11 * S, MissionAction.LAND)
    evidence.observe(Observed(30 * S))
    assert (evidence.counterfactual_ns, evidence.action) == (10 * S, MissionAction.HOLD)


def test_a_landing_that_is_repeated_is_one_command():
    evidence = Evidence(Limits())
    for half_s in range(20, 40):
        evidence.command(half_s * S // 2, MissionAction.LAND)
    evidence.observe(Observed(30 * S))
    assert evidence.counterfactual_ns == 10 * S
