"""LAND is always taken, replaces whatever runs, and stands until it is disarmed; after a silence nothing goes on.

Stories of the planner with the simulated autopilots in virtual time, as seen with real ones when their link was cut.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from flying import ARDUPILOT, LIMITS, MODEL, MS, PLANS, PX4, Recorded, S

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.autopilot.planner.sequencer import Sequencer, SequencerSettings
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase, VehicleLanded
from amaze_autonomy.missions import PlannerSpec

P, A = MissionPhase, MissionAction
EACH = pytest.mark.parametrize("kind", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
BOTH = pytest.mark.parametrize("mission", ["line", "inside"])


def armed_with_the_link_cut(mission, kind):
    """Take off, and lose the link at the moment at which the vehicle is armed."""
    flying = Recorded(kind=kind)
    flying.take_off(mission)
    flying.until(lambda: flying.craft.armed)
    flying.cut()
    return flying


@EACH
@BOTH
def test_a_landing_is_taken_while_the_vehicle_is_silent_and_nothing_else_is_sent_when_it_is_heard_again(mission, kind):
    flying = armed_with_the_link_cut(mission, kind)
    flying.run(3500 * MS)
    assert flying.status.message == "the vehicle is silent"
    landed_ns = flying.t_ns
    assert flying.command(A.LAND) == ""
    flying.run(1500 * MS)
    flying.join()
    flying.until(lambda: not flying.craft.armed, 30 * S)
    flying.run(5 * S)
    assert set(flying.since(landed_ns)) <= {"AUTO.LAND", "disarm"}
    assert (flying.craft.height_m, flying.craft.armed) == (0.0, False)
    assert flying.phase in (P.LANDED, P.FAILED)


@EACH
@BOTH
def test_a_takeoff_does_not_go_on_by_itself_after_a_silence_and_says_so(mission, kind):
    flying = armed_with_the_link_cut(mission, kind)
    flying.run(3500 * MS)
    heard_ns = flying.t_ns
    flying.join()
    flying.run(6 * S)
    assert flying.since(heard_ns) == []
    ended = ("takeoff ended: the vehicle was silent for 3 s", "the pilot has control (mode POSCTL)")
    assert (flying.phase, flying.status.message in ended) == (P.FAILED, True), flying.status


@EACH
def test_a_resume_does_not_go_on_by_itself_after_a_silence(kind):
    flying = Recorded(kind=kind)
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(A.HOLD) == ""
    flying.until_phase(P.HOLDING)
    flying.craft.flags.ignores = ("AUTO.MISSION",)
    assert flying.command(A.RESUME) == ""
    flying.cut()
    flying.run(3500 * MS)
    flying.craft.flags.ignores = ()
    heard_ns = flying.t_ns
    flying.join()
    flying.run(3 * S)
    assert flying.since(heard_ns) == []
    assert (flying.phase, flying.status.message) == (P.HOLDING, "resume ended: the vehicle was silent for 3 s")
    assert flying.command(A.RESUME) == ""  # asked again, it does
    flying.until_phase(P.LANDED)


@EACH
@BOTH
def test_after_a_landing_was_taken_nothing_else_is_until_the_vehicle_is_disarmed(mission, kind):
    flying = Recorded(kind=kind)
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(A.LAND) == ""
    for action in (A.HOLD, A.RESUME):
        assert flying.command(action) == "a landing was commanded: it stands until the vehicle is disarmed"
    flying.until_phase(P.LANDED)
    flying.run(3 * S)
    assert flying.load(mission).accepted
    assert flying.command(A.TAKEOFF) == ""
    flying.until_phase(P.FLYING)


@BOTH
def test_a_landing_takes_the_place_of_a_takeoff_before_its_arming_and_nothing_arms_afterwards(mission):
    flying = Recorded(fate=lambda: (300 * MS,))
    flying.take_off(mission)
    flying.until(lambda: "arm" in flying.since(0), 10 * S)
    flying.run(50 * MS)
    assert not flying.craft.armed
    landed_ns = flying.t_ns
    assert flying.command(A.LAND) == ""
    flying.run(8 * S)
    assert set(flying.since(landed_ns)) == {"disarm"}
    assert (flying.craft.armed, flying.phase, flying.status.waypoint) == (False, P.LANDED, 0)


def test_an_arming_that_arrives_after_the_disarming_is_taken_back():
    """Over a link that reorders, the planner's own arming overtaken by its disarming must not stay."""
    flying = Recorded()
    flying.take_off("line")
    flying.until(lambda: "arm" in flying.since(0), 5 * S)
    assert flying.command(A.ABORT) == ""
    flying.until_phase(P.LANDED, limit_ns=5 * S)
    flying.craft.arm()
    flying.run(2 * S)
    assert (flying.craft.armed, set(flying.since(flying.t_ns - 2 * S))) == (False, {"disarm"})


