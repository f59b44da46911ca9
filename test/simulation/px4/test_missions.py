"""Missions: taken and handed out as PX4 does it, flown item by item, and its traps."""

from __future__ import annotations

import math

import pytest
from px4_tools import LAND, LOITER, MISSION, QUICK, STEP, Bench, S, changes
from pymavlink.dialects.v20 import common as mavlink

ROWS = ((4.0, 0.0, 2.0, 0.5), (4.0, 3.0, 3.0, 0.0))


def story(bench):
    return [what for _, what in changes([(t_ns / S, message) for t_ns, _, message in bench.heard])]


def over(bench):
    return lambda: bench.craft.mission_over and not bench.craft.armed


def test_an_uploaded_mission_is_flown_from_takeoff_to_landing():
    bench = Bench().advance(1.5)
    assert bench.upload(bench.items(*ROWS)) == 0
    assert bench.arm() == [0]
    assert bench.mode(MISSION) == [0, 0]
    bench.until(over(bench)).advance(1.5)
    assert story(bench)[:-3] == [
        *("mode MISSION", "armed True", "status 4"),
        *("landed 3", "reached 0", "landed 2", "reached 1", "reached 2", "landed 4", "reached 3"),
    ]
    assert sorted(story(bench)[-3:]) == ["armed False", "landed 1", "status 3"]  # within the period of the messages
    assert math.dist(bench.craft.position_m, (4.0, 3.0, 0.0)) < 0.01


def test_the_item_that_was_reached_is_told_every_second():
    bench = Bench()
    bench.upload(bench.items(*ROWS))
    bench.arm()
    bench.mode(MISSION)
    bench.until(lambda: bench.craft.item_reached == 0)
    bench.heard.clear()
    bench.craft.command_mode("AUTO.LOITER")
    bench.advance(4.0)
    assert [message.seq for message in bench.of("MISSION_ITEM_REACHED")] == [0] * 4


def test_a_mission_without_a_current_item_keeps_the_number_of_the_one_before():
    """The trap: it is at its last item, to land, when it begins; so it is over at once, and disarms."""
    bench = Bench()
    bench.upload(bench.items(*ROWS))
    bench.arm()
    bench.mode(MISSION)
    bench.until(over(bench)).advance(1.0)
    assert bench.upload(bench.items(*ROWS, first=False)) == 0
    assert bench.last("MISSION_CURRENT").seq == 3
    bench.arm()
    bench.mode(MISSION)
    bench.advance(3.0)
    assert (bench.craft.armed, bench.craft.height_m, bench.craft.mission_over) == (False, 0.0, True)


def test_a_current_item_or_a_message_begins_it_anew():
    for begin in (True, False):
        bench = Bench()
        bench.upload(bench.items(*ROWS))
        bench.craft.set_current(3)
        bench.upload(bench.items(*ROWS, first=begin))
        if not begin:
            bench.tell(mavlink.MAVLink_mission_set_current_message(1, 1, 0))
        bench.arm()
        bench.mode(MISSION)
        bench.until(lambda bench=bench: bench.craft.height_m > 1.0)
        assert bench.craft.current == 0


def test_a_hold_keeps_the_item_and_the_mission_goes_on_from_there():
    bench = Bench()
    bench.upload(bench.items(*ROWS))
    bench.arm()
    bench.mode(MISSION)
    bench.until(lambda: bench.craft.position_m[0] > 1.0)
    assert bench.mode(LOITER) == [0, 0]
    held = bench.craft.position_m
    bench.advance(5.0)
    assert (bench.craft.position_m, bench.craft.current) == (held, 1)
    assert bench.mode(MISSION) == [0, 0]
    bench.until(over(bench))
    assert bench.craft.item_reached == 3


def test_land_ends_where_it_is_and_two_seconds_later_the_motors_stop():
    bench = Bench()
    bench.upload(bench.items(*ROWS))
    bench.arm()
    bench.mode(MISSION)
    bench.until(lambda: bench.craft.position_m[0] > 1.0)
    bench.mode(LAND)
    bench.until(lambda: bench.craft.landed.name == "ON_GROUND")
    begin_ns = bench.t_ns
    bench.until(lambda: not bench.craft.armed)
    assert (bench.t_ns - begin_ns) / S == pytest.approx(2.0, abs=0.05)
    assert bench.advance(1.0).last("HEARTBEAT").custom_mode >> 24 == 4  # the user's last intended mode: the mission


