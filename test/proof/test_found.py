"""What the explorer has found once stays mended: every law holds on every journal of `found/`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from proof_defects import DEFECTS
from proof_explorer import explore
from proof_journal import check_journal, write
from proof_worlds import WORLDS

from amaze_autonomy.laws import LAWS, BrokenLawError
from amaze_autonomy.tester.command import main

FOUND = sorted((Path(__file__).parent / "found").glob("*.jsonl"))


@pytest.mark.parametrize("path", FOUND, ids=[path.stem for path in FOUND])
def test_every_law_holds_on_what_was_found(path):
    header = json.loads(path.read_text().splitlines()[0])
    assert header["law"] in (*LAWS, "no_loop_without_progress", "a_landed_vehicle_is_let_go")
    assert sum(check_journal(path.read_text()).values()) > 0


def test_a_broken_law_becomes_a_scenario_that_breaks_it_again(tmp_path, monkeypatch, capsys):
    defect = next(defect for defect in DEFECTS if defect.words == "`land` is left out")
    defect.breaks(monkeypatch)
    broken = explore(WORLDS["flight with imu"]).broken
    assert broken.law == "abort_is_landed"

    scenario = write(broken, WORLDS["flight with imu"].rules, tmp_path)

    path = tmp_path / "abort_is_landed-1.jsonl"
    assert scenario.name == "abort_is_landed-1.scenario.yaml"
    with pytest.raises(BrokenLawError, match="imu is at 16"):
        check_journal(path.read_text())
    assert main(["journal", str(path)]) == 0
    monkeypatch.undo()
    check_journal(path.read_text())
    assert main(["journal", str(path)]) != 0, "the engine that is mended decides otherwise"
    assert "imu" in capsys.readouterr().out
    assert main(["test", str(scenario)]) == 1, "nobody has accepted what the mended engine decides"
    assert main(["accept", "--reason", "the engine lands again", str(scenario)]) == 0
    assert main(["test", str(scenario)]) == 0
    defect.breaks(monkeypatch)
    assert main(["test", str(scenario)]) == 1, "the defect is back"


def test_the_shortest_way_is_written_first_and_a_second_one_beside_it(tmp_path, monkeypatch):
    next(defect for defect in DEFECTS if defect.words == "`land` is left out").breaks(monkeypatch)
    world = WORLDS["flight with imu"]
    broken = explore(world).broken
    assert broken.path[len(world.seeds[0]) :] == (("component", "imu", "16", "none"),)
    assert [write(broken, world.rules, tmp_path).name for _ in range(2)] == [
        "abort_is_landed-1.scenario.yaml",
        "abort_is_landed-2.scenario.yaml",
    ]
