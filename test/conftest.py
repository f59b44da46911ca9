"""What all tests share: a desk, how hypothesis searches, and what happens on a system without pseudo terminals."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import Phase, settings
from hypothesis.configuration import set_hypothesis_home_dir

from amaze_autonomy.tester.golden import CI_VARIABLES

# In CI nothing is accepted. Tests run as at a desk, wherever they run; those of CI say so themselves.
for name in CI_VARIABLES:
    os.environ.pop(name, None)

set_hypothesis_home_dir(Path(__file__).parents[1] / "build" / "hypothesis")
# The same examples in each run, so that a red test stays red. HYPOTHESIS_PROFILE=search looks for new ones.
settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.register_profile("search", max_examples=2000, deadline=None, print_blob=True)
# A mutant is caught by the first example that fails: test/mutation has no use for a smaller one.
settings.register_profile(
    "mutants", derandomize=True, deadline=None, database=None, phases=(Phase.explicit, Phase.generate)
)
# On another version of Python: that it is the same there, not once more whether it is right.
settings.register_profile("few", derandomize=True, deadline=None, database=None, max_examples=15)
PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "repeatable")
settings.load_profile(PROFILE)


@pytest.fixture
def umask_of_nodes():
    """Write as nodes do, whoever starts them (test/nodes/test_process.py)."""
    before = os.umask(0o027)
    yield
    os.umask(before)


def pytest_collection_modifyitems(config, items):
    """With few examples, a test of many rows has its first and its last one."""
    if PROFILE != "few":
        return
    rows = {}
    for item in items:
        rows.setdefault(item.nodeid.partition("[")[0], []).append(item)
    kept = {id(item) for each in rows.values() for item in (each[0], each[-1])}
    config.hook.pytest_deselected(items=[item for item in items if id(item) not in kept])
    items[:] = [item for item in items if id(item) in kept]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup():
    return (yield from skipped_without_terminals())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call():
    return (yield from skipped_without_terminals())


def skipped_without_terminals():
    """A root folder that somebody made by hand often has no /dev/pts."""
    try:
        return (yield)
    except OSError as error:
        if str(error) != "out of pty devices":
            raise
        pytest.skip("this system has no pseudo terminals (/dev/pts)")
