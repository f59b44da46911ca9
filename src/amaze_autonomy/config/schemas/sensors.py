"""Schema of sensors.yaml: what is watched, the decision table, and the checks besides the watchdog's."""

from __future__ import annotations

from typing import Tuple

from amaze_autonomy.monitoring.initialisation import InitialisationSpec, InitialisationType
from amaze_autonomy.monitoring.specs import (
    GROUPS,
    AutopilotSensor,
    BatterySpec,
    ComponentSpec,
    EstimateSource,
    LandingSpec,
    PollingSpec,
    RangeSource,
    RestartPolicy,
    RestartSpec,
    StateEstimationSpec,
    TopicSpec,
)

from ...engine.rules import Severity
from ..kinds import Choice, Flag, ListOf, Number, Text, Whole
from ..schema import Group, Key, Named, Row, bind, group_of

# --- components schema ------------------------------------------------------------------------------------------------
# Schema of the components in sensors.yaml: the decision table, and what is watched.


COMPONENT_NAME = r"[a-z][a-z0-9_]{0,63}"
_SEGMENTS = "[A-Za-z0-9_]*(/[A-Za-z0-9_]+)*"  # ROS asks for a letter at the very beginning alone, e.g. /camera/0
TOPIC_NAME = f"([A-Za-z]|[~/][A-Za-z0-9_]){_SEGMENTS}"
SEVERITY = Choice(tuple(severity.value for severity in Severity))
NAME = Text("the name of a component of sensors.yaml")  # a bad one is refused where the component is
TOPIC = Text('the name of a topic, e.g. "/lrf/range"', TOPIC_NAME)

_SMALL = Number(above=0.0, below=1.0)
_NODE = Text('the name of a node, e.g. "/camera"', f"/[A-Za-z0-9_]{_SEGMENTS}")
_COMMAND = ListOf(
    Text("a text without control characters"), "program and arguments (no shell)", 0, example="[rosnode, kill, /camera]"
)


LONGEST_AGE_S, LANDING_WINDOW_S, LANDING_AGE_S, SLOWEST_ESTIMATE_HZ = 600.0, 1.5, 5.0, 0.1
"""Bounds of keys that a proposed configuration keeps, however slow a recorded sensor is."""


def _time(most: float = LONGEST_AGE_S) -> Number:
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
    ("policy", Choice(tuple(policy.value for policy in RestartPolicy)), "what is restarted: the node (killed, roslaunch respawns it), driver or else by a command, or never", "never is the only one in group px4, and node is refused where the PX4 or this stack needs the node: the vehicle would be uncontrollable"),
    ("command", _COMMAND, "program and arguments, for the policies driver and command", "no shell: nothing is expanded or chained"),
    ("attempts", Whole(1, 100), "at most so many, one after the other", "what does not come back in three does not come back"),
    ("backoff_ns", _time(60), "pause between two attempts", "a USB device needs a second to go away"),
    ("attempt_limit_ns", _time(), "time in which an attempt must bring the component back; more than its slowest source needs to be back", "the start of the slowest driver comes before"),
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
    ("autopilot_age_limit_ns", _time(60), "longest time without a report of the autopilot", "it reports at 1 to 5 Hz, and a link may lose a fifth"),
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
            "how long a flight may wait for it, all its failures together; more than its slowest source needs to be back; "
            "for moderate and high alone",
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


# --- checks schema ----------------------------------------------------------------------------------------------------
# Schema of the checks in sensors.yaml besides the watchdog's: landing detection, state estimation, battery.


_ANGLE = Number(above=0.0, maximum=90.0)
_COUNT = Whole(1, 10000)
_MAYBE_TOPIC = Text("the name of a topic, or empty", f"({TOPIC_NAME})?")


