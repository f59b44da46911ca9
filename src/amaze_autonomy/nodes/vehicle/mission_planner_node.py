"""The mission planner node: sends missions to the autopilot, and takes off, holds, resumes and lands.

    mission_planner/load      LoadMission; answers when the waypoint file was read back the same, or says why not
    mission_planner/load_waypoints  LoadWaypoints; the same with waypoints of somebody who plans elsewhere
    mission_planner/command   MissionCommand; answers at once, the status tells when it is done
    mission_planner/status    MissionStatus, 5 Hz and at once on a change
    /diagnostics              diagnostic_msgs/DiagnosticArray, 1 Hz
    autopilot/commanding      std_msgs/String: what the autopilot node commands; it stands here as well (subscribed)

Missions: missions.yaml; its link: autopilot.yaml, planner_link. Parameters: `node_main.py`. It has an endpoint and a
component id of its own, so that the autopilot node lands when it hangs. On SIGINT or SIGTERM in flight it commands the
landing mode, keeps its stream of set-points up until the vehicle shows it, and ends; not when a pilot has control.
How it works: docs/planner.md.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from functools import partial
from typing import Any, Callable, Dict, Optional, Tuple

import rospy
from std_msgs.msg import String

from amaze_autonomy import msg, srv
from amaze_autonomy.config import Configuration
from amaze_autonomy.config.trajectories import plan_of_waypoints
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase, MissionStatus
from amaze_autonomy.missions import Frame, MissionPlan, Waypoint, WaypointError
from amaze_autonomy.ros.clock import Clock

from ...autopilot.link.connection import link_problem
from ...autopilot.link.state_files import keep, origin_from, origin_to, read_kept
from ...autopilot.planner.loading import Loading, LoadRequest
from ...autopilot.planner.mission_vehicle import streams_hz
from ...autopilot.planner.sequencer import GUARD_S, PLANNER_MESSAGES, Sequencer, SequencerSettings
from ...engine.events import Check, Verdict
from ...ros.interface import CheckDiagnostics, status_message
from ...ros.node_main import run_node
from ..autonomy.run_folder import default_parent
from .vehicle_link import ChangeLog, LevelLoop, Link, make_link, tell_link

_S = 1_000_000_000
_QUEUE = 10
_ANSWER_S = 1.0  # beyond the limit of a transfer
_FRAMES = {
    srv.LoadWaypointsRequest.EAST_NORTH: Frame.EAST_NORTH,
    srv.LoadWaypointsRequest.START_HEADING: Frame.START_HEADING,
}
_ACTIONS = {action.value: action for action in MissionAction}


class MissionPlannerNode:
    """A sequencer on a link, and the ROS names around it.

    Args:
        configuration: as loaded.
        clock: the node's.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        self._clock, self._configuration = clock, configuration
        self._spec = spec = configuration.planner
        self._exit_s = configuration.autopilot.commands.exit_limit_ns / _S
        limits, rates_hz = configuration.rules.limits, streams_hz(configuration.autopilot)
        settings = SequencerSettings(configuration.plans, spec, configuration.flight, limits, rates_hz)
        self._kept = default_parent() / f"{rospy.get_name().strip('/').replace('/', '.')}.json"
        self.planner = Sequencer(settings, origin_from(read_kept(self._kept)), lambda: time.time_ns() - clock.now_ns())
        autopilot = configuration.autopilot
        self._autopilot = autopilot
        self._link: Link = make_link(autopilot, autopilot.planner_link, self.planner, PLANNER_MESSAGES, clock)
        period_ns = round(_S / configuration.streams.planner_status_rate_hz)
        self._loop = LevelLoop(self._link, clock, period_ns, self.planner.level, self._tell)
        self._publisher = rospy.Publisher(
            "mission_planner/status", msg.MissionStatus, queue_size=_QUEUE, tcp_nodelay=True
        )
        self._diagnostics = CheckDiagnostics("mission planner", clock)
        self._problem, self._said = "", ChangeLog()

    # --- services; on rospy's threads -----------------------------------------------------------------------------

    def _load(self, request: Any) -> Any:
        wanted = LoadRequest(request.session_id, request.mission_id, request.file_index, request.repetition)
        return srv.LoadMissionResponse(**self._loaded(wanted))

    def _load_waypoints(self, request: Any) -> Any:
        wanted = LoadRequest(request.session_id, request.mission_id, 0, 0)
        frame = _FRAMES.get(request.frame)
        numbered = enumerate(request.waypoints, start=1)
        waypoints = [Waypoint(each.x, each.y, each.z, each.yaw, each.hold, line) for line, each in numbered]
        try:
            plan = plan_of_waypoints(self._configuration, request.mission_id, frame, waypoints)
        except WaypointError as error:
            self._log(f"load {wanted.mission_id}", str(error))
            return srv.LoadWaypointsResponse(accepted=False, estimated_duration=math.nan, message=str(error))
        return srv.LoadWaypointsResponse(**self._loaded(wanted, plan))

    def _loaded(self, wanted: LoadRequest, plan: Optional[MissionPlan] = None) -> Dict[str, Any]:
        """Send a file to the vehicle; return the fields of the answer."""
        loading: Loading = self._link.ask(lambda t_ns: self.planner.load(t_ns, wanted, plan))
        self._link.wait_for(lambda: loading.over or self._loop.ended, self._spec.transfer_limit_ns / _S + _ANSWER_S)
        accepted, reason = loading.accepted, loading.reason or "the planner ends"
        if accepted:
            self._keep(loading)
        self._log(f"load mission {wanted.mission_id}, file {wanted.file_index + 1}", "" if accepted else reason)
        return {
            "accepted": accepted,
            "waypoints": len(loading.trajectory.waypoints) if accepted else 0,
            "estimated_duration": loading.duration_s,
            "message": "" if accepted else reason,
        }

    def _keep(self, loading: Loading) -> None:
        """Keep the session's origin for a planner that is started again between its files."""
        kept = {} if loading.origin is None else origin_to(loading.origin)
        if kept and kept != read_kept(self._kept):
            try:
                keep(self._kept, kept)
            except OSError as error:
                rospy.logwarn("%s: %s; a planner that starts again will not know the session", self._kept, error)

    def _command(self, request: Any) -> Any:
        action = _ACTIONS.get(request.command)
        if action is None:
            problem = f"there is no command {request.command}"
        else:
            problem = self._link.ask(lambda t_ns: self.planner.command(t_ns, request.session_id, action))
        self._log(action.name if action else "command", problem)
        return srv.MissionCommandResponse(accepted=not problem, message=problem)

    def _log(self, what: str, problem: str) -> None:
        self._said.log(what, problem or "accepted", warns=bool(problem))

    def _take_other(self, message: Any) -> None:
        """Take what the autopilot node commands."""
        self._link.ask(lambda t_ns: (None, self.planner.other_commands(t_ns, message.data)))

    # --- the node's own thread ------------------------------------------------------------------------------------

    def run(self) -> None:
        """Publish until `end`; then land, where it flies."""
        self._link.start()
        rospy.Subscriber("autopilot/commanding", String, self._take_other, queue_size=_QUEUE, tcp_nodelay=True)
        rospy.Service("mission_planner/load", srv.LoadMission, self._load)
        rospy.Service("mission_planner/load_waypoints", srv.LoadWaypoints, self._load_waypoints)
        rospy.Service("mission_planner/command", srv.MissionCommand, self._command)
        try:
            self._loop.run()
        finally:
            self._leave()
            self._link.close()

    def _tell(self, now_ns: int) -> None:
        status = self._status()
        self._publisher.publish(status_message(status, self._clock.ros_ns()))
        self._diagnostics.publish(now_ns, self._rows(status, now_ns))
        self._tell_link(now_ns)

    def _status(self) -> MissionStatus:
        status: MissionStatus = self._link.ask(lambda t_ns: (self.planner.status(t_ns), ()))
        return status

    def _rows(self, status: MissionStatus, now_ns: int) -> Tuple[Check, ...]:
        beat_ns, limit_s = self._link.state.heartbeat_ns, self._spec.vehicle_age_limit_ns / _S
        age_s = None if beat_ns is None else (now_ns - beat_ns) / _S
        good = age_s is not None and age_s <= limit_s
        failed = status.phase is MissionPhase.FAILED
        return (
            Check(
                "link",
                Verdict.PASS if good else Verdict.FAIL,
                age_s,
                limit_s,
                "s",
                advice="" if good else "see docs/planner.md",
            ),
            Check(f"phase {status.phase.name}", Verdict.FAIL if failed else Verdict.PASS, advice=status.message),
        )

    def _tell_link(self, now_ns: int) -> None:
        """Log what has become of the link, once for each change."""
        problem = link_problem(self._link.state, now_ns)
        if problem != self._problem:
            self._problem = problem
            tell_link("mission planner", self._autopilot, self._autopilot.planner_link, problem)

    def _leave(self) -> None:
        """Land before the link is closed, where it flies and no pilot does; on the ground, take back an arming."""
        if not self._link.ask(self.planner.shutdown):
            return
        until_s = time.monotonic() + (max(self._exit_s, GUARD_S) if self.planner.guards else self._exit_s)
        self._wait(lambda: not self.planner.landing_waits, until_s)
        shown = self._show_landing(until_s)
        taken: str = self._link.ask(lambda _: (self.planner.landing_taken, ()))
        where, does, command = "in flight", "lands", "landing"
        if self.planner.takes_back:
            where, does, command = "on the ground", "is disarmed", "disarming"
            shown = shown and self.planner.watch.armed is False
        said = taken or (f"the vehicle {does}" if shown else f"a {command} was commanded and is not confirmed")
        print(f"mission_planner: ended {where}: {said}", flush=True)

    def _show_landing(self, until_s: float) -> bool:
        """Say what it does, and again where that changes; return whether the vehicle has shown it in time."""
        planner = self.planner
        told: Optional[bool] = None
        while planner.takes_back is not told:
            told = planner.takes_back
            if not planner.landing_waits and not planner.landing_taken:
                last: MissionStatus = self._link.ask(lambda t_ns: (planner.last_status(t_ns), ()))
                with suppress(rospy.ROSException):  # the master has closed the topic
                    self._publisher.publish(status_message(last, self._clock.ros_ns()))
            self._wait(partial(self._is_shown, told=told), until_s)
        return planner.landing_shown

    def _is_shown(self, *, told: bool) -> bool:
        return self.planner.landing_shown or self.planner.takes_back is not told

    def _wait(self, condition: Callable[[], bool], until_s: float) -> None:
        self._link.wait_for(condition, max(0.0, until_s - time.monotonic()))

    def end(self) -> None:
        """End; from any thread."""
        self._loop.end()


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("mission_planner", MissionPlannerNode)
