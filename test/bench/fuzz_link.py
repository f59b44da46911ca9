"""Feed damaged and hostile MAVLink to the link for minutes, one seed after the other.

    python test/bench/fuzz_link.py --minutes 5             # through a UDP socket, as a vehicle's
    python test/bench/fuzz_link.py --minutes 5 --pure      # without: many more bytes
    python test/bench/fuzz_link.py --minutes 5 --planner   # the planner's link, the mission protocol included

Prints a line per seed; ends at the first crash or false state with the seed in its traceback. At the end the growth of
the whole process since its first seed.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / "autopilot")]
from link_fuzz import Fuzz, SocketFuzz, fuzz  # noqa: E402
from planner_fuzz import PlannerFuzz  # noqa: E402

STEPS = 20_000


def resident_mb() -> float:
    """Return how much memory this process holds."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pure", action="store_true", help="without a socket")
    parser.add_argument("--planner", action="store_true", help="the planner's link, without a socket")
    options = parser.parse_args()
    kind, begun_mb = PlannerFuzz if options.planner else Fuzz if options.pure else SocketFuzz, 0.0
    end, seed, fed, heard = time.monotonic() + 60 * options.minutes, options.seed, 0, 0
    while time.monotonic() < end:
        try:
            run, (half, last) = fuzz(seed, STEPS, kind)
        except Exception:
            print(f"seed {seed} fails", flush=True)
            raise
        fed, heard = fed + run.fed, heard + run.heard
        print(
            f"seed {seed}: {run.fed} bytes, {run.heard} messages, {last - half:+d} bytes in its second half", flush=True
        )
        begun_mb = begun_mb or resident_mb()
        seed += 1
    print(f"{seed - options.seed} seeds, {fed / 1e6:.1f} MB, {heard} messages heard: no crash, no false state")
    print(f"this process: {begun_mb:.1f} MB after the first seed, {resident_mb():.1f} MB at the end")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
