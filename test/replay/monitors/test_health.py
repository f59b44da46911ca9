"""What a recorded autopilot says of its sensors is judged as the watchdog node judges it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from amaze_autonomy.engine.rules import Code, Severity
from amaze_autonomy.interface import health_fields
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec
from amaze_autonomy.monitoring.watchdog import Watchdog
from amaze_autonomy.replay.monitors.feeds import HealthFeed

S = 1_000_000_000
SPECS = (ComponentSpec("imu", "px4", Severity.HIGHEST, autopilot=AutopilotSensor.IMU),)


def codes(statuses):
    """Return the times, in seconds, at which the code of the IMU changes, and the codes."""
    watchdog, found = Watchdog(SPECS), []
    feed = HealthFeed(watchdog, "/autopilot/status")
    watchdog.start(0)
    for number, message in enumerate(statuses):
        t_ns = number * S // 5
        feed.take(t_ns, message)
        code = watchdog.evaluate(t_ns)[0].code
        if not found or found[-1][1] is not code:
            found.append((t_ns / S, code))
    return found


def status(sequence, *, good=True, link_age_s=0.0):
    fields = health_fields({"imu": good}, sequences={"sensors_sequence": sequence or 0})
    if sequence is None:
        del fields["sensors_sequence"]  # a recording of before
    return SimpleNamespace(link_age=link_age_s, **fields)


def test_a_wrong_bit_of_one_report_is_a_glitch_however_often_it_is_told():
    reports = [1, 1, 2, 2, 2, 3, 3, 4, 4, 4]
    assert codes(status(each, good=each != 3) for each in reports) == [(0.0, Code.NOMINAL)]
    assert codes(status(each, good=each < 3) for each in reports) == [(0.0, Code.NOMINAL), (1.4, Code.ABORT)]


def test_a_recording_that_does_not_number_the_reports_is_judged_by_its_statuses():
    assert codes(status(None, good=each < 5) for each in range(10)) == [(0.0, Code.NOMINAL), (1.2, Code.ABORT)]
    assert codes(status(None) for _ in range(30)) == [(0.0, Code.NOMINAL)]


@pytest.mark.parametrize("sequence", [None, 1])
def test_a_recorded_link_that_dies_is_silence(sequence):
    """The last of it that counts: over a link of 5 s without numbers, the first status with them."""
    told = [status(sequence, link_age_s=max(0.0, number * 0.2 - 2.0)) for number in range(90)]
    assert codes(told) == [(0.0, Code.NOMINAL), (12.2 if sequence is None else 5.2, Code.ABORT)]


def test_silence_is_judged_once():
    told = [status(min(number // 3, 5) + 1) for number in range(60)]
    assert codes(told) == [(0.0, Code.NOMINAL), (3.0 + 5.0 + 0.2, Code.ABORT)]
