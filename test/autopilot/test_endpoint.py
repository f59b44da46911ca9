from __future__ import annotations

import socket
import time

import pytest
from autopilot_tools import wait_until

from amaze_autonomy.autopilot.link.ports import make_port
from amaze_autonomy.config.kinds import parse_endpoint

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
