#!/usr/bin/env python3
"""Missions in a row over UDP through a bad relay, in real time: none lost, none stuck, nothing done twice.

    missions_over_udp.py [MISSIONS [ROWS [SEED]]]      default: 200 missions in 4 rows beside each other, seed 0

Each row has a vehicle of its own, the planner's link with its thread and socket, and a relay between that loses 5 % of
all datagrams, delays them by up to 50 ms, and is cut once in each mission, for 0.5 s to 4 s. What the vehicle did is
read from the vehicle. Exit status 1 when a mission did not go as it should. Takes about 15 s for each mission of a row.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).parents[1] / "simulation" / "px4"))
sys.path.insert(0, str(Path(__file__).parents[1] / "simulation" / "px4_udp"))

from bad_line import BadRelay, Quality
from px4_tools import QUICK
from udp_tools import served

from amaze_autonomy.autopilot import Connection, Identity
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.autopilot.planner.sequencer import PLANNER_MESSAGES, Sequencer, SequencerSettings
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import Mission, MissionPhase
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import Controller, MissionPlan, PlannerSpec, Trajectory, Waypoint, estimate_rounds

MS = 1_000_000
LINE = Trajectory("line.csv", tuple(Waypoint(4.0 * n, 0.0, 2.0, 0.0, 0.0) for n in range(3)))
SPEED, LOSS, JITTER_NS, LONGEST_S, CUT_WITHIN_MS = 2.0, 0.05, 50 * MS, 90.0, 7_000
ONCE = {"armed": 1, "takeoff": 1, "airborne": 1, "waypoint": 3, "land": 1, "landed": 1, "disarmed": 1}
P = MissionPhase


class Row:
    """One vehicle, one planner and the relay between them."""

    def __init__(self, seed: int) -> None:
        self.random, self.seed, self.lost = Random(seed), seed, 0
        first, again = estimate_rounds((LINE,), 2.0, QUICK.model)
        plan = MissionPlan(Mission(id="line"), (LINE,), first, again, None, Controller.MISSION)
        self.planner = Sequencer(SequencerSettings((plan,), PlannerSpec(), QUICK.model, Limits(takeoff_height_m=2.0)))

    def fly(self, missions: int) -> list[str]:
        """Fly so many; return what was wrong."""
        with served(speed=SPEED) as (owner, port):
            relay = BadRelay(("127.0.0.1", port), Quality(loss=LOSS, jitter_ns=JITTER_NS), seed=self.seed)
            url = f"udpout:127.0.0.1:{relay.port}"
            self.link = Connection(url, Identity(1, 192, 1), self.planner, wanted=PLANNER_MESSAGES)
            relay.start()
            self.link.start()
            try:
                wrong = [self.one(f"s{number}", owner, relay) for number in range(missions)]
            finally:
                self.link.close()
                relay.stop()
                self.lost = relay.lost
        return [f"row {self.seed}, mission {number}: {each}" for number, each in enumerate(wrong) if each]

    def one(self, session: str, owner, relay) -> str:
        """Fly one; return what was wrong."""
        self.before = len(owner.craft.happened)
        after_ns, lasts_ns = self.random.randrange(CUT_WITHIN_MS) * MS, self.random.randrange(500, 4000) * MS
        relay.cut(after_ns, lasts_ns)
        whole_s = time.monotonic() + (after_ns + lasts_ns) / 1e9
        problem = self.take_off(session, owner)
        problem = problem or self.until(lambda: self.phase is P.LANDED, "landed")
        problem = problem or self.until(lambda: not owner.craft.armed, "disarmed")
        problem = problem or self.until(lambda: time.monotonic() > whole_s, "past its cut")  # one in each
        happened = Counter(owner.craft.happened[self.before :])
        said = {name: happened[name] for name in ONCE}
        status = self.planner.status(time.monotonic_ns())
        return problem or ("" if said == ONCE and status.waypoint == len(LINE.waypoints) else f"{said}, {status}")

    def take_off(self, session: str, owner) -> str:
        """Load and take off; what a silence has ended is landed, as the engine does, and begun again."""
        taken = (P.FLYING, P.LANDING, P.LANDED, P.FAILED)
        for _ in range(3):
            problem = self.load(session)
            problem = problem or self.until(lambda: not self.order(session), "a takeoff that is taken")
            problem = problem or self.until(lambda: self.phase in taken, "taking off")
            if problem or self.phase is not P.FAILED:
                break
            self.order(session, MissionAction.LAND)
            problem = self.until(lambda: self.phase is P.LANDED and not owner.craft.armed, "landed after a silence")
            self.before = len(owner.craft.happened)
        return problem

    def load(self, session: str) -> str:
        """Load until it is loaded; return what was wrong."""
        request, end_s = LoadRequest(session, "line", 0, 0), time.monotonic() + LONGEST_S
        while time.monotonic() < end_s:
            loading = self.link.ask(lambda t_ns: self.planner.load(t_ns, request))
            self.link.wait_for(lambda loading=loading: loading.over, 10.0)
            if loading.accepted:
                return ""
            time.sleep(0.3)
        return f"not loaded: {loading.reason}"

    def order(self, session: str, action: MissionAction = MissionAction.TAKEOFF) -> str:
        return self.link.ask(lambda t_ns: self.planner.command(t_ns, session, action))

    @property
    def phase(self) -> MissionPhase:
        return self.link.ask(lambda t_ns: (self.planner.status(t_ns), ())).phase

    def until(self, condition, what: str) -> str:
        """Wait for something; return what did not come."""
        end_s = time.monotonic() + LONGEST_S
        while not condition():
            if time.monotonic() > end_s:
                return f"not {what}: {self.planner.status(time.monotonic_ns())}"
            time.sleep(0.1)
        return ""


def main(missions: int = 200, rows: int = 4, seed: int = 0) -> int:
    """Fly them all; return the exit status."""
    began_s, each = time.monotonic(), [Row(seed * 1000 + number) for number in range(rows)]
    with ThreadPoolExecutor(rows) as pool:
        shares = [missions // rows + (number < missions % rows) for number in range(rows)]
        wrong = [line for lines in pool.map(Row.fly, each, shares) for line in lines]
    print(*wrong, sep="\n", end="\n" if wrong else "")
    lost, took_s = sum(row.lost for row in each), time.monotonic() - began_s
    print(f"{missions} missions over UDP, {len(wrong)} not as they should be; {lost} datagrams lost; {took_s:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
