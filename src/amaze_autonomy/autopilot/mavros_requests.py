"""What mavros is asked to do for a MAVLink message: a service to call, or a message to publish. Pure.

Each request has a lane, and each lane its own thread: a landing waits for no transfer of a mission, and for no service
that mavros answers only after its own 5 s.
"""

from __future__ import annotations

import enum
import math
from typing import Any, Callable, Dict, Mapping, NamedTuple, Optional

from .dialect import Message, mavlink
from .modes import mode_name

__all__ = ["Lane", "Publication", "Request", "publication_of", "request_of"]

_URGENT = (mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM)


class Lane(enum.Enum):
    """What waits for each other."""

    URGENT = "urgent"
    MISSION = "mission"
    REST = "rest"


class Request(NamedTuple):
    """A service of mavros to call.

    Args:
        service: below the namespace.
        kind: type of it in mavros_msgs.
        fields: of the request; waypoints as dictionaries of their fields.
        command: MAV_CMD that the answer acknowledges; 0: none.
        lane: what it waits for.
    """

    service: str
    kind: str
    fields: Dict[str, Any]
    command: int = 0
    lane: Lane = Lane.REST


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


def request_of(message: Message) -> Optional[Request]:
    """Return the service of mavros that does what a message asks for; None: mavros does it by itself, or cannot."""
    make = _REQUESTS.get(message.get_type())
    return None if make is None else make(message)


def _parameter(message: Message) -> Request:
    return Request("param/get", "ParamGet", {"param_id": message.param_id})


def _command(message: Message) -> Request:
    lane = Lane.URGENT if message.command in _URGENT else Lane.REST
    if message.command == mavlink.MAV_CMD_DO_SET_MODE:
        number = int(message.param3) << 24 | int(message.param2) << 16
        mode = mode_name(mavlink.MAV_AUTOPILOT_PX4, number)
        return Request("set_mode", "SetMode", {"base_mode": 0, "custom_mode": mode}, message.command, lane)
    parameters = {f"param{number}": getattr(message, f"param{number}") for number in range(1, 8)}
    fields = {"broadcast": False, "command": message.command, "confirmation": 0, **parameters}
    return Request("cmd/command", "CommandLong", fields, message.command, lane)


_REQUESTS: Mapping[str, Callable[[Message], Request]] = {"PARAM_REQUEST_READ": _parameter, "COMMAND_LONG": _command}


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
    return Publication("setpoint_raw/local", "mavros_msgs/PositionTarget", fields)
