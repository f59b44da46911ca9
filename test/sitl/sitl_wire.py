"""What was said on the wire, by the telemetry logs of a flight: modes, arming, height, and who ordered what."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Tuple

from sitl_station import CURRENT_MODE

from amaze_autonomy.autopilot.link.dialect import mavlink, message_id
from amaze_autonomy.autopilot.link.framing import V2, frame_at
from amaze_autonomy.autopilot.link.wire import decode
from amaze_autonomy.autopilot.vehicle.modes import mode_name

_OURS = {191: "autopilot", 192: "planner"}
_CURRENT_MODE = 436
_TAKEN = (
    "HEARTBEAT",
    "EXTENDED_SYS_STATE",
    "COMMAND_LONG",
    "COMMAND_INT",
    "SET_MODE",
    "HIL_STATE_QUATERNION",
    "SIM_STATE",
)
_FORWARDED_S = 0.5
_STAMP = 8
_IDS = frozenset(message_id(name) for name in _TAKEN)


class Shown(NamedTuple):
    """What the vehicle says of itself, when it is new: time (s since 1970), armed, mode, landed state."""

    t_s: float
    armed: bool
    mode: str


class Order(NamedTuple):
    """What somebody told the vehicle: time, who (autopilot, planner, station), what (a mode, ARM, DISARM, START)."""

    t_s: float
    who: str
    what: str
    height_m: float


class Wire(NamedTuple):
    """One flight on the wire.

    Args:
        shown: each change of armed or mode, on any link.
        landed: each change of the landed state: time, state.
        orders: of modes, arming and mission start, on all links.
        heights: time and true height above the ground of its start, m.
    """

    shown: Tuple[Shown, ...]
    landed: Tuple[Tuple[float, int], ...]
    orders: Tuple[Order, ...]
    heights: Tuple[Tuple[float, float], ...]

    @property
    def armed_modes(self) -> List[str]:
        """Modes shown while armed, in their order, each once in a row."""
        modes: List[str] = []
        for each in self.shown:
            if each.armed and (not modes or modes[-1] != each.mode):
                modes.append(each.mode)
        return modes

    def first_shown(self, mode: str, after_s: float) -> Optional[float]:
        """Return when a mode was first shown after a time."""
        return next((each.t_s for each in self.shown if each.t_s >= after_s and each.mode == mode), None)

    def first_order(self, what: str, after_s: float) -> Optional[float]:
        """Return when one of our nodes first ordered something after a time."""
        ours = (each for each in self.orders if each.who != "station")
        return next((each.t_s for each in ours if each.t_s >= after_s and each.what == what), None)

    def height_at(self, t_s: float) -> float:
        """Return the true height at a time, the last one known."""
        return _last(self.heights, t_s)


def read_wire(folder: Path, autopilot: str) -> Wire:
    """Read the logs of a flight's folder."""
    number = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA if autopilot == "ardupilot" else mavlink.MAV_AUTOPILOT_PX4
    messages: List[Tuple[float, Any]] = []
    for name in ("node", "planner", "ground"):
        messages += _messages((folder / f"{name}.tlog").read_bytes())
    messages.sort(key=lambda each: each[0])
    heights = _heights(messages)
    return Wire(_shown(messages, number), _landed(messages), _orders(messages, number, heights), heights)


def orders_in(data: bytes, autopilot: str) -> List[str]:
    """Return what a datagram tells the vehicle to do, as in `Order`."""
    number = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA if autopilot == "ardupilot" else mavlink.MAV_AUTOPILOT_PX4
    found: List[str] = []
    at = 0
    while at < len(data):
        frame = frame_at(data, at)
        if frame is None:
            break
        at += frame.length
        if frame.frame is not None and frame.frame.number in _IDS:
            found.append(_ordered(decode(frame.frame), number))
    return [each for each in found if each]


class _CurrentMode(NamedTuple):
    """PX4's CURRENT_MODE, of which our dialect knows nothing."""

    custom_mode: int

    @staticmethod
    def get_type() -> str:
        """Return its name, as messages do."""
        return "CURRENT_MODE"


