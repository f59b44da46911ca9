"""Names and types of everything between the nodes (DESIGN.md section 6). Names are defaults, all can be remapped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, Mapping, Tuple, Type

from std_srvs.srv import Trigger

from amaze_autonomy import msg, srv
from amaze_autonomy.engine import events
from amaze_autonomy.engine.checks import CheckName
from amaze_autonomy.engine.events import UserCommand

from . import incoming

__all__ = ["CHECK_SERVICES", "SERVICES", "STATUS_TOPICS", "USER_SERVICES", "StatusTopic"]


@dataclass(frozen=True)
class StatusTopic:
    """A status that the engine listens to.

    Args:
        name: of the topic.
        message: its message class.
        read: makes the event of (message, arrival on the deciding clock, arrival in ROS time).
    """

    name: str
    message: Type[Any]
    read: Callable[[Any, int, int], events.Event]


STATUS_TOPICS: Tuple[StatusTopic, ...] = (
    StatusTopic("watchdog/action", msg.WatchdogAction, incoming.watchdog_action),
    StatusTopic("watchdog/info", msg.WatchdogInfo, incoming.watchdog_info),
    StatusTopic("mission_planner/status", msg.MissionStatus, incoming.mission_status),
    StatusTopic("data_recorder/status", msg.RecordingStatus, incoming.recording_status),
    StatusTopic("autopilot/status", msg.AutopilotStatus, incoming.autopilot_status),
    StatusTopic("landing_detection/landed", msg.Landed, incoming.landed_status),
)

CHECK_SERVICES: Mapping[CheckName, str] = {
    CheckName.WATCHDOG: "watchdog/start",
    CheckName.BATTERY: "autopilot/check_battery",
    CheckName.AUTOPILOT: "autopilot/check",
    CheckName.ON_GROUND: "landing_detection/check",
    CheckName.STATE_ESTIMATION: "state_estimation/check",
}

SERVICES: Dict[str, Type[Any]] = {
    "watchdog/start": srv.StartWatchdog,
    "autopilot/check_battery": srv.CheckBattery,
    "autopilot/check": srv.CheckAutopilot,
    "landing_detection/check": srv.CheckLanded,
    "state_estimation/check": srv.CheckState,
    "mission_planner/load": srv.LoadMission,
    "mission_planner/command": srv.MissionCommand,
    "data_recorder/start": srv.StartRecording,
    "data_recorder/stop": srv.StopRecording,
    "autopilot/land": Trigger,
    "autopilot/disarm": Trigger,
}

#: The user's services in the private namespace of the node, by the value of their command.
USER_SERVICES: Tuple[str, ...] = tuple(command.value for command in UserCommand)
