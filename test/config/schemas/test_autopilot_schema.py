"""autopilot.yaml: its defaults, and what cannot be."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import pytest

from amaze_autonomy import paths
from amaze_autonomy.autopilot.link.ports import make_port
from amaze_autonomy.config import AutopilotSettings, ConfigError, load_configuration
from amaze_autonomy.config.errors import EndpointError
from amaze_autonomy.config.kinds import parse_endpoint
from amaze_autonomy.config.schemas.autopilot import JUDGED_RATES


def test_the_shipped_file_says_the_defaults_and_the_parameters_that_matter():
    shipped = load_configuration(paths.config_folder(), ["missions.missions.5.controller=mission"]).autopilot
    assert replace(shipped, parameters={}, ardupilot_parameters={}, offboard_parameters={}) == AutopilotSettings()
    assert sorted(shipped.parameters) == [
        "BAT_CRIT_THR",
        "BAT_EMERGEN_THR",
        "BAT_LOW_THR",
        "COM_DISARM_LAND",
        "COM_DISARM_PRFLT",
        "COM_LOW_BAT_ACT",
        "COM_RC_OVERRIDE",
        "NAV_RCL_ACT",
    ]
    assert shipped.parameters["BAT_LOW_THR"] == shipped.battery.low_fraction


def test_a_mission_by_set_points_has_what_follows_their_loss_compared():
    ways = [f"missions.missions.5.controller={way}" for way in ("mission", "offboard")]
    by_mission, by_setpoints = (load_configuration(paths.config_folder(), [way]).autopilot for way in ways)
    assert "COM_OBL_RC_ACT" not in by_mission.parameters
    assert (by_setpoints.parameters["COM_OBL_RC_ACT"], by_setpoints.parameters["COM_RC_OVERRIDE"]) == (4, 3)
    assert by_setpoints.parameters["COM_LOW_BAT_ACT"] == by_mission.parameters["COM_LOW_BAT_ACT"]


@pytest.mark.parametrize(
    "text, message",
    [
        (
            "planner_link:\n  url: udpin:127.0.0.1:14540\n",
            "autopilot.yaml:2: planner_link.url: is 'udpin:127.0.0.1:14540', as link.url; must be an endpoint of its "
            "own; a router shares a serial port (docs/autopilot.md)",
        ),
        (
            "planner_link:\n  component_id: 191\n",
            "autopilot.yaml:2: planner_link.component_id: is 191, as link.component_id; must be another one: each node "
            "that speaks has its own",
        ),
        (
            "link:\n  vehicle_id: 2\n",
            "autopilot.yaml:1: planner_link.vehicle_id: is 1, and link.vehicle_id is 2; must be the same: the mission "
            "planner would arm and fly another vehicle than the one that is checked and landed",
        ),
        (
            "link: {vehicle_id: 0}\nplanner_link: {vehicle_id: 0}\n",
            "autopilot.yaml:1: link.vehicle_id: is 0; must be a whole number, 1 to 255",
        ),
        (
            "planner_link:\n  component_id: 1\n",
            "autopilot.yaml:2: planner_link.component_id: is 1; must be another one: system 1, component 1 is the "
            "address of the vehicle's autopilot",
        ),
        (
            "link:\n  component_id: 1\n  system_id: 3\n  vehicle_id: 3\nplanner_link:\n  vehicle_id: 3\n",
            "autopilot.yaml:2: link.component_id: is 1; must be another one: system 3, component 1 is the address of "
            "the vehicle's autopilot",
        ),
        (
            "link:\n  key_file: /a.key\n",
            "autopilot.yaml:2: link.key_file: is '/a.key', and planner_link.key_file is empty; must be named in both "
            "or in none: a vehicle that signs hears nobody who does not",
        ),
        (
            "planner_link:\n  key_file: /a.key\n",
            "autopilot.yaml:2: planner_link.key_file: is '/a.key', and link.key_file is empty; must be named in both "
            "or in none: a vehicle that signs hears nobody who does not",
        ),
        (
            "backend: ros2\n",
            "autopilot.yaml:1: backend: is the text 'ros2'; must be one of mavlink, mavros; did you mean mavros?",
        ),
        (
            "land_switch: {channel: 7}\nrates_hz:\n  RC_CHANNELS: 1\n",
            "autopilot.yaml:3: rates_hz.RC_CHANNELS: is 1; must be at least 2, two periods within "
            "land_switch.age_limit_s (1): else it is old between two",
        ),
        (
            "land_switch: {channel: 7}\nrates_hz: {RC_CHANNELS: 0}\n",
            "autopilot.yaml:2: rates_hz.RC_CHANNELS: is 0; must be above 0, or left out: land_switch has a channel, "
            "and would never say land",
        ),
        (
            "land_switch:\n  channel: 7\n  age_limit_s: 0.1\n",
            "autopilot.yaml:3: land_switch.age_limit_s: is 0.1; must be at least 0.2, two periods of RC_CHANNELS, "
            "asked for at 10 Hz: else it is old between two",
        ),
        (
            "land_switch: {above_us: 2000}\n",
            "autopilot.yaml:1: land_switch.above_us: is 2000; must be a number at least 900 and at most 1950, in "
            "microseconds",
        ),
        (
            "rates_hz: {LOCAL_POSITION_NED: 2}\n",
            "autopilot.yaml:1: rates_hz.LOCAL_POSITION_NED: is 2; must be at least 2.86, two periods within "
            "limits.speed_age_limit_s (0.7): else it is old between two",
        ),
        (
            "rates_hz: {HEARTBEAT: -0.1}\n",
            "autopilot.yaml:1: rates_hz.HEARTBEAT: is -0.1; must be a number at least 0 and at most 50",
        ),
        (
            "planner_link:\n  url: udp:localhost:14540\n",
            "autopilot.yaml:2: planner_link.url: is 'udp:localhost:14540', as link.url is ('udpin:127.0.0.1:14540'); "
            "must be an endpoint of its own; a router shares a serial port (docs/autopilot.md)",
        ),
        (
            "link:\n  url: udpin:foo\n",
            "autopilot.yaml:2: link.url: is the text 'udpin:foo', which names no host and port; must be "
            "udpin:HOST:PORT, PORT 1 to 65535",
        ),
        (
            "planner_link:\n  url: serial:/dev/ttyACM0:123456\n",
            "autopilot.yaml:2: planner_link.url: is the text 'serial:/dev/ttyACM0:123456', which names no baud rate of "
            "this system; must be one that this system has; 57600, 115200 and 921600 are usual",
        ),
        (
            "commands:\n  repeat_s: 5.0\n",
            "autopilot.yaml:2: commands.repeat_s: is 5; must be below commands.limit_s (5): else nothing is sent again",
        ),
        (
            "commands:\n  limit_s: 0.3\n",
            "autopilot.yaml:2: commands.limit_s: is 0.3; must be above commands.repeat_s (0.3): else nothing is sent "
            "again",
        ),
        (
            "commands: {exit_limit_s: 15}\n",
            "autopilot.yaml:1: commands.exit_limit_s: is 15; must be a number above 0 and at most 12, in seconds",
        ),
        ("link: {url: 14540}\n", None),
        ("link: {url: 'ftp:host:1'}\n", None),
        ("gps: {frozen_limit_ms: 5}\n", None),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(mistake, text, message):
    said = mistake("autopilot.yaml", text)
    assert said.startswith("autopilot.yaml:1: ") if message is None else said == message


@pytest.mark.parametrize("rate_hz, good", [(9.9, False), (10.0, True), (20.0, True), (20.1, False)])
def test_a_rate_of_set_points_that_would_not_be_kept_is_refused(rate_hz, good):
    with nullcontext() if good else pytest.raises(ConfigError, match="setpoint_rate_hz"):
        load_configuration(paths.config_folder(), [f"missions.planner.setpoint_rate_hz={rate_hz}"])


def test_another_vehicle_is_named_in_both_links_and_component_1_is_free_on_another_system(small):
    (small / "autopilot.yaml").write_text(
        "link: {vehicle_id: 2, system_id: 1, component_id: 1}\nplanner_link: {vehicle_id: 2}\n"
    )
    autopilot = load_configuration(small).autopilot
    assert autopilot.link.vehicle_id == autopilot.planner_link.vehicle_id == 2


@pytest.mark.parametrize("message", [name for name in JUDGED_RATES if name != "RC_CHANNELS"])
def test_a_message_may_be_as_slow_as_two_periods_within_its_limit_or_not_be_asked_for(small, mistake, message):
    shortest_s = min({"mode": 5.0, "system": 3.0, "speed": 0.7}.get(name, 2.0) for name in _limit_names(message))
    for rate_hz in (2 / shortest_s, 0.0):
        (small / "autopilot.yaml").write_text(f"rates_hz: {{{message}: {rate_hz}}}\n")
        assert load_configuration(small).autopilot.rates_hz == {message: rate_hz}
    assert mistake("autopilot.yaml", f"rates_hz: {{{message}: {1.9 / shortest_s}}}\n").startswith(
        f"autopilot.yaml:1: rates_hz.{message}: is "
    )


def _limit_names(message):
    return [limit.split(".")[1].split("_")[0] for limit in JUDGED_RATES[message][1]]


def test_without_a_land_switch_its_message_may_come_as_others_want_it(small):
    (small / "autopilot.yaml").write_text("rates_hz: {RC_CHANNELS: 0.5}\nland_switch: {age_limit_s: 0.1}\n")
    assert load_configuration(small).autopilot.rates_hz == {"RC_CHANNELS": 0.5}


@pytest.mark.parametrize(
    "url, good",
    [
        ("udpin:127.0.0.1:14540", True),
        ("udpin://127.0.0.1:65535", True),
        ("udpout:companion.local:00014550", True),
        ("tcp:[::1]:5760", True),
        ("tcpin:::1:5760", True),
        ("serial:/dev/ttyACM0", True),
        ("serial:///dev/ttyACM0:57600", True),
        ("udpin:foo", False),
        ("udpin:14540", False),
        ("udpin::14540", False),
        ("udpin:127.0.0.1:0", False),
        ("udpin:127.0.0.1:65536", False),
        ("udpin:127.0.0.1:99999", False),
        ("tcp:host:port", False),
        ("serial:/dev/ttyACM0:fast", False),
        ("serial:/dev/ttyACM0:0", False),
        ("serial:/dev/ttyACM0:123456", False),
        ("serial:/dev/ttyACM0:", False),
        ("serial:/dev/tty ACM0:57600", False),
        ("serial:/dev/ttyACM0::57600", False),
        ("serial:/dev/ttyACM0:\u0665\u0667\u0666\u0660\u0660", False),
        ("serial:/dev/serial/by-path/pci-0000:00:14.0-usb:57600", True),
        ("serial:/dev/serial/by-path/platform-3610000.xhci-usb-0:2.1:1.0:921600", True),
        ("serial:///dev/serial/by-path/platform-3610000.xhci-usb-0:2.1:1.0", True),
        ("serial:/dev/serial/by-path/platform-3610000.xhci-usb-0:2.1:1.0-port0", True),
        ("serial:/dev/serial/by-path/platform-3610000.xhci-usb-0:2.1:1.0:fast", False),
        ("serial:/dev/serial/by-path/platform-3610000.xhci-usb-0:2.1:1.0:0", False),
        ("serial:ttyACM0:57600", False),
        ("serial:ttyACM0", False),
        ("serial://dev/ttyACM0", False),
        ("serial:/", False),
        ("serial:/:57600", False),
    ],
)
def test_a_url_is_good_when_the_nodes_can_open_it(url, good):
    with nullcontext() if good else pytest.raises(EndpointError):
        make_port(parse_endpoint(url))
    with nullcontext() if good else pytest.raises(ConfigError, match=r"link\.url"):
        load_configuration(paths.config_folder(), {"autopilot.link.url": url})


@pytest.mark.parametrize(
    "url, planner_url, same",
    [
        ("udpin:127.0.0.1:14540", "udp:127.0.0.1:14540", True),
        ("udpin:127.0.0.1:14540", "udpin:localhost:14540", True),
        ("udpin:127.0.0.1:14540", "udpin:0.0.0.0:014540", True),
        ("udpin:127.0.0.1:14540", "tcpin:127.0.0.1:14540", False),
        ("udpin:127.0.0.1:14540", "udpin:192.168.1.2:14540", False),
        ("udpout:127.0.0.1:14540", "udpout:127.0.0.1:14540", False),
        ("tcpin:[::1]:5760", "tcpin:[0:0::1]:5760", True),
        ("serial:/dev/ttyACM0", "serial:/dev/ttyACM0:57600", True),
        ("serial:/dev/ttyACM0:921600", "serial:///dev/ttyACM0:57600", True),
        ("serial:/dev/ttyACM0", "serial:/dev/ttyACM1", False),
        ("serial:/dev/by-path/usb-0:2.1:1.0", "serial:/dev/by-path/usb-0:2.1:1.0:57600", True),
        ("serial:/dev/by-path/usb-0:2.1:1.0:57600", "serial:/dev/by-path/usb-0:2.2:1.0:57600", False),
    ],
)
def test_one_endpoint_is_one_however_it_is_written(url, planner_url, same):
    urls = {"autopilot.link.url": url, "autopilot.planner_link.url": planner_url}
    with pytest.raises(ConfigError, match="must be an endpoint of its own") if same else nullcontext():
        load_configuration(paths.config_folder(), urls)
