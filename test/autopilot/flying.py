"""A planner and the simulated PX4 on a channel, in virtual time."""

from __future__ import annotations

import heapq
from typing import Any, Callable, List, Tuple

from mission_channel import MS, Channel, S, good

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.autopilot.planner.sequencer import PLANNER_MESSAGES, Sequencer, SequencerSettings
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import Mission, MissionPhase
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
from amaze_autonomy.simulation.ardupilot import ArduCraft, ArduPilot
from amaze_autonomy.simulation.px4 import Craft, Px4, Px4Settings
from amaze_autonomy.simulation.vehicle.vehicle import Power, PowerSettings, VehicleSettings

LIMITS = Limits(takeoff_height_m=1.0)
MODEL = FlightModel(cruise_speed_m_s=4.0, climb_speed_m_s=2.0, landing_speed_m_s=1.0, acceleration_m_s2=4.0)
LINE = Trajectory(
    "line.csv",
    (Waypoint(0.0, 0.0, 2.0, 0.0, 0.5), Waypoint(8.0, 0.0, 2.0, 0.0, 0.5), Waypoint(8.0, 6.0, 3.0, 1.57, 0.5)),
)
BACK = Trajectory("back.csv", (Waypoint(8.0, 6.0, 2.0, 1.57, 0.5), Waypoint(0.0, 0.0, 2.0, 0.0, 0.5)))


def plan(name: str, files: Tuple[Trajectory, ...], controller: Controller, repetitions: int = 1, home=None):
    first, again = estimate_rounds(files, 1.0, MODEL)
    mission = Mission(id=name, files=len(files), repetitions=repetitions)
    return MissionPlan(mission, files, first, again, home, controller)


PLANS = (
    plan("line", (LINE,), Controller.MISSION),
    plan("both", (LINE, BACK), Controller.MISSION, 2),
    plan("inside", (LINE,), Controller.OFFBOARD),
    plan("inside twice", (LINE, BACK), Controller.OFFBOARD, 2),
)


PX4, ARDUPILOT = (Craft, Px4), (ArduCraft, ArduPilot)


class Vehicle:
    """The simulated autopilot at the other end."""

    def __init__(self, settings: Px4Settings, kind=PX4) -> None:
        make_craft, make_autopilot = kind
        self.craft = make_craft(VehicleSettings(model=MODEL))
        self.px4 = make_autopilot(self.craft, Power(PowerSettings()), settings=settings)
        self.px4.connect("planner")

    def take(self, t_ns: int, message: Any) -> List[Any]:
        self.px4.receive(t_ns, "planner", message)
        return []

    def wake(self, t_ns: int) -> List[Any]:
        self.craft.advance(t_ns)
        return [message for _, message in self.px4.advance(t_ns)]


