"""Two things fail: the worst wins, each wait has its own limit, a landing goes on, flapping spends its budget."""

from __future__ import annotations

import pytest
from engine_beginnings import at
from engine_peers import S

LAND_EARLY = "LANDED_EARLY"


# --- a second failure during a hold -----------------------------------------------------------------------------------


def test_second_one_worse_lands_at_once():
    story = at("MISSION flying")
    story.fail("realsense_camera", 4).until("HOLD", "holding")
    story.look().fail("mission_camera", 16)
    assert (story.place[0], story.motions) == ("LAND", ["LAND"])
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == LAND_EARLY


def test_second_one_milder_changes_nothing():
    story = at("MISSION flying")
    story.fail("lrf", 8).until("HOLD", "holding")
    story.look().fail("gps", 2).after(1.0).expect("HOLD", "holding")
    assert story.motions == []
    story.back("lrf").until("MISSION", "flying")


def test_the_same_one_gets_worse():
    story = at("MISSION flying")
    story.fail("lrf", 8, "trying").until("HOLD", "holding")
    story.look().fail("lrf", 16, "given_up")
    assert (story.place[0], story.motions) == ("LAND", ["LAND"])


def test_the_same_one_gets_milder_and_the_mission_goes_on():
    story = at("MISSION flying")
    story.fail("lrf", 8).until("HOLD", "holding")
    story.look().fail("lrf", 2)
    story.until("MISSION", "flying")
    assert story.motions == ["RESUME"]
    assert story.failure("lrf").action.name == "CONTINUE"


def test_the_same_failure_told_twice_does_not_begin_its_wait_anew():
    story = at("MISSION flying")
    story.fail("lrf", 8)
    story.after(4.0).fail("lrf", 8, "trying")
    story.after_ns(S - 1).expect("HOLD")
    story.after_ns(1).expect("LAND")


def test_a_second_hold_is_not_sent_while_it_holds():
    story = at("MISSION flying")
    story.fail("lrf", 8).until("HOLD", "holding")
    story.fail("realsense_camera", 4).after(1.0)
    assert story.motions == ["HOLD"]


def test_both_must_come_back():
    story = at("MISSION flying")
    story.fail("lrf", 8).fail("realsense_camera", 4).until("HOLD", "holding")
    story.back("lrf").after(1.0).expect("HOLD", "holding")
    story.back("realsense_camera").until("MISSION", "flying")
    assert story.motions == ["HOLD", "RESUME"]


def test_continue_drops_only_its_own_item():
    """The magnetometer's 6 s end; the LSM9DS1's 9 s go on."""
    story = at("MISSION flying")
    story.fail("magnetometer", 4).fail("lsm9ds1_imu", 4)
    story.after(6.5).expect("HOLD", "holding")
    assert story.failure("magnetometer").action.name == "CONTINUE"
    assert story.failure("lsm9ds1_imu").action.name == "WAIT"
    story.back("lsm9ds1_imu").until("MISSION", "flying")


def test_the_worst_second_verb_wins():
    """The LRF's 5 s end in a landing while the camera would still have 3 s to come back."""
    story = at("MISSION flying")
    story.fail("realsense_camera", 4).fail("lrf", 8)
    story.after_ns(5 * S - 1).expect("HOLD")
    story.after_ns(1).expect("LAND")


def test_limits_run_per_item():
    story = at("MISSION flying")
    story.fail("lrf", 8).after(2.0).back("lrf")
    story.fail("realsense_camera", 4)
    story.after(7.9).expect("HOLD", "holding")
    story.after(0.2).expect("HOLD", "resuming")


# --- while resuming, while landing ------------------------------------------------------------------------------------


def test_while_resuming_a_hold_is_asked_for_again():
    story = at("HOLD resuming")
    story.fail("lrf", 8).expect("HOLD", "confirming")
    assert story.motions == ["HOLD"]
    story.disobeyed.remove("RESUME")
    story.until("HOLD", "holding").back("lrf").until("MISSION", "flying")
    assert story.motions == ["HOLD", "RESUME"]


def test_the_planners_hold_from_before_does_not_confirm_the_second_one():
    """The planner said HOLDING at the very moment of the second HOLD: that was about the first."""
    story = at("HOLD resuming")
    story.report()
    story.disobeyed.append("HOLD")
    story.fail("lrf", 8).expect("HOLD", "confirming")


def test_while_resuming_a_milder_one_changes_nothing():
    story = at("HOLD resuming")
    story.fail("gps", 2).expect("HOLD", "resuming")
    assert story.motions == []


def test_while_resuming_a_worse_one_lands():
    story = at("HOLD resuming")
    story.fail("imu", 16).expect("LAND")
    assert story.motions == ["LAND"]


@pytest.mark.parametrize("name, code", [("gps", 2), ("lrf", 8), ("realsense_camera", 4), ("imu", 16)])
def test_a_landing_goes_on_whatever_fails_and_comes_back(name, code):
    story = at("LAND descending")
    story.fail(name, code).after(0.5).back(name).until("MISSION_ENDED")
    assert story.motions == []


