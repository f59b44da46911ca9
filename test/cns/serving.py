"""Our planner and the simulated PX4 as the sequencer of an engine of the CNS Flight Stack; in virtual time."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from math import degrees
from typing import Any, Dict, List, Optional, Tuple

from flying import BACK, MODEL, Flying, S, plan
from flying import LINE as EAST_LINE
from stand_ins import namespace

from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.cns.peers import Publish
from amaze_autonomy.cns.served import Notice
from amaze_autonomy.cns.served_planner import LoadWaypoints, PlannerSettings, ServedPlanner
from amaze_autonomy.cns.tables import Answer, Request
from amaze_autonomy.engine.commands import AutopilotLand, MissionCommand
from amaze_autonomy.engine.events import AutopilotStatus, Mission, MissionPhase, MissionStatus, Outcome, Reply
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import Controller, Frame, MissionPlan, Trajectory, estimate_rounds

__all__ = ["BACK", "EAST_LINE", "LINE", "LIST", "MS", "POINTS", "S", "Serving", "turned"]

MS = S // 1000
POINTS = [(0.0, 0.0, 2.0, 0.0, 0.5), (8.0, 0.0, 2.0, 0.0, 0.5), (8.0, 6.0, 3.0, 90.0, 0.5)]
LINE = replace(EAST_LINE, frame=Frame.START_HEADING)
LIST: Dict[str, Any] = {"action": 0, "idx": 0, "is_global": False, "reference": 1}


class Serving:
    """One engine, of which only the words are here, and what it was answered.

    Args:
        configured: files of mission 7 in missions.yaml; `LINE` has the waypoints of `POINTS`.
        hover_s: after the last waypoint.
        more: of the mission in missions.yaml.
    """

    def __init__(self, *configured: Trajectory, hover_s: float = 60.0, **more: Any) -> None:
        self.settings = PlannerSettings(
            (replace(plan("7", configured, Controller.MISSION), **more),) if configured else (),
            Limits(),
            "begin",
            0.5,
            round(hover_s * S),
            120 * S,
        )
        self.flying = Flying()
        self.ids = count(1)
        self.served = ServedPlanner(self.ids, self.settings)
        self.answers: List[Tuple[str, str]] = []  # request, answer
        self.numbers: List[int] = []  # ids of the answers
        self.reached: List[Tuple[float, ...]] = []
        self.notices: List[str] = []
        self.commands: List[str] = []
        self.loads: List[LoadWaypoints] = []
        self.refusing: Dict[str, str] = {}  # commands that our services refuse, and why
        self.lost: Tuple[str, ...] = ()  # commands that are carried out, and whose answer does not come
        self.silent: Tuple[str, ...] = ()  # of planner, autopilot
        self.planner_forgets = False  # as one that was started again
        self.second: List[int] = []
        self._loading: Optional[Tuple[int, Any]] = None
        self.run(S)

    @property
    def t_ns(self) -> int:
        return self.flying.t_ns

    @property
    def craft(self) -> Any:
        return self.flying.craft

    @property
    def stage(self) -> str:
        return self.served.stage.name

    # --- the engine -------------------------------------------------------------------------------------------------

    def ask(self, request: Request, number: int = 7) -> Tuple[Tuple[str, str], ...]:
        """Send a request; return what is answered at once."""
        before = len(self.answers)
        self.served.heard(self.t_ns, "request", namespace({"id": number, "request": int(request)}))
        self._flush()
        return tuple(self.answers[before:])

    def give(self, points: Any = POINTS, **more: Any) -> None:
        names = ("x", "y", "z", "yaw", "holdtime")
        waypoints = [dict(zip(names, each)) for each in points]
        self.served.heard(self.t_ns, "waypoint_list", namespace({**LIST, "waypoints": waypoints, **more}))
        self._flush()

    def take_off(self) -> None:
        self.give()
        self.ask(Request.ARM)
        self.ask(Request.TAKEOFF)

    def fly(self) -> None:
        self.take_off()
        self.until_answer(Request.TAKEOFF, Answer.COMPLETED)

    def until_answer(self, request: Request, answer: Answer, limit_ns: int = 120 * S) -> None:
        self.until(lambda: (request.name, answer.name) in self.answers, limit_ns)

    # --- time -------------------------------------------------------------------------------------------------------

    def run(self, duration_ns: int) -> None:
        self.flying.until(self._over(lambda: False), duration_ns, must=False)

    def until(self, condition: Any, limit_ns: int = 120 * S) -> None:
        self.flying.until(self._over(condition), limit_ns, must=False)
        assert condition(), (self.stage, self.answers, self.notices, self.flying.status)

    def restart(self) -> None:
        """Have another process come in the place of this one."""
        self.served = ServedPlanner(self.ids, self.settings._replace(begin="again"))

    def _over(self, condition: Any) -> Any:
        def over() -> bool:
            self._step()
            return bool(condition())

        return over

    def _step(self) -> None:
        t_ns, craft = self.t_ns, self.craft
        if "planner" not in self.silent:
            status = self.flying.status
            blank = MissionStatus(t_ns=t_ns, session_id="", mission_id="", phase=MissionPhase.IDLE)
            self.served.told(t_ns, blank if self.planner_forgets else status)
        if "autopilot" not in self.silent:
            self.served.told(
                t_ns, AutopilotStatus(t_ns=t_ns, armed=craft.armed, landed=craft.landed, height_m=craft.height_m)
            )
        self.served.step(t_ns)
        self._flush()
        if self._loading is not None and self._loading[1].over:
            (number, loading), self._loading = self._loading, None
            self._reply(number, "" if loading.accepted else loading.reason)

    def _reply(self, number: int, problem: str, *, lost: bool = False) -> None:
        outcome = Outcome.TIMED_OUT if lost else Outcome.REFUSED if problem else Outcome.ACCEPTED
        self.served.replied(self.t_ns, Reply(t_ns=self.t_ns, command_id=number, outcome=outcome, message=problem))
        self._flush()

    def _flush(self) -> None:
        outbox, self.served.outbox = self.served.outbox, []
        for each in outbox:
            if isinstance(each, Publish):
                self._hear(each)
            elif isinstance(each, Notice):
                self.notices.append(each.text)
            elif isinstance(each, LoadWaypoints):
                self._load(each)
            else:
                self._carry_out(each)

    def _hear(self, said: Publish) -> None:
        fields = dict(said.fields)
        if said.key == "waypoint_reached":
            self.reached.append(tuple(fields["waypoint"].values()))
            return
        request, answer = Request(fields["request"]["request"]), Answer((fields["response"], fields["completed"]))
        self.numbers.append(fields["request"]["id"])
        self.answers.append((request.name, answer.name))

    def _load(self, command: LoadWaypoints) -> None:
        self.loads.append(command)
        if "load" in self.refusing:
            self._reply(command.id, self.refusing["load"])
            return
        files = (Trajectory("given", command.waypoints, frame=command.frame),)
        given = MissionPlan(Mission(command.mission_id), files, *estimate_rounds(files, 1.0, MODEL))
        flying, wanted = self.flying, LoadRequest(command.session_id, command.mission_id, 0, 0)
        loading, messages = flying.planner.load(flying.t_ns, wanted, given)
        flying.channel.ours(messages)
        self._loading = command.id, loading

    def _carry_out(self, command: Any) -> None:
        if isinstance(command, AutopilotLand):
            self.second.append(self.t_ns)
            self._reply(command.id, self.refusing.get("second", ""))
            return
        assert isinstance(command, MissionCommand)
        name = command.action.name
        self.commands.append(name)
        problem = self.refusing.get(name) or self.flying.command(command.action, command.session_id)
        lost = name in self.lost
        self._reply(command.id, "no answer within 1 s" if lost else problem, lost=lost)


def turned(waypoints: Any) -> List[Tuple[float, ...]]:
    """Return waypoints as its engine writes them."""
    return [(each.x_m, each.y_m, each.z_m, degrees(each.yaw_rad), each.hold_s) for each in waypoints]
