"""The simulated vehicle on UDP: connections of their own, cuts, addresses."""

from __future__ import annotations

import contextlib
import socket
import time

import pytest
from pymavlink.dialects.v20 import common as mavlink
from udp_tools import Client, Quick, free_port, served

from amaze_autonomy.simulation import px4_udp
from amaze_autonomy.simulation.px4 import VehicleAddressError
from amaze_autonomy.simulation.px4_udp import VehicleServer

pytestmark = pytest.mark.live

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM


def test_a_client_that_speaks_is_answered_and_can_arm():
    with served() as (owner, port), Client(port) as client:
        assert client.hear("HEARTBEAT").autopilot == mavlink.MAV_AUTOPILOT_PX4
        assert client.command(ARM, 1) == 0
        assert owner.craft.armed


def test_two_clients_at_one_address_have_rates_and_acknowledgements_of_their_own():
    with served() as (_, port), Client(port) as one, Client(port, 192) as other:
        other.hear("HEARTBEAT")
        assert one.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, -1) == 0
        assert other.hear("ATTITUDE") is not None
        assert one.hear("COMMAND_ACK", 0.1) is None
        while one.hear("ATTITUDE", 0.1) is not None:
            pass  # those that were on their way
        assert one.hear("ATTITUDE", 0.3) is None


def test_it_speaks_first_to_an_address_that_it_is_told():
    with socket.socket(type=socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.settimeout(5.0)
        with served(addresses=(f"udpout:127.0.0.1:{ear.getsockname()[1]}",)):
            data, _ = ear.recvfrom(2048)
            assert data[:1] == b"\xfd"


def test_one_component_can_be_cut_off_while_another_is_served():
    cut = []
    with served(mute=lambda component: component in cut) as (owner, port), Client(port) as one, Client(
        port, 192
    ) as two:
        one.hear("HEARTBEAT")
        two.hear("HEARTBEAT")
        cut.append(191)
        one.link.mav.command_long_send(1, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0)
        assert one.hear("COMMAND_ACK", 0.5) is None
        assert not owner.craft.armed
        while one.link.recv_match(blocking=True, timeout=0.1) is not None:
            pass
        assert one.hear("HEARTBEAT", 1.2) is None
        assert two.command(ARM, 1) == 0
        cut.clear()
        assert one.hear("HEARTBEAT") is not None


def test_garbage_is_passed_over():
    with served() as (_, port), Client(port) as client:
        with socket.socket(type=socket.SOCK_DGRAM) as stranger:
            for data in (b"", b"\xfd", b"hello" * 100, bytes(range(256)) * 8):
                stranger.sendto(data, ("127.0.0.1", port))
        assert client.hear("HEARTBEAT") is not None
        assert client.command(ARM, 1) == 0


def test_more_peers_than_it_serves_are_not_answered_and_that_is_told_once(monkeypatch):
    monkeypatch.setattr(px4_udp, "_SILENT_S", 60.0)
    told = []
    with served(complain=told.append) as (_, port), clients(port, 16) as first:
        assert all(client.hear("ATTITUDE") is not None for client in first)
        with clients(port, 2) as late:
            assert [client.hear("ATTITUDE", 0.3) for client in late] == [None, None]
            one = place_of(late[0])
    assert told == [f"16 speak to the simulated vehicle: it does not answer {one}, nor others, until one is silent"]


def test_peers_that_are_gone_make_room_and_one_that_speaks_or_was_named_stays(monkeypatch):
    monkeypatch.setattr(px4_udp, "_SILENT_S", 0.5)
    told, gone = [], ""
    with socket.socket(type=socket.SOCK_DGRAM) as named:
        named.bind(("127.0.0.1", 0))
        named.settimeout(2.0)
        addresses = ("udpin:127.0.0.1:0", f"udpout:127.0.0.1:{named.getsockname()[1]}")
        with served(addresses=addresses, complain=told.append) as (_, port), Client(port) as stays:
            assert stays.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, -1) == 0
            for _ in range(3):
                stays.beat()
                with clients(port, 14) as some:
                    assert all(client.hear("HEARTBEAT") is not None for client in some)
                    gone = gone or place_of(some[0])
                time.sleep(0.6)
            on_their_way = iter(range(100))
            while stays.hear("ATTITUDE", 0.1) is not None and next(on_their_way, None) is not None:
                pass
            assert stays.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 33) == 0
            assert stays.hear("ATTITUDE", 0.3) is None
            named.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while named.recvfrom(2048):
                    pass
            named.settimeout(2.0)
            assert named.recvfrom(2048)
    assert told == [
        f"16 have spoken to the simulated vehicle: {gone}, silent for longest, is forgotten, and others will be"
    ]


@contextlib.contextmanager
def clients(port, count):
    """Have clients that have spoken once; gone for good afterwards."""
    with contextlib.ExitStack() as all_of_them:
        yield [all_of_them.enter_context(Client(port)) for _ in range(count)]


def place_of(client):
    """Return where the vehicle sees a client."""
    return f"127.0.0.1:{client.link.port.getsockname()[1]}"


@pytest.mark.parametrize(
    "address, problem",
    [
        ("nonsense", "is no connection URL"),
        ("tcp:127.0.0.1:5760", "must be udpin:HOST:PORT or udpout:HOST:PORT"),
        ("udpin:192.0.2.1:14540", "Cannot assign requested address"),
    ],
)
def test_an_address_that_cannot_be_served_is_one_error(address, problem):
    owner = Quick()
    with pytest.raises(VehicleAddressError, match=problem):
        VehicleServer(owner.px4, (f"udpin:127.0.0.1:{free_port()}", address), owner)
