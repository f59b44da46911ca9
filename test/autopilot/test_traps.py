"""What a real PX4 was seen to do and that looks like something else: texts withheld, a home that moves, more."""

from __future__ import annotations

import pytest
from autopilot_tools import beat
from client_bench import ClientBench
from flying import Flying, S
from px4_tools import LOITER
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.vehicle.vehicle import VehicleState
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import Landed, MissionPhase

ARDUPILOT = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
ASK_RATE = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
GCS, ONBOARD = mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_ONBOARD_CONTROLLER


def texts(bench):
    return [text.text for text in bench.vehicle.texts.recent(bench.t_ns, 60 * S)]


@pytest.mark.parametrize("kind, said", [(ONBOARD, []), (GCS, ["Armed by external command"])])
def test_texts_are_withheld_where_no_ground_station_beats(kind, said):
    bench = ClientBench(kind=kind).advance(3.0)
    bench.far.arm()
    bench.advance(2.0)
    assert texts(bench) == said


def test_texts_that_were_withheld_come_when_a_ground_station_is_heard():
    bench = ClientBench(kind=ONBOARD).advance(3.0)
    bench.far.arm()
    bench.advance(2.0)
    bench.far.kind = GCS
    bench.advance(2.0)
    assert texts(bench) == ["Armed by external command"]


def test_a_home_that_moves_half_a_metre_at_the_arming_moves_nothing_else():
    bench = ClientBench().advance(5.0)
    seen, homes = [], set()
    bench.far.mode(LOITER)
    bench.far.arm()
    for _ in range(60):
        bench.advance(0.1)
        status = bench.vehicle.status(bench.t_ns)
        seen.append(max(abs(status.height_m), abs(status.position_x_m), abs(status.position_y_m)))
        homes.add(round(bench.vehicle.position._home[2], 2))
    assert max(homes) - min(homes) == pytest.approx(0.45, abs=0.01)
    assert max(seen) < 0.1  # the noise of the position
    assert bench.vehicle.control.pilot is False


