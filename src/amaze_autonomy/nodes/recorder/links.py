"""The collector's way to the recorders of the other platforms: requests with a limit, their statuses, their clocks."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

import rosgraph
import rospy

from amaze_autonomy import msg, srv
from amaze_autonomy.engine.events import RecordingPhase
from amaze_autonomy.recording.collector import Exchange, Offset, best
from amaze_autonomy.recording.status import Answer, PlatformStatus, Status

from ...ros.errors import CallError
from ...ros.interface import ros_time
from ...ros.service_client import ServiceClient

__all__ = ["PlatformLink", "read_status"]

_LIMIT_S = 2.0
_EXCHANGES = 16
_PHASES = {int(phase.value): phase for phase in RecordingPhase}
_SERVICES: Mapping[str, Any] = {
    "start": srv.StartRecording,
    "stop": srv.StopRecording,
    "remove": srv.RemovePart,
    "clock": srv.ExchangeClock,
}


def read_status(message: Any) -> Optional[Status]:
    """Read a RecordingStatus; None when it holds what cannot be."""
    phase = _PHASES.get(message.phase)
    if phase is None:
        return None
    return Status(
        session_id=message.session_id,
        phase=phase,
        progress=_fraction(message.progress),
        remaining_s=message.remaining if message.remaining >= 0.0 else None,
        platforms=tuple([_platform(each) for each in message.platforms]),
        location=message.location,
        message=message.message,
        lost=message.lost,
    )


def _platform(message: Any) -> PlatformStatus:
    return PlatformStatus(
        platform=message.platform,
        growing=message.growing,
        written_bytes=message.bytes,
        byte_rate=message.byte_rate,
        free_fraction=_fraction(message.free_fraction),
        location=message.location,
        message=message.message,
        dropped=message.dropped,
        cpu_fraction=_fraction(message.cpu_fraction),
    )


def _fraction(value: float) -> Optional[float]:
    return value if 0.0 <= value <= 1.0 else None


class PlatformLink:
    """One other platform.

    Args:
        name: of the platform.
        heard: called with each of its statuses, on rospy's threads.
        wall_ns: the clock that stamps.
    """

    def __init__(self, name: str, heard: Callable[[str, Status], None], wall_ns: Callable[[], int]) -> None:
        self._name, self._heard, self._wall_ns = name, heard, wall_ns
        master, me = rosgraph.get_master_uri(), rospy.get_name()
        self._clients: Dict[str, ServiceClient] = {
            verb: ServiceClient(rospy.resolve_name(f"{name}/data_recorder/{verb}"), service, master, me)
            for verb, service in _SERVICES.items()
        }
        self._subscriber = rospy.Subscriber(
            f"{name}/data_recorder/status", msg.RecordingStatus, self._take, queue_size=10, tcp_nodelay=True
        )

    def _take(self, message: Any) -> None:
        status = read_status(message)
        if status is not None:
            age_s = round((self._wall_ns() - message.header.stamp.to_nsec()) * 1e-9, 2)  # without noise
            aged = tuple([replace(each, clock_age_s=age_s) for each in status.platforms])
            self._heard(self._name, replace(status, platforms=aged))

    def ask(self, verb: str, session_id: str, **more: Any) -> Answer:
        """Ask for something, waiting for the answer; `more` are further fields of the request.

        Raises:
            CallError: There was none within the limit.
        """
        client = self._clients[verb]
        request = _SERVICES[verb]._request_class(session_id=session_id, **more)
        response = client.call(client.serialize(request), time.monotonic() + _LIMIT_S)
        return Answer(bool(response.accepted), str(response.message))

    def offset(self) -> Tuple[Optional[Offset], str]:
        """Return the offset of its clock, or why it could not be measured."""
        client = self._clients["clock"]
        exchanges: List[Exchange] = []
        problem = ""
        for _ in range(_EXCHANGES):
            sent_ns = self._wall_ns()
            request = srv.ExchangeClockRequest(sent=ros_time(sent_ns))
            try:
                response = client.call(client.serialize(request), time.monotonic() + _LIMIT_S)
            except CallError as error:
                problem = str(error)
                break
            arrived_ns = self._wall_ns()
            exchanges.append(Exchange(sent_ns, response.received.to_nsec(), response.answered.to_nsec(), arrived_ns))
        return best(exchanges), problem

    def close(self) -> None:
        """Forget it."""
        self._subscriber.unregister()
        for client in self._clients.values():
            client.close()
