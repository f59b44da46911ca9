"""The watchdog's thread notices that it did not run, wherever it was stopped."""

from __future__ import annotations

import struct
import threading
from io import BytesIO
from queue import SimpleQueue
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy", reason="needs ROS")

from amaze_autonomy import msg
from amaze_autonomy.engine.rules import Code, Severity
from amaze_autonomy.monitoring.errors import RestartRefusedError
from amaze_autonomy.monitoring.restart import RestartRequest
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec, RestartPolicy, RestartSpec, TopicSpec
from amaze_autonomy.monitoring.watchdog import Streams, Watchdog
from amaze_autonomy.nodes.watchdog import node
from amaze_autonomy.nodes.watchdog.watch_loop import TakeoffDesk, TakeoffRequest, TopicWatch, WatchLoop

MS = 1_000_000
PERIOD_NS = 200 * MS


class World:
    """A clock that goes on while the loop waits, and a stop of the process in one of its steps."""

    def __init__(self, stopped_in: str, at_turn: int = 5) -> None:
        self.now, self.turns, self.stopped_in, self.at_turn = 0, 0, stopped_in, at_turn
        self.excused, self.judged = [], []
        self.loop = WatchLoop(
            SimpleNamespace(started=True, restart_requests=tuple),
            self,
            SimpleNamespace(wait=self.wait, wake=lambda: None),
            (),
            SimpleNamespace(next_ns=1 << 62, turn=lambda _: self.step("answer")),
            self,
            lambda *_: None,
            lambda _: None,
            lambda stall_ns, now_ns: self.excused.append((stall_ns, now_ns)),
        )

    def step(self, name: str) -> None:
        if name == self.stopped_in and self.turns == self.at_turn:
            self.now += 2000 * MS

    # the clock
    def now_ns(self) -> int:
        return self.now

    def wall_wait_s(self, until_ns: int) -> float:
        self.step("look at the clock")
        return max(0, until_ns - self.now) * 1e-9

    # the streams
    @property
    def next_ns(self) -> int:
        return (self.now // PERIOD_NS + 1) * PERIOD_NS

    def poll(self, now_ns: int):
        self.judged.append(now_ns)
        self.step("judge")
        return None, None

    # the reader
    def wait(self, limit_s: float) -> None:
        self.turns += 1
        self.now += round(limit_s * 1e9)
        self.step("wait")
        if self.turns > 10:
            self.loop.stop()


@pytest.mark.parametrize("stopped_in", ["wait", "judge", "answer", "look at the clock"])
def test_a_stop_is_excused_before_anything_is_judged_wherever_it_came(stopped_in):
    world = World(stopped_in)
    world.loop.run()
    assert len(world.excused) == 1
    stall_ns, now_ns = world.excused[0]
    assert 2000 * MS - PERIOD_NS <= stall_ns <= 2000 * MS
    assert now_ns in world.judged
    assert not any(now_ns - 1900 * MS < judged < now_ns for judged in world.judged)


def test_a_loop_that_runs_excuses_nothing():
    world = World("")
    world.loop.run()
    assert world.excused == []


def test_what_a_publisher_could_not_send_meanwhile_is_read_before_anything_is_judged():
    """A picture is larger than a socket: its rest comes once its beginning was read."""
    world, order = World("wait"), []
    wait, poll = world.loop._reader.wait, world.poll

    def waits(limit_s):
        order.append("wait")
        wait(limit_s)

    def judges(now_ns):
        order.append("judge")
        return poll(now_ns)

    world.loop._reader.wait, world.poll = waits, judges
    world.loop._stalled = lambda *_: order.append("stalled")
    world.loop.run()
    at = order.index("stalled")
    assert order[at - 2 : at + 1] == ["wait", "wait", "stalled"]


FLOAT64 = {"type": "std_msgs/Float64", "message_definition": "float64 data\n", "md5sum": "x"}


@pytest.mark.parametrize(
    "hz, age_limit_ms, stall_ms, how",
    [
        (10, 300, 350, {"finite": True}),
        (5, 500, 650, {"finite": True}),
        (5, 500, 450, {"unchanged_limit_ns": 500 * MS}),
    ],
)
def test_content_that_waited_while_this_process_stood_still_came_in_time(hz, age_limit_ms, stall_ms, how):
    """What waits in a connection is read at once: it would seem to have been away, and to be too little after that."""
    topic = TopicSpec("/odometry", hz, age_limit_ns=age_limit_ms * MS, **how)
    watchdog = Watchdog((ComponentSpec("estimator", severity=Severity.HIGHEST, topics=(topic,)),))
    watchdog.start(0)
    now, sent, codes = [0], [0], set()
    clock = SimpleNamespace(
        now_ns=lambda: now[0], ros_ns=lambda: now[0], wall_wait_s=lambda until_ns: max(0, until_ns - now[0]) * 1e-9
    )
    watch = TopicWatch(topic.topic, watchdog, clock)
    watch.use("estimator", topic)
    look = watch.look_for(FLOAT64)

    def wait(limit_s):
        begin_ns = now[0]
        now[0] += min(20 * MS, max(MS, round(limit_s * 1e9)))
        if begin_ns < 20_000 * MS <= now[0]:
            now[0] += stall_ms * MS
        while sent[0] <= now[0]:
            look(memoryview(struct.pack("<d", sent[0] * 1e-9)))
            watch.tally.count += 1
            sent[0] += 1000 * MS // hz
        if now[0] > 30_000 * MS:
            loop.stop()

    def tell(action, _info, t_ns):
        if action is not None and t_ns > 10_000 * MS:
            codes.add(action.code)

    desk = SimpleNamespace(next_ns=1 << 62, turn=lambda _: None)
    reader = SimpleNamespace(wait=wait, wake=lambda: None)
    loop = WatchLoop(watchdog, Streams(watchdog), reader, (watch,), desk, clock, tell, lambda _: None, lambda *_: None)
    loop.run()
    assert codes == {Code.NOMINAL}


# --- what is no message of ours ---------------------------------------------------------------------------------------


STATUS = {"type": msg.AutopilotStatus._type, "md5sum": msg.AutopilotStatus._md5sum, "callerid": "/somebody"}


def watched():
    """Return a watch of the autopilot's status, and what was taken."""
    watch, taken = TopicWatch("/autopilot/status", None, World("nowhere")), []
    watch.take_whole(msg.AutopilotStatus, taken.append)
    return watch, taken


@pytest.mark.parametrize("data", [b"", b"\x01", b"hello" * 3, b"\xff" * 200])
def test_what_is_no_status_ends_nothing_and_the_next_one_is_taken(data):
    watch, taken = watched()
    look = watch.look_for(STATUS)
    look(memoryview(data))
    assert taken == []
    buffer = BytesIO()
    msg.AutopilotStatus(link_age=0.5).serialize(buffer)
    look(memoryview(buffer.getvalue()))
    assert [each.link_age for each in taken] == [0.5]


def test_a_publisher_of_another_kind_is_not_read():
    watch, taken = watched()
    buffer = BytesIO()
    msg.AutopilotStatus(link_age=0.5).serialize(buffer)
    look = watch.look_for({**STATUS, "type": "std_msgs/String", "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1"})
    look(memoryview(buffer.getvalue()))
    assert taken == []


def test_a_look_that_fails_ends_nothing():
    watch, looked = TopicWatch("/autopilot/status", None, World("nowhere")), []

    def fails(data):
        looked.append(bytes(data))
        raise MemoryError

    watch.take_whole(msg.AutopilotStatus, lambda _message: None)
    watch._takers[:] = [(msg.AutopilotStatus, fails)]
    look = watch.look_for(STATUS)
    look(memoryview(b"one"))
    look(memoryview(b"two"))
    assert looked == [b"one", b"two"]


IMU = {"type": "sensor_msgs/Imu", "message_definition": "Header header\nfloat64 x\n"}


@pytest.mark.parametrize("stamp_s, off", [(1000, False), (0, True), (990, True)])
def test_a_stamp_of_0_is_off_the_clock_where_stamps_are_judged(stamp_s, off):
    spec = TopicSpec("/imu", 50.0, stamp_tolerance_ns=500 * MS)
    watchdog = Watchdog((ComponentSpec("imu", severity=Severity.LOW, topics=(spec,)),))
    watchdog.start(0)
    watch = TopicWatch("/imu", watchdog, SimpleNamespace(ros_ns=lambda: 1000_000 * MS))
    watch.use("imu", spec)
    look = watch.look_for(IMU)
    for number in range(200):
        look(memoryview(struct.pack("<IIIId", number, stamp_s, 0, 0, 1.0)))
        watchdog.add_samples("imu", 20 * MS * (number + 1), 1, "/imu")
    (status,) = watchdog.evaluate(4000 * MS)
    assert status.code is (Code.NON_CRITICAL if off else Code.NOMINAL)
    assert ("off the clock" in status.reason) is off


# --- take-off checks --------------------------------------------------------------------------------------------------


SPECS = (ComponentSpec("camera", severity=Severity.HIGHEST, topics=(TopicSpec("/camera", 30.0),)),)
MISSION = SimpleNamespace(severities=(("camera", Severity.LOW),), tolerated=())


def asked(desk, now_ns, mission_id):
    """Return the answer to a take-off check."""
    request = TakeoffRequest(mission_id, (), 0, SimpleQueue())
    desk.ask(now_ns, request)
    desk.turn(now_ns)
    return request.answer.get_nowait()


def test_who_asks_in_flight_is_answered_and_changes_nothing():
    watchdog = Watchdog(SPECS)
    desk = TakeoffDesk(watchdog, {"low": MISSION})
    assert asked(desk, 0, "low").components[0].code is Code.NON_CRITICAL
    watchdog.add_vehicle(armed=True, on_ground=False)
    for mission_id in ("", "another", "low"):
        answer = asked(desk, 1000 * MS, mission_id)
        assert answer.components[0].code is Code.NON_CRITICAL
        assert answer.message == "not nominal: camera; in flight: what is judged stays as it is"
    watchdog.add_vehicle(armed=False, on_ground=True)
    answer = asked(desk, 2000 * MS, "another")
    assert answer.components[0].code is Code.ABORT
    assert answer.message.endswith("mission 'another' is not in missions.yaml: severities are those of sensors.yaml")


@pytest.mark.parametrize(
    "status,flies",
    [
        (msg.AutopilotStatus(armed=True), False),
        (msg.AutopilotStatus(armed_known=True, armed=True, landed=msg.AutopilotStatus.ON_GROUND), True),
        (msg.AutopilotStatus(armed_known=True, landed=msg.AutopilotStatus.ON_GROUND), False),
    ],
)
@pytest.mark.parametrize("specs", [SPECS, ()])
def test_the_status_of_the_autopilot_says_whether_it_flies(status, flies, specs):
    watchdog = Watchdog(specs)
    nodes = SimpleNamespace(_watchdog=watchdog, _clock=SimpleNamespace(now_ns=lambda: 7))
    node.WatchdogNode._take_autopilot(nodes, status)
    assert watchdog.in_flight is flies


def test_one_report_of_the_autopilot_counts_once_and_over_a_dead_link_not_at_all():
    specs = (ComponentSpec("imu", "px4", Severity.HIGHEST, autopilot=AutopilotSensor.IMU),)
    watchdog, now = Watchdog(specs), [0]
    nodes = SimpleNamespace(_watchdog=watchdog, _clock=SimpleNamespace(now_ns=lambda: now[0]))
    watchdog.start(0)

    def code(at_ms, sequence, imu, link_age=0.0):
        now[0] = at_ms * MS
        said = msg.AutopilotStatus(link_age=link_age, imu=imu, sensors_sequence=sequence)
        node.WatchdogNode._take_autopilot(nodes, said)
        return watchdog.evaluate(now[0])[0].code

    healthy, failed = msg.AutopilotStatus.SENSOR_HEALTHY, msg.AutopilotStatus.SENSOR_FAILED
    for at_ms, sequence, imu in ((0, 1, healthy), (500, 2, failed), (700, 2, failed), (900, 2, failed)):
        assert code(at_ms, sequence, imu) is Code.NOMINAL
    assert code(1000, 3, healthy) is Code.NOMINAL
    assert code(5900, 4, healthy, link_age=5.1) is Code.NOMINAL
    assert code(6100, 5, healthy, link_age=5.1) is Code.ABORT


# --- restarts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("error", [RestartRefusedError("imu"), RuntimeError("can't start new thread"), MemoryError()])
def test_a_restart_that_cannot_begin_has_failed(error):
    outcomes = []

    def begin(_request):
        raise error

    watchdog = SimpleNamespace(restart_outcome=lambda request, now_ns, good: outcomes.append((request, now_ns, good)))
    nodes = SimpleNamespace(
        _restarter=SimpleNamespace(begin=begin), _watchdog=watchdog, _clock=SimpleNamespace(now_ns=lambda: 7)
    )
    request = SimpleNamespace(component="lrf")
    node.WatchdogNode._restart(nodes, request)
    assert outcomes == [(request, 7, False)]


@pytest.mark.live
@pytest.mark.parametrize("node_name", ["/mavros", "/px4/driver", "/watchdog", "/left/autopilot"])
def test_a_node_that_the_vehicle_needs_is_not_ended_whoever_asks(node_name):
    specs = (
        ComponentSpec("camera", node=node_name, restart=RestartSpec(RestartPolicy.NODE)),
        ComponentSpec("imu", "px4", node="/px4/driver"),
    )
    begun = node.Restarter(specs, {}, lambda *_: pytest.fail("it was carried out"), link="/mavros")
    request = RestartRequest("camera", 1, RestartPolicy.NODE, node_name, (), 30_000 * MS)
    with pytest.raises(RestartRefusedError, match=f"^camera is not restarted: {node_name} is .* uncontrollable$"):
        begun.begin(request)


@pytest.mark.live
def test_a_restart_begins_where_no_thread_can_be_had(monkeypatch):
    spec = SimpleNamespace(name="lrf", group="sensors", restart=SimpleNamespace(policy=RestartPolicy.COMMAND))
    told = SimpleQueue()
    begun = node.Restarter((spec,), {}, lambda request, good: told.put((request, good)))

    def start(_thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    request = RestartRequest("lrf", 1, RestartPolicy.COMMAND, "", ("true",), 30_000 * MS)
    begun.begin(request)
    assert told.get(timeout=30.0) == (request, True)
