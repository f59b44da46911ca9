"""The watchdog node: are all sensors, nodes and drivers working? It restarts what may be restarted.

    watchdog/start    StartWatchdog; the first call begins the watching; in flight a call changes nothing
    watchdog/action   WatchdogAction, 5 Hz and at once on a change: issues, and the heartbeat
    watchdog/info     WatchdogInfo, 1 Hz and at once on a change: everything
    /diagnostics      diagnostic_msgs/DiagnosticArray, 1 Hz: a row per component
    autopilot/status  AutopilotStatus, what the PX4 says of its sensors, and whether the vehicle flies (subscribed)

What is watched: sensors.yaml. Parameters: `node_main.py`. How it judges: docs/monitoring.md.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import time
from contextlib import suppress
from math import isfinite
from queue import Empty, SimpleQueue
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from amaze_autonomy import msg, srv
from amaze_autonomy.config import Configuration
from amaze_autonomy.engine.events import ComponentStatus, WatchdogAction, WatchdogInfo
from amaze_autonomy.interface import health_of
from amaze_autonomy.monitoring.errors import RestartRefusedError
from amaze_autonomy.monitoring.restart import RestartRequest, why_kept
from amaze_autonomy.monitoring.specs import AutopilotSensor, ComponentSpec, RestartPolicy
from amaze_autonomy.monitoring.watchdog import Watchdog
from amaze_autonomy.ros.clock import Clock, Periodic, Workers
from amaze_autonomy.ros.liveness import NodeLiveness, Place, call, find

from ...engine.events import Check
from ...engine.rules import Code, Restart
from ...journal.report import limit_words
from ...monitoring.watchdog import Streams
from ...ros.errors import BrokenCallError, CallError, UnavailableError
from ...ros.interface import check_row, component_state, ros_time, status_message
from ...ros.node_main import run_node
from ...ros.topic_reader import TopicReader, subscribe
from .watch_loop import TakeoffAnswer, TakeoffDesk, TakeoffRequest, TopicWatch, WatchLoop

_S = 1_000_000_000
_QUEUE = 10
_LONGEST_STARTUP_S = 600.0
_LOOK_AGAIN_S = 0.5
_DIAGNOSTICS_NS = _S
_SAY_AGAIN_S = 10.0


class WatchdogNode:
    """All parts of the node, and how they are connected.

    Args:
        configuration: as loaded.
        clock: the node's.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        self._clock, self._specs = clock, configuration.components
        self._watchdog = Watchdog(self._specs)
        self._reader = TopicReader()
        self._watches = self._make_watches()
        self._desk = TakeoffDesk(self._watchdog, {mission.id: mission for mission in configuration.missions})
        self._ended = False
        self._diagnostics_ns = 0
        period_ns = round(_S / configuration.streams.watchdog_action_rate_hz)
        self._loop = WatchLoop(
            self._watchdog,
            Streams(self._watchdog, action_period_ns=period_ns),
            self._reader,
            tuple(self._watches.values()),
            self._desk,
            clock,
            self._tell,
            self._restart,
            self._excuse,
        )
        self._answers: Dict[Tuple[str, bool], Tuple[int, Optional[bool], str]] = {}
        self._action = rospy.Publisher("watchdog/action", msg.WatchdogAction, queue_size=_QUEUE, tcp_nodelay=True)
        self._info = rospy.Publisher("watchdog/info", msg.WatchdogInfo, queue_size=_QUEUE, tcp_nodelay=True)
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=_QUEUE)
        self._nodes = self._make_nodes()
        autopilot = configuration.autopilot
        link = autopilot.mavros if autopilot.backend == "mavros" else ""
        self._restarter = Restarter(self._specs, self._nodes, self._tell_restart, link)
        self._periodics = self._ask_nodes() + self._check_drivers()

    # --- what is watched ------------------------------------------------------------------------------------------

    def _make_watches(self) -> Dict[str, TopicWatch]:
        watches: Dict[str, TopicWatch] = {}
        for component in self._specs:
            for spec in component.topics:
                self._watch(watches, spec.topic).use(component.name, spec)
        self._watch(watches, "autopilot/status").take_whole(msg.AutopilotStatus, self._take_autopilot)
        return watches

    def _watch(self, watches: Dict[str, TopicWatch], topic: str) -> TopicWatch:
        name = rospy.resolve_name(topic)
        return watches.setdefault(name, TopicWatch(name, self._watchdog, self._clock))

    def _make_nodes(self) -> Dict[str, NodeLiveness]:
        master, me = rosgraph.get_master_uri(), rospy.get_name()
        return {
            spec.node: NodeLiveness(spec.node, master, me, spec.polling.node_answer_limit_ns / _S)
            for spec in self._specs
            if spec.node
        }

    def _ask_nodes(self) -> List[Periodic]:
        """Ask each node on a thread of its own, for all components that it has."""
        by_node: Dict[str, List[ComponentSpec]] = {}
        for spec in self._specs:
            if spec.node:
                by_node.setdefault(spec.node, []).append(spec)
        return [
            Periodic(f"ask {node}", self._asker(node, specs), specs[0].polling.node_period_ns, self._clock)
            for node, specs in by_node.items()
        ]

    def _asker(self, node: str, specs: List[ComponentSpec]) -> Any:
        liveness, names = self._nodes[node], [spec.name for spec in specs]

        def ask() -> None:
            answer = liveness.ask()

            def tell(now_ns: int) -> None:
                for name in names:
                    self._answer(name, False, now_ns, answer.alive, answer.message)

            self._loop.put(tell)

        return ask

    def _check_drivers(self) -> List[Periodic]:
        return [
            Periodic(f"driver of {spec.name}", self._driver_check(spec), spec.polling.driver_period_ns, self._clock)
            for spec in self._specs
            if spec.driver
        ]

    def _driver_check(self, spec: ComponentSpec) -> Any:
        limit_s = spec.polling.driver_run_limit_ns / _S

        def check() -> None:
            outcome = run_command(spec.driver, limit_s)
            message = "" if outcome.good else outcome.message
            self._loop.put(lambda now_ns: self._answer(spec.name, True, now_ns, outcome.good, message))

        return check

    def _answer(self, name: str, driver: bool, t_ns: int, good: Optional[bool], message: str) -> None:  # noqa: FBT001
        """Hand over the answer of a node, or the outcome of a look at a driver."""
        if good is None:
            return
        self._answers[name, driver] = (t_ns, good, message)
        if driver:
            self._watchdog.add_driver(name, good, t_ns, message)
        else:
            self._watchdog.add_process(name, good, t_ns, message)

    def _excuse(self, stall_ns: int, now_ns: int) -> None:
        """Make the last answers younger by a time in which nobody was asked, because this process did not run."""
        rospy.logwarn_throttle(_SAY_AGAIN_S, "the watchdog did not run for %.3f s", stall_ns / _S)
        for (name, driver), (t_ns, good, message) in list(self._answers.items()):
            self._answer(name, driver, min(now_ns, t_ns + stall_ns), good, message)

    def _take_autopilot(self, status: Any) -> None:
        """Take whether the vehicle flies, and what the autopilot says of its sensors."""
        armed = bool(status.armed) if status.armed_known else None
        self._watchdog.add_vehicle(armed=armed, on_ground=status.landed == msg.AutopilotStatus.ON_GROUND)
        said = health_of(status)
        health = {sensor: said.healthy[sensor.value] for sensor in AutopilotSensor}
        sequences = {sensor: said.sequences[sensor.value] for sensor in AutopilotSensor}
        self._watchdog.add_autopilot(self._clock.now_ns(), health, link_age_s=said.link_age_s, sequences=sequences)

    # --- what is said and done; on the watching thread ------------------------------------------------------------

    def _tell(self, action: Optional[WatchdogAction], info: Optional[WatchdogInfo], now_ns: int) -> None:
        ros_ns = self._clock.ros_ns()
        if action is not None:
            self._action.publish(status_message(action, ros_ns))
        if info is not None:
            self._info.publish(status_message(info, ros_ns))
            log_changes(info)
        if now_ns - self._diagnostics_ns >= _DIAGNOSTICS_NS:
            self._diagnostics_ns = now_ns
            self._diagnostics.publish(
                array(ros_ns, self._watchdog.checks(now_ns).checks, self._watchdog.evaluate(now_ns), self._specs)
            )

    def _restart(self, request: RestartRequest) -> None:
        try:
            self._restarter.begin(request)
        except (RestartRefusedError, RuntimeError, MemoryError) as error:  # the last two: there is no thread for it
            rospy.logerr("%s: not restarted: %s", request.component, error)
            self._watchdog.restart_outcome(request, self._clock.now_ns(), good=False)

    def _tell_restart(self, request: RestartRequest, good: bool) -> None:  # noqa: FBT001
        self._loop.put(lambda now_ns: self._watchdog.restart_outcome(request, now_ns, good=good))

    # --- the service; on its own threads --------------------------------------------------------------------------

    def _start(self, request: Any) -> Any:
        slot: SimpleQueue[TakeoffAnswer] = SimpleQueue()
        asked = TakeoffRequest(request.mission_id, tuple(request.required), _startup_ns(request.startup_time), slot)
        self._loop.put(lambda now_ns: self._desk.ask(now_ns, asked))
        while not self._ended:
            try:
                return _response(slot.get(timeout=_LOOK_AGAIN_S))
            except Empty:
                continue
        raise rospy.ServiceException("the watchdog ends")

    # --- life -----------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Watch, on this thread, until `end`."""
        for watch in self._watches.values():
            subscribe(watch.tally.topic, self._reader, watch.tally, watch.look_for)
        for periodic in self._periodics:
            periodic.start()
        rospy.Service("watchdog/start", srv.StartWatchdog, self._start)
        self._loop.run()
        for periodic in self._periodics:
            periodic.stop()
        self._reader.close()

    def end(self) -> None:
        """End; from any thread."""
        self._ended = True
        self._loop.stop()


