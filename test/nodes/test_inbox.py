"""What reaches the engine: read from real sockets, in the order in which it came, also after a time without reading."""

from __future__ import annotations

import io
import socket
import struct

import pytest

pytest.importorskip("rospy")


from amaze_autonomy import msg
from amaze_autonomy.engine.events import AutopilotStatus, ClockStatus, LandedStatus, Tick, WatchdogAction
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.interface import STATUSES
from amaze_autonomy.interface.fields import MOST_ITEMS
from amaze_autonomy.nodes.autonomy.engine_thread import Inbox, Stall
from amaze_autonomy.ros.clock import Clock
from amaze_autonomy.ros.interface import ros_time
from amaze_autonomy.ros.topic_reader import ALL, Tally, TopicStream

S, MS = 1_000_000_000, 1_000_000
TOPICS = {status.topic: status for status in STATUSES}
EPOCH_S = 1_700_000_000  # of ROS time, when the deciding clock shows 0


class HandClock(Clock):
    """Time passes when a test says so; ROS time with it."""

    def __init__(self):
        self.ns, self.stands_s = 100 * S, 0.0

    def now_ns(self):
        return self.ns

    def ros_ns(self):
        return EPOCH_S * S + self.ns

    def stalled_s(self):
        return self.stands_s

    def wall_wait_s(self, until_ns):
        return max(0.0, (until_ns - self.ns) / S)


class Desk:
    """An inbox with publishers at real sockets."""

    def __init__(self):
        self.clock = HandClock()
        self.rejected, self.stalls, self.shortened = [], [], []
        self.inbox = Inbox(
            self.clock,
            lambda topic, error: self.rejected.append((topic, error.field)),
            self.stalls.append,
            self.clock.now_ns,
            lambda *said: self.shortened.append(said),
        )

    def publisher(self, name, callerid="/somebody"):
        with socket.create_server(("127.0.0.1", 0)) as server:
            publisher = socket.create_connection(server.getsockname(), timeout=5.0)
            sock, _ = server.accept()
        publisher.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        look = self.inbox.look_for(TOPICS[name])({"callerid": callerid})
        self.inbox.reader.add(TopicStream(sock, Tally(name, ALL), look))
        self.inbox.wait(0.0)
        return publisher

    def send(self, publisher, message, *, ago_s=0.0, ahead_s=0.0):
        """Publish something, some time ago, from a computer whose clock may be ahead."""
        message.header.stamp = ros_time(self.clock.ros_ns() - round((ago_s - ahead_s) * S))
        body = io.BytesIO()
        message.serialize(body)
        publisher.sendall(struct.pack("<I", len(body.getvalue())) + body.getvalue())

    def take(self, after_s=0.0):
        """Return what comes with the next look, some time after the last one."""
        self.clock.ns += round(after_s * S)
        return list(self.inbox.wait(0.0))


def landed(state=2):
    return msg.Landed(landed=state, distance=1.0)


def action(code=1, counter=1):
    bad = [msg.ComponentState(name="imu", code=code)] if code > 1 else []
    return msg.WatchdogAction(sequence=counter, loop_counter=counter, code=code, components=bad)


@pytest.fixture
def desk():
    desk = Desk()
    yield desk
    desk.inbox.reader.close()


def test_a_status_is_an_event_of_now_with_its_age_and_its_publisher(desk):
    watchdog = desk.publisher("watchdog/action", "/near/watchdog")
    desk.send(watchdog, action(16), ago_s=0.03)
    (event,) = desk.take(0.1)
    assert isinstance(event, WatchdogAction)
    assert (event.t_ns, event.code, event.publisher) == (desk.clock.ns, Code.ABORT, "/near/watchdog")
    assert event.age_ns == 130 * MS
    assert desk.stalls == []


