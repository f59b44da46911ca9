"""The watchdog as a story: streams stop, come back, are restarted, and are asked about before takeoff."""

from __future__ import annotations

from typing import Dict, List, Optional, Tuple

import pytest
from monitoring_feed import S

from amaze_autonomy.engine.events import Check, ComponentStatus, Verdict
from amaze_autonomy.engine.rules import Code, Restart, Severity
from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.errors import RestartRefusedError, UnknownComponentError
from amaze_autonomy.monitoring.restart import RestartRequest
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec, RestartPolicy, RestartSpec, TopicSpec
from amaze_autonomy.monitoring.watchdog import TakeoffCheck, Watchdog

RESTART = RestartSpec(RestartPolicy.COMMAND, ("restart-lrf",), 2, S, 3 * S, 20 * S)
SPECS = (
    ComponentSpec("px4_imu", "px4", Severity.HIGHEST, autopilot=AutopilotSensor.IMU),
    ComponentSpec("camera", "other", Severity.HIGHEST, topics=(TopicSpec("/camera", 30.0, age_limit_ns=S // 5),)),
    ComponentSpec("lrf", "other", Severity.HIGH, topics=(TopicSpec("/lrf", 50.0),), restart=RESTART),
    ComponentSpec("realsense_imu", "other", Severity.LOW, topics=(TopicSpec("/rs", 200.0),), required=False),
)
RATES = {"camera": 30.0, "lrf": 50.0, "realsense_imu": 200.0}
STEP_NS = S // 20


def test_the_loop_counter_counts_from_one():
    watchdog = Watchdog(SPECS)
    watchdog.evaluate(0)
    watchdog.evaluate(1)
    assert watchdog.loop_counter == 2


class World:
    """Feeds a watchdog in steps of 50 ms and keeps what it says, when it changes."""

    def __init__(self) -> None:
        self.watchdog = Watchdog(SPECS)
        self.now_ns = 0
        self.rates: Dict[str, float] = dict(RATES)
        self.imu: Optional[bool] = True
        self.log: List[Tuple[float, str, int, str]] = []
        self.requests: List[Tuple[float, RestartRequest]] = []
        self._sent: Dict[str, float] = dict.fromkeys(RATES, 0.0)

    def run(self, until_s: float) -> World:
        while self.now_ns < until_s * S:
            self.now_ns += STEP_NS
            self._feed()
            for status in self.watchdog.evaluate(self.now_ns):
                self._note(status)
            self.requests += [(self.now_ns / S, request) for request in self.watchdog.restart_requests()]
        return self

    def codes(self, name: str) -> List[Tuple[float, int, str]]:
        return [(t_s, code, restart) for t_s, component, code, restart in self.log if component == name]

    def _feed(self) -> None:
        for name, rate_hz in self.rates.items():
            self._sent[name] += rate_hz * STEP_NS / S
            if self._sent[name] >= 1:
                self.watchdog.add_samples(name, self.now_ns, int(self._sent[name]))
                self._sent[name] %= 1
        if self.now_ns % (S // 5) == 0:
            self.watchdog.add_autopilot(self.now_ns, {AutopilotSensor.IMU: self.imu})

    def _note(self, status: ComponentStatus) -> None:
        last = [entry for entry in self.log if entry[1] == status.name][-1:]
        if not last or last[0][2:] != (int(status.code), status.restart.value):
            self.log.append((self.now_ns / S, status.name, int(status.code), status.restart.value))


@pytest.fixture
def flying() -> World:
    """Return a world in which everything has worked for 10 s."""
    world = World()
    world.watchdog.start(0)
    world.run(10.0)
    world.log.clear()
    return world


def test_nothing_is_judged_before_the_start():
    world = World().run(5.0)
    assert world.watchdog.evaluate(world.now_ns) == ()
    assert world.watchdog.checks(world.now_ns).ready is False


def test_everything_good_is_code_1_and_ready(flying: World):
    flying.run(12.0)
    assert {entry[2] for entry in flying.log} == {1}
    answer = flying.watchdog.checks(flying.now_ns)
    assert answer[:4] == (True, False, False, None)
    assert [(row.name, row.verdict) for row in answer.checks] == [(spec.name, Verdict.PASS) for spec in SPECS]


def test_the_mission_camera_is_code_16_within_its_limit(flying: World):
    flying.rates["camera"] = 0.0
    flying.run(11.0)
    (_, _, _), (at_s, code, restart) = flying.codes("camera")
    assert (code, restart) == (16, "none")
    assert at_s - 10.0 <= 0.2 + 0.05
    assert flying.watchdog.latest_component == "camera"


def test_the_lrf_is_8_while_it_is_restarted_and_16_once_given_up(flying: World):
    flying.rates["lrf"] = 0.0
    flying.run(25.0)
    assert flying.codes("lrf")[1:] == [(10.55, 8, "trying"), (17.55, 16, "given_up")]
    assert [(at_s, request.attempt) for at_s, request in flying.requests] == [(10.55, 1), (14.55, 2)]


def test_the_lrf_is_back_after_a_restart(flying: World):
    flying.rates["lrf"] = 0.0
    flying.run(12.0)
    ((_, request),) = flying.requests
    assert request == RestartRequest("lrf", 1, RestartPolicy.COMMAND, "", ("restart-lrf",), 3 * S)
    flying.watchdog.restart_outcome(request, flying.now_ns, good=True)
    flying.rates["lrf"] = 50.0
    flying.run(20.0)
    codes = flying.codes("lrf")
    assert [entry[1:] for entry in codes] == [(1, "none"), (8, "trying"), (1, "none")]
    assert 12.5 <= codes[2][0] <= 12.8
    assert len(flying.requests) == 1


def test_the_px4_imu_is_16_and_nobody_asks_for_a_restart(flying: World):
    flying.imu = False
    flying.run(30.0)
    assert [entry[1:] for entry in flying.codes("px4_imu")] == [(1, "none"), (16, "none")]
    assert flying.requests == []


def test_a_silent_autopilot_is_a_failed_imu_too(flying: World):
    flying.imu = None
    flying.run(15.5)
    status = flying.watchdog.evaluate(flying.now_ns)[0]
    reason = "the autopilot's imu: no answer for longer than 5 s"
    assert status == ComponentStatus("px4_imu", Code.ABORT, Restart.NONE, None, reason)


def told(world: World, until_s: float, sequence: int, *, good: bool, link_age_s: float = 0.0) -> int:
    """Let the node of the autopilot say the same report of the autopilot five times a second; return the IMU's code."""
    while world.now_ns < until_s * S:
        world.now_ns += S // 5
        health = {AutopilotSensor.IMU: good}
        world.watchdog.add_autopilot(
            world.now_ns, health, link_age_s=link_age_s, sequences={AutopilotSensor.IMU: sequence}
        )
        world.watchdog.evaluate(world.now_ns)
    return world.watchdog.evaluate(world.now_ns)[0].code


@pytest.fixture
def heard() -> World:
    """Return a world whose autopilot alone has said something, twice a second for two seconds: that its IMU is good."""
    world = World()
    world.watchdog.start(0)
    for number in range(1, 5):
        assert told(world, number * 0.5, number, good=True) == 1
    return world


def test_one_report_of_the_autopilot_counts_once_however_often_it_is_told(heard: World):
    assert told(heard, 2.6, 5, good=False) == 1
    assert told(heard, 3.0, 6, good=True) == 1
    assert told(heard, 3.6, 7, good=False) == 1
    assert told(heard, 3.8, 8, good=False) == 16


def test_an_autopilot_that_reports_nothing_new_is_silent_whatever_is_told_of_it(heard: World):
    assert told(heard, 6.8, 4, good=True) == 1, "its last report was told at 1.8 s for the first time"
    assert told(heard, 7.0, 4, good=True) == 16
    assert "no answer for longer than 5 s" in heard.watchdog.evaluate(heard.now_ns)[0].reason
    assert told(heard, 7.2, 5, good=True) == 1


def test_statuses_that_do_not_number_the_reports_count_each(heard: World):
    assert told(heard, 8.0, 0, good=True) == 1
    assert told(heard, 8.2, 0, good=False) == 1
    assert told(heard, 8.4, 0, good=False) == 16


@pytest.mark.parametrize("fresh", AutopilotSensor)
def test_each_sensor_has_reports_of_its_own(fresh: AutopilotSensor):
    specs = tuple(ComponentSpec(sensor.value, "px4", autopilot=sensor) for sensor in AutopilotSensor)
    watchdog = Watchdog(specs)
    watchdog.start(0)
    watchdog.add_autopilot(0, dict.fromkeys(AutopilotSensor, True), sequences=dict.fromkeys(AutopilotSensor, 1))
    for t_ns in (S, 2 * S):
        sequences = {**dict.fromkeys(AutopilotSensor, 2), fresh: 0}
        watchdog.add_autopilot(t_ns, dict.fromkeys(AutopilotSensor, False), sequences=sequences)
    assert {status.name: int(status.code) for status in watchdog.evaluate(2 * S)} == {
        **{sensor.value: 1 for sensor in AutopilotSensor},
        fresh.value: 2,
    }


@pytest.mark.parametrize("link_age_s", [5.1, float("nan"), float("inf")])
def test_what_is_said_over_a_dead_link_is_silence(heard: World, link_age_s: float):
    assert told(heard, 6.6, 0, good=True, link_age_s=link_age_s) == 1
    assert told(heard, 7.2, 0, good=True, link_age_s=link_age_s) == 16


def test_what_is_said_over_a_link_at_its_limit_counts(heard: World):
    assert told(heard, 8.0, 0, good=True, link_age_s=5.0) == 1


def test_it_is_steady_while_every_rate_is_as_intended_and_was_looked_at():
    specs = (SPECS[1], SPECS[2])
    made = Watchdog(specs)
    assert not made.steady, "nobody has started it"
    made.start(0)
    for number in range(1, 301):
        for name in ("camera", "lrf"):
            made.add_samples(name, number * S // 50)
        made.evaluate(number * S // 50)
    assert not made.steady, "the camera is too fast"
    flying = World()
    flying.watchdog = Watchdog(specs)
    flying.rates = {"camera": 30.0, "lrf": 50.0}
    flying.watchdog.start(0)
    flying.run(10.0)
    assert flying.watchdog.steady
    flying.rates["lrf"] = 0.0
    flying.run(12.0)
    assert not flying.watchdog.steady


def test_a_rate_that_is_off_may_come_right_by_itself_as_long_as_a_start_may_take():
    """As seen live: what a starved node hears at once counts as a burst, "9.7 Hz, too fast", for a second."""
    world = World()
    world.rates["camera"] = 60.0
    world.watchdog.start(0, required=("camera",), startup_ns=8 * S)
    for at_s, comes in ((4.0, True), (7.9, True), (8.1, False)):
        answer = world.run(at_s).watchdog.checks(world.now_ns)
        (row,) = (row for row in answer.checks if row.name == "camera")
        assert (answer.ready, answer.fixable, row.verdict, row.heals) == (False, comes, Verdict.FAIL, comes)
        assert answer.until_ns == (8 * S if comes else None)


def test_a_component_at_half_rate_is_code_2_and_not_restarted(flying: World):
    flying.rates["lrf"] = 25.0
    flying.run(20.0)
    assert [entry[1:] for entry in flying.codes("lrf")] == [(1, "none"), (2, "none")]
    assert flying.requests == []


def test_a_mission_may_judge_a_component_otherwise(flying: World):
    flying.watchdog.start(flying.now_ns, severities=(("camera", Severity.LOW),))
    flying.rates["camera"] = 0.0
    flying.run(11.0)
    assert [entry[1] for entry in flying.codes("camera")] == [1, 2]
    flying.watchdog.start(flying.now_ns)
    flying.run(11.5)
    assert flying.codes("camera")[-1][1] == 16


def test_a_mission_cannot_judge_a_component_that_is_not_watched(flying: World):
    with pytest.raises(
        UnknownComponentError, match=r"^sonar is not watched; watched: px4_imu, camera, lrf, realsense_imu$"
    ):
        flying.watchdog.start(flying.now_ns, severities=(("sonar", Severity.LOW),))


def test_what_is_as_intended_does_not_come_up(flying: World):
    rows = flying.watchdog.checks(flying.now_ns).checks
    assert [row.heals for row in rows if row.verdict is Verdict.PASS] == [False] * len(rows)


def test_a_start_that_says_nothing_of_it_has_ten_seconds():
    world = World()
    world.watchdog.start(0)
    assert world.run(0.2).watchdog.checks(world.now_ns).until_ns == 10 * S


def test_at_the_start_it_is_not_ready_but_on_its_way():
    world = World()
    world.watchdog.start(0, startup_ns=5 * S)
    world.run(0.2)
    answer = world.watchdog.checks(world.now_ns)
    assert answer[:4] == (False, True, True, 5 * S)
    assert [row.verdict for row in answer.checks] == [Verdict.PASS, Verdict.UNKNOWN, Verdict.UNKNOWN, Verdict.WARN]
    world.run(1.0)
    assert world.watchdog.checks(world.now_ns).ready


def test_what_is_being_restarted_is_fixable_until_it_is_given_up(flying: World):
    flying.rates["lrf"] = 0.0
    flying.run(11.0)
    assert flying.watchdog.checks(flying.now_ns)[:4] == (False, True, True, 17_550_000_000)
    flying.run(18.0)
    assert flying.watchdog.checks(flying.now_ns)[:4] == (False, False, False, None)


def test_what_cannot_be_restarted_is_not_fixable(flying: World):
    flying.rates["camera"] = flying.rates["lrf"] = 0.0
    flying.run(11.0)
    assert flying.watchdog.checks(flying.now_ns)[:4] == (False, False, False, None)


def test_what_is_not_required_is_a_warning(flying: World):
    flying.rates["realsense_imu"] = 0.0
    flying.run(11.0)
    answer = flying.watchdog.checks(flying.now_ns)
    assert answer.ready
    assert answer.checks[3].verdict is Verdict.WARN


@pytest.mark.parametrize("severity", [Severity.HIGH, Severity.HIGHEST])
def test_nothing_takes_off_while_what_would_be_landed_for_has_not_come_yet(severity: Severity):
    """Whether it is required or not: it would fail in the air, with the end of the time that it has to come up."""
    world = World()
    del world.rates["camera"]
    world.watchdog.start(0, severities=(("camera", severity),), required=("lrf",))
    for at_s in (2.0, 9.9):
        answer = world.run(at_s).watchdog.checks(world.now_ns)
        assert answer[:4] == (False, True, True, 10 * S)
        assert [row.verdict for row in answer.checks if row.name == "camera"] == [Verdict.UNKNOWN]
    answer = world.run(10.1).watchdog.checks(world.now_ns)
    assert answer.ready, "its code says it from now on: nothing that would be landed for takes off"
    assert world.codes("camera")[-1][1] == (16 if severity is Severity.HIGHEST else 8)


def test_a_topic_that_is_off_does_not_hide_another_one_that_has_not_come_yet():
    topics = (TopicSpec("/picture", 30.0), TopicSpec("/depth", 30.0))
    watchdog = Watchdog((ComponentSpec("camera", "other", Severity.HIGHEST, topics, required=False),))
    watchdog.start(0, tolerated=("camera",))
    for number in range(1, 121):
        watchdog.add_samples("camera", number * S // 60, topic="/picture")
    answer = watchdog.checks(2 * S)
    assert answer.checks[0].advice.startswith("60 Hz on /picture, too fast")
    assert answer[:4] == (False, True, True, 10 * S)
    assert answer.checks[0].verdict is Verdict.UNKNOWN


@pytest.mark.parametrize("severity", [Severity.LOW, Severity.MODERATE])
def test_what_would_be_flown_on_without_may_come_up_in_the_air(severity: Severity):
    world = World()
    del world.rates["camera"]
    world.watchdog.start(0, severities=(("camera", severity),), required=("lrf",))
    answer = world.run(2.0).watchdog.checks(world.now_ns)
    assert answer[:4] == (True, False, False, None)
    assert [row.verdict for row in answer.checks if row.name == "camera"] == [Verdict.WARN]


def test_the_mission_says_what_is_required_and_what_is_tolerated(flying: World):
    flying.rates["camera"] = 15.0
    flying.watchdog.start(flying.now_ns, required=("lrf",))
    flying.run(14.0)
    assert flying.watchdog.checks(flying.now_ns).ready
    flying.watchdog.start(flying.now_ns, required=("camera",))
    assert not flying.watchdog.checks(flying.now_ns).ready
    flying.watchdog.start(flying.now_ns, required=("camera",), tolerated=("camera",))
    assert flying.watchdog.checks(flying.now_ns).ready


def test_a_required_component_that_is_not_watched_is_never_ready(flying: World):
    flying.watchdog.start(flying.now_ns, required=("lrf", "sonar"))
    answer = flying.watchdog.checks(flying.now_ns)
    row = Check("sonar", Verdict.UNKNOWN, advice="sonar is not watched: add it to sensors.yaml")
    assert answer == TakeoffCheck(False, False, False, None, (*answer.checks[:-1], row))


def test_a_takeoff_check_after_a_while_gives_restarts_a_new_chance_and_polling_does_not(flying: World):
    flying.watchdog.start(flying.now_ns)
    flying.rates["lrf"] = 0.0
    flying.run(18.0)
    flying.watchdog.start(flying.now_ns)  # 8 s after the one before
    flying.run(18.2)
    assert [request.attempt for _, request in flying.requests] == [1, 2, 1]
    for second in range(19, 30):
        flying.run(float(second))
        flying.watchdog.start(flying.now_ns)
    assert [request.attempt for _, request in flying.requests] == [1, 2, 1, 2]
    assert flying.watchdog.evaluate(flying.now_ns)[2].restart is Restart.GIVEN_UP


def test_a_call_in_flight_changes_nothing_of_what_the_flight_is_judged_by(flying: World):
    watchdog = flying.watchdog
    watchdog.start(flying.now_ns, severities=(("camera", Severity.LOW),), required=("lrf",), tolerated=("lrf",))
    watchdog.add_vehicle(armed=True, on_ground=True)
    flying.rates["camera"] = flying.rates["lrf"] = 0.0
    before = flying.run(20.0).watchdog.checks(flying.now_ns)
    assert watchdog.in_flight
    assert [flying.codes(name)[-1][1:] for name in ("camera", "lrf")] == [(2, "none"), (16, "given_up")]
    watchdog.start(flying.now_ns)  # as somebody who looks at it asks, for no mission
    assert watchdog.checks(flying.now_ns) == before
    flying.run(30.0)
    assert [flying.codes(name)[-1][1:] for name in ("camera", "lrf")] == [(2, "none"), (16, "given_up")]
    watchdog.add_vehicle(armed=False, on_ground=True)
    watchdog.start(flying.now_ns)
    flying.run(30.1)
    assert [flying.codes(name)[-1][1:] for name in ("camera", "lrf")] == [(16, "none"), (8, "trying")]


@pytest.mark.parametrize(
    "said,flies",
    [
        ([(None, True)], False),
        ([(False, False)], False),
        ([(True, False)], True),
        ([(True, False), (None, True)], True),
        ([(True, False), (False, False)], True),
        ([(True, False), (True, True)], True),
        ([(True, False), (False, True)], False),
    ],
)
def test_it_flies_from_armed_until_it_is_disarmed_on_the_ground(said, flies):
    watchdog = Watchdog(SPECS)
    for armed, on_ground in said:
        watchdog.add_vehicle(armed=armed, on_ground=on_ground)
    assert watchdog.in_flight is flies


def test_a_watchdog_that_was_started_again_in_flight_begins_when_it_is_asked():
    world = World()
    world.watchdog.add_vehicle(armed=True, on_ground=False)
    world.watchdog.start(0, severities=(("camera", Severity.LOW),), startup_ns=0)
    del world.rates["camera"]
    assert world.run(1.0).codes("camera")[-1][1] == 2


def test_it_wakes_exactly_when_a_verdict_changes(flying: World):
    flying.rates = {}
    due_ns = flying.watchdog.next_ns
    while due_ns <= flying.now_ns or flying.watchdog.evaluate(due_ns)[1].code is Code.NOMINAL:
        due_ns = max(due_ns + 1, flying.watchdog.next_ns)
    last_ns = flying.now_ns
    assert due_ns == last_ns + S // 5 + 1


def test_without_components_there_is_nothing_to_wait_for():
    watchdog = Watchdog(())
    watchdog.start(0)
    assert watchdog.evaluate(S) == ()
    assert watchdog.next_ns == FOREVER_NS
    assert watchdog.checks(S) == TakeoffCheck(True, False, False, None, ())


def test_names_and_sources_that_it_does_not_have_are_refused(flying: World):
    with pytest.raises(UnknownComponentError):
        flying.watchdog.add_samples("sonar", S)
    with pytest.raises(UnknownComponentError):
        flying.watchdog.add_samples("px4_imu", S)
    with pytest.raises(UnknownComponentError):
        flying.watchdog.add_process("lrf", True, S)
    with pytest.raises(UnknownComponentError):
        flying.watchdog.add_driver("lrf", True, S)


def test_node_driver_content_and_stamps_reach_their_component():
    topic = TopicSpec("/t", 10.0, finite=True, stamp_tolerance_ns=S)
    watchdog = Watchdog((ComponentSpec("x", "other", Severity.MODERATE, (topic,), "/x", ("check",)),))
    watchdog.start(0, startup_ns=S)

    def feed(begin: int, end: int, **said: bool) -> ComponentStatus:
        for index in range(begin, end):
            t_ns = index * S // 10
            watchdog.add_samples("x", t_ns)
            watchdog.add_content("x", t_ns, finite=said.get("finite", True), digest=index)
            watchdog.add_stamp("x", t_ns, t_ns if said.get("stamp", True) else t_ns - 2 * S)
            watchdog.add_process("x", said.get("node", True), t_ns, "refused")
            watchdog.add_driver("x", said.get("driver", True), t_ns, "exit status 1")
        return watchdog.evaluate(end * S // 10)[0]

    assert feed(0, 20).code is Code.NOMINAL
    assert feed(20, 30, finite=False).reason == "nothing but NaN or infinity on /t for longer than 0.5 s"
    assert feed(30, 40).code is Code.NOMINAL
    off = feed(40, 50, stamp=False)
    assert (off.code, off.reason) == (Code.NON_CRITICAL, "stamps on /t are more than 1 s off the clock")
    assert feed(50, 60).code is Code.NOMINAL
    assert feed(60, 61, node=False).reason == "node /x: refused"
    assert feed(61, 62, driver=False).reason == "driver check check: exit status 1"
    assert feed(62, 63).code is Code.NOMINAL


def test_a_px4_component_with_a_forged_restart_is_refused():
    object.__setattr__(forged := ComponentSpec("px4_imu", "px4", node="/mavros"), "restart", RESTART)
    with pytest.raises(RestartRefusedError):
        Watchdog((forged,))
