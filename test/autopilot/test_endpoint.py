from __future__ import annotations

import pytest

from amaze_autonomy.autopilot.errors import EndpointError
from amaze_autonomy.autopilot.link.ports import Endpoint, EndpointKind, make_port, parse_endpoint


@pytest.mark.parametrize(
    "url, endpoint",
    [
        ("serial:/dev/ttyACM0:921600", Endpoint(EndpointKind.SERIAL, "/dev/ttyACM0", 921600)),
        ("serial:///dev/ttyACM0:57600", Endpoint(EndpointKind.SERIAL, "/dev/ttyACM0", 57600)),
        ("serial:/dev/ttyUSB0", Endpoint(EndpointKind.SERIAL, "/dev/ttyUSB0", 57600)),
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
    assert parse_endpoint(str(endpoint)) == endpoint or endpoint.address == "::1"


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
        ("serial:ttyACM0:57600", "names no device and baud rate"),
    ],
)
def test_what_is_no_url_is_refused_with_what_would_be_right(url, words):
    with pytest.raises(EndpointError) as caught:
        parse_endpoint(url)
    assert caught.value.wrong == words
    assert str(caught.value) == f"{url!r}: {words}; {caught.value.right}"
    assert "must be" in caught.value.right


def test_a_baud_rate_that_the_system_does_not_have_is_refused():
    with pytest.raises(EndpointError, match="no such baud rate"):
        make_port(parse_endpoint("serial:/dev/ttyACM0:123456"))
