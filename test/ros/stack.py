"""One engine with its simulated peers in a namespace of its own, and what a test can see and do of it.

The vehicle's side writes down every request that reaches it, with the system's monotonic time, on which the engine
decides too; so an answer's delay is the difference of two lines of two files.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

import rosgraph
import roslib.packages
import rospy
from hitches import PATIENCE
from modes import DEFAULT, assert_modes, started_under
from one_node import wait_for_end, wait_for_service

from amaze_autonomy import msg, srv
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import Event
from amaze_autonomy.interface import SERVICES
from amaze_autonomy.journal.journal import read
from amaze_autonomy.paths import config_folder
from amaze_autonomy.replay.compare import check_laws, law_lines
from amaze_autonomy.replay.recordings.journals import read_journals
from amaze_autonomy.replay.timeline import decision_text

HERE = Path(__file__).resolve().parent
LIMIT_S = 40.0
START_ERROR = 2  # exit status of an engine that refuses to start

#: What makes a mission last seconds instead of minutes.
QUICK = (
    "autonomy.failsafe.watchdog_heartbeat_limit_s=1.5",  # one that comes late beside a dozen stacks is no story
    "autonomy.recording.recording_lead_s=0.2",
    "autonomy.landing.descent_time_s=0.5",
    "autonomy.landing.land_second_route_after_s=1.0",
    "autonomy.landing.land_alarm_after_s=2.0",
    "sensors.components.realsense_camera.wait_limit_s=3.0",
    "sensors.components.realsense_camera.restart.attempt_limit_s=3.0",
    "sensors.components.lrf.wait_limit_s=3.0",
    "sensors.components.lrf.restart.attempt_limit_s=3.0",
)

PREFLIGHT = (
    "watchdog/start",
    "autopilot/check_battery",
    "autopilot/check",
    "landing_detection/check",
    "state_estimation/check",
)
CHECKS = frozenset(PREFLIGHT)


class Received(NamedTuple):
    """A request that reached the vehicle's side: service, command, session, when (monotonic, ns)."""

    service: str
    command: str
    session: str
    t_ns: int

    @property
    def name(self) -> str:
        return self.command or self.service


