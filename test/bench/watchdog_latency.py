#!/usr/bin/env python3
"""How long from the last message of a topic to its code on `watchdog/action`, at 200, 30 and 1 Hz.

    watchdog_latency.py [--trials 50] [--json FILE]

The configured limit is max(age_limit, 3 periods): 0.3 s, 0.3 s, 3 s. What a common watchdog takes that looks at the
mean over a window twice a second is computed beside it. The status is 1 when a p99 is above the limit + 50 ms.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import threading
import time
from pathlib import Path
from typing import Any, Dict, List

import rospy

sys.path.insert(0, str(Path(__file__).resolve().parent))
from roscore import Roscore
from watchdog_bench import WatchdogBench, component_of

ALLOWED_MS = 50.0
AGE_LIMIT_S = 0.3
TOPICS = {200.0: 2, 30.0: 5, 1.0: 10}  # rate in Hz: how many fall silent in turn
_BACK_S = {200.0: 1.0, 30.0: 1.2, 1.0: 7.0}  # from the first message to nominal again
_LATEST_S = 10.0


class Seen:
    """When each component was first said to have failed, since it was last forgotten."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.failed_ns: Dict[str, int] = {}
        self.now: Dict[str, int] = {}

    def see(self, t_ns: int, action: Any) -> None:
        with self.changed:
            self.now = {each.name: each.code for each in action.components}
            for name in self.now:
                self.failed_ns.setdefault(name, t_ns)
            self.changed.notify_all()

    def wait(self, condition: Any, what: str) -> None:
        with self.changed:
            assert self.changed.wait_for(condition, _LATEST_S), what


def trial(bench: WatchdogBench, seen: Seen, topic: str, rng: random.Random) -> float:
    """Return the time from the last message to the code, in seconds."""
    name = component_of(topic)
    seen.wait(lambda: name not in seen.now, f"{name} did not come back")
    time.sleep(rng.uniform(0.0, 0.2))
    with seen.changed:
        seen.failed_ns.pop(name, None)
    with bench.told:
        bench.last_ns.pop(topic, None)
    bench.command("stop", topic)
    with bench.told:
        assert bench.told.wait_for(lambda: topic in bench.last_ns, _LATEST_S)
    seen.wait(lambda: name in seen.failed_ns, f"{name} was not seen")
    bench.command("go", topic)
    return (seen.failed_ns[name] - bench.last_ns[topic]) / 1e9


def measure(rate_hz: float, trials: int) -> List[float]:
    """Return the times of all trials at a rate; the topics fall silent in turn, those of 1 Hz at the same time."""
    topics = [(f"/topic{number}", "imu", rate_hz) for number in range(TOPICS[rate_hz])]
    seen, times, problems = Seen(), [], []
    with WatchdogBench(topics, see=seen.see) as bench:

        def run(topic: str, share: int) -> None:
            rng = random.Random(topic)
            try:
                for _ in range(share):
                    times.append(trial(bench, seen, topic, rng))
                    time.sleep(_BACK_S[rate_hz])
            except AssertionError as error:
                problems.append(error)

        share = -(-trials // len(topics))
        threads = [threading.Thread(target=run, args=(topic, share)) for topic, _, _ in topics]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()  # hollow: each of its trials has a limit
    if problems:
        raise problems[0]
    return sorted(times)


def common(rate_hz: float) -> str:
    """Say what a watchdog takes that compares the mean over 10 s (or ten periods) with half the rate at 2 Hz."""
    half_window_s = max(10.0, 10.0 / rate_hz) / 2
    return f"{half_window_s:.1f}..{half_window_s + 0.5:.1f} s"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    results, status = {}, 0
    with Roscore():
        rospy.init_node("bench", disable_signals=True)
        print("rate      limit    p50       p99       largest   above the limit (p99)   a windowed mean at 2 Hz")
        for rate_hz in TOPICS:
            times = measure(rate_hz, options.trials)
            limit_s = max(AGE_LIMIT_S, 3.0 / rate_hz)
            p50, p99 = times[len(times) // 2], times[min(len(times) - 1, int(0.99 * len(times)))]
            over_ms = (p99 - limit_s) * 1e3
            good = over_ms <= ALLOWED_MS
            status = status if good else 1
            verdict = "" if good else "  MISSED"
            numbers = f"{limit_s:.3f} s  {p50:.4f} s  {p99:.4f} s  {times[-1]:.4f} s  {over_ms:6.1f} ms"
            print(f"{rate_hz:5.0f} Hz  {numbers}               {common(rate_hz)}{verdict}", flush=True)
            results[f"{rate_hz:g} Hz"] = {"limit_s": limit_s, "p50_s": p50, "p99_s": p99, "trials": len(times)}
    if options.json:
        options.json.write_text(json.dumps(results, indent=2, sort_keys=True) + "\n")
    return status


if __name__ == "__main__":
    sys.exit(main())
