"""Every status and every service of the tables, without ROS: what is written is read again as the same."""

from __future__ import annotations

import re
from math import inf, isnan, nan
from pathlib import Path
from types import SimpleNamespace

import pytest

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import AutopilotLand, MissionAction, MissionCommand, Notify, RunCheck
from amaze_autonomy.engine.events import Check, CheckName, Verdict
from amaze_autonomy.engine.rules import Code, Restart
from amaze_autonomy.interface import (
    CHECK_ROW,
    CHECK_SERVICES,
    COMPONENT,
    PEERS,
    SERVICES,
    STATUSES,
    InvalidMessageError,
    health_fields,
    health_of,
    message_name,
    peer_of,
    service_of,
)
from amaze_autonomy.interface.fields import MOST_ITEMS, MOST_TEXT, text
from amaze_autonomy.interface.tables import HEALTH, PLATFORM
from amaze_autonomy.journal.codec import field_types, tuple_items
from amaze_autonomy.journal.journal import encode_event

ROOT = Path(__file__).parents[2]
S = 1_000_000_000
T = 7 * S
LRF = ev.ComponentStatus(name="lrf", code=Code.HOLD, restart=Restart.TRYING, until_ns=T + 2 * S, reason="silent")


def classes(_name):
    return SimpleNamespace


def fields_of(path, part=0):
    """Return the names of the fields in a definition of a message, or of one part of a service."""
    text = (ROOT / path).read_text(encoding="utf-8").split("\n---\n")[part]
    lines = [line.partition("#")[0].split() for line in text.splitlines()]
    return {line[1] for line in lines if len(line) == 2 and "=" not in line[1]}


@pytest.mark.parametrize("status", STATUSES, ids=lambda status: status.topic)
def test_every_field_of_an_event_is_in_its_message(status):
    names = set(status.shape.names.values()) | {"header"}
    assert names <= fields_of(f"msg/{status.shape.message}.msg")


@pytest.mark.parametrize("shape", [CHECK_ROW, COMPONENT], ids=lambda shape: shape.message)
def test_every_field_of_a_part_is_in_its_message_and_the_other_way_round(shape):
    assert set(shape.names.values()) == fields_of(f"msg/{shape.message}.msg")


@pytest.mark.parametrize("name", [name for name, row in SERVICES.items() if row.type != "Trigger"])
def test_every_field_of_a_service_is_asked_or_answered(name):
    row = SERVICES[name]
    kind = row.request
    command = (
        RunCheck(id=1, limit_ns=S, check=row.check)
        if row.check
        else kind(
            **{
                each: {"int": 1, "str": "x", "MissionAction": MissionAction.HOLD}[entry.type]
                for each, entry in kind.__dataclass_fields__.items()
            }
        )
    )
    assert set(row.ask(command, classes)) == fields_of(f"srv/{row.type}.srv")
    reply = (
        ev.CheckReply(t_ns=T, command_id=1, check=row.check, outcome=ev.Outcome.ACCEPTED)
        if row.check
        else ev.Reply(t_ns=T, command_id=1, outcome=ev.Outcome.ACCEPTED)
    )
    assert set(row.answer(reply, T, classes)) <= fields_of(f"srv/{row.type}.srv", 1)


def test_a_list_of_parts_is_read_as_it_was_written():
    status = next(each for each in STATUSES if each.event is ev.WatchdogInfo)
    event = ev.WatchdogInfo(t_ns=T, sequence=4, changed=("lrf",), components=(LRF,), age_ns=0)
    assert status.read(status.write(event, classes), T, 0) == event


def test_moments_count_from_when_the_message_was_made():
    message = COMPONENT.written(LRF, T, classes)
    assert message.until == 2.0
    assert COMPONENT.make(message, T + 1).until_ns == LRF.until_ns + 1
    for seconds in (nan, inf, -inf, 1e10):
        message.until = seconds
        assert COMPONENT.make(message, T).until_ns is None


def test_what_a_status_says_of_the_sensors_is_read_as_it_was_written_and_of_a_status_of_before_likewise():
    said = {"gps": True, "imu": False}
    numbers = {"sensors_sequence": 7, "gps_sequence": 3}
    written = health_fields(said, sequences=numbers)
    assert set(written) <= fields_of("msg/AutopilotStatus.msg")
    message = SimpleNamespace(link_age=0.5, **written)
    sequences = {"gps": 3, "imu": 7, "magnetometer": 7, "barometer": 7}
    assert health_of(message) == ({**dict.fromkeys(HEALTH), **said}, 0.5, sequences)
    del message.sensors_sequence, message.gps_sequence
    message.imu = 9
    assert health_of(message) == ({**dict.fromkeys(HEALTH), "gps": True}, 0.5, dict.fromkeys(sequences, 0))


