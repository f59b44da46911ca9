"""What a row of the decision table may say."""

from __future__ import annotations

import re

import pytest

from amaze_autonomy.config import load_configuration
from amaze_autonomy.config.schemas.sensors import TOPIC_NAME

CAMERA = "components.camera"


def _component(**changes: str) -> str:
    rows = {
        "group": "other",
        "severity": "moderate",
        "wait_limit_s": "20.0",
        "node": "/camera",
        "topics": "{/image: {rate_hz: 10.0}}",
        "restart": "{policy: node}",
    }
    rows.update(changes)
    lines = [f"    {key}: {value}" for key, value in rows.items() if value]
    return "components:\n  camera:\n" + "\n".join(lines) + "\n"


@pytest.mark.parametrize("policy", ["node", "driver", "command"])
@pytest.mark.parametrize("sensor", ["gps", "imu", "magnetometer", "barometer"])
def test_a_sensor_of_the_px4_is_never_restarted(mistake, policy, sensor):
    text = f"components:\n  {sensor}:\n    group: px4\n    severity: low\n    autopilot: {sensor}\n    node: /px4\n"
    text += f"    restart:\n      policy: {policy}\n      command: [reboot]\n"
    assert mistake("sensors.yaml", text) == (
        f"sensors.yaml:8: components.{sensor}.restart.policy: is {policy}; "
        "must be never in group px4: the vehicle would be uncontrollable"
    )


@pytest.mark.parametrize(
    "changes, message",
    [
        (
            {"node": "", "topics": "", "restart": ""},
            f"2: {CAMERA}: has no source; "
            "must have a source: topics, node, driver or autopilot; nothing would be watched",
        ),
        (
            {"autopilot": "imu"},
            f"3: {CAMERA}.group: is other; must be px4: the autopilot says how its imu is",
        ),
        (
            {"node": ""},
            f"7: {CAMERA}.restart.policy: is node; "
            "must be another one, or node must be given: there is none to restart",
        ),
        (
            {"restart": "{policy: command}"},
            f"8: {CAMERA}.restart.command: is missing; must be given with the policy command: program and arguments",
        ),
        (
            {"restart": "{policy: driver}"},
            f"8: {CAMERA}.restart.command: is missing; must be given with the policy driver: program and arguments",
        ),
        (
            {"restart": "{command: [a]}"},
            f"8: {CAMERA}.restart.command: is given with the policy never; "
            "must be left out, or the policy must be driver or command",
        ),
        (
            {"restart": "{policy: node, total_limit_s: 2.0}"},
            f"8: {CAMERA}.restart.total_limit_s: is 2; must be at least attempt_limit_s (5)",
        ),
        (
            {"restart": "{policy: node, attempts: 0}"},
            f"8: {CAMERA}.restart.attempts: is 0; must be a whole number, 1 to 100",
        ),
        (
            {"wait_limit_s": ""},
            f"2: {CAMERA}.wait_limit_s: is missing; "
            "must be given: with severity moderate a flight waits, and every wait has a limit",
        ),
        (
            {"severity": "high", "wait_limit_s": ""},
            f"2: {CAMERA}.wait_limit_s: is missing; "
            "must be given: with severity high a flight waits, and every wait has a limit",
        ),
        (
            {"severity": "low"},
            f"5: {CAMERA}.wait_limit_s: is 20; "
            "must be left out: with severity low it is flown on without, nobody waits",
        ),
        (
            {"severity": "highest"},
            f"5: {CAMERA}.wait_limit_s: is 20; "
            "must be left out: with severity highest it is landed for at once, nobody waits",
        ),
        (
            {"wait_limit_s": "4.0"},
            f"5: {CAMERA}.wait_limit_s: is 4; "
            "must be at least restart.attempt_limit_s (5): no restart would end in time",
        ),
        (
            {"topics": "{/image: {rate_hz: 10.0, age_limit_s: 0.2}}"},
            f"7: {CAMERA}.topics./image.age_limit_s: is 0.2; "
            "must be at least 0.3, three periods of rate_hz: one or two lost messages are no failure",
        ),
        (
            {"topics": "{/image: {rate_hz: 10.0, window_s: 0.3}}"},
            f"7: {CAMERA}.topics./image.window_s: is 0.3; must be at least 0.4, four periods of rate_hz",
        ),
        (
            {"topics": "{/image: {rate_hz: 10.0, tolerance_fraction: 1.0}}"},
            f"7: {CAMERA}.topics./image.tolerance_fraction: is 1.0; "
            "must be a number above 0 and below 1, as a fraction of 1",
        ),
        (
            {"topics": "{/image: {rate_hz: 10.0, rate_failed_fraction: 0.8}}"},
            f"7: {CAMERA}.topics./image.rate_failed_fraction: is 0.8; "
            "must be below 1 - tolerance_fraction (0.8): a slow topic comes before a failed one",
        ),
        (
            {"topics": "{/image: {rate_hz: 0.0}}"},
            f"7: {CAMERA}.topics./image.rate_hz: is 0.0; must be a number at least 0.001 and at most 100000, in Hz",
        ),
        (
            {"topics": "{image raw: {rate_hz: 10.0}}"},
            f"7: {CAMERA}.topics.image raw: is not a good name; "
            "must match ([A-Za-z]|[~/][A-Za-z0-9_])[A-Za-z0-9_]*(/[A-Za-z0-9_]+)*",
        ),
        (
            {"node": "camera"},
            f"6: {CAMERA}.node: is the text 'camera'; must be the name of a node, e.g. \"/camera\"",
        ),
    ],
)
def test_a_row_that_cannot_be_is_refused(mistake, changes, message):
    assert mistake("sensors.yaml", _component(**changes)) == f"sensors.yaml:{message}"


