#!/usr/bin/env python3
"""Fly missions whose links are cut at random and that must land at random moments, in virtual time.

    ./run soak-cuts [FLIGHTS [SEED]]      default: 200 flights

Engine, planner, autopilot client and the simulated PX4 fly (`test/simulation/px4/cut_flights.py`). After LAND nobody
may send anything but landing and disarming, LAND may leave no later than the confirmation of a takeover takes, every
flight ends disarmed, and the laws hold at every event. Exit status 1 when something of that was not so.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "simulation" / "px4"))

from cut_flights import CutFlight, CutFlights

_AT_ONCE = 10  # flights of one engine and one vehicle, then all begin anew


def main(number: int = 200, seed: int = 1) -> int:
    """Fly, tell, return the exit status."""
    began_s, flown = time.monotonic(), []
    while len(flown) < number:
        flights = CutFlights(seed + len(flown) // _AT_ONCE)
        flown += [_told(flights, each) for each in range(min(_AT_ONCE, number - len(flown)))]
    wrong = sum(bool(each.problems) for each in flown)
    delays_s = [each.delay_ns / 1e9 for each in flown if each.delay_ns is not None]
    print(f"{len(flown)} flights, {wrong} of them wrong; {sum(each.cuts for each in flown)} cuts")
    print(f"results: {dict(Counter(each.result for each in flown))}")
    print(f"LAND after a cause in flight: {len(delays_s)}, at most {max(delays_s, default=0.0):.3f} s later")
    print(f"{time.monotonic() - began_s:.0f} s")
    return 1 if wrong else 0


def _told(flights: CutFlights, number: int) -> CutFlight:
    flight = flights.fly_once(number)
    for problem in flight.problems:
        print(f"seed {flights.seed}, flight {number}: {problem}", flush=True)
    return flight


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