@EACH
@pytest.mark.parametrize("up_m, where", [(-6.0, "6.0 m below"), (6.0, "6.0 m above")])
def test_a_mission_is_not_flown_from_a_home_that_somebody_has_set_at_another_height(kind, up_m, where):
    """Its heights count from home: a file of 3 m would be dragged along the ground, or flown at 9 m."""
    flying = with_a_home_that_is_kept(kind, up_m)
    flying.take_off("line")
    flying.until_phase(P.LANDED, limit_ns=15 * S)
    assert "AUTO.MISSION" not in flying.since(0)
    assert flying.since(0)[-1] == "disarm"
    assert (flying.craft.armed, flying.craft.height_m, flying.status.waypoint) == (False, 0.0, 0)
    assert flying.status.message == f"home is {where} where it stands: set home here"


@EACH
def test_nor_is_it_after_a_hold_on_the_ground(kind):
    flying = with_a_home_that_is_kept(kind, 6.0)
    flying.take_off("line")
    flying.until(lambda: flying.planner.watch.armed, 10 * S)
    assert (flying.command(A.HOLD), flying.command(A.RESUME)) == ("", "")
    flying.run(6 * S)
    assert "AUTO.MISSION" not in flying.since(0)
    assert flying.status.message == "home is 6.0 m above where it stands: set home here"


@pytest.mark.parametrize("up_m, where", [(-6.0, "6.0 m below"), (6.0, "6.0 m above")])
@pytest.mark.parametrize("held", [False, True])
def test_nor_does_an_ardupilot_climb_by_command_from_such_a_home(up_m, where, held):
    """The height of its takeoff counts from home as well: a climb of 1 m would end at 7 m, perhaps in a ceiling."""
    flying = with_a_home_that_is_kept(ARDUPILOT, up_m)
    flying.take_off("inside")
    if held:
        flying.until(lambda: flying.planner.watch.armed, 10 * S)
        assert (flying.command(A.HOLD), flying.command(A.RESUME)) == ("", "")
    flying.run(6 * S)
    assert "takeoff" not in flying.since(0)
    assert flying.craft.height_m == 0.0
    assert flying.status.message == f"home is {where} where it stands: set home here"


def test_an_ardupilot_without_any_height_above_home_climbs_from_where_it_stands():
    """It has no home then, and takes the height where it arms for it."""
    flying = Recorded(kind=ARDUPILOT)
    flying.channel._wanted -= {"GLOBAL_POSITION_INT"}
    flying.planner.watch.place_ns = 0
    flying.take_off("inside")
    flying.until_phase(P.FLYING, limit_ns=15 * S)
    assert "takeoff" in flying.since(0)
    assert flying.craft.height_m == pytest.approx(LIMITS.takeoff_height_m, abs=0.4)


@pytest.mark.parametrize("drift_m", [2.0, -3.0])
def test_heights_count_from_where_an_ardupilot_stands_once_it_is_armed(drift_m):
    """Without a home it sets its height to 0 as it arms: set-points by the height before would lead into the ground."""
    flying = Recorded(kind=ARDUPILOT)
    said = flying.vehicle.wake

    def wake(t_ns):
        messages = said(t_ns)
        for message in messages:
            if message.get_type() == "LOCAL_POSITION_NED" and not flying.planner.watch.armed:
                message.z -= drift_m
        return messages

    flying.vehicle.wake = wake
    flying.run(2 * S)
    flying.take_off("inside")
    flying.until_phase(P.FLYING, limit_ns=20 * S)
    heights = []
    flying.until(lambda: heights.append(flying.craft.height_m) or flying.phase is not P.FLYING)
    assert (min(heights) > 0.9, max(heights) < 3.2, flying.status.waypoint) == (True, True, 3)