def _startup_ns(seconds: float) -> int:
    """Return the time to come up; what is no time is none."""
    return round(min(max(seconds, 0.0), _LONGEST_STARTUP_S) * _S) if isfinite(seconds) else 0


def _response(answer: TakeoffAnswer) -> Any:
    check = answer.check
    until = float("nan") if check.until_ns is None else (check.until_ns - answer.t_ns) / _S
    components: Tuple[Any, ...] = tuple(component_state(status, answer.t_ns) for status in answer.components)
    return srv.StartWatchdogResponse(
        ready=check.ready,
        fixable=check.fixable,
        being_fixed=check.being_fixed,
        until=until,
        components=list(components),
        checks=[check_row(row) for row in check.checks],
        message=answer.message,
    )


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("watchdog", WatchdogNode)


# --- watchdog diagnostics ---------------------------------------------------------------------------------------------
# The watchdog's words for people: a row per component on /diagnostics, a line of the log for each change.


_LEVELS = {
    Code.NOMINAL: DiagnosticStatus.OK,
    Code.NON_CRITICAL: DiagnosticStatus.WARN,
    Code.INCONVENIENT: DiagnosticStatus.WARN,
    Code.HOLD: DiagnosticStatus.ERROR,
    Code.ABORT: DiagnosticStatus.ERROR,
}


