"""Runs the tests of a TestCase at the same time: most of the time each waits for a vehicle.

Each test needs a namespace, nodes and a vehicle of its own. They begin with the class; the test tells how each ended.
"""

from __future__ import annotations

import unittest
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Callable, Dict, Type

LIMIT_S = 800.0  # less than that of the files *.test, which would not name the test
_Case = Type[unittest.TestCase]


def at_once(number: int) -> Callable[[_Case], _Case]:
    """Return a decorator: so many tests of a class run at the same time."""

    def decorate(kind: _Case) -> _Case:
        names = unittest.defaultTestLoader.getTestCaseNames(kind)

        def set_up_class(cls: Any) -> None:
            cls.pool = ThreadPoolExecutor(number)
            cls.outcomes = {name: cls.pool.submit(_run, kind(name)) for name in names}

        def tear_down_class(cls: Any) -> None:
            cls.pool.shutdown()

        members: Dict[str, Any] = {name: _told(name) for name in names}
        members.update(setUpClass=classmethod(set_up_class), tearDownClass=classmethod(tear_down_class))
        return type(kind.__name__, (unittest.TestCase,), members)

    return decorate


def _run(case: Any) -> None:
    """Run one test; what it raises is told later."""
    try:
        case.setUp()
        getattr(case, case._testMethodName)()
    finally:
        case.tearDown()


def _told(name: str) -> Callable[[Any], None]:
    def test(self: Any) -> None:
        self.outcomes[name].result(LIMIT_S)

    return test
