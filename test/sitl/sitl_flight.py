"""One flight: a real autopilot, the relay, roslaunch with all real nodes, and what the scenario does to them.

Run in a network of its own, which `fly.py` makes:  sitl_flight.py SCENARIO AUTOPILOT FOLDER PROGRAM_FOLDER
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, Callable, Collection, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import rosgraph
import rospy
import yaml
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image, Range
from sitl_autopilots import GROUND, KINDS, NODE, PLANNER, ROOT, Autopilot
from sitl_faults import find
from sitl_relay import Relay
from sitl_scenario import Action, Scenario
from sitl_station import Station
from sitl_wire import orders_in

from amaze_autonomy import srv
from amaze_autonomy.engine.events import VehicleLanded

_READY_S, _SETTLE_S, _END_S = 120.0, 2.0, 45.0
_SENSORS_S, _RATES_KNOWN_S = 150.0, 3.0
_SENSORS = {
    "lrf": ("/lrf/range", Range),
    "odometry": ("/odometry", Odometry),
    "mission_camera": ("/mission_camera/image_raw", Image),
}
"""What is waited for before the mission is chosen: by component, its topic and the topic's type."""
_SLICE_S = 0.01
_NODES = ("node", "planner")  # their links
_LIBRARY = ROOT / "build" / "devel" / "lib" / "amaze_autonomy"


