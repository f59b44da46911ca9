"""The mission protocol over mavros' services: the real upload on one side, a mavros that can fail on the other."""

from __future__ import annotations

from types import SimpleNamespace as Said

import pytest

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.mavros.requests import QUIET, MavrosMission
from amaze_autonomy.autopilot.planner.held import HeldMission
from amaze_autonomy.autopilot.planner.mission_upload import Dialect, MissionItem, MissionUpload, UploadPhase

S = 1_000_000_000
ITEMS = tuple(MissionItem(16, 473977431 + 100 * n, 85455942, 2.0 + n, hold_s=0.5, heading_deg=90.0) for n in range(4))


class Mavros:
    """A mavros and the vehicle behind it; what it is asked is done when the test says so.

    Args:
        upload: that speaks to it.
    """

    begins_at = 0

    def __init__(self, upload):
        self.upload, self.mission = upload, MavrosMission()
        self.vehicle, self.current, self.called, self.waiting = (), 3, [], []
        self.t_ns = 0
        self.send(upload.start(0))

    def send(self, messages):
        for message in messages:
            taken = self.mission.take(message)
            self.waiting.extend(taken.requests)
            for answer in taken.answers:
                self.send(self.upload.receive(self.t_ns, answer))

    def give(self, messages):
        for message in messages:
            self.send(self.upload.receive(self.t_ns, message))

    def publish(self, waypoints=None):
        self.give(self.mission.listed(Said(current_seq=self.current, waypoints=waypoints or self.vehicle)))

    def serve(self, *, works=True, list_first=True, quiet=True):
        """Answer the oldest request; then mavros is quiet for a while."""
        request = self.waiting.pop(0)
        self.called.append(request.service)
        answer = None
        if works:
            answer = getattr(self, request.service.split("/")[1])(request.fields, list_first=list_first)
        self.give(self.mission.answered(request, answer))
        if works and request.kind == "WaypointPull" and not list_first:
            self.publish()
        self.wake(QUIET if quiet else 0)

    def wake(self, times, *, read=True):
        for _ in range(times):
            self.give(self.mission.wake(read=read))

    def push(self, fields, **_):
        self.vehicle = tuple(Said(**each) for each in fields["waypoints"])
        return Said(success=True, wp_transfered=len(self.vehicle))

    def pull(self, _, *, list_first):
        if list_first:
            self.publish()
        return Said(success=True, wp_received=len(self.vehicle))

    def set_current(self, fields, **_):
        self.current = max(fields["wp_seq"], self.begins_at)
        self.publish()
        return Said(success=True)

    def wait(self, seconds):
        self.t_ns += round(seconds * S)
        self.send(self.upload.wake(self.t_ns))


class ArduPilotMavros(Mavros):
    """ArduPilot overwrites item 0 with its home, keeps no yaw of a waypoint, and begins at item 1."""

    begins_at = 1

    def push(self, fields, **_):
        answer = super().push(fields)
        home = {**vars(self.vehicle[0]), "frame": 0, "x_lat": 47.1, "y_long": 8.2, "z_alt": 489.0}
        kept = (Said(**{**vars(each), "param4": 0.0}) for each in self.vehicle[1:])
        self.vehicle = (Said(**home), *kept)
        return answer


