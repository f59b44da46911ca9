"""Stand-ins for the five nodes of the CNS Flight Stack, as they were seen to behave; pure, in the time they are given.

Each takes `call` (a service) or `take` (a topic) and answers through `said` (messages) and `returned` (ends of calls),
as (key, fields); fields are plain values, so that a test over ROS can make messages of them.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, Dict, List, Optional, Tuple

from amaze_autonomy.missions import Waypoint

S = 1_000_000_000
UNDEF, NOMINAL, STARTING, DEFECT, ERROR = 0, 1, 2, 4, 8
ARM, TAKEOFF, HOLD, RESUME, LAND, HOVER, ABORT, DISARM = range(1, 9)


def namespace(value: Any) -> Any:
    """Return plain fields as something with attributes, as messages are."""
    if isinstance(value, dict):
        return SimpleNamespace(**{name: namespace(each) for name, each in value.items()})
    return [namespace(each) for each in value] if isinstance(value, list) else value


class StandIn:
    """What they have in common.

    Args:
        vehicle: the simulated one.
    """

    peer = ""

    def __init__(self, vehicle: Any, **faults: Any) -> None:
        self.vehicle, self.faults = vehicle, faults
        self.said: List[Tuple[str, Dict[str, Any]]] = []
        self.returned: List[Tuple[str, Dict[str, Any]]] = []
        self.calls: List[Tuple[str, Dict[str, Any]]] = []
        self._due: List[Tuple[int, str, Dict[str, Any]]] = []

    def call(self, t_ns: int, key: str, fields: Dict[str, Any]) -> None:  # noqa: ARG002
        self.calls.append((key, dict(fields)))

    def take(self, t_ns: int, key: str, fields: Dict[str, Any]) -> None:  # noqa: ARG002
        self.calls.append((key, dict(fields)))

    def step(self, t_ns: int) -> None:
        for due_ns, key, fields in list(self._due):
            if t_ns >= due_ns:
                self._due.remove((due_ns, key, fields))
                self.returned.append((key, fields))


class Watchdog(StandIn):
    """Blocks its start call, beats at its rate from then on, and says only changes; a second start begins anew.

    Args:
        vehicle: the simulated one.
        entities: that it watches.
        rate_hz: of its checks.
        starting_s: how long each is STARTING.
    """

    peer = "watchdog"

    def __init__(
        self,
        vehicle: Any,
        entities: Tuple[str, ...] = (),
        rate_hz: float = 2.0,
        starting_s: float = 1.0,
        **faults: Any,
    ) -> None:
        super().__init__(vehicle, **faults)
        self._rows = dict.fromkeys(entities, STARTING)
        self._rate_hz, self._starting_s = rate_hz, starting_s
        self._started_ns: Optional[int] = None
        self._next_ns = 0
        self.failing: Dict[str, int] = {}
        self.answers: List[bool] = []

    def call(self, t_ns: int, key: str, fields: Dict[str, Any]) -> None:
        super().call(t_ns, key, fields)
        self._started_ns = self._next_ns = t_ns
        self._rows = dict.fromkeys(self._rows, STARTING)
        startup_s = self.faults.get("startup_s", fields["startup_time"])
        end_ns = t_ns + round((startup_s + 2 / self._rate_hz) * S)
        self._due.append((end_ns, key, {"successful": None, "status": {}, "entity_ids": []}))

    def _answer(self, t_ns: int) -> None:
        """Say yes at the end of a call where the worst is NOMINAL or DEFECT at that instant."""
        for due_ns, _, fields in self._due:
            if t_ns >= due_ns:
                fields["successful"] = all(status in (NOMINAL, DEFECT) for status in self._rows.values())
                self.answers.append(fields["successful"])

    def _status(self, entity: str) -> Dict[str, Any]:
        info = "rate 0" if self._rows[entity] == ERROR else ""
        return {"entity": entity, "type": 1, "status": self._rows[entity], "name": f"/{entity}", "info": info}

    def step(self, t_ns: int) -> None:
        self._answer(t_ns)
        super().step(t_ns)
        if self._started_ns is None or t_ns < self._next_ns:
            return
        first = self._next_ns == self._started_ns
        self._next_ns += round(S / self._rate_hz)
        before = dict(self._rows)
        for entity in self._rows:
            up = NOMINAL if t_ns - self._started_ns >= self._starting_s * S else STARTING
            self._rows[entity] = self.failing.get(entity, up)
        changed = [entity for entity in self._rows if first or self._rows[entity] != before[entity]]
        if changed and not self.faults.get("log_lost"):
            data = {
                "changes": [self._status(each) for each in changed],
                "current": [self._status(each) for each in self._rows],
            }
            self.said.append(("log", {"data": data}))
        if not self.faults.get("silent"):
            worst = max(self._rows, key=lambda each: self._rows[each])
            self.said.append(("heartbeat", {"status": {**self._status(worst), "entity": "", "name": "", "type": 0}}))


class LandingDetector(StandIn):
    """Is armed by its service; then one message for each event."""

    peer = "landing_detection"

    def __init__(self, vehicle: Any, **faults: Any) -> None:
        super().__init__(vehicle, **faults)
        self._armed = self._flew = False

    def start_again(self) -> None:
        """Be another process: not armed, and asked nothing."""
        self._armed = self._flew = False
        self._due, self.said, self.returned = [], [], []

    def call(self, t_ns: int, key: str, fields: Dict[str, Any]) -> None:
        super().call(t_ns, key, fields)
        good = not self.faults.get("not_flat")
        self._armed = self._armed or good
        self._due.append((t_ns + S // 100, key, {"success": good, "message": "" if good else "not flat"}))

    def step(self, t_ns: int) -> None:
        super().step(t_ns)
        if self._armed and self.vehicle.height_m > 0.5 and not self._flew:
            self._flew = True
            self.said.append(("is_takeoff", {"data": True}))
        elif self._flew and not self.vehicle.airborne:
            self._flew = False
            self.said.append(("is_landed", {"data": True}))


class Supervisor(StandIn):
    """Answers after its window and 0.2 s; never while its topic is silent."""

    peer = "state_estimation"
    WINDOW_S = 10.0

    def call(self, t_ns: int, key: str, fields: Dict[str, Any]) -> None:
        super().call(t_ns, key, fields)
        window_s = self.faults.get("window_s", self.WINDOW_S)
        if not self.faults.get("silent"):
            self._due.append((t_ns + round((window_s + 0.2) * S), key, {"success": True, "message": ""}))


class Recorder(StandIn):
    """Says yes, whatever happens; its stop runs its store script inside the call."""

    peer = "data_recorder"
    STOP_S = 10.0

    def __init__(self, vehicle: Any, **faults: Any) -> None:
        super().__init__(vehicle, **faults)
        self.written, self.open_files = 4096, 0

    def call(self, t_ns: int, key: str, fields: Dict[str, Any]) -> None:
        super().call(t_ns, key, fields)
        lies = self.faults.get("lies")
        self.open_files = 1 if (fields["data"] and not lies) or self.faults.get("stays_open") else 0
        seconds = 0.05 if fields["data"] else self.faults.get("stop_s", self.STOP_S)
        self._due.append((t_ns + round(seconds * S), key, {"success": True, "message": ""}))

    def step(self, t_ns: int) -> None:
        super().step(t_ns)
        self.written += 100_000 if self.open_files else 0
        if self.faults.get("moves_away") and self.returned and not self.open_files:
            self.written = 4096


class Sequencer(StandIn):
    """Flies the simulated vehicle as its requests and waypoints say, and answers in pairs."""

    peer = "mission_planner"
    ARM_S = 2.6

    def __init__(self, vehicle: Any, **faults: Any) -> None:
        super().__init__(vehicle, **faults)
        self._state, self._before, self._id, self._arming_ns = "idle", "idle", 0, 0
        self._start = (0.0, 0.0, 0.0)
        self._points: List[Dict[str, float]] = []
        self._told = 0

    def _say(self, request: int, *, response: bool, completed: bool) -> None:
        fields = {"request": {"id": self._id, "request": request}, "response": response, "completed": completed}
        self.said.append(("response", fields))

    def take(self, t_ns: int, key: str, fields: Dict[str, Any]) -> None:
        super().take(t_ns, key, fields)
        if self._counted("ignores", fields.get("request", key)):
            return
        if key == "waypoint_list":
            self._fly(fields["waypoints"])
            return
        request = fields["request"]
        if self._state == "idle":
            self._id = fields["id"]
        self._answer(t_ns, request, fits=fields["id"] == self._id and not self._counted("refuses", request))

    def _counted(self, fault: str, what: Any) -> bool:
        """Return whether a fault is due, of those that come so many times."""
        times = self.faults.get(fault, {})
        times[what] = times.get(what, 0) - 1
        return bool(times[what] >= 0)

    def _answer(self, t_ns: int, request: int, *, fits: bool) -> None:
        flying = self._state in ("takeoff", "hover", "mission", "hold", "land")
        if fits and request == ARM and self._state == "idle":
            self._state, self._arming_ns = "arm", t_ns
            self._say(ARM, response=True, completed=False)
        elif fits and request == TAKEOFF and self._state == "armed":
            self._take_off()
        elif fits and request == HOLD and self._state in ("takeoff", "hover", "mission", "land"):
            self._before, self._state = self._state, "hold"
            self.vehicle.hold()
            self._say(HOLD, response=True, completed=True)
        elif fits and request == RESUME and self._state == "hold":
            self._state = self._before
            self.vehicle.resume()
            self._say(RESUME, response=True, completed=True)
        elif fits and request == LAND and flying and self._state != "land":
            self._state = "land"
            if not self.faults.get("lands_not"):
                self.vehicle.land()
            self._say(LAND, response=True, completed=False)
        elif fits and request == ABORT and flying:
            self._say(ABORT, response=True, completed=True)
            self._say(ABORT, response=False, completed=False)  # and nothing happens
        elif fits and request == DISARM and self._state in ("arm", "armed", "landed"):
            self._state = "disarm"
            self._say(DISARM, response=True, completed=False)
        else:
            self._say(request, response=False, completed=False)

    def _take_off(self) -> None:
        x, y, _ = self.vehicle.position_m
        self._start, self._state = (x, y, self.vehicle.yaw_rad), "takeoff"
        height = self.vehicle.settings.takeoff_height_m
        self.vehicle.upload((Waypoint(x, y, height, self.vehicle.yaw_rad, 0.0),))
        self.vehicle.take_off()
        self._say(TAKEOFF, response=True, completed=False)

    def _fly(self, points: List[Dict[str, float]]) -> None:
        if self._state == "hold" and self._before == "hover" and self.faults.get("takes_in_hold"):
            self._before = "mission"
        elif self._state == "hover":
            self._state = "mission"
        else:
            return
        skipped = self.faults.get("skips", ())
        self._points = [each for number, each in enumerate(points, start=1) if number not in skipped]
        x, y, heading = self._start
        cosine, sine = math.cos(heading), math.sin(heading)
        self.vehicle.waypoints = tuple(
            Waypoint(
                x + cosine * each["x"] - sine * each["y"],
                y + sine * each["x"] + cosine * each["y"],
                each["z"],
                heading + math.radians(each["yaw"]),
                each["holdtime"],
            )
            for each in self._points
        )
        self.vehicle.reached, self.vehicle._leave_at, self._told = 0, None, 0

    def step(self, t_ns: int) -> None:
        super().step(t_ns)
        vehicle = self.vehicle
        if self._state == "arm" and t_ns - self._arming_ns >= self.ARM_S * S and not self.faults.get("arms_never"):
            self._state = "armed"
            self._say(ARM, response=False, completed=True)
        elif self._state == "takeoff" and vehicle.reached and not self.faults.get("climbs_for_ever"):
            self._state = "hover"
            self._say(TAKEOFF, response=False, completed=True)
        elif self._state == "mission":
            self._report()
        elif self._state == "land" and not vehicle.airborne and not self.faults.get("lands_not"):
            self._state = "landed"
            self._say(LAND, response=False, completed=True)
        elif self._state == "disarm" and not vehicle.airborne:
            vehicle.disarm()
            self._state = "idle"
            self._say(DISARM, response=False, completed=True)

    def _report(self) -> None:
        while self._told < min(self.vehicle.reached, len(self._points)):
            self.said.append(("waypoint_reached", {"waypoint": dict(self._points[self._told])}))
            self._told += 1
        if self.vehicle.finished and self._told >= len(self._points):
            self._state = "hover"
            self._say(UNDEF, response=False, completed=True)


STAND_INS = (Watchdog, LandingDetector, Supervisor, Sequencer, Recorder)
