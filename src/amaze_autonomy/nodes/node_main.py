"""What the nodes beside the engine have in common: their start, their parameters, their end.

~config      folder of the configuration; empty: the one that ships with the package
~overrides   keys of the configuration that are to be different, with semicolons between
~startup_time  seconds after its start in which a check says of what was not heard yet that it comes by itself
~nice        niceness of the process, where the system permits it
"""

from __future__ import annotations

import signal
import sys
import threading
from dataclasses import replace
from typing import Any, Callable, Protocol, Sequence, Tuple

import rospy

from amaze_autonomy.config import ConfigError, Configuration, load_configuration
from amaze_autonomy.engine.checks import Check, Verdict
from amaze_autonomy.monitoring.errors import MonitoringError

from . import parameters, process
from .clock import Clock, make_clock, wait_for_time
from .errors import NodeError, StartError
from .reconnector import Reconnector

__all__ = ["RunningNode", "Startup", "run_node"]

_START_ERROR = 2
_LONGEST_S = 3600.0


class RunningNode(Protocol):
    """A node that `run_node` starts."""

    def run(self) -> None:
        """Work until `end` is called."""

    def end(self) -> None:
        """Have `run` return; called from signal handlers and other threads."""


def run_node(name: str, make: Callable[[Configuration, Clock], RunningNode]) -> int:
    """Run a node on this thread until it is told to end; return its exit status."""
    process.survive_a_closed_terminal()
    rospy.init_node(name, disable_signals=True)
    stopped = threading.Event()
    node: Any = None
    reconnector = Reconnector()

    def end(*_: Any) -> None:
        stopped.set()
        if node is not None:
            node.end()

    for number in process.END_SIGNALS:
        signal.signal(number, end)
    rospy.core.add_preshutdown_hook(end)
    try:
        process.take_precedence_or_say(_nice())
        configuration = load_configuration(parameters.configuration_folder(), parameters.overrides())
        wait_for_time(stopped)
        node = make(configuration, make_clock())
        process.settle()
        reconnector.start()
        if not stopped.is_set():
            node.run()
    except (ConfigError, NodeError, MonitoringError) as error:
        print(f"{name}: {error}", file=sys.stderr, flush=True)
        return _START_ERROR
    finally:
        reconnector.stop()
        rospy.signal_shutdown("ended")
    return 0


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
    value = rospy.get_param("~startup_time", otherwise_ns * 1e-9)
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0.0 <= value < _LONGEST_S:
        raise StartError(f"~startup_time is {value!r}, must be seconds, not negative")
    return round(value * 1e9)


def _nice() -> int:
    value = rospy.get_param("~nice", -10)
    if not isinstance(value, int) or isinstance(value, bool):
        raise StartError(f"~nice is {value!r}, must be a whole number")
    return value
