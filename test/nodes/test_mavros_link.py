"""The link through mavros without ROS: which service is called, for how long, and what is not called any more.

And who is heard: what mavros answers is no word of the vehicle, its topics are.
"""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from genpy import SerializationError

from amaze_autonomy.autopilot.link.connection import link_problem
from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.mavros.messages import BATTERY, EKF, HOME, ORIGIN, RECEIVED, TEXT
from amaze_autonomy.autopilot.mavros.requests import LATE_NS, Lane, request_of
from amaze_autonomy.autopilot.planner.sequencer import PLANNER_MESSAGES, Sequencer, SequencerSettings
from amaze_autonomy.autopilot.vehicle.client import CLIENT_MESSAGES, AutopilotClient
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import FlightModel, PlannerSpec
from amaze_autonomy.monitoring.specs import BatterySpec
from amaze_autonomy.nodes.vehicle import mavros_link
from amaze_autonomy.nodes.vehicle.mavros_link import MavrosLink
from amaze_autonomy.ros.errors import CallTimeoutError

LIMIT_S, S = 5.0, 1_000_000_000
NO_FIELD = "'types.SimpleNamespace' object has no attribute 'mode_sent'"
PX4 = mavlink.MAV_AUTOPILOT_PX4


QUIET = SimpleNamespace(receive=lambda *_, **_heard: (), wake=lambda *_, **_read: (), key=lambda *_: None)
"""A client that says nothing."""


def command(number, *parameters):
    given = (*parameters, *[0.0] * (7 - len(parameters)))
    return request_of(mavlink.MAVLink_command_long_message(1, 1, number, 0, *given), PX4)


LAND, MISSION = command(176, 1.0, 4.0, 6.0), command(176, 1.0, 4.0, 4.0)
ARM, INTERVAL = command(400, 1.0), command(511, 0.0)


class Services:
    """Those of mavros: what was called, in order; a service that hangs answers when it is told to."""

    def __init__(self):
        self.called, self.hanging, self.kept, self.expiring = [], {}, [], []
        self.failing = {}  # what a function fails with, each thing once
        self.changed = threading.Condition()

    def client(self, name, _service, _master, _caller):
        def ask(_limit_s, *, expires=False, **fields):
            with self.changed:
                self.expiring += [fields.get("custom_mode", fields.get("command"))] if expires else []
                self.called.append(fields.get("custom_mode", fields.get("command")))
                self.changed.notify_all()
            self.fail("ask")
            goes_on = self.hanging.get(name)
            if goes_on is not None and not goes_on.wait(LIMIT_S):
                raise CallTimeoutError("did not answer within the limit")
            strange = self.failing.pop("answer", None)
            return strange or SimpleNamespace(success=True, mode_sent=True, result=0)

        def keep(_limit_s):
            with self.changed:
                self.kept.append(name)
                self.changed.notify_all()
            self.fail("keep")

        return SimpleNamespace(name=name, ask=ask, keep=keep)

    def fail(self, place):
        with self.changed:
            error = self.failing.pop(place, None)
        if error is not None:
            raise error

    def wait(self, expected):
        return self.until(lambda: expected in self.called)

    def until(self, condition):
        with self.changed:
            return self.changed.wait_for(condition, LIMIT_S)


@pytest.fixture
def services(monkeypatch):
    made = Services()
    monkeypatch.setattr(mavros_link, "_imported", lambda _module, _name: None)
    monkeypatch.setattr(mavros_link, "ServiceClient", made.client)
    monkeypatch.setattr(mavros_link, "_LOOK_S", 0.01)
    return made


@pytest.fixture
def complaints():
    return []


@pytest.fixture
def link(services, complaints):
    made = MavrosLink("/mavros", QUIET, CLIENT_MESSAGES, lambda: 0, complaints.append)
    made._announce = lambda: None
    threads = [threading.Thread(target=made._serve, args=(lane,)) for lane in Lane]
    made.begin = lambda: [each.start() for each in threads]
    yield made
    for goes_on in services.hanging.values():
        goes_on.set()
    made._ended.set()
    for each in threads:
        if each.ident is not None:
            each.join(LIMIT_S)


@pytest.mark.live
@pytest.mark.parametrize("hanging", [ARM, INTERVAL], ids=["arming", "interval"])
def test_a_landing_waits_for_no_command_that_hangs(link, services, hanging):
    services.hanging["/mavros/cmd/command"] = threading.Event()
    link.begin()
    link._enqueue(hanging)
    assert services.wait(hanging.command)
    link._enqueue(LAND)
    assert services.wait("AUTO.LAND")