def array(
    ros_ns: int, rows: Iterable[Check], statuses: Iterable[ComponentStatus], specs: Sequence[ComponentSpec]
) -> Any:
    """Return the message for all components, in their order."""
    message = DiagnosticArray()
    message.header.stamp = ros_time(ros_ns)
    message.status = [_status(row, status, spec) for row, status, spec in zip(rows, statuses, specs)]
    return message


def _status(row: Check, status: ComponentStatus, spec: ComponentSpec) -> Any:
    values: Tuple[Tuple[str, Any], ...] = (
        ("code", f"{int(status.code)} {status.code.name}"),
        ("restart", status.restart.value),
        ("value", "" if row.value is None else f"{row.value:.4g} {row.unit}".strip()),
        ("limit", limit_words(row, lambda each: f"{each:.4g} {row.unit}".strip())),
        ("age", "" if row.age_s is None else f"{row.age_s:.3f} s"),
        ("advice", row.advice),
        ("topics", ", ".join(topic.topic for topic in spec.topics)),
        ("node", spec.node or ""),
    )
    return DiagnosticStatus(
        level=_LEVELS[status.code],
        name=f"watchdog: {spec.name}",
        message=status.reason or status.code.name,
        hardware_id=spec.group,
        values=[KeyValue(key, value) for key, value in values if value],
    )


