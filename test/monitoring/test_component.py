"""One component: the worst of its sources, its code, its row of the pre-flight table."""

from __future__ import annotations

import itertools

import pytest
from monitoring_feed import S, regular

from amaze_autonomy.engine.events import Check, ComponentStatus, Verdict
from amaze_autonomy.engine.rules import Code, Restart, Severity
from amaze_autonomy.monitoring.component import ComponentMonitor, code_of, return_time
from amaze_autonomy.monitoring.condition import Level
from amaze_autonomy.monitoring.errors import UnknownComponentError
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec, RestartPolicy, RestartSpec, TopicSpec

# Written by hand from DESIGN.md section 4: severity -> code when it fails, code once restarting has failed.
CODES = {"low": (2, 2), "moderate": (4, 4), "high": (8, 16), "highest": (16, 16)}


@pytest.mark.parametrize("severity", list(Severity))
@pytest.mark.parametrize("restart", list(Restart))
def test_a_failure_has_the_code_of_its_severity(severity: Severity, restart: Restart):
    failed, given_up = CODES[severity.value]
    assert code_of(Level.FAILED, severity, restart) == (given_up if restart is Restart.GIVEN_UP else failed)


@pytest.mark.parametrize("severity", list(Severity))
@pytest.mark.parametrize("restart", list(Restart))
def test_what_is_off_or_starting_is_code_2_and_what_is_good_code_1(severity: Severity, restart: Restart):
    codes = [code_of(level, severity, restart) for level in (Level.GOOD, Level.STARTING, Level.OFF)]
    assert codes == [1, 2, 2]


@pytest.mark.parametrize("restart", list(Restart))
def test_a_worse_level_and_a_higher_severity_never_have_a_lower_code(restart: Restart):
    for severity in Severity:
        codes = [code_of(level, severity, restart) for level in Level]
        assert codes == sorted(codes)
    for level in Level:
        codes = [code_of(level, severity, restart) for severity in Severity]
        assert codes == sorted(codes)


TOPICS = (TopicSpec("/left", 10.0), TopicSpec("/right", 0.2))


@pytest.mark.parametrize(
    "sources, expected",
    [
        ({"topics": TOPICS, "node": "/camera", "driver": ("lsusb",)}, (25 * S, "/right at 0.2 Hz (good_samples: 5)")),
        ({"topics": TOPICS[:1], "node": "/camera"}, (750_000_000, "node /camera")),
        ({"topics": TOPICS[:1], "driver": ("lsusb",)}, (3 * S, "driver check lsusb")),
        ({"autopilot": AutopilotSensor.GPS}, (0, "")),
    ],
)
def test_the_slowest_source_says_how_long_it_needs_to_be_back(sources, expected):
    assert return_time(ComponentSpec("camera", **sources)) == expected


def camera() -> ComponentMonitor:
    """Return a camera with every kind of source, all of them good at 2 s."""
    monitor = ComponentMonitor(
        ComponentSpec(
            "camera",
            severity=Severity.HIGH,
            topics=(TopicSpec("/left", 10.0), TopicSpec("/right", 10.0)),
            node="/camera",
            driver=("lsusb",),
            autopilot=AutopilotSensor.GPS,
        )
    )
    monitor.start(0, 10 * S)
    feed(monitor, {"left", "right", "node", "driver", "autopilot"}, 0.0, 2.0)
    monitor.evaluate(2 * S)
    return monitor


def feed(monitor: ComponentMonitor, sources: set, begin_s: float, end_s: float) -> None:
    for t_ns in regular(10.0, begin_s, end_s):
        for topic in ("left", "right"):
            if topic in sources:
                monitor.rate(f"/{topic}").add(t_ns)
        for name in ("node", "driver", "autopilot"):
            if name in sources:
                getattr(monitor, name).add(t_ns, good=True)


def test_it_is_nominal_when_all_of_its_sources_are_good():
    assert camera().status == ComponentStatus("camera", Code.NOMINAL)


