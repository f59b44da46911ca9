"""What a single value may be, and what is said when it is something else."""

from __future__ import annotations

import pytest

from amaze_autonomy.config.errors import EndpointError
from amaze_autonomy.config.kinds import Endpoint, EndpointKind, parse_endpoint

HEIGHT = "must be a number above 0 and at most 1000, in metres"
ROUNDS = "must be a whole number, 1 to 100"


@pytest.mark.parametrize(
    "value, rest",
    [
        ("[1]", f"is a list; {HEIGHT}"),
        ("{a: 1}", f"is a group of keys; {HEIGHT}"),
        ("", f"has no value; {HEIGHT}"),
        ("~", f"has no value; {HEIGHT}"),
        ("true", f"is true; {HEIGHT}"),
        ("tall", f"is the text 'tall'; {HEIGHT}"),
        ("2020-01-01", f"is 2020-01-01; {HEIGHT}"),
        (".nan", f"is .nan; {HEIGHT}"),
        (".inf", f"is .inf; {HEIGHT}"),
        ("-.inf", f"is -.inf; {HEIGHT}"),
        ("1.0e+999", f"is 1.0e+999; {HEIGHT}"),
        ("0", f"is 0; {HEIGHT}"),
        ("-3.5", f"is -3.5; {HEIGHT}"),
        ("1000.5", f"is 1000.5; {HEIGHT}"),
        ("010", f"is 010; {HEIGHT}, written plainly"),
        ("0x10", f"is 0x10; {HEIGHT}, written plainly"),
        ("1:30", f"is 1:30; {HEIGHT}, written plainly"),
        ("1e2", f"is the text '1e2'; {HEIGHT}: write 100.0 without quotes"),
        ('"3.5"', f"is the text '3.5'; {HEIGHT}: write 3.5 without quotes"),
        ("3 m", f"is the text '3 m'; {HEIGHT}, written without its unit"),
        ("x" * 100, f"is the text '{'x' * 60}...'; {HEIGHT}"),
    ],
)
def test_a_number_is_a_plain_finite_number_within_its_bounds(mistake, value, rest):
    message = mistake("autonomy.yaml", f"flight:\n  max_height_m: {value}\n")
    assert message == f"autonomy.yaml:2: flight.max_height_m: {rest}"


@pytest.mark.parametrize(
    "value, rest",
    [
        ("0", f"is 0; {ROUNDS}"),
        ("101", f"is 101; {ROUNDS}"),
        ("5.0", f"is 5.0; {ROUNDS}"),
        ("010", f"is 010; {ROUNDS}"),
        ("9" * 30, f"is {'9' * 30}; {ROUNDS}"),
        ("five", f"is the text 'five'; {ROUNDS}"),
    ],
)
def test_a_count_is_a_whole_number(mistake, value, rest):
    message = mistake("autonomy.yaml", f"checks:\n  preflight_rounds_limit: {value}\n")
    assert message == f"autonomy.yaml:2: checks.preflight_rounds_limit: {rest}"


def test_a_flag_is_true_or_false(mistake):
    expected = "autonomy.yaml:1: require_go: is the text 'maybe'; must be true or false"
    assert mistake("autonomy.yaml", "require_go: maybe\n") == expected


def test_a_choice_is_one_of_its_words(mistake, small_file):
    text = small_file("sensors.yaml").replace("severity: low", "severity: lowest")
    assert mistake("sensors.yaml", text) == (
        "sensors.yaml:4: components.gps.severity: is the text 'lowest'; "
        "must be one of low, moderate, high, highest; did you mean low?"
    )


def test_a_command_is_a_list_and_no_shell_text(mistake, small_file):
    text = small_file("sensors.yaml").replace("{policy: node}", "{policy: command, command: rosnode kill /camera}")
    assert mistake("sensors.yaml", text) == (
        "sensors.yaml:13: components.camera.restart.command: is the text 'rosnode kill /camera'; must be a list of "
        "program and arguments (no shell), e.g. [rosnode, kill, /camera]"
    )


