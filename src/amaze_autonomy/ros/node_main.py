"""What the nodes beside the engine have in common: their start, their parameters, their end.

~startup_time  seconds after its start in which a check says of what was not heard yet that it comes by itself
~nice        niceness of the process, where the system permits it

What names a path, a command or the configuration is no parameter: `arguments.py`.
"""

from __future__ import annotations

import atexit
import gc
import io
import logging
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from logging.handlers import QueueHandler, QueueListener
from pathlib import Path
from queue import Full, Queue
from typing import Any, Callable, List, Protocol, Sequence, Tuple

import rospy

from amaze_autonomy.config import ConfigError, Configuration, load_configuration
from amaze_autonomy.monitoring.errors import MonitoringError

from ..engine.events import Check, Verdict
from .arguments import NODES, answer_words, configuration_folder, given, overrides, parameter_words
from .clock import Clock, make_clock, wait_for_time
from .errors import NodeError, StartError
from .reconnector import Reconnector
from .rospy_flaws import ask_master, check_master_uri, mend_rospy

_START_ERROR = 2
_UMASK = 0o027  # recordings, journals and sessions are for their user and group: 0750 and 0640
_LONGEST_S = 3600.0
_SHOWN = 100  # characters of what a stranger has set
_LEAVE_S = 1.0  # for the last words of a node that the master ends, e.g. that it lands; the master waits meanwhile


class RunningNode(Protocol):
    """A node that `run_node` starts."""

    def run(self) -> None:
        """Work until `end` is called."""

    def end(self) -> None:
        """Have `run` return; called from other threads."""


def run_node(name: str, make: Callable[[Configuration, Clock], RunningNode]) -> int:
    """Run a node on this thread until it is told to end; return its exit status."""
    answered = answer_words(name, sys.modules[make.__module__].__doc__, __doc__)
    if answered is not None:
        return answered
    begin(name)
    stopped, left = threading.Event(), threading.Event()
    node: Any = None
    reconnector = Reconnector()

    def end(_: str = "") -> None:
        stopped.set()
        if node is not None:
            node.end()

    def leave() -> None:
        end()
        left.wait(_LEAVE_S)

    end_by_signals(end)
    rospy.on_shutdown(leave)  # called before the topics are closed
    try:
        warn_of_parameters(name)
        take_precedence_or_say(nice_of_process())
        configuration = load_configuration(configuration_folder(), overrides())
        wait_for_time(stopped)
        node = make(configuration, make_clock(stall_limit_ns=configuration.rules.limits.clock_stall_limit_ns))
        settle()
        reconnector.start()
        if not stopped.is_set():
            node.run()
    except (ConfigError, NodeError, MonitoringError) as error:
        print(f"{name}: {error}", file=sys.stderr, flush=True)
        return _START_ERROR
    finally:
        reconnector.stop()
        left.set()
        rospy.signal_shutdown("ended")
    return 0


def warn_of_parameters(node: str) -> None:
    """Name the parameters of this node that stand in the place of words of its command line: they are ignored.

    Args:
        node: which one it is, as `arguments.NODES` calls it.
    """
    path = rospy.get_name()
    there = rospy.get_param(path, {})
    for name in NODES[node] if isinstance(there, dict) else ():
        value = there.get(name)
        said = "; ".join(map(str, value)) if isinstance(value, list) else str(value)
        if value is not None and said != given(name):
            shown = repr(said if len(said) <= _SHOWN else f"{said[:_SHOWN]}...")
            right = parameter_words(name)
            text = "The parameter %s/%s is ignored (%s): anybody may set one. In a launch file %s."
            rospy.logwarn(text, path, name, shown, right)


