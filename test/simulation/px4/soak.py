"""Missions in a row over a bad radio, in virtual time: planner and autopilot client as they fly, and the simulated PX4.

Each has a link of its own; all messages go as bytes over lines that lose, delay and cut. What the vehicle did is read
from the vehicle: each thing that a command causes must have happened once.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from typing import Dict, List, NamedTuple, Tuple

from bad_line import BadLine, Quality

from amaze_autonomy.autopilot.link.connection import heartbeat
from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.autopilot.planner.sequencer import PLANNER_MESSAGES, Sequencer, SequencerSettings
from amaze_autonomy.autopilot.vehicle.client import CLIENT_MESSAGES, AutopilotClient
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import Mission, MissionPhase, VehicleLanded
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import (
    Controller,
    FlightModel,
    MissionPlan,
    PlannerSpec,
    Trajectory,
    Waypoint,
    estimate_rounds,
)
from amaze_autonomy.monitoring.preflight_specs import BatterySpec
from amaze_autonomy.simulation.px4 import Craft, Framing, Px4
from amaze_autonomy.simulation.vehicle.flight import VehicleSettings
from amaze_autonomy.simulation.vehicle.vehicle import Power, PowerSettings

MS, S = 1_000_000, 1_000_000_000
_STEP_NS, _WAKE_NS = 20 * MS, 50 * MS
_LIMIT_NS, _NEAR_M = 90 * S, 0.7
_MODEL = FlightModel(cruise_speed_m_s=3.0, climb_speed_m_s=2.0, landing_speed_m_s=1.0, acceleration_m_s2=4.0)
_FILES = {
    name: Trajectory(
        f"{name}.csv",
        (
            Waypoint(0.0, 0.0, 2.0, 0.0, 0.0),
            Waypoint(way * 6.0, 0.0, 2.0, 0.0, 1.0),
            Waypoint(way * 6.0, way * 4.0, 3.0, 1.57, 0.0),
        ),
    )
    for name, way in (("out", 1.0), ("back", -1.0))
}
_ONCE = {"armed": 1, "takeoff": 1, "airborne": 1, "waypoint": 3, "land": 1, "landed": 1, "disarmed": 1}


class Flown(NamedTuple):
    """What came of one mission.

    Args:
        number: of the mission, from 0.
        problem: empty when it was flown as commanded.
        happened: what the vehicle did, by name.
        loads: how often it was sent.
        orders: how often a command was refused because the vehicle was not heard.
        lasted_s: from the first loading to the landing.
    """

    number: int
    problem: str
    happened: Dict[str, int]
    loads: int
    orders: int
    lasted_s: float


class _Radio:
    """A client and its two lines to the vehicle."""

    def __init__(self, name, client, wanted, component, quality, seed):
        self.name, self.client, self.wanted = name, client, frozenset((*wanted, "HEARTBEAT"))
        self.up, self.down = BadLine(quality, 2 * seed), BadLine(quality, 2 * seed + 1)
        self.ours, self.theirs = Framing(1, component), Framing(1, 1)
        self.here, self.there = Framing(1, component), Framing(1, 1)

    def send(self, t_ns, messages):
        for message in messages:
            self.up.send(t_ns, self.ours.encode(message))


class Soak:
    """Everything of it.

    Args:
        quality: of all lines.
        seed: of losses, delays and cuts.
        cut_s: shortest and longest cut, one in each mission.
    """

    def __init__(self, quality: Quality, seed: int = 1, cut_s: Tuple[float, float] = (1.0, 4.0)) -> None:
        self._chance, self._cut_s = random.Random(seed), cut_s
        self.craft = Craft(VehicleSettings(model=_MODEL, spin_up_ns=S // 2, ground_ns=S // 2))
        self._power = Power(PowerSettings(flight_endurance_s=1e9, idle_endurance_s=1e9))
        self.px4 = Px4(self.craft, self._power)
        self.planner = Sequencer(SequencerSettings(_plans(), PlannerSpec(), _MODEL, Limits(takeoff_height_m=2.0)))
        self.autopilot = AutopilotClient(AutopilotSettings(), BatterySpec(), lambda: (1, 1))
        self._radios = (
            _Radio("planner", self.planner, PLANNER_MESSAGES, 192, quality, 2 * seed),
            _Radio("autopilot", self.autopilot, CLIENT_MESSAGES, 191, quality, 2 * seed + 1),
        )
        for radio in self._radios:
            self.px4.connect(radio.name, "gcs")
        self.t_ns = self._wake_ns = self._beat_ns = 0
        self.happened: List[str] = []
        self._until(lambda: False, 5 * S)

    @property
    def lost(self) -> int:
        """How many frames were lost."""
        return sum(radio.up.lost + radio.down.lost for radio in self._radios)

    def fly(self, number: int, *, hold: bool = False) -> Flown:
        """Fly one mission, out or back, and say what came of it."""
        begin_ns, session, mission = self.t_ns, f"session {number}", "back" if number % 2 else "out"
        self._cut(begin_ns)
        loads, problem, orders = self._take_off(session, mission)
        if not problem and hold:
            problem = self._hold(session)
        if not problem and not self._until(lambda: self._phase is MissionPhase.LANDED, _LIMIT_NS):
            problem = f"stuck: {self.planner.status(self.t_ns)}"
        self._until(lambda: self._shown_on_ground, 10 * S)
        happened = dict(Counter(self.happened))
        return Flown(
            number,
            problem or self._wrong(happened, mission, hold=hold),
            happened,
            loads,
            orders,
            (self.t_ns - begin_ns) / S,
        )

    # --- steps of a mission ---------------------------------------------------------------------------------------

    def _cut(self, begin_ns):
        """Cut all lines once, somewhere between loading and landing."""
        at_ns = begin_ns + round(self._chance.uniform(0.0, 20.0) * S)
        end_ns = at_ns + round(self._chance.uniform(*self._cut_s) * S)
        for radio in self._radios:
            radio.up.cut(at_ns, end_ns)
            radio.down.cut(at_ns, end_ns)

    def _load(self, session, mission):
        """Send the mission until it is there, as an operator would who retries."""
        for loads in range(1, 6):
            loading, messages = self.planner.load(self.t_ns, LoadRequest(session, mission, 0, 0))
            self._radios[0].send(self.t_ns, messages)
            self._until(lambda loading=loading: loading.over, 30 * S)
            if loading.accepted:
                return loads
            self._until(lambda: False, S)
        raise AssertionError(f"{session} could not be loaded: {loading.reason}")

    def _order(self, session, action):
        """Command something; what was not heard yet is refused, so it is asked again."""
        for orders in range(20):
            problem, messages = self.planner.command(self.t_ns, session, action)
            self._radios[0].send(self.t_ns, messages)
            if not any(words in problem for words in ("silent", "position", "on the ground")):
                return problem, orders
            self._until(lambda: False, S)
        return f"{action.name} refused: {problem}", orders

    def _take_off(self, session, mission):
        """Load and take off; what a silence has ended is landed, as the engine does, and begun again."""
        loads = 0
        for _ in range(3):
            self._start = self.craft.position_m
            self.happened.clear()
            loads += self._load(session, mission)
            problem, orders = self._order(session, MissionAction.TAKEOFF)
            taken = (MissionPhase.FLYING, MissionPhase.FAILED, MissionPhase.LANDED, MissionPhase.LANDING)
            self._until(lambda taken=taken: self._phase in taken, 40 * S)
            if problem or self._phase is not MissionPhase.FAILED:
                break
            self._order(session, MissionAction.LAND)
            self._until(lambda: self._phase is MissionPhase.LANDED and self._shown_on_ground, 40 * S)
        return loads, problem, orders

    def _hold(self, session):
        self._until(lambda: math.dist(self.craft.position_m, self._start) > 4.0, 40 * S)
        problem = self._shown(session, MissionAction.HOLD, (MissionPhase.HOLDING,))
        goes_on = (MissionPhase.FLYING, MissionPhase.LANDING, MissionPhase.LANDED)
        return problem or self._shown(session, MissionAction.RESUME, goes_on)

    def _shown(self, session, action, phases):
        """Command something until its phase is shown, again after a silence has ended it; return what is wrong."""
        for _ in range(3):
            problem, _ = self._order(session, action)
            self._until(lambda: self._phase in phases or "ended" in self.planner.status(self.t_ns).message, 20 * S)
            if problem or self._phase in phases:
                return problem
        return f"{action.name}: {self.planner.status(self.t_ns)}"

    def _wrong(self, happened, mission, *, hold):
        """Say what happened too often, too seldom, or in the wrong place."""
        expected = {**_ONCE, "hold": int(hold), "mission": 1 + hold, "pilot": 0}
        wrong = {name: happened.get(name, 0) for name, times in expected.items() if happened.get(name, 0) != times}
        if wrong:
            return f"happened: {wrong}, not { ({name: expected[name] for name in wrong}) }"
        last = _FILES[mission].waypoints[-1]
        goal = (self._start[0] + last.x_m, self._start[1] + last.y_m, 0.0)
        if math.dist(self.craft.position_m, goal) > _NEAR_M:
            return f"landed at {self.craft.position_m}, not at {goal}"
        if self.planner.status(self.t_ns).waypoint != len(_FILES[mission].waypoints):
            return f"{self.planner.status(self.t_ns)}"
        return "" if self._shown_on_ground else "the autopilot client does not know that it has landed"

    @property
    def _phase(self):
        return self.planner.status(self.t_ns).phase

    @property
    def _shown_on_ground(self):
        status = self.autopilot.vehicle.status(self.t_ns)
        return status.armed is False and status.landed is VehicleLanded.ON_GROUND

    # --- time -----------------------------------------------------------------------------------------------------

    def _until(self, condition, limit_ns):
        """Let time pass until something is so; return whether it is."""
        end_ns = self.t_ns + limit_ns
        while self.t_ns < end_ns:
            if condition():
                return True
            self._step(self.t_ns + _STEP_NS)
        return bool(condition())

    def _step(self, t_ns):
        self.t_ns = t_ns
        self.craft.advance(t_ns)
        self.happened += self.craft.happened
        self.craft.happened.clear()
        for radio in self._radios:
            for data in radio.up.due(t_ns):
                for message in radio.there.decode(data):
                    self.px4.receive(t_ns, radio.name, message)
        links = {radio.name: radio for radio in self._radios}
        for name, message in self.px4.advance(t_ns):
            links[name].down.send(t_ns, links[name].theirs.encode(message))
        wakes, beats = t_ns >= self._wake_ns, t_ns >= self._beat_ns
        self._wake_ns, self._beat_ns = self._wake_ns + wakes * _WAKE_NS, self._beat_ns + beats * S
        for radio in self._radios:
            self._serve(t_ns, radio, wakes=wakes, beats=beats)

    @staticmethod
    def _serve(t_ns, radio, *, wakes, beats):
        for data in radio.down.due(t_ns):
            for message in radio.here.decode(data):
                if message.get_type() in radio.wanted:
                    radio.send(t_ns, radio.client.receive(t_ns, message))
        if wakes:
            radio.send(t_ns, radio.client.wake(t_ns))
        if beats:
            radio.send(t_ns, (heartbeat(mavlink.MAV_TYPE_ONBOARD_CONTROLLER),))


def _plans():
    plans = []
    for name, trajectory in _FILES.items():
        first, again = estimate_rounds((trajectory,), 2.0, _MODEL)
        plans.append(MissionPlan(Mission(id=name), (trajectory,), first, again, None, Controller.MISSION))
    return tuple(plans)
