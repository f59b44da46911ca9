#!/usr/bin/env python3
"""An autonomy node that only pretends, for the tests of the console: shows what it is told and writes down the calls.

As a program it shows MISSION_INPUT until it is stopped.
"""

from __future__ import annotations

import threading
import time
from typing import Any, Callable, Dict, List, Tuple

import rospy

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy


class FakeAutonomy:
    """Topic and services of the engine under a name space.

    Args:
        name: of the engine, e.g. "/autonomy".
        without: services that it does not offer.
    """

    def __init__(self, name: str, without: Tuple[str, ...] = ()) -> None:
        self.calls: List[str] = []
        self.answers: Dict[str, Any] = {}
        self._state = msg.AutonomyState(state="MISSION_INPUT", message="Select a mission.")
        self._publisher = rospy.Publisher(f"{name}/state", msg.AutonomyState, latch=True, queue_size=10)
        kinds = {"list_missions": srv.ListMissions, "select_mission": srv.SelectMission}
        kinds["command"] = srv.UserCommand
        self._services = [
            rospy.Service(f"{name}/{service}", kind, self._handler(service))
            for service, kind in kinds.items()
            if service not in without
        ]
        self._alive = threading.Event()
        self._alive.set()
        threading.Thread(target=self._publish, daemon=True).start()

    def show(self, **fields: Any) -> None:
        """Show a state from now on."""
        defaults = {"time_left": float("nan"), "recording_progress": float("nan")}
        self._state = msg.AutonomyState(**{**defaults, **fields})
        self._publisher.publish(self._state)

    def silent(self, yes: bool) -> None:  # noqa: FBT001
        """Stop publishing, or go on."""
        (self._alive.clear if yes else self._alive.set)()

    def stop(self) -> None:
        """Take back all that was offered."""
        self.silent(yes=True)
        self._publisher.unregister()
        for service in self._services:
            service.shutdown("test is over")

    def _publish(self) -> None:
        while not rospy.is_shutdown():
            if self._alive.is_set():
                self._publisher.publish(self._state)
            time.sleep(0.5)

    def _handler(self, service: str) -> Callable[[Any], Any]:
        def handle(request: Any) -> Any:
            if service == "list_missions":
                return srv.ListMissionsResponse(missions=[_mission("1", ""), _mission("2", "no such file")])
            ids = " ".join(getattr(request, "mission_ids", ()))
            name = getattr(request, "command", service)
            self.calls.append(f"{name} {ids}".strip())
            answer = self.answers.get(name)
            if callable(answer):
                return answer()
            if service == "select_mission":
                return srv.SelectMissionResponse(*(answer or (True, "the checks are running")))
            return srv.UserCommandResponse(*(answer or (srv.UserCommandResponse.DONE, "as asked")))

        return handle


def _mission(name: str, error: str) -> Any:
    return msg.MissionInfo(
        id=name, description="Square", files=1, repetitions=1, estimated_duration=60.0, battery_needed=0.4, error=error
    )


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("autonomy")
    FakeAutonomy("/autonomy")
    rospy.spin()
