"""Which service of which peer a command of the engine goes to; names as in DESIGN.md section 6."""

from __future__ import annotations

from typing import Mapping, Optional

from amaze_autonomy.engine.checks import CheckName
from amaze_autonomy.engine.commands import (
    AutopilotDisarm,
    AutopilotLand,
    Command,
    LoadMission,
    MissionCommand,
    RunCheck,
    StartRecording,
    StopRecording,
)

__all__ = ["PEERS", "SERVICES", "peer_of", "service_of"]

PEERS = ("watchdog", "landing_detection", "state_estimation", "autopilot", "mission_planner", "data_recorder")

SERVICES = (
    "watchdog/start",
    "autopilot/check_battery",
    "autopilot/check",
    "landing_detection/check",
    "state_estimation/check",
    "mission_planner/load",
    "mission_planner/command",
    "data_recorder/start",
    "data_recorder/stop",
    "autopilot/land",
    "autopilot/disarm",
)

_CHECKS: Mapping[CheckName, str] = {
    CheckName.WATCHDOG: "watchdog/start",
    CheckName.BATTERY: "autopilot/check_battery",
    CheckName.AUTOPILOT: "autopilot/check",
    CheckName.ON_GROUND: "landing_detection/check",
    CheckName.STATE_ESTIMATION: "state_estimation/check",
}


def peer_of(service: str) -> str:
    """Return the peer that offers a service: the first part of its name."""
    return service.split("/", 1)[0]


def service_of(command: Command) -> Optional[str]:
    """Return the service that a command is a request to; None for what is not a request."""
    if isinstance(command, RunCheck):
        return _CHECKS[command.check]
    for kind, name in _COMMANDS.items():
        if isinstance(command, kind):
            return name
    return None


_COMMANDS = {
    LoadMission: "mission_planner/load",
    MissionCommand: "mission_planner/command",
    StartRecording: "data_recorder/start",
    StopRecording: "data_recorder/stop",
    AutopilotLand: "autopilot/land",
    AutopilotDisarm: "autopilot/disarm",
}