def test_a_flag_says_what_is_known():
    status = next(each for each in STATUSES if each.event is ev.AutopilotStatus)
    event = ev.AutopilotStatus(t_ns=T, armed=None, landed=ev.VehicleLanded.IN_AIR, position_x_m=1.0)
    message = status.write(event, classes)
    assert (message.armed_known, message.armed, message.height_valid, message.position_valid) == (False,) * 4
    assert isnan(message.height)
    read = status.read(message, T, 0)
    assert (read.armed, read.height_m, read.position_x_m) == (None, None, None)
    message.armed_known = message.position_valid = True
    message.position_y = 2.0
    read = status.read(message, T, 0)
    assert (read.armed, read.position_x_m, read.position_y_m) == (False, 1.0, 2.0)


@pytest.mark.parametrize(
    "field, value, words",
    [
        ("code", 3, "components.code is 3, must be one of 1, 2, 4, 8, 16"),
        ("restart", 9, "components.restart is 9, must be one of 0, 1, 2"),
        ("name", "", "components.name is '', must be the name of a component"),
    ],
)
def test_what_cannot_be_is_refused_by_the_way_to_its_field(field, value, words):
    service = CHECK_SERVICES[CheckName.WATCHDOG]
    reply = ev.CheckReply(
        t_ns=T, command_id=5, check=CheckName.WATCHDOG, outcome=ev.Outcome.ACCEPTED, components=(LRF,)
    )
    answer = SimpleNamespace(**service.answer(reply, T, classes))
    assert service.reply(answer, 5, T) == reply
    setattr(answer.components[0], field, value)
    with pytest.raises(InvalidMessageError, match=re.escape(words)):
        service.reply(answer, 5, T)


def test_a_verdict_has_the_numbers_of_its_message():
    assert [CHECK_ROW.write(Check("x", verdict), 0, classes)["verdict"] for verdict in Verdict] == [1, 2, 3, 4]


def test_which_service_a_command_goes_to():
    assert service_of(AutopilotLand(id=1, limit_ns=S)).name == "autopilot/land"
    assert service_of(MissionCommand(id=1, limit_ns=S, session_id="s", action=MissionAction.LAND)).peer == (
        "mission_planner"
    )
    for check in CheckName:
        assert service_of(RunCheck(id=1, limit_ns=S, check=check)).check is check
    assert service_of(Notify(level=None, key="", text="", advice="")) is None
    assert {peer_of(name) for name in SERVICES} == set(PEERS)


def test_a_field_is_called_in_messages_as_it_is_without_its_unit():
    names = ["height_m", "vertical_speed_m_s", "battery_voltage_v", "age_s", "until_ns", "waypoints", "free_fraction"]
    assert [message_name(name) for name in names] == [
        *("height", "vertical_speed", "battery_voltage", "age", "until", "waypoints", "free_fraction")
    ]


def test_texts_of_peers_are_cut_in_statuses_lists_and_parts():
    assert text("x" * MOST_TEXT) == "x" * MOST_TEXT
    assert text("x" * (MOST_TEXT + 1)) == "x" * (MOST_TEXT - 3) + "..."
    long = "x" * 5_000_000
    component = SimpleNamespace(name="lrf", code=8, restart=0, until=0.0, reason=long)
    message = SimpleNamespace(sequence=1, changed=[long], components=[component])
    found = next(each for each in STATUSES if each.topic == "watchdog/info").read(message, 5, 0)
    assert [len(each) for each in (found.changed[0], found.components[0].reason)] == [MOST_TEXT, MOST_TEXT]
    assert len(encode_event(found)) < 3 * MOST_TEXT


def test_the_name_of_a_peer_s_node_is_cut_as_its_texts_are():
    status = next(each for each in STATUSES if each.topic == "watchdog/action")
    message = status.write(status.event(t_ns=T, sequence=1, **OWN["watchdog/action"]), classes)
    assert status.read(message, T, 0, "/" + "x" * 5_000_000).publisher == text("/" + "x" * 5_000_000)
    assert status.read(message, T, 0, "/a/watchdog").publisher == "/a/watchdog"


# --- long lists -------------------------------------------------------------------------------------------------------


def component(number, code):
    return SimpleNamespace(name=f"c{number}", code=code, restart=0, until=nan, reason="x" * 900)


def row(number, verdict):
    return SimpleNamespace(
        **{**vars(CHECK_ROW.written(Check(f"r{number}", Verdict.PASS), T, classes)), "verdict": verdict}
    )


def platform(number, growing):
    return PLATFORM.written(ev.PlatformRecording(platform=f"p{number}", growing=growing), T, classes)


@pytest.mark.parametrize("topic", ["watchdog/action", "watchdog/info"])
def test_of_a_long_list_of_components_the_worst_are_kept_in_their_order(topic):
    status = next(each for each in STATUSES if each.topic == topic)
    codes = [1] * 700 + [8] + [2] * 500 + [16] + [4] * 600 + [8, 16] + [1] * 200
    parts = [component(number, code) for number, code in enumerate(codes)]
    message = status.write(status.event(t_ns=T, sequence=1, **OWN[topic]), classes)
    message.components, message.changed = parts, [each.name for each in parts]
    found = status.read(message, T, 0)
    assert len(found.components) == MOST_ITEMS
    kept = [int(each.name[1:]) for each in found.components]
    assert kept == sorted(kept)
    assert sorted((codes[each] for each in kept), reverse=True) == sorted(codes, reverse=True)[:MOST_ITEMS]
    assert [each for each in kept if codes[each] >= 8] == [700, 1201, 1802, 1803]
    assert len(encode_event(found)) < 2 * MOST_ITEMS * MOST_TEXT
    cut = len(codes) - MOST_ITEMS
    assert status.left_out(message) == {"components": cut, **({"changed": cut} if topic == "watchdog/info" else {})}