def test_what_was_uploaded_is_handed_out_the_same():
    bench = Bench()
    items = bench.items(*ROWS)
    bench.upload(items)
    bench.tell(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    bench.step(bench.t_ns + STEP)
    assert bench.last("MISSION_COUNT").count == 4
    for seq in range(4):
        bench.tell(mavlink.MAVLink_mission_request_int_message(1, 1, seq, 0))
    bench.step(bench.t_ns + STEP)

    def content(item):
        numbers = (item.param1, item.param2, item.param3, str(item.param4), item.z)
        return (item.seq, item.frame, item.command, item.current, item.autocontinue, item.x, item.y, *numbers)

    assert [content(item) for item in bench.of("MISSION_ITEM_INT")] == [content(item) for item in items]


def test_the_first_item_is_asked_for_with_request_the_others_with_request_int():
    bench = Bench()
    bench.upload(bench.items(*ROWS))
    asked = [(m.get_type(), m.seq) for m in bench.of("MISSION_REQUEST", "MISSION_REQUEST_INT")]
    assert asked == [("MISSION_REQUEST", 0), *(("MISSION_REQUEST_INT", seq) for seq in (1, 2, 3))]


def test_a_sender_that_cannot_do_it_in_floats_is_asked_for_integers():
    bench = Bench()
    bench.tell(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    bench.tell(mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_UNSUPPORTED, 0))
    bench.step(bench.t_ns + STEP)
    asked = [(m.get_type(), m.seq) for m in bench.of("MISSION_REQUEST", "MISSION_REQUEST_INT")]
    assert asked == [("MISSION_REQUEST", 0), ("MISSION_REQUEST_INT", 0)]


def test_an_item_that_does_not_come_is_asked_for_again_and_given_up_after_five_seconds():
    bench = Bench()
    bench.tell(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    bench.advance(8.0)
    asked = bench.of("MISSION_REQUEST")
    assert len(asked) == 20
    bench.tell(bench.items(*ROWS)[0])
    bench.step(bench.t_ns + STEP)
    assert bench.last("MISSION_ACK").type == mavlink.MAV_MISSION_ERROR


def test_the_last_item_again_is_acknowledged_again():
    bench = Bench()
    items = bench.items(*ROWS)
    bench.upload(items)
    bench.tell(items[-1])
    bench.step(bench.t_ns + STEP)
    assert [message.type for message in bench.of("MISSION_ACK")] == [0, 0]


@pytest.mark.parametrize(
    "change, result",
    [
        ({"frame": 1}, mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        ({"command": 9999}, mavlink.MAV_MISSION_UNSUPPORTED),
        ({"z": float("nan")}, mavlink.MAV_MISSION_INVALID_PARAM7),
    ],
    ids=["local frame", "unknown command", "no height"],
)
def test_an_item_that_cannot_be_flown_refuses_the_whole_mission(change, result):
    bench = Bench()
    items = bench.items(*ROWS)
    for name, value in change.items():
        setattr(items[1], name, value)
    assert bench.upload(items) == result
    assert bench.craft.items == ()


def test_two_uploads_at_once_are_not_mixed():
    bench = Bench()
    bench.px4.connect("other")
    bench.tell(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    bench.tell(mavlink.MAVLink_mission_count_message(1, 1, 3, 0), link="other")
    bench.step(bench.t_ns + STEP)
    answers = [(link, m.get_type()) for _, link, m in bench.heard if m.get_type().startswith("MISSION_")]
    assert [each for each in answers if each[1] != "MISSION_CURRENT"] == [
        ("client", "MISSION_REQUEST"),
        ("other", "MISSION_ACK"),
    ]


def test_more_items_than_it_holds_are_refused_and_none_clears_it():
    bench = Bench(mission_capacity=3)
    assert bench.upload(bench.items(*ROWS)) == mavlink.MAV_MISSION_NO_SPACE
    assert bench.upload(bench.items(*ROWS[:1])) == 0
    bench.tell(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    bench.advance(1.0)
    assert bench.craft.items == ()
    assert bench.arm() == [0]
    assert bench.mode(MISSION) == [0, mavlink.MAV_RESULT_TEMPORARILY_REJECTED]


def test_a_mission_that_does_not_land_ends_in_the_air():
    bench = Bench(QUICK)
    bench.upload(bench.items(*ROWS, land=False))
    bench.arm()
    bench.mode(MISSION)
    bench.until(lambda: bench.craft.mission_over).advance(5.0)
    assert (bench.craft.armed, bench.craft.height_m, bench.texts()[-1]) == (True, 3.0, "Mission finished, loitering\t")
