#!/usr/bin/env python3
"""peers:=cns over ROS: the engine under roslaunch, stand-ins for all five CNS nodes, the simulated vehicle."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from functools import partial
from pathlib import Path
from typing import Any, Dict, List, Tuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "cns"))

import rospy
from cns_folder import write_folder
from cns_stand_ins import MODULES, S, StandIns
from diagnostic_msgs.msg import DiagnosticArray
from one_node import wait_for, wait_for_end
from stand_ins import ARM, DISARM, LAND, STAND_INS, TAKEOFF, Recorder
from std_msgs.msg import String
from std_srvs.srv import SetBool, SetBoolResponse

from amaze_autonomy import msg
from amaze_autonomy.cns.importer import import_folder
from amaze_autonomy.cns.tables import PEERS, SERVICES, TOPICS
from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.events import AutopilotStatus, CheckReply, Reply
from amaze_autonomy.interface import SERVICES as OURS
from amaze_autonomy.ros.interface import SERVICE_CLASSES, response_of, status_message
from amaze_autonomy.ros.rospy_flaws import mend_rospy
from amaze_autonomy.simulation import World

FOLDER = Path(tempfile.mkdtemp(prefix="amaze_cns_"))
ENTITIES = ("mission_cam", "lrf", "px4_imu", "UWB-Tag 1", "px4_gps")
SQUARE = "x,y,z,yaw,holdtime\n0,0,1.5,0,0\n1,0,1.5,5,0\n1,1,1.5,90,0\n"
FLYING = msg.MissionStatus.FLYING
RESTARTED = "started again: mission_planner goes on with what it knew"
QUICK = {  # and four limits that a machine with much else to do may stand still for
    "autonomy.failsafe.planner_status_limit_s": 30.0,
    "autonomy.failsafe.watchdog_heartbeat_limit_s": 30.0,
    "autonomy.failsafe.autopilot_status_limit_s": 6.0,
    "autonomy.failsafe.status_max_age_s": 6.0,
    "autonomy.recording.recording_lead_s": 0.2,
    "autonomy.checks.watchdog_startup_time_s": 2.0,
    "missions.flight.cruise_speed_m_s": 3.0,
    "sensors.initialisation.service": "/mars/init_service",
    "sensors.initialisation.type": "set_bool",
}


class Stack(StandIns):
    """Everything beside our launch file."""

    def __init__(self) -> None:
        write_folder(FOLDER / "cns", square=SQUARE)
        import_folder(FOLDER / "cns", FOLDER / "config")
        self.configuration = load_configuration(FOLDER / "config", QUICK)
        self.world = World(self.configuration, without=PEERS)
        self.recordings = FOLDER / "recordings"
        self.recordings.mkdir()
        self.answers: Dict[int, Any] = {}
        self.number = 0
        self.initialised: List[Any] = []
        super().__init__([kind(self.world.vehicle) for kind in STAND_INS])
        self.nodes["watchdog"]._rows = dict.fromkeys(ENTITIES, 2)
        self.nodes["state_estimation"].faults["window_s"] = 1.0
        self.nodes["data_recorder"].faults["stop_s"] = 1.0
        rospy.Service("/mars/init_service", SetBool, self._initialise)
        for name, row in OURS.items():
            if row.peer == "autopilot":
                rospy.Service(name, SERVICE_CLASSES[name], partial(self._autopilot, row))
        self.status = rospy.Publisher("autopilot/status", msg.AutopilotStatus, queue_size=10)
        self.start()

    def filled(self, key: str, fields: Dict[str, Any]) -> Dict[str, Any]:
        if key == "supervision" and not self.initialised:
            return {**fields, "success": False, "message": "not initialised"}
        return fields

    def _initialise(self, request: Any) -> Any:
        self.initialised.append(request.data)
        return SetBoolResponse(success=True)

    def _autopilot(self, row: Any, request: Any) -> Any:
        with self.changed:
            self.number += 1
            number = self.number
            self.world.handle(max(self.now_ns(), self.world.now_ns), row.command(request, number, S))
            self.changed.wait_for(lambda: number in self.answers, 5.0)
            return response_of(row, self.answers.pop(number), self.now_ns())

    def step(self, t_ns: int) -> None:
        t_ns = max(t_ns, self.world.now_ns)
        for event in self.world.advance(t_ns):
            if isinstance(event, AutopilotStatus):
                self.status.publish(status_message(event, rospy.Time.now().to_nsec()))
            elif isinstance(event, (Reply, CheckReply)):
                self.answers[event.command_id] = event
        super().step(t_ns)
        self._write(self.nodes["data_recorder"])

    def _write(self, recorder: Recorder) -> None:
        growing, whole = self.recordings / "flight.bag.active", self.recordings / "flight.bag"
        if recorder.open_files:
            with growing.open("ab") as file:
                file.write(b"x" * 1000)
        elif growing.exists():
            growing.rename(whole)


def _values(array: DiagnosticArray) -> List[str]:
    return [pair.value for status in array.status for pair in status.values]


def launch(*arguments: str, modules: str) -> Tuple[subprocess.Popen, Path]:
    log = FOLDER / f"launch_{len(arguments)}_{bool(modules)}.log"
    environment = {**os.environ, "PYTHONPATH": f"{modules}:{os.environ.get('PYTHONPATH', '')}"}
    overrides = "; ".join(f"{key}={value}" for key, value in QUICK.items())
    command = ["roslaunch", "amaze_autonomy", "autonomy.launch", "autopilot:=false", "console:=false"]
    command += [f"config:={FOLDER / 'config'}", f"overrides:={overrides}", f"output:={FOLDER / 'run'}", *arguments]
    with log.open("wb") as file:
        return subprocess.Popen(command, env=environment, stdout=file, stderr=file), log


def doctor(*words: str) -> List[Dict[str, str]]:
    """Return what the doctor finds."""
    options = [word for key, value in QUICK.items() for word in ("--set", f"{key}={value}")]
    command = ["amaze-autonomy", "doctor", str(FOLDER / "config"), "--for", "2", "--json", *options, *words]
    return json.loads(subprocess.run(command, capture_output=True, check=False, timeout=120).stdout)["findings"]


class TestCns(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.stack = Stack()

    @classmethod
    def tearDownClass(cls) -> None:
        cls.stack.end()
        shutil.rmtree(FOLDER, ignore_errors=True)

    def test_a_whole_mission_is_flown_with_all_five_though_the_node_between_is_killed_in_flight(self) -> None:
        recordings = f"cns_recordings:=main={self.stack.recordings}"
        states: List[str] = []
        rospy.Subscriber("autonomy/state_name", String, lambda name: states.append(name.data))
        foreign = rospy.Publisher("landing_detection/landed", String, queue_size=1)  # somebody else's, of another type
        shown, rows, phases = set(), set(), set()
        rospy.Subscriber("mission_planner/status", msg.MissionStatus, lambda status: phases.add(status.phase))
        rospy.Subscriber("autonomy/state", msg.AutonomyState, lambda state: shown.add(state.advice))
        rospy.Subscriber("/diagnostics", DiagnosticArray, lambda all_of: rows.update(_values(all_of)))
        arguments = ("peers:=cns", "mission:=1", "unattended:=true", "exit_when_ended:=true", recordings)
        process, log = launch(*arguments, modules=MODULES)
        try:
            wait_for(lambda: FLYING in phases, lambda: f"the mission: {log.read_text()[-3000:]}", 60.0)
            self.stack.silent = ("mission_planner",)  # until somebody hears it
            subprocess.run(
                ["pkill", "-KILL", "-P", str(process.pid), "-f", "__name:=cns_peers"], check=True, timeout=60
            )
            wait_for(lambda: process.poll() is not None or RESTARTED in log.read_text(), log.read_text, 60.0)
            phases.clear()
            wait_for(lambda: FLYING in phases, lambda: f"the mission: {log.read_text()[-3000:]}", 60.0)
            self.stack.silent = ()
            wait_for(lambda: process.poll() is not None, lambda: f"the end: {log.read_text()[-3000:]}", 90.0)
        finally:
            process.terminate()
            wait_for_end(process)
        result = json.loads((FOLDER / "run" / "result.json").read_text())
        self.assertEqual(result["result"], "COMPLETE", log.read_text()[-9000:])
        asked = [fields["request"] for key, fields in self.stack.nodes["mission_planner"].calls if key == "request"]
        self.assertEqual(asked, [ARM, TAKEOFF, LAND, DISARM])
        self.assertEqual(self.stack.initialised, [True])
        self.assertEqual(len(self.stack.nodes["watchdog"].calls), 1)
        self.assertEqual([path.name for path in self.stack.recordings.iterdir()], ["flight.bag"])
        line = (
            "/landing_detection/landed: /cns publishes std_msgs/String (md5 992ce8a1687cec8c8bd883ec73ca41d1), read "
            f"here is amaze_autonomy/Landed (md5 {msg.Landed._md5sum}): rename or remap one of them"
        )
        self.assertTrue(any(advice.endswith(line) for advice in shown), shown)
        self.assertIn(line, rows)
        self.assertIn(f"NODE: {line}", Path(result["report"]).read_text())
        foreign.unregister()
        flown = ["PREFLIGHT", "START_RECORDING", "LOAD_MISSION", "TAKEOFF", "MISSION"]  # READY is passed at once
        self.assertEqual([name for name in states if name in flown], flown)
        self.assertEqual(states[-1], "MISSION_ENDED")

    def test_the_doctor_finds_every_name_of_both_sides_and_another_type_by_its_md5_sum(self) -> None:
        process, log = launch("peers:=cns", modules=MODULES)
        try:
            words = "nodes of the CNS Flight Stack are the engine's"
            wait_for(lambda: words in log.read_text(), lambda: log.read_text()[-3000:], 30.0)
            found = doctor("--peers", "cns")
            self.assertEqual([each for each in found if each["about"] in PEERS and each["level"] != "good"], [])
            good = [each["said"] for each in found]
            for name in (*TOPICS.values(), *SERVICES.values()):
                self.assertTrue(any(said.startswith(f"{name.name} is ") for said in good), name.name)
            self.assertIn("/cns_peers/watchdog/start is offered by /cns_peers", good)
            self.assertIn("/mars/init_service is offered by /cns", good)
            self.assertIn("/autonomy/request is heard by /cns", good)
            other = subprocess.Popen(["rostopic", "pub", "-r", "5", "/watchdog/log", "std_msgs/String", "x"])
            wrong = [each["said"] for each in doctor("--peers", "cns") if each["about"] == "watchdog"]
            other.terminate()
            log_of_it = next(said for said in wrong if said.startswith("/watchdog/log of "))
            self.assertIn(
                "is std_msgs/String, watchdog_msgs/StatusChangesArrayStamped, read is watchdog_msgs/", log_of_it
            )
        finally:
            process.terminate()
            wait_for_end(process)

    def test_missing_messages_are_named_with_their_package(self) -> None:
        arguments = ("cns_peers:=watchdog,mission_planner", "autonomy:=false", "state_estimation:=false")
        process, log = launch(*arguments, "landing_detection:=false", "data_recorder:=false", modules="")
        try:
            words = "watchdog_msgs/StatusStamped is missing: build the package watchdog_msgs in your workspace"
            wait_for(lambda: words in log.read_text(), lambda: log.read_text()[-3000:], 30.0)
            self.assertIn("mission_sequencer/MissionRequest is missing", log.read_text())
        finally:
            process.terminate()
            wait_for_end(process)


if __name__ == "__main__":
    import rostest

    mend_rospy()
    rospy.init_node("cns_stand_ins")
    rostest.rosrun("amaze_autonomy", "cns", TestCns)
