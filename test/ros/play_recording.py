#!/usr/bin/env python3
"""A recording played into the live nodes, and the offline replay of the same recording: the same decisions.

This is the example of docs/tester.md. Nothing of the recording may be lost on the way: what went over each connection
is counted against what the bag holds.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path
from typing import Any, Dict, List

import rosbag
import rostest
import yaml
from behaviours import BUSY_FRACTION
from hitches import idle_s
from one_node import wait_for_end
from stack import HERE

from amaze_autonomy import msg
from amaze_autonomy.bags import Recording
from amaze_autonomy.paths import config_folder
from amaze_autonomy.replay.recordings.journals import read_journals
from amaze_autonomy.tester.command import main as replay
from amaze_autonomy.tester.difference import agree, agreement_lines
from amaze_autonomy.tester.scenario import load_cases

SCENARIO = HERE.parent / "scenarios" / "demo_flight_anew.scenario.yaml"
TOLERANCE_S = 0.3
"""Measured: 0.04 s, and 0.15 s for a rate that comes back through its limit (docs/tester.md, Timing)."""
LISTENERS = ("/watchdog", "/landing_detection", "/state_estimation", "/autonomy")
LIVE = ("/watchdog/action", "/watchdog/info", "/landing_detection/landed")  # said anew by the nodes themselves
LEAST_DECISIONS, LIMIT_S = 20, 60.0
MISSION, SELECT_AT_S = "1", 3.5


def desk(configuration: Path, to: Path) -> None:
    """Copy a configuration for a desk: no component has a node or a driver, every restart is a command that works."""
    shutil.copytree(configuration, to)
    sensors = yaml.safe_load((to / "sensors.yaml").read_text())
    for component in sensors["components"].values():
        component.pop("node", None)
        component.pop("driver", None)
        if "restart" in component:
            component["restart"].update(policy="command", command=["true"])
    (to / "sensors.yaml").write_text(yaml.safe_dump(sensors, sort_keys=False))


def of_today(old: Any, kind: Any) -> Any:
    """Return a message as it is defined today, parts and all."""
    made = kind()
    for field, of in zip(kind.__slots__, kind._slot_types):
        value = getattr(old, field, math.nan if of in ("float32", "float64") else getattr(made, field))
        package, _, name = of.partition("/")
        part = getattr(msg, name.partition("[")[0], None) if package == "amaze_autonomy" else None
        if part is not None:
            value = [of_today(each, part) for each in value] if of.endswith("]") else of_today(value, part)
        setattr(made, field, value)
    return made


def today(path: Path, to: Path) -> Path:
    """Write a recording with its messages of this package as they are defined today: nodes refuse those of before.

    What a message did not have yet is unknown where that can be said (NaN), else as in an empty message. Its last tenth
    of a second, in which its recorder was told to stop, is left out: nodes that play to its end may not decide on it.
    """
    with rosbag.Bag(str(path)) as old, rosbag.Bag(str(to), "w") as new:
        end_s = old.get_end_time() - 0.1
        for topic, message, stamp, header in old.read_messages(return_connection_header=True):
            if stamp.to_sec() > end_s:
                continue
            package, _, name = message._type.partition("/")
            kind = getattr(msg, name, None) if package == "amaze_autonomy" else None
            if kind is None or kind._md5sum == message._md5sum:
                new.write(topic, message, stamp, connection_header=header)
                continue
            made = of_today(message, kind)
            said = {"type": kind._type, "md5sum": kind._md5sum, "message_definition": kind._full_text}
            new.write(topic, made, stamp, connection_header={**header, **said})
    return to


class PlayedRecording(unittest.TestCase):
    """One play for all its tests."""

    folder: Path
    idle: float

    @classmethod
    def setUpClass(cls) -> None:
        cls.folder = Path(tempfile.mkdtemp(prefix="amaze_played_"))
        cls.case = load_cases(SCENARIO)[0]
        cls.bag = today(cls.case.bags[0].path, cls.folder / "flight.bag")
        cls.overrides = [f"{key}={value}" for key, value in cls.case.overrides.items()]
        with Recording(cls.bag) as recording:
            cls.held = recording.topics
        cls.sensors = {topic.name for topic in cls.held if not topic.kind.startswith("amaze_autonomy/")}
        desk(config_folder(), cls.folder / "config")
        cls.status = cls.play()

    @classmethod
    def play(cls, name: str = "live") -> int:
        """Play it into the nodes as they are launched on the vehicle; return roslaunch's exit status."""
        began_s, began_idle_s = time.monotonic(), idle_s()
        arguments = {
            "bag": cls.bag,
            "mission": MISSION,
            "select_at_s": SELECT_AT_S,
            "config": cls.folder / "config",
            "overrides": "; ".join(cls.overrides),
            "output": cls.folder / name,
            "received": cls.folder / ("received.json" if name == "live" else f"{name}.json"),
        }
        command = ["roslaunch", "--screen", str(HERE.parents[1] / "launch" / "play_recording.launch")]
        command += [f"{name}:={value}" for name, value in arguments.items()]
        with (cls.folder / "roslaunch.log").open("wb") as log:
            launch = subprocess.Popen(command, stdout=log, stderr=log)
            try:
                return wait_for_end(launch, LIMIT_S)
            except subprocess.TimeoutExpired:
                launch.send_signal(signal.SIGINT)  # the nodes have groups of their own: it has to end them
                wait_for_end(launch)
                return -1
            finally:
                cls.idle = (idle_s() - began_idle_s) / (time.monotonic() - began_s) / (os.cpu_count() or 1)

    @classmethod
    def tearDownClass(cls) -> None:
        shutil.rmtree(cls.folder, ignore_errors=True)

    def test_everything_that_the_bag_holds_came_to_every_node_that_listens(self) -> None:
        self.assertEqual(self.status, 0, self.log())
        held = {topic.name: topic.messages for topic in self.held}
        received: List[Dict[str, Any]] = json.loads((self.folder / "received.json").read_text())
        counts = {
            (row["listener"], row["topic"]): row["messages"]
            for row in received
            if row["topic"].replace("/recorded/", "/") in held and row["topic"] not in LIVE
        }
        expected = {key: held[key[1].replace("/recorded/", "/")] for key in counts}
        print(f"{sum(counts.values())} of {sum(expected.values())} messages on {len(counts)} ways", file=sys.stderr)
        self.assertEqual(counts, expected, "lost on the way")
        self.assertEqual(set(LISTENERS) | {"/recorded_peers"}, {listener for listener, _ in counts})
        self.assertEqual(len(self.sensors - {topic for _, topic in counts}), 0, "nobody listens to these")

    def _agreement(self, name: str) -> Any:
        live, replayed = (read_journals(self.folder / each / "journal.jsonl")[0] for each in (name, "replay"))
        return agree(live, replayed, TOLERANCE_S)

    def test_live_nodes_and_replay_agree_decision_by_decision(self) -> None:
        self.assertEqual(self.status, 0, self.log())
        ran = replay(
            [
                "run",
                str(self.bag),
                *("--map", str(SCENARIO.parent / self.case.topic_map)),
                *("--config", str(self.folder / "config")),
                *(word for text in self.overrides for word in ("--set", text)),
                *("--mission", MISSION, "--out", str(self.folder / "replay")),
            ]
        )
        self.assertEqual(ran, 0)
        result = self._agreement("live")
        if not result.agreed and self.idle < BUSY_FRACTION:  # two of its events are 10 ms apart: once more
            print("\n".join(agreement_lines(result)), "\nthe machine had no time: it is played again", file=sys.stderr)
            self.assertEqual(self.play("again"), 0, self.log())
            result = self._agreement("again")
        print("\n".join(agreement_lines(result)), file=sys.stderr)
        self.assertTrue(result.agreed, "\n".join(agreement_lines(result)))
        self.assertGreaterEqual(len(result.changes), LEAST_DECISIONS)

    def log(self) -> str:
        return (self.folder / "roslaunch.log").read_text(errors="replace")[-3000:]


if __name__ == "__main__":
    rostest.rosrun("amaze_autonomy", "play_recording", PlayedRecording, sys.argv)
