"""Commands as steps: what is sent, when it counts as done, when it is given up and when it is left to others."""

from __future__ import annotations

from itertools import product

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.planner.mission_upload import Dialect
from amaze_autonomy.autopilot.planner.mission_vehicle import VehicleWatch
from amaze_autonomy.autopilot.planner.procedure import Means, Procedure, Progress, steps_of
from amaze_autonomy.autopilot.vehicle.modes import is_foreign
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.missions import Controller, PlannerSpec

S, MS = 1_000_000_000, 1_000_000
A = MissionAction
PX4_MODES = {"AUTO.LOITER": (4, 3), "AUTO.MISSION": (4, 4), "AUTO.LAND": (4, 6), "OFFBOARD": (6, 0), "POSCTL": (3, 0)}
PX4_MODES["AUTO.RTL"] = (4, 5)
COPTER = {"AUTO.MISSION": 3, "OFFBOARD": 4, "AUTO.LAND": 9, "AUTO.LOITER": 17}
SET_MODE, ARM, START = 176, 400, 300


class Story:
    """A watch that is told heartbeats, and one procedure on it."""

    def __init__(self, action, controller=Controller.MISSION, *, copter=False, mode="", **means):
        self.watch, self.t_ns, self.copter = VehicleWatch(), 0, copter
        self.means = Means(self.watch, S, **{"verified": True, "lifted": action is A.RESUME, **means})
        self.beat(mode or ("AUTO.LOITER" if not copter else "OFFBOARD"))
        persistent = action in (A.LAND, A.ABORT)
        steps = steps_of(controller, action, self.watch.dialect)
        self.procedure = Procedure(action, steps, self.means, PlannerSpec(), 0, persistent=persistent)

    def beat(self, mode, *, armed=False, status=mavlink.MAV_STATE_ACTIVE):
        self.t_ns += MS
        main, sub = PX4_MODES[mode] if not self.copter else (0, 0)
        number = COPTER[mode] if self.copter else main << 16 | sub << 24
        autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA if self.copter else mavlink.MAV_AUTOPILOT_PX4
        base = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        message = mavlink.MAVLink_heartbeat_message(2, autopilot, base, number, status, 3)
        message._header.srcSystem, message._header.srcComponent = 1, 1
        self.watch.take(self.t_ns, message)

    def stand(self, above_home_m=0.0, landed=mavlink.MAV_LANDED_STATE_ON_GROUND):
        """Be on the ground, and say how far above home that is."""
        self.t_ns += MS
        self.watch.take(self.t_ns, mavlink.MAVLink_extended_sys_state_message(0, landed))
        height_mm = round(1000 * above_home_m)
        self.watch.take(self.t_ns, mavlink.MAVLink_global_position_int_message(0, 1, 1, 0, height_mm, 0, 0, 0, 0))

    def at(self, item):
        """Say at which item of its mission it is, which the planner looks at; return what is sent."""
        self.t_ns += MS
        self.watch.take(self.t_ns, mavlink.MAVLink_mission_current_message(item))
        return self.after(0)

    def after(self, ms):
        """Let time pass; return (command, first three parameters) of what is sent."""
        self.t_ns += ms * MS
        return [_short(message) for message in self.procedure.wake(self.t_ns)]


def _short(message):
    if message.get_type() != "COMMAND_LONG":
        return message.get_type(), message.seq
    assert (message.target_system, message.target_component) == (1, 1)
    return message.command, message.param1, message.param2, message.param3


def test_a_takeoff_changes_the_mode_arms_and_begins_the_mission_each_when_the_one_before_shows():
    story = Story(A.TAKEOFF)
    assert story.after(0) == [(SET_MODE, 1.0, 4.0, 3.0)]
    assert story.after(100) == []  # the heartbeat is older than the command, whatever it says
    story.beat("AUTO.LOITER")
    assert story.after(100) == [(ARM, 1.0, 0.0, 0.0)]
    story.beat("AUTO.LOITER", armed=True)
    story.stand()
    assert story.after(100) == [(SET_MODE, 1.0, 4.0, 4.0)]
    story.beat("AUTO.MISSION", armed=True)
    assert (story.after(100), story.procedure.progress) == ([], Progress.DONE)