def _messages(data: bytes) -> Iterator[Tuple[float, Any]]:
    """Return what is looked at of a telemetry log that the relay wrote."""
    at = 0
    while at + _STAMP < len(data):
        found = frame_at(data, at + _STAMP)
        if found is None:
            return  # the log ends in a frame: its writer was ended
        t_s = int.from_bytes(data[at : at + _STAMP], "big") * 1e-6
        raw = data[at + _STAMP : at + _STAMP + found.length]
        at += _STAMP + found.length
        if found.frame is not None and found.frame.number in _IDS:
            yield t_s, decode(found.frame)
        elif found.frame is None and raw[0] == V2 and int.from_bytes(raw[7:10], "little") == CURRENT_MODE:
            yield t_s, _CurrentMode(int.from_bytes(raw[10 : 10 + min(4, raw[1])], "little"))


def _shown(messages: List[Tuple[float, Any]], autopilot: int) -> Tuple[Shown, ...]:
    shown: List[Shown] = []
    armed = False
    for t_s, message in messages:
        if message.get_type() == "HEARTBEAT" and message.get_srcSystem() == message.get_srcComponent() == 1:
            armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        elif message.get_type() != "CURRENT_MODE":
            continue
        each = Shown(t_s, armed, mode_name(autopilot, message.custom_mode))
        if not shown or each[1:] != shown[-1][1:]:
            shown.append(each)
    return tuple(shown)


def _landed(messages: List[Tuple[float, Any]]) -> Tuple[Tuple[float, int], ...]:
    found: List[Tuple[float, int]] = []
    for t_s, message in messages:
        if message.get_type() == "EXTENDED_SYS_STATE" and (not found or found[-1][1] != message.landed_state):
            found.append((t_s, int(message.landed_state)))
    return tuple(found)


def _heights(messages: List[Tuple[float, Any]]) -> Tuple[Tuple[float, float], ...]:
    found: List[Tuple[float, float]] = []
    for t_s, message in messages:
        if message.get_type() == "HIL_STATE_QUATERNION":
            found.append((t_s, message.alt / 1000.0))
        elif message.get_type() == "SIM_STATE":
            found.append((t_s, float(message.alt)))
    ground = min((height for _, height in found), default=0.0)
    return tuple((t_s, height - ground) for t_s, height in found)


def _orders(
    messages: List[Tuple[float, Any]], autopilot: int, heights: Tuple[Tuple[float, float], ...]
) -> Tuple[Order, ...]:
    orders: List[Order] = []
    passed: Dict[Tuple[int, int], float] = {}
    for t_s, message in messages:
        what = _ordered(message, autopilot)
        if what and message.get_srcComponent() != 1:
            frame = (message.get_srcComponent(), message.get_seq())
            again = t_s - passed.get(frame, 0.0) < _FORWARDED_S
            passed[frame] = t_s
            if again:
                continue  # the autopilot has passed it on to its other links
            who = _OURS.get(message.get_srcComponent(), "station")
            orders.append(Order(t_s, who, what, _last(heights, t_s)))
    return tuple(orders)


def _ordered(message: Any, autopilot: int) -> str:
    name = message.get_type()
    if name == "SET_MODE":
        return mode_name(autopilot, message.custom_mode)
    if name not in ("COMMAND_LONG", "COMMAND_INT"):
        return ""
    if message.command == mavlink.MAV_CMD_DO_SET_MODE:
        main, sub = int(message.param2), int(message.param3)
        px4 = autopilot == mavlink.MAV_AUTOPILOT_PX4
        return mode_name(autopilot, main << 16 | sub << 24 if px4 else main)
    if message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
        return "ARM" if message.param1 == 1.0 else "DISARM"
    return {mavlink.MAV_CMD_MISSION_START: "START", mavlink.MAV_CMD_NAV_TAKEOFF: "TAKEOFF"}.get(message.command, "")


def _last(series: Tuple[Tuple[float, float], ...], t_s: float) -> float:
    low, high = 0, len(series)
    while low < high:
        middle = (low + high) // 2
        if series[middle][0] <= t_s:
            low = middle + 1
        else:
            high = middle
    return series[low - 1][1] if low else 0.0


def counted(wire: Wire) -> Dict[str, int]:
    """Return how often each order was given by our nodes."""
    found: Dict[str, int] = {}
    for each in wire.orders:
        if each.who != "station":
            found[each.what] = found.get(each.what, 0) + 1
    return found
