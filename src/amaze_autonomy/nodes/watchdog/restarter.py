"""Carry out the restarts that the watchdog asks for, off its thread, each within its limit.

A node under roslaunch's `respawn` is restarted by ending it: asked to shut down while it still answers, killed when it
does not end. One that is gone already, or has just come back, is left to roslaunch. Whether the component is back is
shown by its samples, not by what is reported here. Nothing of the PX4 is ever touched, nor a node that it or this stack
needs, whatever component asks for it.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import time
from contextlib import suppress
from typing import Callable, List, Mapping, NamedTuple, Sequence, Tuple

import rospy

from amaze_autonomy.monitoring.errors import RestartRefusedError
from amaze_autonomy.monitoring.restart import RestartRequest, why_kept
from amaze_autonomy.monitoring.specs import ComponentSpec, RestartPolicy
from amaze_autonomy.ros.clock import Workers
from amaze_autonomy.ros.liveness import NodeLiveness, Place, call, find

from ...ros.errors import BrokenCallError, CallError, UnavailableError

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
    while not ended and time.monotonic() < deadline_s:
        ended = process.poll() is not None
        while select.select([pipe], [], [], 0.0 if ended else _LOOK_S)[0] and time.monotonic() < deadline_s:
            part = os.read(pipe, 65536)
            tail = (tail + part)[-_TAIL_BYTES:]
            if not part:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, deadline_s - time.monotonic()))
                ended, held = True, False
                break
    lines = tail.decode("utf-8", "replace").strip().splitlines()
    return (lines[-1].strip() if lines else ""), held
