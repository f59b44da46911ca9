"""A small configuration of which single files are replaced, and the message that comes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Callable

import pytest

from amaze_autonomy.config import ConfigError, load_configuration

SMALL = {
    "autonomy.yaml": "require_go: false\n",
    "sensors.yaml": """\
components:
  gps:
    group: px4
    severity: low
    autopilot: gps
  camera:
    group: other
    severity: moderate
    wait_limit_s: 20.0
    node: /camera
    topics:
      /camera/image: {rate_hz: 10.0}
    restart: {policy: node}
""",
    "missions.yaml": """\
missions:
  "1":
    description: Up and down
    files: [up.csv]
""",
    "autopilot.yaml": "backend: mavlink\n",
    "recording.yaml": """\
folder: ~/recordings
collector: main
platforms:
  main: {groups: [all]}
groups:
  all: {topics: [/camera/image]}
""",
    "up.csv": "# frame: east_north\nx,y,z,yaw_rad,holdtime\n0,0,2,0,1\n",
}


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A folder with the least that a configuration has."""
    for name, text in SMALL.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


@pytest.fixture
def mistake(small: Path) -> Callable[..., str]:
    """Replace a file of the small configuration and return the message, with paths as seen from its folder."""

    def message(file: str, text: str, overrides: object = ()) -> str:
        (small / file).write_text(text, encoding="utf-8")
        with pytest.raises(ConfigError) as caught:
            load_configuration(small, overrides)
        return str(caught.value).replace(f"{small}/", "").replace(str(small), "FOLDER")

    return message


@pytest.fixture
def small_file() -> Callable[[str], str]:
    """Return the text of a file of the small configuration."""
    return lambda name: SMALL[name]
