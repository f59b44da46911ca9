"""Hands off (rule 4): neither node commands over a failsafe that acts, nor over a pilot, whatever the flags say.

And the other way round: a flag alone is no reason to leave a vehicle in our mode to itself.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from random import Random
from types import SimpleNamespace

import pytest
from autopilot_tools import beat
from client_bench import ClientBench
from flying import ARDUPILOT, ARM, LIMITS, MODEL, MS, PLANS, PX4, SET_MODE, Recorded, S, plan
from mission_channel import good
from px4_tools import POSCTL, RTL
from vehicle_lies import CRITICAL, Liar

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.planner.mission_vehicle import MODE_LATE_NS, VehicleWatch
from amaze_autonomy.autopilot.planner.own_landing import ENDS, OwnLanding
from amaze_autonomy.autopilot.planner.sequencer import Sequencer, SequencerSettings
from amaze_autonomy.autopilot.vehicle.client import AutopilotClient, Reply
from amaze_autonomy.autopilot.vehicle.modes import Control, Heartbeat
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase
from amaze_autonomy.missions import Controller, FlightModel, PlannerSpec, Trajectory, Waypoint
from amaze_autonomy.monitoring.specs import BatterySpec
from amaze_autonomy.simulation.ardupilot import ArduCraft, ArduPilot
from amaze_autonomy.simulation.px4 import Px4Settings

P, A = MissionPhase, MissionAction
EACH = pytest.mark.parametrize("kind", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
BOTH = pytest.mark.parametrize("mission", ["line", "inside"])
LOITER, TAKEOFF, MISSION, LAND = (f"AUTO.{name}" for name in ("LOITER", "TAKEOFF", "MISSION", "LAND"))
COPTER_FLIES = mavlink.MAV_CMD_NAV_TAKEOFF


def landings(bench, since_ns=0):
    """Return when the landing mode was commanded."""
    return [t_ns for t_ns in bench.commands(SET_MODE) if t_ns >= since_ns]


def copter():
    """Return an ArduCopter in the air, in GUIDED."""
    bench = ClientBench(autopilot=(ArduCraft, ArduPilot)).advance(3.0)
    for command, *values in ((SET_MODE, 1, 4), (ARM, 1), (COPTER_FLIES, 0, 0, 0, 0, 0, 0, 10.0)):
        bench.far.command(command, *values)
        bench.advance(0.1)
    return bench.until(lambda: bench.vehicle.landed(bench.t_ns).name == "IN_AIR").advance(4.0)


def failsafe(mode, *, pilot=False):
    """Return what happens while the link is cut: a failsafe chooses a mode; a pilot flies in it, the flag still up."""

    def happens(craft):
        craft.enter_failsafe(mode)
        craft.pilot = pilot

    return happens


# --- the autopilot node: a landing that stands ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make, happens, mode",
    [
        (lambda: ClientBench().fly(20.0), failsafe("AUTO.RTL"), "AUTO.RTL"),
        (lambda: ClientBench().fly(20.0).advance(0.4), failsafe("AUTO.RTL"), "AUTO.RTL"),
        (lambda: ClientBench().fly(20.0), failsafe("POSCTL", pilot=True), "POSCTL"),
        (lambda: ClientBench().fly(20.0).advance(0.4), failsafe("POSCTL", pilot=True), "POSCTL"),
        (copter, failsafe("ALTCTL", pilot=True), "ALTCTL"),
        (copter, failsafe("AUTO.RTL"), "AUTO.RTL"),
    ],
    ids=["px4 returns", "px4 returns a little later", "px4 pilot", "px4 pilot later", "copter pilot", "copter returns"],
)
@pytest.mark.slow_rows
def test_a_landing_that_stands_is_not_sent_over_what_the_autopilot_began_while_the_link_was_cut(make, happens, mode):
    bench = make()
    bench.far.craft.command_mode("AUTO.MISSION" if mode != "ALTCTL" else "OFFBOARD")
    bench.advance(1.5)
    bench.cut = True
    bench.advance(3.2)
    bench.ask(bench.client.land)
    happens(bench.far.craft)
    bench.advance(1.0)
    assert bench.client.commanding == LAND
    bench.cut, heard_ns = False, bench.t_ns
    bench.until(lambda: bench.vehicle.beat.mode == mode, 1.2)
    seen_ns = bench.t_ns
    bench.advance(6.0)
    assert landings(bench, seen_ns + 1) == []
    assert (len(landings(bench, heard_ns)) <= 3, bench.client.commanding) == (True, "")  # until its mode is heard
    words = f"the autopilot acts by its failsafe, in {mode}"
    assert bench.client.land_reply() == Reply(accepted=False, message=words, final=True)
    bench.far.craft.leave_failsafe()
    bench.advance(3.0)
    assert landings(bench, seen_ns + 1) == []  # it was taken for good


def test_a_landing_that_is_asked_for_is_refused_while_a_failsafe_acts():
    bench = ClientBench().fly(20.0)
    bench.far.craft.enter_failsafe("AUTO.RTL")
    bench.until(lambda: bench.vehicle.control.failsafe, 1.2)
    words = "the autopilot acts by its failsafe, in AUTO.RTL"
    assert bench.ask(bench.client.land) == Reply(accepted=False, message=words, final=True)
    bench.advance(3.0)
    assert (landings(bench), bench.client.commanding) == ([], "")


def heard(*beats, transmitter=True):
    """Return a client after heartbeats of (mode, status), armed, 0.4 s apart, and one SYS_STATUS; and the time."""
    client = AutopilotClient(AutopilotSettings(), BatterySpec(), lambda: (1, 1))
    rc = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    known = rc if transmitter else 0
    if transmitter is not None:
        client.receive(S, mavlink.MAVLink_sys_status_message(known, rc, known, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0))
    numbers = {MISSION: 4 << 24 | 4 << 16, LOITER: 3 << 24 | 4 << 16, TAKEOFF: 2 << 24 | 4 << 16, "POSCTL": 3 << 16}
    numbers.update({"AUTO.RTL": 5 << 24 | 4 << 16, "OFFBOARD": 6 << 16, LAND: 6 << 24 | 4 << 16})
    t_ns = S
    for mode, status in beats:
        t_ns += 400 * MS
        client.receive(t_ns, beat(numbers[mode], armed=True, status=status))
    return client, t_ns


ACTIVE = mavlink.MAV_STATE_ACTIVE


@pytest.mark.parametrize(
    "beats, lands",
    [
        ([(MISSION, ACTIVE), (MISSION, CRITICAL), (MISSION, CRITICAL)], True),
        ([(TAKEOFF, ACTIVE), (TAKEOFF, CRITICAL), (TAKEOFF, CRITICAL)], True),
        ([("OFFBOARD", ACTIVE), ("OFFBOARD", CRITICAL), ("OFFBOARD", CRITICAL)], True),
        ([(LOITER, ACTIVE), (LOITER, CRITICAL), (LOITER, CRITICAL)], True),  # held by us
        ([(MISSION, ACTIVE), (MISSION, CRITICAL), (LOITER, CRITICAL), (LOITER, CRITICAL)], True),  # held under the flag
        ([(MISSION, ACTIVE), (LOITER, CRITICAL), (LOITER, CRITICAL)], False),  # PX4 waits before it returns
        ([(MISSION, ACTIVE), ("AUTO.RTL", CRITICAL), (LOITER, CRITICAL), (LOITER, CRITICAL)], False),
        ([(LOITER, ACTIVE), ("AUTO.RTL", CRITICAL), (LOITER, CRITICAL), (LOITER, CRITICAL)], False),
        ([(MISSION, ACTIVE), ("AUTO.RTL", CRITICAL)], False),  # its first sign is enough
        ([(MISSION, ACTIVE), ("POSCTL", CRITICAL)], False),
    ],
)
def test_a_failsafe_has_control_when_the_mode_left_ours_and_with_its_flag_alone_it_is_landed(beats, lands):
    client, t_ns = heard(*beats)
    answer, messages = client.land(t_ns)
    assert (bool(messages), answer.accepted) == (lands, lands), answer
    answer, messages = client.leave(t_ns)
    assert (bool(messages) or client.landing.sending) is (lands or len(beats) == 2)  # its first sign ends nothing


@pytest.mark.parametrize("transmitter, after_s", [(True, None), (False, 0.0), (None, 3.0)])
def test_a_pilot_s_mode_of_a_failsafe_is_a_pilot_s_where_a_transmitter_is_heard_and_unknown_is_waited_for(
    transmitter, after_s
):
    """The heartbeat that shows POSCTL may come half a second before the SYS_STATUS that says who is there."""
    client, t_ns = heard((MISSION, ACTIVE), transmitter=transmitter)
    client.land(t_ns)
    sent, began_ns = [], t_ns + 10 * MS
    for number in range(100):
        t_ns += 50 * MS
        messages = list(client.wake(t_ns))
        if not number % 10:
            messages += client.receive(t_ns, beat(3 << 16, armed=True, status=CRITICAL))
        if not number % 10 and transmitter is not None:
            rc = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
            known = rc if transmitter else 0
            client.receive(t_ns, mavlink.MAVLink_sys_status_message(known, rc, known, *[0] * 10))
        sent += [t_ns for each in messages if each.get_type() == "COMMAND_LONG" and each.command == SET_MODE]
    if after_s is None:
        assert sent == []
    else:
        assert after_s <= (sent[0] - began_ns) / S <= after_s + 0.5


def test_of_a_silent_vehicle_the_last_that_was_heard_of_its_transmitter_counts():
    client, t_ns = heard((MISSION, ACTIVE), transmitter=True)
    client.land(t_ns)
    client.receive(t_ns + 50 * MS, beat(3 << 16, armed=True, status=CRITICAL))
    sent = [each for number in range(1, 100) for each in client.wake(t_ns + number * S // 10)]
    assert SET_MODE not in {each.command for each in sent if each.get_type() == "COMMAND_LONG"}


# --- the autopilot node: a disarming ----------------------------------------------------------------------------------


def on_the_ground(make=lambda: ClientBench().fly(3.0)):
    """Return a vehicle that has landed and does not disarm, told to."""
    bench = make()
    bench.far.craft.flags.does_not_disarm = True
    bench.ask(bench.client.land)
    bench.until(lambda: bench.vehicle.landed(bench.t_ns).name == "ON_GROUND").advance(1.0)
    bench.ask(bench.client.disarm)
    assert len(bench.commands(ARM)) == 1
    return bench


def test_a_disarming_ends_when_a_pilot_takes_over_and_is_refused_then():
    bench = on_the_ground()
    bench.far.craft.pilot_takes_over("POSCTL", 600 * S)
    bench.until(lambda: bench.vehicle.control.pilot, 1.2)
    sent = bench.commands(ARM)
    words = "the pilot has control, in POSCTL"
    assert bench.ask(bench.client.disarm) == Reply(accepted=False, message=words, final=True)
    bench.until(lambda: not bench.client.disarming.sending, 1.2)
    assert bench.client.disarm_reply() == Reply(accepted=False, message=words, final=True)
    bench.far.craft.pilot_gives_back()
    bench.advance(5.0)
    assert bench.commands(ARM) == sent


def test_a_disarming_is_not_sent_over_a_pilot_while_the_failsafe_flag_is_up():
    bench = on_the_ground()
    bench.far.craft.enter_failsafe("POSCTL")
    bench.far.craft.pilot = True
    bench.until(lambda: bench.vehicle.beat.mode == "POSCTL", 1.2)
    sent = bench.commands(ARM)
    assert not bench.ask(bench.client.disarm).accepted
    bench.advance(3.0)
    assert bench.commands(ARM) == sent


def test_one_message_that_says_pilot_does_not_end_a_disarming_nor_does_a_mode_that_px4_chooses_by_itself():
    bench = on_the_ground()
    lies = Liar(bench.client)
    bench.advance(1.0)
    sent = len(bench.commands(ARM))
    bench.transmit(lies.datagram(bench.t_ns, ("mode", "POSCTL")))
    bench.advance(1.5)
    assert len(bench.commands(ARM)) > sent
    sent = len(bench.commands(ARM))
    bench.far.craft.fall_into(LOITER)
    bench.until(lambda: bench.vehicle.beat.mode == LOITER, 1.2)
    bench.ask(bench.client.disarm)
    bench.advance(1.0)
    assert len(bench.commands(ARM)) > sent


# --- the planner ------------------------------------------------------------------------------------------------------


def flying(mission="line", kind=PX4):
    found = Recorded(kind=kind)
    found.take_off(mission)
    found.until(lambda: found.craft.position_m[0] > 2.0)
    return found


def pilot_chooses(mode):
    return lambda craft: craft.pilot_takes_over(mode, 600 * S)


TAKES = {
    "a pilot's return": pilot_chooses("AUTO.RTL"),
    "a pilot's hold": pilot_chooses(LOITER),
    "a failsafe's return": failsafe("AUTO.RTL"),
    "a failsafe's hold": failsafe(LOITER),
    "a pilot's sticks under the flag": failsafe("ALTCTL", pilot=True),
}


@EACH
@BOTH
@pytest.mark.parametrize("who", TAKES)
@pytest.mark.slow_rows
def test_told_to_end_the_planner_does_not_land_over_who_has_control(mission, kind, who):
    found = flying(mission, kind)
    TAKES[who](found.craft)
    found.run(2 * S)
    mode, told_ns = found.craft.mode, found.t_ns
    assert found.planner.shutdown(found.t_ns) == (False, ())
    found.run(2 * S)
    assert (found.since(told_ns), found.craft.mode) == ([], mode)


def without_transmitter(found, *, heard=True):
    """Have SYS_STATUS say that no transmitter is heard; not heard: it does not come."""
    receive, rc = found.planner.receive, mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER

    def told(t_ns, message, **how):
        if message.get_type() == "SYS_STATUS":
            if not heard:
                return ()
            message = mavlink.MAVLink_sys_status_message(0, rc, 0, *[0] * 10)
        return receive(t_ns, message, **how)

    found.planner.receive = told


@EACH
@BOTH
def test_a_pilot_s_sticks_under_the_flag_are_not_landed_over_also_when_he_switches_back_to_them(mission, kind):
    """A low battery: the flag stays up while he flies."""
    found = flying(mission, kind)
    failsafe("ALTCTL", pilot=True)(found.craft)
    found.run(2 * S)
    words, told_ns = "the pilot has control (mode ALTCTL)", found.t_ns
    assert [found.command(action) for action in (A.LAND, A.ABORT, A.HOLD)] == [words] * 3
    assert found.status.message == words
    found.craft.fall_into(LAND)
    found.run(2 * S)
    found.craft.fall_into("ALTCTL")
    found.run(2 * S)
    assert (found.since(told_ns), found.craft.mode) == ([], "ALTCTL")


@EACH
def test_a_landing_in_a_mode_of_the_sticks_ends_when_a_transmitter_is_heard_again(kind):
    found = flying(kind=kind)
    receive = found.planner.receive
    without_transmitter(found)
    found.craft.enter_failsafe("ALTCTL")
    found.craft.flags.ignores = (LAND,)
    found.run(4 * S)
    assert found.command(A.LAND) == ""
    found.run(S)
    assert set(found.since(found.t_ns - S)) == {LAND}
    found.craft.pilot, found.planner.receive = True, receive
    found.run(2 * S)
    taken_ns = found.t_ns
    found.run(2 * S)
    assert (found.since(taken_ns), found.status.message) == ([], "the pilot has control (mode ALTCTL)")


@EACH
@BOTH
@pytest.mark.parametrize("heard", [True, False], ids=["heard", "not heard"])
@pytest.mark.parametrize("told_to_end", [True, False])
@pytest.mark.slow_rows
def test_in_a_mode_of_the_sticks_that_a_failsafe_chose_it_lands_where_no_transmitter_is_heard(
    mission, kind, heard, told_to_end
):
    found = flying(mission, kind)
    without_transmitter(found, heard=heard)
    found.run(4 * S)
    found.craft.enter_failsafe("ALTCTL")
    found.until(lambda: found.planner.watch.failsafe, 2 * S)
    if told_to_end:
        lands, messages = found.planner.shutdown(found.t_ns)
        found.channel.ours(messages)
        assert lands
    else:
        refused = "a pilot may have control (mode ALTCTL): whether a transmitter is heard is not known yet"
        assert found.command(A.LAND) == ("" if heard else refused)
        found.run(0 if heard else 3500 * MS)
        assert found.command(A.LAND) == ""
    found.until(lambda: found.craft.mode == LAND, 5 * S)


@EACH
@BOTH
def test_a_landing_of_the_planner_is_not_sent_over_what_the_autopilot_began_while_the_link_was_cut(mission, kind):
    found = flying(mission, kind)
    found.cut()
    found.run(3200 * MS)
    assert found.command(A.LAND) == ""
    found.craft.enter_failsafe("AUTO.RTL")
    found.run(S)
    found.join()
    found.until(lambda: found.planner.watch.mode == "AUTO.RTL", 1200 * MS)
    seen_ns = found.t_ns
    found.run(4 * S)
    assert found.since(seen_ns + 1) == []


@EACH
def test_told_to_end_under_the_flag_alone_it_lands_from_a_mode_of_ours(kind):
    """A warning of a low battery; and a hold of ours under it."""
    for hold in (False, True):
        found = flying(kind=kind)
        Liar(found.planner, copter=kind is ARDUPILOT).always(("status", CRITICAL))
        found.run(2 * S)
        if hold:
            assert found.command(A.HOLD) == ""
            found.run(2 * S)
        lands, messages = found.planner.shutdown(found.t_ns)
        found.channel.ours(messages)
        assert lands
        found.until(lambda found=found: found.craft.mode == LAND, 2 * S)


@EACH
@BOTH
def test_a_landing_that_is_repeated_is_refused_while_a_pilot_returns(mission, kind):
    """The autopilot node is dead, so the engine cannot see him: it asks twice a second."""
    found = flying(mission, kind)
    found.craft.pilot_takes_over("AUTO.RTL", 600 * S)
    found.run(1500 * MS)
    taken_ns = found.t_ns
    for _ in range(8):
        assert found.command(A.LAND) == "the pilot has control (mode AUTO.RTL)"
        found.run(S // 2)
    assert found.status.message == "the pilot has control (mode AUTO.RTL)"
    assert (found.since(taken_ns), found.craft.mode) == ([], "AUTO.RTL")


def held(mission, kind=PX4):
    """Return a vehicle that holds by our command."""
    found = flying(mission, kind)
    assert found.command(A.HOLD) == ""
    found.until_phase(P.HOLDING)
    found.run(2 * S)
    return found


@BOTH
def test_nothing_is_resumed_under_the_hold_of_a_failsafe_which_the_command_would_end(mission):
    """A lost transmitter: PX4 holds for COM_FAIL_ACT_T before it returns; a mode that is commanded cancels that."""
    found = held(mission)
    found.craft.enter_failsafe(LOITER)
    found.run(2 * S)
    told_ns, words = found.t_ns, "the autopilot acts by its failsafe (mode AUTO.LOITER)"
    assert found.command(A.RESUME) == words
    found.run(S)
    assert (found.since(told_ns), found.craft.mode) == ([], LOITER)


FAILSAFE = "the autopilot acts by its failsafe (mode AUTO.LOITER)"


def test_a_hold_of_ours_is_not_commanded_again_once_the_flag_came_up_in_it():
    """PX4 may have taken it for its own: also the mode that it is in already is the user's takeover to it."""
    found = held("line")
    found.craft.enter_failsafe(LOITER)
    found.run(2 * S)
    told_ns = found.t_ns
    assert found.command(A.HOLD) == ""
    found.run(4 * S)
    assert (found.since(told_ns), found.craft.mode, found.phase) == ([], LOITER, P.HOLDING)
    assert found.status.message == ""