NOTHING = {"changed": (), "components": ()}
OWN = {"watchdog/action": {"loop_counter": 1, "code": Code.ABORT}, "watchdog/info": NOTHING}


def test_more_of_the_worst_than_can_be_kept_leave_nothing_else():
    status = next(each for each in STATUSES if each.event is ev.WatchdogInfo)
    message = status.write(ev.WatchdogInfo(t_ns=T, sequence=1, **NOTHING), classes)
    message.components = [component(number, 16 if number % 2 else 8) for number in range(2 * MOST_ITEMS + 2)]
    assert {each.code for each in status.read(message, T, 0).components} == {Code.ABORT}


def test_of_a_long_check_no_row_that_has_failed_is_left_out_for_one_that_passed():
    service = CHECK_SERVICES[CheckName.WATCHDOG]
    reply = ev.CheckReply(t_ns=T, command_id=5, check=CheckName.WATCHDOG, outcome=ev.Outcome.ACCEPTED, message="no")
    answer = SimpleNamespace(**service.answer(reply, T, classes))
    answer.checks = [row(number, 1) for number in range(500)] + [row(500, 3), row(501, 4), row(502, 2)]
    found = service.reply(answer, 5, T)
    assert (len(found.checks), [each.name for each in found.checks[-3:]]) == (MOST_ITEMS, ["r500", "r501", "r502"])
    assert found.message == f"no ({503 - MOST_ITEMS} of 503 checks are left out)"


def test_of_a_long_list_of_platforms_none_that_does_not_record_is_left_out():
    status = next(each for each in STATUSES if each.event is ev.RecordingStatus)
    event = ev.RecordingStatus(t_ns=T, session_id="s", phase=ev.RecordingPhase.RECORDING)
    message = status.write(event, classes)
    message.platforms = [platform(number, growing=number != 400) for number in range(500)]
    found = status.read(message, T, 0)
    assert (len(found.platforms), found.platforms[-1].platform) == (MOST_ITEMS, "p400")
    assert status.left_out(message) == {"platforms": 500 - MOST_ITEMS}


@pytest.mark.parametrize("status", STATUSES, ids=lambda status: status.topic)
def test_no_list_of_any_status_is_longer_than_the_limit(status):
    """Also of one that comes later: its fields are those of the event."""
    lists = [name for name, hint in field_types(status.event).items() if tuple_items(hint) is not None]
    assert set(lists) == set(status.shape.lists)
    message = SimpleNamespace(**dict.fromkeys(status.shape.lists, range(MOST_ITEMS + 7)))
    assert status.left_out(message) == dict.fromkeys(status.shape.lists, 7)


def test_a_list_that_is_not_too_long_is_read_as_it_is():
    status = next(each for each in STATUSES if each.event is ev.WatchdogInfo)
    message = status.write(ev.WatchdogInfo(t_ns=T, sequence=1, **NOTHING), classes)
    message.components = [component(number, (16, 1)[number % 2]) for number in range(MOST_ITEMS)]
    found = status.read(message, T, 0)
    assert [each.name for each in found.components] == [f"c{number}" for number in range(MOST_ITEMS)]
    assert status.left_out(message) == {}


def test_numbers_are_published_in_steps_that_mean_something():
    status = next(each for each in STATUSES if each.event is ev.AutopilotStatus)
    noise = {
        "height_m": 1.5050423885695636,
        "battery_fraction": 0.98044,
        "battery_voltage_v": nan,
        "position_x_m": None,
        "tilt_deg": 45.0000001,
    }
    event = ev.AutopilotStatus(t_ns=0, armed=True, landed=ev.VehicleLanded.IN_AIR, mode="", **noise)
    message = status.write(event, classes)
    assert (message.height, message.battery_fraction, message.position_valid) == (1.505, 0.9804, False)
    assert isnan(message.battery_voltage)
    assert message.tilt == 0.7854


@pytest.mark.parametrize("tilt_rad, tilt_deg", [(0.7854, 45.0), (1.23, 70.0), (1.24, 71.0), (nan, None), (inf, None)])
def test_an_angle_in_radians_is_read_in_whole_degrees(tilt_rad, tilt_deg):
    status = next(each for each in STATUSES if each.event is ev.AutopilotStatus)
    message = status.write(ev.AutopilotStatus(t_ns=0, armed=True, landed=ev.VehicleLanded.IN_AIR), classes)
    assert isnan(message.tilt)
    message.tilt = tilt_rad
    assert status.read(message, 0, 0).tilt_deg == tilt_deg
