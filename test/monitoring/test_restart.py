"""Restarting a component: asked for, bounded in every way, never for the PX4."""

from __future__ import annotations

from typing import List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from monitoring_feed import S

from amaze_autonomy.engine.rules import Restart
from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.errors import RestartRefusedError
from amaze_autonomy.monitoring.restart import RestartMachine, RestartRequest, why_kept
from amaze_autonomy.monitoring.specs import ComponentSpec, RestartPolicy, RestartSpec

COMMAND = ("systemctl", "restart", "camera")
LIMITS = RestartSpec(
    RestartPolicy.COMMAND,
    COMMAND,
    attempts=2,
    backoff_ns=S,
    attempt_limit_ns=3 * S,
    total_limit_ns=20 * S,
    forget_after_ns=30 * S,
)


def machine(limits: RestartSpec = LIMITS) -> RestartMachine:
    return RestartMachine(ComponentSpec("camera", node="/camera", restart=limits))


def asked_at(machine_: RestartMachine, begin_ns: int = 0, end_ns: int = 100 * S) -> List[Tuple[float, int]]:
    """Keep the component failed, wake when the machine wants it, and return when it asked for which attempt."""
    requests, now = [], begin_ns
    while now <= end_ns:
        request = machine_.update(now, failed=True)
        if request is not None:
            requests.append((now / S, request.attempt))
        now = machine_.changes_at_ns
    return requests


def test_the_first_attempt_is_asked_for_at_once_with_everything_it_needs():
    first = machine()
    assert first.update(S, failed=True) == RestartRequest("camera", 1, RestartPolicy.COMMAND, "", COMMAND, 3 * S)
    assert (first.restart, first.until_ns, first.changes_at_ns) == (Restart.TRYING, 8 * S, 4 * S)
    assert first.update(S, failed=True) is None


def test_a_node_is_asked_for_by_name():
    request = machine(RestartSpec(RestartPolicy.NODE)).update(0, failed=True)
    assert request == RestartRequest("camera", 1, RestartPolicy.NODE, "/camera", (), 5 * S)


def test_attempts_follow_each_other_with_a_pause_until_it_gives_up():
    failing = machine()
    assert asked_at(failing) == [(0.0, 1), (4.0, 2)]
    assert (failing.restart, failing.until_ns, failing.changes_at_ns) == (Restart.GIVEN_UP, None, FOREVER_NS)


def test_it_gives_up_when_the_total_time_is_spent_before_the_attempts_are():
    failing = machine(RestartSpec(RestartPolicy.COMMAND, COMMAND, 9, S, 3 * S, 10 * S))
    assert asked_at(failing, 0, 10 * S - 1) == [(0.0, 1), (4.0, 2), (8.0, 3)]
    assert (failing.restart, failing.until_ns) == (Restart.TRYING, 10 * S)
    failing.update(10 * S, failed=True)
    assert failing.restart is Restart.GIVEN_UP


def test_an_attempt_that_could_not_be_made_ends_at_once():
    failing = machine()
    failing.update(0, failed=True)
    failing.tell(S, 1, good=False)
    assert failing.update(2 * S - 1, failed=True) is None
    second = failing.update(2 * S, failed=True)
    assert second is not None
    assert second.attempt == 2
    failing.tell(3 * S, 2, good=False)
    assert failing.restart is Restart.GIVEN_UP


def test_after_an_attempt_that_failed_early_the_others_are_expected_to():
    """As `simulate --faults lrf`: 1.9 s were left in the moment in which it landed."""
    failing = machine(RestartSpec(RestartPolicy.COMMAND, COMMAND, 3, S, 4 * S, 12 * S))
    expected = []
    for attempt, begin_s in enumerate((0, 3, 6), 1):
        assert failing.update(begin_s * S, failed=True) is not None
        expected.append(failing.until_ns)
        failing.tell((begin_s + 2) * S, attempt, good=False)
        expected.append(failing.until_ns)
    assert expected == [12 * S, 8 * S, 8 * S, 8 * S, 8 * S, None]
    assert failing.restart is Restart.GIVEN_UP