class Startup:
    """The time after a node's start in which what it has not heard yet may still come by itself.

    Args:
        configuration: with the time, unless ~startup_time has another one.
        clock: the node's.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        self._until_ns = clock.now_ns() + _startup_ns(configuration.rules.limits.watchdog_startup_time_ns)

    def rows(self, now_ns: int, rows: Sequence[Check]) -> Tuple[Check, ...]:
        """Return the rows of a check; while the node starts, what is unknown comes by itself."""
        if now_ns >= self._until_ns:
            return tuple(rows)
        return tuple(replace(row, heals=True) if row.verdict is Verdict.UNKNOWN else row for row in rows)


def _startup_ns(otherwise_ns: int) -> int:
    """Return ~startup_time, or another time where it is not set.

    Raises:
        StartError: It is no time.
    """
    return round(seconds("startup_time", otherwise_ns * 1e-9, _LONGEST_S) * 1e9)


# --- parameters -------------------------------------------------------------------------------------------------------
# The private parameters of nodes by their kind; those of the autonomy node, and its words.


def flag(name: str, *, default: bool) -> bool:
    """Return a private parameter that is true or false.

    Raises:
        StartError: It is neither.
    """
    value = rospy.get_param(f"~{name}", default)
    if not isinstance(value, bool):
        raise StartError(f"~{name} is {value!r}, must be true or false")
    return value


def seconds(name: str, default: float, most_s: float = 1e9) -> float:
    """Return a private parameter that is a time.

    Raises:
        StartError: It is none, or negative, or longer than `most_s`.
    """
    value = rospy.get_param(f"~{name}", default)
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0.0 <= value <= most_s:
        raise StartError(f"~{name} is {value!r}, must be 0 to {most_s:g} seconds")
    return float(value)


def whole_number(name: str, default: int) -> int:
    """Return a private parameter that is a whole number.

    Raises:
        StartError: It is none.
    """
    value = rospy.get_param(f"~{name}", default)
    if not isinstance(value, int) or isinstance(value, bool):
        raise StartError(f"~{name} is {value!r}, must be a whole number")
    return value


def nice_of_process() -> int:
    """Return ~nice: what the niceness of this process is to be, where the system permits it."""
    return whole_number("nice", -10)


@dataclass(frozen=True)
class Parameters:
    """What the launch file says to the node: by words the first two, output and runs, by private parameters the rest.

    Args:
        config: folder of the configuration.
        overrides: keys of the configuration that are to be different: "file.group.key=value".
        missions: ids to be flown one after the other without asking; empty: the user selects.
        output: folder of the run; empty: a new one in `runs`.
        runs: folder of the runs; empty: ROS_HOME/amaze_autonomy. Simulated ones lie apart: none goes on as a flight.
        exit_when_ended: end the process when the last mission has ended.
        unattended: nobody will answer: `unattended.py` does.
        peers_limit_s: how long the missions of `missions` wait for all peers to be started, in any order.
        resume: go on with the journal of a run that did not end.
        nice: niceness of the process, where the system permits it.
    """

    config: Path
    overrides: Tuple[str, ...] = ()
    missions: Tuple[str, ...] = ()
    output: str = ""
    runs: str = ""
    exit_when_ended: bool = False
    unattended: bool = False
    peers_limit_s: float = 15.0
    resume: bool = True
    nice: int = -10


def _words(name: str, value: Any) -> Tuple[str, ...]:
    """Return ids from what YAML makes of `1`, `"1,2"` or `[1, 2]`."""
    if isinstance(value, (list, tuple)):
        return tuple(str(item).strip() for item in value)
    if isinstance(value, (str, int)) and not isinstance(value, bool):
        return tuple(word.strip() for word in str(value).split(",") if word.strip())
    raise StartError(f"~{name} is {value!r}, must be ids of missions, e.g. 1 or '1,2'")


def read_parameters() -> Parameters:
    """Read them from the parameter server, and what is none from the command line.

    Raises:
        StartError: One is not of its kind.
    """
    return Parameters(
        config=configuration_folder(),
        overrides=overrides(),
        missions=_words("mission", rospy.get_param("~mission", "")),
        output=given("output"),
        runs=given("runs"),
        exit_when_ended=flag("exit_when_ended", default=False),
        unattended=flag("unattended", default=False),
        peers_limit_s=seconds("peers_limit", 15.0),
        resume=flag("resume", default=True),
        nice=nice_of_process(),
    )


# --- process ----------------------------------------------------------------------------------------------------------
# What the process itself does for speed: threads that take turns quickly, no pauses for garbage, precedence.


#: What ends a node in good order; a terminal that closes is no reason to leave a flying vehicle to itself.
END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def end_by_signals(end: Callable[[str], None]) -> None:
    """Have a node be ended by each signal that does so, by a thread that does nothing else.

    A handler comes between any two steps of the main thread, perhaps in the middle of another one: what it waits for,
    as the lock of an event, that very thread may hold, and then nobody lands the vehicle. So it only writes a byte.

    Args:
        end: called with the name of the signal.
    """
    told, tell = os.pipe()

    def wait() -> None:
        while True:
            for number in os.read(told, 1):
                try:
                    end(signal.Signals(number).name)
                except Exception:
                    logging.getLogger(__name__).exception("the node could not be told to end")

    threading.Thread(target=wait, name="signals", daemon=True).start()
    for number in END_SIGNALS:
        signal.signal(number, lambda number, _: os.write(tell, bytes([number])))


_SWITCH_INTERVAL_S = 0.0005
_AUTOGROUP = Path("/proc/self/autogroup")


# --- words to people --------------------------------------------------------------------------------------------------
# They go to the terminal of roslaunch, and into a file of the log. The terminal may be closed in flight, and it may be
# held: by Ctrl-S, by a connection that hangs. A disk may hang. Whoever wrote a line would wait then: the thread that
# hears the vehicle, for ever. So a thread that does nothing else writes them.

_MOST_WAITING = 10_000
"""So many lines wait for who takes none; what comes then is lost."""
_LAST_WORDS_S = 1.0
_waiting: List[Queue[Any]] = []


class Outlet(io.TextIOBase):
    """A stream for people that nobody may read any more: what is written goes out by a thread of its own."""

    def __init__(self, stream: Any) -> None:
        self._stream, self._texts = stream, _queue()
        threading.Thread(target=self._write_out, name="words", daemon=True).start()

    def __getattr__(self, name: str) -> Any:
        """Be the stream in everything else."""
        return getattr(self._stream, name)

    def isatty(self) -> bool:
        """Tell whether it is a terminal: warnings have a colour there."""
        return bool(self._stream.isatty())

    def fileno(self) -> int:
        """Return the descriptor of the stream."""
        return int(self._stream.fileno())

    def write(self, text: str) -> int:
        """Have a text written."""
        with suppress(Full):
            self._texts.put_nowait(text)
        return len(text)

    def flush(self) -> None:
        """Do nothing: it is written as soon as it can be."""

    def _write_out(self) -> None:
        number = self.fileno()  # a stream of Python's that hangs would not let the process end
        while True:
            data = self._texts.get().encode(errors="backslashreplace")
            with suppress(OSError):
                while data:
                    data = data[os.write(number, data) :]
            self._texts.task_done()


class _Queued(QueueHandler):
    def enqueue(self, record: logging.LogRecord) -> None:
        with suppress(Full):
            self.queue.put_nowait(record)


def _queue() -> Queue[Any]:
    made: Queue[Any] = Queue(_MOST_WAITING)
    _waiting.append(made)
    return made


def detach_files() -> None:
    """Have the files of the log written by a thread each; more than once is the same."""
    named = logging.Logger.manager.loggerDict.values()
    for logger in (logging.getLogger(), *(each for each in named if isinstance(each, logging.Logger))):
        for handler in [each for each in logger.handlers if isinstance(each, logging.FileHandler)]:
            lines = _queue()
            logger.removeHandler(handler)
            logger.addHandler(_Queued(lines))
            QueueListener(lines, handler, respect_handler_level=True).start()


def forget_words() -> None:
    """Wait for no words that were begun before a fork, in it: the thread that writes them is not there."""
    _waiting.clear()


def say_last_words(limit_s: float = _LAST_WORDS_S) -> None:
    """Wait until all words are written, for so long at most; before this process becomes another one, or ends."""
    until_s = time.monotonic() + limit_s
    for words in _waiting:
        with words.all_tasks_done:
            while words.unfinished_tasks and time.monotonic() < until_s:
                words.all_tasks_done.wait(until_s - time.monotonic())


def begin(name: str) -> None:
    """Become a node, as every one does that flies; it waits for the master for as long as there is none.

    Words to people never fail from here on, and nobody waits for them: see above.
    What is written is for its user and group. A signal in the wait for the master ends it at once, without a traceback.
    It ends here, with a line, where no master can have the address of ROS_MASTER_URI: that wait would have no end.

    Args:
        name: of the node, where nobody gives it another one.
    """
    try:
        check_master_uri()
    except StartError as error:
        print(f"{name}: {error}", file=sys.stderr, flush=True)
        sys.exit(_START_ERROR)
    sys.stdout, sys.stderr = Outlet(sys.stdout), Outlet(sys.stderr)  # before rospy keeps both for its log
    atexit.register(say_last_words)
    write_for_user_and_group()
    mend_rospy()
    for number in END_SIGNALS:
        signal.signal(number, lambda *_: os._exit(0))  # an exception could be lost in rospy
    rospy.init_node(name, argv=sys.argv, disable_signals=True)
    ask_master()
    detach_files()


def write_for_user_and_group() -> None:
    """Have what this process and its programs write from here on be for its user and group, whoever started it."""
    os.umask(_UMASK)


def take_precedence(nice: int) -> str:
    """Ask for a niceness; return what the system did not permit, empty when it did.

    Where the kernel groups tasks by session (sched_autogroup_enabled, the default of Debian and Ubuntu), a niceness
    counts only among those of the same session, and roslaunch gives each node one: the niceness of the session's group
    is what counts against everybody else (sched(7)). It is set only for a session of our own, not for a terminal's.
    """
    refused = []
    try:
        os.setpriority(os.PRIO_PROCESS, 0, nice)
    except OSError as error:
        refused.append(f"niceness {nice}: {error.strerror}")
    if os.getsid(0) == os.getpid():
        try:
            _AUTOGROUP.write_text(f"{nice}\n", encoding="ascii")
        except FileNotFoundError:
            return "; ".join(refused)  # this kernel does not group by session
        except OSError as error:
            refused.append(f"niceness {nice} of the session: {error.strerror}")
    return "; ".join(refused)


def take_precedence_or_say(nice: int) -> None:
    """Ask for a niceness, and say once what the system did not permit."""
    refused = take_precedence(nice)
    if refused:
        rospy.logwarn(
            "Precedence over other programs was not permitted (%s): reactions are late when the computer is busy."
            " Run as root, with CAP_SYS_NICE or with a limit of nice in /etc/security/limits.conf; or set ~nice to 0.",
            refused,
        )


def settle() -> None:
    """Call once everything is loaded: what is there now is never searched for garbage again."""
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
