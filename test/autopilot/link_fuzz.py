"""Damaged and hostile MAVLink into the link, by a seed: no crash, no false state, bounded memory.

`Fuzz` feeds its pure part; `SocketFuzz` a `Connection` on UDP, from four sockets, with its thread and its buffers.

The vehicle of this fuzz stands on the ground, disarmed, and says so in every good frame. All else is noise, frames
that were damaged or cut, good frames of strangers, and good frames of our vehicle full of nonsense in messages
that say nothing of armed, landed and mode. Whatever comes: armed, landed and mode must stay what the vehicle said.
"""

from __future__ import annotations

import random
import socket
import struct
import tracemalloc
from math import isfinite

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot import Connection
from amaze_autonomy.autopilot.link.framing import LONGEST, crc16
from amaze_autonomy.autopilot.link.peers import Identity, Peers
from amaze_autonomy.autopilot.link.wire import Wire
from amaze_autonomy.autopilot.vehicle.client import CLIENT_MESSAGES, AutopilotClient
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.events import Landed, Verdict
from amaze_autonomy.monitoring.specs import BatterySpec

S = 1_000_000_000
STATE = ("HEARTBEAT", "EXTENDED_SYS_STATE", "CURRENT_MODE")
NUMBERS = sorted(mavlink.mavlink_map)
OURS = [number for number in NUMBERS if mavlink.mavlink_map[number].msgname in CLIENT_MESSAGES]
NONSENSE = [number for number in OURS if mavlink.mavlink_map[number].msgname not in STATE]
GOOD = (
    mavlink.MAVLink_heartbeat_message(2, 12, 81, 3 << 24 | 4 << 16, 3, 3),
    mavlink.MAVLink_extended_sys_state_message(0, 1),
)


def _without_boot_time(number, payload):
    """Return a payload whose time since the start is 0: not known."""
    kind = mavlink.mavlink_map[number]
    if "time_boot_ms" not in kind.ordered_fieldnames:
        return payload
    at = sum(struct.calcsize("<" + chr(code)) for code in _codes_before(kind, "time_boot_ms"))
    return payload[:at] + bytes(len(payload[at : at + 4])) + payload[at + 4 :]


def _codes_before(kind, field):
    codes = [code for code in kind.native_format if chr(code).isalpha()]
    return codes[: kind.ordered_fieldnames.index(field)]


class Pieces:
    """What is fed, and what is said of it.

    Args:
        seed: of all chance.
    """

    ours, nonsenses = OURS, NONSENSE  # numbers of messages that are listened to; those that say nothing of its state

    def __init__(self, seed):
        self.chance = random.Random(seed)
        self.client = AutopilotClient(AutopilotSettings(parameters={"A": 1.0}), BatterySpec(cells=4), lambda: (1, 1))
        self.vehicle = Wire(1, 1)
        self.fed = 0

    def frame(self, number, system=1, component=1):
        """Return a frame with a good checksum and any payload."""
        sequence = self.chance.randrange(256)
        if (system, component) == (1, 1):  # nonsense in good order: what is not is another vehicle, and not listened to
            sequence = self.vehicle._mav.seq
            self.vehicle._mav.seq = (sequence + 1) % 256
        size = min(255, self.chance.choice((0, 1, mavlink.mavlink_map[number].unpacker.size, 255)))
        payload = self.chance.choice((self._bytes, lambda n: b"\xff" * n, lambda n: b"\0" * n))(size)
        if self.chance.random() < 0.99:  # who says another boot time each time is another vehicle each time
            payload = _without_boot_time(number, payload)
        head = struct.pack("<BBBBBBBHB", 0xFD, size, 0, 0, sequence, system, component, number & 0xFFFF, number >> 16)
        crc = crc16(head[1:] + payload + bytes((mavlink.mavlink_map[number].crc_extra,)))
        return head + payload + struct.pack("<H", crc)

    def _bytes(self, count):
        return bytes(self.chance.randrange(256) for _ in range(count))

    def _in_order(self):
        """Return good frames in their order: what was heard before and comes again is another vehicle's."""
        return b"".join(self.vehicle.send(message) for message in GOOD)

    def noise(self):
        return self._bytes(self.chance.randrange(1, 600))

    def magics(self):
        return bytes(self.chance.choice((0xFD, 0xFE)) for _ in range(self.chance.randrange(1, 600)))

    def damaged(self):
        """A good frame of our vehicle with one bit turned: it must not be heard."""
        raw = bytearray(self._in_order())
        raw[self.chance.randrange(len(raw))] ^= 1 << self.chance.randrange(8)
        return bytes(raw)

    def cut(self):
        raw = self._in_order()
        return raw[: self.chance.randrange(len(raw))]

    def stranger(self):
        """Armed, in the air: but from another vehicle, another component, or a ground station."""
        system, component = self.chance.choice(((2, 1), (1, 2), (255, 190), (0, 0), (1, 191)))
        if self.chance.random() < 0.5:
            return self.frame(self.chance.choice(self.ours), system, component)
        wire = Wire(system, component)
        return wire.send(mavlink.MAVLink_heartbeat_message(2, 12, 209, 1 << 16, 5, 3)) + wire.send(
            mavlink.MAVLink_extended_sys_state_message(0, 2)
        )

    def nonsense(self):
        return self.frame(self.chance.choice(self.nonsenses))

    def unwanted(self):
        return self.frame(self.chance.choice([number for number in NUMBERS if number not in self.ours]))

    def good(self):
        return self._in_order()

    def piece(self):
        """Return the next bytes."""
        kinds = (self.noise, self.magics, self.damaged, self.cut, self.stranger, self.nonsense, self.unwanted)
        data = self.chance.choice(kinds)() if self.chance.random() < 0.8 else self.good()
        self.fed += len(data)
        return data

    def look(self, t_ns):
        """Assert that nothing false is said."""
        vehicle = self.client.vehicle
        status = vehicle.status(t_ns)
        assert status.armed in (None, False)
        assert status.landed.name in ("UNKNOWN", "ON_GROUND")
        assert status.mode in ("", "AUTO.LOITER")
        assert not status.pilot_in_control
        assert not status.failsafe
        for value in (status.height_m, status.position_x_m, status.vertical_speed_m_s, status.battery_voltage_v):
            assert value is None or isfinite(value)
        assert status.battery_fraction is None or 0.0 <= status.battery_fraction <= 1.0
        assert set(vehicle.health(t_ns)) == {"gps", "imu", "magnetometer", "barometer"}
        rows, _ = self.client.check(t_ns, Landed.ON_GROUND)
        assert all(isinstance(row.verdict, Verdict) for row in rows)
        assert all("\n" not in row.advice for row in rows)
        self.client.check_battery(t_ns, 0.5)


