"""Requests that arrive at the simulated peers' services -> commands of the engine; the world's answers -> responses.

The other direction of `requests.py`.
"""

from __future__ import annotations

from math import isfinite
from typing import Any, Callable, Mapping

from std_srvs.srv import TriggerResponse

from amaze_autonomy import srv
from amaze_autonomy.engine import commands
from amaze_autonomy.engine.checks import CheckName
from amaze_autonomy.engine.commands import MissionAction, Request
from amaze_autonomy.engine.events import CheckReply, Event, Outcome, Reply

from . import outgoing
from .interface import CHECK_SERVICES

__all__ = ["command_of", "response_of"]

_LIMIT_NS = 3600 * 1_000_000_000  # the caller's limit is not known here
_CHECKS: Mapping[str, CheckName] = {name: check for check, name in CHECK_SERVICES.items()}


def _check(check: CheckName) -> Callable[[Any, int], Request]:
    def read(request: Any, number: int) -> Request:
        fraction = getattr(request, "required_fraction", None)
        return commands.RunCheck(
            id=number,
            limit_ns=_LIMIT_NS,
            check=check,
            mission_id=getattr(request, "mission_id", ""),
            required=tuple(getattr(request, "required", ())),
            startup_time_ns=round(getattr(request, "startup_time", 0.0) * 1e9),
            required_fraction=fraction if fraction is not None and isfinite(fraction) else None,
        )

    return read


_READERS: Mapping[str, Callable[[Any, int], Request]] = {
    **{name: _check(check) for name, check in _CHECKS.items()},
    "mission_planner/load": lambda request, number: commands.LoadMission(
        id=number,
        limit_ns=_LIMIT_NS,
        session_id=request.session_id,
        mission_id=request.mission_id,
        file_index=request.file_index,
        repetition=request.repetition,
    ),
    "mission_planner/command": lambda request, number: commands.MissionCommand(
        id=number, limit_ns=_LIMIT_NS, session_id=request.session_id, action=MissionAction(request.command)
    ),
    "data_recorder/start": lambda request, number: commands.StartRecording(
        id=number, limit_ns=_LIMIT_NS, session_id=request.session_id, mission_id=request.mission_id
    ),
    "data_recorder/stop": lambda request, number: commands.StopRecording(
        id=number, limit_ns=_LIMIT_NS, session_id=request.session_id
    ),
    "autopilot/land": lambda _, number: commands.AutopilotLand(id=number, limit_ns=_LIMIT_NS),
    "autopilot/disarm": lambda _, number: commands.AutopilotDisarm(id=number, limit_ns=_LIMIT_NS),
}

_PLAIN: Mapping[str, Callable[[bool, str], Any]] = {
    "mission_planner/load": lambda good, message: srv.LoadMissionResponse(
        accepted=good, estimated_duration=float("nan"), message=message
    ),
    "mission_planner/command": lambda good, message: srv.MissionCommandResponse(accepted=good, message=message),
    "data_recorder/start": lambda good, message: srv.StartRecordingResponse(accepted=good, message=message),
    "data_recorder/stop": lambda good, message: srv.StopRecordingResponse(accepted=good, message=message),
    "autopilot/land": lambda good, message: TriggerResponse(success=good, message=message),
    "autopilot/disarm": lambda good, message: TriggerResponse(success=good, message=message),
}


def command_of(service: str, request: Any, number: int) -> Request:
    """Return the command that a request to a service is, with an id of ours."""
    return _READERS[service](request, number)


def response_of(service: str, reply: Event, now_ns: int) -> Any:
    """Return the response of a service that says what the world replied."""
    if isinstance(reply, CheckReply):
        return outgoing.check_response(reply, now_ns)
    if not isinstance(reply, Reply):
        raise TypeError(f"{type(reply).__name__} is no reply")
    return _PLAIN[service](reply.outcome is Outcome.ACCEPTED, reply.message)