def with_a_home_that_is_kept(kind, up_m):
    flying = Recorded(kind=kind)
    craft = flying.craft
    home = craft.geography.place(0.0, 0.0, up_m)
    kept = property(lambda _: home, lambda _, __: None)  # PX4: set by hand, ArduPilot: locked
    craft.__dict__.pop("home")
    craft.__class__ = type("Kept", (type(craft),), {"home": kept})
    flying.run(2 * S)
    return flying


@BOTH
@EACH
def test_no_file_is_loaded_while_a_takeoff_of_ours_arms(mission, kind):
    """Else the takeoff is forgotten, and the vehicle stands armed with a planner that says LOADED."""
    flying = Recorded(kind=kind)
    flying.take_off(mission)
    flying.until(lambda: "arm" in flying.since(0), 10 * S)
    assert flying.load(mission, session="s2").reason == "a takeoff is under way: ABORT cancels it"
    flying.until_phase(P.LANDED)
    assert flying.status.waypoint == 3
    assert flying.load(mission, session="s2").accepted


@BOTH
def test_no_file_is_loaded_while_an_arming_of_ours_may_still_come(mission):
    """Else the landing that takes it back is forgotten."""
    flying = Recorded()
    flying.take_off(mission)
    flying.until(lambda: "arm" in flying.since(0), 5 * S)
    assert flying.command(A.ABORT) == ""
    flying.until_phase(P.LANDED, limit_ns=5 * S)
    late = "what was commanded less than 3 s ago may still take effect: load again"
    flying.until(lambda: flying.load(mission).reason == late, 2 * S)
    flying.craft.arm()
    flying.run(2 * S)
    assert not flying.craft.armed
    flying.run(2 * S)
    assert flying.load(mission).accepted


def test_a_late_change_of_mode_of_our_own_is_landed_again():
    flying = Recorded()
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.command(A.HOLD)
    flying.run(100 * MS)
    assert flying.command(A.LAND) == ""
    flying.until(lambda: flying.planner.watch.mode == "AUTO.LAND", 3 * S)
    flying.craft.command_mode("AUTO.LOITER")  # the hold, on a slower way
    flying.until(lambda: flying.craft.mode == "AUTO.LAND", 2 * S)
    flying.until_phase(P.LANDED)


def test_a_pilot_who_ends_a_landing_keeps_the_vehicle():
    flying = Recorded()
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDING)
    flying.craft.pilot_takes_over("POSCTL", 60 * S)
    flying.run(1500 * MS)
    taken_ns = flying.t_ns
    flying.run(4 * S)
    flying.craft.command_mode("AUTO.LOITER")  # handed back
    flying.run(3 * S)
    assert flying.since(taken_ns) == []
    assert flying.command(A.RESUME) == "a landing was commanded: it stands until the vehicle is disarmed"
    assert flying.command(A.LAND) == ""
    flying.until_phase(P.LANDED)


@pytest.mark.parametrize("action, phase", [(A.HOLD, P.HOLDING), (A.LAND, P.LANDING)])
def test_a_pilot_who_takes_over_as_soon_as_a_mode_shows_is_not_commanded_again(action, phase):
    """CURRENT_MODE shows a mode up to a second before the next heartbeat; to repeat it would take him over."""
    flying = Recorded()
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(action) == ""
    flying.until_phase(phase, limit_ns=2 * S)
    flying.craft.pilot_takes_over("POSCTL", 60 * S)
    shown_ns = flying.t_ns
    flying.run(3 * S)
    assert (flying.craft.mode, flying.since(shown_ns)) == ("POSCTL", [])


