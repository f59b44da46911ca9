"""A bad line, in virtual time and on UDP."""

from __future__ import annotations

import time

import pytest
from bad_line import BadLine, BadRelay, Quality
from udp_tools import Client, served

pytestmark = pytest.mark.live

MS, S = 1_000_000, 1_000_000_000


def test_a_perfect_line_hands_over_at_once_and_in_order():
    line = BadLine(Quality(), 1)
    for number in range(5):
        line.send(number, bytes([number]))
    assert line.due(5) == [bytes([number]) for number in range(5)]
    assert (line.due(6), line.lost) == ([], 0)


def test_a_line_loses_its_part_and_delays_up_to_its_jitter():
    line, came = BadLine(Quality(loss=0.05, jitter_ns=50 * MS), 2), []
    for number in range(2000):
        line.send(number * MS, number.to_bytes(2, "big"))
        came += [(number * MS, int.from_bytes(data, "big")) for data in line.due(number * MS)]
    late = [t_ns - number * MS for t_ns, number in came]
    assert 60 <= line.lost <= 140
    assert max(late) <= 51 * MS
    assert [number for _, number in came] != sorted(number for _, number in came), "nothing was overtaken"


def test_nothing_gets_through_a_cut_and_the_same_seed_loses_the_same():
    def flown(seed):
        line = BadLine(Quality(loss=0.3, cuts=((10, 20),)), seed)
        for t_ns in range(40):
            line.send(t_ns, bytes([t_ns]))
        return [data[0] for data in line.due(40)]

    assert flown(7) == flown(7) != flown(8)
    assert not set(flown(7)) & set(range(10, 20))


def until(condition, limit_s=20.0):
    deadline_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline_s, "it did not come"
        time.sleep(0.01)


def test_a_relay_passes_both_ways_cuts_and_passes_again():
    with served() as (owner, port):
        relay = BadRelay(("127.0.0.1", port), Quality(jitter_ns=20 * MS))
        relay.start()
        try:
            with Client(relay.port) as client:
                assert client.hear("HEARTBEAT") is not None
                assert client.command(400, 1) == 0
                assert (owner.craft.armed, relay.lost) == (True, 0)
                before_ms = client.hear("ATTITUDE").time_boot_ms
                relay.cut(0, S)
                until(lambda: relay.lost > 0)
                client.until(lambda said: said.get_type() == "ATTITUDE" and said.time_boot_ms > before_ms + 1500)
        finally:
            relay.stop()


def test_a_relay_loses_its_part():
    with served() as (_, port):
        relay = BadRelay(("127.0.0.1", port), Quality(loss=0.5))
        relay.start()
        try:
            with Client(relay.port) as client:
                client.beat()
                until(lambda: relay.lost > 0 or client.beat())
                assert client.hear("ATTITUDE") is not None
        finally:
            relay.stop()