def by_mode(found, mode):
    """Have a failsafe choose a mode just after a heartbeat: CURRENT_MODE says the mode, and none of why it is so."""
    watch, beat_ns = found.planner.watch, found.planner.watch.heartbeat_ns
    found.until(lambda: watch.heartbeat_ns != beat_ns, 2 * S)
    found.craft.enter_failsafe(mode)
    found.until(lambda: watch.mode == mode, 400 * MS)
    assert not watch.failsafe
    return found.t_ns


@BOTH
@pytest.mark.parametrize("action", [A.HOLD, A.RESUME], ids=["hold", "resume"])
def test_a_hold_that_nobody_here_commanded_is_not_commanded_over_before_a_heartbeat_says_whose_it_is(mission, action):
    found = flying(mission)
    told_ns = by_mode(found, LOITER)
    assert found.command(action) == ""
    found.run(3 * S)
    assert (found.since(told_ns), found.craft.mode) == ([], LOITER)
    assert found.status.message == f"{action.name.lower()} ended: {FAILSAFE}"
    assert found.command(action) == FAILSAFE


@EACH
def test_a_hold_of_somebody_else_is_held_and_resumed_once_a_heartbeat_says_that_no_failsafe_chose_it(kind):
    for action, mode in ((A.HOLD, LOITER), (A.RESUME, MISSION)):
        found = flying(kind=kind)
        found.craft.fall_into(LOITER)
        found.until(lambda found=found: found.planner.watch.mode == LOITER, 2 * S)
        asked_ns = found.t_ns
        assert found.command(action) == ""
        found.run(S)
        assert mode in found.since(asked_ns)
        assert found.craft.mode == mode


