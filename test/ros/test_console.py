#!/usr/bin/env python3
"""The console as a process, over a real master, against an engine that only pretends."""

from __future__ import annotations

import itertools
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
import unittest
from pathlib import Path
from typing import Any, List

import rosgraph
import rosnode
import rospy
import rostest

from amaze_autonomy.ros.rospy_flaws import mend_rospy

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from amaze_autonomy.srv import UserCommandResponse  # noqa: E402
from fake_autonomy import FakeAutonomy  # noqa: E402 (rostest starts this file from anywhere)
from hitches import PATIENCE  # noqa: E402
from one_node import wait_for_end  # noqa: E402

from amaze_autonomy import msg  # noqa: E402

LIMIT_S = PATIENCE * 20.0
FLYING = {"state": "MISSION", "step": "flying", "in_flight": True, "user_commands": ["hold", "land", "abort"]}


class ConsoleProcess:
    """A console with a pipe for its input and one for its output."""

    def __init__(self, *arguments: str, **environment: str) -> None:
        command = [sys.executable, "-c", "from amaze_autonomy.console.main import main; raise SystemExit(main())"]
        self.process = subprocess.Popen(
            [*command, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1", **environment},
        )
        self.lines: List[str] = []
        self._queue: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def type(self, line: str) -> None:
        """Type a line."""
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()

    def wait_for(self, words: str) -> str:
        """Wait for a new line that contains the words, and return it without its time."""
        deadline = time.monotonic() + LIMIT_S
        while time.monotonic() < deadline:
            try:
                line = self._queue.get(timeout=0.1)
            except queue.Empty:
                continue
            self.lines.append(line)
            if words in line:
                return line[9:]
        raise AssertionError(f"no {words!r} in\n" + "\n".join(self.lines))

    def end(self, number: signal.Signals = signal.SIGINT) -> int:
        """Stop the console and return its exit status."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return wait_for_end(self.process)

    def _read(self) -> None:
        for line in self.process.stdout:
            self._queue.put(line.rstrip())


class TestConsole(unittest.TestCase):
    """Each test has an engine of its own under a name of its own."""

    def setUp(self) -> None:
        self.name = f"/{self.id().split('.')[-1]}/autonomy"
        self.started: List[Any] = []

    def tearDown(self) -> None:
        for each in self.started:
            (each.end if isinstance(each, ConsoleProcess) else each.stop)()

    def engine(self, **options: Any) -> FakeAutonomy:
        self.started.append(FakeAutonomy(self.name, **options))
        return self.started[-1]

    def console(self, *arguments: str, **environment: str) -> ConsoleProcess:
        self.started.insert(0, ConsoleProcess("--engine", self.name, *arguments, **environment))
        return self.started[0]

    def test_a_mission_is_listed_chosen_confirmed_and_selected(self) -> None:
        engine, console = self.engine(), self.console()
        self.assertEqual(console.wait_for("MISSION   1"), "MISSION   1: Square (1 min, battery needed 40 %)")
        self.assertEqual(console.wait_for("MISSION   2"), "MISSION   2: Square (CANNOT BE FLOWN: no such file)")
        console.type("3")
        self.assertEqual(console.wait_for("INPUT"), 'INPUT     There is no mission "3". There are: 1, 2.')
        console.type("2")
        self.assertEqual(console.wait_for("INPUT"), "INPUT     Mission 2 cannot be flown: no such file")
        console.type("1")
        console.wait_for("QUESTION  Fly mission 1: Square (1 min, battery needed 40 %)?")
        self.assertEqual(engine.calls, [])
        console.type("y")
        self.assertEqual(console.wait_for("ANSWER"), "ANSWER    mission 1: DONE the checks are running")
        self.assertEqual(engine.calls, ["select_mission 1"])

    def test_a_refused_mission_gives_the_reason_and_can_be_chosen_again(self) -> None:
        engine, console = self.engine(), self.console()
        engine.answers["select_mission"] = (False, "battery is low")
        for _ in range(2):
            console.type("1\ny")
            self.assertEqual(console.wait_for("ANSWER"), "ANSWER    mission 1: REFUSED battery is low")
        self.assertEqual(engine.calls, ["select_mission 1", "select_mission 1"])

    def test_every_answer_to_a_command_is_shown(self) -> None:
        engine, console = self.engine(), self.console()
        engine.show(**FLYING)
        console.wait_for("STATE     MISSION (flying), IN FLIGHT")
        for number, shown in ((1, "DONE"), (2, "REFUSED"), (3, "ALREADY"), (77, "NO ANSWER")):
            engine.answers["land"] = (number, "because")
            console.type("land")
            self.assertEqual(console.wait_for("ANSWER"), f"ANSWER    land: {shown} because")
        self.assertEqual(engine.calls, ["land"] * 4)

    def test_a_service_that_hangs_does_not_keep_land_back(self) -> None:
        engine, console = self.engine(), self.console()
        engine.show(**FLYING)
        console.wait_for("STATE     MISSION")
        released = threading.Event()
        engine.answers["hold"] = lambda: (released.wait(LIMIT_S), UserCommandResponse(2, "too late"))[1]
        console.type("hold")
        console.type("land")
        self.assertEqual(console.wait_for("ANSWER    land"), "ANSWER    land: DONE as asked")
        self.assertEqual(console.wait_for("ANSWER    hold"), "ANSWER    hold: none for 3 s")
        released.set()
        self.assertEqual(console.wait_for("ANSWER    hold"), "ANSWER    hold: REFUSED too late")

    def test_a_service_that_is_not_there_is_an_answer_too(self) -> None:
        engine, console = self.engine(without=("command",)), self.console()
        engine.show(**FLYING)
        console.wait_for("STATE     MISSION")
        console.type("abort")
        line = console.wait_for("ANSWER")
        self.assertEqual(line, f"ANSWER    abort: NO ANSWER {self.name}/command: no such service: no provider")

    def test_a_service_that_dies_in_mid_call(self) -> None:
        engine, console = self.engine(), self.console()
        engine.show(**FLYING)
        console.wait_for("STATE     MISSION")
        engine.answers["land"] = lambda: 1 // 0
        console.type("land")
        self.assertIn(f"ANSWER    land: NO ANSWER {self.name}/command: failed", console.wait_for("ANSWER"))

    def test_the_engine_is_waited_for_and_found_again_after_it_was_silent(self) -> None:
        console = self.console()
        console.wait_for("START")
        engine = self.engine()
        console.wait_for("STATE     MISSION_INPUT")
        engine.silent(yes=True)
        self.assertIn("has been silent for 3 s", console.wait_for("CONTACT   LOST"))
        engine.silent(yes=False)
        console.wait_for("CONTACT   the engine is heard again")

    def test_an_engine_that_is_started_anew_is_found_again(self) -> None:
        first, console = self.engine(), self.console()
        console.wait_for("STATE     MISSION_INPUT")
        first.stop()
        self.started.remove(first)
        console.wait_for("CONTACT   LOST")
        self.engine().show(**FLYING)
        console.wait_for("STATE     MISSION (flying), IN FLIGHT")

    def test_several_consoles_see_the_same_and_either_may_command(self) -> None:
        engine, consoles = self.engine(), [self.console(), self.console(), self.console()]
        engine.show(**FLYING)
        for console in consoles:
            console.wait_for("STATE     MISSION (flying), IN FLIGHT")
        consoles[2].type("hold")
        consoles[2].wait_for("ANSWER    hold: DONE")
        consoles[0].type("land")
        consoles[0].wait_for("ANSWER    land: DONE")
        engine.show(state="LAND", in_flight=True)
        for console in consoles:
            console.wait_for("STATE     LAND, IN FLIGHT")
        self.assertEqual(engine.calls, ["hold", "land"])

    def test_the_end_of_a_console_commands_nothing_and_leaves_the_graph(self) -> None:
        engine, console = self.engine(), self.console("__name:=leaving")
        engine.show(**FLYING)
        console.wait_for("STATE     MISSION")
        self.assertIn("/leaving", " ".join(rosnode.get_node_names()))
        self.assertEqual(console.end(signal.SIGINT), 130)
        self.assertIn("The engine's last state: MISSION, IN FLIGHT.", console.wait_for("END"))
        self.assertNotIn("/leaving", " ".join(rosnode.get_node_names()))
        self.assertEqual(engine.calls, [])

    def test_parameters_name_the_engine_and_the_mission(self) -> None:
        engine = self.engine()
        console = ConsoleProcess(f"_engine:={self.name}", "_mission:=1")
        self.started.insert(0, console)
        console.wait_for("ANSWER    mission 1: DONE")
        self.assertEqual(engine.calls, ["select_mission 1"])

    def test_in_a_namespace_the_engine_is_the_one_of_that_namespace(self) -> None:
        engine = self.engine()
        self.started.insert(0, FakeAutonomy("/autonomy"))  # of another vehicle
        console = ConsoleProcess("--mission", "1", ROS_NAMESPACE=str(Path(self.name).parent))
        self.started.insert(0, console)
        console.wait_for("ANSWER    mission 1: DONE")
        self.assertEqual(engine.calls, ["select_mission 1"])

    def test_topic_and_services_can_be_remapped(self) -> None:
        engine = self.engine()
        names = [f"/elsewhere/{name}:={self.name}/{name}" for name in ("state", "list_missions", "command")]
        console = ConsoleProcess("--engine", "/elsewhere", *names)
        self.started.insert(0, console)
        engine.show(**FLYING)
        console.wait_for("STATE     MISSION")
        console.type("land")
        console.wait_for("ANSWER    land: DONE")
        self.assertEqual(engine.calls, ["land"])

    def test_the_time_that_a_merge_still_takes_comes_from_the_recorder_beside_the_engine(self) -> None:
        engine, console = self.engine(), self.console()
        console.wait_for("STATE     MISSION_INPUT")
        name = f"{Path(self.name).parent}/data_recorder/status"
        recorder = rospy.Publisher(name, msg.RecordingStatus, latch=True, queue_size=1)
        status = msg.RecordingStatus(session_id="s-1", phase=msg.RecordingStatus.MERGING, remaining=90.9)
        deadline, line = time.monotonic() + LIMIT_S, ""
        for number in itertools.cycle(range(1, 10)):  # state and status come in either order
            recorder.publish(status)
            merging = {"recording_phase": "MERGING", "recording_progress": number / 10}
            engine.show(state="DATA_CLEANUP", session_id="s-1", **merging)
            line = console.wait_for("RECORDING merging")
            if "left" in line or time.monotonic() > deadline:
                break
        recorder.unregister()
        self.assertRegex(line, r"^RECORDING merging \d0 %, about 1 min (30|29) s left$")

    def test_once_ends_with_the_mission(self) -> None:
        engine, console = self.engine(), self.console("--once")
        for state in ("MISSION_INPUT", "PREFLIGHT"):
            engine.show(state=state)
            console.wait_for(f"STATE     {state}")
        engine.show(state="MISSION_ENDED", result="LANDED_EARLY", data_location="/data/1.bag")
        console.wait_for("RESULT    LANDED_EARLY")
        self.assertEqual(wait_for_end(console.process), 3)

    def test_shut_down_by_ros_it_ends(self) -> None:
        engine, console = self.engine(), self.console("__name:=victim")
        engine.show(**FLYING)
        console.wait_for("STATE     MISSION")
        rosnode.kill_nodes([name for name in rosnode.get_node_names() if "victim" in name])
        console.wait_for("END       ROS shut this console down.")
        self.assertEqual(wait_for_end(console.process), 0)

    def test_a_name_that_cannot_be_is_refused(self) -> None:
        for arguments in (["--engine", "what an engine"], ["_engine:=1engine"]):
            console = ConsoleProcess(*arguments)
            self.started.append(console)
            self.assertIn("cannot be the name of a node, e.g. /autonomy", console.wait_for("END"))
            self.assertEqual(wait_for_end(console.process), 2)

    def test_a_master_is_waited_for_and_a_new_one_is_found(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        elsewhere = {"ROS_MASTER_URI": f"http://127.0.0.1:{port}"}
        console = ConsoleProcess(**elsewhere)
        self.started.append(console)
        console.wait_for(f"WAIT      Waiting for the ROS master at http://127.0.0.1:{port}")
        for _ in range(2):
            master = subprocess.Popen(["rosmaster", "--core", "-p", str(port)], stdout=subprocess.DEVNULL)
            wait_until(lambda: rosgraph.is_master_online(elsewhere["ROS_MASTER_URI"]))
            engine = subprocess.Popen([sys.executable, str(HERE / "fake_autonomy.py")], env={**os.environ, **elsewhere})
            try:
                line = console.wait_for("")
                while "STATE     MISSION_INPUT" not in line and "the engine is heard again" not in line:
                    line = console.wait_for("")
            finally:
                for process in (engine, master):
                    process.kill()
                    wait_for_end(process)
            console.wait_for("CONTACT   LOST")


def wait_until(holds: Any) -> None:
    """Wait for a condition."""
    deadline = time.monotonic() + LIMIT_S
    while not holds():
        if time.monotonic() > deadline:
            raise AssertionError("it did not become true in time")
        time.sleep(0.05)


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_console")
    rostest.rosrun("amaze_autonomy", "console", TestConsole)