def test_the_first_one_comes_back_during_the_landing_of_the_second():
    story = at("MISSION flying")
    story.fail("lrf", 8).until("HOLD", "holding")
    story.fail("imu", 16).back("lrf").back("imu").expect("LAND")
    story.until("MISSION_ENDED")
    assert story.motions == ["HOLD", "LAND"]
    assert story.state.session.result.value == LAND_EARLY


def test_a_failure_during_the_landing_is_never_waited_for():
    story = at("LAND descending")
    story.fail("lrf", 8)
    assert story.failure("lrf").action.name == "LAND"
    assert story.failure("lrf").deadline_ns is None


def test_two_fail_at_once_in_one_message():
    story = at("MISSION flying")
    story.fail("realsense_camera", 4, tell=False).fail("imu", 16, tell=False).tell()
    assert (story.place[0], story.motions) == ("LAND", ["LAND"])


def test_a_component_fails_in_the_moment_of_the_users_hold():
    story = at("HOLD holding")
    story.fail("lrf", 8).after(1.0)
    assert story.user("resume") == ("REFUSED", "A component is waited for.")
    story.back("lrf").after(1.0).expect("HOLD", "holding")
    assert story.user("resume")[0] == "DONE"
    story.until("MISSION", "flying")


def test_the_users_hold_remains_when_a_moderate_one_is_given_up():
    story = at("HOLD holding")
    story.fail("realsense_camera", 4).after(8.5).expect("HOLD", "holding")
    assert story.failure("realsense_camera").action.name == "CONTINUE"
    assert story.motions == []


# --- budgets ----------------------------------------------------------------------------------------------------------


def test_flapping_spends_the_budget_of_a_flight():
    """2 s, 2 s, and then only 1 s of the LRF's 5 s is left."""
    story = at("MISSION flying")
    for _ in range(2):
        story.fail("lrf", 8)
        story.after(2.0).back("lrf").until("MISSION", "flying")
    story.look().fail("lrf", 8)
    story.after_ns(S - 1).expect("HOLD")
    story.after_ns(1).expect("LAND")


def test_a_spent_budget_lands_at_once():
    story = at("MISSION flying")
    story.fail("lrf", 8).after_ns(5 * S - 1).back("lrf").until("MISSION", "flying")
    story.look().fail("lrf", 8)
    story.after_ns(1).expect("LAND")


def test_flapping_of_a_moderate_one_ends_in_flying_without_it():
    story = at("MISSION flying")
    story.planner.flown_ns = -60 * S
    for _ in range(20):
        story.fail("realsense_camera", 4).after(1.0).back("realsense_camera").after(1.0)
    assert story.motions.count("HOLD") <= 9
    story.look().fail("realsense_camera", 4).expect("MISSION", "flying")
    assert story.motions == []


def test_flown_without_does_not_hold_again():
    story = at("MISSION flying")
    story.planner.flown_ns = -60 * S
    story.fail("realsense_camera", 4).after(8.0).until("MISSION", "flying")
    story.look().back("realsense_camera").after(1.0).fail("realsense_camera", 4).after(1.0).expect("MISSION", "flying")
    assert story.motions == []


def test_flown_without_still_lands_at_16():
    story = at("MISSION flying")
    story.planner.flown_ns = -60 * S
    story.fail("realsense_camera", 4).after(8.0).until("MISSION", "flying")
    story.look().fail("realsense_camera", 16).expect("LAND")


def test_budgets_are_per_component():
    story = at("MISSION flying")
    story.fail("magnetometer", 4).after(5.9).back("magnetometer").until("MISSION", "flying")
    story.fail("barometer", 4).after(6.9).expect("HOLD", "holding")


def test_the_next_flight_has_fresh_budgets():
    story = at("MISSION flying")
    story.fail("lrf", 8).after(4.0).back("lrf").until("MISSION_ENDED")
    story.select().until("MISSION", "flying").fail("lrf", 8).after(4.9).expect("HOLD", "holding")


def test_the_budget_is_spent_over_takeoff_and_mission_alike():
    story = at("TAKEOFF climbing")
    story.fail("lrf", 8).after(3.0).back("lrf").until("MISSION", "flying")
    story.fail("lrf", 8).after_ns(2 * S - 1).expect("HOLD")
    story.after_ns(1).expect("LAND")


def test_a_wait_that_ends_by_being_dropped_is_told():
    story = at("MISSION flying")
    story.fail("realsense_camera", 4).after(8.0)
    assert story.told == ["hold", "flown_without", "resuming"]


def test_an_unlisted_component_waits_for_the_configured_time():
    story = at("MISSION flying")
    story.fail("nobodys_camera", 8).after_ns(15 * S - 1).expect("HOLD")
    story.after_ns(1).expect("LAND")