@EACH
@pytest.mark.parametrize("holds", [False, True], ids=["flies", "holds"])
def test_a_mission_that_somebody_else_chose_stands_in_a_flight_by_set_points(kind, holds):
    found = flying("inside", kind=kind)
    if holds:
        assert found.command(A.HOLD) == ""
        found.until_phase(P.HOLDING)
    chosen_ns = found.t_ns
    found.craft.command_mode(MISSION)
    found.run(2 * S)
    words = f"somebody else has chosen the flight mode (mode {MISSION})"
    assert (found.command(A.HOLD), found.command(A.RESUME), found.status.message) == (words, words, words)
    found.run(2 * S)
    assert (found.since(chosen_ns), found.craft.mode) == ([], MISSION)


def test_fly_here_of_a_ground_station_stands_in_a_flight_by_a_mission_of_the_autopilot():
    found = flying(kind=ARDUPILOT)
    assert found.command(A.HOLD) == ""
    found.until_phase(P.HOLDING)
    chosen_ns = found.t_ns
    found.craft.command_mode("OFFBOARD")  # its GUIDED
    found.run(2 * S)
    assert "somebody else" in found.command(A.HOLD)
    assert "somebody else" in found.command(A.RESUME)
    found.run(2 * S)
    assert (found.since(chosen_ns), found.craft.mode) == ([], "OFFBOARD")


OTHER_WAY = {"line": "OFFBOARD", "inside": MISSION}


@EACH
@BOTH
@pytest.mark.parametrize("action, phase", [(A.HOLD, P.HOLDING), (A.RESUME, P.FLYING)], ids=["hold", "resume"])
def test_one_message_that_says_another_way_to_fly_neither_refuses_nor_ends_a_hold_or_resume(
    mission, kind, action, phase
):
    """The engine lands where its HOLD or RESUME is refused."""
    for asked_before in (False, True):
        found = flying(mission, kind)
        lies = Liar(found.planner, copter=kind is ARDUPILOT)
        if action is A.RESUME:
            assert found.command(A.HOLD) == ""
            found.until_phase(P.HOLDING)
        found.run(2 * S)
        answers = [found.command(action)] if asked_before else []
        found.channel.ours(lies.datagram(found.t_ns, ("mode", OTHER_WAY[mission])))
        assert found.planner.watch.mode == OTHER_WAY[mission]
        answers = answers or [found.command(action)]
        assert answers == [""]
        found.until_phase(phase, limit_ns=4 * S)
        found.run(2 * S)
        assert (found.phase, found.status.message) == (phase, "")


@pytest.mark.parametrize(
    "mission, kind",
    [("inside", PX4), ("inside", ARDUPILOT), ("line", ARDUPILOT)],  # a PX4 leaves OFFBOARD without set-points
    ids=["px4 by set-points", "ardupilot by set-points", "ardupilot by a mission"],
)
@pytest.mark.parametrize("action", [A.HOLD, A.RESUME], ids=["hold", "resume"])
def test_at_the_first_sign_of_another_way_to_fly_a_hold_or_resume_waits_and_then_fails(mission, kind, action):
    found, other = flying(mission, kind), OTHER_WAY[mission]
    assert found.command(A.HOLD) == ""
    found.until_phase(P.HOLDING)
    found.run(2 * S)
    found.craft.command_mode(other)
    found.until(lambda: found.planner.watch.mode == other, 2 * S)
    told_ns, words = found.t_ns, f"somebody else has chosen the flight mode (mode {other})"
    assert found.command(action) == ""
    found.run(1500 * MS)
    assert (found.status.message, found.command(action)) == (words, words)
    found.run(2 * S)
    assert (found.since(told_ns), found.craft.mode) == ([], other)


def test_whose_a_mode_is_that_nobody_here_commanded_is_asked_for_at_once():
    """A PX4 beats at 1 Hz: till then it seems to be a pilot's, and a planner that is told to end left the vehicle."""
    found = flying("inside")
    without_transmitter(found)
    found.run(4 * S)
    told_ns = by_mode(found, "POSCTL")
    found.until(lambda: found.planner.watch.failsafe, 200 * MS)
    asked = [each for at_ns, each in found.commands if at_ns >= told_ns]
    assert [(each.command, each.param1) for each in asked] == [(mavlink.MAV_CMD_REQUEST_MESSAGE, 0)]
    found.run(400 * MS)
    lands, messages = found.planner.shutdown(found.t_ns)
    found.channel.ours(messages)
    assert lands
    found.until(lambda: found.craft.mode == LAND, 2 * S)


@BOTH
@pytest.mark.parametrize("holds", [False, True], ids=["flies", "holds"])
def test_under_a_flag_that_is_up_already_a_hold_that_nobody_here_commanded_is_a_failsafe_s(mission, holds):
    """A warning of a low battery, and then a lost transmitter: PX4 holds, and returns."""
    found = flying(mission)
    Liar(found.planner).always(("status", CRITICAL))
    found.run(1500 * MS)
    if holds and mission == "inside":  # by the list PX4's hold is not told from ours
        assert found.command(A.HOLD) == ""
        found.until_phase(P.HOLDING)
        found.run(2 * S)
    found.craft.enter_failsafe(LOITER)
    found.run(2 * S)
    told_ns = found.t_ns
    assert [found.command(action) for action in (A.HOLD, A.RESUME)] == [FAILSAFE] * 2
    found.run(S)
    assert (found.since(told_ns), found.craft.mode) == ([], LOITER)
    assert found.command(A.LAND) == ""
    found.until_phase(P.LANDED)


def test_a_hold_by_set_points_is_not_commanded_over_that_of_a_failsafe():
    found = held("inside")
    found.craft.enter_failsafe(LOITER)
    found.run(2 * S)
    told_ns = found.t_ns
    assert found.command(A.HOLD) == FAILSAFE
    found.run(S)
    assert (found.since(told_ns), found.craft.mode) == ([], LOITER)


def test_a_resume_that_waits_ends_when_a_failsafe_holds():
    found = held("line")
    found.craft.flags.ignores = (MISSION,)
    assert found.command(A.RESUME) == ""
    found.run(S)
    found.craft.enter_failsafe(LOITER)
    found.until(lambda: found.planner.watch.failsafe, 2 * S)
    told_ns = found.t_ns
    found.run(3 * S)
    assert found.since(told_ns + 1) == []
    assert found.status.message == "resume ended: the autopilot acts by its failsafe (mode AUTO.LOITER)"


@EACH
@BOTH
def test_a_hold_that_is_ours_is_resumed_under_a_flag_that_was_up_before_it(mission, kind):
    """A warning of a low battery, of which nothing is made."""
    found = flying(mission, kind)
    Liar(found.planner, copter=kind is ARDUPILOT).always(("status", CRITICAL))
    found.run(1500 * MS)
    assert found.command(A.HOLD) == ""
    found.until_phase(P.HOLDING)
    found.run(2 * S)
    assert found.command(A.RESUME) == ""
    found.until_phase(P.FLYING)