class Flying:
    """Both of them, and what was seen."""

    def __init__(
        self, fate: Callable[[], Tuple[int, ...]] = good, plans=PLANS, spec=None, settings=None, kind=PX4, limits=LIMITS
    ) -> None:
        self.planner = Sequencer(SequencerSettings(plans, spec or PlannerSpec(), MODEL, limits))
        self.vehicle = Vehicle(settings or Px4Settings(), kind)
        self.craft = self.vehicle.craft
        self.channel = Channel(self.planner, self.vehicle, fate, PLANNER_MESSAGES)
        self.phases: List[MissionPhase] = []
        self.received: List[Any] = []
        self.run(3 * S)

    @property
    def t_ns(self) -> int:
        return self.channel.t_ns

    @property
    def status(self):
        return self.planner.status(self.t_ns)

    @property
    def phase(self) -> MissionPhase:
        return self.status.phase

    def _see(self) -> None:
        if not self.phases or self.phases[-1] is not self.phase:
            self.phases.append(self.phase)

    def run(self, duration_ns: int) -> None:
        self.until(lambda: False, duration_ns, must=False)

    def until(self, condition: Callable[[], Any], limit_ns: int = 120 * S, *, must: bool = True) -> None:
        def over() -> bool:
            self._see()
            return bool(condition())

        self.channel.run(over, limit_ns)
        assert not must or condition(), f"not within {limit_ns / S} s: {self.status} {self.craft.mode}"

    def load(self, mission: str, file_index: int = 0, repetition: int = 0, session: str = "s1"):
        request = LoadRequest(session, mission, file_index, repetition)
        loading, messages = self.planner.load(self.t_ns, request)
        self.channel.ours(messages)
        self.until(lambda: loading.over, 20 * S)
        return loading

    def command(self, action: MissionAction, session: str = "s1") -> str:
        problem, messages = self.planner.command(self.t_ns, session, action)
        self.channel.ours(messages)
        return problem

    def take_off(self, mission: str, file_index: int = 0, repetition: int = 0) -> None:
        loading = self.load(mission, file_index, repetition)
        assert loading.accepted, loading.reason
        assert self.command(MissionAction.TAKEOFF) == ""

    def until_phase(self, *phases: MissionPhase, limit_ns: int = 120 * S) -> None:
        self.until(lambda: self.phase in phases, limit_ns)


SET_MODE, ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
START, LIFT = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_TAKEOFF


class Recorded(Flying):
    """Keeps what the planner sends, and when."""

    def __init__(self, **how) -> None:
        self.commands = []
        super().__init__(**how)
        send = self.channel.ours

        def recorded(messages):
            messages = list(messages)
            self.commands += [(self.t_ns, each) for each in messages if each.get_type() == "COMMAND_LONG"]
            send(messages)

        self.channel.ours = recorded

    def since(self, t_ns):
        """Return what was commanded since then: names of modes, "arm", "disarm", "start", "takeoff"."""
        return [name for at_ns, each in self.commands if at_ns >= t_ns for name in self._named(each)]

    def _named(self, message):
        watch = self.planner.watch
        if message.command == SET_MODE:
            modes = ("AUTO.LAND", "AUTO.LOITER", "AUTO.MISSION", "OFFBOARD")
            numbers = (message.param2, message.param3)
            return [mode for mode in modes if tuple(map(float, watch.numbers(mode))) == numbers]
        if message.command == ARM:
            return ["arm" if message.param1 == 1.0 else "disarm"]
        return {START: ["start"], LIFT: ["takeoff"]}.get(message.command, [])

    def cut(self) -> None:
        self.channel.fate = lambda: ()

    def join(self) -> None:
        self.channel.fate = good


def stand_still(flying, duration_ns, happens=lambda: None):
    """Have the planner's process stand still: what the vehicle says meanwhile lies in its socket, and is read at once.

    Half way through something happens.
    """
    channel, inbox, begun_ns = flying.channel, [], flying.t_ns
    while channel.t_ns < begun_ns + duration_ns:
        half = channel.t_ns < begun_ns + duration_ns // 2 <= channel.t_ns + 50 * MS
        channel.t_ns += 50 * MS
        if half:
            happens()
        while channel._queue and channel._queue[0][0] <= channel.t_ns:
            _, _, to_vehicle, data = heapq.heappop(channel._queue)
            if to_vehicle:
                channel._deliver(data, to_vehicle=True)
            else:
                inbox.append(data)
        channel._put(channel._theirs, flying.vehicle.wake(channel.t_ns), to_vehicle=False)
    woken_ns = flying.t_ns
    for data in inbox:
        channel._deliver(data, to_vehicle=False)
    return woken_ns


__all__ = [
    "ARDUPILOT",
    "ARM",
    "BACK",
    "LIFT",
    "LIMITS",
    "LINE",
    "MODEL",
    "MS",
    "PLANS",
    "PX4",
    "SET_MODE",
    "Flying",
    "Recorded",
    "S",
    "stand_still",
]
