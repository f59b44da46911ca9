from __future__ import annotations

import socket
import time

import pytest
from autopilot_tools import wait_until

from amaze_autonomy.autopilot.errors import EndpointError
from amaze_autonomy.autopilot.link.ports import Endpoint, EndpointKind, make_port, parse_endpoint


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


def test_a_baud_rate_that_the_system_does_not_have_is_refused():
    with pytest.raises(EndpointError, match="no such baud rate"):
        make_port(parse_endpoint("serial:/dev/ttyACM0:123456"))


# --- how long it waited -----------------------------------------------------------------------------------------------


@pytest.fixture
def waiting():
    """Return a call that sends datagrams, pauses after each, and returns the chunks that a port then reads."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
    port = make_port(parse_endpoint(f"udpin:127.0.0.1:{number}"))
    port.open()
    speaker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def sent(*pauses_s):
        for pause_s in pauses_s:
            speaker.sendto(b"x", ("127.0.0.1", number))
            time.sleep(pause_s)  # what is measured is this time
        chunks = []
        wait_until(lambda: chunks.extend(port.read()) or len(chunks) >= len(pauses_s))
        return chunks

    # The kernel begins to stamp a moment after it was asked to (net_enable_timestamp).
    assert wait_until(lambda: sent(0.02)[0].waited_ns > 10_000_000)
    yield sent
    speaker.close()
    port.close()


@pytest.mark.live
def test_a_datagram_that_nobody_read_says_for_how_long_it_waited(waiting):
    first, second, third = (chunk.waited_ns * 1e-9 for chunk in waiting(0.2, 0.1, 0.0))
    assert first > second + 0.19
    assert second > third + 0.09
    assert third >= 0.0


@pytest.mark.live
@pytest.mark.parametrize("set_by_s", [3600.0, -3600.0])
def test_a_wall_clock_that_is_set_meanwhile_makes_nothing_older_than_the_last_look(waiting, monkeypatch, set_by_s):
    waiting(0.0)
    began_ns, right_ns = time.monotonic_ns(), time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: right_ns() + round(set_by_s * 1e9))
    (chunk,) = waiting(0.05)
    most_ns = time.monotonic_ns() - began_ns + 1_000_000_000 if set_by_s > 0 else 0
    assert 0 <= chunk.waited_ns <= most_ns