def test_no_mission_is_entered_before_a_height_above_home_came_after_the_arming():
    """Home is set anew by the arming; what came before it says nothing."""
    story = Story(A.TAKEOFF)
    story.after(0)
    story.beat("AUTO.LOITER")
    assert story.after(100) == [(ARM, 1.0, 0.0, 0.0)]
    story.stand()
    story.beat("AUTO.LOITER", armed=True)
    assert story.after(100) == []
    story.stand(above_home_m=6.0)  # may be as old
    assert story.after(100) == []
    story.stand(above_home_m=-0.9, landed=mavlink.MAV_LANDED_STATE_IN_AIR)
    assert story.after(100) == []
    story.stand(above_home_m=-0.9)
    assert story.after(100) == [(SET_MODE, 1.0, 4.0, 4.0)]


@pytest.mark.parametrize(
    "above_home_m, reason",
    [
        (6.0, "home is 6.0 m below where it stands: set home here"),
        (-1.1, "home is 1.1 m above where it stands: set home here"),
        (None, "no height above home has come since it was armed"),
    ],
)
def test_a_home_at_another_height_than_where_it_stands_ends_the_takeoff(above_home_m, reason):
    story = Story(A.TAKEOFF)
    story.after(0)
    story.beat("AUTO.LOITER")
    story.after(100)
    sent = []
    for _ in range(45):
        story.beat("AUTO.LOITER", armed=True)
        if above_home_m is not None:
            story.stand(above_home_m)
        sent += story.after(100)
    assert (sent, story.procedure.progress, story.procedure.reason) == ([], Progress.FAILED, reason)


def test_a_hold_before_lift_off_does_not_go_round_the_look_at_home():
    story = Story(A.RESUME, lifted=False)
    story.beat("AUTO.LOITER", armed=True)
    story.stand(above_home_m=6.0)
    assert story.after(100) == []
    story.stand(above_home_m=6.0, landed=mavlink.MAV_LANDED_STATE_TAKEOFF)
    assert story.after(100) == [(SET_MODE, 1.0, 4.0, 4.0)]


def test_ardupilot_arms_in_guided_and_is_told_to_start():
    story = Story(A.TAKEOFF, copter=True)
    assert story.after(0) == [(SET_MODE, 1.0, 4.0, 0.0)]
    story.beat("OFFBOARD")
    assert story.after(100) == [(ARM, 1.0, 0.0, 0.0)]
    story.beat("OFFBOARD", armed=True)
    story.stand()
    assert story.after(100) == [(SET_MODE, 1.0, 3.0, 0.0)]
    story.beat("AUTO.MISSION", armed=True)
    assert story.after(100) == [(START, 0.0, 0.0, 0.0)]
    story.watch.take(story.t_ns, mavlink.MAVLink_mission_current_message(1))  # at once, also while it waits
    assert story.after(500) == [(START, 0.0, 0.0, 0.0)]
    climbs = mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_TAKEOFF)
    story.watch.take(story.t_ns, climbs)
    assert (story.after(300), story.procedure.progress) == ([], Progress.RUNNING)  # one message may be wrong
    story.watch.take(story.t_ns, climbs)
    assert (story.after(300), story.procedure.progress) == ([], Progress.DONE)


def test_an_accepted_start_ends_its_repetition_but_that_of_the_flight_before_does_not():
    story = Story(A.TAKEOFF, copter=True)
    story.watch.take(0, mavlink.MAVLink_command_ack_message(START, 0))
    for mode, armed in (("OFFBOARD", False), ("OFFBOARD", True), ("AUTO.MISSION", True)):
        story.after(100)
        story.beat(mode, armed=armed)
        story.stand()
    assert story.after(100) == [(START, 0.0, 0.0, 0.0)]
    story.watch.take(story.t_ns, mavlink.MAVLink_command_ack_message(START, 0))
    assert (story.after(100), story.procedure.progress) == ([], Progress.DONE)


