"""The one place that knows which MAVLink dialect is spoken, and the little that pymavlink's types do not say.

`ardupilotmega` holds all of `common` and what ArduPilot adds (EKF_STATUS_REPORT). PX4's EVENT is in neither: frames of
ids that the dialect does not know are skipped, and the same text comes as STATUSTEXT.
"""

from __future__ import annotations

from typing import Any, Dict, Tuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

__all__ = ["Message", "mavlink", "message_id", "source_of"]

Message = Any  # a pymavlink message: its fields are attributes, `get_type()` is its name


def message_id(name: str) -> int:
    """Return the number of a message, e.g. 0 for HEARTBEAT.

    Raises:
        KeyError: There is no such message.
    """
    return int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}", None) or _ids()[name])


def source_of(message: Message) -> Tuple[int, int]:
    """Return the system and the component that sent a message."""
    return int(message.get_srcSystem()), int(message.get_srcComponent())


def _ids() -> Dict[str, int]:
    return {kind.msgname: number for number, kind in mavlink.mavlink_map.items()}