def test_an_attempt_that_takes_longer_than_expected_has_its_limit_again():
    failing = machine(RestartSpec(RestartPolicy.COMMAND, COMMAND, 3, S, 4 * S, 20 * S))
    failing.update(0, failed=True)
    failing.tell(2 * S, 1, good=False)
    failing.update(3 * S, failed=True)
    assert (failing.until_ns, failing.changes_at_ns) == (8 * S, 5 * S + S // 2)
    failing.update(failing.changes_at_ns, failed=True)
    assert (failing.until_ns, failing.changes_at_ns) == (12 * S, 7 * S)
    assert asked_at(failing, 7 * S) == [(8.0, 3)]


def test_a_good_exit_status_is_not_back():
    failing = machine()
    failing.update(0, failed=True)
    failing.tell(S, 1, good=True)
    assert failing.restart is Restart.TRYING
    assert failing.changes_at_ns == 3 * S


def test_what_is_said_of_another_attempt_is_ignored():
    failing = machine()
    asked_at(failing, 0, 4 * S)
    failing.tell(5 * S, 1, good=False)
    assert failing.restart is Restart.TRYING


def test_it_is_done_when_the_component_is_back():
    failing = machine()
    failing.update(0, failed=True)
    failing.update(2 * S, failed=False)
    assert (failing.restart, failing.until_ns, failing.changes_at_ns) == (Restart.NONE, None, FOREVER_NS)


def test_a_flapping_component_goes_on_where_it_was_and_is_given_up():
    flapping = machine()
    requests = []
    for index in range(4):
        begin_ns = index * 10 * S
        requests += asked_at(flapping, begin_ns, begin_ns + S)
        flapping.update(begin_ns + 2 * S, failed=False)
    assert requests == [(0.0, 1), (11.0, 2)]
    flapping.update(40 * S, failed=True)
    assert flapping.restart is Restart.GIVEN_UP


def test_attempts_are_forgotten_when_it_was_good_for_long_enough():
    failing = machine()
    assert asked_at(failing) == [(0.0, 1), (4.0, 2)]
    failing.update(50 * S, failed=False)
    assert asked_at(failing, 80 * S) == [(80.0, 1), (84.0, 2)]


def test_a_new_takeoff_check_tries_again_what_was_given_up_but_not_what_is_being_tried():
    failing = machine()
    asked_at(failing)
    failing.forget()
    assert asked_at(failing, 50 * S, 51 * S) == [(50.0, 1)]
    failing.forget()
    assert asked_at(failing, 51 * S) == [(54.0, 2)]


def test_never_means_never():
    quiet = machine(RestartSpec())
    assert asked_at(quiet) == []
    assert (quiet.possible, quiet.restart) == (False, Restart.NONE)


def test_time_that_jumps_backwards_does_not_stretch_an_attempt():
    failing = machine()
    failing.update(100 * S, failed=True)
    failing.update(10 * S, failed=True)
    assert failing.changes_at_ns == 13 * S


@pytest.mark.parametrize("policy", [RestartPolicy.NODE, RestartPolicy.DRIVER, RestartPolicy.COMMAND])
def test_the_px4_is_refused_here_too_whatever_the_specification_says(policy: RestartPolicy):
    spec = ComponentSpec("px4_imu", "px4", node="/mavros")
    object.__setattr__(spec, "restart", RestartSpec(policy, () if policy is RestartPolicy.NODE else ("x",)))
    with pytest.raises(RestartRefusedError) as refused:
        RestartMachine(spec)
    assert refused.value.component == "px4_imu"
    expected = "px4_imu belongs to the PX4, which is never restarted: the vehicle would be uncontrollable"
    assert str(refused.value) == expected


@pytest.mark.parametrize(
    "node, why",
    [
        ("/px4/driver", "/px4/driver is a node of imu, of the PX4"),
        ("/mavros", "/mavros is mavros, the link to the vehicle"),
        ("/watchdog", "/watchdog is a node of this stack"),
        ("/left/autopilot", "/left/autopilot is a node of this stack"),
        ("/data_recorder_second", "/data_recorder_second is a node of this stack"),
        ("/camera", ""),
        ("/watchdog/camera", ""),
        ("/autopilot_camera", ""),
    ],
)
def test_a_node_that_the_vehicle_needs_is_never_ended(node: str, why: str):
    for link in ("/mavros", "/mavros/"):
        assert why_kept(node, {"/px4/driver": "imu"}, link) == why
    if node == "/mavros":
        assert why_kept(node, {}) == ""
    refused = RestartRefusedError("camera", why)
    assert refused.component == "camera"
    if why:
        assert str(refused) == f"camera is not restarted: {why}: the vehicle would be uncontrollable"


@given(
    st.integers(1, 5),
    st.integers(1, 10),
    st.integers(1, 10),
    st.integers(0, 40),
    st.lists(st.tuples(st.integers(0, 30), st.sampled_from(["failed", "good", "tell"])), max_size=60),
)
def test_it_never_asks_more_often_than_it_may_and_never_waits_without_end(
    attempts: int, backoff_s: int, attempt_s: int, extra_s: int, steps: List[Tuple[int, str]]
):
    limits = RestartSpec(
        RestartPolicy.COMMAND, COMMAND, attempts, backoff_s * S, attempt_s * S, (attempt_s + extra_s) * S, 5, 10**6 * S
    )
    failing, now, requests = machine(limits), 0, 0
    for step_s, what in steps:
        now += step_s * S
        if what == "tell":
            failing.tell(now, requests, good=False)
        elif failing.update(now, failed=what == "failed") is not None:
            requests += 1
        assert failing.restart is not Restart.TRYING or failing.until_ns is not None
        if failing.until_ns is not None and what == "failed":
            assert now <= failing.until_ns <= now + limits.total_limit_ns
    assert requests <= attempts
    begin_ns = now
    while failing.update(now, failed=True) or failing.restart is Restart.TRYING:
        now = failing.changes_at_ns
    assert now - begin_ns <= limits.total_limit_ns + S


def test_an_attempt_that_ended_early_is_the_measure_of_the_next_at_any_time_of_the_clock():
    failing, begin_ns = machine(), 1000 * S
    failing.update(begin_ns, failed=True)
    failing.tell(begin_ns + S, 1, good=False)
    assert failing.until_ns == begin_ns + 3 * S  # a pause, and an attempt that takes as long
