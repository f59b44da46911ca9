from __future__ import annotations

import os
import pty
import socket
import time
import tty
from queue import Empty, SimpleQueue

import pytest
from autopilot_tools import Recorder, UdpVehicle, beat, free_port, wait_until
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot import Connection, Identity
from amaze_autonomy.autopilot.link.wire import Wire

pytestmark = pytest.mark.live

KEY = bytes(range(32))
PING = mavlink.MAVLink_ping_message(1, 2, 0, 0)


@pytest.fixture
def link():
    """Return a function that opens a link to a URL; all are closed at the end."""
    opened = []

    def make(url, client=None, identity=None, **options):
        connection = Connection(url, identity or Identity(1, 191), client or Recorder(), **options)
        connection.start()
        opened.append(connection)
        return connection

    yield make
    for connection in opened:
        connection.close()


@pytest.fixture
def vehicle():
    made = UdpVehicle()
    yield made
    made.close()


def test_a_change_of_what_is_observed_is_noticed_once_whoever_changes_it(link, vehicle):
    client, vehicle.to, changes = Recorder(), free_port(), SimpleQueue()
    connection, said = link(f"udpin:127.0.0.1:{vehicle.to}", client), []
    connection.observe(lambda _t_ns: (len(client.heard), tuple(said)), lambda: changes.put(time.monotonic()))
    changes.get(timeout=5.0)  # what it is at first
    wait_until(lambda: connection.state.opened)
    vehicle.say(beat())
    changes.get(timeout=5.0)
    connection.ask(lambda _t_ns: (said.append("by a question"), ()))
    assert changes.qsize() == 1, "a question is looked at before it returns"
    changes.get(timeout=5.0)
    with pytest.raises(Empty):
        changes.get(timeout=0.2)  # nothing changes: the link's own thread looks 20 times a second


