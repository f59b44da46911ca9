"""Feed damaged and hostile MAVLink to the link for minutes, one seed after the other.

    python test/bench/fuzz_link.py --minutes 5

Prints a line per seed; ends at the first crash or false state with the seed in its traceback.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / "autopilot")]
from link_fuzz import fuzz  # noqa: E402

STEPS = 20_000


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    end, seed, fed, heard = time.monotonic() + 60 * options.minutes, options.seed, 0, 0
    while time.monotonic() < end:
        try:
            run, (half, last) = fuzz(seed, STEPS)
        except Exception:
            print(f"seed {seed} fails", flush=True)
            raise
        fed, heard = fed + run.fed, heard + run.heard
        print(
            f"seed {seed}: {run.fed} bytes, {run.heard} messages, {last - half:+d} bytes in its second half", flush=True
        )
        seed += 1
    print(f"{seed - options.seed} seeds, {fed / 1e6:.1f} MB, {heard} messages heard: no crash, no false state")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
