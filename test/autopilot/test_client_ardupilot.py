"""The autopilot node's client against the simulated ArduCopter, in virtual time."""

from __future__ import annotations

import pytest
from client_bench import ClientBench
from px4_tools import S
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.vehicle.client import Reply
from amaze_autonomy.autopilot.vehicle.position import Position
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.events import Landed
from amaze_autonomy.simulation.ardupilot import ArduCraft, ArduPilot

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
GUIDED, AUTO, LOITER = 4, 3, 5


def bench(**more):
    return ClientBench(autopilot=(ArduCraft, ArduPilot), **more)


def bad(bench):
    rows = bench.ask(bench.client.check, Landed.ON_GROUND)
    failed = {row.name: (row.verdict.value, row.advice) for row in rows if row.verdict.value != "pass"}
    failed.pop("time of day")  # the bench begins in 1970
    return failed


def order(bench, command, *parameters):
    """Command it as a ground station does."""
    bench.far.command(command, *parameters)
    bench.advance(0.1)


def fly(bench):
    bench.advance(3.0)
    order(bench, mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    order(bench, ARM, 1)
    order(bench, mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5.0)
    return bench.until(lambda: bench.vehicle.landed(bench.t_ns).name == "IN_AIR").advance(1.0)


def test_it_streams_nothing_until_asked_and_all_once_asked():
    silent = ClientBench(autopilot=(ArduCraft, ArduPilot))
    silent.cut = True
    silent.advance(5.0)
    assert {kind for _, _, message in silent.far.heard for kind in [message.get_type()]} == {"HEARTBEAT"}
    heard = bench().advance(8.0)
    status = heard.vehicle.status(heard.t_ns)
    assert (status.armed, status.landed.name, status.mode) == (False, "ON_GROUND", "STABILIZED")
    assert abs(status.height_m) < 0.3
    assert heard.vehicle.health(heard.t_ns) == dict.fromkeys(("gps", "imu", "magnetometer", "barometer"), True)
    assert list(bad(heard)) == ["parameters"]  # none is named


class Older(ArduPilot):
    """Before 4.4: the local place of home is 0, 0, 0, wherever it is."""

    def _message(self, name, view):
        made = super()._message(name, view)
        if name == "HOME_POSITION":
            made.x = made.y = made.z = 0.0
        return made


@pytest.mark.parametrize("autopilot", [ArduPilot, Older])
def test_a_node_that_begins_in_flight_counts_from_home_also_where_that_is_not_the_origin(autopilot):
    begun = ClientBench(autopilot=(ArduCraft, autopilot))
    begun.cut = True
    begun.advance(3.0)
    far = begun.far
    for command, *values in (
        (mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED),
        (ARM, 1),
        (mavlink.MAV_CMD_NAV_TAKEOFF, *[0] * 6, 5.0),
    ):
        order(begun, command, *values)
    begun.advance(8.0)
    far.craft.home = far.craft.geography.place(5.0, 10.0, -3.0)  # a ground station sets it
    begun.cut = False
    begun.advance(4.0)
    status, (east, north, up) = begun.vehicle.status(begun.t_ns), far.craft.position_m
    told = (status.position_x_m, status.position_y_m, status.height_m)
    assert told == pytest.approx((east - 5.0, north - 10.0, up + 3.0), abs=0.1)


#: as an ArduCopter 4.5.6 said them: its home 10 m north, 5 m east and 3 m below the origin
HOME, ORIGIN = (473978318, 85456604, 485100), (473977420, 85455940, 488100)
HOME_M, FLIES_M = (9.996432, 5.003387, 3.0), (12.0, 0.0, -5.0)
NOWHERE = (None, None, None)


def where(*messages, px4=False):
    """Return where a vehicle is that was never seen on the ground, after messages about home and origin."""
    position = Position(10 * S, 10 * S)
    for message in messages:
        if message is None:
            position.forget_takeoff()
        elif message.get_type() == "HOME_POSITION":
            position.add_home(0, message)
        else:
            position.add_origin(0, message)
    if px4:
        position.add_px4_flags(0, mavlink.MAVLink_estimator_status_message(0, 0x33F, 0, 0, 0, 0, 0, 0, 0, 0))
    else:
        position.add_ardupilot_flags(0, mavlink.MAVLink_ekf_status_report_message(0x33F, 0, 0, 0, 0, 0))
    position.add_local(0, mavlink.MAVLink_local_position_ned_message(0, *FLIES_M, 0, 0, 0))
    return position.place(0)[:3]


def home(local=(0.0, 0.0, 0.0), place=HOME):
    return mavlink.MAVLink_home_position_message(*place, *local, [1, 0, 0, 0], 0, 0, 0)


def origin(place=ORIGIN):
    return mavlink.MAVLink_gps_global_origin_message(*place)


TOPIC = home(place=(0, 0, 0))  # of mavros, which does not say where on the earth


@pytest.mark.parametrize(
    "messages, known",
    [
        ((home(HOME_M),), True),
        ((home(), origin()), True),
        ((origin(), home()), True),
        ((origin(), home(), TOPIC), True),
        ((home(),), False),
        ((TOPIC,), False),
        ((origin(), TOPIC), False),
        ((origin(),), False),
        ((home(), origin(), None, home()), False),
    ],
    ids=["told", "older", "origin first", "mavros", "no origin", "topic", "no place", "no home", "began again"],
)
def test_a_home_at_0_0_0_is_where_it_is_on_the_earth_or_unknown(messages, known):
    east, north, up = FLIES_M[1] - HOME_M[1], FLIES_M[0] - HOME_M[0], HOME_M[2] - FLIES_M[2]
    assert where(*messages) == (pytest.approx((east, north, up), abs=1e-4) if known else NOWHERE)


def test_home_and_origin_on_both_sides_of_the_date_line_are_near():
    told = where(home(place=(0, -1_799_999_500, 0)), origin((0, 1_799_999_500, 0)))
    assert told == pytest.approx((-11.1319, 12.0, 5.0), abs=1e-3)


def test_a_px4_s_home_at_0_0_0_is_there():
    assert where(home(), px4=True) == (0.0, 12.0, 5.0)


def test_parameters_come_as_floats_of_their_values():
    settings = AutopilotSettings(
        parameters={"COM_LOW_BAT_ACT": 3}, ardupilot_parameters={"FS_THR_ENABLE": 1, "BATT_LOW_VOLT": 11.0}
    )
    asked = bench(settings=settings).advance(5.0)
    assert bad(asked) == {"parameters": ("warn", "BATT_LOW_VOLT is 10.5, should be 11")}


def test_where_only_px4_s_parameters_are_named_nothing_was_compared_and_that_is_said():
    asked = bench(settings=AutopilotSettings(parameters={"COM_LOW_BAT_ACT": 3})).advance(5.0)
    words = "none of an ArduPilot is named in autopilot.yaml: nothing was compared"
    assert bad(asked) == {"parameters": ("warn", words)}


def test_px4_s_parameters_are_not_its_own_and_that_is_said():
    settings = AutopilotSettings(ardupilot_parameters={"COM_LOW_BAT_ACT": 3, "NAV_RCL_ACT": 2})
    asked = bench(settings=settings).advance(5.0)
    words = "this ArduPilot knows none of ardupilot_parameters in autopilot.yaml (docs/autopilot.md)"
    assert bad(asked) == {"parameters": ("warn", words)}


def test_prearm_ok_in_stabilize_is_none_without_a_position():
    lost = bench().advance(5.0)
    lost.far.craft.lose_gps()
    lost.advance(8.0)
    assert lost.vehicle.system.prearm(lost.t_ns) is True
    words = "the autopilot has no valid position: wait for its estimator"
    assert bad(lost)["pre-arm check"] == ("fail", words)
    order(lost, mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    assert lost.far.craft.mode == "STABILIZED"


def test_a_lost_gps_that_stays_healthy_in_sys_status_is_seen():
    flown = fly(bench())
    flown.far.craft.lose_gps()
    flown.advance(1.0)
    assert flown.vehicle.system.healthy(flown.t_ns, (mavlink.MAV_SYS_STATUS_SENSOR_GPS,)) is True
    assert flown.vehicle.health(flown.t_ns)["gps"] is False
    flown.until(lambda: flown.vehicle.control.failsafe, 10.0).advance(0.5)
    status = flown.vehicle.status(flown.t_ns)
    assert (status.mode, status.position_x_m, status.pilot_in_control) == ("AUTO.LAND", None, False)


@pytest.mark.parametrize("fraction, told", [(0.4, 0.9), (0.1, 0.15), (0.04, 0.05)])
def test_the_charge_state_corrects_a_fraction_that_ignores_the_voltage(fraction, told):
    drained = bench(endurance_s=1000.0)
    drained.far.power.drop_to(fraction)
    drained.advance(5.0)
    assert drained.vehicle.battery.reading().fraction == pytest.approx(told, abs=0.011)


def test_it_lands_by_the_second_route_and_disarms_itself():
    flown = fly(bench())
    flown.ask(flown.client.land)
    flown.until(lambda: flown.client.land_reply().final, 3.0)
    assert flown.client.land_reply() == Reply(accepted=True, message="the vehicle is in its landing mode", final=True)
    assert not flown.vehicle.control.pilot
    flown.until(lambda: not flown.vehicle.beat.armed)
    assert flown.vehicle.landed(flown.t_ns).name == "ON_GROUND"


def test_a_pilot_in_loiter_keeps_control():
    flown = fly(bench())
    flown.far.craft.pilot_takes_over("POSCTL", 60 * S)
    flown.advance(1.0)
    assert flown.vehicle.control.pilot
    answer = flown.ask(flown.client.land)
    assert answer == Reply(accepted=False, message="the pilot has control, in POSCTL", final=True)
