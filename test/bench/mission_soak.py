#!/usr/bin/env python3
"""Fly missions in a row over a bad radio, in virtual time: 5 % of frames lost, 50 ms jitter, one cut in each mission.

    ./run soak [MISSIONS [SEED]]      default: 200 missions

None may be lost, none stuck, and no command may have its effect twice. Exit status 1 when one was.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "simulation" / "px4"))

from bad_line import Quality
from soak import MS, Soak


def main(missions: int = 200, seed: int = 1) -> int:
    """Fly, tell, return the exit status."""
    began_s = time.monotonic()
    soak = Soak(Quality(loss=0.05, jitter_ns=50 * MS), seed)
    flown = []
    for number in range(missions):
        flown.append(soak.fly(number, hold=number % 5 == 2))
        if flown[-1].problem:
            print(f"mission {number}: {flown[-1].problem}")
    wrong = sum(bool(each.problem) for each in flown)
    loads = Counter(each.loads for each in flown)
    print(f"{missions} missions, {wrong} of them wrong; {soak.lost} frames lost, one cut in each mission")
    print(f"loaded at the first attempt {loads[1]}, later {missions - loads[1]}")
    print(f"refused because the vehicle was silent, and asked again: {sum(each.orders for each in flown)}")
    print(f"{soak.t_ns / 1e9:.0f} s of flight in {time.monotonic() - began_s:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
