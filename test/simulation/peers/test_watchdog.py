"""The simulated watchdog: conditions and codes follow from samples, processes and health alone."""

import pytest
from simulation_tools import RESTARTS, Driver, S, changes, small_settings

from amaze_autonomy.engine.events import CheckName, Mission, Outcome, WatchdogAction, WatchdogInfo
from amaze_autonomy.engine.rules import Code, Restart, Severity
from amaze_autonomy.monitoring.specs import ComponentSpec, PollingSpec, TopicSpec


def watched(faults="", **more):
    """Return a world whose watchdog watches and has found everything good."""
    driver = Driver(faults, **more)
    driver.go_on(2.0)
    reply = driver.check(CheckName.WATCHDOG)
    assert reply.ok
    driver.events.clear()
    return driver


def codes(driver, name):
    """Return the codes of a component as the info stream said them, equal ones in a row once."""
    told = []
    for event in driver.events:
        if isinstance(event, WatchdogInfo):
            (status,) = [each for each in event.components if each.name == name]
            if not told or told[-1] != (status.code, status.restart):
                told.append((status.code, status.restart))
    return told


NOMINAL = (Code.NOMINAL, Restart.NONE)


def test_says_nothing_before_it_was_asked_to_watch():
    driver = Driver()
    driver.go_on(5.0)
    assert [event for event in driver.events if isinstance(event, (WatchdogAction, WatchdogInfo))] == []


def test_watches_from_the_first_request_on_and_beats_five_times_a_second():
    driver = watched()
    driver.go_on(10.0)
    beats = [event for event in driver.events if isinstance(event, WatchdogAction)]
    assert len(beats) == pytest.approx(50, abs=2)
    assert {(event.code, event.components) for event in beats} == {(Code.NOMINAL, ())}
    assert [later.sequence - earlier.sequence for earlier, later in zip(beats, beats[1:])] == [1] * (len(beats) - 1)
    assert all(later.loop_counter > earlier.loop_counter for earlier, later in zip(beats, beats[1:]))


def test_the_first_answer_waits_for_a_component_that_comes_up_in_time():
    driver = Driver("component: camera, fault: silent, for_s: 4")
    driver.go_on(1.0)
    reply = driver.check(CheckName.WATCHDOG)
    assert reply.ok
    assert 4 * S < reply.t_ns < 6 * S