class Tail:
    """Reads a journal while it grows."""

    def __init__(self, path: Path) -> None:
        self._path, self._at, self._half = path, 0, b""

    def rows(self) -> Iterator[Mapping[str, Any]]:
        """Return the lines that came since the last look; decisions only."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._at)
                data = file.read()
        except OSError:
            return
        self._at += len(data)
        *whole, self._half = (self._half + data).split(b"\n")
        for line in whole:
            if b'"kind":"decision"' in line:
                yield json.loads(line)


class Happened:
    """What has happened so far, for triggers: (what, value, step) and the monotonic time."""

    def __init__(self) -> None:
        self.log: List[Tuple[float, str, str, str]] = []
        self._state = self._step = self._mode = ""
        self._armed = self._airborne = False
        self._landed = VehicleLanded.UNKNOWN
        self._waypoints = 0

    def note(self, what: str, value: str, step: str = "") -> None:
        """Note something."""
        self.log.append((time.monotonic(), what, value, step))

    def decision(self, row: Mapping[str, Any]) -> None:
        """Note what a decision changed."""
        if (row["after"], row["step"]) != (self._state, self._step):
            self._state, self._step = row["after"], row["step"]
            self.note("state", self._state, self._step)

    def look(self, station: Station) -> None:
        """Note what the vehicle shows."""
        seen = station.seen
        if seen.armed != self._armed:
            self._armed = seen.armed
            self.note("event", "armed" if seen.armed else "disarmed")
        mode = seen.mode if seen.armed else ""
        if mode != self._mode:
            self._mode = mode
            self.note("mode", mode)
        airborne = seen.armed and seen.landed not in (VehicleLanded.ON_GROUND, VehicleLanded.UNKNOWN)
        if airborne != self._airborne:
            self._airborne = airborne
            self.note("event", "airborne" if airborne else "landed")
        for _ in seen.reached[self._waypoints :]:
            self._waypoints += 1
            self.note("event", "waypoint")

    def due(self, action: Action) -> bool:
        """Tell whether it is time for an action."""
        after = action.after
        fits = [
            t_s
            for t_s, what, value, step in self.log
            if what == after.what and value == after.value and (not after.step or step == after.step)
        ]
        if after.what == "state" and not after.step:
            fits = _entries(self.log, after.value)
        return len(fits) >= after.occurrence and time.monotonic() >= fits[after.occurrence - 1] + after.delay_s


def _entries(log: List[Tuple[float, str, str, str]], state: str) -> List[float]:
    """Return when a state was entered, whatever step it began with."""
    states = [(t_s, value) for t_s, what, value, _ in log if what == "state"]
    return [t_s for (t_s, value), (_, before) in zip(states, [(0.0, ""), *states]) if value == state != before]


class Operator:
    """The person at the console: chooses the mission once the sensors speak, and says what the scenario tells him."""

    def __init__(self) -> None:
        rospy.init_node("operator", anonymous=True, disable_signals=True)

    def choose(self, missions: Tuple[str, ...], dead: Collection[str], check: Callable[[], None]) -> None:
        """Wait for the engine and for the sensors that are not dead, as long as they still start; then choose."""
        missing: Dict[str, Any] = {}
        for topic, kind in (_SENSORS[name] for name in _SENSORS if name not in dead):
            missing[topic] = rospy.Subscriber(topic, kind, lambda _, name=topic: missing.pop(name, None))
        deadline = time.monotonic() + _SENSORS_S
        while missing:
            check()
            if time.monotonic() > deadline:
                raise SystemExit(f"nothing came on {', '.join(missing)} within {_SENSORS_S:g} s")
            time.sleep(0.1)
        time.sleep(_RATES_KNOWN_S)
        rospy.wait_for_service("autonomy/select_mission", _SENSORS_S)
        answer = rospy.ServiceProxy("autonomy/select_mission", srv.SelectMission)(list(missions))
        if not answer.accepted:
            raise SystemExit(f"the missions are refused: {answer.message}")

    @staticmethod
    def say(command: str) -> str:
        """Ask something of the engine; return its answer."""
        answer = rospy.ServiceProxy("autonomy/command", srv.UserCommand)(command)
        return f"{answer.answer} {answer.message}"


class Flight:
    """One flight from power-on to the end of the engine.

    Args:
        scenario: what happens.
        autopilot: by name.
        folder: for all that is written.
        program: folder of the autopilot.
    """

    def __init__(self, scenario: Scenario, autopilot: str, folder: Path, program: Path) -> None:
        self._scenario, self._folder = scenario, folder
        kind = KINDS[autopilot]
        links = {"node": (NODE, 14540), "planner": (PLANNER, 14541), "ground": (GROUND, 14550)}
        self._relay = Relay(links, folder)
        parameters = scenario.parameters.get(autopilot, {})
        self._autopilot = Autopilot(kind, program, folder / "vehicle", parameters)
        self._station = Station(self._relay.links["ground"], kind)
        self._happened = Happened()
        self._relay.links["planner"].overhear = self._overhear
        self._done: List[Dict[str, Any]] = []
        self._later: List[Tuple[float, Callable[[], None]]] = []
        self._launch: Optional[subprocess.Popen[bytes]] = None
        self._engine: Optional[subprocess.Popen[bytes]] = None
        self._engine_at: Optional[float] = 0.0
        self._kind = kind
        self._operator: Any = None
        self._stack_is_up = threading.Event()

    def fly(self) -> Dict[str, Any]:
        """Fly, and return how it went beside what is in the files."""
        facts: Dict[str, Any] = {"unix_minus_monotonic_s": time.time() - time.monotonic(), "ended_by": "itself"}
        self._relay.start()
        self._station.start()
        threading.Thread(target=self._prefer, daemon=True).start()
        try:
            self._switch_on()
            facts["ready_after_s"] = self._wait_until_ready()
            self._run(facts)
        finally:
            self._end_launch()
            self._station.stop()
            self._autopilot.kill()
            self._relay.stop()
        facts["done"], facts["downloads"] = self._done, self._station.downloads
        facts["texts"] = self._station.texts
        facts["links"] = {name: [link.passed, link.lost] for name, link in self._relay.links.items()}
        return facts

    def _prefer(self) -> None:
        """Let a flight have the processor before whatever else this computer does: it measures reactions.

        Vehicle and relay come first from the beginning: one that starves is a bad link. Nodes do once they are up: ten
        that start take all there is, also from another flight.
        """
        while True:
            first = {os.getsid(0), self._autopilot.session}
            for process in _network():
                with contextlib.suppress(OSError):  # it has ended, or this kernel has no groups
                    if self._stack_is_up.is_set() or os.getsid(int(process.name)) in first:
                        (process / "autogroup").write_text("-19")
            time.sleep(0.3)

    # --- the vehicle ----------------------------------------------------------------------------------------------

    def _switch_on(self) -> None:
        self._station.forget()
        self._autopilot.start()

    def _wait_until_ready(self) -> float:
        began = time.monotonic()
        while not self._station.ready:
            if time.monotonic() - began > _READY_S or not self._autopilot.runs:
                raise SystemExit(f"the autopilot was not ready to arm within {_READY_S:g} s: see {self._folder}")
            time.sleep(0.05)
        took = time.monotonic() - began
        while not self._station.real_time():
            if time.monotonic() - began - took > _READY_S:
                raise SystemExit(f"the simulator was not in real time within {_READY_S:g} s: see {self._folder}")
            time.sleep(0.2)
        time.sleep(_SETTLE_S)
        return round(took, 1)

    # --- the stack ------------------------------------------------------------------------------------------------

    def _run(self, facts: Dict[str, Any]) -> None:
        self._station.busy = self._scenario.station
        self._happened.note("event", "started")
        waiting = list(self._scenario.when)
        waiting = [each for each in waiting if not self._act_if_due(each)]
        self._start_launch()
        self._wait_for_master()
        if self._scenario.engine == "apart":
            self._start_engine()
        operator = Operator()
        dead = {fault.get("component") for fault in self._scenario.world.get("faults", ()) if "at_s" in fault}
        operator.choose(tuple(self._scenario.mission.split(",")), dead, self._check)
        self._stack_is_up.set()
        self._operator = operator
        tail = Tail(self._folder / "run" / "journal.jsonl")
        deadline = time.monotonic() + self._scenario.limit_s
        while self._runs():
            for row in tail.rows():
                self._happened.decision(row)
            self._happened.look(self._station)
            waiting = [each for each in waiting if not self._act_if_due(each)]
            due = [each for each in self._later if time.monotonic() >= each[0]]
            self._later = [each for each in self._later if each not in due]
            for _, do in due:
                do()
            if time.monotonic() > deadline:
                facts["ended_by"] = f"its limit of {self._scenario.limit_s:g} s"
                break
            time.sleep(_SLICE_S)
        facts["not_done"] = [each.do for each in waiting]
        time.sleep(0.5)
        self._happened.look(self._station)
        facts["armed_at_end"] = self._station.seen.armed

    def _wait_for_master(self) -> None:
        while not rosgraph.is_master_online():
            self._check()
            time.sleep(0.1)

    def _check(self) -> None:
        if not self._runs():
            raise SystemExit("roslaunch ended before the mission was chosen: see launch.txt")

    def _runs(self) -> bool:
        if self._launch is None or self._launch.poll() is not None:
            return False
        killed = self._engine is None or self._engine_at is not None
        return killed or self._engine.poll() is None

    def _start_launch(self) -> None:
        apart = self._scenario.engine == "apart"
        overrides = (*self._kind.overrides, *self._scenario.overrides, *self._give_key())
        self._overrides = "; ".join(overrides)
        arguments = {
            "simulation": "true",
            "vehicle": "external",
            "unattended": str(self._scenario.unattended).lower(),
            "exit_when_ended": "true",
            "console": "false",
            "output": str(self._folder / "run"),
            "overrides": self._overrides,
            "autonomy": str(not apart).lower(),
            **self._scenario.launch,
        }
        if self._scenario.world:
            faults = self._folder / "faults.yaml"
            faults.write_text(yaml.safe_dump(dict(self._scenario.world), sort_keys=False), encoding="utf-8")
            arguments["faults"] = str(faults)
        given = [f"{name}:={value}" for name, value in arguments.items()]
        command = ["roslaunch", "--skip-log-check", "amaze_autonomy", "autonomy.launch", *given]
        self._launch = self._start(command, "launch.txt")

    def _give_key(self) -> Tuple[str, ...]:
        """Give the autopilot of a signed flight a key; return what names it in our configuration."""
        if not self._scenario.signed:
            return ()
        key, path = os.urandom(32), self._folder / "mavlink.key"
        path.touch(0o600)
        path.write_text(key.hex(), encoding="ascii")
        self._station.give_key(key, time.time_ns())
        return tuple(f"autopilot.{link}.key_file={path}" for link in ("link", "planner_link"))

    def _start_engine(self) -> None:
        parameters = {
            "output": str(self._folder / "run"),
            "exit_when_ended": "true",
            "unattended": str(self._scenario.unattended).lower(),
            "overrides": f"'{self._overrides}'",
        }
        given = [f"_{name}:={value}" for name, value in parameters.items()]
        self._engine = self._start([str(_LIBRARY / "autonomy"), "__name:=autonomy", *given], "engine.txt")
        self._engine_at = None

    def _start(self, command: List[str], log: str) -> subprocess.Popen[bytes]:
        with (self._folder / log).open("ab") as output:
            return subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True
            )

    def _end_launch(self) -> None:
        for process in (self._engine, self._launch):
            if process is None:
                continue
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()

    def _overhear(self, _: int, data: bytes) -> None:
        """Note what the planner orders; on the relay's thread."""
        for order in orders_in(data, self._kind.name):
            self._happened.note("order", order)

    # --- what the scenario does -----------------------------------------------------------------------------------

    def _act_if_due(self, action: Action) -> bool:
        if not self._happened.due(action):
            return False
        self._done.append({"do": action.do, "unix_s": time.time(), **action.arguments})
        getattr(self, f"_do_{action.do}")(**action.arguments)
        return True

    def _in(self, seconds: float, do: Callable[[], None]) -> None:
        self._later.append((time.monotonic() + seconds, do))

    def _links(self, names: Sequence[str] = _NODES) -> List[Any]:
        return [self._relay.links[name] for name in names]

    def _do_cut(self, for_s: float, links: Sequence[str] = _NODES) -> None:
        for link in self._links(links):
            link.cut = True

        def mend() -> None:
            for link in self._links(links):
                link.cut = False

        self._in(for_s, mend)

    def _do_lose(self, fraction: float, for_s: float = 1e6) -> None:
        for link in self._links():
            link.loss = fraction

        def mend() -> None:
            for link in self._links():
                link.loss = 0.0

        self._in(for_s, mend)

    def _do_mode(self, mode: str) -> None:
        self._station.mode(mode)

    def _do_forge(self, mode: str) -> None:
        self._station.forge(self._relay.links["planner"], mode)

    def _do_arm(self) -> None:
        self._station.disarm_or_arm(arm=True)

    def _do_disarm(self) -> None:
        self._station.disarm_or_arm(arm=False)

    def _do_upload(self, up_m: float) -> None:
        self._station.upload(up_m)

    def _do_home(self, up_m: float) -> None:
        self._station.set_home(up_m)

    def _do_parameter(self, **values: Mapping[str, float]) -> None:
        given = values.get(self._kind.name, {})
        for name, value in given.items():
            self._station.ask_parameter(name)

            def change(name: str = name, value: float = value) -> None:
                self._station.set_parameter(name, value)

            for after_s in (0.3, 0.6, 0.9):  # a parameter is set again until it holds: a message may be lost
                self._in(after_s, change)

    def _do_kill(self, node: str) -> None:
        for process in _network():
            with contextlib.suppress(OSError):
                if f"__name:={node}".encode() in (process / "cmdline").read_bytes().split(b"\0"):
                    os.kill(int(process.name), signal.SIGKILL)
                    return
        raise SystemExit(f"there is no node {node} to be killed")

    def _do_user(self, command: str) -> None:
        def ask() -> None:
            words = self._operator.say(command)
            self._done.append({"do": "answer", "command": command, "unix_s": time.time(), "words": words})

        threading.Thread(target=ask, daemon=True).start()

    def _do_kill_engine(self, down_s: float) -> None:
        if self._engine is None:
            raise SystemExit("the engine is not apart")
        self._engine_at = time.monotonic() + down_s
        self._engine.kill()
        self._engine.wait()
        self._in(down_s, self._start_engine)

    def _do_restart_autopilot(self, down_s: float) -> None:
        self._autopilot.kill()
        self._in(down_s, self._switch_on)
        if self._kind.boot_speed > 1:
            self._in(down_s + 8.0, self._station.real_time)


def _network() -> List[Path]:
    """Return the processes of this network, which are those of this flight, as folders of /proc."""
    mine, found = os.readlink("/proc/self/ns/net"), []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if os.readlink(process / "ns" / "net") == mine:
                found.append(process)
    return found


def main() -> int:
    """Fly one, and write what only this process knows to facts.json."""
    name, autopilot, folder, program = sys.argv[1], sys.argv[2], Path(sys.argv[3]), Path(sys.argv[4])
    scenario = find(name)
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True, timeout=60)
    facts = Flight(scenario, autopilot, folder, program).fly()
    (folder / "facts.json").write_text(json.dumps(facts, indent=2, default=str), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