def test_what_does_not_show_is_sent_again_and_given_up_at_the_limit_with_the_reason():
    story = Story(A.HOLD)
    story.beat("AUTO.MISSION", armed=True)
    sent = []
    for _ in range(45):
        story.beat("AUTO.MISSION", armed=True)
        sent += story.after(100)
    assert sent == [(SET_MODE, 1.0, 4.0, 3.0)] * 8
    assert story.procedure.progress is Progress.FAILED
    assert story.procedure.reason == "change to AUTO.LOITER: not shown within 4 s (mode AUTO.MISSION, armed)"


def test_a_landing_is_never_given_up():
    story = Story(A.LAND)
    sent = []
    for _ in range(200):
        story.beat("AUTO.MISSION", armed=True)
        sent += story.after(100)
    assert len(sent) == 40
    assert story.procedure.running
    story.beat("AUTO.LAND", armed=True)
    assert (story.after(400), story.procedure.progress) == ([], Progress.RUNNING)  # one message may be wrong
    story.beat("AUTO.LAND", armed=True)
    assert (story.after(100), story.procedure.progress, story.procedure.reason) == ([], Progress.DONE, "")


def test_a_landing_that_one_message_showed_is_sent_again_when_the_next_one_does_not():
    story = Story(A.LAND, mode="AUTO.MISSION")
    assert story.after(0) == [(SET_MODE, 1.0, 4.0, 6.0)]
    story.beat("AUTO.LAND", armed=True)
    assert story.after(900) == []
    story.beat("AUTO.MISSION", armed=True)
    assert story.after(100) == [(SET_MODE, 1.0, 4.0, 6.0)]


@pytest.mark.parametrize("action", [A.TAKEOFF, A.HOLD, A.RESUME])
def test_a_silence_of_the_vehicle_ends_what_is_under_way_and_it_is_not_taken_up_again(action):
    story = Story(action)
    for _ in range(30):
        story.after(100)
    assert story.procedure.running
    assert story.after(100) == []
    story.beat("AUTO.LOITER")
    assert (story.after(600), story.procedure.progress) == ([], Progress.SILENT)
    assert story.procedure.reason == f"{action.name.lower()} ended: the vehicle was silent for 3 s"


def test_a_landing_goes_on_through_a_silence():
    story = Story(A.LAND, mode="AUTO.MISSION")
    sent = [story.after(500) for _ in range(40)]
    assert sent == [[(SET_MODE, 1.0, 4.0, 6.0)]] * 40
    story.beat("AUTO.LAND", armed=True)
    story.after(400)
    story.beat("AUTO.LAND", armed=True)
    assert (story.after(100), story.procedure.progress) == ([], Progress.DONE)


def test_in_a_silence_a_pilot_who_was_flying_is_not_commanded_and_keeps_what_he_is_seen_to_have():
    story = Story(A.LAND, mode="POSCTL")
    story.beat("POSCTL", armed=True)
    sent = []
    for _ in range(50):
        story.beat("POSCTL", armed=True)
        sent += story.after(100)
    assert (sent, story.procedure.progress) == ([], Progress.TAKEN)
    silent = Story(A.LAND, mode="POSCTL")
    silent.beat("POSCTL", armed=True)
    silent.t_ns += 4 * S
    assert (silent.after(0), silent.procedure.running) == ([], True)
    silent.beat("AUTO.LOITER", armed=True)
    assert silent.after(100) == [(SET_MODE, 1.0, 4.0, 6.0)]


