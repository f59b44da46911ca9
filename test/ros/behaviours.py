"""Runs behaviours as tests: each is a function of a running `Stack`; several fly at the same time.

A behaviour names the rules of the transition table that make it. With `--crippled` the same behaviours fly with an
engine that lacks these rules, and each of them must fail: a test that cannot fail is none.

What fails in this crowd, on a machine that had hardly time for it, is flown once more when the others have landed;
both outcomes are told. What fails on a machine that has time has failed.
"""

from __future__ import annotations

import os
import sys
import threading
import time
import unittest
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import wait as wait_for_all
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

import rospkg
import rospy
import rostest
from hitches import idle_s
from stack import Stack, TestConfiguration

sys.path.append(str(Path(__file__).resolve().parents[1]))
from drawn import some_of

from amaze_autonomy.ros.rospy_flaws import mend_rospy

AT_ONCE = 6 * (os.cpu_count() or 1)
AGAIN = "flown_again.log"  # in ROS_HOME; `./run test-ros` shows it
BUSY_FRACTION = 0.2  # of the processors' time: where less than that is idle, processes wait for each other
_QUICK = bool(os.environ.get("AMAZE_QUICK"))
"""`./run test-ros quick`: without those for the night; within `./run test` a quarter of the others."""
_starting = threading.Semaphore(2)


@dataclass(frozen=True)
class Behaviour:
    """One behaviour: what runs, with which stack, the rules that make it; `night`: `test-ros quick` leaves it out."""

    run: Callable[[Stack], None]
    rules: Tuple[str, ...]
    options: Dict[str, Any]
    start: bool = True
    night: bool = False

    @property
    def name(self) -> str:
        return self.run.__name__


class Behaviours:
    """All behaviours of one test file; `overrides` of the configuration are those of each."""

    def __init__(self, *overrides: str) -> None:
        self._overrides = overrides
        self._all: List[Behaviour] = []

    def add(
        self, *rules: str, start: bool = True, night: bool = False, **options: Any
    ) -> Callable[[Callable[[Stack], None]], Callable[[Stack], None]]:
        """Register a function; `rules` are taken out of the engine in the self-check."""

        def register(run: Callable[[Stack], None]) -> Callable[[Stack], None]:
            own = (*self._overrides, *options.pop("overrides", ()))
            self._all.append(Behaviour(run, rules, {**options, "overrides": own}, start, night))
            return run

        return register

    def main(
        self, package: str, name: str, at_start: Callable[[], None] = lambda: None, at_once: int = AT_ONCE
    ) -> None:
        """Run as a rostest node; `at_start` is called once it is one."""
        crippled = "--crippled" in sys.argv
        sys.argv = [word for word in sys.argv if word != "--crippled"]
        mend_rospy()
        rospy.init_node(name)
        at_start()
        only = [word.split("=", 1)[1] for word in sys.argv if word.startswith("--only=")]
        sys.argv = [word for word in sys.argv if not word.startswith("--only=")]
        today = [each for each in self._all if not (each.night and _QUICK)]
        drawn = some_of([each.name for each in today]) if _QUICK and not only else [each.name for each in today]
        chosen = [each for each in today if (each.rules or not crippled) and each.name in (only or drawn)]
        rostest.rosrun(package, name, _test_case(chosen, at_once, crippled=crippled), sys.argv)


def _test_case(behaviours: List[Behaviour], at_once: int, *, crippled: bool) -> type:
    """Make a TestCase that starts all behaviours at first, and has one test for the outcome of each."""

    def set_up_class(cls: Any) -> None:
        cls.configuration = TestConfiguration()
        cls.pool = ThreadPoolExecutor(at_once)
        folder = cls.configuration.folder
        cls.outcomes = {each.name: cls.pool.submit(_fly, each, folder, crippled=crippled) for each in behaviours}

    def tear_down_class(cls: Any) -> None:
        cls.pool.shutdown()
        cls.configuration.remove()

    members: Dict[str, Any] = {
        "setUpClass": classmethod(set_up_class),
        "tearDownClass": classmethod(tear_down_class),
    }
    for each in behaviours:
        members[f"test_{each.name}"] = _test(each, crippled=crippled)
    return type("TestBehaviours", (unittest.TestCase,), members)


def _test(behaviour: Behaviour, *, crippled: bool) -> Callable[[Any], None]:
    name = behaviour.name

    def healthy(self: Any) -> None:
        failed = self.outcomes[name].exception()
        if failed is None:
            return
        if not isinstance(failed, BusyError):
            raise failed
        with (Path(rospkg.get_ros_home()) / AGAIN).open("a") as log:
            log.write(f"{name} failed on a busy machine, and is flown again: {failed}\n\n")
        wait_for_all(self.outcomes.values())
        _fly(behaviour, self.configuration.folder, name=f"{name}_again")

    def must_fail(self: Any) -> None:
        outcome: Future[None] = self.outcomes[name]
        error = outcome.exception()
        self.assertIsInstance(error, AssertionError, f"{name} passes although the reaction that it tests is disabled")

    return must_fail if crippled else healthy


class BusyError(AssertionError):
    """A behaviour failed on a machine that had hardly time for it."""


def _fly(behaviour: Behaviour, folder: Any, *, name: str = "", crippled: bool = False) -> None:
    rules = behaviour.rules if crippled else ()
    patience_s = 5.0 if crippled else 40.0
    began_s, began_idle_s = time.monotonic(), idle_s()
    stack = Stack(name or behaviour.name, folder, rules=rules, patience_s=patience_s, **behaviour.options)
    try:
        if behaviour.start:
            with _starting:
                stack.start()
                stack.wait(lambda: stack.states, "the first state")
        behaviour.run(stack)
        stack.stop()
        if not crippled:  # there the story must notice by itself
            stack.check_laws()
            stack.check_modes()
    except AssertionError as error:
        if crippled:
            stack.remove()
        took_s = time.monotonic() - began_s
        idle = (idle_s() - began_idle_s) / took_s / (os.cpu_count() or 1)
        words = f"{error}\nafter {took_s:.1f} s, in which the processors were idle for {idle:.0%}\n{stack.story()}"
        raise (BusyError if idle < BUSY_FRACTION else AssertionError)(words) from error
    finally:
        stack.stop()
    stack.remove()
