#!/usr/bin/env python3
"""serve:=cns over ROS: a stand-in for the engine of the CNS Flight Stack flies a mission with our nodes, simulated.

Its messages are made here of their fields, in packages that only the node's path has.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import threading
import unittest
from functools import partial
from pathlib import Path
from typing import Any, Dict, List, Tuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "cns"))

import rosnode
import rospy
from cns_definitions import install
from genpy.message import fill_message_args
from launching import PATIENT, free_ports, make_patient
from one_node import wait_for, wait_for_end, wait_for_service
from stack import TestConfiguration
from stand_ins import DEFECT, NOMINAL

from amaze_autonomy import msg
from amaze_autonomy.cns.tables import SERVICES, TOPICS, Answer, Request
from amaze_autonomy.config import load_configuration
from amaze_autonomy.nodes.cns.names import cns_classes
from amaze_autonomy.ros.rospy_flaws import mend_rospy

FOLDER = Path(tempfile.mkdtemp(prefix="amaze_cns_served_"))
PYTHONPATH = install(FOLDER)
sys.path.insert(0, str(FOLDER))
QUICK = (*PATIENT, "missions.flight.cruise_speed_m_s=3.0", "autonomy.failsafe.status_max_age_s=5.0")
POINTS = ((0.0, 0.0, 1.5, 0.0, 0.5), (2.0, 0.0, 1.5, 0.0, 0.5), (2.0, 1.0, 1.5, 90.0, 1.0))
ID, OTHER_ID = 7, 8
ACCEPTED, COMPLETED, DONE, REFUSED = (each.name for each in Answer)
WHOLE = [
    ("ARM", ACCEPTED),
    ("ARM", COMPLETED),
    ("TAKEOFF", REFUSED),
    ("TAKEOFF", ACCEPTED),
    ("TAKEOFF", COMPLETED),
    ("HOLD", DONE),
    ("RESUME", DONE),
    ("UNDEF", COMPLETED),
    ("LAND", ACCEPTED),
    ("LAND", COMPLETED),
    ("DISARM", ACCEPTED),
    ("DISARM", COMPLETED),
]


class Engine:
    """What its engine asks, and what it hears."""

    def __init__(self) -> None:
        self.classes = cns_classes({**TOPICS, **SERVICES}, SERVICES)
        self.heard: Dict[str, List[Any]] = {key: [] for key, name in TOPICS.items() if name.heard}
        self.answers: List[Tuple[str, str]] = []
        self._changed = threading.Lock()
        self.senders = {
            key: rospy.Publisher(name.name, self.classes[key], queue_size=10)
            for key, name in TOPICS.items()
            if not name.heard
        }
        for key in self.heard:
            if key != "log":
                self.listen(key)

    def listen(self, key: str) -> None:
        rospy.Subscriber(TOPICS[key].name, self.classes[key], partial(self._hear, key), queue_size=50)

    def _hear(self, key: str, message: Any) -> None:
        with self._changed:
            self.heard[key].append(message)
            if key == "response":
                answer = Answer((message.response, message.completed))
                self.answers.append((Request(message.request.request).name, answer.name))

    def call(self, key: str, **fields: Any) -> Any:
        proxy = rospy.ServiceProxy(SERVICES[key].name, self.classes[key])
        return proxy(self.classes[key]._request_class(**fields))

    def send(self, key: str, fields: Dict[str, Any]) -> None:
        message = self.classes[key]()
        fill_message_args(message, [fields])
        self.senders[key].publish(message)

    def ask(self, request: Request, number: int = ID) -> None:
        self.send("request", {"id": number, "request": int(request)})


def launch(*arguments: str, modules: str) -> Tuple[subprocess.Popen, Path]:
    log = FOLDER / f"launch_{bool(modules)}.log"
    environment = {**os.environ, "PYTHONPATH": f"{modules}:{os.environ.get('PYTHONPATH', '')}"}
    command = ["roslaunch", "amaze_autonomy", "autonomy.launch", "simulation:=true", f"mavlink_port:={free_ports()}"]
    command += [f"overrides:={'; '.join(QUICK)}", f"output:={FOLDER / 'run'}", *arguments]
    with log.open("wb") as file:
        return subprocess.Popen(command, env=environment, stdout=file, stderr=file), log


class TestCnsServed(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.configuration = TestConfiguration()
        make_patient(cls.configuration.folder / "sensors.yaml")

    @classmethod
    def tearDownClass(cls) -> None:
        cls.configuration.remove()
        shutil.rmtree(FOLDER, ignore_errors=True)

    def wait(self, condition: Any, what: str, limit_s: float = 60.0, period_s: float = 0.005) -> Any:
        said = lambda: f"{what}: {self.engine.answers} {self.log.read_text()[-3000:]}"  # noqa: E731
        return wait_for(condition, said, limit_s, period_s)

    def wait_answer(self, request: Request, answer: str) -> None:
        self.wait(lambda: (request.name, answer) in self.engine.answers, f"{request.name} {answer}")

    def test_a_whole_mission_is_flown_by_its_engine_with_all_five_of_ours(self) -> None:
        config = f"config:={self.configuration.folder}"
        process, self.log = launch("serve:=cns", config, modules=PYTHONPATH)
        self.engine = engine = Engine()
        planner: List[Any] = []
        rospy.Subscriber("mission_planner/status", msg.MissionStatus, planner.append)
        try:
            self.prepare(planner)
            self.fly(process.pid)
            stopped = engine.call("record", data=False)
            self.assertTrue(stopped.success, stopped.message)
        finally:
            process.terminate()
            wait_for_end(process)
        self.assertEqual(list(dict.fromkeys(engine.answers)), WHOLE)  # the landing is asked until it is heard
        reached = [each.waypoint for each in engine.heard["waypoint_reached"]]
        self.assertEqual([(round(each.x, 6), round(each.y, 6)) for each in reached], [each[:2] for each in POINTS])
        self.assertAlmostEqual(reached[-1].yaw, 90.0)
        self.assertEqual([len(engine.heard[key]) for key in ("is_takeoff", "is_landed")], [1, 1])
        self.assertGreater(len(engine.heard["heartbeat"]), 5)
        bags = list((FOLDER / "run" / "recordings").rglob("*.manifest.json"))
        self.assertEqual(len(bags), 1, self.log.read_text()[-3000:])

    def prepare(self, planner: List[Any]) -> None:
        """Everything before the takeoff; its engine hears the log only after the start call, as the real one may."""
        engine = self.engine
        for name in SERVICES.values():
            wait_for_service(name.name)
        self.wait(lambda: planner and not planner[-1].message, "a vehicle that speaks")
        started: List[Any] = []  # asked again, as its operator does where something has not come up
        start = lambda: started.append(engine.call("watchdog_start", startup_time=20.0)) or started[-1]  # noqa: E731
        self.wait(lambda: start().successful, "a start that is a success", 120.0, 1.0)
        self.assertIn(started[-1].status.status, (NOMINAL, DEFECT))
        self.assertEqual(started[-1].entity_ids, [])
        engine.listen("log")
        log = self.wait(lambda: engine.heard["log"], "the log, late")[0].data
        watched = {each.name for each in load_configuration(self.configuration.folder).components}
        self.assertEqual({each.entity for each in log.changes}, watched)
        self.assertEqual({each.entity for each in log.current}, watched)
        self.assertNotIn("/autonomy", rosnode.get_node_names())
        for check in ("takeoff_check", "supervision"):
            self.wait(lambda key=check: engine.call(key).success, check, period_s=1.0)
        recorded = engine.call("record", data=True)
        self.assertTrue(recorded.success, recorded.message)

    def fly(self, pid: int) -> None:
        """From ARM to DISARM; the node between is killed before the landing."""
        engine = self.engine
        self.wait(lambda: all(each.get_num_connections() for each in engine.senders.values()), "who hears it")
        names = ("x", "y", "z", "yaw", "holdtime")
        points = [dict(zip(names, each)) for each in POINTS]
        engine.send("waypoint_list", {"waypoints": points, "action": 0, "reference": 1})
        engine.ask(Request.ARM)
        self.wait_answer(Request.ARM, COMPLETED)
        engine.ask(Request.TAKEOFF, OTHER_ID)
        self.wait_answer(Request.TAKEOFF, REFUSED)
        engine.ask(Request.TAKEOFF)
        self.wait_answer(Request.TAKEOFF, COMPLETED)
        engine.ask(Request.HOLD)
        self.wait_answer(Request.HOLD, DONE)
        engine.ask(Request.RESUME)
        self.wait_answer(Request.RESUME, DONE)
        self.wait_answer(Request.UNDEF, COMPLETED)
        subprocess.run(["pkill", "-KILL", "-P", str(pid), "-f", "__name:=cns_server"], check=True, timeout=60)
        words = "started again in flight: mission 7 is in stage "
        self.wait(lambda: words in self.log.read_text(), "another cns_server")
        landing = ("LAND", ACCEPTED)
        self.wait(lambda: engine.ask(Request.LAND) or landing in engine.answers, "a landing", period_s=1.0)
        self.wait_answer(Request.LAND, COMPLETED)
        self.wait(lambda: engine.heard["is_landed"], "is_landed")
        engine.ask(Request.DISARM)
        self.wait_answer(Request.DISARM, COMPLETED)

    def test_missing_messages_are_named_with_their_packages_in_one_message(self) -> None:
        process, self.log = launch("cns_served:=watchdog,mission_planner", "autopilot:=false", modules="")
        self.engine = Engine()
        words = "watchdog_msgs/StatusStamped is missing: build the package watchdog_msgs in your workspace"
        try:
            self.wait(lambda: words in self.log.read_text(), "what is missing")
            (line, *_) = [each for each in self.log.read_text().splitlines() if words in each]
            self.assertIn("mission_sequencer/MissionRequest is missing", line)
        finally:
            process.terminate()
            wait_for_end(process)


if __name__ == "__main__":
    import rostest

    mend_rospy()
    rospy.init_node("cns_engine")
    rostest.rosrun("amaze_autonomy", "cns_served", TestCnsServed)
