"""A serial device or a TCP connection that takes nothing for a while: no command comes out of it late."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import pty
import select
import socket
import struct
import termios
import time
import tty

import pytest
from autopilot_tools import Recorder, beat, wait_until
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot import Connection, Identity
from amaze_autonomy.autopilot.link import ports
from amaze_autonomy.autopilot.link.dialect import changes_flight
from amaze_autonomy.autopilot.link.ports import make_port
from amaze_autonomy.autopilot.link.wire import Wire
from amaze_autonomy.config.kinds import parse_endpoint

MS = 1_000_000
LATE_S = 0.5
TOLD_S = 0.2  # until this computer has looked, and read
FILLER = mavlink.MAVLink_play_tune_message(1, 1, b"a" * 30, b"b" * 200)
SET_POINT = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, *(0,) * 12)


def land(number):
    return mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 4, 6, 0, 0, 0, number)


@pytest.mark.parametrize(
    "message, changes",
    [
        (land(0), True),
        (mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_MISSION_START, *(0,) * 8), True),
        (mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, *(0,) * 8), False),
        (mavlink.MAVLink_mission_set_current_message(1, 1, 3), True),
        (SET_POINT, False),
        (beat(), False),
    ],
)
def test_what_changes_what_the_vehicle_does_must_not_come_late(message, changes):
    assert changes_flight(message) is changes


# --- a serial device --------------------------------------------------------------------------------------------------


class Device:
    """A serial device in virtual time, with what its driver keeps: as many bytes leave as its rate lets."""

    def __init__(self, monkeypatch, rate, *, tells=True, discards=True):
        self.t_ns, self.rate, self.held, self.part, self.discarded = 0, rate, 0, 0.0, 0
        master, slave = pty.openpty()
        tty.setraw(slave)
        self.port = make_port(parse_endpoint(f"serial:{os.ttyname(slave)}:57600"))
        self.port.open()
        fd, real = self.port.fileno(), fcntl.ioctl

        def ask(asked, request, *rest):
            told = asked == fd and request == termios.TIOCOUTQ
            return struct.pack("@i", self.held if tells else 0) if told else real(asked, request, *rest)

        def discard(_, queue):
            assert queue == termios.TCOFLUSH
            self.discarded += 1
            self.held = 0 if discards else self.held

        monkeypatch.setattr(ports.os, "write", self._take)
        monkeypatch.setattr(ports.fcntl, "ioctl", ask)
        monkeypatch.setattr(ports.termios, "tcflush", discard)
        monkeypatch.setattr(ports.time, "monotonic_ns", lambda: self.t_ns)
        self._fds = (master, slave)

    def _take(self, _, data):
        taken = min(len(data), 4096 - self.held)
        if not taken:
            raise BlockingIOError
        self.held += taken
        return taken

    def pass_time(self, seconds):
        for _ in range(round(seconds * 100)):
            self.t_ns += 10 * MS
            self.part = min(self.held, self.part + self.rate / 100)
            self.held, self.part = self.held - int(self.part), self.part % 1

    def close(self):
        self.port.close()
        for fd in self._fds:
            os.close(fd)


@pytest.fixture
def device(monkeypatch):
    made = []

    def make(*arguments, **options):
        made.append(Device(monkeypatch, *arguments, **options))
        return made[-1]

    yield make
    monkeypatch.undo()
    for each in made:
        each.close()


@pytest.mark.parametrize("tells", [True, False], ids=["driver tells", "driver tells nothing"])
def test_a_slow_device_that_is_hardly_ever_empty_loses_nothing(device, tells):
    """57600 baud, a list of parameters: bursts of nearly half a second, one after the other, and set-points."""
    radio = device(5760, tells=tells)
    for tick in range(400):
        assert radio.port.write(b"p" * (2200 if tick % 10 == 0 else 20)) is True
        radio.pass_time(0.05)
        radio.port.flush()
    assert not radio.discarded


@pytest.mark.parametrize("size", [41, 4096], ids=["its driver has room", "its driver is full"])
def test_what_a_device_does_not_take_is_discarded_after_half_a_second_and_what_comes_then_is_sent(device, size):
    stuck = device(0)
    for _ in range(10):
        assert stuck.port.write(b"l" * size) is True
        stuck.pass_time(0.05)
    stuck.port.flush()
    assert (stuck.held, stuck.discarded) == (min(10 * size, 4096), 0)
    stuck.pass_time(0.01)
    stuck.port.flush()
    assert (stuck.held, stuck.port.blocked, stuck.discarded) == (0, False, 1)
    stuck.rate = 5760
    assert stuck.port.write(b"new") is True
    assert stuck.held == len(b"new")


def test_who_stood_still_while_bytes_waited_does_not_send_them_later(device):
    stuck = device(0)
    for _ in range(2):
        stuck.port.write(b"l" * 4096)
    stuck.pass_time(3.0)
    stuck.rate = 5760
    assert stuck.port.write(b"new") is True
    assert stuck.held == len(b"new")


def test_a_device_that_is_slower_than_what_is_said_sends_nothing_that_is_old(device):
    """9600 baud for 28 bytes 100 times a second: what is said is three times too much."""
    slow = device(960)
    for _ in range(2000):
        slow.port.write(b"s" * 28)
        slow.pass_time(0.01)
        slow.port.flush()
        assert slow.held + len(slow.port._pending) <= 28 * 51
    assert slow.discarded > 10


def test_a_driver_that_cannot_discard_keeps_what_it_has_and_costs_nothing_else(device):
    stuck = device(0, discards=False)
    for _ in range(200):
        assert stuck.port.write(b"l" * 41) is True
        stuck.pass_time(0.05)
    assert len(stuck.port._pending) < 11 * 41
    stuck.rate = 5760
    stuck.pass_time(1.0)
    assert stuck.port.write(b"new") is True
    assert stuck.held == len(b"new")


# --- the connection ---------------------------------------------------------------------------------------------------


@pytest.fixture
def link():
    opened = []

    def make(url):
        opened.append(Connection(url, Identity(1, 191), Recorder()))
        opened[-1].start()
        return opened[-1]

    yield make
    for connection in opened:
        connection.close()


@pytest.mark.live
def test_no_landing_that_is_old_comes_out_of_a_serial_device_that_stalled_and_it_stays_open(link):
    master, slave = pty.openpty()
    tty.setraw(slave)
    connection, said_s, problems = link(f"serial:{os.ttyname(slave)}:57600"), [], set()
    wait_until(lambda: connection.state.opened)

    def say():
        """Fill all there is, and land, ten times a second."""
        while not said_s or time.monotonic() - said_s[-1] > 0.1:
            for _ in range(64):
                connection.send(FILLER)
            said_s.append(time.monotonic())
            connection.send(land(len(said_s) - 1))
        problems.add(connection.state.problem)
        return said_s[-1] - said_s[0] > 2.0

    wait_until(say)
    wire, ages_s = Wire(255, 1), []
    connection.send(land(len(said_s)))
    said_s.append(time.monotonic())

    def read():
        if select.select([master], [], [], 0.01)[0]:
            lands = [each for each in wire.receive(os.read(master, 65536)) if each.get_type() == "COMMAND_LONG"]
            ages_s.extend(time.monotonic() - said_s[round(each.param7)] for each in lands)
        if len(said_s) < 40 and time.monotonic() - said_s[-1] > 0.1:
            said_s.append(time.monotonic())
            connection.send(land(len(said_s) - 1))
        return len(said_s) == 40 and ages_s

    wait_until(read)
    assert max(ages_s) < LATE_S + TOLD_S
    assert problems == {""}
    os.close(slave)
    os.close(master)


_DROPS_ALL = ctypes.create_string_buffer(struct.pack("@HBBI", 0x06, 0, 0, 0))  # BPF_RET: keep 0 bytes
_PROGRAM = struct.pack("@HP", 1, ctypes.addressof(_DROPS_ALL))
_ATTACH, _DETACH = 26, 27  # SO_ATTACH_FILTER, SO_DETACH_FILTER of Linux, for which Python has no name


def lose(fd, *, all_of_it):
    """Have the system lose, or no longer lose, whatever comes to a socket, as a network does that is away."""
    same = socket.socket(fileno=os.dup(fd))
    with same, contextlib.suppress(OSError):
        same.setsockopt(socket.SOL_SOCKET, *((_ATTACH, _PROGRAM) if all_of_it else (_DETACH, 0)))


class TcpVehicle:
    """A vehicle behind a TCP server, in no thread: whoever waits for something calls `step`."""

    def __init__(self, *, one_at_a_time=False):
        self.server = socket.create_server(("127.0.0.1", 0), backlog=5)
        self.server.setblocking(False)
        self.one, self.wire, self.beat_s = one_at_a_time, Wire(1, 1), 0.0
        self.peers, self.accepted, self.heard = {}, 0, []

    def step(self):
        if not (self.one and self.peers):
            with contextlib.suppress(BlockingIOError):
                peer, _ = self.server.accept()
                peer.setblocking(False)
                self.peers[peer], self.accepted = Wire(255, 1), self.accepted + 1
                lose(peer.fileno(), all_of_it=False)  # what it has of the server
        due = time.monotonic() - self.beat_s > 0.05
        self.beat_s = time.monotonic() if due else self.beat_s
        for peer, wire in list(self.peers.items()):
            try:
                if due:
                    peer.send(self.wire.send(beat()))
                data = peer.recv(65536)
                self.heard += [(time.monotonic(), message) for message in wire.receive(data)]
                if data:
                    continue
            except BlockingIOError:
                continue
            except OSError:
                pass
            del self.peers[peer]
            peer.close()

    def stall(self, connection, *, stalled):
        ours = connection._port.fileno()
        for fd in [each.fileno() for each in (self.server, *self.peers)] + ([] if ours is None else [ours]):
            lose(fd, all_of_it=stalled)

    def close(self):
        for each in (self.server, *self.peers):
            each.close()


@pytest.fixture
def vehicle():
    made = []

    def make(**options):
        made.append(TcpVehicle(**options))
        return made[-1]

    yield make
    for each in made:
        each.close()


def heard_over(link, vehicle):
    """Return a connection over which a vehicle was heard."""
    connection = link(f"tcp:127.0.0.1:{vehicle.server.getsockname()[1]}")
    wait_until(lambda: (vehicle.step(), connection._client.heard)[1])
    return connection


class Story:
    """Set-points 20 times a second and perhaps a landing each 0.3 s, while the network is away for a while."""

    def __init__(self, connection, vehicle):
        self.connection, self.vehicle = connection, vehicle
        self.said_s, self.set_point_s = [], 0.0

    def run(self, stall_s, *, lands):
        self.vehicle.stall(self.connection, stalled=True)
        end_s = time.monotonic() + stall_s
        wait_until(lambda: self._goes_on(lands) > end_s)
        self.vehicle.stall(self.connection, stalled=False)
        heard = len(self.connection._client.heard)
        wait_until(lambda: self._goes_on(lands) and len(self.connection._client.heard) > heard + 10, 10.0)
        return time.monotonic() - end_s

    def _goes_on(self, lands):
        now_s = time.monotonic()
        self.vehicle.step()
        if now_s - self.set_point_s > 0.05:
            self.set_point_s = now_s
            self.connection.send(SET_POINT)
        if lands and (not self.said_s or now_s - self.said_s[-1] > 0.3):
            self.said_s.append(now_s)
            self.connection.send(land(len(self.said_s) - 1))
        return now_s

    def ages_s(self):
        lands = [(t_s, each) for t_s, each in self.vehicle.heard if each.get_type() == "COMMAND_LONG"]
        return [t_s - self.said_s[round(each.param7)] for t_s, each in lands]


@pytest.mark.live
@pytest.mark.parametrize("one_at_a_time", [False, True], ids=["takes many", "takes one at a time"])
@pytest.mark.parametrize("stall_s", [0.3, 1.0, 3.5])
def test_no_landing_that_is_old_comes_over_tcp_after_the_network_was_away(link, vehicle, stall_s, one_at_a_time):
    far = vehicle(one_at_a_time=one_at_a_time)
    connection = heard_over(link, far)
    story = Story(connection, far)
    story.run(stall_s, lands=True)
    wait_until(lambda: (story._goes_on(True), story.ages_s())[1])
    assert max(story.ages_s()) < LATE_S + TOLD_S
    assert far.accepted <= 2


@pytest.mark.live
@pytest.mark.parametrize("stall_s", [0.3, 1.0, 3.0])
def test_a_network_that_was_away_while_nothing_was_commanded_costs_no_connection(link, vehicle, stall_s):
    far = vehicle()
    connection = heard_over(link, far)
    Story(connection, far).run(stall_s, lands=False)
    assert (far.accepted, connection.state.opened) == (1, True)


def never_sent(fd):
    """Return how many bytes the system has not sent at all (SIOCOUTQNSD of Linux)."""
    return struct.unpack("@i", fcntl.ioctl(fd, 0x894B, bytes(4)))[0]


@pytest.mark.live
def test_what_a_tcp_peer_has_no_room_for_does_not_come_when_it_has(link, vehicle):
    far = vehicle()
    far.server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection = heard_over(link, far)
    fd = connection._port.fileno()
    wait_until(lambda: (connection.send(*[FILLER] * 8), never_sent(fd) > 2000)[1])
    connection.send(land(0))
    assert not connection._port.blocked, "the system has it"
    wait_until(lambda: select.select([far.server], [], [], 0)[0])  # another connection
    far.beat_s = float("inf")  # says nothing more, to which our system would answer that nobody is there
    wait_until(lambda: (far.step(), far.accepted == 2 and len(far.peers) == 1)[1])
    assert [each for _, each in far.heard if each.get_type() == "PLAY_TUNE"]
    assert not [each for _, each in far.heard if changes_flight(each)]


@pytest.mark.live
def test_over_a_connection_that_nobody_has_spoken_on_nothing_is_commanded(link):
    """A peer that takes one connection at a time reads another one only when it has noticed that it lost the first."""
    with socket.create_server(("127.0.0.1", 0), backlog=5) as server:
        connection = link(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        wait_until(lambda: connection.state.opened)
        connection.send(land(0), SET_POINT)
        assert connection.state.unsent == 1
        far, _ = server.accept()
        with far:
            far.sendall(Wire(1, 1).send(beat()))
            wait_until(lambda: connection._client.heard)
            connection.send(land(1))
            wire, lands = Wire(255, 1), []
            far.settimeout(5.0)
            while not lands:
                lands += [each.param7 for each in wire.receive(far.recv(65536)) if changes_flight(each)]
            assert lands == [1]


@pytest.mark.live
def test_a_link_that_is_dropped_or_closed_leaves_no_command_behind(link, vehicle):
    for end in (lambda each: each._drop("silent for 5 s"), Connection.close):
        far = vehicle()
        connection = heard_over(link, far)
        far.stall(connection, stalled=True)
        connection.send(land(0))
        with connection._changed:
            end(connection)
        connection.close()
        begin_s = time.monotonic()
        wait_until(lambda begin_s=begin_s: time.monotonic() - begin_s > 1.0)  # as long as the network is away
        for peer in far.peers:
            lose(peer.fileno(), all_of_it=False)
        wait_until(lambda far=far, begin_s=begin_s: (far.step(), time.monotonic() - begin_s > 2.5)[1])
        assert not [each for _, each in far.heard if changes_flight(each)]
