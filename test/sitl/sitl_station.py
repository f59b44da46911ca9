"""The second ground station: somebody else who speaks with the vehicle, with a transmitter of its own (PX4: sticks)."""

from __future__ import annotations

import struct
import threading
import time
from typing import Any, Dict, List, Optional, Tuple

from sitl_autopilots import Kind
from sitl_relay import Link

from amaze_autonomy.autopilot.link.dialect import mavlink, message_id
from amaze_autonomy.autopilot.link.wire import Wire, time_stamp
from amaze_autonomy.simulation.vehicle.external import WANTED, Observer

_SYSTEM, _COMPONENT = 255, 190
_RATES_HZ = {"SYS_STATUS": 2.0, "HOME_POSITION": 1.0, "GPS_RAW_INT": 2.0}
_STREAMS = {"ATTITUDE": 25.0, "GLOBAL_POSITION_INT": 10.0, "VFR_HUD": 10.0, "BATTERY_STATUS": 2.0}
CURRENT_MODE, _CURRENT_MODE_US = 436, 50_000  # of a newer dialect than ours
_STICKS_S, _BEAT_S, _MISSION_S, _ASK_S = 0.1, 1.0, 3.0, 3.0
_MODES: Dict[str, Dict[str, Tuple[int, int]]] = {
    "px4": {"POSCTL": (3, 0), "AUTO.LOITER": (4, 3), "AUTO.RTL": (4, 5), "AUTO.LAND": (4, 6), "AUTO.MISSION": (4, 4)},
    "ardupilot": {"POSCTL": (5, 0), "AUTO.LOITER": (17, 0), "AUTO.RTL": (6, 0), "AUTO.LAND": (9, 0)},
}
_SPEED = "SIM_SPEEDUP"


