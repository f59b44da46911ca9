"""Measures what monitoring costs; no test. Run from the root: `python test/monitoring/measure_cost.py`."""

from __future__ import annotations

import time
from typing import Callable

from amaze_autonomy.engine.rules import Severity
from amaze_autonomy.monitoring.gravity import GravityWindow
from amaze_autonomy.monitoring.landing import LandingDetector
from amaze_autonomy.monitoring.rate import RateMonitor
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec, TopicSpec
from amaze_autonomy.monitoring.watchdog import Streams, Watchdog

S = 1_000_000_000
RATES_HZ = (200, 200, 30, 30, 30, 100, 50, 10, 5, 1)
MISSION_S = 300
TURNS_HZ = 20


def mission(*, batched: bool) -> None:
    """Watch ten components and two sensors of the autopilot for five minutes, 20 turns a second."""
    specs = tuple(
        ComponentSpec(f"c{index}", severity=Severity.HIGH, topics=(TopicSpec(f"/t{index}", float(rate_hz)),))
        for index, rate_hz in enumerate(RATES_HZ)
    )
    sensors = (AutopilotSensor.IMU, AutopilotSensor.GPS)
    specs += tuple(ComponentSpec(sensor.value, "px4", autopilot=sensor) for sensor in sensors)
    watchdog = Watchdog(specs)
    streams, names, sent = Streams(watchdog), watchdog.names, [0] * len(RATES_HZ)
    health = dict.fromkeys(sensors, True)
    watchdog.start(0)
    for turn in range(1, MISSION_S * TURNS_HZ + 1):
        t_ns = turn * S // TURNS_HZ
        for index, rate_hz in enumerate(RATES_HZ):
            due = t_ns * rate_hz // S
            if due > sent[index] and batched:
                watchdog.add_samples(names[index], due * S // rate_hz, due - sent[index])
            elif not batched:
                for number in range(sent[index] + 1, due + 1):
                    watchdog.add_samples(names[index], number * S // rate_hz)
            sent[index] = due
        if turn % 4 == 0:
            watchdog.add_autopilot(t_ns, health)
        streams.poll(t_ns)
    if not watchdog.checks(MISSION_S * S).ready:
        raise AssertionError("the mission was not nominal: this measures something else")


def rate(count: int) -> None:
    """Add single messages of a topic at 200 Hz."""
    add = RateMonitor(TopicSpec("/t", 200.0)).add
    for index in range(count):
        add(index * S // 200)


def imu(count: int) -> None:
    """Add samples of an IMU at 200 Hz."""
    add = GravityWindow(2 * S).add
    for index in range(count):
        add(index * S // 200, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0))


def ranges(count: int) -> None:
    """Add ranges at 50 Hz, and ask each time."""
    detector = LandingDetector()
    for index in range(count):
        detector.add_range(index * S // 50, 0.1)
        detector.evaluate(index * S // 50)


def best_s(work: Callable[[], object], runs: int = 5) -> float:
    """Return the shortest time of some runs."""
    times = []
    for _ in range(runs):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> None:
    """Print what each costs."""
    messages = sum(RATES_HZ) * MISSION_S
    for name, batched in (("batches", True), ("single messages", False)):
        took_s = best_s(lambda batched=batched: mission(batched=batched))
        print(f"5 min, 12 components, {messages} messages in {name}: {took_s * 1e3:.0f} ms, {MISSION_S / took_s:.0f} x")
    for name, work in (("200 Hz message", rate), ("IMU sample", imu), ("range, asked", ranges)):
        took_s = best_s(lambda work=work: work(100_000))
        print(f"{name}: {took_s * 10:.2f} us")


if __name__ == "__main__":
    main()