def test_a_message_that_there_is_no_memory_for_is_said_and_not_called_invalid(desk, monkeypatch, caplog):
    detection, watchdog = desk.publisher("landing_detection/landed"), desk.publisher("watchdog/action")

    def no_memory(*_):
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(msg.Landed, "deserialize", no_memory)
        desk.send(detection, landed())
        desk.send(watchdog, action(16))
        assert [type(event) for event in desk.take()] == [WatchdogAction]
    assert desk.rejected == []
    assert "there is no memory to read a message of landing_detection/landed" in caplog.text
    desk.send(detection, landed())
    assert [type(event) for event in desk.take()] == [LandedStatus]


def test_what_others_put_comes_before_what_was_read_after_it(desk):
    detection = desk.publisher("landing_detection/landed")
    desk.send(detection, landed())
    desk.inbox.put(Tick(t_ns=desk.clock.ns))
    assert [type(event) for event in desk.take()] == [Tick, LandedStatus]


def test_what_lay_in_the_sockets_while_it_was_stopped_is_stamped_with_when_it_came(desk):
    detection, watchdog = desk.publisher("landing_detection/landed"), desk.publisher("watchdog/action")
    desk.send(detection, landed())
    desk.send(watchdog, action())
    desk.take(0.01)
    stopped_ns = desk.clock.ns
    desk.clock.ns += 2 * S
    for number in range(10):
        desk.send(detection, landed(), ago_s=1.82 - 0.2 * number)
        desk.send(watchdog, action(16 if number == 4 else 1, number), ago_s=1.92 - 0.2 * number)
    first, *events = desk.take()
    assert first == Tick(t_ns=stopped_ns, away_ns=2 * S), "before anything else is decided"
    times = [event.t_ns - stopped_ns for event in events]
    assert times == sorted(times)
    assert times == pytest.approx([(0.1 * (number + 1) - 0.01) * S for number in range(20)], abs=2)
    assert [event.age_ns for event in events] == pytest.approx([10 * MS] * 20, abs=2), (
        "as old as its messages usually are"
    )
    assert [event.code for event in events if isinstance(event, WatchdogAction)][4] is Code.ABORT
    assert desk.stalls == [Stall(2.0, 20, 0)]


@pytest.mark.parametrize("reading", range(4))
def test_a_stop_at_any_reading_of_its_clocks_makes_nothing_later_than_it_came(desk, reading):
    """What came before the stop is of before, whichever clock was read already."""
    detection = desk.publisher("landing_detection/landed")
    desk.send(detection, landed())
    desk.take(0.01)
    desk.send(detection, landed(), ago_s=0.0)
    came_ns, now_ns, readings = desk.clock.ns, desk.clock.now_ns, []

    def now_and_then_it_is_stopped():
        found = now_ns()
        readings.append(found)
        if len(readings) == reading + 1:
            desk.clock.ns += 2 * S
        return found

    desk.clock.now_ns = desk.inbox._wall_ns = now_and_then_it_is_stopped
    events = [event for event in desk.inbox.wait(0.0) if not isinstance(event, Tick)]
    assert [event.t_ns for event in events] == pytest.approx([came_ns], abs=11 * MS)
    assert [event.age_ns for event in events] == pytest.approx([0], abs=11 * MS), "it would be stale"


@pytest.mark.parametrize("stopped_s, told", [(0.3, False), (1.0, True), (3600.0, True)])
def test_only_what_is_longer_than_a_moment_is_told(desk, stopped_s, told):
    desk.take(0.01)
    desk.clock.ns += round(stopped_s * S)
    assert [event.away_ns for event in desk.take(0.0)] == ([round(stopped_s * S)] if told else [])


def test_a_computer_that_slept_is_told_though_the_clock_that_decides_did_not_run(desk):
    before_ns = desk.clock.ns
    desk.take(0.01)
    desk.inbox._wall_ns = lambda: desk.clock.ns + 3600 * S
    (event,) = desk.inbox.wait(0.0)
    assert (event.t_ns - before_ns < S, event.away_ns > 3599 * S) == (True, True)