@pytest.mark.live
@pytest.mark.parametrize(
    "place, error, words",
    [
        ("ask", MemoryError(), "/mavros/set_mode: MemoryError: "),
        ("ask", SerializationError("field custom_mode"), "/mavros/set_mode: SerializationError: field custom_mode"),
        (
            "answer",
            SimpleNamespace(ok=True),
            "AttributeError: 'types.SimpleNamespace' object has no attribute 'mode_sent'",
        ),
        ("keep", MemoryError(), "MemoryError: "),
    ],
    ids=["memory", "request", "another version", "idle"],
)
def test_a_landing_is_commanded_after_whatever_went_wrong_before_it(link, services, complaints, place, error, words):
    services.failing[place] = error
    link.begin()
    link._enqueue(MISSION)
    assert services.wait("AUTO.MISSION")
    assert services.until(lambda: not services.failing)
    link._enqueue(LAND)
    assert services.wait("AUTO.LAND")
    assert services.until(lambda: link.state.errors and complaints)
    assert (link.state.errors, complaints) == (1, [words])


@pytest.mark.live
def test_a_landing_is_commanded_though_nothing_can_be_said_of_what_went_wrong(link, services, monkeypatch):
    def complain(_words):
        raise MemoryError

    monkeypatch.setattr(link, "_complain", complain)
    services.failing["ask"] = MemoryError()
    link.begin()
    for request, mode in ((MISSION, "AUTO.MISSION"), (LAND, "AUTO.LAND")):
        link._enqueue(request)
        assert services.wait(mode)


def test_a_mission_whose_call_fails_in_whatever_way_is_answered_as_one_that_failed(link, services):
    services.failing["ask"] = MemoryError()
    assert link._call(MISSION) is None


@pytest.mark.live
def test_what_waited_behind_a_service_that_hung_is_not_sent_any_more_but_for_a_landing(link, services, monkeypatch):
    goes_on = services.hanging["/mavros/set_mode"] = threading.Event()
    now_ns = [0]
    monkeypatch.setattr(mavros_link.time, "monotonic_ns", lambda: now_ns[0])
    link.begin()
    link._enqueue(command(176, 1.0, 4.0, 3.0))
    assert services.wait("AUTO.LOITER")
    for request in (MISSION, LAND):
        link._enqueue(request)
    now_ns[0] += LATE_NS + 1
    goes_on.set()
    assert services.wait("AUTO.LAND")
    assert services.called == ["AUTO.LOITER", "AUTO.LAND"]
    assert link.state.unsent == 1


ARDUPILOT, NOBODY = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_AUTOPILOT_GENERIC


@pytest.mark.parametrize(
    "wanted, mode, taken",
    [
        (CLIENT_MESSAGES, "GUIDED", {EKF, BATTERY, HOME, ORIGIN, TEXT}),
        (PLANNER_MESSAGES, "GUIDED", {EKF, HOME, TEXT}),
        (CLIENT_MESSAGES, "AUTO.LOITER", {BATTERY, TEXT}),
        (PLANNER_MESSAGES, "AUTO.LOITER", {TEXT}),
        (CLIENT_MESSAGES, "ACRO", set()),
    ],
)
def test_of_what_mavros_receives_only_what_no_topic_has_is_looked_at(services, monkeypatch, wanted, mode, taken):
    assert services.called == []
    subscribed, found, noted = [], set(), []
    subscriber = threading.Event()
    monkeypatch.setattr(
        mavros_link.rospy, "Subscriber", lambda topic, *_, **__: subscribed.append(topic) or subscriber.set()
    )
    monkeypatch.setattr(mavros_link.rospy, "get_param", lambda _name, default: default)
    made = MavrosLink("/mavros", QUIET, wanted, lambda: 0, lambda _: None)
    made._announce = lambda: None
    for _ in range(2):
        made._take(SimpleNamespace(connected=True, armed=False, mode=mode, system_status=3), mavros_link.STATE)
    if taken:
        assert subscriber.wait(LIMIT_S)
    assert subscribed == ["/mavlink/from"] * bool(taken)
    made._take = lambda message, source: found.add((message.msgid, source))
    made._converter.note_sender = lambda _t_ns, message: noted.append(message.msgid)
    for number in (0, 30, BATTERY, EKF, HOME, ORIGIN, TEXT):
        made._take_received(SimpleNamespace(msgid=number))
    assert found == {(number, RECEIVED) for number in taken}
    assert noted == [0, 30, BATTERY, EKF, HOME, ORIGIN, TEXT]