# fmt: off
_LANDING_ROWS: Tuple[Row, ...] = (
    ("topic", TOPIC, "range to the ground", "laser range finder"),
    ("source", Choice(tuple(source.value for source in RangeSource)), "kind of message: sensor_msgs/Range, sensor_msgs/LaserScan, std_msgs/Float32, geometry_msgs/PoseStamped", ""),
    ("scale", Number(above=0.0, maximum=1000.0), "metres per unit of the message", "0.001 for millimetres"),
    ("mounting_height_m", Number(minimum=-10.0, maximum=10.0), "from the feet up to the sensor", "what it measures on the ground"),
    ("min_range_m", Number(minimum=0.0, maximum=100.0), "readings below are nothing seen, when the message does not say it; a height (pose) has no such", "blind zone of the sensor"),
    ("max_range_m", Number(above=0.0, maximum=1000.0), "readings from here on are nothing seen, when the message does not say it", "reach of the sensor"),
    ("sentinels", ListOf(Number(), "numbers"), "readings, in units of the message, that mean nothing seen", "what drivers send instead of infinity"),
    ("tilt_correction", Flag(), "the beam is fixed to the vehicle: multiply by the cosine of the tilt", ""),
    ("max_tilt_rad", _ANGLE, "beyond this tilt a range says nothing about the ground", "the beam looks elsewhere"),
    ("window_ns", _time(LANDING_WINDOW_S), "time over which the median is taken; a climb is seen half of it later", "single wrong readings"),
    ("min_samples", Whole(1, 20), "good readings that make a distance; the window grows until it has them", "a median of fewer is chance"),
    ("age_limit_ns", _time(LANDING_AGE_S), "longest time without a reading before the judgement is unknown", "unknown is not good"),
    ("ground_distance_m", Number(above=0.0, maximum=10.0), "feet nearer to the ground than this are on it", "noise and grass"),
    ("airborne_distance_m", Number(above=0.0, maximum=10.0), "feet farther from the ground than this are in the air", "between the two the last judgement stands"),
    ("settle_ns", _time(2), "how long the distance must agree before the judgement changes", "a bounce is not a takeoff"),
    ("landed_dwell_ns", _time(60), "how long on the ground, still, until it has landed", "a touch is not a landing"),
    ("max_vertical_speed_m_s", Number(above=0.0, maximum=10.0), "faster than this it has not landed", "noise of the estimate at rest"),
)
_STATE_ROWS: Tuple[Row, ...] = (
    ("topic", _MAYBE_TOPIC, "the estimate; empty: judged from the IMU alone", "what the controller flies by"),
    ("source", Choice(tuple(source.value for source in EstimateSource)), "kind of message: nav_msgs/Odometry, geometry_msgs/PoseStamped, geometry_msgs/PoseWithCovarianceStamped", ""),
    ("imu_topic", _MAYBE_TOPIC, "accelerometer whose gravity must agree; empty: none is looked at", "an estimator can be wrong and sure of itself"),
    ("imu_mounting_rpy_rad", ListOf(Number(minimum=-360.0, maximum=360.0), "roll, pitch, yaw", 3), "orientation of the IMU in the vehicle frame (x forward, y left, z up)", "as in the vehicle's URDF"),
    ("rate_hz", Number(minimum=SLOWEST_ESTIMATE_HZ, maximum=10000.0), "estimates per second that are intended", "as set in the estimator"),
    ("tolerance_fraction", _SMALL, "deviation of the rate that is still as intended", ""),
    ("age_limit_ns", _time(60), "how old the last estimate and IMU sample may be", "unknown is not good"),
    ("window_ns", _time(60), "time over which gravity is averaged", "vibration and noise"),
    ("min_samples", _COUNT, "IMU samples in the window", ""),
    ("tilt_limit_rad", _ANGLE, "largest angle between the vehicle's z axis and the vertical", "a slope that it can take off from"),
    ("tilt_difference_limit_rad", _ANGLE, "largest angle between the vertical of the estimate and that of the IMU", "a wrong mounting or a diverged filter"),
    ("gravity_m_s2", Number(minimum=9.7, maximum=9.9), "what an accelerometer measures at rest", "9.780 at the equator, 9.832 at the poles"),
    ("gravity_tolerance_m_s2", Number(above=0.0, maximum=5.0), "its deviation that is still at rest", "bias of cheap accelerometers"),
    ("position_limit_m", Number(above=0.0, maximum=100000.0), "largest distance from the origin that a valid state has", "a diverged filter runs away"),
    ("position_deviation_limit_m", Number(above=0.0, maximum=1000.0), "largest standard deviation of the position", "from the covariance"),
    ("orientation_deviation_limit_rad", _ANGLE, "largest standard deviation of the orientation", "from the covariance"),
    ("require_covariance", Flag(), "an estimate without covariance is unknown; otherwise it is only warned of", "many estimators send none"),
    ("quaternion_tolerance", _SMALL, "how far the norm of the quaternion may be from 1", "not normalised: not an orientation"),
    ("still_ns", _time(60), "how long the vehicle must have been still", "somebody may carry it"),
    ("still_acceleration_m_s2", Number(above=0.0, maximum=10.0), "largest standard deviation of the acceleration at rest", "noise, propellers standing"),
    ("still_turn_rate_rad_s", Number(above=0.0, maximum=10.0), "largest mean turn rate at rest, of the gyroscope and of the estimate", "bias of the gyroscope"),
    ("still_drift_m", Number(above=0.0, maximum=10.0), "furthest that the estimated position may move meanwhile", "a drifting estimate flies away"),
    ("speed_limit_m_s", Number(above=0.0, maximum=10.0), "largest estimated speed on the ground", ""),
)
_BATTERY_ROWS: Tuple[Row, ...] = (
    ("age_limit_ns", _time(60), "how old the last level may be", "unknown is not good"),
    ("minimum_fraction", Number(minimum=0.0, maximum=1.0), "below this no mission starts, whatever it needs", "short missions are tempting"),
    ("cells", Whole(0, 24), "cells in series, of each pack; 0: voltages are not looked at", "a wrong battery shows in its voltage"),
    ("cell_voltage_min_v", Number(above=0.0, maximum=10.0), "lowest voltage per cell at rest, whatever the level says", "levels are estimates, voltages are measured"),
    ("cell_voltage_max_v", Number(above=0.0, maximum=10.0), "highest voltage per cell that is believed", "a full cell has 4.2 V"),
)
_INITIALISATION_TYPE = Choice(tuple(each.value for each in InitialisationType))
_INITIALISATION_ROWS: Tuple[Row, ...] = (
    ("service", _MAYBE_TOPIC, "asked on the ground, disarmed, while the states are not valid; empty: the estimator needs none", "an estimator that waits to be told to begin"),
    ("type", _INITIALISATION_TYPE, "of it: std_srvs/Trigger, std_srvs/SetBool with true, std_srvs/Empty", ""),
    ("always", Flag(), "asked in each pre-flight, also when the states look valid", "they may be left from before"),
    ("limit_ns", _time(60), "time in which it must answer, and after which the states must be valid", "below preflight_fix_limit_s"),
    ("in_flight_service", _MAYBE_TOPIC, "asked once when the mission begins after a takeoff; empty: none", "a second sensor that must be in the air first"),
    ("in_flight_type", _INITIALISATION_TYPE, "of it", ""),
)
# fmt: on

INITIALISATION = group_of(InitialisationSpec, "initialisation of an estimator", _INITIALISATION_ROWS)
LANDING_DETECTION = group_of(LandingSpec, "landing detection", _LANDING_ROWS)
STATE_ESTIMATION = group_of(StateEstimationSpec, "check of the state estimation", _STATE_ROWS)
BATTERY = group_of(BatterySpec, "check of the battery before takeoff", _BATTERY_ROWS)


# --- sensors schema ---------------------------------------------------------------------------------------------------


SENSORS = Group(
    "what is watched",
    (
        Key("components", COMPONENTS, "the decision table: every component, its sources and what its failure means"),
        Key("polling", POLLING, "how often nodes and drivers are asked, and how old their answers may be", "", {}),
        Key("landing_detection", LANDING_DETECTION, "is the vehicle on the ground, has it landed?", "", {}),
        Key("state_estimation", STATE_ESTIMATION, "are the states valid, does gravity point down?", "", {}),
        Key("initialisation", INITIALISATION, "how is an estimator told to begin?", "", {}),
        Key("battery", BATTERY, "is the level enough to take off? In flight: autonomy.yaml, battery", "", {}),
    ),
)
