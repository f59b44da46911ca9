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

__all__ = ["PEERS", "SERVICES", "service_of"]

PEERS = ("watchdog", "landing_detection", "state_estimation", "autopilot", "planner", "recorder")

SERVICES: Mapping[str, str] = {
    "watchdog/start": "watchdog",
    "autopilot/check_battery": "autopilot",
    "autopilot/check": "autopilot",
    "landing_detection/check": "landing_detection",
    "state_estimation/check": "state_estimation",
    "mission_planner/load": "planner",
    "mission_planner/command": "planner",
    "data_recorder/start": "recorder",
    "data_recorder/stop": "recorder",
    "autopilot/land": "autopilot",
    "autopilot/disarm": "autopilot",
}

_CHECKS: Mapping[CheckName, str] = {
    CheckName.WATCHDOG: "watchdog/start",
    CheckName.BATTERY: "autopilot/check_battery",
    CheckName.AUTOPILOT: "autopilot/check",
    CheckName.ON_GROUND: "landing_detection/check",
    CheckName.STATE_ESTIMATION: "state_estimation/check",
}


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