@EACH
def test_told_to_end_it_says_whose_the_landing_is_when_a_pilot_takes_it(kind):
    found = flying(kind=kind)
    lands, messages = found.planner.shutdown(found.t_ns)
    found.channel.ours(messages)
    found.craft.flags.ignores = (LAND,)
    assert (lands, found.planner.landing_taken) == (True, "")
    found.craft.pilot_takes_over("POSCTL", 600 * S)
    found.until(lambda: found.planner.landing_shown, 4 * S)
    assert found.planner.landing_taken == "land ended: the vehicle went to POSCTL by itself"


@EACH
def test_a_vehicle_that_leaves_our_mission_for_a_hold_by_itself_is_landed_when_asked(kind):
    found = flying(kind=kind)
    found.craft.fall_into(LOITER)
    found.run(2 * S)
    assert found.command(A.LAND) == ""
    found.until_phase(P.LANDED)


def test_who_has_control_under_the_flag_is_told_by_the_mode_and_by_what_was_commanded():
    watch, control = VehicleWatch(), Control()
    assert (watch.pilot, watch.others_fly, control.acts_alone) == (False, False, False)
    control.command(LOITER)
    for mode in (MISSION, LOITER):
        control.add(Heartbeat(0, armed=True, mode=mode, status=CRITICAL, autopilot=12))
    assert (control.failsafe, control.acts_alone) == (True, False)


def test_a_pilot_who_returns_from_a_landing_of_the_autopilot_node_is_left_alone():
    bench = ClientBench().fly(20.0)
    bench.ask(bench.client.land)
    bench.until(lambda: bench.client.land_reply().final, 5.0)
    for mode in (RTL, POSCTL):
        bench.far.mode(mode)
        bench.until(lambda: bench.vehicle.control.pilot, 1.2)
        sent = landings(bench)
        bench.advance(2.0)
        assert landings(bench) == sent


# --- the flight mode alone is not heard -------------------------------------------------------------------------------

UNKNOWN = "the flight mode is not known"


def without(found, *names):
    """Have messages not come, while all else does; return what has them come again."""
    receive = found.planner.receive
    found.planner.receive = lambda t_ns, message, **how: (
        () if message.get_type() in names else receive(t_ns, message, **how)
    )

    def again():
        found.planner.receive = receive

    return again


def mute(found):
    """Have no message come that tells the flight mode."""
    return without(found, "HEARTBEAT", "CURRENT_MODE")


def flies_away(found, mode="POSCTL"):
    """Have a pilot take over, and fly somewhere else."""
    craft = found.craft
    plain = type(craft)

    class Piloted(plain):
        def _fly(self, end):
            if self.mode == mode:
                self._approach((-30.0, 20.0, 4.0), end)
            else:
                super()._fly(end)

    craft.__class__ = Piloted
    craft.pilot_takes_over(mode, 600 * S)
    return craft


@EACH
def test_a_flight_that_leaves_its_way_is_not_landed_by_itself_while_its_mode_is_not_heard(kind):
    """A pilot may have taken over; it is landed when the engine asks for it, as a vehicle that is silent."""
    found = flying("inside", kind)
    mute(found)
    found.run(500 * MS)
    craft, told_ns = flies_away(found), found.t_ns
    found.run(12 * S)
    assert (found.since(told_ns), craft.mode) == ([], "POSCTL")
    waits = "the local position stays away: it lands once its flight mode is heard"
    assert (found.phase, found.status.message) == (P.FAILED, f"{UNKNOWN}; {waits}")
    sent = len(found.channel.sent)
    found.run(S)
    assert "SET_POSITION_TARGET_LOCAL_NED" not in found.channel.sent[sent:]
    assert [found.command(action) for action in (A.HOLD, A.RESUME)] == [UNKNOWN] * 2
    assert found.command(A.LAND) == ""
    assert found.since(told_ns) == [LAND]


@EACH
def test_it_is_not_landed_when_the_mode_that_is_heard_again_is_a_pilot_s(kind):
    found = flying("inside", kind)
    again = mute(found)
    found.run(500 * MS)
    craft, told_ns = flies_away(found), found.t_ns
    found.run(4 * S)
    again()
    found.run(4 * S)
    assert (found.since(told_ns), craft.mode) == ([], "POSCTL")
    assert found.status.message == "the pilot has control (mode POSCTL)"


@EACH
def test_after_the_last_waypoint_it_waits_for_its_mode_and_lands_when_it_is_ours(kind):
    found = flying("inside", kind)
    found.until(lambda: found.planner._flight.reached == 2)
    again, told_ns = mute(found), found.t_ns
    found.until(lambda: "it lands once its flight mode is heard" in found.status.message)
    found.run(S)
    assert found.since(told_ns) == []
    again()
    found.until(lambda: LAND in found.since(told_ns), 1200 * MS)
    found.until_phase(P.LANDED)
    assert found.status.waypoint == found.status.waypoints


@EACH
def test_in_our_mode_a_vehicle_whose_mode_is_not_heard_is_not_left_for_ever(kind):
    """PX4 lands by its own failsafe without set-points; an ArduPilot stays, and is landed when its mode is heard."""
    found = Recorded(kind=kind, settings=Px4Settings(parameters={"COM_OBL_RC_ACT": 4}))
    found.take_off("inside")
    found.until(lambda: found.craft.position_m[0] > 2.0)
    again = mute(found)
    found.until(lambda: found.phase is P.FAILED)
    if kind is PX4:
        found.until(lambda: found.craft.mode == LAND, 3 * S)
        return
    found.run(5 * S)
    assert found.craft.mode == "OFFBOARD"
    again()
    found.until_phase(P.LANDED)


@EACH
@BOTH
def test_told_to_end_it_does_not_land_while_its_mode_is_not_heard(mission, kind):
    found = flying(mission, kind)
    again = mute(found)
    found.run(1500 * MS)
    found.craft.pilot_takes_over("POSCTL", 600 * S)
    told_ns = found.t_ns
    assert found.planner.shutdown(found.t_ns) == (True, [])
    found.run(3 * S)  # exit_limit_s
    assert (found.since(told_ns), found.planner.landing_shown) == ([], False)
    assert found.planner.landing_taken == "no landing was commanded: its flight mode is not known"
    again()
    found.until(lambda: found.planner.landing_shown, 3 * S)
    assert found.craft.mode == "POSCTL"


@EACH
@BOTH
def test_told_to_end_it_lands_when_the_mode_is_heard_anew_and_is_ours(mission, kind):
    found = flying(mission, kind)
    again = mute(found)
    found.run(1500 * MS)
    assert found.planner.shutdown(found.t_ns) == (True, [])
    found.run(S)
    again()
    found.until(lambda: found.craft.mode == LAND, 1500 * MS)
    assert found.planner.landing_taken == ""