class Station:
    """Hears the vehicle on the link for ground stations and speaks on it.

    Args:
        link: of the relay.
        kind: of the autopilot.
    """

    def __init__(self, link: Link, kind: Kind) -> None:
        self.seen = Observer()
        self.busy = False
        self.downloads = 0
        self.heard: Dict[str, Any] = {}
        self.texts: List[Tuple[float, str]] = []
        self._link, self._kind = link, kind
        wanted = {*WANTED, *_RATES_HZ, "STATUSTEXT", "PARAM_VALUE", "MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK"}
        self._wanted = sorted({*wanted, "MISSION_REQUEST_INT", "MISSION_REQUEST"})
        self._wire = Wire(_SYSTEM, _COMPONENT, self._wanted)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ground station", daemon=True)
        self._mission: Optional[List[Any]] = None
        self._asked = 0
        link.listeners.append(self._hear)

    def start(self) -> None:
        """Switch it on."""
        self._thread.start()

    def stop(self) -> None:
        """Switch it off."""
        self._stopped.set()
        self._thread.join(5.0)

    @property
    def ready(self) -> bool:
        """Tell whether the autopilot would arm, and knows where it is (ArduPilot sends no position before)."""
        status = self.heard.get("SYS_STATUS")
        if status is None or "HOME_POSITION" not in self.heard or "LOCAL_POSITION_NED" not in self.heard:
            return False
        return bool(status.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)

    def forget(self) -> None:
        """Forget what was heard: the autopilot has been switched off."""
        self.heard.clear()
        self.seen.place = None

    # --- what it tells the vehicle --------------------------------------------------------------------------------

    def mode(self, name: str) -> None:
        """Command a flight mode."""
        main, sub = _MODES[self._kind.name][name]
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub)

    def disarm_or_arm(self, *, arm: bool) -> None:
        """Arm or disarm, not forced."""
        self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1 if arm else 0)

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter; PX4 wants whole numbers as such."""
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        known = self.heard.get(f"PARAM {name}")
        if known is not None:
            kind = known.param_type
        if kind == mavlink.MAV_PARAM_TYPE_INT32 and self._kind.name == "px4":
            value = _bits(int(value))
        self._say(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))

    def ask_parameter(self, name: str) -> None:
        """Ask for a parameter, which says what kind of number it is."""
        self._say(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))

    def real_time(self) -> bool:
        """Let the simulator run in real time; return whether it says that it does."""
        said = self.heard.get(f"PARAM {_SPEED}")
        if self._kind.boot_speed == 1 or (said is not None and said.param_value == 1.0):
            return True
        self.set_parameter(_SPEED, 1.0)
        return False

    def upload(self, up_m: float) -> None:
        """Replace the vehicle's mission by one of its own: a takeoff and a far waypoint."""
        home = self.heard["HOME_POSITION"]
        frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        north = home.latitude + 1000  # 11 m
        places = [(16, home.latitude, up_m)] if self._kind.name == "ardupilot" else []
        places += [(22, home.latitude, up_m), (16, north, up_m)]
        self._mission = [
            mavlink.MAVLink_mission_item_int_message(
                1, 1, number, frame, command, int(number == 0), 1, 0, 0, 0, 0, latitude, home.longitude, up
            )
            for number, (command, latitude, up) in enumerate(places)
        ]
        self._say(mavlink.MAVLink_mission_count_message(1, 1, len(self._mission)))

    def set_home(self, up_m: float) -> None:
        """Set home where it is, but for its height."""
        home, frame = self.heard["HOME_POSITION"], mavlink.MAV_FRAME_GLOBAL
        place = (home.latitude, home.longitude, home.altitude / 1e3 + up_m)
        message = mavlink.MAVLink_command_int_message(
            1, 1, frame, mavlink.MAV_CMD_DO_SET_HOME, 0, 0, 0.0, 0.0, 0.0, 0.0, *place
        )
        self._say(message)

    def give_key(self, key: bytes, unix_ns: int) -> None:
        """Have the autopilot sign, and believe nothing else, from now on; so does the station."""
        stamp = time_stamp(unix_ns)
        self._say(*[mavlink.MAVLink_setup_signing_message(1, 1, list(key), stamp)] * 3)
        self._wire = Wire(_SYSTEM, _COMPONENT, self._wanted, key=key)

    def forge(self, link: Link, mode: str) -> None:
        """Command a flight mode on another's link, as the autopilot node would, without the key."""
        main, sub = _MODES[self._kind.name][mode]
        message = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, main, sub, 0, 0, 0, 0)
        link.send(Wire(1, 191).send(message))

    # --- the link -------------------------------------------------------------------------------------------------

    def _command(self, number: int, *parameters: float) -> None:
        values = (*parameters, *(0.0,) * (7 - len(parameters)))
        self._say(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values))

    def _say(self, *messages: Any) -> None:
        for message in messages:
            self._link.send(self._wire.send(message, time.time_ns()))

    def _hear(self, t_ns: int, data: bytes) -> None:
        for message in self._wire.receive(data, "autopilot", t_ns):
            if message.get_srcSystem() != 1 or message.get_srcComponent() != 1:
                continue
            self.seen.receive(t_ns, message)
            self._note(t_ns, message)

    def _note(self, t_ns: int, message: Any) -> None:
        name = message.get_type()
        self.heard[name] = message
        if name == "STATUSTEXT":
            self.texts.append((t_ns * 1e-9, message.text))
        elif name == "PARAM_VALUE":
            self.heard[f"PARAM {message.param_id}"] = message
        elif name in ("MISSION_REQUEST_INT", "MISSION_REQUEST") and self._mission is not None:
            self._say(self._mission[message.seq])
        elif name == "MISSION_ACK" and self._mission is not None:
            self._mission = None
        elif name == "MISSION_COUNT" and self.busy and message.target_system == _SYSTEM:
            self._asked = message.count
            if message.count:
                self._say(mavlink.MAVLink_mission_request_int_message(1, 1, 0))
        elif name == "MISSION_ITEM_INT" and self.busy and message.target_system == _SYSTEM:
            self._go_on(message.seq)

    def _go_on(self, number: int) -> None:
        if number + 1 < self._asked:
            self._say(mavlink.MAVLink_mission_request_int_message(1, 1, number + 1))
        else:
            self.downloads += 1
            self._say(mavlink.MAVLink_mission_ack_message(1, 1, 0))

    def _run(self) -> None:
        due = {"beat": 0.0, "sticks": 0.0, "mission": 0.0, "ask": 0.0}
        while not self._stopped.wait(0.02):
            now = time.monotonic()
            if now >= due["beat"]:
                due["beat"] = now + _BEAT_S
                self._say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            if self._kind.name == "px4" and now >= due["sticks"]:
                due["sticks"] = now + _STICKS_S
                self._say(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
            if now >= due["ask"]:
                due["ask"] = now + _ASK_S
                self._ask()
            if self.busy and now >= due["mission"]:
                due["mission"] = now + _MISSION_S
                self._say(mavlink.MAVLink_mission_request_list_message(1, 1))

    def _ask(self) -> None:
        rates = {**_RATES_HZ, **(_STREAMS if self.busy else {})}
        for name, rate in rates.items():
            if name not in self.heard or name in _STREAMS:
                self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id(name), 1e6 / rate)
        if self._kind.name == "px4":  # its heartbeat comes once a second, whatever it is asked
            self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, CURRENT_MODE, _CURRENT_MODE_US)
        self._say(*self.seen.wake(time.time_ns()))


def _bits(value: int) -> float:
    return float(struct.unpack("<f", struct.pack("<i", value))[0])
