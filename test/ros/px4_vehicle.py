"""The simulated PX4 in the process of a test, in real time: the test may be its pilot and its faults."""

from __future__ import annotations

import threading
import time
from random import Random
from typing import Any, Callable, Dict, List, Optional, Set, Tuple, Type

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.missions import FlightModel
from amaze_autonomy.ros.node_main import take_precedence
from amaze_autonomy.simulation.px4 import Craft, Px4, Px4Settings
from amaze_autonomy.simulation.px4.wire import base_mode, custom_mode
from amaze_autonomy.simulation.px4_udp import VehicleServer
from amaze_autonomy.simulation.vehicle.vehicle import Power, PowerSettings, VehicleSettings

QUICK = FlightModel(
    cruise_speed_m_s=5.0,
    climb_speed_m_s=4.0,
    descent_speed_m_s=4.0,
    landing_speed_m_s=2.0,
    acceleration_m_s2=10.0,
    turn_rate_rad_s=8.0,
)
MISSIONS = f"""\
flight:
  cruise_speed_m_s: {QUICK.cruise_speed_m_s}
  climb_speed_m_s: {QUICK.climb_speed_m_s}
  descent_speed_m_s: {QUICK.descent_speed_m_s}
  landing_speed_m_s: {QUICK.landing_speed_m_s}
  acceleration_m_s2: {QUICK.acceleration_m_s2}
  turn_rate_rad_s: {QUICK.turn_rate_rad_s}
missions:
  "hop":
    description: Up, around, down
    files: [trajectories/hop.csv]
  "indoors":
    description: The same without GPS
    files: [trajectories/hop.csv]
    controller: offboard
  "twice":
    description: Up, around, down, and once more
    files: [trajectories/hop.csv]
    repetitions: 2
"""


def forged(mode: str = "AUTO.MISSION", *, armed: bool = False) -> List[Any]:
    """What a vehicle on the ground says, which is disarmed; or one in the air, in somebody's hands by its mode."""
    system = mavlink.MAV_STATE_ACTIVE if armed else mavlink.MAV_STATE_STANDBY
    place = mavlink.MAV_LANDED_STATE_IN_AIR if armed else mavlink.MAV_LANDED_STATE_ON_GROUND
    flags = base_mode(mode, armed=armed)
    beat = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, flags, custom_mode(mode), system, 3
    )
    return [beat, mavlink.MAVLink_extended_sys_state_message(0, place)]


class Px4Vehicle:
    """A vehicle on UDP; each address is one endpoint.

    Args:
        addresses: e.g. udpout:127.0.0.1:14541.
        kind: classes of craft and autopilot.
        on: it speaks from the beginning; else once it is switched on.
        key: with which it signs; empty: it does not.

    Attributes:
        sensors: what the autopilot says of each: healthy.
        cut: nothing goes through its links, either way, to whoever has spoken.
        lost_fraction: of all messages on its links, either way, to whoever has spoken; drawn by a seed.
        unsaid: kinds of messages that do not come through, as by chance on a bad link.
        modes: that it was in while it was armed, in order.
        commands: that came to it, each with its first parameter, in order.
        refusal: why it does not arm from the moment when it is asked to; until then it seems ready.
        addresses: host and port of each endpoint.
    """

    def __init__(
        self,
        *addresses: str,
        kind: Tuple[Type[Craft], Type[Px4]] = (Craft, Px4),
        on: bool = True,
        key: bytes = b"",
    ) -> None:
        self.lock = threading.Lock()
        self.sensors: Dict[str, Optional[bool]] = dict.fromkeys(("gps", "imu", "magnetometer", "barometer"), True)
        self.cut, self.lost_fraction, self.modes = False, 0.0, [""]
        self.unsaid: Set[str] = set()
        self.commands: List[Tuple[int, float]] = []
        self.refusal = ""
        draw = Random(1)
        self._ends = [address.partition(":")[2] for address in addresses]
        self.addresses = [(host, int(port)) for host, _, port in (end.partition(":") for end in self._ends)]
        self._said: List[Tuple[str, Any]] = []
        make_craft, make_autopilot = kind
        self.craft = make_craft(VehicleSettings(model=QUICK), time.monotonic_ns())
        px4 = make_autopilot(
            self.craft,
            Power(PowerSettings()),
            time.monotonic_ns(),
            Px4Settings(signing_key=key),
            sensors=lambda: self.sensors,
            unix_ns=time.time_ns(),
        )
        receive = px4.receive

        def heard(t_ns: int, name: str, message: Any) -> None:
            if message.get_type() in ("COMMAND_LONG", "COMMAND_INT"):
                self.commands.append((message.command, message.param1))
                if self.refusal and message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                    self.craft.flags.not_ready["refusal"] = self.refusal
            receive(t_ns, name, message)

        vars(px4)["receive"] = heard
        lost = lambda _: self.cut or draw.random() < self.lost_fraction  # noqa: E731
        self._server = VehicleServer(px4, addresses, self, mute=lost)
        if on:
            self.switch_on()

    def switch_on(self) -> None:
        """Speak from now on, as a computer of its own would: not starved by nodes, which take this precedence, too."""
        take_precedence(-10)
        self._server.start()

    @property
    def ports(self) -> Tuple[int, ...]:
        """From which it speaks, one for each address."""
        return self._server.ports

    def say(self, *messages: Any) -> None:
        """Send messages on every link, among those that the autopilot means."""
        with self.lock:
            self._said += [(end, message) for end in self._ends for message in messages]

    def exchange(self, act: Callable[[int], List[Tuple[str, Any]]]) -> List[Tuple[str, Any]]:
        """Let time pass until now, and act."""
        with self.lock:
            now_ns = time.monotonic_ns()
            self.craft.advance(now_ns)
            out = act(now_ns)
            if self.craft.armed and self.craft.mode != self.modes[-1]:
                self.modes.append(self.craft.mode)
            said, self._said = self._said, []
            return [(end, message) for end, message in out if message.get_type() not in self.unsaid] + said

    def stop(self) -> None:
        """End it."""
        self._server.stop()
