"""The action and info streams: at their periods, at once on a change, and level-based."""

from __future__ import annotations

from monitoring_feed import S

from amaze_autonomy.engine.events import ComponentStatus, WatchdogAction, WatchdogInfo
from amaze_autonomy.engine.rules import Code, Restart, Severity
from amaze_autonomy.monitoring.specs import ComponentSpec, TopicSpec
from amaze_autonomy.monitoring.watchdog import Streams, Watchdog

SPECS = (
    ComponentSpec("camera", severity=Severity.HIGHEST, topics=(TopicSpec("/camera", 10.0),)),
    ComponentSpec("gps", severity=Severity.LOW, topics=(TopicSpec("/gps", 10.0),)),
)
GOOD = (ComponentStatus("camera", Code.NOMINAL), ComponentStatus("gps", Code.NOMINAL))


def running() -> Streams:
    """Return streams that have run for 2 s, everything good."""
    watchdog = Watchdog(SPECS)
    streams = Streams(watchdog)
    watchdog.start(0)
    for index in range(21):
        for name in ("camera", "gps"):
            watchdog.add_samples(name, index * S // 10)
        streams.poll(index * S // 10)
    return streams


def test_nothing_is_sent_before_the_start():
    assert Streams(Watchdog(SPECS)).poll(S) == (None, None)


def test_both_streams_begin_with_the_start():
    streams = Streams(Watchdog(SPECS))
    streams._watchdog.start(0)
    action, info = streams.poll(0)
    assert action is not None
    assert info is not None


def test_action_is_the_heartbeat_five_times_a_second_and_info_comes_once():
    streams = running()
    watchdog = streams._watchdog
    sent = []
    for index in range(21, 41):
        for name in ("camera", "gps"):
            watchdog.add_samples(name, index * S // 10)
        sent.append(streams.poll(index * S // 10))
    assert sum(1 for action, _ in sent if action) == 10
    assert sum(1 for _, info in sent if info) == 2
    action = next(action for action, _ in reversed(sent) if action)
    info = next(info for _, info in reversed(sent) if info)
    assert (action.code, action.components) == (Code.NOMINAL, ())
    assert (info.changed, info.components) == ((), GOOD)


def test_a_change_is_sent_at_once_on_both_streams():
    streams = running()
    due_ns = 2 * S + S // 2 + 1
    for step in (4, 5):
        streams.poll(2 * S + step * S // 10)
    action, info = streams.poll(due_ns)
    reason = "no message on /camera for longer than 0.5 s"
    camera = ComponentStatus("camera", Code.ABORT, Restart.NONE, None, reason)
    gps = ComponentStatus("gps", Code.NON_CRITICAL, Restart.NONE, None, reason.replace("camera", "gps"))
    assert isinstance(action, WatchdogAction)
    assert isinstance(info, WatchdogInfo)
    assert (action.t_ns, action.code, action.latest_component) == (due_ns, Code.ABORT, "camera")
    assert action.components == (camera,)
    assert (info.changed, info.components) == (("camera", "gps"), (camera, gps))


def test_each_message_has_the_next_number_and_the_loop_is_counted():
    streams = running()
    first, _ = streams.poll(10 * S)
    second, _ = streams.poll(11 * S)
    assert first is not None
    assert second is not None
    assert second.sequence == first.sequence + 1
    assert second.loop_counter == first.loop_counter + 1


def test_time_that_jumps_backwards_does_not_stop_the_heartbeat():
    streams = running()
    action, info = streams.poll(S)
    assert action is not None
    assert info is not None


def test_it_says_when_it_must_be_polled_again():
    streams = running()
    assert 2 * S < streams.next_ns <= 2 * S + S // 5