def test_a_home_that_moves_does_not_change_what_the_planner_has_left():
    flying = Flying()
    flying.take_off("line")
    flying.until(lambda: flying.craft.armed)
    before, origin = flying.status, flying.planner._origin
    flying.run(S // 2)
    assert flying.planner._origin == origin
    assert abs(flying.status.distance_left_m - before.distance_left_m) < 0.8  # the climb
    flying.until_phase(MissionPhase.LANDED)
    assert flying.status.waypoint == 3


def parameter(name, value):
    return mavlink.MAVLink_param_value_message(name, value, mavlink.MAV_PARAM_TYPE_REAL32, 900, 65535)


def test_parameters_that_nobody_asked_for_are_taken_when_they_are_compared_and_else_left_alone():
    bench = ClientBench(settings=AutopilotSettings(parameters={"COM_DISARM_LAND": 2.0})).advance(5.0)
    bench.sent.clear()
    for number in range(300):
        assert bench.client.receive(bench.t_ns, parameter(f"UNKNOWN_{number}".encode(), 1.0)) == []
    bench.client.receive(bench.t_ns, parameter(b"COM_DISARM_LAND", 7.0))
    states = [(one.name, one.value, one.agrees) for one in bench.client._parameters.states]
    assert states == [("COM_DISARM_LAND", 7.0, False)]


def test_an_autopilot_that_starts_again_is_told_of_once():
    bench, told = ClientBench().advance(20.0), []
    bench.client.on_text = lambda severity, text: told.append((severity, text))
    bench.client.receive(bench.t_ns, mavlink.MAVLink_local_position_ned_message(100, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    bench.advance(5.0)
    assert told == [(mavlink.MAV_SEVERITY_ALERT, "the autopilot has started again")]


TELL_ITS_START = {
    "ATTITUDE": lambda boot_ms: mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "LOCAL_POSITION_NED": lambda boot_ms: mavlink.MAVLink_local_position_ned_message(boot_ms, 1.0, 2.0, -0.1, 0, 0, 0),
    "SYSTEM_TIME": lambda boot_ms: mavlink.MAVLink_system_time_message(0, boot_ms),
}
HOME = mavlink.MAVLink_home_position_message(474000000, 85000000, 500000, 1.0, 2.0, 0.0, [1, 0, 0, 0], 0, 0, 0)


def tell(vehicle, t_s, *messages, armed=False):
    """Let a vehicle say messages for two seconds."""
    for number in range(4):
        t_ns = t_s * S + number * S // 2
        for message in (beat(4, armed=armed, autopilot=ARDUPILOT), *messages):
            vehicle.receive(t_ns, message)


@pytest.mark.parametrize("name", TELL_ITS_START)
def test_an_autopilot_that_has_started_again_is_known_by_any_message_that_tells_it(name):
    """As an ArduPilot within doors: it then has no local position, and no home."""
    vehicle = VehicleState(AutopilotSettings())
    tell(vehicle, 0, *(message(600_000) for message in TELL_ITS_START.values()), HOME)
    assert (vehicle.restarts, vehicle.position.home_ns is None) == (0, False)
    tell(vehicle, 6, TELL_ITS_START[name](1_500))
    assert (vehicle.restarts, vehicle.position.home_ns is None) == (1, True)


def test_messages_that_are_under_way_for_different_times_are_no_start():
    vehicle = VehicleState(AutopilotSettings())
    for boot_ms in (600_000, 599_200, 600_100, 0, 600_300):  # mavros has no such time: 0
        tell(vehicle, 0, *(message(boot_ms) for message in TELL_ITS_START.values()), HOME)
    assert (vehicle.restarts, vehicle.position.home_ns is None) == (0, False)


@pytest.mark.parametrize(
    "boot_ms, pause_s, armed, forgotten",
    [(0, 12, False, True), (0, 8, False, False), (0, 12, True, False), (600_000, 12, False, False)],
)
def test_behind_mavros_the_home_of_before_a_break_on_the_ground_is_forgotten(boot_ms, pause_s, armed, forgotten):
    vehicle = VehicleState(AutopilotSettings())
    attitude = TELL_ITS_START["ATTITUDE"](boot_ms)
    tell(vehicle, 0, attitude, HOME)
    tell(vehicle, pause_s, attitude, armed=armed)
    assert (vehicle.position.home_ns is None) is forgotten
    tell(vehicle, pause_s + 2, attitude, HOME, armed=armed)
    assert vehicle.position.home_ns is not None


def test_behind_mavros_one_wrong_heartbeat_after_a_break_in_flight_forgets_no_home_and_one_that_came_since_stays():
    vehicle = VehicleState(AutopilotSettings())
    tell(vehicle, 0, HOME, armed=True)
    vehicle.receive(20 * S, beat(4, autopilot=ARDUPILOT))
    tell(vehicle, 21, armed=True)
    assert vehicle.position.home_ns is not None
    tell(vehicle, 40, HOME)
    assert vehicle.position.home_ns is not None


def test_motors_that_px4_stops_by_itself_before_the_takeoff_are_no_flight():
    flying = Flying()
    flying.craft.flags.does_not_lift_off = True
    flying.take_off("line")
    flying.until(lambda: flying.craft.armed)
    armed_ns = flying.t_ns
    flying.until(lambda: flying.craft.mode == "AUTO.MISSION")
    assert flying.command(MissionAction.HOLD) == ""  # so that it waits for nothing any more
    flying.until_phase(MissionPhase.LANDED, limit_ns=15 * S)
    assert flying.status.message == "disarmed before it lifted off"
    assert (flying.t_ns - armed_ns) / S == pytest.approx(11.0, abs=1.5)  # two heartbeats say so, at 1 Hz
    assert (flying.status.waypoint, flying.craft.armed) == (0, False)


@pytest.mark.parametrize("action, wait_s", [(MissionAction.LAND, 2.0), (None, 0.05)])
def test_px4_disarms_by_itself_after_the_landing_and_only_then_it_is_landed(action, wait_s):
    flying = Flying()
    flying.take_off("line")
    flying.until_phase(MissionPhase.FLYING)
    if action is not None:
        assert flying.command(action) == ""
    flying.until(lambda: flying.craft.landed.name == "ON_GROUND")
    down_ns = flying.t_ns
    assert flying.phase is MissionPhase.LANDING
    flying.until(lambda: not flying.craft.armed)
    assert (flying.t_ns - down_ns) / S == pytest.approx(wait_s, abs=0.1)
    flying.until_phase(MissionPhase.LANDED, limit_ns=3 * S)


@pytest.mark.parametrize("silent_s", [30, 2], ids=["unplugged", "started again at once"])
def test_a_planner_asks_as_often_after_the_tenth_start_of_the_autopilot_as_after_the_first(silent_s):
    planner, t_ns, wanted = Flying().planner, 1000 * S, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
    for _ in range(10):
        started_ns, asked_ns = t_ns, []
        for second in range(40):
            t_ns = started_ns + second * S
            position = mavlink.MAVLink_local_position_ned_message(1 + second * 1000, 0, 0, 0, 0, 0, 0)
            for message in (beat(4 << 16 | 3 << 24), position):
                message._header = mavlink.MAVLink_header(message.get_msgId(), srcSystem=1, srcComponent=1)
                planner.receive(t_ns, message)
            asked = [each for _ in range(5) for each in planner.wake(t_ns) if each.get_type() == "COMMAND_LONG"]
            asked_ns += [t_ns for each in asked if (each.command, each.param1) == (ASK_RATE, wanted)]
        pauses_s = [(later - earlier) // S for earlier, later in zip(asked_ns, asked_ns[1:])]
        assert (asked_ns[0] - started_ns, pauses_s) == (0, [3, 3, 3, 3])
        t_ns += silent_s * S


def test_another_autopilot_that_has_been_on_for_longer_has_no_home_of_the_one_before():
    """Unplugged on the ground, and another one, on for an hour and without a home, plugged into the same line."""
    bench = ClientBench().advance(6.0)
    rows = {row.name: row.verdict.name for row in bench.client.rows(bench.t_ns, Landed.ON_GROUND)}
    assert rows["home position"] == "PASS"
    bench.cut = True
    bench.advance(6.0)
    bench.cut, bench.deaf = False, ("HOME_POSITION",)
    send = bench._theirs.send

    def an_hour_later(message):
        if getattr(message, "time_boot_ms", 0):
            message.time_boot_ms += 3_600_000
        return send(message)

    bench._theirs.send = an_hour_later
    bench._peers.sources.forget()
    bench.advance(20.0)
    rows = {row.name: row.verdict.name for row in bench.client.rows(bench.t_ns, Landed.ON_GROUND)}
    assert (rows["home position"], bench.client.vehicle.restarts) == ("FAIL", 1)
