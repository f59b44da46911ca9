"""The one place that knows which MAVLink dialect is spoken, and the little that pymavlink's types do not say.

`ardupilotmega` holds all of `common` and what ArduPilot adds (EKF_STATUS_REPORT). CURRENT_MODE and EVENT of PX4 are in
neither and are added here, and MISSION_CURRENT lacks what was added to it last; whoever decodes, decodes them.
https://mavlink.io/en/messages/development.html#CURRENT_MODE, https://mavlink.io/en/services/events.html,
https://mavlink.io/en/messages/common.html#MISSION_CURRENT
"""

from __future__ import annotations

import struct
from typing import Any, Dict, List, Tuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

__all__ = [
    "FLIGHT_COMMANDS",
    "LATE_NS",
    "Message",
    "changes_flight",
    "current_mode_message",
    "event_message",
    "mavlink",
    "message_id",
    "mission_current_message",
    "source_of",
]

Message = Any  # a pymavlink message: its fields are attributes, `get_type()` is its name

FLIGHT_COMMANDS = frozenset(
    {
        mavlink.MAV_CMD_DO_SET_MODE,
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        mavlink.MAV_CMD_MISSION_START,
        mavlink.MAV_CMD_NAV_TAKEOFF,
    }
)
"""What changes what the vehicle does."""
LATE_NS = 500_000_000
"""How long such a command may wait for its way out: as long as a node may stand still before it listens first."""


def _added(name: str, number: int, extra: int, form: str, fields: Dict[str, int]) -> Any:
    """Return the class of a message that the dialect lacks, or has with fewer fields, as pymavlink generates it.

    Args:
        name: of the message.
        number: its id.
        extra: that its checksum ends with.
        form: of `struct`, in the order of the wire.
        fields: place on the wire by name, in the order of the definition; the last one may be an array of bytes.
    """
    known = mavlink.mavlink_map.get(number)
    if known is not None and set(fields) <= set(known.fieldnames):
        return known
    packer = struct.Struct(form)
    array = len(packer.unpack(bytes(packer.size))) - len(fields) + 1

    def init(self: Any, *values: Any) -> None:
        mavlink.MAVLink_message.__init__(self, number, name)
        self._fieldnames, self._instance_field, self._instance_offset = list(fields), None, -1
        for field, value in zip(fields, values):
            setattr(self, field, value)

    def pack(self: Any, mav: Any, force_mavlink1: bool = False) -> bytes:  # noqa: FBT001, FBT002 - pymavlink's signature
        ordered: List[Any] = [getattr(self, field) for field in sorted(fields, key=fields.__getitem__)]
        flat = [*ordered[:-1], *ordered[-1]] if array > 1 else ordered
        return bytes(self._pack(mav, extra, packer.pack(*flat), force_mavlink1=force_mavlink1))

    arrays = [array if array > 1 and at == len(fields) - 1 else 0 for at in range(len(fields))]
    kind = type(
        f"MAVLink_{name.lower()}_message",
        (mavlink.MAVLink_message,),
        {
            "__init__": init,
            "pack": pack,
            "id": number,
            "msgname": name,
            "fieldnames": list(fields),
            "ordered_fieldnames": sorted(fields, key=fields.__getitem__),
            "native_format": bytearray(form.encode("ascii")),
            "orders": list(fields.values()),
            "lengths": [max(1, count) for count in arrays],
            "array_lengths": arrays,
            "crc_extra": extra,
            "unpacker": packer,
            "fieldenums_by_name": {},
            "fielddisplays_by_name": {},
            "fieldunits_by_name": {},
            "instance_field": None,
            "instance_offset": -1,
        },
    )
    mavlink.mavlink_map[number] = kind
    return kind


current_mode_message = _added(
    "CURRENT_MODE", 436, 193, "<IIB", {"standard_mode": 2, "custom_mode": 0, "intended_custom_mode": 1}
)
event_message = _added(
    "EVENT",
    410,
    160,
    "<IIHBBB40B",
    {
        "destination_component": 3,
        "destination_system": 4,
        "id": 0,
        "event_time_boot_ms": 1,
        "sequence": 2,
        "log_levels": 5,
        "arguments": 6,
    },
)


#: with what tells one mission from another: `mission_id` is 0 where the autopilot gives none
mission_current_message = _added(
    "MISSION_CURRENT",
    42,
    28,
    "<HHBBIII",
    {
        "seq": 0,
        "total": 1,
        "mission_state": 2,
        "mission_mode": 3,
        "mission_id": 4,
        "fence_id": 5,
        "rally_points_id": 6,
    },
)


def message_id(name: str) -> int:
    """Return the number of a message, e.g. 0 for HEARTBEAT.

    Raises:
        KeyError: There is no such message.
    """
    return int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}", None) or _ids()[name])


def source_of(message: Message) -> Tuple[int, int]:
    """Return the system and the component that sent a message."""
    return int(message.get_srcSystem()), int(message.get_srcComponent())


def changes_flight(message: Message) -> bool:
    """Return whether a message changes what the vehicle does: nobody may want it any more when it comes late."""
    name = message.get_type()
    return name == "MISSION_SET_CURRENT" or (name == "COMMAND_LONG" and message.command in FLIGHT_COMMANDS)


def _ids() -> Dict[str, int]:
    return {kind.msgname: number for number, kind in mavlink.mavlink_map.items()}