@pytest.mark.parametrize(
    "text, message",
    [
        ("description: 5", "description: is 5; must be one line: put it in quotes"),
        ("description: yes", "description: is yes; must be one line: put it in quotes"),
        ('description: "two\\nlines"', "description: is the text 'two\\nlines'; must be one line"),
        (f"description: {'x' * 121}", "description: has 121 characters; must be one line of at most 120 characters"),
        ('description: ""', "description: is the text ''; must be one line"),
    ],
)
def test_a_text_is_printable_and_not_too_long(mistake, text, message):
    text = f"missions:\n  '1':\n    {text}\n    files: [up.csv]\n"
    assert mistake("missions.yaml", text) == f"missions.yaml:3: missions.1.{message}"


def test_an_empty_list_is_refused_where_something_is_needed(mistake):
    assert mistake("missions.yaml", "missions:\n  '1':\n    description: x\n    files: []\n") == (
        "missions.yaml:4: missions.1.files: is an empty list; must be a list of waypoint files, at least 1, "
        "e.g. [trajectories/square.csv]"
    )


def test_what_may_be_listed_once_is_not_listed_twice(mistake, small_file):
    text = small_file("missions.yaml") + "    required: [gps, gps]\n"
    assert mistake("missions.yaml", text) == (
        "missions.yaml:5: missions.1.required.1: 'gps' is listed twice; must be listed once"
    )


# --- endpoints --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "url, endpoint",
    [
        ("serial:/dev/ttyACM0:921600", Endpoint(EndpointKind.SERIAL, "/dev/ttyACM0", 921600)),
        ("serial:///dev/ttyACM0:57600", Endpoint(EndpointKind.SERIAL, "/dev/ttyACM0", 57600)),
        ("serial:/dev/ttyUSB0", Endpoint(EndpointKind.SERIAL, "/dev/ttyUSB0", 57600)),
        (
            "serial:/dev/by-path/usb-0:2:1.0:921600",
            Endpoint(EndpointKind.SERIAL, "/dev/by-path/usb-0:2:1.0", 921600),
        ),
        ("serial:/dev/by-path/usb-0:2:1.0", Endpoint(EndpointKind.SERIAL, "/dev/by-path/usb-0:2:1.0", 57600)),
        ("udpin:0.0.0.0:14540", Endpoint(EndpointKind.UDP_IN, "0.0.0.0", 14540)),
        ("udp:127.0.0.1:14550", Endpoint(EndpointKind.UDP_IN, "127.0.0.1", 14550)),
        ("udpout:192.168.1.2:14550", Endpoint(EndpointKind.UDP_OUT, "192.168.1.2", 14550)),
        ("udpin://127.0.0.1:14540", Endpoint(EndpointKind.UDP_IN, "127.0.0.1", 14540)),
        ("tcp:localhost:5760", Endpoint(EndpointKind.TCP, "localhost", 5760)),
        ("tcp:[::1]:5760", Endpoint(EndpointKind.TCP, "::1", 5760)),
        (" tcpin:127.0.0.1:1 ", Endpoint(EndpointKind.TCP_IN, "127.0.0.1", 1)),
    ],
)
def test_urls_are_read_as_mavlink_people_write_them(url, endpoint):
    assert parse_endpoint(url) == endpoint
    assert parse_endpoint(str(endpoint)) == endpoint


@pytest.mark.parametrize(
    "url, words",
    [
        ("", "is no connection URL"),
        ("/dev/ttyACM0", "is no connection URL"),
        ("http://example.org:80", "is no connection URL"),
        ("udpin:14540", "names no host and port"),
        ("udpin:0.0.0.0:99999", "names no host and port"),
        ("udpin:0.0.0.0:0", "names no host and port"),
        ("tcp:host:port", "names no host and port"),
        ("serial:/dev/ttyACM0:fast", "names no device and baud rate"),
        ("serial:/dev/ttyACM0:", "names no device and baud rate"),
        ("serial:/dev/by-path/usb-0:2:1.0:0", "names no device and baud rate"),
        ("serial:/dev/ttyACM0:123456", "names no baud rate of this system"),
        ("serial:ttyACM0", "names no device and baud rate"),
        ("serial:ttyACM0:57600", "names no device and baud rate"),
    ],
)
def test_what_is_no_url_is_refused_with_what_would_be_right(url, words):
    with pytest.raises(EndpointError) as caught:
        parse_endpoint(url)
    assert caught.value.wrong == words
    assert str(caught.value) == f"{url!r}: {words}; {caught.value.right}"
    assert "must be" in caught.value.right
