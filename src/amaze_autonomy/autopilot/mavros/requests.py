"""What mavros is asked to do for a MAVLink message: a service to call, or a message to publish. Pure.

Each request has a lane, and each lane its own thread: a landing waits for no transfer of a mission, and for no service
that mavros answers only after its own 5 s, an arming among them. A command that has waited is dropped: who wants it
still says it again.
"""

from __future__ import annotations

import enum
import math
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Tuple

from ..link.dialect import FLIGHT_COMMANDS, LATE_NS, Message, mavlink
from ..vehicle.modes import LANDING_MODES, mavros_name, mode_name

_SET_MODE, _COMMAND, _PARAMETER = "set_mode", "cmd/command", "param/get"
_PUSH, _PULL, _SET_CURRENT = "mission/push", "mission/pull", "mission/set_current"
SERVICES: Mapping[str, str] = {_SET_MODE: "SetMode", _COMMAND: "CommandLong", _PARAMETER: "ParamGet"}
"""What is called below mavros' namespace, with its type in mavros_msgs."""
MISSION_SERVICES: Mapping[str, str] = {
    _PUSH: "WaypointPush",
    _PULL: "WaypointPull",
    _SET_CURRENT: "WaypointSetCurrent",
}
"""The same, by who flies missions."""


class Lane(enum.Enum):
    """What waits for each other."""

    MODE = "mode"
    ARMING = "arming"
    MISSION = "mission"
    REST = "rest"


CALL_LIMITS_S: Mapping[Lane, float] = {Lane.MODE: 1.0, Lane.ARMING: 6.0, Lane.MISSION: 120.0, Lane.REST: 6.0}
"""How long a call may take: a mode mavros sends at once, for a command's acknowledgement it waits 5 s; for each item of
a mission, of which there are some hundred, up to 3 times 1 s in the worst case."""


COMMAND_SERVICES: Mapping[Lane, str] = {Lane.MODE: _SET_MODE, Lane.ARMING: _COMMAND}
"""The lanes of what the vehicle is commanded, and the service of each."""


class Request(NamedTuple):
    """A service of mavros to call.

    Args:
        service: below the namespace.
        fields: of the request; waypoints as dictionaries of their fields.
        command: MAV_CMD that the answer acknowledges; 0: none.
        lane: what it waits for.
        lands: it asks for a landing mode.
    """

    service: str
    fields: Dict[str, Any]
    command: int = 0
    lane: Lane = Lane.REST
    lands: bool = False

    @property
    def kind(self) -> str:
        """Its type in mavros_msgs."""
        return SERVICES.get(self.service) or MISSION_SERVICES[self.service]

    @property
    def flies(self) -> bool:
        """Whether it changes what the vehicle does: nobody may want it any more when it comes late."""
        return self.command in FLIGHT_COMMANDS or self.service == _SET_CURRENT


def is_late(request: Request, waited_ns: int) -> bool:
    """Return whether a request has waited for so long that it is not to be sent: a landing never has."""
    return waited_ns > LATE_NS and request.flies and not request.lands


class Publication(NamedTuple):
    """A message to publish.

    Args:
        topic: below the namespace.
        kind: package and type.
        fields: of the message; those of inner messages by their names with a dot.
    """

    topic: str
    kind: str
    fields: Dict[str, Any]


SETPOINTS = Publication("setpoint_raw/local", "mavros_msgs/PositionTarget", {})
"""All that is published."""


def request_of(message: Message, autopilot: int) -> Optional[Request]:
    """Return the service of mavros that does what a message asks for; None: mavros does it by itself, or cannot.

    Args:
        message: to the vehicle.
        autopilot: behind mavros (MAV_AUTOPILOT), whose number of a mode becomes mavros' name of it.
    """
    make = _REQUESTS.get(message.get_type())
    return None if make is None else make(message, autopilot)


def _parameter(message: Message, _: int) -> Request:
    return Request(_PARAMETER, {"param_id": message.param_id})


def _command(message: Message, autopilot: int) -> Request:
    if message.command == mavlink.MAV_CMD_DO_SET_MODE:
        main, sub = int(message.param2), int(message.param3)
        number = main if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA else sub << 24 | main << 16
        fields = {"base_mode": 0, "custom_mode": mavros_name(autopilot, number)}
        lands = mode_name(autopilot, number) in LANDING_MODES
        return Request(_SET_MODE, fields, message.command, Lane.MODE, lands)
    lane = Lane.ARMING if message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM else Lane.REST
    parameters = {f"param{number}": getattr(message, f"param{number}") for number in range(1, 8)}
    long = {"broadcast": False, "command": message.command, "confirmation": 0, **parameters}
    return Request(_COMMAND, long, message.command, lane)


