#!/usr/bin/env python3
"""Missions in a row with the simulated PX4 over a bad link, in virtual time: none lost, none stuck, none armed twice.

    planner_missions.py [MISSIONS [SEED [ardupilot]]]      default: 200 missions, seed 0, px4

Each has 5 % of packets lost, up to 50 ms of jitter, and one cut of the link of 0.5 s to 4 s at any moment, the loading
included. Exit status 1 when one did not end as it should.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "autopilot"))

from flying import ARDUPILOT, MS, PX4, Flying, S

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase

OVER = (MissionPhase.LANDED, MissionPhase.FAILED)
LOSS, JITTER_MS, LONGEST_MS = 0.05, 50, 60_000
LONGEST_CUT_NS = 4 * S


class Row:
    """One vehicle and one planner, and mission after mission."""

    def __init__(self, seed: int, kind) -> None:
        self.random = Random(seed)
        self.cut_ns = (0, 0)
        self.flying = Flying(kind=kind)
        self.flying.channel.fate = self.fate
        self.armings = 0
        set_armed = self.flying.craft._set_armed

        def armed() -> None:
            self.armings += 1
            set_armed()

        self.flying.craft._set_armed = armed

    def fate(self):
        """Return what becomes of a packet."""
        if self.cut_ns[0] <= self.flying.t_ns < self.cut_ns[1]:
            return ()
        return () if self.random.random() < LOSS else (self.random.randrange(1, JITTER_MS) * MS,)

    def load(self, session: str) -> str:
        """Load it, again for as long as a cut lasts; return why it was not; empty: it was."""
        end_ns = self.flying.t_ns + LONGEST_CUT_NS
        while True:
            loading = self.flying.load("line", session=session)
            if loading.accepted or self.flying.t_ns > end_ns:
                return "" if loading.accepted else loading.reason
            self.flying.run(S)

    def fly(self, number: int) -> str:
        """Fly one mission; return what was wrong."""
        flying, session = self.flying, f"s{number}"
        start_ns = flying.t_ns + self.random.randrange(20_000) * MS
        self.cut_ns = (start_ns, start_ns + self.random.randrange(500 * MS, LONGEST_CUT_NS))
        for _ in range(3):
            armings = self.armings
            flying.run(4 * S)  # what was commanded for the one before takes no effect any more
            refused = self.load(session)
            if refused:
                return f"not loaded: {refused}"
            while flying.command(MissionAction.TAKEOFF, session):  # the vehicle may be silent just now
                flying.run(200 * MS)
            flying.until(lambda: flying.phase in OVER, LONGEST_MS * MS, must=False)
            if flying.phase is not MissionPhase.FAILED:
                break
            flying.command(MissionAction.LAND, session)  # a silence has ended the takeoff: landed, as the engine does
            flying.until(lambda: flying.phase is MissionPhase.LANDED, LONGEST_MS * MS, must=False)
        status = flying.status
        wrong = "" if status.phase is MissionPhase.LANDED else f"stuck: {status}"
        wrong = wrong or ("" if status.waypoint == 3 else f"not complete: {status}")
        wrong = wrong or ("" if self.armings == armings + 1 else f"armed {self.armings - armings} times")
        flying.craft.position_m = (0.0, 0.0, 0.0)  # carried back to where it took off
        flying.run(S)
        return wrong


def main() -> int:
    """Fly them all; return the exit status."""
    kind = ARDUPILOT if "ardupilot" in sys.argv else PX4
    given = [int(each) for each in sys.argv[1:] if each != "ardupilot"]
    missions, seed = given[0] if given else 200, given[1] if len(given) > 1 else 0
    begin_s, row, failed = time.monotonic(), Row(seed, kind), 0
    for number in range(missions):
        wrong = row.fly(number)
        failed += bool(wrong)
        if wrong:
            print(f"mission {number}: {wrong}")
    flown_s, wall_s = row.flying.t_ns / 1e9, time.monotonic() - begin_s
    print(f"{missions} missions, {failed} not as they should be; {flown_s:.0f} s of flight in {wall_s:.1f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