class TestConfiguration:
    """The shipped configuration with the missions of the tests, in a temporary folder."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="amaze_test_"))
        for name in ("autonomy.yaml", "sensors.yaml", "recording.yaml", "autopilot.yaml"):
            shutil.copy(config_folder() / name, self.folder / name)
        shutil.copytree(HERE / "config", self.folder, dirs_exist_ok=True)

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)


class Stack:
    """Processes of one test.

    Args:
        name: becomes the namespace.
        config: folder of the configuration.
        faults: text of a scenario; empty: nothing goes wrong.
        overrides: of the configuration, beyond QUICK.
        mission: flown without asking; empty: none.
        parameters: private ones of the autonomy node.
        processes: which peers each simulation process plays; empty text: all.
        rules: rules of the transition table that are taken out of the engine.
        crippled: options of `crippled_autonomy.py` besides, "FOLDER" being the folder of the test.
        patience_s: how long anything is waited for.
    """

    def __init__(
        self,
        name: str,
        config: Path,
        faults: str = "",
        overrides: Sequence[str] = (),
        mission: str = "hop",
        parameters: Optional[Dict[str, Any]] = None,
        processes: Sequence[str] = ("",),
        rules: Sequence[str] = (),
        crippled: Sequence[str] = (),
        patience_s: float = LIMIT_S,
    ) -> None:
        self.name, self.patience_s = name, patience_s
        self.folder = Path(tempfile.mkdtemp(prefix=f"amaze_{name}_"))
        self.output = self.folder / "out"
        self.config, self._faults = config, self.folder / "faults.yaml"
        self._faults.write_text(faults or "description: nothing goes wrong\n")
        self.parameters: Dict[str, Any] = {"mission": mission, **(parameters or {})}
        self._overrides = [*QUICK, *overrides]
        self._processes = processes
        self._crippled = [f"--without-rule={rule}" for rule in rules]
        self._crippled += [option.replace("FOLDER", str(self.folder)) for option in crippled]
        self.engine: Optional[subprocess.Popen[bytes]] = None
        self._again_s = 0.0
        self.launched = False
        self.peers: List[subprocess.Popen[bytes]] = []
        self._changed = threading.Condition()
        self.states: List[Any] = []
        self._subscriber = rospy.Subscriber(f"/{name}/autonomy/state", msg.AutonomyState, self._see)

    # --- processes ------------------------------------------------------------------------------------------------

    def start(self) -> Stack:
        for number in range(len(self._processes)):
            self.start_peers(number)
        self.start_engine()
        return self

    def start_engine(self) -> None:
        self._set("autonomy", self.parameters)
        arguments = ["__name:=autonomy", *self._crippled]
        arguments += [*self._configured(), "--output", str(self.output)]
        kind = ["amaze_autonomy", "autonomy"] if not self._crippled else [str(HERE / "crippled_autonomy.py")]
        self.engine = self._spawn("autonomy", kind, arguments)

    def start_peers(self, number: int) -> None:
        name = f"simulation{number}"
        self._set(name, {"peers": self._processes[number], "sensors": False})
        files = ["--faults", str(self._faults), "--received", str(self.folder / "received.jsonl")]
        words = [f"__name:={name}", *self._configured(), *files]
        process = self._spawn(name, ["amaze_autonomy", "simulation"], words)
        if number < len(self.peers):
            self.peers[number] = process
        else:
            self.peers.append(process)

    def _configured(self) -> List[str]:
        return ["--config", str(self.config), "--overrides", "; ".join(self._overrides)]

    def _set(self, node: str, parameters: Dict[str, Any]) -> None:
        for name, value in parameters.items():
            rospy.set_param(f"/{self.name}/{node}/{name}", value)

    def _spawn(self, name: str, kind: List[str], arguments: List[str]) -> subprocess.Popen[bytes]:
        program = kind if len(kind) == 1 else [roslib.packages.find_node(*kind)[0]]
        command = started_under(DEFAULT, [*program, *arguments])
        environment = {**os.environ, "ROS_NAMESPACE": f"/{self.name}"}
        with (self.folder / f"{name}.log").open("ab") as log:
            return subprocess.Popen(command, env=environment, stdout=log, stderr=log, start_new_session=True)

    def stop(self) -> None:
        """End every process that is left, by its id, and forget the files."""
        self._subscriber.unregister()
        processes = [each for each in (self.engine, *self.peers) if each is not None and each.poll() is None]
        if self.launched and processes:  # the children of roslaunch have groups of their own: it has to end them
            processes[0].send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                wait_for_end(processes[0])
        for process in processes:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # each is the leader of its own group
        for process in processes:
            wait_for_end(process)

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    # --- seeing ---------------------------------------------------------------------------------------------------

    def _see(self, message: Any) -> None:
        with self._changed:
            self.states.append(message)
            self._changed.notify_all()

    @property
    def state(self) -> str:
        return self.states[-1].state if self.states else ""

    @property
    def passed(self) -> List[str]:
        """The states that were seen, in order, without repetitions."""
        return without_repetitions([message.state for message in self.states])

    @property
    def engine_lives(self) -> bool:
        return self.engine is not None and self.engine.poll() is None

    def wait(
        self, condition: Callable[[], Any], what: str, limit_s: Optional[float] = None, *, alive: bool = True
    ) -> Any:
        """Wait for a condition on what is seen; looked at with each message and ten times a second."""
        limit_s = self.patience_s if limit_s is None else limit_s
        deadline_s = time.monotonic() + PATIENCE * limit_s
        while True:
            found = condition()
            if found:
                return found
            assert time.monotonic() < deadline_s, f"{self.name}: {what} did not come in {PATIENCE} x {limit_s} s"
            for number, peer in enumerate(self.peers):
                assert peer.poll() != 2, f"{self.name}: {self.log(f'simulation{number}')}"
            assert not alive or self.engine_lives, f"{self.name}: the engine ended before {what} came"
            with self._changed:
                self._changed.wait(0.1)

    def wait_state(self, *states: str, limit_s: Optional[float] = None) -> None:
        self.wait(lambda: self.state in states, " or ".join(states), limit_s)

    def wait_over(self) -> None:
        """Wait for the end of a flight: its recording is stopped. Collecting the data takes seconds more."""
        self.wait_received("data_recorder/stop")
        self.wait_state("DATA_CLEANUP", "MISSION_ENDED")

    def wait_received(self, name: str, count: int = 1, limit_s: Optional[float] = None) -> Received:
        def found() -> Optional[Received]:
            matching = [each for each in self.received() if each.name == name]
            return matching[count - 1] if len(matching) >= count else None

        return self.wait(found, f"{count} x {name} at the vehicle's side", limit_s)

    def wait_end(self, limit_s: Optional[float] = None) -> int:
        assert self.engine is not None
        self.wait(lambda: not self.engine_lives, "the end of the autonomy node", limit_s, alive=False)
        return int(self.engine.returncode)

    def wait_peers(self) -> None:
        """Wait until the master knows every service of the peers."""
        master = rosgraph.Master("/test")
        wanted = [f"/{self.name}/{service}" for service in SERVICES]

        def all_there() -> bool:
            offered = {name for name, _ in master.getSystemState()[2]}
            return offered.issuperset(wanted)

        self.wait(all_there, "every service of the peers")

    def received(self) -> List[Received]:
        """Every request that reached the vehicle's side, in order."""
        path = self.folder / "received.jsonl"
        lines = path.read_text().splitlines() if path.exists() else []
        read = [json.loads(line) for line in lines]
        return [
            Received(each["service"], each.get("command", ""), each.get("session_id", ""), each["monotonic_ns"])
            for each in sorted(read, key=lambda each: each["monotonic_ns"])
        ]

    def routes_after(self, told_ns: int) -> Dict[str, float]:
        """How many seconds after something each route of a landing was asked for the first time."""
        first: Dict[str, float] = {}
        for each in self.received():
            if each.name in ("LAND", "autopilot/land"):
                first.setdefault(each.name, (each.t_ns - told_ns) / 1e9)
        return first

    def commands(self) -> List[str]:
        """What reached the vehicle's side besides the checks, in order, without repetitions."""
        return without_repetitions([each.name for each in self.received() if each.service not in CHECKS])

    def journal(self) -> List[Any]:
        """Every event and decision that is on the disk."""
        path = self.output / "journal.jsonl"
        text = path.read_text() if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        return [line.payload for line in read(whole).lines] if whole else []

    def check_laws(self) -> None:
        """Assert that there is a journal, and that no law was broken at any event of any journal of this test."""
        paths = sorted(path for place in (".", "earlier*") for path in self.output.glob(f"{place}/journal*.jsonl"))
        if not paths and (self.engine is None or self.engine.returncode == START_ERROR):  # None: peers alone
            print(f"{self.name}: no mission was begun: no law to check", flush=True)
            return
        assert paths, f"{self.name}: its flight left no journal"
        for path in paths:
            for journal in read_journals(path):
                lawful = check_laws(journal)
                assert not lawful.judged.broken, "\n".join([f"{self.name}:", *law_lines(lawful)])

    def check_modes(self) -> List[Path]:
        """Assert that what the engine wrote, and what was recorded below it, is as private as promised; return it."""
        return assert_modes(self.output)

    def events(self, kind: type) -> List[Any]:
        return [each for each in self.journal() if isinstance(each, Event) and isinstance(each, kind)]

    def decisions(self, rule: str = "") -> List[Decision]:
        return [each for each in self.journal() if isinstance(each, Decision) and rule in ("", each.rule)]

    def result(self) -> Dict[str, Any]:
        return json.loads((self.output / "result.json").read_text())

    def log(self, name: str = "autonomy") -> str:
        path = self.folder / f"{name}.log"
        return path.read_text(errors="replace") if path.exists() else ""

    def story(self) -> str:
        """Everything a person needs to see why a test failed."""
        rules = [f"{each.t_ns / 1e9:.3f} {decision_text(each)}" for each in self.decisions()]
        came = [f"{each.t_ns / 1e9:.3f} {each.name}" for each in self.received()]
        return "\n".join(["decisions:", *rules, "received:", *came, "log:", self.log()[-3000:]])

    # --- doing ----------------------------------------------------------------------------------------------------

    def ask(self, command: str) -> Tuple[int, str]:
        """Be the user; return (answer, message)."""
        service = f"/{self.name}/autonomy/command"
        wait_for_service(service)
        answer = rospy.ServiceProxy(service, srv.UserCommand)(command)
        return answer.answer, answer.message

    def retry(self, command: str = "retry") -> None:
        """Ask again in OUTREACH, once a second as a person does: more often starves the peers that it waits for."""
        if self.state == "OUTREACH" and time.monotonic() >= self._again_s:
            self._again_s = time.monotonic() + 1.0
            with contextlib.suppress(rospy.ServiceException):  # it has ended meanwhile
                self.ask(command)

    def select(self, *missions: str) -> Tuple[bool, str]:
        service = f"/{self.name}/autonomy/select_mission"
        wait_for_service(service)
        answer = rospy.ServiceProxy(service, srv.SelectMission)(list(missions))
        return answer.accepted, answer.message

    def signal_engine(self, number: int) -> int:
        """Send a signal to the autonomy node; return when (monotonic, ns)."""
        assert self.engine is not None
        now_ns = time.monotonic_ns()
        self.engine.send_signal(number)
        return now_ns


def without_repetitions(names: Sequence[str]) -> List[str]:
    return [name for number, name in enumerate(names) if number == 0 or names[number - 1] != name]
