"""A far end of a link for tests: a socket that says what a test tells it to, and hears what comes back."""

from __future__ import annotations

import socket
import threading
import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot.link.wire import Wire

LIMIT_S = 5.0


def beat(mode=0, *, armed=False, kind=mavlink.MAV_TYPE_QUADROTOR, autopilot=mavlink.MAV_AUTOPILOT_PX4, status=4):
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, base, mode, status, 3)


def wait_until(condition, limit_s=LIMIT_S):
    """Wait for a condition; return its value, or fail."""
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        threading.Event().wait(0.005)
    raise AssertionError(f"did not come true within {limit_s} s")


class Recorder:
    """A client that keeps what it is given, and says what it is told to."""

    def __init__(self):
        self.heard, self.woken, self.answers = [], 0, []

    def receive(self, _, message):
        self.heard.append(message)
        answers, self.answers = self.answers, []
        return answers

    def wake(self, _, **_read):
        self.woken += 1
        return ()

    def names(self):
        return [message.get_type() for message in self.heard]


class UdpVehicle:
    """A vehicle on a UDP socket."""

    def __init__(self, to=None, system=1, component=1, key=None):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.02)
        self.port = self.socket.getsockname()[1]
        self.to = to
        self.wire = Wire(system, component, key=key)
        self.heard = []

    def say(self, *messages):
        for message in messages:
            self.raw(self.wire.send(message, time.time_ns()))

    def raw(self, data):
        self.socket.sendto(data, ("127.0.0.1", self.to))

    def listen(self):
        """Return all that has been heard so far."""
        try:
            while True:
                data, source = self.socket.recvfrom(65536)
                self.to = self.to or source[1]
                self.heard += self.wire.receive(data, source, time.time_ns())
        except (socket.timeout, ConnectionError):
            return self.heard

    def close(self):
        self.socket.close()


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