@pytest.mark.parametrize(
    "missing,reason",
    [
        ("left", "no message on /left for longer than 0.5 s"),
        ("right", "no message on /right for longer than 0.5 s"),
        ("node", "node /camera: no answer for longer than 1.5 s"),
        ("driver", "driver check lsusb: no answer for longer than 5 s"),
        ("autopilot", "the autopilot's gps: no answer for longer than 5 s"),
    ],
)
def test_each_of_its_sources_alone_makes_it_fail(missing: str, reason: str):
    monitor = camera()
    feed(monitor, {"left", "right", "node", "driver", "autopilot"} - {missing}, 2.0, 9.0)
    monitor.evaluate(9 * S)
    assert monitor.status == ComponentStatus("camera", Code.HOLD, Restart.NONE, None, reason)


def test_its_row_shows_value_limit_age_and_advice():
    monitor = camera()
    monitor.evaluate(3 * S)
    advice = (
        "no message on /left for longer than 0.5 s; "
        "it is not restarted by the watchdog: check its cable, power and log, then retry"
    )
    row = monitor.row(required=True, tolerated=False)
    assert row == Check("camera", Verdict.FAIL, 1.1, 0.5, "s", 1.1, advice)


def test_a_good_row_has_no_advice():
    row = camera().row(required=True, tolerated=False)
    assert (row.name, row.verdict, row.unit, row.advice) == ("camera", Verdict.PASS, "Hz", "")
    assert row.value == pytest.approx(10.0)


@pytest.mark.parametrize("required,tolerated", list(itertools.product([True, False], repeat=2)))
def test_off_is_a_warning_where_it_is_tolerated_or_not_required(required: bool, tolerated: bool):  # noqa: FBT001
    monitor = camera()
    for t_ns in regular(5.0, 2.0, 6.0):
        monitor.rate("/left").add(t_ns)
    feed(monitor, {"right", "node", "driver", "autopilot"}, 2.0, 6.0)
    monitor.evaluate(6 * S)
    assert monitor.status.code is Code.NON_CRITICAL
    verdict = monitor.row(required=required, tolerated=tolerated).verdict
    assert verdict is (Verdict.WARN if tolerated or not required else Verdict.FAIL)


def test_a_failure_at_code_2_is_tolerated_too():
    monitor = ComponentMonitor(ComponentSpec("gps", topics=(TopicSpec("/fix", 5.0),)))
    monitor.start(0, S)
    monitor.evaluate(2 * S)
    assert monitor.status.code is Code.NON_CRITICAL
    assert monitor.row(required=True, tolerated=True).verdict is Verdict.WARN


@pytest.mark.parametrize(
    "level_at_s,group,words",
    [
        (0.1, "other", "no message on /t yet; it is starting up, wait"),
        (2.0, "px4", "no message on /t since the start; the PX4 is never restarted by the watchdog"),
    ],
)
def test_advice_fits_the_case(level_at_s: float, group: str, words: str):
    monitor = ComponentMonitor(ComponentSpec("x", group, topics=(TopicSpec("/t", 5.0),)))
    monitor.start(0, S)
    monitor.evaluate(int(level_at_s * S))
    assert monitor.row(required=True, tolerated=False).advice.startswith(words)


@pytest.mark.parametrize(
    "at_s,words", [(1.0, "the watchdog is restarting it, wait"), (100.0, "restarting it did not help")]
)
def test_advice_says_what_the_watchdog_does(at_s: float, words: str):
    restart = RestartSpec(RestartPolicy.COMMAND, ("x",))
    monitor = ComponentMonitor(ComponentSpec("x", topics=(TopicSpec("/t", 5.0),), restart=restart))
    monitor.start(0, S)
    monitor.evaluate(S)
    monitor.evaluate(int(at_s * S))
    assert words in monitor.row(required=True, tolerated=False).advice


def test_a_topic_that_it_does_not_have_is_named():
    with pytest.raises(UnknownComponentError, match=r"^topic /x of camera is not watched; watched: /left, /right$"):
        camera().rate("/x")
