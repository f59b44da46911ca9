"""Schema of the components in sensors.yaml: the decision table, and what is watched."""

from __future__ import annotations

from typing import Tuple

from amaze_autonomy.engine.severity import Severity
from amaze_autonomy.monitoring.specs import (
    GROUPS,
    AutopilotSensor,
    ComponentSpec,
    PollingSpec,
    RestartPolicy,
    RestartSpec,
    TopicSpec,
)

from .binding import Row, bind, group_of
from .kinds import Choice, Flag, ListOf, Number, Text, Whole
from .schema import Group, Key, Named

__all__ = ["COMPONENTS", "COMPONENT_NAME", "NAME", "POLLING", "SEVERITY", "TOPIC", "TOPIC_NAME"]

COMPONENT_NAME = r"[a-z][a-z0-9_]{0,63}"
TOPIC_NAME = r"[~/]?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*"
SEVERITY = Choice(tuple(severity.value for severity in Severity))
NAME = Text("the name of a component of sensors.yaml", COMPONENT_NAME)
TOPIC = Text('the name of a topic, e.g. "/lrf/range"', TOPIC_NAME)

_SMALL = Number(above=0.0, below=1.0)
_NODE = Text('the name of a node, e.g. "/camera"', "/" + TOPIC_NAME[len("[~/]?") :])
_COMMAND = ListOf(
    Text("a text without control characters"), "program and arguments (no shell)", 0, example="[rosnode, kill, /camera]"
)


def _time(most: float = 600.0) -> Number:
    return Number(above=0.0, maximum=most)


# fmt: off
_TOPIC_ROWS: Tuple[Row, ...] = (
    ("rate_hz", Number(minimum=0.001, maximum=100000.0), "messages per second that are intended", "as set in the driver"),
    ("tolerance_fraction", _SMALL, "deviation of the rate that is still as intended; more is code 2", "wide enough for jitter, narrow enough to see a halved rate"),
    ("rate_failed_fraction", _SMALL, "part of the intended rate below which the component has failed", "a third of the data is of no use"),
    ("age_limit_ns", _time(), "silence after which the component has failed; at least three periods", "one or two lost messages are no failure"),
    ("window_ns", _time(), "time over which the rate is measured; at least four periods; left out: ten periods, at least 1 s", "a longer one is steadier and slower"),
    ("finite", Flag(), "NaN or infinity in the content is a failure", "costs decoding each message"),
    ("unchanged_limit_ns", _time(), "content that stays the same for longer is a failure; left out: not looked at", "a camera can send the same frame for ever"),
    ("stamp_tolerance_ns", _time(60), "header stamps further than this from the arrival are code 2; left out: not looked at", "clocks of two computers drift apart"),
)
_RESTART_ROWS: Tuple[Row, ...] = (
    ("policy", Choice(tuple(policy.value for policy in RestartPolicy)), "what is restarted: the node (killed, roslaunch respawns it), driver or else by a command, or never", "never is the only one in group px4: the vehicle would be uncontrollable"),
    ("command", _COMMAND, "program and arguments, for the policies driver and command", "no shell: nothing is expanded or chained"),
    ("attempts", Whole(1, 100), "at most so many, one after the other", "what does not come back in three does not come back"),
    ("backoff_ns", _time(60), "pause between two attempts", "a USB device needs a second to go away"),
    ("attempt_limit_ns", _time(), "time in which an attempt must bring the component back", "the start of the slowest driver"),
    ("total_limit_ns", _time(), "time after which the watchdog gives up, all attempts together", "within what a flight waits"),
    ("good_samples", Whole(1, 10000), "messages in time that show that it is back", "one message may be the last of a buffer"),
    ("forget_after_ns", _time(3600), "good for so long: attempts and time are forgotten", "a flapping component is given up"),
)
_POLLING_ROWS: Tuple[Row, ...] = (
    ("node_period_ns", _time(60), "how often a node is asked", "an answer takes a millisecond"),
    ("node_answer_limit_ns", _time(60), "time that its answer may take", "a busy node is slow, a dead one refuses at once"),
    ("node_age_limit_ns", _time(60), "longest time without a good answer", "three questions"),
    ("driver_period_ns", _time(60), "how often the command that looks at a driver is run", "it starts a process each time"),
    ("driver_run_limit_ns", _time(60), "time that one run may take", "longer is a failed run"),
    ("driver_age_limit_ns", _time(60), "longest time without a result", "two runs"),
    ("autopilot_age_limit_ns", _time(60), "longest time without a report of the autopilot", "it reports at 1 to 5 Hz"),
    ("autopilot_reports", Whole(1, 100), "reports in a row that change the verdict", "a single one may be a glitch"),
)
# fmt: on
_RECORDED = Key("recorded", Flag(), "false: it is meant to be in no group of recording.yaml", "", True)
_TOPIC = Group("one topic", (*group_of(TopicSpec, "one topic", _TOPIC_ROWS).keys, _RECORDED))
_COMPONENT = Group(
    "a component: what tells that it works, and what its failure means",
    (
        Key("group", Choice(GROUPS), "px4: a sensor of the autopilot, never restarted; other: all else"),
        Key(
            "severity",
            SEVERITY,
            "how bad its failure is, unless a mission names another",
            "the row of the severity table",
        ),
        Key(
            "wait_limit_s",
            _time(),
            "how long a flight may wait for it, all its failures together; for moderate and high alone",
            "every wait has a limit",
            None,
        ),
        bind(
            ComponentSpec,
            "required",
            Flag(),
            "must be at code 1 before takeoff when a mission does not list what it needs",
            "all are required unless somebody says why not",
        ),
        Key(
            "topics",
            Named("topics that it must publish", TOPIC_NAME, _TOPIC),
            "topics that it must publish",
            "all its sources are judged, the worst counts",
            {},
        ),
        bind(
            ComponentSpec,
            "node",
            _NODE,
            "ROS node that must answer; left out: none",
            "a node can live and send nothing, or send and be dead by now",
        ),
        bind(
            ComponentSpec,
            "driver",
            _COMMAND,
            "command that tells by exit status 0 that its driver works; empty: none",
            "",
        ),
        bind(
            ComponentSpec,
            "autopilot",
            Choice(tuple(sensor.value for sensor in AutopilotSensor)),
            "sensor that the autopilot must call healthy; left out: none",
            "the PX4 knows its sensors best",
        ),
        Key(
            "restart",
            group_of(RestartSpec, "how it is restarted", _RESTART_ROWS),
            "how it is restarted, and when the watchdog gives up",
            "",
            {},
        ),
    ),
)

COMPONENTS = Named("components", COMPONENT_NAME, _COMPONENT, 1)
POLLING = group_of(PollingSpec, "how often nodes and drivers are asked", _POLLING_ROWS)