def test_another_reason_for_a_landing_that_waits_does_not_make_it_wait_anew():
    watch = VehicleWatch()
    own = OwnLanding(watch, 3 * S)
    for number in range(30):
        own.want(S + number * S // 10, ("blind", "flown")[number % 2])
    assert (own.why, own.gives_up(3900 * MS), own.gives_up(4 * S), own.gives_up(5 * S)) == ("blind", False, True, False)
    own.want(5 * S, ENDS)
    own.want(6 * S, "blind")
    assert (own.why, own.gives_up(20 * S), own.is_due(20 * S)) == (ENDS, False, False)


@EACH
@BOTH
@pytest.mark.parametrize("action", [A.HOLD, A.RESUME])
def test_nothing_is_commanded_but_a_landing_where_the_mode_is_not_known(mission, kind, action):
    found = flying(mission, kind)
    if action is A.RESUME:
        assert found.command(A.HOLD) == ""
        found.until_phase(P.HOLDING)
        found.run(2 * S)
    mute(found)
    found.run(3200 * MS)
    told_ns = found.t_ns
    assert (found.command(action), found.status.message) == (UNKNOWN, UNKNOWN)
    found.run(S)
    assert found.since(told_ns) == []
    assert found.command(A.LAND) == ""
    found.until(lambda: found.craft.mode == LAND, S)


@EACH
def test_a_takeoff_is_refused_where_the_mode_is_not_known(kind):
    found = Recorded(kind=kind)
    assert found.load("line").accepted
    mute(found)
    found.run(3200 * MS)
    assert found.command(A.TAKEOFF) == UNKNOWN


def test_whether_it_is_armed_is_not_known_from_its_mode():
    found = flying("line")
    without(found, "HEARTBEAT")
    found.run(3500 * MS)
    assert found.planner.watch.mode == "AUTO.MISSION"
    assert found.command(A.HOLD) == found.status.message == "whether the vehicle is armed is not known"
    found.craft.pilot_takes_over("POSCTL", 600 * S)
    found.run(S)
    assert found.command(A.LAND) == "the pilot has control (mode POSCTL)"


@EACH
@BOTH
def test_a_hold_that_waits_ends_when_the_mode_is_not_heard_any_more(mission, kind):
    found = flying(mission, kind)
    found.craft.flags.ignores = (LOITER, "OFFBOARD")
    mute(found)
    found.run(2 * S)
    assert found.command(A.HOLD) == ""
    found.run(1500 * MS)
    assert UNKNOWN in found.status.message
    told_ns = found.t_ns
    found.run(3 * S)
    assert found.since(told_ns) == []


def test_a_heartbeat_that_is_late_is_asked_for():
    found = flying("line")
    beat_ns = found.planner.watch.heartbeat_ns
    again = without(found, "HEARTBEAT")
    found.run(1600 * MS)
    asked = [t_ns for t_ns, each in found.commands if each.command == mavlink.MAV_CMD_REQUEST_MESSAGE]
    assert asked
    assert asked[0] - beat_ns > 1300 * MS
    again()
    found.run(3 * S)
    last = [t_ns for t_ns, each in found.commands if each.command == mavlink.MAV_CMD_REQUEST_MESSAGE][-1]
    assert found.t_ns - last > 2 * S


@BOTH
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_fifth_of_all_messages_lost_ends_no_flight(mission, seed):
    """PX4 beats once a second."""
    chance = Random(seed)
    found = Recorded(fate=lambda: () if chance.random() < 0.2 else (chance.randrange(50) * MS,))
    found.run(3 * S)
    found.take_off(mission)
    seen = set()
    found.until(lambda: seen.add(found.status.message) or found.phase is P.LANDED)
    assert (found.status.waypoint, UNKNOWN in seen) == (found.status.waypoints, False)


def test_a_short_limit_makes_no_mode_unknown_between_two_heartbeats_of_a_px4():
    found = Recorded(spec=PlannerSpec(vehicle_age_limit_ns=S // 2))
    seen = set()
    found.until(lambda: seen.add(found.status.message), 4 * S, must=False)
    assert seen == {""}


# --- moved in the hold ------------------------------------------------------------------------------------------------

MOVED = "somebody else has moved it in the hold"


def goes_to(found, place):
    """Have a ground station send it somewhere in AUTO.LOITER (DO_REPOSITION); return what ends that."""
    craft, plain = found.craft, type(found.craft)

    class Sent(plain):
        def _fly(self, end):
            if self.mode == LOITER:
                self._approach(place, end)
            else:
                super()._fly(end)

    craft.__class__ = Sent

    def end():
        craft.__class__, craft._leg = plain, None

    return end


def test_from_a_place_to_which_somebody_has_sent_it_in_our_hold_nothing_is_resumed():
    found = held("line")
    end = goes_to(found, (-20.0, -15.0, 2.0))
    found.until(lambda: found.status.message == MOVED, 20 * S)
    found.run(5 * S)
    end()
    told_ns = found.t_ns
    assert (found.phase, found.command(A.RESUME)) == (P.HOLDING, MOVED)
    assert found.command(A.HOLD) == ""
    found.run(3 * S)
    assert (found.command(A.RESUME), found.status.message) == (MOVED, MOVED)
    assert MISSION not in found.since(told_ns)
    assert found.command(A.LAND) == ""
    found.until_phase(P.LANDED)


@EACH
@BOTH
def test_a_hold_in_a_gust_is_resumed_and_held_again_somewhere_else(mission, kind):
    found = flying(mission, kind)
    for east_m in (3.0, 7.0):
        found.until(lambda east_m=east_m: found.craft.position_m[0] > east_m)
        assert found.command(A.HOLD) == ""
        found.until_phase(P.HOLDING)
        found.run(4 * S)
        east, north, up = found.craft.position_m
        end = goes_to(found, (east - 2.0, north + 2.5, up + 1.0))
        found.run(4 * S)
        end()
        found.run(S)
        assert (found.status.message, found.command(A.RESUME)) == ("", "")
        found.until_phase(P.FLYING)
    found.until_phase(P.LANDED)
    assert found.status.waypoint == 3


def test_a_position_or_two_that_are_far_away_for_a_moment_are_no_move():
    found = held("line")
    take, lies = found.planner.watch.take, []

    def lying(t_ns, message, **how):
        if message.get_type() == "LOCAL_POSITION_NED" and len(lies) < 5:
            lies.append(message)
            message.x += 30.0
        take(t_ns, message, **how)

    found.planner.watch.take = lying
    found.run(3 * S)
    assert (len(lies), found.status.message, found.command(A.RESUME)) == (5, "", "")


def test_where_it_comes_to_rest_is_what_counts_not_where_it_was_told_to_hold():
    found = Recorded()
    found.take_off("line")
    found.until(lambda: found.craft.position_m[0] > 1.5)
    told_m = found.craft.position_m
    end = goes_to(found, (told_m[0] + 6.0, told_m[1], told_m[2]))  # as a fast vehicle brakes
    assert found.command(A.HOLD) == ""
    found.run(6 * S)
    end()
    assert found.craft.position_m[0] - told_m[0] > 5.0
    assert (found.status.message, found.command(A.RESUME)) == ("", "")


@EACH
def test_moved_while_a_resume_waits_for_its_reading_it_does_not_go_on_from_the_new_place(kind):
    """Somebody sends it away just before the RESUME: too late to be noticed when that is admitted."""
    found = Recorded(kind=kind)
    take = found.planner.watch.take

    def without_id(t_ns, message, **how):
        if message.get_type() == "MISSION_CURRENT":
            message.mission_id = 0
        take(t_ns, message, **how)

    found.planner.watch.take = without_id
    found.take_off("line")
    found.until(lambda: found.craft.position_m[0] > 2.0)
    assert found.command(A.HOLD) == ""
    found.until_phase(P.HOLDING)
    found.run(8 * S)
    again, end = without(found, "MISSION_COUNT"), goes_to(found, (-20.0, -15.0, 2.0))
    found.run(S)
    told_ns = found.t_ns
    assert found.command(A.RESUME) == ""
    found.until(lambda: found.status.message == MOVED, 2 * S)
    again()
    found.run(6 * S)
    end()
    assert (found.phase, found.status.message, found.command(A.RESUME)) == (P.HOLDING, MOVED, MOVED)
    assert found.since(told_ns) == []


@pytest.mark.parametrize("beat_ms", [0, 400, 700])
@pytest.mark.parametrize("wait_ms", [100, 1500, 1800])
@pytest.mark.slow_rows
def test_a_hold_soon_after_a_resume_is_another_hold_where_heartbeats_alone_tell_the_mode(wait_ms, beat_ms):
    """A PX4 beats once a second: one heartbeat, or none, has told that it flew on."""
    far = Trajectory("far.csv", (Waypoint(0.0, 0.0, 2.0, 0.0, 0.5), Waypoint(200.0, 0.0, 2.0, 0.0, 0.5)))
    found = Recorded(plans=(plan("far", (far,), Controller.MISSION),))
    found.take_off("far")
    found.until(lambda: found.craft.position_m[0] > 5.0)
    without(found, "CURRENT_MODE")
    for _ in range(2):
        assert found.command(A.HOLD) == ""
        found.until_phase(P.HOLDING)
        found.run(6 * S + beat_ms * MS)
        assert (found.status.message, found.command(A.RESUME)) == ("", "")
        found.run(wait_ms * MS)
    assert found.command(A.HOLD) == ""
    found.run(6 * S)
    end = goes_to(found, (-20.0, -15.0, 2.0))
    found.until(lambda: found.status.message == MOVED, 20 * S)
    end()
    assert found.command(A.RESUME) == MOVED


# --- home set anew in the air -----------------------------------------------------------------------------------------

LOWER = "home was set anew in the air: heights count from 1.8 m lower"
HILL = Trajectory(
    "hill.csv", tuple(Waypoint(25.0 * number, 0.0, 2.0 + 8.0 * (number % 2), 0.0, 0.5) for number in range(1, 6))
)
HILLS = (plan("hill", (HILL,), Controller.MISSION),)
FAR = Trajectory("far.csv", (Waypoint(5.0, 0.0, 3.0, 0.0, 0.5), Waypoint(900.0, 0.0, 3.0, 0.0, 0.5)))


def sets_home(found, up_m, *, moves=True):
    """Have a ground station set home in the air (DO_SET_HOME); or, where it stays, the autopilot correct its height."""
    east_m, north_m, _ = found.craft.position_m if moves else (0.0, 0.0, 0.0)
    found.craft.home = found.craft.geography.place(east_m, north_m, up_m)


def changes(found, change):
    """Have messages of the vehicle be changed before the planner takes them."""
    take = found.planner.watch.take

    def changed(t_ns, message, **how):
        change(t_ns, message)
        take(t_ns, message, **how)

    found.planner.watch.take = changed


def says(found, until):
    """Return what the planner says meanwhile."""
    said = set()
    found.until(lambda: said.add(found.status.message) or until())
    return said


@EACH
@pytest.mark.parametrize("up_m, words", [(-1.8, LOWER), (1.9, LOWER.replace("1.8 m lower", "1.9 m higher"))])
def test_in_a_hold_in_which_home_was_set_anew_nothing_is_resumed(kind, up_m, words):
    found = held("line", kind)
    found.run(2 * S)
    assert found.status.message == ""
    sets_home(found, up_m)
    found.until(lambda: found.status.message == words, 2 * S)
    told_ns = found.t_ns
    assert (found.phase, found.command(A.RESUME)) == (P.HOLDING, words)
    assert found.command(A.HOLD) == ""
    sets_home(found, 0.0)
    found.run(5 * S)
    assert (found.command(A.RESUME), MISSION in found.since(told_ns)) == (words, False)
    assert found.command(A.LAND) == ""
    found.until_phase(P.LANDED)


@EACH
@pytest.mark.parametrize("resumed", [False, True], ids=["flies", "resumes"])
def test_a_mission_whose_home_was_set_anew_in_the_air_is_given_up(kind, resumed):
    found = Recorded(plans=HILLS, kind=kind)
    found.take_off("hill")
    found.until(lambda: found.craft.position_m[0] > 10.0)
    if resumed:
        assert found.command(A.HOLD) == ""
        found.until_phase(P.HOLDING)
        found.run(4 * S)
    sets_home(found, -1.8)
    if resumed:
        assert found.command(A.RESUME) == ""
    found.until(lambda: found.phase is P.FAILED, 4 * S)
    assert found.status.message == LOWER
    assert found.command(A.LAND) == ""
    found.until_phase(P.LANDED)


def on_the_earth(home):
    return mavlink.MAVLink_home_position_message(home.lat, home.lon, home.alt_mm, 0.0, 0.0, 0.0, [1, 0, 0, 0], 0, 0, 0)


def on_its_topic(_):
    """Return home as mavros has it on its topic, of an ArduPilot, which tells no place of it in its local frame."""
    return mavlink.MAVLink_home_position_message(0, 0, 0, 0.0, 0.0, 0.0, [1, 0, 0, 0], 0, 0, 0)


def behind_mavros(found, *homes, place_s=0.0):
    """Have it say no time and no height above the sea, and home by turns as each of these says it.

    The height above home is that of the message before: mavros publishes it after the place.
    """
    receive, beats, last = found.planner.receive, [], SimpleNamespace(ns=0, height=0)

    def told(t_ns, message, **how):
        kind, sent = message.get_type(), []
        if kind in ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"):
            message.time_boot_ms = 0
        if kind == "GLOBAL_POSITION_INT":
            if t_ns - last.ns < place_s * S - 10 * MS:
                return ()
            message.alt, message.relative_alt, last.height = 0, last.height, message.relative_alt
            last.ns = t_ns
        if kind == "HEARTBEAT" and homes:
            beats.append(t_ns)
            sent += receive(t_ns, homes[len(beats) % len(homes)](found.craft.home), **how)
        return [*sent, *(() if kind == "HOME_POSITION" else receive(t_ns, message, **how))]

    found.planner.receive = told


@pytest.mark.parametrize("moves", [False, True], ids=["its height", "its place as well"])
@pytest.mark.parametrize("homes", [(on_its_topic, on_the_earth), (on_the_earth, on_its_topic)])
def test_behind_mavros_home_that_is_told_in_two_ways_has_not_moved_from_one_to_the_other(homes, moves):
    found = Recorded(plans=(plan("far", (FAR,), Controller.MISSION),), kind=ARDUPILOT)
    behind_mavros(found, *homes)
    found.take_off("far")
    found.until(lambda: found.craft.position_m[0] > 40.0)
    sets_home(found, -1.8, moves=moves)
    found.run(8 * S)
    assert (found.phase, found.status.message) == (P.FAILED if moves else P.FLYING, LOWER)


@EACH
@pytest.mark.parametrize("climb_m_s", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("place_s", [0.2, 1.0, 2.0])
@pytest.mark.slow_rows
def test_behind_mavros_a_height_that_is_of_the_place_before_is_no_home_that_was_set_anew(
    kind, climb_m_s, place_s, monkeypatch
):
    model = FlightModel(cruise_speed_m_s=4.0, climb_speed_m_s=climb_m_s, landing_speed_m_s=0.5, acceleration_m_s2=4.0)
    monkeypatch.setattr(import_module("flying"), "MODEL", model)
    steep = tuple(Waypoint(3.0 * number, 0.0, 2.0 + 8.0 * (number % 2), 0.0, 1.0) for number in range(1, 4))
    found = Recorded(plans=(plan("steep", (Trajectory("steep.csv", steep),), Controller.MISSION),), kind=kind)
    behind_mavros(found, place_s=place_s)
    found.take_off("steep")
    assert says(found, lambda: found.phase is P.LANDED) == {""}
    assert found.status.waypoint == 3


@EACH
def test_behind_mavros_home_that_is_set_anew_is_noticed_where_the_place_comes_once_a_second(kind):
    found = Recorded(kind=kind)
    behind_mavros(found, place_s=1.0)
    found.take_off("line")
    found.until(lambda: found.craft.position_m[0] > 2.0)
    assert found.command(A.HOLD) == ""
    found.run(6 * S)
    sets_home(found, -1.8)
    found.until(lambda: found.status.message.startswith("home was set anew in the air"), 4 * S)
    assert found.command(A.RESUME) == found.status.message


def test_by_set_points_heights_are_local_and_home_is_nobody_s_business():
    found = flying("inside")
    sets_home(found, -5.0)
    assert says(found, lambda: found.phase is P.LANDED) == {""}


def test_a_px4_that_corrects_the_height_of_its_home_in_its_first_two_minutes_flies_on_but_is_not_resumed():
    found = Recorded(plans=(plan("far", (FAR,), Controller.MISSION),))
    found.take_off("far")
    found.until(lambda: found.craft.position_m[0] > 20.0)
    sets_home(found, -1.8, moves=False)
    found.run(20 * S)
    assert (found.phase, found.status.message) == (P.FLYING, LOWER)
    assert found.command(A.HOLD) == ""
    found.until_phase(P.HOLDING)
    assert found.command(A.RESUME) == LOWER


def refuses_modes(found):
    """Have the vehicle refuse every change of its mode."""
    take, refused = found.vehicle.take, mavlink.MAV_RESULT_DENIED

    def refusing(t_ns, message):
        if message.get_type() == "COMMAND_LONG" and message.command == SET_MODE:
            return [mavlink.MAVLink_command_ack_message(SET_MODE, refused)]
        return take(t_ns, message)

    found.vehicle.take = refusing


@EACH
@pytest.mark.parametrize("by_us, wait_ms, words", [(True, 8000, "DENIED"), (False, 300, "the autopilot node commands")])
def test_the_words_about_home_do_not_hide_why_it_is_landed_or_why_it_does_not_land(kind, by_us, wait_ms, words):
    found = held("line", kind)
    sets_home(found, -1.8)
    found.until(lambda: found.status.message == LOWER, 3 * S)
    refuses_modes(found)
    if by_us:
        assert found.command(A.LAND) == ""
    else:
        found.channel.ours(found.planner.other_commands(found.t_ns, LAND))
    found.run(wait_ms * MS)
    said = says(found, lambda end_ns=found.t_ns + S: found.t_ns >= end_ns)
    assert [each for each in said if words not in each] == []


def test_later_no_px4_corrects_the_height_of_its_home():
    found = Recorded(plans=(plan("far", (FAR,), Controller.MISSION),))
    found.take_off("far")
    found.run(150 * S)
    assert found.phase is P.FLYING
    sets_home(found, -1.8, moves=False)
    found.until(lambda: found.phase is P.FAILED, 4 * S)


@EACH
@pytest.mark.parametrize("late_ms", [50, 600])
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.slow_rows
def test_lost_and_late_messages_are_no_home_that_was_set_anew(kind, late_ms, seed):
    found, chance = Recorded(plans=HILLS, kind=kind), Random(seed)
    found.take_off("hill")
    found.until(lambda: found.craft.armed)

    def bad():
        return () if chance.random() < 0.15 else (chance.randrange(late_ms) * MS,)

    found.channel.fate = bad
    said = says(found, lambda: found.craft.position_m[0] > 30.0)
    assert found.command(A.HOLD) == ""
    found.run(6 * S)
    found.join()  # for the reading of the mission, which has a limit
    found.run(3 * S)
    assert found.command(A.RESUME) == ""
    found.run(3 * S)
    found.channel.fate = bad
    said |= says(found, lambda: found.phase is P.LANDED)
    assert (found.status.waypoint, [each for each in said if "home" in each]) == (5, [])


@pytest.mark.parametrize("sea", [True, False], ids=["height above the sea", "none, as behind mavros"])
@EACH
def test_what_the_estimate_does_is_no_home_that_was_set_anew(kind, sea):
    """It is reset by 6 m, drifts, and its height above the sea may come from another sensor."""
    found = Recorded(plans=HILLS, kind=kind)
    found.take_off("hill")
    found.until(lambda: found.craft.position_m[0] > 5.0)
    begun_ns = found.t_ns

    def estimates(t_ns, message):
        up_m = 6.0 if t_ns - begun_ns > 3 * S else 0.0
        drift_m = (t_ns - begun_ns) / S * (0.1 if sea else 0.03)  # of the local frame alone
        if message.get_type() == "LOCAL_POSITION_NED":
            message.z -= up_m + drift_m
        if message.get_type() == "GLOBAL_POSITION_INT":
            message.relative_alt += round(1000 * up_m)
            message.alt = message.alt + (30_000 if t_ns - begun_ns > 6 * S else 0) if sea else 0
        if not sea and message.get_type() in ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"):
            message.time_boot_ms = 0

    changes(found, estimates)
    assert says(found, lambda: found.phase is P.LANDED) == {""}
    assert found.status.waypoint == 5


@EACH
def test_a_few_wrong_heights_are_no_home_that_was_set_anew(kind):
    found, lies = held("line", kind), []

    def lying(_, message):
        if message.get_type() == "GLOBAL_POSITION_INT" and len(lies) < 5:
            lies.append(message)
            message.relative_alt += 5000

    changes(found, lying)
    found.run(4 * S)
    assert (len(lies), found.status.message, found.command(A.RESUME)) == (5, "", "")


@EACH
def test_one_message_that_says_on_ground_does_not_have_the_home_of_before_forgotten(kind):
    """Home is set anew in the same second: it would be taken for the one that is right."""
    found, lies = held("line", kind), []
    found.run(2 * S)

    def lying(_, message):
        if message.get_type() == "EXTENDED_SYS_STATE" and not lies:
            lies.append(message)
            message.landed_state = mavlink.MAV_LANDED_STATE_ON_GROUND

    changes(found, lying)
    found.until(lambda: lies, S)
    sets_home(found, -1.8)
    found.run(4 * S)
    assert (found.phase, found.status.message, found.command(A.RESUME)) == (P.HOLDING, LOWER, LOWER)


def test_a_px4_sets_its_home_once_more_when_it_notices_that_it_has_lifted_off():
    found = Recorded()
    found.take_off("line")
    found.until(lambda: found.craft.airborne)
    sets_home(found, 1.4)
    assert says(found, lambda: found.phase is P.FLYING and found.craft.position_m[0] > 3.0) == {""}
    assert found.command(A.HOLD) == ""
    found.run(4 * S)
    assert found.command(A.RESUME) == ""


def test_a_planner_that_is_started_in_flight_knows_no_home_that_was_before():
    found = flying("line")
    found.planner = Sequencer(SequencerSettings(PLANS, PlannerSpec(), MODEL, LIMITS))
    found.channel.client = found.planner
    found.run(2 * S)
    sets_home(found, -1.8)
    assert says(found, lambda: not found.craft.armed) == {""}


# --- another item of the mission chosen in the hold -------------------------------------------------------------------

CHOSEN = "somebody else has chosen another item of the mission in the hold"


def chooses(found, number):
    """Have a ground station set the current item (MISSION_SET_CURRENT)."""
    found.vehicle.px4.connect("ground station")
    found.vehicle.px4.receive(found.t_ns, "ground station", mavlink.MAVLink_mission_set_current_message(1, 1, number))


def item_of(found, waypoint):
    """Return the item of a waypoint, from 0; behind the last, the landing."""
    return 2 * waypoint + 2 if isinstance(found.craft, ArduCraft) else waypoint + 1


@EACH
@pytest.mark.parametrize("waypoint", [0, 2, 3], ids=["passed", "last", "landing"])
def test_with_another_item_that_somebody_has_chosen_in_our_hold_nothing_is_resumed(kind, waypoint):
    found = held("line", kind)
    found.run(2 * S)
    assert (found.status.message, found.status.waypoint) == ("", 2)
    chooses(found, item_of(found, waypoint))
    found.until(lambda: found.status.message == CHOSEN, 2 * S)
    told_ns = found.t_ns
    assert (found.phase, found.command(A.RESUME), found.status.waypoint) == (P.HOLDING, CHOSEN, 2)
    assert found.command(A.HOLD) == ""
    found.run(3 * S)
    assert (found.command(A.RESUME), MISSION in found.since(told_ns)) == (CHOSEN, False)
    assert found.command(A.LAND) == ""
    found.until_phase(P.LANDED)
    assert found.status.waypoint == 1


def seldom(found, gap_ns):
    """Have MISSION_CURRENT come on a change and else so seldom, as behind mavros: with each pull of the mission."""
    receive, last = found.planner.receive, SimpleNamespace(ns=-gap_ns, item=None)

    def thinned(t_ns, message, **how):
        if message.get_type() == "MISSION_CURRENT":
            if t_ns - last.ns < gap_ns and message.seq == last.item:
                return ()
            last.ns, last.item = t_ns, message.seq
        return receive(t_ns, message, **how)

    found.planner.receive = thinned


@EACH
@pytest.mark.parametrize("gap_s", [2.5, 3.5, 6.0])
def test_where_the_item_is_told_seldom_another_one_that_somebody_has_chosen_is_noticed_as_well(kind, gap_s):
    found = flying(kind=kind)
    seldom(found, round(gap_s * S))
    assert found.command(A.HOLD) == ""
    found.run(15 * S)
    assert (found.phase, found.status.message) == (P.HOLDING, "")
    chooses(found, item_of(found, 2))
    found.until(lambda: found.status.message == CHOSEN, round(2 * gap_s * S))
    assert found.command(A.RESUME) == CHOSEN


@EACH
def test_where_the_item_is_told_seldom_the_one_of_another_hold_says_nothing_of_this_one(kind):
    found = flying(kind=kind)
    seldom(found, 3500 * MS)
    for _ in range(2):
        assert found.command(A.HOLD) == ""
        found.run(9 * S)
        assert (found.phase, found.status.message, found.command(A.RESUME)) == (P.HOLDING, "", "")
        found.run(2 * S)
    assert says(found, lambda: found.phase is P.LANDED) == {""}
    assert found.status.waypoint == 3


@EACH
def test_an_item_that_somebody_chooses_just_before_a_resume_is_not_flown_to(kind):
    found = held("line", kind)
    found.run(2 * S)
    chooses(found, item_of(found, 3))
    found.until(lambda: found.planner.watch.current == item_of(found, 3), S)
    told = found.command(A.RESUME)
    found.run(3 * S)
    assert told == ""
    assert found.status.message == CHOSEN or (found.phase, found.status.waypoint) == (P.FLYING, 2)


@EACH
@pytest.mark.parametrize("late_ms", [50, 600])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.slow_rows
def test_a_waypoint_that_is_passed_as_it_is_held_is_nobody_s_choice(kind, late_ms, seed):
    """What it says may be lost or late, and each hold begins at another place of the way."""
    close = tuple(Waypoint(1.5 * number, 0.0, 2.0, 0.0, 0.0) for number in range(1, 20))
    plans = (plan("close", (Trajectory("close.csv", close),), Controller.MISSION),)
    found, chance, said = Recorded(plans=plans, kind=kind), Random(seed), set()
    found.take_off("close")
    found.until(lambda: found.craft.position_m[0] > 1.0)
    for _ in range(4):
        found.channel.fate = lambda: () if chance.random() < 0.15 else (chance.randrange(late_ms) * MS,)
        found.run(chance.randrange(2000) * MS)
        assert found.command(A.HOLD) == ""
        end_ns = found.t_ns + 4 * S
        said |= says(found, lambda end_ns=end_ns: found.t_ns >= end_ns)
        found.join()
        if found.phase is P.FLYING:  # a command of the RESUME before it has overtaken it: the engine asks again
            assert found.command(A.HOLD) == ""
        found.run(3 * S)
        assert (found.phase, found.command(A.RESUME)) == (P.HOLDING, "")
        found.run(2 * S)
    said |= says(found, lambda: found.phase is P.LANDED)
    assert (found.status.waypoint, CHOSEN in said) == (19, False)


def test_one_message_that_says_another_item_is_nobody_s_choice():
    found, lies = held("line"), []
    found.run(2 * S)

    def lying(_, message):
        if message.get_type() == "MISSION_CURRENT" and not lies:
            lies.append(message)
            message.seq = 4

    changes(found, lying)
    found.run(3 * S)
    assert (len(lies), found.status.message, found.command(A.RESUME)) == (1, "", "")
    found.until_phase(P.LANDED)
    assert found.status.waypoint == 3


# --- told to end ------------------------------------------------------------------------------------------------------


def given_up(kind):
    """Return a flight by set-points whose landing was given up, since its mode is not heard; what has it heard again.

    A PX4 stays in OFFBOARD without set-points as well, as an ArduPilot.
    """
    found = Recorded(kind=kind, settings=Px4Settings(parameters={"COM_OF_LOSS_T": 60.0}))
    found.take_off("inside")
    found.until(lambda: found.craft.position_m[0] > 2.0)
    again = mute(found)
    blind = without(found, "LOCAL_POSITION_NED")
    found.until(lambda: found.phase is P.FAILED, 12 * S)

    def all_again():
        blind()
        again()

    return found, all_again


@EACH
def test_told_to_end_with_a_landing_given_up_that_is_wanted_still_it_waits_and_says_that_none_was_commanded(kind):
    found, _ = given_up(kind)
    told_ns = found.t_ns
    assert found.planner.shutdown(found.t_ns) == (True, [])
    found.run(3 * S)  # exit_limit_s
    assert (found.since(told_ns), found.planner.landing_waits, found.planner.landing_shown) == ([], True, False)
    assert found.planner.landing_taken == "no landing was commanded: its flight mode is not known"


@EACH
def test_told_to_end_with_a_landing_given_up_it_lands_once_its_mode_is_heard_and_is_ours(kind):
    found, again = given_up(kind)
    assert found.planner.shutdown(found.t_ns) == (True, [])
    again()
    found.until(lambda: not found.planner.landing_waits, 1500 * MS)
    assert (found.planner.landing_shown, found.planner.landing_taken) == (False, "")
    found.until(lambda: found.planner.landing_shown, 3 * S)
    assert (found.craft.mode, found.planner.landing_taken) == (LAND, "")


@EACH
def test_told_to_end_with_a_landing_given_up_it_commands_nothing_where_a_pilot_flies_by_then(kind):
    found, again = given_up(kind)
    assert found.planner.shutdown(found.t_ns) == (True, [])
    told_ns = found.t_ns
    found.craft.pilot_takes_over("POSCTL", 600 * S)
    again()
    found.until(lambda: found.planner.landing_shown, 4 * S)
    assert (found.since(told_ns), found.craft.mode) == ([], "POSCTL")
    assert "POSCTL" in found.planner.landing_taken


def leave(found, exit_s=3.0):
    """End as the node does, which stays so long for a landing."""
    module = import_module("amaze_autonomy.nodes.vehicle.mission_planner_node")

    def wait_for(condition, limit_s):
        found.until(condition, round(limit_s * S), must=False)
        return condition()

    def ask(question):
        answer, messages = question(found.t_ns)
        found.channel.ours(messages)
        return answer

    told = []
    node = module.MissionPlannerNode.__new__(module.MissionPlannerNode)
    node.planner, node._exit_s, node._link = found.planner, exit_s, SimpleNamespace(ask=ask, wait_for=wait_for)
    node._clock, node._publisher = SimpleNamespace(ros_ns=lambda: 0), SimpleNamespace(publish=told.append)
    node._leave()
    return [(MissionPhase(each.phase), each.waypoint, each.message) for each in told]


def test_what_the_node_says_at_its_end_is_what_became_of_the_landing_that_was_given_up(capsys):
    pytest.importorskip("rospy")
    found, _ = given_up(PX4)
    assert leave(found) == []
    said = "mission_planner: ended in flight: no landing was commanded: its flight mode is not known\n"
    assert capsys.readouterr().out == said


def test_what_the_node_says_at_its_end_is_that_it_took_an_arming_back(capsys):
    pytest.importorskip("rospy")
    found = Recorded()
    found.take_off("line")
    found.until(lambda: "arm" in found.since(0), 20 * S)
    assert leave(found) == [(P.LANDING, 0, "the planner ends: it disarms")]
    assert capsys.readouterr().out == "mission_planner: ended on the ground: the vehicle is disarmed\n"
    assert not found.craft.armed


def test_what_the_node_says_at_its_end_is_that_it_disarms_also_where_the_vehicle_spins_up_for_long(capsys):
    pytest.importorskip("rospy")
    found = Recorded()
    found.take_off("line")
    found.until(lambda: found.craft.armed and found.craft.mode == MISSION)
    found.craft._lift_at = found.craft.t_ns + 60 * S
    found.run(3500 * MS)
    assert leave(found) == [(P.LANDING, 0, "the planner ends: it disarms")]
    assert capsys.readouterr().out == "mission_planner: ended on the ground: the vehicle is disarmed\n"


def test_what_the_node_says_at_its_end_does_not_hide_why_a_takeoff_has_failed():
    pytest.importorskip("rospy")
    found = Recorded()
    send = found.channel.ours

    def lost(messages):
        send([each for each in messages if not (each.get_type() == "COMMAND_LONG" and each.command == ARM)])

    found.channel.ours = lost
    found.take_off("line")
    found.until(lambda: found.phase is P.FAILED, 20 * S)
    ((phase, _, words),) = leave(found)
    assert phase is P.FAILED
    assert words.startswith("arm: not shown within")


@pytest.mark.parametrize("late_ms, said", [(5, "the vehicle is disarmed"), (1500, "")])
def test_the_node_stays_for_an_arming_that_may_be_late_also_where_it_stays_shorter_for_a_landing(late_ms, said, capsys):
    pytest.importorskip("rospy")
    found = Recorded()
    send = found.channel.ours

    def slow(messages):
        for message in messages:
            arms = message.get_type() == "COMMAND_LONG" and message.command == ARM and message.param1 == 1.0
            found.channel.fate = (lambda: (late_ms * MS,)) if arms else good
            send([message])
            found.channel.fate = good

    found.channel.ours = slow
    found.take_off("line")
    found.until(lambda: "arm" in found.since(0), 20 * S)
    leave(found, exit_s=1.0)
    assert capsys.readouterr().out.startswith(f"mission_planner: ended on the ground: {said}")
    found.planner.receive = found.planner.wake = lambda *_, **__: []  # its process has ended
    found.run(3 * S)
    assert (found.craft.armed, found.craft.height_m) == (False, 0.0)


@pytest.mark.parametrize("wait_ms", [1350, 1500])
def test_what_the_node_says_when_it_lifts_off_as_it_ends_is_that_it_lands_so_that_nobody_takes_it_for_a_pilot(
    wait_ms, capsys
):
    """The ground that it still hears is that of 0.2 s ago: the disarming is refused, the landing mode follows."""
    pytest.importorskip("rospy")
    found = Recorded()
    found.take_off("line")
    found.until(lambda: "arm" in found.since(0), 20 * S)
    found.channel.fate = lambda: (200 * MS,)
    found.until(lambda: found.craft.mode == MISSION and found.craft.armed)
    found.run(wait_ms * MS)
    told_ns = found.t_ns
    said = leave(found)
    assert found.since(told_ns)[:2] == ["disarm", LAND]
    assert said == [(P.LANDING, 0, f"the planner ends: it {does}") for does in ("disarms", "lands")]
    assert capsys.readouterr().out == "mission_planner: ended in flight: the vehicle lands\n"
    assert found.craft.mode == LAND


def test_what_the_node_says_at_its_end_is_no_waypoint_that_was_not_reached():
    """A landing at the last waypoint is the end of the mission."""
    pytest.importorskip("rospy")
    found = flying("line")
    found.until(lambda: found.status.waypoint == 3)
    assert leave(found) == [(P.LANDING, 2, "the planner ends: it lands")]


# --- after our flight, and before it ----------------------------------------------------------------------------------


@EACH
@BOTH
@pytest.mark.parametrize("landed_by_command", [True, False])
def test_who_takes_off_with_a_ground_station_after_our_flight_is_never_landed(kind, mission, landed_by_command):
    """Where the link was cut meanwhile nobody has heard it armed on the ground; but our flight was over for long."""
    flown = Recorded(kind=kind)
    flown.take_off(mission)
    flown.until_phase(P.FLYING)
    if landed_by_command:
        flown.run(S)
        assert flown.command(A.LAND) == ""
    flown.until_phase(P.LANDED)
    flown.run(LIMITS.confirm_limit_ns + S)
    flown.cut()
    craft = flown.craft
    craft.command_mode("OFFBOARD" if kind is ARDUPILOT else LOITER)
    assert craft.arm() == ""
    craft.climb_to(10.0)
    flown.run(15 * S)
    joined_ns, sent = flown.t_ns, []
    send = flown.channel.ours
    flown.channel.ours = lambda messages: sent.extend(messages) or send(messages)
    flown.join()
    flown.run(10 * S)
    setpoints = [each for each in sent if each.get_type().startswith("SET_POSITION")]
    assert (flown.since(joined_ns), setpoints, flown.phase) == ([], [], P.LANDED)
    assert craft.height_m > 2.0


def test_a_mission_that_is_replaced_while_ours_is_read_before_the_takeoff_is_not_flown():
    """A ground station uploads beside ours and activates it at once; what was read of it by then was ours."""
    way = Trajectory("long.csv", tuple(Waypoint(i % 2 * 6.0, i * 0.2, 2.0, 0.0, 0.0) for i in range(30)))
    flown = Recorded(fate=lambda: (40 * MS,), plans=(plan("long", (way,), Controller.MISSION),))
    flown.load("long")
    flown.run(3 * S)
    assert flown.command(A.TAKEOFF) == ""
    flown.until(lambda: flown.planner._verification and len(flown.planner._verification._read) == 4)
    items = tuple(replace(each, z=25.0) if number == 2 else each for number, each in enumerate(flown.craft.items))
    flown.vehicle.px4.missions._stores[0] = items
    flown.craft.load_items(items, 0)
    flown.until_phase(P.FAILED)
    assert "the mission did not read back as it was sent" in flown.status.message
    flown.run(5 * S)
    assert (flown.craft.height_m, flown.craft.armed) == (0.0, False)


def test_a_mission_that_only_gets_another_number_while_it_is_read_is_read_again_and_flown():
    flown = Recorded()
    flown.load("line")
    flown.run(3 * S)
    assert flown.command(A.TAKEOFF) == ""
    flown.until(lambda: flown.planner._verification and len(flown.planner._verification._read) == 1)
    flown.craft.load_items(flown.craft.items, 0)
    flown.until_phase(P.LANDED)
    assert flown.status.waypoint == 3


def test_a_failsafe_that_holds_the_vehicle_as_it_arms_is_not_flown_over():
    """The engine takes its hold for the failsafe's and commands nothing more: nobody would supervise that flight."""
    flown = Recorded()
    flown.load("line")
    assert flown.command(A.TAKEOFF) == ""
    flown.until(lambda: flown.craft.armed)
    armed_ns = flown.t_ns
    flown.craft.enter_failsafe(LOITER)
    flown.run(10 * S)
    assert flown.craft.height_m == 0.0
    assert MISSION not in flown.since(armed_ns)
    assert not flown.craft.armed
    assert "failsafe" in flown.status.message


def test_who_flies_after_a_takeoff_of_ours_that_was_refused_is_never_landed():
    """The takeoff has FAILED on the ground; minutes later somebody flies the same vehicle by himself."""
    flown = Recorded()
    flown.craft.flags.not_ready["rc"] = "no RC"
    flown.load("line")
    assert flown.command(A.TAKEOFF) == ""
    flown.until_phase(P.FAILED)
    flown.run(LIMITS.confirm_limit_ns + 6 * S)
    flown.craft.flags.not_ready.clear()
    flown.craft.command_mode(LOITER)
    assert flown.craft.arm() == ""
    flown.craft.climb_to(10.0)
    begun_ns = flown.t_ns
    flown.run(10 * S)
    assert (flown.phase, flown.status.message[:4], flown.craft.height_m > 5.0) == (P.FAILED, "arm:", True)
    assert leave(flown) == []
    flown.run(5 * S)
    assert (flown.since(begun_ns), flown.craft.height_m > 5.0) == ([], True)


@EACH
def test_a_landing_of_our_own_is_told_as_it_is_sent(kind):
    """A planner that stands still just after it would else seem to have been taken over by a pilot's AUTO.LAND."""
    flown = flying("inside", kind)
    flown.until(lambda: LAND in flown.since(0))
    flown.cut()  # of what it sends, nothing has come yet
    assert (flown.phase, flown.planner.watch.mode) == (P.LANDING, "OFFBOARD")
    flown.join()
    flown.run(S)
    assert (flown.phase, flown.planner.watch.mode) == (P.LANDING, LAND)
    flown.until_phase(P.LANDED)


@EACH
def test_a_landing_of_our_own_that_the_vehicle_does_not_take_is_not_said_for_long(kind):
    flown = flying("inside", kind)
    flown.craft.flags.ignores = (LAND,)
    flown.until(lambda: LAND in flown.since(0))
    flown.run(MODE_LATE_NS + S)
    assert flown.phase is not P.LANDING
    flown.craft.flags.ignores = ()
    flown.until_phase(P.LANDED)
