"""Sending a mission over any channel: what is on the vehicle in the end, or why it is not."""

from __future__ import annotations

from dataclasses import replace
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission_channel import MS, TARGET, Channel, S, Vehicle, good

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.planner.mission_upload import (
    Dialect,
    MissionItem,
    MissionUpload,
    UploadPhase,
    beginning,
    difference,
    mission_items,
    waypoint_index,
)
from amaze_autonomy.missions import Home, Place, Trajectory, Waypoint

HOME = Home(47.397742, 8.545594)
SQUARE = Trajectory(
    "square.csv",
    (
        Waypoint(0.0, 0.0, 2.0, 0.0, 1.0),
        Waypoint(4.0, 0.0, 2.5, 1.5707963267948966, 0.5),
        Waypoint(4.0, 4.0, 2.0, -3.0, 0.0),
    ),
)


def items(dialect: Dialect = Dialect.PX4, trajectory: Trajectory = SQUARE):
    return mission_items(trajectory, HOME, Place(47.397742, 8.545594), 1.2, 0.5, dialect)


def transfer(channel_fate=good, limit_ns: int = 8 * S, current: int = 0, mission=None):
    """Run a transfer; return it, the vehicle and the channel."""
    vehicle = Vehicle(current)
    upload = MissionUpload(mission or items(), TARGET, 0, 500 * MS, limit_ns)
    channel = Channel(upload, vehicle, channel_fate)
    channel.ours(upload.start(0))
    channel.run(lambda: upload.over, limit_ns + S)
    return upload, vehicle, channel


def on_vehicle(vehicle):
    return [(each.command, each.x, each.y, round(each.z, 3), each.params[0]) for each in vehicle.server.items]


EXPECTED = [(each.command, each.latitude_e7, each.longitude_e7, each.height_m, each.hold_s) for each in items()]


def test_a_flight_is_a_takeoff_its_waypoints_and_a_landing():
    assert items() == (
        MissionItem(22, 473977420, 85455940, 1.2),
        MissionItem(16, 473977420, 85455940, 2.0, 1.0, 0.5, 90.0),
        MissionItem(16, 473977420, 85456470, 2.5, 0.5, 0.5, 0.0),
        MissionItem(16, 473977780, 85456470, 2.0, 0.0, 0.5, pytest.approx(261.887, abs=1e-3)),
        MissionItem(21, 473977780, 85456470, 0.0),
    )
    assert [waypoint_index(number, Dialect.PX4) for number in range(5)] == [-1, 0, 1, 2, 3]


def test_places_of_a_file_in_latitude_and_longitude_are_sent_as_they_stand_there():
    places = (Place(47.1234567, 8.7654321),)
    (_, waypoint, _) = items(trajectory=Trajectory("a.csv", SQUARE.waypoints[:1], places=places))
    assert (waypoint.latitude_e7, waypoint.longitude_e7) == (471234567, 87654321)


def turn(heading_deg):
    return MissionItem(115, 0, 0, 0.0, hold_s=heading_deg, heading_deg=0.0)


def test_before_ardupilots_mission_stands_its_home_before_each_waypoint_a_turn_and_holds_are_whole_seconds():
    takeoff, first, second, third, land = items()
    south = turn(pytest.approx(261.887, abs=1e-3))
    flown = (turn(90.0), first, turn(0.0), replace(second, hold_s=1.0), south, third)
    assert items(Dialect.ARDUPILOT)[1:] == (takeoff, *flown, land)
    home_moved = MissionItem(16, 1, 2, 488.0).message(0, TARGET)
    assert difference(items(Dialect.ARDUPILOT), 0, home_moved, Dialect.ARDUPILOT) == ""


def test_a_turn_is_absolute_to_the_nearer_side_and_as_fast_as_the_vehicle_turns():
    sent = items(Dialect.ARDUPILOT)[6].message(6, TARGET)
    assert (sent.command, sent.param1) == (mavlink.MAV_CMD_CONDITION_YAW, pytest.approx(261.887, abs=1e-3))
    assert (sent.param2, sent.param3, sent.param4, sent.x, sent.y, sent.z) == (0.0, 0.0, 0.0, 0, 0, 0.0)


@pytest.mark.parametrize("field, value", [("param1", 91.0), ("param4", 1.0)])
def test_a_turn_that_came_back_as_another_one_is_none(field, value):
    mission = items(Dialect.ARDUPILOT)
    read = mission[2].message(2, TARGET)
    read.frame = 0  # ArduPilot does not keep it
    assert difference(mission, 2, read, Dialect.ARDUPILOT) == ""
    setattr(read, field, value)
    assert difference(mission, 2, read, Dialect.ARDUPILOT).startswith(f"item 2 came back with {field} {value:g}")