def log_changes(info: WatchdogInfo) -> None:
    """Write a line of the log for each component that changed."""
    for status in info.components:
        if status.name in info.changed:
            log = rospy.loginfo if status.code is Code.NOMINAL else rospy.logwarn
            restart = "" if status.restart is Restart.NONE else f", restart {status.restart.value}"
            log("%s: %s%s%s%s", status.name, status.code.name, restart, ": " if status.reason else "", status.reason)


# --- restarts ---------------------------------------------------------------------------------------------------------
# Carry out the restarts that the watchdog asks for, off its thread, each within its limit.
#
# A node under roslaunch's `respawn` is restarted by ending it: asked to shut down while it still answers, killed when
# it does not end. One that is gone already, or has just come back, is left to roslaunch. Whether the component is back
# is shown by its samples, not by what is reported here. Nothing of the PX4 is ever touched, nor a node that it or this
# stack needs, whatever component asks for it.


_AHEAD = 2  # restarts that find a thread when the system gives none
_POLITE_S = 1.0  # for a node to shut down by itself
_GONE = "it is gone"
_YOUNG_S = 2.0  # a node that started so recently is just coming back


class Restarter:
    """Restarts components.

    Args:
        specs: all components.
        nodes: the nodes that are watched, by name.
        tell: gets each request when it has been carried out, or could not be; on a worker.
        link: the node through which the vehicle is reached; empty: none but ours.
    """

    def __init__(
        self,
        specs: Tuple[ComponentSpec, ...],
        nodes: Mapping[str, NodeLiveness],
        tell: Callable[[RestartRequest, bool], None],
        link: str = "",
    ) -> None:
        self._specs = {spec.name: spec for spec in specs}
        self._of_the_px4 = {spec.node: spec.name for spec in specs if spec.group == "px4" and spec.node}
        self._nodes, self._tell, self._link = nodes, tell, link
        self._workers = Workers("restart")
        self._workers.prepare(_AHEAD)  # what fails may fail for want of processes or memory: nothing is left then

    def begin(self, request: RestartRequest) -> None:
        """Begin a restart; returns at once.

        Raises:
            RestartRefusedError: It belongs to the PX4, or to nobody, or its node is one that the vehicle needs.
            RuntimeError: No thread can be had for it. Likewise MemoryError.
        """
        spec = self._specs.get(request.component)
        if spec is None or spec.group == "px4" or spec.restart.policy is RestartPolicy.NEVER:
            raise RestartRefusedError(request.component)
        kept = why_kept(request.node, self._of_the_px4, self._link) if request.policy is RestartPolicy.NODE else ""
        if kept:
            raise RestartRefusedError(request.component, f"{kept}, and is never ended")
        self._workers.submit(lambda: self._carry_out(request))

    def _carry_out(self, request: RestartRequest) -> None:
        limit_s = request.limit_ns * 1e-9
        outcome = Outcome(good=False, message="failed by an error of its own")
        try:
            if request.policy is RestartPolicy.NODE:
                outcome = self._restart_node(request.node, limit_s)
            else:
                outcome = run_command(request.command, limit_s)
        finally:
            words = "carried out" if outcome.good else "NOT carried out"
            rospy.logwarn(
                "restart %d of %s %s%s%s",
                request.attempt,
                request.component,
                words,
                ": " if outcome.message else "",
                outcome.message,
            )
            self._tell(request, outcome.good)

    def _restart_node(self, node: str, limit_s: float) -> Outcome:
        """End a node, so that roslaunch starts it again."""
        liveness = self._nodes[node]
        place = liveness.place
        if place is None:
            return Outcome(good=True, message=f"{node} has never answered, roslaunch may bring it")
        process = find(place.uri, place.pid)
        if process is not None and process.age_s < _YOUNG_S:
            return Outcome(good=True, message=f"{node} has just come back, it gets the time to start")
        problem = _ask_to_shut_down(place, min(_POLITE_S, limit_s / 4))
        if process is None:
            return _without_process(node, problem)
        if not problem and process.wait(min(_POLITE_S, limit_s / 4)):
            return Outcome(good=True, message=f"{node} has shut down")
        process.kill()
        if process.wait(min(_POLITE_S, limit_s / 4)):
            return Outcome(good=True, message=f"process {process.pid} of {node} was killed")
        return Outcome(good=False, message=f"process {process.pid} of {node} does not end, though it was killed")