_REQUESTS: Mapping[str, Callable[[Message, int], Request]] = {
    "PARAM_REQUEST_READ": _parameter,
    "COMMAND_LONG": _command,
}


def publication_of(message: Message) -> Optional[Publication]:
    """Return the set-point as mavros takes it, east, north, up; None: the message is no set-point."""
    if message.get_type() != "SET_POSITION_TARGET_LOCAL_NED":
        return None
    fields = {
        "coordinate_frame": message.coordinate_frame,
        "type_mask": message.type_mask,
        "yaw": math.remainder(math.pi / 2 - message.yaw, 2 * math.pi),
        "position.x": message.y,
        "position.y": message.x,
        "position.z": -message.z,
        "velocity.x": message.vy,
        "velocity.y": message.vx,
        "velocity.z": -message.vz,
    }
    return Publication(SETPOINTS.topic, SETPOINTS.kind, fields)


# --- mavros mission ---------------------------------------------------------------------------------------------------
# The vehicle's side of the MAVLink mission protocol, played by mavros' services and its list of waypoints. Pure.
#
# `MissionUpload` speaks to it as to a vehicle. Items are asked for at once and pushed together; reading back is a
# pull, which makes mavros read the vehicle's own mission again, and the list that it publishes then. While a push or
# a pull is under way nothing is answered: whoever asks, asks again. A pull that is given up answers nobody: what it
# brings may be from before the next one asks. mavros answers a call before it publishes the list, and of a push what
# was pushed: read is the last list, once none has come for 0.3 s behind the pull's answer. mavros leaves the items as
# they are: ArduPilot's item 0, home, is pushed and pulled with the others.
#
#     MISSION_COUNT, MISSION_ITEM_INT   ->  mission/push         ->  MISSION_ACK
#     MISSION_REQUEST_LIST              ->  mission/pull         ->  MISSION_COUNT of the last mission/waypoints
#     MISSION_ACK that cancels          ->  the answer of the mission/pull that is under way counts no more
#     MISSION_REQUEST_INT               <-  mission/waypoints
#     MISSION_SET_CURRENT               ->  mission/set_current
#     mission/waypoints                 ->  MISSION_CURRENT
#     mission/reached                   ->  MISSION_ITEM_REACHED (`mavros_messages.py`)


_RELATIVE = 3  # mavros' name of both relative frames; it makes integers of the places by itself
_DEG7 = 1e7
QUIET = 6
"""Wakes of the link, 20 a second, for which no list comes behind the answer of a pull."""


class Taken(NamedTuple):
    """What comes of a message: answers to the client, services to call."""

    answers: Tuple[Message, ...] = ()
    requests: Tuple[Request, ...] = ()


