"""What all tests share: a desk, how hypothesis searches, and what happens on a system without pseudo terminals."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import Phase, settings
from hypothesis.configuration import set_hypothesis_home_dir

sys.path.append(str(Path(__file__).parent))
import drawn

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


def pytest_report_header(config):
    thins = drawn.SEED and "not" in config.option.markexpr and "night" in config.option.markexpr
    return f"of what takes long a quarter is tested, drawn by AMAZE_DRAW={drawn.SEED}" if thins else None


@pytest.fixture
def umask_of_nodes():
    """Write as nodes do, whoever starts them (test/nodes/test_process.py)."""
    before = os.umask(0o027)
    yield
    os.umask(before)


def groups_of(item):
    """Return the name under which tests share something that takes long to make, if any."""
    mark = item.get_closest_marker("xdist_group")
    return [] if mark is None else [mark.args[0]]


def is_wanted(item, builds):
    """Return whether this commit has a test; `builds`: which of what is built for many tests it makes."""
    group = groups_of(item)
    if item.get_closest_marker("builds") is not None:
        return group[0] in builds if group else drawn.is_drawn(item.nodeid)
    function = item.nodeid.partition("[")[0].rpartition("::")[2]
    if PROFILE != "few" and (item.path not in drawn.FILES or drawn.is_kept(item.path.parent.name, function)):
        return True
    return drawn.is_drawn((group or [item.nodeid])[0])


@pytest.hookimpl(tryfirst=True)  # before it is decided what of the night is left out
def pytest_collection_modifyitems(config, items):
    """Leave rows of slow tests to the night (`slow_rows`), and with few examples those between the first and the last.

    Likewise what is not drawn. What waits for the jobs beside this run comes last.
    """
    groups = {name: item for item in items for name in groups_of(item) if item.get_closest_marker("night") is None}
    builds = drawn.some_of(sorted(name for name, item in groups.items() if item.get_closest_marker("builds")))
    for item in items:
        if not is_wanted(item, builds):
            item.add_marker("night")
    rows = {}
    for item in items:
        rows.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for each in rows.values():
        mark = each[0].get_closest_marker("slow_rows")
        for item in () if mark is None else each[1:] if mark.args == (1,) else each[1:-1]:
            item.add_marker("night")
    if PROFILE == "few":
        between = {id(item) for each in rows.values() for item in each[1:-1]}
        config.hook.pytest_deselected(items=[item for item in items if id(item) in between])
        items[:] = [item for item in items if id(item) not in between]
    items.sort(key=lambda item: item.path.name == "test_stages.py")


def pytest_terminal_summary(terminalreporter):
    """Show how the jobs ended that ran before this run or beside it: each shows that itself, but its log is a file."""
    for log in sorted(Path(os.environ.get("AMAZE_STAGES", os.devnull)).glob("*.log")):
        lines = [line for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
        terminalreporter.write_line(f"{log.stem}: {lines[-1] if lines else 'said nothing'}")


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