def test_items_of_ardupilot_are_counted_as_the_waypoints_that_they_belong_to():
    home, takeoff, *flown, land = range(9)
    indices = [waypoint_index(number, Dialect.ARDUPILOT) for number in (home, takeoff, *flown, land)]
    assert indices == [-1, -1, 0, 0, 1, 1, 2, 2, 3]
    assert [beginning(number, Dialect.ARDUPILOT) for number in range(9)] == [0, 1, 2, 2, 4, 4, 6, 6, 8]
    assert [beginning(number, Dialect.PX4) for number in range(5)] == [0, 1, 2, 3, 4]


def test_over_a_good_link_it_is_sent_read_back_and_begins_at_its_beginning():
    upload, vehicle, channel = transfer(current=4)
    assert (upload.phase, upload.reason, on_vehicle(vehicle), vehicle.current) == (
        UploadPhase.DONE,
        "",
        EXPECTED,
        0,
    )
    assert channel.sent == [
        "MISSION_COUNT",
        *["MISSION_ITEM_INT"] * 5,
        "MISSION_REQUEST_LIST",
        *["MISSION_REQUEST_INT"] * 5,
        "MISSION_ACK",
        *["MISSION_SET_CURRENT"] * channel.sent.count("MISSION_SET_CURRENT"),
    ]


def test_only_the_first_item_is_marked_as_the_current_one():
    assert [each.message(number, TARGET).current for number, each in enumerate(items())] == [1, 0, 0, 0, 0]


FATES = st.lists(st.sampled_from(["good", "lost", "twice", "late", "much later"]), max_size=100)
DELAYS = {
    "good": (5 * MS,),
    "lost": (),
    "twice": (5 * MS, 120 * MS),
    "late": (300 * MS,),
    "much later": (5 * MS, 1900 * MS),
}


@settings(max_examples=150, deadline=None)
@given(FATES, st.integers(0, 4))
def test_whatever_the_link_does_at_first_the_mission_arrives(fates, current):
    script = iter(fates)
    upload, vehicle, _ = transfer(lambda: DELAYS[next(script, "good")], 120 * S, current)
    assert (upload.phase, on_vehicle(vehicle), vehicle.current) == (UploadPhase.DONE, EXPECTED, 0)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([0.05, 0.2, 0.4]))
def test_it_ends_within_its_limit_and_never_believes_a_mission_that_is_not_there(seed, loss):
    random = Random(seed)
    upload, vehicle, channel = transfer(
        lambda: () if random.random() < loss else (random.randrange(100 * MS),), current=3
    )
    assert upload.over
    assert channel.t_ns <= 9 * S
    if upload.phase is UploadPhase.DONE:
        assert (on_vehicle(vehicle), vehicle.current) == (EXPECTED, 0)
    else:
        assert "no end within the limit" in upload.reason


def test_a_hundred_and_fifty_waypoints_arrive_in_order():
    many = Trajectory("many.csv", tuple(Waypoint(i * 0.1, 0.0, 2.0, 0.0, 0.0) for i in range(150)))
    upload, vehicle, _ = transfer(mission=items(trajectory=many))
    assert (upload.phase, len(vehicle.server.items)) == (UploadPhase.DONE, 152)


CUTS = [(UploadPhase.ITEMS, 4.0), (UploadPhase.READ, 4.0), (UploadPhase.READ, 7.0)]


@pytest.mark.parametrize("phase, silent_s", CUTS)
def test_a_link_that_is_cut_for_seconds_costs_what_was_under_way_and_not_what_has_arrived(phase, silent_s):
    upload, vehicle = MissionUpload(items(), TARGET, 0, 500 * MS, 20 * S), Vehicle()
    channel = Channel(upload, vehicle)
    channel.ours(upload.start(0))
    channel.run(lambda: upload.phase is phase, S)
    channel.fate = lambda: ()
    channel.run(lambda: False, round(silent_s * S))
    channel.fate = good
    channel.run(lambda: upload.over, 2 * S)
    assert (upload.phase, on_vehicle(vehicle)) == (UploadPhase.DONE, EXPECTED)
    assert channel.sent.count("MISSION_COUNT") == 1


def test_a_mission_that_is_refused_says_why_when_its_time_is_over():
    many = Trajectory("many.csv", tuple(Waypoint(i * 0.1, 0.0, 2.0, 0.0, 0.0) for i in range(300)))
    upload, vehicle, channel = transfer(mission=items(trajectory=many), limit_ns=3 * S)
    assert upload.phase is UploadPhase.FAILED
    assert upload.reason == ("announcing: no end within the limit (the autopilot says MAV_MISSION_NO_SPACE)")
    assert vehicle.server.items == ()
    assert len(channel.sent) < 10  # it does not flood


