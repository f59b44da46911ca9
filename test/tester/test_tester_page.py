"""The ready-made example of docs/tester.md is run as it stands there."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import pytest

from amaze_autonomy.tester.command import main

PAGE = (Path(__file__).parents[2] / "docs" / "tester.md").read_text(encoding="utf-8")
DATA = Path(os.environ.get("AMAZE_DATA", Path(__file__).parents[3] / "shared" / "data"))


def block(kind, holds):
    """Return the first block of code of a kind that holds a text."""
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    return next(text for found, text in blocks if found == kind and holds in text)


@pytest.mark.skipif(not (DATA / "crazyflie_sine.bag").is_file(), reason="no recordings: set AMAZE_DATA")
@pytest.mark.usefixtures("folder")
def test_a_team_keeps_a_flight_as_a_regression_test(capsys):
    flights = Path("flights")
    flights.mkdir()
    shutil.copy(DATA / "crazyflie_sine.bag", flights / "flight.bag")
    (flights / "field.scenario.yaml").write_text(block("yaml", "# field.scenario.yaml"))
    for line in block("", "amaze-replay accept flights").splitlines():
        if line.startswith("amaze-replay accept"):
            reason = re.search(r'--reason "(.*)"', line).group(1)
            assert main(["accept", "flights", "--reason", reason]) == 0
    capsys.readouterr()
    exec(block("python", "tasks_of"), {})
    assert main(["test", "flights"]) == 0
    assert capsys.readouterr().out.startswith("PASS         field: ")


@pytest.mark.skipif(not (DATA / "crazyflie_sine.bag").is_file(), reason="no recordings: set AMAZE_DATA")
@pytest.mark.usefixtures("folder")
def test_a_map_a_fault_and_anchors_of_one_s_own(capsys):
    flights = Path("flights")
    flights.mkdir()
    shutil.copy(DATA / "crazyflie_sine.bag", flights / "flight.bag")
    for name in ("quadrotor.yaml", "range.scenario.yaml"):
        (flights / name).write_text(block("yaml", f"# {name}"))
    commands = block("", "amaze-replay run flights/flight.bag").splitlines()
    for command in commands:
        assert main(command.partition("#")[0].split()[1:]) == 0
    out = capsys.readouterr().out
    assert out.startswith("PASS         range: 20 decisions, 3 expectations hold")
    assert "    PASS     exists command HOLD, within_s 0.2, from quiet: " in out
    assert Path("flight.html").stat().st_size < 15_000_000


def test_every_verb_of_the_page_is_there(capsys):
    verbs = dict.fromkeys(re.findall(r"^amaze-replay ([a-z-]+)", PAGE, re.MULTILINE))
    assert len(verbs) > 5
    for verb in verbs:
        with pytest.raises(SystemExit) as ended:
            main([verb, "--help"])
        assert ended.value.code == 0
        assert f"amaze-replay {verb}" in capsys.readouterr().out
