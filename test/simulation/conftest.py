"""Makes the tools of this folder importable for its tests, and loads the shipped configuration once."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

from amaze_autonomy.config import load_configuration


@pytest.fixture(scope="session")
def config_folder():
    return Path(__file__).parents[2] / "config"


@pytest.fixture(scope="session")
def configuration(config_folder):
    return load_configuration(config_folder)
