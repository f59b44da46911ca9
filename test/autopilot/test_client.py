"""The autopilot node's client against the simulated PX4, in virtual time."""

from __future__ import annotations

import pytest
from client_bench import ClientBench
from px4_tools import POSCTL, RTL, S
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.link.dialect import message_id
from amaze_autonomy.autopilot.planner.mission_vehicle import STREAMS, streams_hz
from amaze_autonomy.autopilot.vehicle.asked import Rates
from amaze_autonomy.autopilot.vehicle.client import CLIENT_MESSAGES, Progress, Reply, asked_rates_hz
from amaze_autonomy.config import AutopilotSettings, ConfigError
from amaze_autonomy.config.schemas.autopilot import TakeoffNeeds
from amaze_autonomy.engine.events import Landed, Verdict

SET_MODE, DISARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
ASK_RATE, ASK_PREARM = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_RUN_PREARM_CHECKS


def rows(bench, ground=Landed.ON_GROUND):
    return {row.name: (row.verdict.value, row.advice) for row in bench.ask(bench.client.check, ground)}


def bad(found):
    return {name: row for name, row in found.items() if row[0] != "pass"}


def test_a_vehicle_at_rest_is_fully_known():
    bench = ClientBench().advance(8.0)
    status = bench.vehicle.status(bench.t_ns)
    assert (status.armed, status.landed.name, status.mode) == (False, "ON_GROUND", "AUTO.LOITER")
    assert (status.pilot_in_control, status.failsafe) == (False, False)
    assert (abs(status.height_m) < 0.3, abs(status.position_x_m) < 0.3, status.battery_fraction) == (True, True, 1.0)
    assert bench.vehicle.health(bench.t_ns) == dict.fromkeys(("gps", "imu", "magnetometer", "barometer"), True)


def test_rates_are_asked_for_until_they_come_and_then_no_more():
    bench = ClientBench().advance(40.0)
    asked = len(bench.commands(ASK_RATE))
    assert 1 <= asked <= 40
    bench.sent.clear()
    bench.advance(20.0)
    assert len(bench.commands(ASK_RATE)) <= 2