@pytest.mark.parametrize("action", [A.HOLD, A.RESUME])
def test_a_vehicle_that_somebody_lands_is_neither_held_nor_resumed(action):
    story = Story(action, mode="AUTO.MISSION" if action is A.HOLD else "AUTO.LOITER")
    story.after(0)
    story.beat("AUTO.LAND", armed=True)
    assert (story.after(600), story.procedure.progress) == ([], Progress.RUNNING)  # one message may be wrong
    story.beat("AUTO.LAND", armed=True)
    assert (story.after(600), story.procedure.progress) == ([], Progress.TAKEN)
    assert story.procedure.reason == f"{action.name.lower()} ended: the vehicle lands (mode AUTO.LAND)"


def test_a_takeoff_does_not_arm_before_the_mission_was_read_back():
    story = Story(A.TAKEOFF, verified=False)
    for _ in range(70):
        story.beat("AUTO.LOITER")
        assert story.after(100) == []
    assert story.procedure.running  # reading back has a limit of its own
    story.means.verified = True
    assert story.after(100) == [(SET_MODE, 1.0, 4.0, 3.0)]


def test_a_critical_battery_in_a_mode_of_ours_does_not_end_a_landing():
    """ArduPilot at low battery with BATT_FS_LOW_ACT 0 is CRITICAL, and does nothing by itself."""
    story = Story(A.LAND, mode="AUTO.MISSION")
    story.means.commanded.add("AUTO.LOITER")
    story.beat("AUTO.LOITER", armed=True, status=mavlink.MAV_STATE_CRITICAL)
    assert story.after(0) == [(SET_MODE, 1.0, 4.0, 6.0)]
    for progress in (Progress.RUNNING, Progress.TAKEN):
        story.beat("AUTO.RTL", armed=True, status=mavlink.MAV_STATE_CRITICAL)
        assert (story.after(600), story.procedure.progress) == ([], progress)


def test_nothing_disarms_without_a_fresh_ground():
    story = Story(A.ABORT)
    for _ in range(20):
        story.beat("AUTO.LOITER", armed=True)
        assert story.after(100) == []
    story.means.grounded = True
    assert story.after(100) == [(ARM, 0.0, 0.0, 0.0)]


@pytest.mark.parametrize("mode, status", [("POSCTL", 4), ("POSCTL", 5), ("AUTO.LAND", 5)])
def test_a_mode_that_nobody_of_us_wanted_ends_it(mode, status):
    story = Story(A.RESUME, resume_item=None)
    assert story.after(0) == [(SET_MODE, 1.0, 4.0, 4.0)]
    for progress in (Progress.RUNNING, Progress.TAKEN):
        story.beat(mode, armed=True, status=status)
        assert (story.after(600), story.procedure.progress) == ([], progress)
    story.beat("AUTO.LOITER", armed=True)
    assert story.after(600) == []


def test_a_mode_that_one_message_showed_ends_nothing():
    story = Story(A.RESUME, resume_item=None)
    assert story.after(0) == [(SET_MODE, 1.0, 4.0, 4.0)]
    story.beat("POSCTL", armed=True)
    assert story.after(900) == []
    story.beat("AUTO.LOITER", armed=True)
    assert story.after(0) == [(SET_MODE, 1.0, 4.0, 4.0)]


def test_a_resume_goes_back_to_its_item_when_the_autopilot_has_forgotten_it():
    story = Story(A.RESUME, resume_item=3)
    story.watch.take(0, mavlink.MAVLink_mission_current_message(0))
    assert story.after(0) == [("MISSION_SET_CURRENT", 3)]
    story.watch.take(0, mavlink.MAVLink_mission_current_message(3))
    assert story.after(100) == [(SET_MODE, 1.0, 4.0, 4.0)]


def resume_of_an_ardupilot(said=5):
    """Return one of a mission that was held on its way to the waypoint behind a turn; it says at which item it is."""
    story = Story(A.RESUME, copter=True, mode="AUTO.LOITER", resume_item=5)
    assert story.at(said) == [("MISSION_SET_CURRENT", 4)]
    return story


