"""A real watchdog node over the topics of `many_topics.py`, for as long as a `with` block lasts."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import roslib.packages
import rospy

from amaze_autonomy import msg, srv
from amaze_autonomy.paths import config_folder

HERE = Path(__file__).resolve().parent
Topic = Tuple[str, str, float]  # name, kind, rate in Hz


def component_of(topic: str) -> str:
    return topic.strip("/").replace("/", "_")


def write_configuration(folder: Path, topics: Sequence[Topic], more: Dict[str, str]) -> None:
    """Copy the shipped configuration, with a component of severity high for each topic; `more` goes to its topic."""
    shutil.copytree(config_folder(), folder, dirs_exist_ok=True)
    lines = ["components:"]
    for topic, _, rate_hz in topics:
        limit_s = max(0.3, 3 / rate_hz)
        rest = f"age_limit_s: {limit_s}, tolerance_fraction: 0.5{more.get(topic, '')}"
        lines += [f"  {component_of(topic)}:", "    group: other", "    severity: high", "    wait_limit_s: 10.0"]
        lines += ["    topics:", f"      {topic}: {{rate_hz: {rate_hz}, {rest}}}"]
    (folder / "sensors.yaml").write_text("\n".join(lines) + "\n")
    missions = "missions:\n  '1':\n    description: none\n    files: [trajectories/square.csv]\n"
    (folder / "missions.yaml").write_text(missions)


class WatchdogBench:
    """The processes, and what the watchdog says.

    Args:
        topics: published and watched.
        more: text added to the configuration of a topic, by its name.
        see: gets the monotonic time of arrival, in ns, and each WatchdogAction.
    """

    def __init__(
        self,
        topics: Sequence[Topic],
        more: Optional[Dict[str, str]] = None,
        see: Callable[[int, Any], None] = lambda *_: None,
    ) -> None:
        self.topics, self._more, self._see = list(topics), more or {}, see
        self._folder = Path(tempfile.mkdtemp(prefix="amaze_bench_"))
        self.processes: List[subprocess.Popen[Any]] = []
        self.last_ns: Dict[str, int] = {}
        self.told = threading.Condition()

    def __enter__(self) -> WatchdogBench:  # noqa: PYI034 - Self is not in 3.8
        write_configuration(self._folder, self.topics, self._more)
        self.sensors = subprocess.Popen(
            [sys.executable, str(HERE / "many_topics.py"), json.dumps(self.topics)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        threading.Thread(target=self._listen, daemon=True).start()
        rospy.Subscriber(
            "watchdog/action", msg.WatchdogAction, lambda each: self._see(time.monotonic_ns(), each), tcp_nodelay=True
        )
        self.watchdog = subprocess.Popen(
            [roslib.packages.find_node("amaze_autonomy", "watchdog")[0], "--config", str(self._folder)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.processes = [self.sensors, self.watchdog]
        rospy.wait_for_service("watchdog/start", 20.0)
        self.start = rospy.ServiceProxy("watchdog/start", srv.StartWatchdog)
        answer = self.start(startup_time=15.0, mission_id="1")
        assert answer.ready, answer.message
        return self

    def _listen(self) -> None:
        for line in self.sensors.stdout:
            topic, last_ns = line.split()
            with self.told:
                self.last_ns[topic] = int(last_ns)
                self.told.notify_all()

    def command(self, word: str, topic: str) -> None:
        self.sensors.stdin.write(f"{word} {topic}\n")
        self.sensors.stdin.flush()

    def __exit__(self, *_: object) -> None:
        for process in self.processes:
            process.kill()
            process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)


def usage(pid: int) -> Tuple[float, float]:
    """Return (CPU seconds so far, resident MB) of a process; exact, not by ticks, which miss what is short."""
    tasks = Path(f"/proc/{pid}/task").glob("*/schedstat")
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return sum(int(each.read_text().split()[0]) for each in tasks) / 1e9, pages * os.sysconf("SC_PAGE_SIZE") / 1e6
