"""A folder with a scenario, and the configuration that ships; the bags that replays are tested with are at hand."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "replay"))

from amaze_autonomy.config import load_configuration
from amaze_autonomy.paths import config_folder

LRF = """\
version: 1
description: "The range finder dies in flight: hold, then land."
tags: [hold]
requirements: [R-7]
anchors: {fails: {fault: 1}}
faults:
  - {component: lrf, fault: killed, after: {event: airborne, delay_s: 5.0}, restart: fails}
expectations:
  - {expect: response, when: {component: lrf, code: 8}, then: {command: HOLD}, within_s: 0.4}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with one scenario, and no golden."""
    monkeypatch.chdir(tmp_path)
    folder = Path("suite")
    folder.mkdir()
    (folder / "lrf.scenario.yaml").write_text(LRF)
    return folder


@pytest.fixture(scope="session")
def configuration():
    return load_configuration(config_folder())
