"""The world as a whole: time, determinism, peers that are left out, what a scenario may name."""

import pytest
from simulation_tools import COMPONENTS, Driver, S, scenario, small_settings

from amaze_autonomy.engine.commands import Level, LoadMission, Notify
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    CheckName,
    LandedStatus,
    MissionStatus,
    RecordingStatus,
    UserCommand,
    UserRequest,
    WatchdogAction,
)
from amaze_autonomy.interface import PEERS, SERVICES, peer_of
from amaze_autonomy.simulation import NoEffectError, SimulatedTimeError, SimulationError, UnknownTargetError, World

STATUS = {
    "autopilot": AutopilotStatus,
    "landing_detection": LandedStatus,
    "mission_planner": MissionStatus,
    "data_recorder": RecordingStatus,
}


def flight(seed=1, **more):
    driver = Driver(seed=seed, **more)
    driver.go_on(3.0)
    driver.check(CheckName.WATCHDOG)
    driver.take_off()
    driver.go_on(20.0)
    return driver.events


def test_events_come_in_order_of_time_up_to_the_time_that_was_asked_for():
    driver = Driver()
    events = driver.go_on(5.0)
    times = [event.t_ns for event in events]
    assert times == sorted(times)
    assert times[-1] <= 5 * S == driver.world.now_ns


def test_the_same_in_small_steps_and_in_one():
    steps, whole = Driver(), Driver()
    for _ in range(100):
        steps.go_on(0.1)
    whole.go_on(10.0)
    assert steps.events == whole.events


def test_the_same_seed_gives_the_same_flight_and_another_seed_another():
    assert flight(seed=1) == flight(seed=1)
    assert flight(seed=1) != flight(seed=2)


def test_time_does_not_run_backwards():
    driver = Driver()
    driver.go_on(1.0)
    with pytest.raises(SimulatedTimeError) as error:
        driver.world.advance(S - 1)
    assert (error.value.now_ns, error.value.asked_ns) == (S, S - 1)
    assert isinstance(error.value, SimulationError)


def test_it_may_begin_at_any_time():
    world = World(small_settings(), 1, scenario("fault: does_not_arm, at_s: 2"), start_ns=10**18)
    events = world.advance(10**18 + 3 * S)
    assert events[0].t_ns >= 10**18
    assert [(t_ns - 10**18) / S for t_ns, _, _ in world.history] == [2.0]


def test_its_next_time_is_when_something_happens_next():
    driver = Driver("component: camera, fault: silent, at_s: 0.25")
    times = []
    while driver.world.now_ns < S // 2:
        driver.world.advance(driver.world.next_ns)
        times.append(driver.world.now_ns / S)
    assert times == [0.0, 0.1, 0.2, 0.25, 0.3, 0.4, 0.5]


@pytest.mark.parametrize("peer", STATUS)
def test_a_peer_that_is_left_out_has_no_status_and_no_services(peer):
    driver = Driver(without=(peer,))
    driver.go_on(3.0)
    assert not [event for event in driver.events if isinstance(event, STATUS[peer])]
    assert all(
        any(isinstance(event, kind) for event in driver.events) for kind in STATUS.values() if kind is not STATUS[peer]
    )
    assert [name for name in SERVICES if name not in driver.world.services()] == [
        name for name in SERVICES if peer_of(name) == peer
    ]
    assert peer not in driver.world.processes()


def test_a_command_to_a_peer_that_is_left_out_changes_nothing():
    driver = Driver(without=("mission_planner",))
    assert driver.ask(LoadMission, session_id="a", mission_id="1", file_index=0, repetition=0) is None
    assert driver.vehicle.waypoints == ()


def test_the_absence_of_a_peer_changes_nothing_about_the_others():
    def told(driver):
        driver.go_on(5.0)
        return [event for event in driver.events if isinstance(event, (AutopilotStatus, LandedStatus))]

    assert told(Driver()) == told(Driver(without=("mission_planner", "data_recorder", "watchdog", "state_estimation")))


def test_what_is_no_request_changes_nothing():
    driver, other = Driver(), Driver()
    driver.world.handle(0, Notify(level=Level.INFO, key="ready", text="Ready."))
    assert driver.go_on(1.0) == other.go_on(1.0)