def test_a_defect_in_what_is_observed_costs_nothing_else(link, vehicle):
    told, client, vehicle.to = [], Recorder(), free_port()
    connection = link(f"udpin:127.0.0.1:{vehicle.to}", client, complain=told.append)
    connection.observe(lambda _t_ns: 1 // 0, lambda: None)
    wait_until(lambda: connection.state.opened)
    vehicle.say(beat())
    assert connection.wait_for(lambda: client.heard, 5.0)
    assert connection.ask(lambda _t_ns: (7, ())) == 7
    assert any("ZeroDivisionError" in each for each in told)


def test_a_defect_of_the_link_itself_is_said_once_and_the_link_opens_again(link, vehicle):
    told, client, vehicle.to = [], Recorder(), free_port()
    connection = link(f"udpin:127.0.0.1:{vehicle.to}", client, complain=told.append)
    wait_until(lambda: connection.state.opened)
    port, problems, left = connection._port, [], [-1, -1]
    number = port.fileno
    port.fileno = lambda: left.pop() if left else number()
    wait_until(lambda: problems.append(connection.state.problem) or not left)
    wait_until(lambda: connection.state.opened)
    vehicle.say(beat())
    assert connection.wait_for(lambda: client.heard, 5.0)
    assert (len(told), connection.state.errors) == (1, 2)
    assert "ValueError" in told[0]


def test_while_the_link_waits_nobody_has_closed_what_it_waits_for(link, vehicle):
    """What fails on another thread closes the port: its number is taken under the same lock."""
    vehicle.to = free_port()
    connection = link(f"udpin:127.0.0.1:{vehicle.to}")
    wait_until(lambda: connection.state.opened)
    number, locked = connection._port.fileno, []
    connection._port.fileno = lambda: locked.append(connection._changed._is_owned()) or number()
    wait_until(lambda: len(locked) > 3)
    assert all(locked)


def test_a_link_that_waits_answers_where_the_vehicle_speaks_from(link, vehicle):
    client, vehicle.to = Recorder(), free_port()
    connection = link(f"udpin:127.0.0.1:{vehicle.to}", client)
    assert (connection.state.vehicle, connection.state.heartbeat_ns) == (1, None)
    wait_until(lambda: connection.state.opened)
    vehicle.say(beat())
    wait_until(lambda: connection.state.heartbeat_ns)
    assert client.names() == ["HEARTBEAT"]
    own = wait_until(vehicle.listen)[0]
    assert (own.get_srcSystem(), own.get_srcComponent()) == (1, 191)
    assert (own.type, own.autopilot) == (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)


def test_a_link_that_speaks_first_beats_without_being_asked(link, vehicle):
    link(f"udpout:127.0.0.1:{vehicle.port}")
    wait_until(lambda: len(vehicle.listen()) >= 2)
    assert {message.get_type() for message in vehicle.heard} == {"HEARTBEAT"}


def test_the_client_s_answers_are_sent(link, vehicle):
    client, vehicle.to = Recorder(), free_port()
    client.answers = [PING]
    connection = link(f"udpin:127.0.0.1:{vehicle.to}", client)
    wait_until(lambda: connection.state.opened)
    vehicle.say(beat())
    wait_until(lambda: "PING" in [message.get_type() for message in vehicle.listen()])


def test_another_thread_asks_under_the_lock_and_waits(link, vehicle):
    client, vehicle.to = Recorder(), free_port()
    connection = link(f"udpin:127.0.0.1:{vehicle.to}", client)
    wait_until(lambda: connection.state.opened)
    vehicle.say(beat())
    assert connection.wait_for(lambda: client.heard, 5.0)
    assert connection.ask(lambda t_ns: (t_ns > 0, [PING])) is True
    wait_until(lambda: "PING" in [message.get_type() for message in vehicle.listen()])
    assert connection.wait_for(lambda: len(client.heard) > 99, 0.05) is False


def test_other_vehicles_ground_stations_and_gimbals_are_kept_apart(link):
    client, port = Recorder(), free_port()
    connection = link(f"udpin:127.0.0.1:{port}", client)
    wait_until(lambda: connection.state.opened)
    far = {address: UdpVehicle(port, *address) for address in ((2, 1), (255, 190), (1, 154), (1, 191), (1, 1))}
    far[2, 1].say(beat(), PING)
    far[255, 190].say(beat(kind=mavlink.MAV_TYPE_GCS, autopilot=mavlink.MAV_AUTOPILOT_INVALID))
    far[1, 154].say(beat(kind=mavlink.MAV_TYPE_GIMBAL, autopilot=mavlink.MAV_AUTOPILOT_INVALID))
    far[1, 191].say(PING)
    far[1, 1].say(
        mavlink.MAVLink_mission_ack_message(255, 190, 0),
        mavlink.MAVLink_mission_ack_message(1, 192, 0),
        mavlink.MAVLink_mission_ack_message(1, 191, 1),
        mavlink.MAVLink_mission_ack_message(0, 0, 2),
    )
    wait_until(lambda: len(client.heard) >= 2)
    assert [(message.get_type(), message.type) for message in client.heard] == [("MISSION_ACK", 1), ("MISSION_ACK", 2)]
    assert (connection.state.others, connection.state.doubles) == ((2,), 1)
    assert connection.state.heartbeat_ns is None
    for each in far.values():
        each.close()


def test_without_a_known_id_the_first_vehicle_is_ours(link):
    client, port = Recorder(), free_port()
    connection = link(f"udpin:127.0.0.1:{port}", client, Identity(1, 191, vehicle=0))
    wait_until(lambda: connection.state.opened)
    second, third = UdpVehicle(port, 2), UdpVehicle(port, 3)
    second.say(PING, beat())
    wait_until(lambda: connection.state.vehicle == 2)
    third.say(beat(), PING)
    wait_until(lambda: connection.state.others == (3,))
    assert connection.address == (2, 1)
    assert [message.get_srcSystem() for message in client.heard] == [2]
    wait_until(second.listen)
    assert third.listen() == [] or len(third.heard) <= 1  # one beat to all, before it was known who is the vehicle
    second.close()
    third.close()


def test_a_signed_link_believes_and_sends_signed_only(link):
    client, port = Recorder(), free_port()
    connection = link(f"udpin:127.0.0.1:{port}", client, key=KEY)
    wait_until(lambda: connection.state.opened)
    forger, vehicle = UdpVehicle(port), UdpVehicle(port, key=KEY)
    forger.say(beat())
    wait_until(lambda: connection.state.refused == 1)
    assert connection.state.heartbeat_ns is None
    vehicle.say(beat())
    wait_until(lambda: connection.state.heartbeat_ns)
    wait_until(vehicle.listen)
    assert all(message._signed for message in vehicle.heard)
    forger.close()
    vehicle.close()


def test_a_port_in_use_is_said_and_tried_again(link):
    holder = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    holder.bind(("127.0.0.1", 0))
    connection = link(f"udpin:127.0.0.1:{holder.getsockname()[1]}")
    wait_until(lambda: connection.state.problem == "Address already in use")
    holder.close()
    wait_until(lambda: connection.state.opened)


def test_a_tcp_link_comes_back_by_itself(link):
    client = Recorder()
    with socket.create_server(("127.0.0.1", 0)) as server:
        connection = link(f"tcp:127.0.0.1:{server.getsockname()[1]}", client)
        for _ in range(2):
            far, _ = server.accept()
            far.sendall(Wire(1, 1).send(beat())[:9])
            far.sendall(Wire(1, 1).send(beat()) * 2)
            wait_until(lambda: client.heard)
            client.heard.clear()
            far.close()
    wait_until(lambda: connection.state.problem == "Connection refused")


def test_a_tcp_link_that_waits_hears_its_peer(link):
    client, port = Recorder(), free_port(socket.SOCK_STREAM)
    connection = link(f"tcpin:127.0.0.1:{port}", client)
    wait_until(lambda: connection.state.opened)
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as far:
        far.sendall(Wire(1, 1).send(beat()))
        wait_until(lambda: client.heard)
        assert Wire(1, 1).receive(far.recv(4096))[0].get_type() == "HEARTBEAT"


def test_a_serial_device_is_read_written_unplugged_and_plugged_in_again(link, tmp_path):
    device, client = tmp_path / "ttyACM0", Recorder()
    connection = link(f"serial:{device}:57600", client)
    wait_until(lambda: connection.state.problem == "No such file or directory")
    for _ in range(2):
        master, slave = pty.openpty()
        tty.setraw(slave)
        device.unlink() if device.is_symlink() else None
        device.symlink_to(os.ttyname(slave))
        wait_until(lambda: connection.state.opened)
        client.heard.clear()
        os.write(master, Wire(1, 1).send(beat()))
        wait_until(lambda: client.heard)
        assert Wire(1, 1).receive(os.read(master, 4096))[0].get_type() == "HEARTBEAT"
        os.close(slave)
        os.close(master)
        wait_until(lambda: not connection.state.opened)


def test_an_exception_of_the_client_costs_neither_thread_nor_heartbeat(link, vehicle):
    said = []

    class Broken(Recorder):
        def receive(self, t_ns, message):
            super().receive(t_ns, message)
            raise ValueError("no")

    client, vehicle.to = Broken(), free_port()
    connection = link(f"udpin:127.0.0.1:{vehicle.to}", client, complain=said.append)
    wait_until(lambda: connection.state.opened)
    vehicle.say(beat(), beat())
    wait_until(lambda: connection.state.errors == 2)
    assert said == ["ValueError: no"]
    wait_until(lambda: len(vehicle.listen()) >= 2)


def test_a_closed_link_is_closed_and_sends_nothing(link, vehicle):
    connection = link(f"udpout:127.0.0.1:{vehicle.port}")
    wait_until(lambda: connection.state.opened)
    connection.send(PING)
    connection.close()
    assert connection.state.problem == "closed"
    wait_until(lambda: "PING" in [message.get_type() for message in vehicle.listen()])
    connection.send(PING)
    assert connection.state.unsent == 1