def begin(kind=Mavros, dialect=Dialect.PX4):
    return kind(MissionUpload(ITEMS, (1, 1), 0, S // 2, 8 * S, dialect))


def test_an_ardupilot_s_home_is_pushed_and_pulled_as_item_0_and_never_compared():
    mavros = begin(ArduPilotMavros, Dialect.ARDUPILOT)
    while not mavros.upload.over:
        mavros.serve()
    assert (mavros.upload.phase, mavros.upload.reason) == (UploadPhase.DONE, "")
    assert mavros.called == ["mission/push", "mission/pull", "mission/set_current"]
    assert (len(mavros.vehicle), mavros.vehicle[0].z_alt, mavros.current) == (4, 489.0, 1)


def test_what_an_ardupilot_keeps_otherwise_is_found_behind_its_home():
    mavros = begin(ArduPilotMavros, Dialect.ARDUPILOT)
    mavros.serve()
    mavros.vehicle[1].z_alt = 9.0
    mavros.serve()
    assert mavros.upload.reason == "item 1 came back with z 9 instead of 3"


@pytest.mark.parametrize("list_first", [True, False])
def test_a_mission_is_pushed_pulled_compared_and_set_to_its_beginning(list_first):
    mavros = begin()
    while not mavros.upload.over:
        mavros.serve(list_first=list_first)
    assert (mavros.upload.phase, mavros.upload.reason) == (UploadPhase.DONE, "")
    assert mavros.called == ["mission/push", "mission/pull", "mission/set_current"]
    assert [each.is_current for each in mavros.vehicle] == [True, False, False, False]
    assert mavros.vehicle[1] == Said(
        frame=3,
        command=16,
        is_current=False,
        autocontinue=True,
        param1=0.5,
        param2=0.0,
        param3=0.0,
        param4=90.0,
        x_lat=pytest.approx(47.3977531),
        y_long=pytest.approx(8.5455942),
        z_alt=3.0,
    )


def test_a_mission_that_came_back_changed_is_sent_again():
    mavros = begin()
    mavros.serve()
    mavros.vehicle[2].z_alt = 9.0
    mavros.serve()
    assert mavros.upload.reason == "item 2 came back with z 9 instead of 4"
    while not mavros.upload.over:
        mavros.serve()
    assert mavros.called == ["mission/push", "mission/pull"] * 2 + ["mission/set_current"]


def test_a_list_that_mavros_keeps_from_before_is_not_taken_for_the_vehicles():
    mavros = begin()
    mavros.publish([Said()] * 4)  # as long, and none of it ours
    mavros.serve()
    assert mavros.upload.phase is UploadPhase.LIST
    mavros.serve()
    assert mavros.upload.phase is UploadPhase.CURRENT


@pytest.mark.parametrize("late", [1, QUIET - 1])
def test_the_list_of_a_push_that_comes_behind_the_answer_of_the_pull_is_not_taken_for_the_vehicles(late):
    """mavros answers before it publishes, by another connection: of a push, what was pushed."""
    mavros = begin()
    mavros.serve()
    pushed = mavros.vehicle
    mavros.vehicle = tuple(Said(**vars(each)) for each in pushed)
    mavros.vehicle[2].z_alt = 9.0
    mavros.pull = lambda _, **__: Said(success=True, wp_received=4)
    mavros.serve(quiet=False)
    mavros.wake(late)
    mavros.publish(pushed)
    mavros.wake(late)
    assert (mavros.upload.phase, mavros.upload.reason) == (UploadPhase.LIST, "")
    mavros.publish()
    mavros.wake(QUIET)
    assert mavros.upload.reason == "item 2 came back with z 9 instead of 4"


def test_what_a_node_that_stood_still_has_not_read_yet_may_be_the_list_of_the_pull():
    mavros = begin()
    mavros.serve()
    mavros.serve(quiet=False)
    mavros.wake(10 * QUIET, read=False)
    mavros.wake(QUIET - 1)
    assert mavros.upload.phase is UploadPhase.LIST
    mavros.wake(1)
    assert mavros.upload.phase is UploadPhase.CURRENT


def test_a_mission_whose_list_does_not_come_is_pulled_again():
    mavros = begin()
    mavros.serve()
    mavros.pull = lambda _, **__: Said(success=True, wp_received=4)
    mavros.serve()
    del mavros.pull
    mavros.wait(0.5)
    mavros.serve()
    assert mavros.upload.phase is UploadPhase.CURRENT
    assert mavros.called == ["mission/push", "mission/pull", "mission/pull"]


def test_a_reading_that_begins_while_the_list_of_the_one_before_is_waited_for_pulls_at_once():
    held, mavros = held_mission()
    mavros.serve(quiet=False)
    mavros.wait(0.1)
    held.resume(mavros.t_ns)
    mavros.wait(0.1)
    assert [request.service for request in mavros.waiting] == ["mission/pull"]
    assert not held.over
    mavros.serve()
    assert held.over


def test_a_slow_push_is_not_made_twice():
    mavros = begin()
    for _ in range(4):
        mavros.wait(0.5)
    assert [request.service for request in mavros.waiting] == ["mission/push"]
    while not mavros.upload.over:
        if mavros.waiting:
            mavros.serve()
        mavros.wait(0.5)
    assert mavros.called == ["mission/push", "mission/pull", "mission/set_current"]


def test_services_that_fail_fail_the_transfer_with_its_reason():
    mavros = begin()
    while not mavros.upload.over:
        while mavros.waiting:
            mavros.serve(works=False)
        mavros.wait(0.5)
    assert mavros.upload.phase is UploadPhase.FAILED
    assert "the autopilot says MAV_MISSION_ERROR" in mavros.upload.reason
    assert mavros.t_ns <= 9 * S


def test_where_the_vehicle_is_in_its_mission_comes_with_the_list():
    (message,) = MavrosMission().listed(Said(current_seq=2, waypoints=[]))
    assert (message.get_type(), message.seq) == ("MISSION_CURRENT", 2)
    assert MavrosMission().take(mavlink.MAVLink_timesync_message(0, 1)) is None


def held_mission():
    """Return a mission that is held, and a mavros that is asked for it: it has been read once, and is ours."""
    loaded = begin()
    while not loaded.upload.over:
        loaded.serve()

    def reads(t_ns):
        return loaded.upload.verification(t_ns, 8 * S, sets_current=False)

    held = HeldMission(reads, 3 * S, 0, agreed_patience_ns=3 * S)
    held.start = held.wake
    mavros = Mavros(held)
    mavros.vehicle = loaded.vehicle
    mavros.serve()
    mavros.wait(3.0)
    assert mavros.called == ["mission/pull"]
    return held, mavros


def test_a_pull_that_was_under_way_when_the_mission_is_to_go_on_does_not_answer_the_reading_that_begins_then():
    held, mavros = held_mission()
    assert [request.service for request in mavros.waiting] == ["mission/pull"]  # another reading of the hold
    held.resume(mavros.t_ns)
    mavros.wait(0.1)
    mavros.serve()
    assert (held.over, held.may_go_on(mavros.t_ns), mavros.waiting) == (False, False, [])
    mavros.vehicle[2].z_alt = 9.0  # while that pull was on its way
    for _ in range(2):
        assert not held.difference
        mavros.wait(0.5)
        mavros.serve()
    assert (held.over, held.difference) == (False, "item 2 came back with z 9 instead of 4")


def test_after_a_pull_that_counts_no_more_the_mission_is_pulled_anew_and_goes_on():
    held, mavros = held_mission()
    held.resume(mavros.t_ns)
    mavros.wait(0.1)
    mavros.serve(works=False)
    mavros.wait(0.5)
    mavros.serve()
    assert (held.over, held.may_go_on(mavros.t_ns)) == (True, True)
    assert mavros.called == ["mission/pull"] * 3


def test_a_slow_pull_of_one_reading_is_waited_for():
    """It is asked for again and again meanwhile."""
    held, mavros = held_mission()
    mavros.serve()
    mavros.wait(0.1)
    held.resume(mavros.t_ns)
    for _ in range(5):
        mavros.wait(0.5)
    assert [request.service for request in mavros.waiting] == ["mission/pull"]
    mavros.serve()
    assert held.over