@EACH
def test_a_landing_whose_mode_showed_once_is_sent_on_when_it_is_not_told_any_more_and_not_while_it_is(kind):
    flying = Recorded(kind=kind)
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    assert flying.command(A.LAND) == ""
    flying.until(lambda: flying.planner.watch.mode == "AUTO.LAND", 2 * S)
    flying.cut()
    shown_ns = flying.t_ns
    flying.run(1200 * MS)
    assert flying.since(shown_ns) == []
    flying.run(1 * S)
    assert set(flying.since(shown_ns)) == {"AUTO.LAND"}
    flying.join()
    flying.run(1500 * MS)
    joined_ns = flying.t_ns
    flying.until(lambda: not flying.craft.armed, 30 * S)
    assert flying.since(joined_ns) == []


@BOTH
def test_a_landing_of_somebody_else_ends_what_runs(mission):
    """AUTO.LAND by the pilot's switch, or by the autopilot node: a hold or a resume does not go on against it."""
    flying = Recorded()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.craft.flags.ignores = ("AUTO.LOITER",)
    flying.command(A.HOLD)
    flying.run(100 * MS)
    flying.craft.flags.ignores = ()
    flying.craft.command_mode("AUTO.LAND")
    flying.until(lambda: flying.planner.watch.mode == "AUTO.LAND", 2 * S)
    seen_ns = flying.t_ns
    flying.run(2 * S)
    assert flying.since(seen_ns) == []
    assert flying.phase is not P.LANDING  # it is not ours: the engine must not take it for the planner's
    assert flying.status.message == "somebody else lands the vehicle (mode AUTO.LAND)"
    assert flying.command(A.RESUME) == "the vehicle lands (mode AUTO.LAND)"
    flying.until_phase(P.LANDED)


@EACH
@pytest.mark.parametrize("mode", ["AUTO.LAND", "AUTO.RTL", "POSCTL"])
def test_a_mode_that_somebody_else_chooses_before_our_arming_takes_effect_stands(mode, kind):
    """Seen with PX4: a second station's AUTO.LAND, 0.2 s before it was armed, was answered by our AUTO.MISSION."""
    flying = Recorded(kind=kind)
    assert flying.load("line").accepted
    flying.channel.fate = lambda: (200 * MS,)
    assert flying.command(A.TAKEOFF) == ""
    flying.until(lambda: "arm" in flying.since(0), 10 * S)
    flying.run(50 * MS)
    assert not flying.craft.armed
    flying.craft.command_mode(mode)
    chosen_ns = flying.t_ns
    flying.run(6 * S)
    assert set(flying.since(chosen_ns)) <= {"arm", "disarm"}
    assert "arm" not in flying.since(chosen_ns + 700 * MS)
    assert flying.craft.height_m == 0.0
    assert not flying.craft.armed
    assert flying.phase is not P.FLYING
    assert mode in flying.status.message


# --- the autopilot node lands -----------------------------------------------------------------------------------------


@BOTH
def test_when_the_autopilot_node_lands_the_planner_does_nothing_else(mission):
    flying = Recorded()
    flying.take_off(mission)
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    flying.command(A.HOLD)
    flying.run(100 * MS)
    told_ns = flying.t_ns
    flying.channel.ours(flying.planner.other_commands(flying.t_ns, "AUTO.LAND"))
    assert flying.command(A.HOLD) == "the autopilot node commands AUTO.LAND: it stands until the vehicle is disarmed"
    flying.until_phase(P.LANDED)
    assert set(flying.since(told_ns)) <= {"AUTO.LAND", "disarm"}


def test_no_takeoff_begins_while_the_autopilot_node_lands():
    flying = Recorded()
    assert flying.load("line").accepted
    flying.planner.other_commands(flying.t_ns, "AUTO.LAND")
    assert flying.command(A.TAKEOFF) == "the autopilot node commands AUTO.LAND"
    flying.run(1500 * MS)  # it is dead, or does not any more
    assert flying.command(A.TAKEOFF) == ""


