"""How the mission planner flies missions through the autopilot: what it asks for, and how long it waits."""

from __future__ import annotations

import enum
from dataclasses import dataclass

__all__ = ["Controller", "PlannerSpec"]

_S = 1_000_000_000


class Controller(enum.Enum):
    """Who steers along the waypoints."""

    MISSION = "mission"  # the autopilot, by a mission that was sent to it: needs a position on the earth
    OFFBOARD = "offboard"  # the planner, by set-points in the local frame: needs a local position only


@dataclass(frozen=True)
class PlannerSpec:
    """Limits of the planner.

    Args:
        acceptance_radius_m: nearer than this a waypoint is reached.
        heading_tolerance_rad: likewise for the yaw, with set-points.
        home_tolerance_m: how far the first takeoff may be from a mission's home.
        transfer_limit_ns: time in which a waypoint file must be sent, read back and compared.
        message_retry_ns: time without an answer after which a message of the mission protocol is sent again.
        command_retry_ns: time without an effect after which a command is sent again.
        command_limit_ns: time in which a command must show its effect.
        vehicle_age_limit_ns: how old the vehicle's last word may be to be believed.
        setpoint_rate_hz: of the stream of set-points.
        setpoint_lead_ns: how long they are sent before the autopilot is told to follow them.
        pose_age_limit_ns: how old the local position may be to be flown by.
    """

    acceptance_radius_m: float = 0.5
    heading_tolerance_rad: float = 0.2617993877991494
    home_tolerance_m: float = 5.0
    transfer_limit_ns: int = 8 * _S
    message_retry_ns: int = _S // 2
    command_retry_ns: int = _S // 2
    command_limit_ns: int = 4 * _S
    vehicle_age_limit_ns: int = 3 * _S
    setpoint_rate_hz: float = 20.0
    setpoint_lead_ns: int = _S
    pose_age_limit_ns: int = _S // 2