def test_a_second_vehicle_behind_mavros_is_told_and_said_to_be_taken_for_ours(services):
    node = AutopilotClient(AutopilotSettings(backend="mavros"), BatterySpec(), lambda: (1, 1))
    link, clock, said = linked(node, CLIENT_MESSAGES)
    link._take(said, mavros_link.STATE)
    assert (link.state.strangers, services.called) == (None, [])
    for number in range(250):
        clock.t_ns += S // 50
        for first in (0, 120):
            link._take_received(
                SimpleNamespace(msgid=74, framing_status=1, seq=(first + number) % 256, sysid=1, compid=1)
            )
    assert link_problem(link.state, clock.t_ns) == (
        "another vehicle is heard (mavros, where ours is, too), and it is taken for ours: "
        "let mavros hear one vehicle alone (a link or port of its own)"
    )


@pytest.mark.usefixtures("services")
def test_the_number_of_the_vehicle_is_unknown_until_it_was_read_of_mavros(monkeypatch):
    monkeypatch.setattr(mavros_link.rospy, "Subscriber", lambda *_, **__: None)
    monkeypatch.setattr(mavros_link.rospy, "get_param", lambda name, _default: 7 if "system" in name else 1)
    link, clock, said = linked(QUIET, PLANNER_MESSAGES)
    link._listens = True  # here, below
    link._take(said, mavros_link.STATE)
    assert link.state.vehicle is None
    assert link_problem(link.state, clock.t_ns + 6 * S) == "the vehicle has fallen silent: no heartbeat for 5 s"
    link._listen()
    assert link.state.vehicle == 7
    assert link_problem(link.state, clock.t_ns + 6 * S) == "vehicle 7 has fallen silent: no heartbeat for 5 s"


def received(caller, number, kind=74):
    """Return what a node publishes as received of its vehicle."""
    said = SimpleNamespace(msgid=kind, framing_status=1, seq=number % 256, sysid=1, compid=1)
    said._connection_header = {"callerid": caller}
    return said


def listening():
    """Return a link that knows its autopilot, its clock, and what is taken of what mavros receives."""
    link, clock, said = linked(QUIET, CLIENT_MESSAGES)
    link._listens, taken = True, []
    link._take(said, mavros_link.STATE)
    link._take = lambda message, _source: taken.append(message)
    return link, clock, taken


@pytest.mark.parametrize("other_first", [False, True])
def test_of_two_mavros_that_publish_on_one_topic_what_they_receive_ours_alone_counts(services, other_first):
    """Their own topics are below their names; what they receive is beside both: the battery of another vehicle, too."""
    assert services.called == []
    link, clock, taken = listening()
    if other_first:  # until ours has said something it may be a relay, or a recording
        link._take_received(received("/mavros_radio", 0, BATTERY))
    for number in range(500):
        clock.t_ns += S // 50
        link._take_received(received("/mavros", number, BATTERY))
        link._take_received(received("/mavros_radio", 120 + number, BATTERY))
        assert not link.state.strangers
    callers = [message._connection_header["callerid"] for message in taken]
    assert callers == ["/mavros_radio"] * other_first + ["/mavros"] * 500


def test_what_a_relay_hands_on_of_mavros_counts(services):
    assert services.called == []
    link, _, taken = listening()
    link._take_received(received("/relay", 0, BATTERY))
    link._take_received(SimpleNamespace(msgid=BATTERY, framing_status=1, seq=1, sysid=1, compid=1))
    assert [message.msgid for message in taken] == [BATTERY] * 2


@pytest.mark.live
def test_what_is_commanded_has_a_connection_that_stays_open(link, services):
    link.begin()
    assert services.until(lambda: {*services.kept} == {"/mavros/set_mode", "/mavros/cmd/command"}), services.kept
    assert services.called == []


@pytest.mark.live
def test_the_mission_is_woken_as_the_client_is(link):
    """A pull is over once mavros has been quiet for a while."""
    count, given = mavlink.MAVLink_mission_count_message(0, 0, 4), []
    woken = threading.Event()
    link._answer = lambda message: given.append(message) or woken.set()
    link._mission.wake = lambda *, read: [count] if read else []
    thread = threading.Thread(target=link._wake)
    thread.start()
    assert woken.wait(LIMIT_S)
    link._ended.set()
    thread.join(LIMIT_S)
    assert count in given


# --- who is heard -----------------------------------------------------------------------------------------------------


class Clock:
    t_ns = 10 * S

    def now_ns(self):
        return self.t_ns


