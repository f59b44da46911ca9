"""What the tests of the simulated PX4 share: one in virtual time with somebody who talks to it, and real recordings."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.missions import FlightModel
from amaze_autonomy.simulation.px4 import Craft, Framing, Px4, Px4Settings
from amaze_autonomy.simulation.vehicle.flight import VehicleSettings
from amaze_autonomy.simulation.vehicle.vehicle import Power, PowerSettings

S = 1_000_000_000
DATA = Path(os.environ.get("AMAZE_DATA", Path(__file__).resolve().parents[4] / "shared" / "data"))
NAN = float("nan")
STEP = S // 50
# The vehicle of the recordings, as its LOCAL_POSITION_NED shows it to fly.
RECORDED = VehicleSettings(
    takeoff_height_m=2.5,
    model=FlightModel(
        cruise_speed_m_s=3.6, climb_speed_m_s=1.2, landing_speed_m_s=0.5, acceleration_m_s2=2.0, turn_rate_rad_s=2.0
    ),
    spin_up_ns=17 * S // 10,
)
QUICK = VehicleSettings(
    takeoff_height_m=2.0,
    model=FlightModel(cruise_speed_m_s=3.0, climb_speed_m_s=2.0, landing_speed_m_s=1.0, acceleration_m_s2=4.0),
    spin_up_ns=S // 2,
)
GCS, ONBOARD = mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_ONBOARD_CONTROLLER
LOITER, MISSION, LAND, TAKEOFF, RTL = ((4, sub) for sub in (3, 4, 6, 2, 5))
OFFBOARD, POSCTL = (6, 0), (3, 0)
NAMES = {
    LOITER: "LOITER",
    MISSION: "MISSION",
    LAND: "LAND",
    TAKEOFF: "TAKEOFF",
    RTL: "RTL",
    OFFBOARD: "OFFBOARD",
    POSCTL: "POSCTL",
}


def mode_of(heartbeat):
    """Return the name of the mode of a HEARTBEAT."""
    numbers = (heartbeat.custom_mode >> 16 & 0xFF, heartbeat.custom_mode >> 24)
    return NAMES.get(numbers, str(numbers))


class Bench:
    """A simulated PX4 in virtual time, and a client on one link that keeps all it hears."""

    def __init__(self, vehicle=QUICK, endurance_s=100_000.0, kind=GCS, autopilot=(Craft, Px4), **settings):
        make_craft, make_autopilot = autopilot
        self.craft = make_craft(vehicle)
        self.power = Power(PowerSettings(flight_endurance_s=endurance_s, idle_endurance_s=1e9, cells=4))
        self.health = dict.fromkeys(("gps", "imu", "magnetometer", "barometer"), True)
        self.px4 = make_autopilot(self.craft, self.power, 0, Px4Settings(**settings), sensors=lambda: self.health)
        self.px4.connect("client")
        self.t_ns, self.heard, self.kind = 0, [], kind
        self._client = Framing(245, 191)
        self._beat_ns = 0

    def advance(self, seconds, step=STEP):
        """Let time pass in small steps."""
        end_ns = self.t_ns + round(seconds * S)
        while self.t_ns < end_ns:
            self.step(min(end_ns, self.t_ns + step))
        return self

    def step(self, t_ns):
        """Go on to a time, with a heartbeat of the client each second."""
        self.power.advance(t_ns - self.t_ns, flying=self.craft.armed)
        self.craft.advance(t_ns)
        self.t_ns = t_ns
        if self.kind is not None and t_ns >= self._beat_ns:
            self._beat_ns = t_ns + S
            self.tell(mavlink.MAVLink_heartbeat_message(self.kind, 8, 0, 0, 4, 3))
        self.heard.extend((t_ns, name, message) for name, message in self.px4.advance(t_ns))

    def until(self, condition, limit_s=120.0):
        """Let time pass until something is true."""
        end_ns = self.t_ns + round(limit_s * S)
        while not condition():
            assert self.t_ns < end_ns, f"not within {limit_s} s: {self.lately()}"
            self.step(self.t_ns + STEP)
        return self

    def tell(self, message, link="client"):
        """Send a message, over the wire."""
        frame = self._client.encode(message)
        for decoded in Framing(1, 1).decode(frame):
            self.px4.receive(self.t_ns, link, decoded)

    def command(self, number, *params):
        """Send a command and return the results of its acknowledgements."""
        params = [*params, *[0.0] * (7 - len(params))]
        before = len(self.heard)
        self.tell(mavlink.MAVLink_command_long_message(1, 1, number, 0, *params))
        self.step(self.t_ns + STEP)
        return [m.result for _, _, m in self.heard[before:] if m.get_type() == "COMMAND_ACK" and m.command == number]

    def mode(self, numbers):
        """Command a mode."""
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *numbers)

    def arm(self):
        """Command the motors on."""
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def take_off(self, up_m=2.0):
        """Take off and wait until it is up there."""
        assert self.arm() == [0]
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 489.4 + up_m) == [0]
        return self.until(lambda: self.craft.mode == "AUTO.LOITER")

    def of(self, *kinds):
        """Return the messages of some kinds, in order."""
        return [message for _, _, message in self.heard if message.get_type() in kinds]

    def last(self, kind):
        """Return the last message of a kind."""
        return self.of(kind)[-1]

    def texts(self):
        """Return the texts that were told."""
        return [message.text for message in self.of("STATUSTEXT")]

    def lately(self):
        return [str(message) for _, _, message in self.heard[-5:]]

    def place(self, east_m, north_m):
        """Return latitude and longitude as in MAVLink."""
        place = self.craft.geography.place(east_m, north_m, 0.0)
        return place.lat, place.lon

    def items(self, *rows, first=True, land=True):
        """Make MISSION_ITEM_INTs: a takeoff, waypoints (east, north, up, hold) and a landing.

        Args:
            first: mark the first one as the current one.
            land: end with a landing.
        """
        x, y = self.place(0.0, 0.0)
        items = [(22, (0, 0, 0, NAN), x, y, rows[0][2])]
        items += [(16, (hold, 0, 0, NAN), *self.place(e, n), up) for e, n, up, hold in rows]
        items += [(21, (0, 0, 0, NAN), *self.place(*rows[-1][:2]), 0.0)] if land else []
        return [
            mavlink.MAVLink_mission_item_int_message(
                1, 1, seq, 6, command, int(first and seq == 0), 1, *params, lat, lon, up, 0
            )
            for seq, (command, params, lat, lon, up) in enumerate(items)
        ]

    def upload(self, items):
        """Upload a mission as the vehicle asks for it; return the result."""
        before = len(self.heard)
        self.tell(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
        answered = before
        while True:
            self.step(self.t_ns + STEP)
            for _, _, message in self.heard[answered:]:
                if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                    self.tell(items[message.seq])
                if message.get_type() == "MISSION_ACK":
                    return message.type
            answered = len(self.heard)


def set_point(bench, north=0.0, east=0.0, down=-2.0):
    """Send a set-point of a position."""
    bench.tell(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0b110111111000, north, east, down, 0, 0, 0, 0, 0, 0, 0, 0
        )
    )


_SHOWN = {
    "HEARTBEAT": lambda m: (("mode", mode_of(m)), ("armed", bool(m.base_mode & 128)), ("status", m.system_status)),
    "EXTENDED_SYS_STATE": lambda m: (("landed", m.landed_state),),
    "MISSION_ITEM_REACHED": lambda m: (("reached", m.seq),),
    "GPS_RAW_INT": lambda m: (("fix", m.fix_type),),
    "BATTERY_STATUS": lambda m: (("charge", m.charge_state),),
}


def changes(messages):
    """Return (time in s, what) of what changed: mode, armed, system status, landed state, item reached, fix, charge.

    Args:
        messages: (time in s, message) of the vehicle.
    """
    seen, out = {}, []
    for t_s, message in messages:
        for name, value in _SHOWN.get(message.get_type(), lambda _: ())(message):
            if seen.get(name) != value and (name in seen or name == "reached"):
                out.append((t_s, f"{name} {value}"))
            seen[name] = value
    return out


def rates(messages, begin_s, end_s):
    """Return message -> Hz between two times."""
    counts = Counter(message.get_type() for t_s, message in messages if begin_s <= t_s < end_s)
    return {kind: count / (end_s - begin_s) for kind, count in counts.items()}


def recording(name):
    """Return what the vehicle sent and what it was sent: lists of (time in s, message)."""
    path = DATA / f"{name}.tlog"
    if not path.is_file():
        pytest.skip(f"the recording {path.name} is not in {DATA}: set AMAZE_DATA to the folder of recordings")
    log = mavutil.mavlink_connection(str(path), dialect="common")
    vehicle, client, begin = [], [], None
    while True:
        message = log.recv_match()
        if message is None:
            log.close()
            return vehicle, client
        begin = message._timestamp if begin is None else begin
        row = (message._timestamp - begin, message)
        if message.get_srcSystem() == 245:
            client.append(row)
        elif message.get_srcSystem() == 1:
            vehicle.append(row)


def replayed(name, endurance_s=100_000.0):
    """Send the messages of a recording's client to a simulated PX4; return what that and the recorded one sent."""
    vehicle, client = recording(name)
    bench = Bench(RECORDED, endurance_s, kind=None, transmitter=False)
    end_s, next_one = vehicle[-1][0], 0
    while bench.t_ns < end_s * S:
        while next_one < len(client) and client[next_one][0] * S <= bench.t_ns + STEP // 2:
            bench.px4.receive(bench.t_ns, "client", client[next_one][1])
            next_one += 1
        bench.step(bench.t_ns + STEP // 2)
    return vehicle, [(t_ns / S, message) for t_ns, _, message in bench.heard]