@pytest.mark.parametrize("first", ["planner", "autopilot node"])
def test_where_both_nodes_share_a_channel_the_planner_asks_for_no_lower_rate(first):
    """Behind mavlink-router a message has one rate, and who asks last says it."""
    settings = AutopilotSettings(rates_hz={"ATTITUDE": 20.0, "SYS_STATUS": 5.0})
    planner, node = streams_hz(settings), asked_rates_hz(settings)
    nodes = {"planner": Rates(planner), "autopilot node": Rates(node)}
    names = {message_id(name): name for name in {**planner, **node}}
    rate_hz, due_ns = {}, {}
    for t_ns in range(S, 60 * S, S // 20):
        for name, hz in rate_hz.items():
            if t_ns >= due_ns.get(name, 0):
                due_ns[name] = t_ns + round(S / hz)
                for one in nodes.values():
                    one.heard(t_ns, name)
        for one in [nodes[first]] if t_ns < 3 * S else nodes.values():
            for message in one.wake(t_ns, 1, 1, ("EKF_STATUS_REPORT", "HEARTBEAT")):
                rate_hz[names[int(message.param1)]] = 1e6 / message.param2
    both = {name: round(rate_hz[name], 1) for name in planner if name in node and name in rate_hz}
    assert {name: hz for name, hz in both.items() if hz < node[name]} == {}
    assert both["ATTITUDE"] == 20.0


def test_what_the_planner_needs_is_asked_for_whatever_the_rates_say():
    unwanted = dict.fromkeys(["HEARTBEAT", "CURRENT_MODE", "ESTIMATOR_STATUS", "MISSION_CURRENT", "GPS_RAW_INT"], 0.0)
    assert {name for name in STREAMS if name not in streams_hz(AutopilotSettings(rates_hz=unwanted))} == {
        "HEARTBEAT",
        "CURRENT_MODE",
    }
    assert streams_hz(AutopilotSettings(rates_hz={"ESTIMATOR_STATUS": 0.0}))["ESTIMATOR_STATUS"] == 2.0
    assert "WIND" not in streams_hz(AutopilotSettings(rates_hz={"WIND": 1.0}))


def test_a_rate_of_the_configuration_counts_and_with_none_nothing_is_asked_for():
    rates_hz = {"ATTITUDE": 4.0, "HOME_POSITION": 0.0, "WIND": 1.0}
    asked_s = {}
    for name, settings in (("ours", AutopilotSettings()), ("theirs", AutopilotSettings(rates_hz=rates_hz))):
        bench = ClientBench(settings=settings)
        bench.deaf = {*CLIENT_MESSAGES} - {"HEARTBEAT"}
        bench.advance(20.0)
        asked = [message for _, message in bench.sent if getattr(message, "command", 0) == ASK_RATE]
        asked_s[name] = {int(message.param1): message.param2 / 1e6 for message in asked}
    attitude, home, wind = (message_id(name) for name in rates_hz)
    assert asked_s["ours"][attitude] == 0.1
    same = {number: pause_s for number, pause_s in asked_s["ours"].items() if number not in {attitude, home}}
    assert len(same) > 5
    assert asked_s["theirs"] == {**same, attitude: 0.25, wind: 1.0}


def test_a_rate_of_what_is_no_message_is_one_clear_error():
    with pytest.raises(ConfigError) as told:
        ClientBench(settings=AutopilotSettings(rates_hz={"ALTITUDE_OF_EVERYTHING": 1.0}))
    said = "autopilot.yaml: rates_hz.ALTITUDE_OF_EVERYTHING: is no message; must be one of https://mavlink.io/"
    assert str(told.value).startswith(said)


def test_the_clock_of_the_vehicle_is_known_within_the_way_there_and_back():
    bench = ClientBench().advance(5.0)
    best = bench.vehicle.offset.best
    boot_ns = bench.far.px4.settings.boot_ns
    assert abs(best.offset_ns - boot_ns) <= best.round_trip_ns <= 100_000_000


def test_every_row_passes_on_a_vehicle_that_is_ready():
    settings = AutopilotSettings(parameters={"COM_DISARM_LAND": 2.0, "COM_LOW_BAT_ACT": 0, "SYS_AUTOSTART": 10040})
    bench = ClientBench(settings=settings).advance(5.0)
    found = rows(bench)
    assert list(found) == [
        "autopilot link",
        "one vehicle",
        "not armed",
        "pre-arm check",
        "landed state",
        "RC receiver",
        "kill switch",
        "home position",
        "parameters",
        "time of day",
    ]
    assert list(bad(found)) in ([], ["time of day"])


def test_before_anything_is_heard_nothing_passes():
    bench = ClientBench()
    bench.cut = True
    found = rows(bench.advance(1.0))
    assert found.pop("autopilot link") == ("fail", "the autopilot is not heard: check cable, port and baud rate")
    assert set(found.values()) == {("unknown", "check the link to the autopilot")}


def test_what_is_not_ready_is_said_with_the_vehicle_s_own_words():
    bench = ClientBench(kind=mavlink.MAV_TYPE_GCS, transmitter=False)
    bench.far.craft.flags.not_ready["home"] = "no home"
    bench.advance(6.0)
    found = bad(rows(bench))
    assert found["pre-arm check"][0] == "fail"
    assert "no home" in found["pre-arm check"][1]
    assert found["RC receiver"] == ("fail", "switch on the transmitter")
    assert found["home position"][0] == "fail"
    assert len(bench.commands(ASK_PREARM)) == 1


def test_what_is_not_needed_is_warned_of():
    settings = AutopilotSettings(needs=TakeoffNeeds(rc=False, home=False))
    bench = ClientBench(transmitter=False, settings=settings).advance(5.0)
    assert rows(bench)["RC receiver"] == ("warn", "switch on the transmitter")


def test_a_parameter_that_differs_is_a_warning_with_both_values():
    settings = AutopilotSettings(parameters={"COM_LOW_BAT_ACT": 3, "NO_SUCH": 1})
    found = rows(ClientBench(settings=settings).advance(5.0))
    assert found["parameters"] == ("warn", "COM_LOW_BAT_ACT is 0, should be 3; not read: NO_SUCH")


def test_where_no_parameter_is_named_nothing_was_compared_and_that_is_said():
    settings = AutopilotSettings(ardupilot_parameters={"FS_THR_ENABLE": 1})
    found = rows(ClientBench(settings=settings).advance(5.0))
    assert found["parameters"] == ("warn", "none of a PX4 is named in autopilot.yaml: nothing was compared")


def test_a_range_finder_that_disagrees_fails_and_a_silent_one_is_warned_of():
    bench = ClientBench().advance(5.0)
    assert rows(bench, Landed.AIRBORNE)["landed state"][0] == "fail"
    assert rows(bench, Landed.UNKNOWN)["landed state"] == ("warn", "the range finder cannot confirm it")
    assert rows(bench, None)["landed state"] == ("warn", "the range finder cannot confirm it")


@pytest.mark.parametrize("lost", [0.0, 0.3])
def test_land_is_sent_until_the_heartbeat_shows_it(lost):
    bench = ClientBench(lost=lost).fly()
    answer = bench.ask(bench.client.land)
    assert answer == Reply(accepted=True, message="landing: commanded, not shown yet", final=False)
    bench.until(lambda: bench.client.landing.progress is Progress.CONFIRMED, 5.0)
    assert bench.vehicle.beat.mode == "AUTO.LAND"
    assert bench.client.land_reply() == Reply(accepted=True, message="the vehicle is in its landing mode", final=True)
    bench.sent.clear()
    assert bench.ask(bench.client.land).final
    assert bench.commands(SET_MODE) == []
    bench.until(lambda: bench.vehicle.status(bench.t_ns).armed is False)
    assert not bench.vehicle.control.pilot


def test_land_needs_no_acknowledgement():
    bench = ClientBench(unacknowledged=(SET_MODE,)).fly()
    bench.ask(bench.client.land)
    bench.until(lambda: bench.client.land_reply().final, 5.0)
    assert bench.client.land_reply().accepted


def test_land_that_is_never_shown_is_given_up_with_what_the_vehicle_answered():
    bench = ClientBench().fly()
    bench.cut = True
    bench.ask(bench.client.land)
    bench.advance(6.0)
    assert bench.client.land_reply() == Reply(
        accepted=False, message="landing: the vehicle did not show it in time (no answer)", final=True
    )


def test_a_landing_stands_until_the_vehicle_is_disarmed_also_after_its_reply():
    bench = ClientBench().fly()
    assert bench.client.commanding == ""
    bench.cut = True
    bench.ask(bench.client.land)
    bench.advance(12.0)
    assert (bench.client.landing.progress, bench.client.commanding) == (Progress.GIVEN_UP, "AUTO.LAND")
    bench.cut = False
    bench.until(lambda: bench.far.craft.mode == "AUTO.LAND", 1.0)
    bench.until(lambda: bench.vehicle.beat.armed is False)
    assert bench.client.commanding == "AUTO.LAND"  # one heartbeat says so
    bench.until(lambda: bench.client.commanding == "", 1.5)
    bench.sent.clear()
    bench.advance(5.0)
    assert bench.commands(SET_MODE) == []


def test_a_landing_mode_that_is_not_told_any_more_holds_no_landing_back():
    bench = ClientBench().fly(20.0)
    bench.ask(bench.client.land)
    bench.until(lambda: bench.client.landing.progress is Progress.CONFIRMED, 5.0)
    bench.deaf = ("HEARTBEAT", "CURRENT_MODE")
    bench.advance(2.0)
    bench.sent.clear()
    assert bench.ask(bench.client.land) == Reply(
        accepted=True, message="landing: commanded, not shown yet", final=False
    )
    assert bench.commands(SET_MODE)


@pytest.mark.parametrize("heard", [True, False], ids=["its mode is silent", "silent"])
def test_a_landing_that_one_heartbeat_showed_is_sent_on_when_no_other_comes(heard):
    bench = ClientBench().fly(20.0)
    bench.deaf = ("CURRENT_MODE",)
    bench.ask(bench.client.land)
    bench.until(lambda: bench.vehicle.beat.mode == "AUTO.LAND", 5.0)
    bench.cut, bench.deaf = not heard, ("HEARTBEAT", "CURRENT_MODE")
    bench.sent.clear()
    bench.advance(1.2)
    assert bench.commands(SET_MODE) == []
    bench.advance(1.0)
    assert len(bench.commands(SET_MODE)) >= 3


def test_a_landing_that_a_pilot_has_taken_does_not_come_back_when_he_lets_go():
    bench = ClientBench().fly(20.0)
    bench.ask(bench.client.land)
    bench.until(lambda: bench.client.land_reply().final, 5.0)
    bench.far.mode(POSCTL)
    bench.until(lambda: bench.vehicle.control.pilot, 1.1)
    bench.sent.clear()
    bench.until(lambda: bench.client.commanding == "", 0.6)
    bench.far.mode((4, 3))
    bench.advance(5.0)
    assert bench.commands(SET_MODE) == []


def test_nothing_disarms_on_a_landed_state_that_is_old():
    bench = ClientBench().fly()
    bench.ask(bench.client.land)
    bench.until(lambda: bench.vehicle.landed(bench.t_ns).name == "ON_GROUND")
    take = bench.vehicle.receive
    bench.vehicle.receive = lambda t_ns, m, **_: None if m.get_type() == "EXTENDED_SYS_STATE" else take(t_ns, m)
    bench.advance(1.0)
    assert bench.vehicle.landed(bench.t_ns).name == "ON_GROUND"  # old, and not yet unknown
    answer = bench.ask(bench.client.disarm)
    assert (answer.accepted, answer.message.endswith("s ago, is too old to disarm")) == (False, True), answer
    assert bench.commands(DISARM) == []


def test_a_disarming_does_not_go_on_after_a_silence():
    bench = ClientBench().fly()
    bench.ask(bench.client.land)
    bench.until(lambda: bench.vehicle.landed(bench.t_ns).name == "ON_GROUND").advance(0.7)
    bench.cut = True
    bench.ask(bench.client.disarm)
    assert bench.client.commanding == "AUTO.LAND"
    bench.advance(3.0)
    sent = len(bench.commands(DISARM))
    assert sent >= 1
    bench.far.craft.flags.ignores = ()
    bench.cut = False
    bench.advance(0.5)
    assert len(bench.commands(DISARM)) == sent


def test_the_pilot_is_not_fought():
    bench = ClientBench().fly()
    bench.far.mode(POSCTL)
    bench.until(lambda: bench.vehicle.control.pilot, 1.1)
    bench.sent.clear()
    assert bench.ask(bench.client.land) == Reply(accepted=False, message="the pilot has control, in POSCTL", final=True)
    said = "the pilot seems to have control, in POSCTL: landing if he has not"
    assert bench.ask(bench.client.leave) == Reply(accepted=False, message=said, final=False)
    bench.until(lambda: bench.client.land_reply().final, 0.6)
    assert bench.client.land_reply().message == "the pilot has control, in POSCTL"
    bench.advance(3.0)
    assert bench.commands(SET_MODE) == []


def test_a_pilot_who_takes_over_from_our_landing_is_not_fought_either():
    bench = ClientBench().fly(20.0)
    bench.ask(bench.client.land)
    bench.until(lambda: bench.client.land_reply().final, 5.0)
    bench.far.mode((4, 3))
    bench.until(lambda: bench.vehicle.control.pilot, 1.1)
    assert bench.vehicle.beat.mode == "AUTO.LOITER"


def test_a_mode_that_we_never_command_is_somebody_else_s():
    bench = ClientBench().fly()
    bench.far.mode(RTL)
    bench.until(lambda: bench.vehicle.control.pilot, 1.1)
    assert bench.vehicle.beat.mode == "AUTO.RTL"


def test_disarming_is_refused_in_the_air_and_done_on_the_ground():
    bench = ClientBench().fly()
    assert bench.ask(bench.client.disarm) == Reply(
        accepted=False, message="not on the ground: the vehicle says IN_AIR", final=True
    )
    bench.ask(bench.client.land)
    bench.until(lambda: bench.vehicle.landed(bench.t_ns).name == "ON_GROUND")
    assert bench.ask(bench.client.disarm) == Reply(
        accepted=False, message="ON_GROUND must be said for 0.5 s before it is believed", final=True
    )
    bench.advance(0.7)
    bench.ask(bench.client.disarm)
    bench.until(lambda: bench.client.disarm_reply().final, 5.0)
    assert bench.vehicle.beat.armed is False
    assert bench.ask(bench.client.disarm) == Reply(accepted=True, message="the vehicle is disarmed", final=True)


def test_a_node_that_ends_in_flight_lands_and_on_the_ground_does_nothing():
    bench = ClientBench().advance(3.0)
    assert bench.ask(bench.client.leave).message == "the vehicle is not in flight"
    assert bench.commands(SET_MODE) == []
    bench.fly()
    bench.ask(bench.client.leave)
    bench.until(lambda: bench.client.land_reply().final, 5.0)
    assert bench.vehicle.beat.mode == "AUTO.LAND"


def test_a_lost_link_is_old_and_what_was_said_becomes_unknown():
    bench = ClientBench().fly()
    bench.cut = True
    bench.advance(4.0)
    status = bench.vehicle.status(bench.t_ns)
    assert (status.armed, status.landed.name, status.height_m, status.position_x_m) == (True, "UNKNOWN", None, None)
    assert 3.0 < status.link_age_s < 5.1
    assert bench.vehicle.in_flight(bench.t_ns)
    assert not bench.ask(bench.client.land).accepted


def test_the_pilot_is_recognised_within_a_second():
    bench = ClientBench().fly()
    took_ns = []
    for mode in (POSCTL, (1, 0), (2, 0)):
        bench.far.mode((4, 3))
        bench.advance(2.0)
        assert not bench.vehicle.control.pilot
        bench.far.mode(mode)
        began_ns = bench.t_ns
        bench.until(lambda: bench.vehicle.control.pilot, 2.0)
        took_ns.append(bench.t_ns - began_ns)
    assert max(took_ns) <= 1 * S


def test_the_battery_is_checked_with_the_charge_state():
    bench = ClientBench().advance(5.0)
    verdict = bench.client.check_battery(bench.t_ns, 0.5)
    assert verdict.ok
    assert [row.name for row in verdict.checks] == [
        "battery age",
        "battery fraction",
        "battery cell voltage",
        "battery state",
    ]


FLAT = "3.00 V per cell of 4, limit 3.50 V: change or charge the battery"
SIX_CELLS = "6.25 V per cell cannot be: is it 4 cells, and is the power module calibrated?"
DEAD = "2.40 V in one cell of 4, limit 3.50 V: change or charge the battery"


@pytest.mark.parametrize(
    "packs, verdict, advice",
    [
        ([(16600,), (16400,)], Verdict.PASS, ""),
        ([(16600,), (12000,)], Verdict.FAIL, f"battery 1: {FLAT}"),
        ([(12000,), (16600,)], Verdict.FAIL, f"battery 0: {FLAT}"),
        ([(16600,), (25000,)], Verdict.FAIL, f"battery 1: {SIX_CELLS}"),
        ([(4150, 4150, 4150, 2400)], Verdict.FAIL, DEAD),
        ([(4150,) * 4, (4150, 4150, 4150, 2400)], Verdict.FAIL, f"battery 1: {DEAD}"),
        ([(16600,), ()], Verdict.UNKNOWN, "battery 1: the voltage is unknown: check the power module"),
    ],
)
def test_the_volts_of_each_pack_and_cell_are_judged_though_all_say_that_they_are_full(packs, verdict, advice):
    """An ArduPilot that was switched on says 100 % of whatever is plugged in: it counts the current alone."""
    bench = ClientBench().advance(5.0)
    bench.deaf = ("BATTERY_STATUS",)
    for number, cells in enumerate(packs):
        volts = [*cells, *[65535] * (10 - len(cells))]
        said = mavlink.MAVLink_battery_status_message(number, 0, 0, 0, volts, 100, 0, 0, 100, 0, 1)
        bench.client.receive(bench.t_ns, said)
    answer = bench.client.check_battery(bench.t_ns, 0.5)
    row = answer.checks[2]
    assert (answer.ok, answer.fraction) == (verdict is Verdict.PASS, 1.0)
    assert (row.name, row.verdict, row.advice) == ("battery cell voltage", verdict, advice)


def test_a_pack_that_is_silent_fails_the_check_of_the_battery_and_is_named():
    bench = ClientBench().advance(5.0)
    other = mavlink.MAVLink_battery_status_message(1, 0, 0, 0, [4000] * 4 + [65535] * 6, 100, 0, 0, 80, 0, 1)
    bench.client.receive(bench.t_ns, other)
    assert bench.client.check_battery(bench.t_ns, 0.5).ok
    bench.advance(10.0)
    verdict = bench.client.check_battery(bench.t_ns, 0.5)
    assert not verdict.ok
    row = verdict.checks[-1]
    assert (row.name, row.verdict) == ("battery state", Verdict.FAIL)
    assert row.advice.startswith("nothing is heard of battery 1: look at its power module")
    bench.advance(21.0)
    assert bench.client.check_battery(bench.t_ns, 0.5).ok


def test_a_node_that_ends_while_nothing_is_heard_goes_on_sending():
    bench = ClientBench().fly()
    bench.cut = True
    bench.advance(3.0)
    assert not bench.ask(bench.client.leave).final
    bench.advance(1.0)
    assert len(bench.commands(SET_MODE)) >= 3
    bench.cut = False
    bench.until(lambda: bench.client.land_reply().final, 2.0)
    assert bench.far.craft.mode == "AUTO.LAND"


def test_a_failsafe_that_acts_by_itself_is_left_alone_and_one_that_waits_for_sticks_is_landed():
    bench = ClientBench(transmitter=False).fly()
    bench.far.mode((4, 3))
    heartbeat = mavlink.MAVLink_heartbeat_message
    for mode, number, left_alone in (("AUTO.RTL", 5 << 24 | 4 << 16, True), ("POSCTL", 3 << 16, False)):
        for later_ns in (0, 400_000_000):  # a single one may be wrong
            bench.vehicle.receive(bench.t_ns + later_ns, heartbeat(2, 12, 209, number, 5, 3))
        bench.sent.clear()
        reply = bench.ask(bench.client.leave)
        assert (reply.message == f"the autopilot acts by its failsafe, in {mode}") is left_alone
        assert bool(bench.commands(SET_MODE)) is not left_alone