def linked(client, wanted):
    """Return a link that is not started, and its clock; what is told and asked goes through it all the same."""
    clock = Clock()
    made = MavrosLink("/mavros", client, wanted, clock.now_ns, lambda words: pytest.fail(words))
    said = SimpleNamespace(connected=True, armed=True, mode="AUTO.MISSION", system_status=4)
    return made, clock, said


def serve(link):
    """Let mavros answer all that it was asked."""
    for lane in Lane:
        while not link._requests[lane].empty():
            _, request = link._requests[lane].get_nowait()
            for message in link._answers(request, link._call(request)):
                link._answer(message)


def test_what_flies_the_vehicle_is_not_delivered_any_more_once_it_was_given_up(link, services):
    for request in (MISSION, ARM, LAND, INTERVAL):
        link._call(request)
    assert services.called == ["AUTO.MISSION", 400, "AUTO.LAND", 511]
    assert services.expiring == ["AUTO.MISSION", 400, "AUTO.LAND"], "a landing is asked for again"


def test_a_dead_vehicle_is_not_heard_because_mavros_answers_that_it_has_sent_a_landing(services):
    node = AutopilotClient(AutopilotSettings(backend="mavros"), BatterySpec(), lambda: (1, 1))
    link, clock, said = linked(node, CLIENT_MESSAGES)
    link._take(said, mavros_link.STATE)
    for _ in range(40):  # 6 s without a word of the vehicle
        clock.t_ns += 150_000_000
        link.ask(node.land)
        serve(link)
    assert "AUTO.LAND" in services.called
    assert node.landing.answer == "accepted"  # mavros' words are kept for the reason
    assert node.vehicle.status(clock.t_ns).link_age_s == 6.0
    link._take(said, mavros_link.STATE)
    assert node.vehicle.status(clock.t_ns).link_age_s == 0.0


def test_the_planner_does_not_hear_a_dead_vehicle_because_mavros_answers(services):
    model = FlightModel(cruise_speed_m_s=4.0, climb_speed_m_s=2.0, landing_speed_m_s=1.0, acceleration_m_s2=4.0)
    planner = Sequencer(SequencerSettings((), PlannerSpec(), model, Limits()))
    link, clock, said = linked(planner, PLANNER_MESSAGES)
    link._take(said, mavros_link.STATE)
    for _ in range(40):
        clock.t_ns += 150_000_000
        link._transmit([mavlink.MAVLink_mission_count_message(1, 1, 2)])  # mavros' side asks for an item at once
        link._pass_on(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1.0, 4.0, 6.0, 0, 0, 0, 0))
        serve(link)
    assert "AUTO.LAND" in services.called
    assert planner.watch.results[176] == "MAV_RESULT_ACCEPTED"
    assert not planner.watch.known(clock.t_ns, 3 * S)


def test_over_a_link_of_our_own_whatever_the_vehicle_says_is_heard():
    """Its acknowledgement is its own word there."""
    node = AutopilotClient(AutopilotSettings(), BatterySpec(), lambda: (1, 1))
    node.receive(S, mavlink.MAVLink_heartbeat_message(2, PX4, 129, 4 << 24 | 4 << 16, 4, 3))
    node.receive(5 * S, mavlink.MAVLink_command_ack_message(176, 0))
    assert node.vehicle.status(5 * S).link_age_s == 0.0


@pytest.mark.usefixtures("services")
def test_the_master_is_told_of_set_points_at_the_start_and_not_in_flight(monkeypatch):
    """A master that hangs would hold the link's lock with the first set-point, in the air."""
    published = SimpleNamespace(
        header=SimpleNamespace(stamp=None), position=SimpleNamespace(), velocity=SimpleNamespace()
    )
    told, sent = [], []
    monkeypatch.setattr(mavros_link, "_imported", lambda _module, _name: lambda: published)
    monkeypatch.setattr(mavros_link.rospy, "Subscriber", lambda *_, **__: None)
    monkeypatch.setattr(mavros_link.rospy, "Time", SimpleNamespace(now=lambda: 0))
    publisher = SimpleNamespace(publish=sent.append)
    monkeypatch.setattr(mavros_link.rospy, "Publisher", lambda topic, *_, **__: told.append(topic) or publisher)
    link = MavrosLink("/mavros", QUIET, PLANNER_MESSAGES, lambda: 0, lambda _: None)
    link._announce = lambda: None
    link.start()
    assert told == ["/mavros/setpoint_raw/local"]
    point = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 3576, 2.0, 1.0, -3.0, *[0] * 8)
    link._transmit((point,))
    link._ended.set()
    assert (told, sent, published.position.x) == (["/mavros/setpoint_raw/local"], [published], 1.0)
