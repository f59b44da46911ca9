"""Laws of the watchdog over histories that nobody thought of."""

from __future__ import annotations

from typing import List, Tuple

from hypothesis import given
from hypothesis import strategies as st
from monitoring_feed import S

from amaze_autonomy.engine.rules import Code, Restart, Severity
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec, RestartPolicy, RestartSpec, TopicSpec
from amaze_autonomy.monitoring.watchdog import Watchdog

NAMES = ("imu", "camera", "lrf")
ORDER = list(Severity)
severities = st.sampled_from(ORDER)
histories = st.lists(
    st.tuples(st.integers(0, 2 * S), st.sampled_from([*NAMES, "autopilot", "bad autopilot", "nothing"])), max_size=80
)


def watchdog(severity: Severity) -> Watchdog:
    restart = RestartSpec(RestartPolicy.COMMAND, ("x",), 2, S, S, 4 * S)
    topic = TopicSpec("/t", 2.0)
    specs = (
        ComponentSpec("imu", "px4", severity, (topic,), autopilot=AutopilotSensor.IMU),
        ComponentSpec("camera", "other", severity, (topic,), restart=restart),
        ComponentSpec("lrf", "other", severity, (topic,)),
    )
    made = Watchdog(specs)
    made.start(0, startup_ns=S)
    return made


def play(made: Watchdog, history: List[Tuple[int, str]]) -> List[tuple]:
    said, now = [], 0
    for step_ns, what in history:
        now += step_ns
        if what in NAMES:
            made.add_samples(what, now)
        elif what != "nothing":
            made.add_autopilot(now, {AutopilotSensor.IMU: what == "autopilot"})
        said.append(made.evaluate(now))
    return said


@given(histories, st.integers(0, 2))
def test_a_higher_severity_never_has_a_lower_code(history: List[Tuple[int, str]], lower: int):
    mild, worse = play(watchdog(ORDER[lower]), history), play(watchdog(ORDER[lower + 1]), history)
    for mild_statuses, worse_statuses in zip(mild, worse):
        assert all(one.code <= other.code for one, other in zip(mild_statuses, worse_statuses))


@given(histories, severities)
def test_the_px4_is_never_restarted(history: List[Tuple[int, str]], severity: Severity):
    made = watchdog(severity)
    said = play(made, history)
    assert all(statuses[0].restart is Restart.NONE for statuses in said)
    assert all(request.component == "camera" for request in made.restart_requests())


@given(histories, severities)
def test_what_is_nominal_gives_no_reason_and_what_is_not_gives_one(history: List[Tuple[int, str]], severity: Severity):
    for statuses in play(watchdog(severity), history):
        assert all(bool(status.reason) is (status.code is not Code.NOMINAL) for status in statuses)


@given(histories, severities)
def test_ready_means_that_every_required_component_is_at_code_1(history: List[Tuple[int, str]], severity: Severity):
    made = watchdog(severity)
    play(made, history)
    now = sum(step_ns for step_ns, _ in history)
    answer = made.checks(now)
    assert answer.ready is all(status.code is Code.NOMINAL for status in made.evaluate(now))
    assert not (answer.ready and answer.fixable)
    assert not answer.being_fixed or (answer.fixable and answer.until_ns is not None)


@given(histories, severities)
def test_asking_only_when_it_says_so_misses_nothing(history: List[Tuple[int, str]], severity: Severity):
    lazy, eager = watchdog(severity), watchdog(severity)
    now = 0
    for step_ns, what in history:
        end_ns = now + step_ns
        while eager.next_ns < end_ns and eager.next_ns > now:
            now = eager.next_ns
            eager.evaluate(now)
            lazy.evaluate(now)
        now = end_ns
        for made in (lazy, eager):
            if what in NAMES:
                made.add_samples(what, now)
        lazy.evaluate(now)
        eager._dirty = True  # judge it all, whether it seems needed or not
        eager.evaluate(now)
        assert lazy._statuses == eager._statuses