class MavrosMission:
    """One mission, on its way to the vehicle or back."""

    def __init__(self) -> None:
        self._items: Dict[int, Message] = {}
        self._count = 0
        self._busy = ""
        self._stale = False  # who asked for the pull that is under way has given it up
        self._listed: Optional[Tuple[Any, ...]] = None
        self._pulled = 0  # items, as the answer says
        self._quiet = 0  # wakes that are left

    def take(self, message: Message) -> Optional[Taken]:
        """Take a message of the protocol; None: it is none."""
        take = _TAKES.get(message.get_type())
        return None if take is None else take(self, message)

    def answered(self, request: Request, answer: Any) -> List[Message]:
        """Take the answer of a service; None: there was none."""
        if request.service == _PUSH:
            self._busy = ""
            good = answer is not None and answer.success and answer.wp_transfered == self._count
            return [_ack(mavlink.MAV_MISSION_ACCEPTED if good else mavlink.MAV_MISSION_ERROR)]
        if request.service == _PULL:
            return self._answered_pull(answer)
        return []

    def _answered_pull(self, answer: Any) -> List[Message]:
        good = answer is not None and answer.success
        if good and not self._stale:
            self._pulled, self._quiet = answer.wp_received, QUIET
            return []
        self._busy = ""
        return [] if self._stale else [_ack(mavlink.MAV_MISSION_ERROR)]

    def listed(self, message: Any) -> List[Message]:
        """Take a WaypointList: what the vehicle has, as far as mavros knows, and where it is in it."""
        self._listed = tuple(message.waypoints)
        self._quiet = QUIET if self._quiet else 0
        return [mavlink.MAVLink_mission_current_message(message.current_seq)]

    def wake(self, *, read: bool = True) -> List[Message]:
        """Look whether a pull is over, 20 times a second; a list may wait in the socket of a node that has not read."""
        if not self._quiet or not read:
            return []
        self._quiet -= 1
        if self._quiet:
            return []
        self._busy = ""
        if self._listed is None or len(self._listed) != self._pulled:
            return []
        return [mavlink.MAVLink_mission_count_message(0, 0, len(self._listed))]

    # --- messages of the client -----------------------------------------------------------------------------------

    def _begin(self, message: Message) -> Taken:
        if self._busy:
            return Taken()
        self._items, self._count = {}, message.count
        return Taken((mavlink.MAVLink_mission_request_int_message(0, 0, 0),))

    def _item(self, message: Message) -> Taken:
        if self._busy or message.seq >= self._count:
            return Taken()
        self._items[message.seq] = message
        missing = next((number for number in range(self._count) if number not in self._items), None)
        if missing is not None:
            return Taken((mavlink.MAVLink_mission_request_int_message(0, 0, missing),))
        waypoints = tuple(_waypoint(self._items[number]) for number in range(self._count))
        return self._call(Request(_PUSH, {"start_index": 0, "waypoints": waypoints}, 0, Lane.MISSION))

    def _list(self, _: Message) -> Taken:
        if self._busy:
            return Taken()
        self._listed = None
        return self._call(Request(_PULL, {}, 0, Lane.MISSION))

    def _call(self, request: Request) -> Taken:
        self._busy, self._stale = request.service, False
        return Taken((), (request,))

    def _hand_out(self, message: Message) -> Taken:
        if self._listed is None or message.seq >= len(self._listed):
            return Taken()
        return Taken((_item_of(self._listed[message.seq], message.seq),))

    def _set_current(self, message: Message) -> Taken:
        fields = {"wp_seq": message.seq}
        return Taken((), (Request(_SET_CURRENT, fields, 0, Lane.MISSION),))

    def _end(self, message: Message) -> Taken:
        """Take the end of a transfer, which mavros acknowledges by itself; one that is given up may be a pull's."""
        cancelled = message.type == mavlink.MAV_MISSION_OPERATION_CANCELLED
        self._stale = self._stale or (cancelled and self._busy == _PULL)
        if self._stale and self._quiet:
            self._busy, self._quiet = "", 0
        return Taken()


_TAKES: Mapping[str, Callable[[MavrosMission, Message], Taken]] = {
    "MISSION_COUNT": MavrosMission._begin,  # noqa: SLF001 - the table of this class
    "MISSION_ITEM_INT": MavrosMission._item,  # noqa: SLF001
    "MISSION_REQUEST_LIST": MavrosMission._list,  # noqa: SLF001
    "MISSION_REQUEST_INT": MavrosMission._hand_out,  # noqa: SLF001
    "MISSION_SET_CURRENT": MavrosMission._set_current,  # noqa: SLF001
    "MISSION_ACK": MavrosMission._end,  # noqa: SLF001
}


def _ack(result: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(0, 0, result)


def _waypoint(item: Message) -> Dict[str, Any]:
    """Return the fields of a mavros_msgs/Waypoint."""
    return {
        "frame": _RELATIVE,
        "command": item.command,
        "is_current": bool(item.current),
        "autocontinue": bool(item.autocontinue),
        **{f"param{number}": getattr(item, f"param{number}") for number in range(1, 5)},
        "x_lat": item.x / _DEG7,
        "y_long": item.y / _DEG7,
        "z_alt": item.z,
    }


def _item_of(waypoint: Any, number: int) -> Message:
    """Return the MISSION_ITEM_INT of a mavros_msgs/Waypoint."""
    return mavlink.MAVLink_mission_item_int_message(
        0,
        0,
        number,
        waypoint.frame,
        waypoint.command,
        int(waypoint.is_current),
        int(waypoint.autocontinue),
        waypoint.param1,
        waypoint.param2,
        waypoint.param3,
        waypoint.param4,
        round(waypoint.x_lat * _DEG7),
        round(waypoint.y_long * _DEG7),
        waypoint.z_alt,
    )