SLOW = "{/image: {rate_hz: 0.2, age_limit_s: 15.0}}"
MANY = "{policy: node, attempt_limit_s: 30.0, total_limit_s: 60.0, good_samples: 10000}"
LOOK = "{policy: command, command: [a], attempt_limit_s: 3.0}"


@pytest.mark.parametrize(
    "changes, message",
    [
        (
            {"topics": SLOW},
            "8: {}.restart.attempt_limit_s: is 5; must be above 25, and the time of a start: so long it takes "
            "until /image at 0.2 Hz (good_samples: 5) counts as back",
        ),
        (
            {"topics": SLOW, "restart": "{good_samples: 1}"},
            "5: {}.wait_limit_s: is 20; must be above 20: so long it takes "
            "until /image at 0.2 Hz (good_samples: 1) counts as back",
        ),
        (
            {"restart": MANY, "wait_limit_s": "40.0"},
            "8: {}.restart.attempt_limit_s: is 30; must be above 1000, and the time of a start: so long it takes "
            "until /image at 10 Hz (good_samples: 10000) counts as back",
        ),
        (
            {"restart": LOOK, "driver": "[lsusb]"},
            "8: {}.restart.attempt_limit_s: is 3; must be above 3, and the time of a start: so long it takes "
            "until driver check lsusb counts as back",
        ),
    ],
)
def test_nobody_stops_waiting_before_what_works_again_is_seen_to(mistake, changes, message):
    assert mistake("sensors.yaml", _component(**changes)) == f"sensors.yaml:{message.format(CAMERA)}"


@pytest.mark.parametrize(
    "changes",
    [
        {"topics": SLOW, "wait_limit_s": "", "severity": "low", "restart": ""},
        {"topics": SLOW, "restart": "", "wait_limit_s": "25.1"},
        {"topics": SLOW, "restart": "{policy: node, attempt_limit_s: 25.1, total_limit_s: 60.0}", "wait_limit_s": "60"},
    ],
)
def test_a_slow_topic_is_good_where_nobody_waits_or_for_long_enough(small, changes):
    (small / "sensors.yaml").write_text(_component(**changes))
    assert load_configuration(small).components[0].topics[0].rate_hz == 0.2