@pytest.mark.parametrize(
    "fault, words",
    [
        ("component: lidar, fault: silent", "scenario:3: there is no component 'lidar'; there is gps, camera, lrf"),
        ("component: lfr, fault: silent", "scenario:3: there is no component 'lfr'; did you mean lrf?"),
    ],
)
def test_a_scenario_that_names_what_is_not_there_is_an_error(fault, words):
    with pytest.raises(UnknownTargetError) as error:
        Driver(fault)
    assert str(error.value) == words


NO_EFFECT = (
    ("component: camera, fault: unhealthy", "the autopilot says nothing of this component"),
    ("component: gps, fault: slow, rate_fraction: 0.5", "this component has no topics"),
    ("component: camera, fault: reads, value_m: 1", "it is not the range sensor (/lrf/range)"),
    ("fault: land_switch", "no channel means land; set land_switch.channel in autopilot.yaml"),
    ("fault: not_initialised", "no estimator is initialised; set initialisation.service in sensors.yaml"),
)


@pytest.mark.parametrize("fault, why", NO_EFFECT, ids=[case[0] for case in NO_EFFECT])
def test_a_fault_that_would_do_nothing_is_an_error(fault, why):
    with pytest.raises(NoEffectError) as error:
        Driver(fault)
    assert str(error.value).startswith("scenario:3: ")
    assert str(error.value).endswith(f" would do nothing: {why}")


def test_a_platform_that_does_not_record_cannot_lose_its_part():
    with pytest.raises(UnknownTargetError, match="no platform 'third'; there is main, second"):
        Driver("fault: data_incomplete, platform: third")


def test_a_peer_to_be_left_out_must_be_one():
    with pytest.raises(UnknownTargetError, match="no peer 'planner'"):
        Driver(without=("planner",))


def test_every_service_belongs_to_a_peer():
    assert {peer_of(name) for name in SERVICES} == set(PEERS)


def test_the_requests_of_the_user_are_events():
    driver = Driver(requests="request: go, at_s: 1\nrequest: retry, after: {state: OUTREACH, delay_s: 2}")
    driver.go_on(1.5)
    driver.world.observe_state(driver.world.now_ns, "OUTREACH")
    driver.go_on(5.0)
    asked = [event for event in driver.events if isinstance(event, UserRequest)]
    assert [(event.t_ns / S, event.command) for event in asked] == [(1.0, UserCommand.GO), (3.5, UserCommand.RETRY)]


def test_says_which_processes_live():
    driver = Driver("process: watchdog, fault: killed\ncomponent: lrf, fault: killed\ncomponent: camera, fault: silent")
    driver.go_on(0.1)
    assert driver.world.processes() == {
        **dict.fromkeys(PEERS, True),
        **{component.name: True for component in COMPONENTS},
        "watchdog": False,
        "lrf": False,
    }


def test_a_real_watchdog_may_restart_a_component():
    driver = Driver("component: camera, fault: killed, restart_takes_s: 3", without=("watchdog",))
    driver.go_on(5.0)
    driver.world.restart("camera")
    driver.go_on(2.5)
    assert not driver.world.processes()["camera"]
    driver.go_on(1.0)
    assert driver.world.processes()["camera"]


def test_triggers_hear_of_everything_that_happens():
    events = ("armed", "takeoff", "airborne", "mission", "waypoint", "hold", "land", "landed", "disarmed", "loaded",
              "recording", "merging", "complete", "watched", "pilot")  # fmt: skip
    faults = "\n".join(f"component: gps, fault: unreported, after: {{event: {name}}}, for_s: 0.5" for name in events)
    driver = Driver(faults + "\nfault: pilot_takes_over, after: {event: complete}")
    driver.go_on(3.0)
    driver.check(CheckName.WATCHDOG)
    driver.record()
    driver.take_off()
    driver.vehicle.hold()
    driver.go_on(1.0)
    driver.vehicle.resume()
    driver.until(lambda: driver.vehicle.reached == 3 and not driver.vehicle.armed)
    driver.stop_recording()
    driver.go_on(15.0)
    begun = [text for _, text, _ in driver.world.history if text == "fault begins: gps unreported"]
    assert len(begun) == len(events)


def test_watches_nothing_it_was_not_asked_to():
    driver = Driver()
    driver.go_on(10.0)
    assert not [event for event in driver.events if isinstance(event, WatchdogAction)]
