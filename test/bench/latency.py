#!/usr/bin/env python3
"""How long from a code 16 on the wire to the landing request on the wire, in flight; beside a bare rospy echo.

    latency.py [--samples 200] [--busy 8] [--json FILE]

Plays all peers of a real autonomy node (`peers.py`): it flies, a WatchdogAction of code 16 goes out, and the time
until the bytes of the landing request arrive is taken; again and again, quiet, and with every core busy. The echo is
the least that rospy can do. Node and echo are measured in turn, in the same run. The status is 1 when a target is
missed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List

import roslib.packages
import rospy

from amaze_autonomy import msg, srv
from amaze_autonomy.config import load_configuration
from amaze_autonomy.paths import config_folder
from amaze_autonomy.ros.node_main import take_precedence

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from peers import Peers, WireService  # noqa: E402
from roscore import Roscore  # noqa: E402

NODE = "/bench_node"
ECHO = "/bench_echo"
_FLYING_S = 0.03  # until what came with the takeoff has been written
TARGETS = {("quiet", "p50"): 1.0, ("quiet", "p99"): 3.0, ("loaded", "p99"): 20.0}


class Echo:
    """The bare rospy node and the wire on both of its sides."""

    def __init__(self, nice: int) -> None:
        self._arrived = threading.Event()
        self._arrived_ns = 0
        WireService(f"{ECHO}/command", srv.MissionCommand, self._note)
        self._publisher = rospy.Publisher(f"{ECHO}/action", msg.WatchdogAction, queue_size=1, tcp_nodelay=True)
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "echo.py"), ECHO, str(nice)], start_new_session=True
        )
        deadline_s = time.monotonic() + 20.0
        while not self._publisher.get_num_connections():
            if time.monotonic() > deadline_s:
                raise SystemExit("latency: the echo does not come")
            time.sleep(0.05)

    def _note(self, _: Any, arrived_ns: int) -> Any:
        self._arrived_ns = arrived_ns
        self._arrived.set()
        return srv.MissionCommandResponse(accepted=True)

    def sample(self) -> float:
        """Return one latency in ms."""
        self._arrived.clear()
        sent_ns = time.monotonic_ns()
        self._publisher.publish(
            msg.WatchdogAction(code=16, components=[msg.ComponentState(name="mission_camera", code=16)])
        )
        if not self._arrived.wait(5.0):
            raise SystemExit("latency: the echo does not answer")
        return (self._arrived_ns - sent_ns) * 1e-6


class Node:
    """A real autonomy node, flown by played peers."""

    def __init__(self, home: Path, nice: int = -10) -> None:
        folder = home / "config"
        shutil.copytree(config_folder(), folder)
        shutil.copytree(HERE.parent / "ros" / "config", folder, dirs_exist_ok=True)
        platforms = tuple(platform.name for platform in load_configuration(folder).recording.platforms)
        rospy.set_param(f"{NODE}/autonomy/nice", nice)
        self._words = ["--config", str(folder), "--output", str(home / "run")]
        self._words += ["--overrides", "autonomy.recording.recording_lead_s=0.05"]
        self.peers = Peers(NODE, platforms)
        self.process = self.start()
        rospy.wait_for_service(f"{NODE}/autonomy/select_mission", 20.0)
        self._select = rospy.ServiceProxy(f"{NODE}/autonomy/select_mission", srv.SelectMission, persistent=True)
        self.peers.wait(lambda: self.peers.state == "MISSION_INPUT", "MISSION_INPUT")

    def start(self) -> subprocess.Popen[bytes]:
        """Start the node's process."""
        self.process = subprocess.Popen(
            [roslib.packages.find_node("amaze_autonomy", "autonomy")[0], "__name:=autonomy", *self._words],
            env={**os.environ, "ROS_NAMESPACE": NODE},
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        return self.process

    def take_off(self) -> None:
        """Fly."""
        if not self._select(["long"]).accepted:
            raise SystemExit("latency: the mission was not accepted")
        self.peers.wait(lambda: self.peers.state == "MISSION", "MISSION")

    def land(self) -> None:
        """Be on the ground, and wait for the end of the mission."""
        self.peers.touch_down()
        self.peers.wait(lambda: self.peers.state == "MISSION_ENDED", "MISSION_ENDED")

    def sample(self) -> float:
        """Fly, fail, land; return the latency of the landing in ms."""
        peers = self.peers
        self.take_off()
        time.sleep(_FLYING_S)
        sent_ns = peers.fail()
        peers.wait(lambda: peers.landing is not None, "the landing")
        latency_ms = ((peers.landing or 0) - sent_ns) * 1e-6
        self.land()
        return latency_ms


def _precede_as_a_session(nice: int) -> Callable[[], None]:
    """Raise the session that this runs in, as the nodes do with theirs; return what undoes it."""
    group = Path("/proc/self/autogroup")
    before = group.read_text().split()[-1] if group.exists() else ""

    def write(value: str) -> None:
        with contextlib.suppress(OSError):
            if before:
                group.write_text(value)

    write(str(nice))
    return lambda: write(before)


def _busy() -> None:
    with contextlib.suppress(OSError):
        os.setsid()  # another program's session, as all others are for a node

    while True:
        pass


def _series(node: Node, echo: Echo, samples: int) -> Dict[str, List[float]]:
    found: Dict[str, List[float]] = {"node": [], "echo": []}
    for _ in range(samples):
        found["node"].append(node.sample())
        found["echo"].append(echo.sample())
    return found


def _statistics(values: List[float]) -> Dict[str, float]:
    ordered = sorted(values)
    place = lambda part: ordered[min(len(ordered) - 1, int(part * len(ordered)))]  # noqa: E731
    return {"p50": place(0.5), "p90": place(0.9), "p99": place(0.99), "max": ordered[-1]}


def _print(results: Dict[str, Dict[str, Dict[str, float]]], samples: int) -> bool:
    print(f"code 16 on the wire -> landing request on the wire, in flight, {samples} samples each; ms")
    print(f"{'':16}{'p50':>9}{'p90':>9}{'p99':>9}{'max':>9}")
    for condition, series in results.items():
        for who, numbers in series.items():
            print(
                f"{condition + ' ' + who:16}" + "".join(f"{numbers[key]:9.3f}" for key in ("p50", "p90", "p99", "max"))
            )
        ratios = {key: series["node"][key] / series["echo"][key] for key in ("p50", "p90", "p99", "max")}
        print(f"{condition + ' ratio':16}" + "".join(f"{ratio:9.2f}" for ratio in ratios.values()))
    good = True
    for (condition, key), target in TARGETS.items():
        value = results[condition]["node"][key]
        good = good and value <= target
        print(f"{condition} {key}: {value:.3f} ms, target {target} ms: {'met' if value <= target else 'MISSED'}")
    return good


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=200)
    parser.add_argument("--nice", type=int, default=-10, help="of everything that is measured; 0: as any other process")
    parser.add_argument("--busy", type=int, default=os.cpu_count() or 1, help="programs beside it when it is loaded")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with Roscore() as home:
        rospy.init_node("bench", disable_signals=True)
        sys.setswitchinterval(0.0005)
        take_precedence(options.nice)  # the instrument shall not be what is measured
        restore = _precede_as_a_session(options.nice)
        node, echo = Node(Path(home), options.nice), Echo(options.nice)
        busy = [multiprocessing.Process(target=_busy, daemon=True) for _ in range(options.busy)]
        try:
            for _ in range(5):
                node.sample(), echo.sample()
            results = {"quiet": _series(node, echo, options.samples)}
            for each in busy:
                each.start()
                os.setpriority(os.PRIO_PROCESS, each.pid or 0, 0)
            results["loaded"] = _series(node, echo, options.samples)
        finally:
            restore()
            for each in (*busy,):
                if each.pid:
                    each.terminate()
            for process in (node.process, echo.process):
                process.send_signal(signal.SIGINT)
                process.wait(20.0)
        rospy.signal_shutdown("done")
    numbers = {
        condition: {who: _statistics(values) for who, values in series.items()} for condition, series in results.items()
    }
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=2) + "\n")
    return 0 if _print(numbers, options.samples) else 1


if __name__ == "__main__":
    raise SystemExit(main())
