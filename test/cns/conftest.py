"""Makes the helpers importable, and behind all others those of test/autopilot: our planner with a simulated PX4."""

import sys
from pathlib import Path

import pytest

from amaze_autonomy.cns.importer import import_folder
from amaze_autonomy.config import load_configuration

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE)]
sys.path.append(str(HERE.parent / "autopilot"))

from cns_folder import write_folder  # noqa: E402
from flight import ENTITIES, Flight  # noqa: E402


@pytest.fixture(scope="module")
def configuration(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cns")
    import_folder(write_folder(folder / "cns"), folder / "config")
    return load_configuration(folder / "config")


@pytest.fixture
def make(configuration):
    """Return what makes a flight with stand-ins for all five nodes, each with the faults that are given for it."""

    def flight(mission="1", **faults):
        faults["watchdog"] = {"entities": ENTITIES, **faults.get("watchdog", {})}
        return Flight(configuration, mission, **faults)

    return flight
