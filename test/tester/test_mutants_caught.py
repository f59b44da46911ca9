"""A sample of the mutants of every kind of row, each with a scenario that must notice; all of them: `./run mutate`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from amaze_autonomy.tester.coverage import Hunt, Survival, mutants_of, run_hunt
from amaze_autonomy.tester.golden import golden_path, read_golden
from amaze_autonomy.tester.run import digest_of
from amaze_autonomy.tester.scenario import load_cases
from amaze_autonomy.tester.task import Task

SUITE = Path(__file__).parents[1] / "scenarios"
CAUGHT_BY = {
    "deleted row armed_before_data_is_complete": "armed_before_data_is_complete",
    "deleted row disarm_after_mission": "does_not_disarm_after_mission",
    "deleted row user_land": "user_land",
    "deleted row grounded_while_holding": "seems_landed_in_hold",
    "deleted row land_limit": "landing_takes_too_long",
    "deleted row failure_before_lift_off": "failure_before_lift_off",
    "deleted row user_hold_too": "user_holds_twice",
    "deleted row mission_resumed": "user_hold",
    "deleted row recording_proven": "interrupted_in_outreach",
    "deleted row user_ends_touchdown": "user_ends_touchdown",
    "swapped action of loss planner_status": "planner_restarted",
    "swapped action of loss battery_unknown": "autopilot_link",
    "swapped action of loss height": "height_limit",
    "swapped action of loss recorder_dead": "recorder_dies",
    "swapped routes of loss position_unknown": "demo_flight_position_unknown",
    "swapped alarm of loss recorder_dead": "recorder_dies_while_landing",
    "swapped action of severity moderate": "failure_before_lift_off",
    "swapped action of severity high": "next_takeoff_failed",
    "swapped severity of barometer": "all_moderate_fail",
    "swapped severity of realsense_camera": "lrf_during_hold",
    "swapped severity of lsm9ds1_imu": "all_moderate_fail",
    "longer wait for magnetometer": "held_and_flown_without",
    "longer wait for barometer": "all_moderate_fail",
    "longer wait for realsense_camera": "demo_flight_anew",
    "shifted limit arm_limit_ns": "does_not_arm",
    "shifted limit lift_off_limit_ns": "does_not_lift_off",
    "shifted limit land_limit_ns": "landing_takes_too_long",
    "shifted limit user_hold_limit_ns": "user_holds_too_long",
    "lowered limit takeoff_height_m": "nominal",
    "shifted limit hold_confirm_limit_ns": "hold_ignored",
    "lowered limit resume_confirm_limit_ns": "resume_unconfirmed",
    "shifted limit load_limit_ns": "planner_hangs",
    "shifted limit cancel_limit_ns": "cancel_unconfirmed",
    "shifted limit recording_lead_ns": "nominal",
    "lowered limit battery_critical_fraction": "battery_critical_in_hold",
    "shifted limit takeoff_limit_ns": "does_not_climb",
    "shifted limit land_repeat_period_ns": "land_ignored",
    "shifted limit land_second_route_after_ns": "land_ignored",
    "shifted limit recording_start_limit_ns": "recorder_does_not_grow",
    "shifted limit check_max_age_ns": "checks_expired",
    "shifted limit planner_status_limit_ns": "planner_silent",
    "shifted limit watchdog_heartbeat_limit_ns": "heartbeat_lost_in_takeoff",
}
RUN = tuple(CAUGHT_BY) if sys.version_info >= (3, 9) else tuple(CAUGHT_BY)[::6]  # the same code on both: once is enough


def test_there_is_a_mutant_of_every_kind_among_them(configuration):
    mutants = {str(mutant): mutant.kind for mutant in mutants_of(configuration.rules)}
    assert {mutants[name] for name in CAUGHT_BY} == set(mutants.values())


@pytest.mark.slow_rows
@pytest.mark.parametrize("mutant", RUN)
def test_a_mutant_is_caught(mutant):
    name = CAUGHT_BY[mutant]
    case = load_cases(SUITE / f"{name}.scenario.yaml")[0]
    task = Task(str(case.path), case.variant)
    golden = digest_of(read_golden(golden_path(case)).lines)
    assert run_hunt(Hunt(mutant, (task,), (golden,))) == Survival(mutant, case.id, 1)
