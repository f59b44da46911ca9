"""What goes between the nodes: a table of statuses and one of services, made of the annotations of the engine's types.

`fields.py` says how a field of a message is made of a field of an event or a command, and back; `tables.py`
has the tables. Nodes, simulation and tests read them. Nothing here knows ROS: message classes are handed in by the
shells.
"""

from __future__ import annotations

from .fields import InvalidMessageError, Shape, message_name
from .tables import (
    CHECK_ROW,
    CHECK_SERVICES,
    COMPONENT,
    PEERS,
    SERVICES,
    STATUSES,
    Service,
    Status,
    health_fields,
    health_of,
    peer_of,
    service_of,
    status_of,
)

__all__ = [
    "CHECK_ROW",
    "CHECK_SERVICES",
    "COMPONENT",
    "PEERS",
    "SERVICES",
    "STATUSES",
    "InvalidMessageError",
    "Service",
    "Shape",
    "Status",
    "health_fields",
    "health_of",
    "message_name",
    "peer_of",
    "service_of",
    "status_of",
]