def test_silence_ends_at_the_limit():
    upload, _, channel = transfer(lambda: (), limit_ns=3 * S)
    assert upload.reason == "announcing: no end within the limit"
    assert channel.t_ns <= 4 * S


def _started():
    upload = MissionUpload(items(), TARGET, 0, 500 * MS, 8 * S)
    upload.start(0)
    return upload


def test_an_acknowledgement_of_the_transfer_before_ends_nothing():
    upload = _started()
    assert upload.receive(1, mavlink.MAVLink_mission_ack_message(1, 191, mavlink.MAV_MISSION_ACCEPTED)) == []
    assert upload.phase is UploadPhase.COUNT


def test_requests_beyond_the_end_and_of_other_missions_get_no_answer():
    upload = _started()
    for number, kind in ((5, 0), (65535, 0), (0, mavlink.MAV_MISSION_TYPE_FENCE)):
        assert upload.receive(1, mavlink.MAVLink_mission_request_int_message(1, 191, number, kind)) == []
    assert upload.phase is UploadPhase.COUNT


def test_both_kinds_of_requests_are_answered_with_integers():
    upload = _started()
    for kind in (mavlink.MAVLink_mission_request_message, mavlink.MAVLink_mission_request_int_message):
        (answer,) = upload.receive(1, kind(1, 191, 2))
        assert (answer.get_type(), answer.seq) == ("MISSION_ITEM_INT", 2)


class Forgetful(Vehicle):
    """Keeps something else than it was sent, the first time."""

    def __init__(self, change) -> None:
        super().__init__()
        self.change, self.changed = change, False

    def take(self, t_ns, message):
        answers = super().take(t_ns, message)
        for answer in answers:
            if answer.get_type() == "MISSION_ITEM_INT" and answer.seq == 2 and not self.changed:
                self.changed = True
                self.change(answer)
        return answers


@pytest.mark.parametrize(
    "field, value, reason",
    [
        ("x", 473977423, "item 2 came back with x 473977423 instead of 473977420"),
        ("z", 2.52, "item 2 came back with z 2.52 instead of 2.5"),
        ("param1", 0.0, "item 2 came back with param1 0 instead of 0.5"),
        ("param4", 12.0, "item 2 came back with param4 12 instead of 0"),
        ("param2", 2.0, "item 2 came back with param2 2 instead of 0.5"),
        ("param3", 1.0, "item 2 came back with param3 1 instead of 0"),
        ("autocontinue", 0, "item 2 came back with autocontinue 0 instead of 1"),
        ("command", 17, "item 2 came back with command 17 instead of 16"),
        ("frame", 0, "item 2 came back in frame 0"),
    ],
)
def test_what_came_back_otherwise_is_named_and_sent_again(field, value, reason):
    vehicle = Forgetful(lambda answer: setattr(answer, field, value))
    upload = MissionUpload(items(), TARGET, 0, 500 * MS, 8 * S)
    channel = Channel(upload, vehicle)
    channel.ours(upload.start(0))
    channel.run(lambda: upload.reason != "", 8 * S)
    assert upload.reason == reason
    channel.run(lambda: upload.over, 8 * S)
    assert (upload.phase, on_vehicle(vehicle)) == (UploadPhase.DONE, EXPECTED)


def test_an_ardupilot_keeps_neither_radii_nor_autocontinue():
    mission = items(Dialect.ARDUPILOT)
    read = mission[3].message(3, TARGET)
    read.param2, read.param3, read.autocontinue = 0.0, 1.0, 0
    assert difference(mission, 3, read, Dialect.ARDUPILOT) == ""


@pytest.mark.parametrize("dialect, reason", [(Dialect.PX4, "item 4 came back in frame 0"), (Dialect.ARDUPILOT, "")])
def test_px4_keeps_the_frame_of_a_landing_and_an_ardupilot_may_forget_it(dialect, reason):
    mission = items(dialect)
    read = mission[-1].message(len(mission) - 1, TARGET)
    read.frame = 0
    assert difference(mission, len(mission) - 1, read, dialect) == reason


def test_rounding_by_the_autopilot_is_no_difference():
    def rounded(answer):
        answer.x += 1
        answer.z += 0.004
        answer.param4 = 360.0

    vehicle = Forgetful(rounded)
    upload = MissionUpload(items(), TARGET, 0, 500 * MS, 8 * S)
    channel = Channel(upload, vehicle)
    channel.ours(upload.start(0))
    channel.run(lambda: upload.over, 8 * S)
    assert (upload.phase, upload.reason, vehicle.changed) == (UploadPhase.DONE, "", True)