def test_a_clock_that_is_ahead_does_not_move_what_lay_in_the_sockets(desk):
    autopilot = desk.publisher("autopilot/status")
    status = msg.AutopilotStatus(landed=1)
    desk.send(autopilot, status, ahead_s=0.15)
    desk.take(0.01)
    desk.clock.ns += S
    desk.send(autopilot, status, ago_s=0.5, ahead_s=0.15)
    _, event = desk.take()
    assert isinstance(event, AutopilotStatus)
    assert (desk.clock.ns - event.t_ns, event.age_ns) == (490 * MS, -140 * MS)


def test_nothing_came_before_the_last_look_nor_later_than_now(desk):
    detection = desk.publisher("landing_detection/landed")
    desk.send(detection, landed())
    desk.take()
    desk.clock.ns += S
    desk.send(detection, landed(), ago_s=3.0)
    desk.send(detection, landed(), ahead_s=3.0)
    _, early, late = desk.take()
    assert (desk.clock.ns - early.t_ns, early.age_ns) == (S, 2 * S), (
        "older than the time it was stopped for: it is stale"
    )
    assert (desk.clock.ns - late.t_ns, late.age_ns) == (0, -3 * S)


def test_a_message_that_the_network_delayed_came_when_it_was_read(desk):
    detection = desk.publisher("landing_detection/landed")
    desk.send(detection, landed())
    desk.take()
    desk.send(detection, landed(), ago_s=0.6)
    (event,) = desk.take(0.1)
    assert (event.t_ns, event.age_ns) == (desk.clock.ns, 700 * MS)


def test_after_a_long_time_some_of_each_publisher_are_read_the_last_and_each_code_16_among_them(desk):
    detection, watchdog = desk.publisher("landing_detection/landed"), desk.publisher("watchdog/action")
    desk.clock.ns += 60 * S
    for number in range(300):
        ago_s = 59.8 - 0.2 * number
        desk.send(detection, landed(1 if number == 299 else 2), ago_s=ago_s)
        desk.send(watchdog, action(16 if number == 17 else 1, number), ago_s=ago_s)
    events = desk.take()
    detections = [event for event in events if isinstance(event, LandedStatus)]
    assert len(detections) == 20
    assert detections[-1].landed.name == "ON_GROUND"
    gaps = [after.t_ns - before.t_ns for before, after in zip(detections, detections[1:])]
    assert max(gaps) <= 3 * S + MS, "evenly, so that nobody seems to have been silent for longer than need be"
    actions = [event for event in events if isinstance(event, WatchdogAction)]
    assert len(actions) == 21
    assert [event.loop_counter for event in actions if event.code is Code.ABORT] == [17]
    assert desk.stalls == [Stall(60.0, 600, 559)]


def test_a_message_with_too_long_a_list_is_read_and_what_is_left_out_is_counted(desk):
    watchdog = desk.publisher("watchdog/action")
    parts = [msg.ComponentState(name=f"c{number}", code=1) for number in range(2000)]
    desk.send(watchdog, msg.WatchdogAction(code=16, components=[*parts, msg.ComponentState(name="imu", code=16)]))
    (event,) = desk.take()
    assert (len(event.components), event.components[-1].name) == (MOST_ITEMS, "imu")
    assert (desk.shortened, desk.rejected) == ([("watchdog/action", "components", 2001 - MOST_ITEMS)], [])


def test_what_is_no_message_is_rejected_by_its_topic_and_field(desk):
    watchdog = desk.publisher("watchdog/action")
    watchdog.sendall(struct.pack("<I", 3) + b"abc")
    desk.send(watchdog, msg.WatchdogAction(code=3))
    desk.send(watchdog, action())
    assert [event.code for event in desk.take()] == [Code.NOMINAL]
    assert desk.rejected == [("watchdog/action", "message"), ("watchdog/action", "code")]


def test_a_deciding_clock_that_stands_is_said_once_and_so_is_its_end(desk):
    assert desk.take() == []
    desk.clock.stands_s = 1.2
    assert desk.take() == [ClockStatus(t_ns=desk.clock.ns, stalled_s=1.2)]
    desk.clock.stands_s = 1.3
    assert desk.take() == []
    desk.clock.stands_s = 0.0
    assert desk.take() == [ClockStatus(t_ns=desk.clock.ns, stalled_s=0.0)]