def test_a_takeoff_that_is_under_way_is_cancelled_when_the_autopilot_node_lands_or_disarms():
    for what in ("AUTO.LAND", "DISARM"):
        flying = Recorded()
        flying.take_off("line")
        flying.until(lambda flying=flying: "arm" in flying.since(0), 5 * S)
        flying.run(50 * MS)
        told_ns = flying.t_ns
        flying.channel.ours(flying.planner.other_commands(flying.t_ns, what))
        flying.run(6 * S)
        assert set(flying.since(told_ns)) == {"disarm"}
        assert not flying.craft.armed


# --- disarming --------------------------------------------------------------------------------------------------------


def test_a_failed_takeoff_does_not_disarm_on_what_the_vehicle_said_a_while_ago():
    """Seen with PX4: the landed state stood still, the vehicle was at 1.3 m, and was told to disarm twice a second."""
    flying = Recorded()
    take = flying.planner.watch.take
    flying.take_off("line")
    flying.until(lambda: flying.craft.armed)
    flying.planner.watch.take = lambda t_ns, message, **_: (
        None if message.get_type() == "EXTENDED_SYS_STATE" else take(t_ns, message)
    )
    flying.until(lambda: flying.craft.height_m > 0.5)
    assert flying.planner.watch.landed is VehicleLanded.ON_GROUND  # the last that it heard
    now_ns = flying.t_ns
    assert flying.command(A.ABORT) == ""
    flying.until(lambda: flying.craft.mode == "AUTO.LAND", 5 * S)
    flying.until(lambda: not flying.craft.armed, 30 * S)
    assert "disarm" not in flying.since(now_ns)


def test_what_lay_in_the_socket_while_the_process_stood_still_is_no_reason_to_disarm_nor_a_silence():
    flying = Recorded()
    flying.take_off("line")
    flying.until(lambda: flying.craft.armed and flying.craft.mode == "AUTO.MISSION")
    while flying.craft.height_m < 0.5:  # the planner stands still, and the vehicle lifts off
        flying.channel.t_ns += 50 * MS
        flying.vehicle.wake(flying.t_ns)
    planner, now_ns = flying.planner, flying.t_ns
    assert planner.command(now_ns, "s1", A.ABORT)[0] == ""
    old = mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_ON_GROUND)
    assert "disarm" not in [name for each in planner.receive(now_ns, old) for name in flying._named(each)]
    assert "disarm" not in [name for each in planner.wake(now_ns) for name in flying._named(each)]
    flying.until(lambda: not flying.craft.armed, 40 * S)
    assert "disarm" not in flying.since(now_ns)


def test_a_process_that_stood_still_reads_before_it_believes_the_vehicle_silent():
    flying = Recorded()
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 2.0)
    flying.craft.flags.ignores = ("AUTO.LOITER",)
    flying.command(A.HOLD)
    flying.channel.t_ns += 3500 * MS
    flying.planner.wake(flying.t_ns)
    assert flying.planner._procedure.running
    flying.craft.flags.ignores = ()
    flying.until_phase(P.HOLDING, limit_ns=2 * S)


def test_over_a_link_that_loses_heartbeats_the_vehicle_is_not_silent_while_it_says_other_things():
    flying = Recorded()
    take = flying.planner.watch.take
    flying.planner.watch.take = (
        lambda t_ns, message, **_: None if message.get_type() == "HEARTBEAT" else take(t_ns, message)
    )
    flying.run(5 * S)
    assert flying.status.message == "the flight mode is not known"


# --- uploads ----------------------------------------------------------------------------------------------------------


def test_a_landing_ends_an_upload():
    flying = Recorded()
    loading, messages = flying.planner.load(flying.t_ns, LoadRequest("s1", "line", 0, 0))
    flying.channel.ours(messages)
    assert flying.command(A.LAND) == ""
    assert (loading.over, loading.reason) == (True, "a landing was commanded")
    flying.channel.sent.clear()
    flying.run(2 * S)
    assert not [name for name in flying.channel.sent if name.startswith("MISSION_")]