LEGAL = ("/camera/0/image_raw", "/2d_lidar/scan", "/_image", "camera/0", "~image", "~0")
ILLEGAL = ("", "/", "~", "0camera", "_image", "/camera/", "/camera//image", "//camera", "~/image", "/camera~", "/größe")


@pytest.mark.parametrize("name", LEGAL)
def test_a_topic_may_have_any_name_that_ros_allows(small, name):
    (small / "sensors.yaml").write_text(_component(topics=f'{{"{name}": {{rate_hz: 10.0}}}}'))
    assert [spec.topic for spec in load_configuration(small).components[0].topics] == [name]


@pytest.mark.parametrize("name", ILLEGAL)
def test_a_topic_has_no_name_that_ros_refuses_or_resolves_to_another(name):
    assert re.fullmatch(TOPIC_NAME, name) is None


def test_a_node_may_have_any_whole_name_that_ros_allows(small):
    (small / "sensors.yaml").write_text(_component(node="/camera/0/_driver"))
    assert load_configuration(small).components[0].node == "/camera/0/_driver"


@pytest.mark.parametrize("node", ["camera/0", "~driver", "/", "/camera//driver", "/camera/"])
def test_a_node_has_a_whole_name(mistake, node):
    said = mistake("sensors.yaml", _component(node=f'"{node}"'))
    assert said.endswith(f'{CAMERA}.node: is the text {node!r}; must be the name of a node, e.g. "/camera"')


@pytest.mark.parametrize(
    "section, message",
    [
        (
            "polling: {node_age_limit_s: 0.1}",
            "polling.node_age_limit_s: is 0.1; must be at least node_period_s + node_answer_limit_s",
        ),
        (
            "landing_detection: {airborne_distance_m: 0.1}",
            "landing_detection.airborne_distance_m: is 0.1; must be above ground_distance_m",
        ),
        (
            "landing_detection: {sentinels: [1.0e+999]}",
            "landing_detection.sentinels.0: is 1.0e+999; must be a number",
        ),
        (
            "landing_detection: {window_s: 1.51}",
            "landing_detection.window_s: is 1.51; must be a number above 0 and at most 1.5, in seconds",
        ),
        (
            "landing_detection: {min_samples: 21}",
            "landing_detection.min_samples: is 21; must be a whole number, 1 to 20",
        ),
        (
            "landing_detection: {age_limit_s: 5.1}",
            "landing_detection.age_limit_s: is 5.1; must be a number above 0 and at most 5, in seconds",
        ),
        (
            "landing_detection: {settle_s: 2.1}",
            "landing_detection.settle_s: is 2.1; must be a number above 0 and at most 2, in seconds",
        ),
        (
            "state_estimation: {imu_mounting_rpy_deg: [0, 0, 0, 0]}",
            "state_estimation.imu_mounting_rpy_deg: is [0.0, 0.0, 0.0, 0.0]; must be three numbers: roll, pitch, yaw",
        ),
        (
            "state_estimation: {tilt_limit_deg: 91.0}",
            "state_estimation.tilt_limit_deg: is 91.0; must be a number above 0 and at most 90, in degrees",
        ),
        (
            "state_estimation: {tilt_limit_rad: 0.5}",
            "state_estimation.tilt_limit_rad: is an unknown key; "
            "did you mean tilt_limit_deg (0.5 rad are 28.6479 deg)?",
        ),
        (
            "battery: {cell_voltage_min_v: 4.5}",
            "battery.cell_voltage_max_v: is 4.35; must be above cell_voltage_min_v",
        ),
    ],
)
def test_the_other_checks_are_refused_by_their_specifications_with_file_and_line(mistake, small_file, section, message):
    assert mistake("sensors.yaml", small_file("sensors.yaml") + section + "\n") == f"sensors.yaml:14: {message}"
