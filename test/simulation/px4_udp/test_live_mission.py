"""The planner on its own thread and socket, a bad relay between, the vehicle on another: one mission, flown once."""

from __future__ import annotations

import time
from collections import Counter

import pytest
from bad_line import BadRelay, Quality
from px4_tools import QUICK
from soak import MS, S
from udp_tools import served

from amaze_autonomy.autopilot import Connection, Identity
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.autopilot.planner.sequencer import PLANNER_MESSAGES, Sequencer, SequencerSettings
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import Mission, MissionPhase
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import Controller, MissionPlan, PlannerSpec, Trajectory, Waypoint, estimate_rounds

pytestmark = pytest.mark.live

LINE = Trajectory("line.csv", (Waypoint(0.0, 0.0, 2.0, 0.0, 0.0), Waypoint(5.0, 0.0, 2.0, 0.0, 0.0)))
SPEED = 2.0
# A machine that has other work may let all of this stand for seconds; what is lost and cut here is what is tested.
PATIENT = PlannerSpec(
    transfer_limit_ns=60 * S, command_limit_ns=60 * S, vehicle_age_limit_ns=30 * S, pose_age_limit_ns=30 * S
)


def plan():
    first, again = estimate_rounds((LINE,), 2.0, QUICK.model)
    return MissionPlan(Mission(id="line"), (LINE,), first, again, None, Controller.MISSION)


def test_a_mission_over_sockets_with_loss_jitter_and_a_cut_is_flown_once():
    planner = Sequencer(SequencerSettings((plan(),), PATIENT, QUICK.model, Limits(takeoff_height_m=2.0)))
    with served(speed=SPEED) as (owner, port):
        quality = Quality(loss=0.05, jitter_ns=50 * MS, cuts=((2 * S, 3 * S),))
        relay = BadRelay(("127.0.0.1", port), quality, seed=3)
        link = Connection(f"udpout:127.0.0.1:{relay.port}", Identity(1, 192, 1), planner, wanted=PLANNER_MESSAGES)
        relay.start()
        link.start()
        try:
            # What the planner needs before it loads comes within seconds; until then it refuses.
            deadline_s = time.monotonic() + 60.0
            while True:
                loading = link.ask(lambda t_ns: planner.load(t_ns, LoadRequest("s", "line", 0, 0)))
                link.wait_for(lambda loading=loading: loading.over, 10.0)
                if loading.accepted:
                    break
                assert time.monotonic() < deadline_s, loading.reason
                link.wait_for(lambda: False, 0.3)
            while True:  # what it says may be lost or old just then: nothing is sent where that refuses it
                refused = link.ask(lambda t_ns: planner.command(t_ns, "s", MissionAction.TAKEOFF))
                if not refused:
                    break
                assert time.monotonic() < deadline_s, refused
                link.wait_for(lambda: False, 0.3)
            landed = link.wait_for(lambda: planner.status(time.monotonic_ns()).phase is MissionPhase.LANDED, 300.0)
            assert landed, planner.status(time.monotonic_ns())
            assert planner.status(time.monotonic_ns()).waypoint == 2
        finally:
            link.close()
            relay.stop()
        happened = Counter(owner.craft.happened)
        once = ("armed", "takeoff", "airborne", "mission", "land", "landed", "disarmed")
        assert {name: happened[name] for name in once} == dict.fromkeys(once, 1)
        assert (happened["waypoint"], happened["pilot"]) == (2, 0)
        assert relay.lost > 20