def test_an_upload_ends_when_the_vehicle_is_armed_by_somebody_else():
    flying = Recorded(fate=lambda: (300 * MS,))
    loading, messages = flying.planner.load(flying.t_ns, LoadRequest("s1", "line", 0, 0))
    flying.channel.ours(messages)
    flying.run(500 * MS)
    assert not loading.over
    assert flying.craft.arm() == ""
    flying.until(lambda: loading.over, 3 * S)
    assert loading.reason == "the vehicle was armed meanwhile"


# --- somebody else's mission ------------------------------------------------------------------------------------------


def change_item(flying, number=-1):
    """Change an item of the vehicle's mission, as another ground station does."""
    server = flying.vehicle.px4.missions
    items = list(server.items)
    items[number] = replace(items[number], x=items[number].x + 3000)
    server._stores[0] = tuple(items)
    flying.craft.items = tuple(items)


@EACH
def test_a_mission_that_somebody_changed_since_the_upload_is_not_flown_and_nothing_is_armed(kind):
    flying = Recorded(kind=kind)
    assert flying.load("line").accepted
    change_item(flying, 2)
    assert flying.command(A.TAKEOFF) == ""
    flying.until_phase(P.FAILED, limit_ns=10 * S)
    assert flying.status.message.startswith("the mission did not read back as it was sent: item 2")
    assert set(flying.since(0)) == {"disarm"}
    assert not flying.craft.armed
    flying.take_off("line")  # sent again it flies
    flying.until_phase(P.FLYING)


def test_a_mission_that_somebody_cleared_or_made_longer_is_not_flown():
    for items in ((), None):
        flying = Recorded()
        assert flying.load("line").accepted
        server = flying.vehicle.px4.missions
        server._stores[0] = items if items is not None else (*server.items, server.items[-1])
        assert flying.command(A.TAKEOFF) == ""
        flying.until_phase(P.FAILED, limit_ns=10 * S)
        assert "items instead of 5" in flying.status.message
        assert "arm" not in flying.since(0)


def test_a_mission_that_cannot_be_read_back_is_not_flown():
    flying = Recorded()
    assert flying.load("line").accepted
    flying.vehicle.px4.missions.take = lambda *_: []
    assert flying.command(A.TAKEOFF) == ""
    flying.until_phase(P.FAILED, limit_ns=12 * S)
    assert flying.status.message == (
        "the mission did not read back as it was sent: asking back: no end within the limit"
    )
    assert "arm" not in flying.since(0)


def test_a_first_item_that_somebody_set_is_set_back_before_the_takeoff():
    flying = Recorded()
    assert flying.load("line").accepted
    flying.craft.set_current(3)
    flying.run(2 * S)
    assert flying.command(A.TAKEOFF) == ""
    flying.until_phase(P.LANDED)
    assert (flying.status.waypoint, flying.craft.happened.count("waypoint")) == (3, 3)


@EACH
@pytest.mark.parametrize("action", [A.LAND, A.ABORT])
def test_a_planner_that_begins_in_flight_tells_nobody_to_land_before_it_knows_whom(kind, action):
    """The number of PX4's landing mode is that of GUIDED on an ArduPilot, and the target 0 are all vehicles."""
    flying = Recorded(kind=kind)
    flying.take_off("line")
    flying.until(lambda: flying.craft.position_m[0] > 3.0)
    beats = flying.planner.watch.heartbeat_ns
    flying.until(lambda: flying.planner.watch.heartbeat_ns != beats)
    anew = Sequencer(SequencerSettings(PLANS, PlannerSpec(), MODEL, LIMITS))
    flying.channel.client = flying.planner = anew
    flying.until(lambda: anew.watch.pose is not None, 2 * S)
    assert anew.watch.heartbeat_ns is None
    begun_ns = flying.t_ns
    assert flying.command(action) == ""
    modes = set()
    flying.until(lambda: modes.add(flying.craft.mode) or not flying.craft.armed, 40 * S)
    assert modes <= {"AUTO.MISSION", "AUTO.LAND"}
    assert {each.target_system for at_ns, each in flying.commands if at_ns >= begun_ns} == {1}
    assert (flying.craft.height_m, flying.craft.armed) == (0.0, False)