class Fuzz(Pieces):
    """The link without its socket."""

    def __init__(self, seed):
        super().__init__(seed)
        self.t_ns = S
        self.wire, self.peers = Wire(1, 191, CLIENT_MESSAGES), Peers(Identity(1, 191))
        self.heard = 0

    def step(self):
        """Feed one piece, look at all that is said."""
        data, source = self.piece(), self.chance.choice(("a", "b", self.chance.randrange(10_000)))
        self.t_ns += self.chance.randrange(20_000_000)
        sent = 0
        for frame, message in self.wire.each(data, source, self.t_ns):
            if message is None:
                self.peers.pass_over(self.t_ns, (frame.system, frame.component), frame.sequence, None)
            elif self.peers.take(self.t_ns, message):
                self.heard += 1
                sent += len([self.wire.send(each, self.t_ns) for each in self.client.receive(self.t_ns, message)])
        sent += len([self.wire.send(each, self.t_ns) for each in self.client.wake(self.t_ns)])
        assert sent <= 64
        self.look(self.t_ns)
        assert self.wire.kept <= 16 * LONGEST

    def close(self):
        """There is nothing to close."""


class SocketFuzz(Pieces):
    """A connection on UDP, fed from four sockets; each eighth piece is awaited, so that no buffer overflows."""

    def __init__(self, seed):
        super().__init__(seed)
        self.steps, self.complaints = 0, []
        self.sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(4)]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.place = probe.getsockname()
        url = f"udpin:127.0.0.1:{self.place[1]}"
        self.link = Connection(
            url, Identity(1, 191), self.client, wanted=CLIENT_MESSAGES, complain=self.complaints.append
        )
        self.link.start()
        assert self.link.wait_for(lambda: self.link.state.opened, 5.0)

    @property
    def heard(self):
        return self.link.state.frames

    def step(self):
        """Send one piece; now and then look at all that is said."""
        self.steps += 1
        self.chance.choice(self.sockets).sendto(self.piece(), self.place)
        if self.steps % 8:
            return
        before = self.link.state.heartbeat_ns
        for _ in range(1000):  # a half frame that came before may swallow the first
            self.sockets[0].sendto(self.good(), self.place)
            if self.link.wait_for(lambda: self.link.state.heartbeat_ns != before, 0.005):
                break
        else:
            raise AssertionError("the link hears nothing any more")
        self.link.ask(lambda t_ns: (self.look(t_ns), ()))
        assert (self.link.state.errors, self.complaints) == (0, [])

    def close(self):
        """Close everything."""
        self.link.close()
        for each in self.sockets:
            each.close()


def fuzz(seed, steps, kind=Fuzz):
    """Run so many steps; return the fuzz and how much memory was in use half way and at the end, in bytes."""
    run, used = kind(seed), []
    tracemalloc.start()
    try:
        for number in range(steps):
            run.step()
            if number in (steps // 2, steps - 1):
                used.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
        run.close()
    return run, used