def test_a_resume_of_an_ardupilot_goes_back_to_the_turn_before_its_item_wherever_it_is():
    story = resume_of_an_ardupilot()
    assert story.after(100) == []
    story.beat("AUTO.LOITER")
    assert story.after(100) == []
    assert story.at(4) == [(SET_MODE, 1.0, 3.0, 0.0)]
    assert story.at(5) == []  # where it is from then on


def test_an_ardupilot_that_says_what_it_said_before_is_sent_back_to_the_turn_again():
    story = resume_of_an_ardupilot()
    for _ in range(4):
        story.beat("AUTO.LOITER")
        assert story.at(5) == story.after(100) == []
    assert story.after(100) == [("MISSION_SET_CURRENT", 4)]
    assert story.at(4) == [(SET_MODE, 1.0, 3.0, 0.0)]
    assert story.procedure.reason == ""


def test_a_mission_of_an_ardupilot_goes_on_after_a_while_without_the_heading_of_its_waypoint_and_says_so():
    story, sent = resume_of_an_ardupilot(), []
    for _ in range(10):
        story.beat("AUTO.LOITER")
        sent += story.at(5) + story.after(99)
    assert sent == [("MISSION_SET_CURRENT", 4), (SET_MODE, 1.0, 3.0, 0.0)]
    story.beat("AUTO.MISSION", armed=True)
    story.watch.results[START] = "MAV_RESULT_ACCEPTED"
    story.after(100)
    story.watch.results[START] = "MAV_RESULT_ACCEPTED"
    story.after(100)
    reason = "it goes on without the heading of its waypoint"
    assert (story.procedure.progress, story.procedure.reason) == (Progress.DONE, reason)


@pytest.mark.parametrize("said", [1, 7])
def test_an_ardupilot_that_is_at_another_item_does_not_go_on(said):
    story, sent = resume_of_an_ardupilot(said), []
    for _ in range(41):
        story.beat("AUTO.LOITER")
        sent += story.at(said) + story.after(100)
    assert set(sent) == {("MISSION_SET_CURRENT", 4)}
    assert story.procedure.progress is Progress.FAILED


def test_a_resume_of_an_ardupilot_that_was_in_no_mission_changes_the_mode_alone():
    story = Story(A.RESUME, copter=True, mode="AUTO.LOITER", resume_item=None)
    assert story.after(0) == []
    story.beat("AUTO.LOITER")
    assert story.after(100) == [(SET_MODE, 1.0, 3.0, 0.0)]


def test_offboard_waits_for_its_stream():
    story = Story(A.TAKEOFF, Controller.OFFBOARD)
    assert story.after(100) == []
    story.means.stream_ns = story.t_ns
    assert story.after(900) == []
    story.beat("AUTO.LOITER")
    assert story.after(100) == [(SET_MODE, 1.0, 6.0, 0.0)]


def test_every_command_has_its_steps_for_each_way_of_flying():
    assert all(steps_of(*each) for each in product(Controller, MissionAction, Dialect))


def test_foreign_are_the_modes_that_we_never_command():
    ours = ("AUTO.LOITER", "AUTO.MISSION", "AUTO.LAND", "OFFBOARD", "AUTO.TAKEOFF")
    assert not any(map(is_foreign, ours))
    assert all(map(is_foreign, ("POSCTL", "MANUAL", "ALTCTL", "STABILIZED", "ACRO", "AUTO.RTL", "MODE.25")))


def test_a_pilot_who_returns_to_the_mode_that_it_stood_in_has_taken_it():
    story = Story(A.TAKEOFF, mode="POSCTL")
    assert story.after(0) == [(SET_MODE, 1.0, 4.0, 3.0)]
    story.beat("AUTO.LOITER")
    assert story.after(100) == [(ARM, 1.0, 0.0, 0.0)]
    story.beat("POSCTL", armed=True)
    assert (story.after(100), story.procedure.progress) == ([], Progress.TAKEN)
    assert story.procedure.reason == "takeoff ended: the vehicle went to POSCTL by itself"