def test_the_first_answer_does_not_wait_longer_than_the_startup_time():
    driver = Driver("component: camera, fault: silent")
    driver.go_on(1.0)
    reply = driver.check(CheckName.WATCHDOG)
    assert (reply.outcome, reply.ok, reply.fixable) == (Outcome.ACCEPTED, False, False)
    assert reply.t_ns == pytest.approx(6 * S, abs=S // 5)


EFFECTS = (
    ("component: camera, fault: silent, at_s: 20", "camera", [NOMINAL, (Code.ABORT, Restart.NONE)]),
    ("component: camera, fault: killed, at_s: 20", "camera", [NOMINAL, (Code.ABORT, Restart.NONE)]),
    ("component: camera, fault: nan, at_s: 20", "camera", [NOMINAL, (Code.ABORT, Restart.NONE)]),
    (
        "component: camera, fault: slow, rate_fraction: 0.5, at_s: 20",
        "camera",
        [NOMINAL, (Code.NON_CRITICAL, Restart.NONE)],
    ),
    ("component: camera, fault: slow, rate_fraction: 0.1, at_s: 20", "camera", [NOMINAL, (Code.ABORT, Restart.NONE)]),
    ("component: camera, fault: silent, at_s: 20, for_s: 3", "camera", [NOMINAL, (Code.ABORT, Restart.NONE), NOMINAL]),
    ("component: gps, fault: unhealthy, at_s: 20", "gps", [NOMINAL, (Code.NON_CRITICAL, Restart.NONE)]),
    ("component: gps, fault: unreported, at_s: 20", "gps", [NOMINAL, (Code.NON_CRITICAL, Restart.NONE)]),
    ("process: autopilot, fault: killed, at_s: 20", "gps", [NOMINAL, (Code.NON_CRITICAL, Restart.NONE)]),
    ("fault: autopilot_link_lost, at_s: 20", "gps", [NOMINAL, (Code.NON_CRITICAL, Restart.NONE)]),
    ("component: camera, fault: killed, at_s: 20", "lrf", [NOMINAL]),
)


@pytest.mark.parametrize("fault, name, expected", EFFECTS, ids=[f"{e[0]} -> {e[1]}" for e in EFFECTS])
def test_a_fault_of_samples_process_or_health_becomes_a_code(fault, name, expected):
    driver = watched(fault)
    driver.go_on(20.0)
    assert codes(driver, name) == expected


def test_a_camera_that_sends_the_same_picture_for_ever_is_found_where_that_is_watched():
    camera = ComponentSpec(
        "camera", severity=Severity.MODERATE, topics=(TopicSpec("/camera", 20.0, unchanged_limit_ns=S),)
    )
    settings = small_settings(components=(camera,))
    driver = watched("component: camera, fault: stuck, at_s: 20", settings=settings)
    driver.go_on(20.0)
    assert codes(driver, "camera") == [NOMINAL, (Code.INCONVENIENT, Restart.NONE)]


def test_what_may_be_restarted_is_and_comes_back():
    driver = watched("component: lrf, fault: killed, restart_takes_s: 3, at_s: 20")
    driver.go_on(20.0)
    assert codes(driver, "lrf") == [NOMINAL, (Code.HOLD, Restart.TRYING), NOMINAL]
    assert [text for _, text, _ in driver.world.history] == ["fault begins: lrf killed", "fault ends: lrf killed"]


def test_restarts_that_fail_are_given_up_and_the_code_gets_worse():
    driver = watched("component: lrf, fault: killed, restart: fails, at_s: 20")
    driver.go_on(30.0)
    assert codes(driver, "lrf") == [NOMINAL, (Code.HOLD, Restart.TRYING), (Code.ABORT, Restart.GIVEN_UP)]


def test_what_was_restarted_for_nothing_is_tried_again_by_the_next_take_off_check():
    driver = watched("component: lrf, fault: killed, restart: fails, at_s: 20, for_s: 40")
    driver.go_on(50.0)
    reply = driver.check(CheckName.WATCHDOG)
    assert reply.ok


def test_the_severities_of_the_mission_become_the_codes():
    settings = small_settings(missions=(Mission("1", severities=(("camera", Severity.LOW),), tolerated=("camera",)),))
    driver = Driver("component: camera, fault: silent, at_s: 20", settings=settings)
    driver.go_on(2.0)
    assert driver.check(CheckName.WATCHDOG, mission_id="1").ok
    driver.events.clear()
    driver.go_on(20.0)
    assert codes(driver, "camera") == [NOMINAL, (Code.NON_CRITICAL, Restart.NONE)]


def test_a_change_is_told_at_once():
    driver = watched("component: gps, fault: unhealthy, at_s: 20.55")
    driver.go_on(20.0)
    first = next(e for e in driver.events if isinstance(e, WatchdogInfo) and "gps" in e.changed)
    assert first.t_ns <= round(20.55 * S) + 3 * S // 10


def test_a_stuck_loop_beats_on_and_counts_no_more():
    driver = watched("process: watchdog, fault: stuck, at_s: 20\ncomponent: camera, fault: killed, at_s: 21")
    driver.go_on(15.0)
    beats = [e for e in driver.events if isinstance(e, WatchdogAction) and e.t_ns > 20 * S]
    assert len(beats) > 30
    assert len({event.loop_counter for event in beats}) == 1
    assert [later.sequence - earlier.sequence for earlier, later in zip(beats, beats[1:])] == [1] * (len(beats) - 1)
    assert {event.code for event in beats} == {Code.NOMINAL}


def test_a_slow_one_beats_at_a_part_of_its_rate():
    driver = watched("process: watchdog, fault: slow, rate_fraction: 0.2, at_s: 20")
    driver.go_on(26.0)
    beats = [e for e in driver.events if isinstance(e, WatchdogAction) and e.t_ns > 20 * S]
    assert len(beats) == pytest.approx(20, abs=2)


@pytest.mark.parametrize("kind", ["killed", "silent"])
def test_a_dead_one_beats_no_more(kind):
    driver = watched(f"process: watchdog, fault: {kind}, at_s: 20")
    driver.go_on(20.0)
    assert max(e.t_ns for e in driver.events if isinstance(e, WatchdogAction)) <= 20 * S


def test_one_that_was_killed_comes_back_and_waits_to_be_asked():
    driver = watched("process: watchdog, fault: killed, at_s: 20, for_s: 2")
    driver.go_on(20.0)
    assert max(e.t_ns for e in driver.events if isinstance(e, WatchdogAction)) <= 20 * S
    assert driver.check(CheckName.WATCHDOG).ok
    assert changes(driver.events, WatchdogAction, "code") == [Code.NOMINAL]


def test_the_node_of_a_component_is_asked_and_its_driver_looked_at(configuration):
    """The shipped mission camera has both a topic and a node: a dead node is seen before its silence is."""
    driver = Driver("component: mission_camera, fault: killed, restart: fails, at_s: 20", settings=configuration)
    driver.go_on(5.0)
    assert driver.check(CheckName.WATCHDOG).ok
    driver.go_on(10.0)
    first = next(e for e in driver.events if isinstance(e, WatchdogAction) and e.code is Code.ABORT)
    assert first.t_ns <= round(20.5 * S)
    assert first.components[0].reason == "node /mission_camera: connection refused"


SHARED = small_settings(
    components=(
        ComponentSpec("camera", topics=(TopicSpec("/camera", 20.0),), node="/realsense", restart=RESTARTS),
        ComponentSpec("imu", severity=Severity.HIGHEST, topics=(TopicSpec("/imu", 100.0),), node="/realsense"),
        ComponentSpec("lrf", severity=Severity.HIGH, topics=(TopicSpec("/lrf/range", 20.0),), node="/lrf"),
    )
)
ABORT = (Code.ABORT, Restart.NONE)


@pytest.mark.parametrize("kind, victim", [("killed", "camera"), ("silent", "camera"), ("killed", "imu")])
def test_a_node_ends_with_all_of_its_components_and_comes_back_with_all_of_them(kind, victim):
    fault = f"component: {victim}, fault: {kind}, at_s: 20, restart: succeeds, restart_takes_s: 2"
    driver = watched(fault, settings=SHARED)
    driver.go_on(20.0)
    assert codes(driver, "imu") == [NOMINAL, ABORT, NOMINAL]
    assert codes(driver, "camera") == [NOMINAL, (Code.NON_CRITICAL, Restart.TRYING), NOMINAL]
    assert codes(driver, "lrf") == [NOMINAL]


def test_a_component_that_falls_silent_ends_no_node():
    driver = watched("component: imu, fault: silent, at_s: 20, for_s: 4", settings=SHARED)
    driver.go_on(20.0)
    assert codes(driver, "imu") == [NOMINAL, ABORT, NOMINAL]
    assert codes(driver, "camera") == [NOMINAL]


def test_a_driver_is_looked_at_as_seldom_as_that_of_the_vehicle_and_a_node_as_often():
    polling = PollingSpec(driver_period_ns=10 * S, driver_age_limit_ns=30 * S)
    usb = ComponentSpec("usb", severity=Severity.LOW, driver=("lsusb",), polling=polling)
    node = ComponentSpec("node", severity=Severity.LOW, node="/node", polling=polling)
    both = "component: usb, fault: killed, at_s: 21\ncomponent: node, fault: killed, at_s: 21"
    driver = watched(both, settings=small_settings(components=(usb, node)))
    seen_s = {}
    while len(seen_s) < 2:
        for event in driver.go_on(0.5):
            for status in event.components if isinstance(event, WatchdogInfo) else ():
                if status.code is not Code.NOMINAL:
                    seen_s.setdefault(status.name, event.t_ns / S)
    assert 21.0 <= seen_s["node"] < 22.7
    assert 30.0 <= seen_s["usb"] < 31.2