def _ask_to_shut_down(place: Place, limit_s: float) -> str:
    """Ask a node to shut down; return why it will not, or an empty text. Nobody else who got its port is asked."""
    try:
        if int(call(place.uri, "getPid", (rospy.get_name(),), limit_s)) != place.pid:
            return _GONE
        call(place.uri, "shutdown", (rospy.get_name(), "restarted by the watchdog"), limit_s)
    except BrokenCallError:
        return ""  # it has shut down before it answered
    except UnavailableError:
        return _GONE
    except CallError as error:
        return str(error)
    return ""


def _without_process(node: str, problem: str) -> Outcome:
    """Say what came of a node that is gone, or on another computer."""
    if not problem:
        return Outcome(good=True, message=f"{node} on another computer was asked to shut down")
    if problem == _GONE:
        return Outcome(good=True, message=f"{node} is gone, roslaunch brings it back")
    return Outcome(good=False, message=f"{node} is not on this computer and does not answer: {problem}")


# --- run command ------------------------------------------------------------------------------------------------------
# Run a command of the configuration: program and arguments, no shell, a time limit, its exit status.
#
# A driver that a command leaves in the background keeps the pipe of its output. Nobody at its other end would be its
# death, with the next line that it writes. So a process reads it from then on: a thread would end with this node, and
# the driver with it; a file would grow for as long as the driver runs.


_TAIL_BYTES = 400
_LOOK_S = 0.02
_READER = ("cat",)
_READERS: List[subprocess.Popen[bytes]] = []  # each ends with the last one that can write to its pipe


class Outcome(NamedTuple):
    """How a command ended.

    Args:
        good: with status 0, in time.
        message: what it said last; why not: its status, or that it took too long.
    """

    good: bool
    message: str


def run_command(command: Sequence[str], limit_s: float) -> Outcome:
    """Run a command in a session of its own; when it takes too long, it ends with everything that it started."""
    try:
        process = subprocess.Popen(
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    except (OSError, ValueError) as error:
        return Outcome(good=False, message=f"{command[0]} cannot be run: {getattr(error, 'strerror', '') or error}")
    with process:
        said, held = _listen(process, time.monotonic() + limit_s)
        if process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            return Outcome(good=False, message=f"{command[0]} took longer than {limit_s:g} s")
        if held and not _read_on(process):
            said = f"{said}{'; ' if said else ''}what it left running may end with its next output: nobody reads it"
    if process.returncode == 0:
        return Outcome(good=True, message=said)
    how = f"status {process.returncode}" if process.returncode > 0 else f"signal {-process.returncode}"
    return Outcome(good=False, message=f"{command[0]} ended with {how}{': ' if said else ''}{said}")


def _read_on(process: subprocess.Popen[bytes]) -> bool:
    """Have what it left running read for as long as that writes, and forgotten; return whether somebody does."""
    for reader in [each for each in _READERS if each.poll() is not None]:
        with suppress(ValueError):  # another thread was here
            _READERS.remove(reader)
    nothing = subprocess.DEVNULL
    try:
        reader = subprocess.Popen(_READER, stdin=process.stdout, stdout=nothing, stderr=nothing, start_new_session=True)
    except OSError:
        return False
    _READERS.append(reader)
    return True


def _listen(process: subprocess.Popen[bytes], deadline_s: float) -> Tuple[str, bool]:
    """Read until the process ends or a time comes; return its last line, and whether somebody may still write one."""
    assert process.stdout is not None  # noqa: S101
    pipe, tail, ended, held = process.stdout.fileno(), b"", False, True
    watch = select.poll()
    watch.register(pipe, select.POLLIN)
    while not ended and time.monotonic() < deadline_s:
        ended = process.poll() is not None
        while watch.poll(0.0 if ended else _LOOK_S * 1e3) and time.monotonic() < deadline_s:
            part = os.read(pipe, 65536)
            tail = (tail + part)[-_TAIL_BYTES:]
            if not part:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, deadline_s - time.monotonic()))
                ended, held = True, False
                break
    lines = tail.decode("utf-8", "replace").strip().splitlines()
    return (lines[-1].strip() if lines else ""), held
