"""A simulated vehicle on a socket, its time running faster than the clock; and a client."""

from __future__ import annotations

import contextlib
import socket
import threading
import time

from px4_tools import QUICK, STEP, S
from pymavlink import mavutil

from amaze_autonomy.simulation.px4 import Craft, Px4, Px4Settings
from amaze_autonomy.simulation.px4_udp import VehicleServer
from amaze_autonomy.simulation.vehicle.vehicle import Power, PowerSettings


class Quick:
    """The owner of a vehicle whose time runs some times as fast as the clock."""

    def __init__(self, speed=1.0, **settings):
        self.craft = Craft(QUICK)
        self.power = Power(PowerSettings())
        self.px4 = Px4(self.craft, self.power, 0, Px4Settings(**settings))
        self._speed, self._begin_ns, self._t_ns = speed, time.monotonic_ns(), 0
        self.lock = threading.Lock()

    def exchange(self, act):
        with self.lock:
            end_ns = round((time.monotonic_ns() - self._begin_ns) * self._speed)
            out = []
            while self._t_ns < end_ns:
                self._t_ns = min(end_ns, self._t_ns + STEP)
                self.craft.advance(self._t_ns)
            out += act(self._t_ns)
            return out


@contextlib.contextmanager
def served(speed=1.0, addresses=("udpin:127.0.0.1:0",), mute=lambda _: False, complain=print, **settings):
    """Serve a vehicle; yields it and the port of its first address."""
    owner = Quick(speed, **settings)
    server = VehicleServer(owner.px4, _free(addresses), owner, mute=mute, complain=complain)
    server.start()
    try:
        yield owner, server.ports[0]
    finally:
        server.stop()


def _free(addresses):
    return tuple(
        address.replace(":0", f":{free_port()}") if address.endswith(":0") else address for address in addresses
    )


def free_port():
    with contextlib.closing(socket.socket(type=socket.SOCK_DGRAM)) as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Client:
    """A pymavlink client that says that it is there."""

    def __init__(self, port, component=191, kind=6):
        self.link = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=245, source_component=component, dialect="common"
        )
        self._kind = kind
        self.beat()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.link.close()

    def beat(self):
        self.link.mav.heartbeat_send(self._kind, 8, 0, 0, 4)

    def hear(self, kind, limit_s=5.0):
        """Return the next message of a kind; None when it does not come."""
        return self.link.recv_match(type=kind, blocking=True, timeout=limit_s)

    def command(self, number, *params):
        """Return what a command is answered; sent again like any MAVLink command, for a full buffer drops answers."""
        for confirmation in range(5):
            self.link.mav.command_long_send(1, 1, number, confirmation, *params, *[0.0] * (7 - len(params)))
            answer = self.hear("COMMAND_ACK", 2.0)
            if answer is not None:
                return answer.result
        raise AssertionError(f"nobody answers the command {number}")

    def until(self, condition, limit_s=15.0):
        """Wait until a message makes a condition true, with a heartbeat each second."""
        deadline, beat_s = time.monotonic() + limit_s, 0.0
        while time.monotonic() < deadline:
            if time.monotonic() - beat_s > 1.0:
                beat_s = time.monotonic()
                self.beat()
            message = self.link.recv_match(blocking=True, timeout=0.2)
            if message is not None and condition(message):
                return message
        raise AssertionError(f"not within {limit_s} s")


__all__ = ["Client", "Quick", "S", "free_port", "served"]
