"""What changed in a proof is named figure by figure, and a person accepts it with a reason."""

from __future__ import annotations

import shutil
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import mutation_results
import proof_figures
import prove
import pytest
from mutation_results import Results
from proof_explorer import Stats
from proof_figures import Figures, by_day, differences, keep, kept, otherwise, read, shipped_limits, write
from proof_pages import page
from proof_stories import missing

ROOT = Path(__file__).parents[2]
FOUND = Figures(
    worlds={"takeoff": {"states": 10, "transitions": 30, "lies": 5, "depth": 3, "handed over": 1, "cut off": 2}},
    laws={"land_is_sticky": 7, "alarm_in_time": 3},
    compared=4,
    rules=("land", "landed"),
    places=("LAND commanding",),
    failures=("imu -> land",),
    defects={"a defect": {"law": "land_is_sticky", "world": "takeoff", "moves": 5}},
    reached={"takeoff": "land; landed"},
    decided={"takeoff": {"Answer": "1 (0000000a)", "Notify": "7 (00c0ffee)"}},
    induction={"steps": 200, "laws": 7},
    limits={"land_limit_ns": {"value": 60.0, "least": 0.0, "most": 600.0}},
)


@pytest.fixture(autouse=True)
def own_kept(monkeypatch, tmp_path):
    monkeypatch.setattr(proof_figures, "KEPT", tmp_path / "kept.json")


def test_the_same_figures_do_not_differ():
    assert differences(FOUND, replace(FOUND, reason="another one")) == ()


def test_every_change_is_one_line_that_names_it():
    now = Figures(
        worlds={
            "takeoff": {"states": 12, "transitions": 30, "lies": 5, "depth": 4, "handed over": 1, "cut off": 2},
            "lies": {"states": 1, "transitions": 2, "lies": 0, "depth": 3, "handed over": 0, "cut off": 0},
        },
        laws={"land_is_sticky": 0, "a_new_law": 1},
        compared=5,
        rules=("landed", "suspected"),
        places=("LAND commanding",),
        failures=(),
        defects={"a defect": {"law": "another_law", "world": "takeoff", "moves": 5}},
        reached={"takeoff": "landed; suspected", "lies": "landed"},
        decided={"takeoff": {"Notify": "7 (00c0ffff)"}},
        induction={"steps": 100, "laws": 7},
        limits={"land_limit_ns": {"value": 61.0, "least": 0.0, "most": 600.0}},
    )
    assert differences(FOUND, now) == (
        "worlds: lies is new: states 1, transitions 2, lies 0, depth 3, handed over 0, cut off 0",
        "worlds: takeoff: states 10 -> 12, depth 3 -> 4",
        "laws: alarm_in_time is gone",
        "laws: a_new_law is new: 1",
        "laws: land_is_sticky: 7 -> 0 times: it has fallen silent",
        "compared: 4 -> 5",
        "rules: land is no longer reached",
        "rules: suspected is reached now",
        "failures: imu -> land is no longer reached",
        "defects: a defect: law land_is_sticky -> another_law",
        "reached: lies is new: landed",
        "reached: takeoff: land is no longer reached, suspected is reached now",
        "decided: takeoff: Answer 1 (0000000a) -> None, Notify 7 (00c0ffee) -> 7 (00c0ffff)",
        "induction: steps: 200 -> 100",
        "limits: land_limit_ns: value 60.0 -> 61.0",
    )


def test_a_limit_that_ships_is_a_figure_by_its_value_and_by_what_it_may_be():
    assert shipped_limits()["preflight_fix_limit_ns"] == {"value": 60.0, "least": 0.0, "most": 3600}
    assert shipped_limits()["preflight_rounds_limit"]["value"] == 5
    assert read().limits == shipped_limits()


def test_a_world_differs_in_what_it_reaches_first_then_in_its_numbers_then_in_what_was_decided():
    counted = {"states": 10, "transitions": 30, "lies": 5, "depth": 3, "stopped": 1, "cut": 2}
    same = Stats(**counted, rules={"land": 1, "landed": 1}, commands=Counter(Answer=1, Notify=7))
    same.words.update(Answer=0xA, Notify=0xC0FFEE)
    assert otherwise(FOUND, "takeoff", same) == ""
    said = replace(same, words=Counter(Answer=0xA, Notify=0xC0FFFF))
    assert otherwise(FOUND, "takeoff", said) == "Notify 7 (00c0ffee) -> 7 (00c0ffff)"
    more = replace(said, states=12)
    assert otherwise(FOUND, "takeoff", more) == "states 10 -> 12"
    assert otherwise(FOUND, "takeoff", replace(more, rules={"land": 1})) == "landed is no longer reached"


def test_only_the_parts_that_are_asked_for_are_compared():
    assert differences(FOUND, replace(FOUND, compared=9, rules=()), "compared") == ("compared: 4 -> 9",)


def test_what_was_never_accepted_differs(tmp_path):
    assert differences(read(tmp_path / "none.json"), FOUND) == ("nothing was accepted before",)


def test_figures_are_written_with_their_reason_and_read_again(tmp_path):
    accepted = write(FOUND, "a world was added", tmp_path / "accepted.json")
    assert read(tmp_path / "accepted.json") == accepted == replace(FOUND, reason="a world was added")


def test_the_last_run_is_kept_until_a_source_changes(monkeypatch):
    assert kept() is None
    keep(replace(FOUND, sources=proof_figures.fingerprint()))
    assert differences(kept(), FOUND) == ()
    monkeypatch.setattr(proof_figures, "fingerprint", lambda: "other sources")
    assert kept() is None


def test_every_source_of_the_proof_is_in_its_fingerprint_and_nothing_else(monkeypatch, tmp_path):
    shutil.copytree(
        str(ROOT / "src"), str(tmp_path / "src"), ignore=shutil.ignore_patterns("__pycache__", "*.egg-info")
    )
    for name in ("proof", "engine", "mutation"):
        shutil.copytree(str(ROOT / "test" / name), str(tmp_path / "test" / name))
    monkeypatch.setattr(proof_figures, "ROOT", tmp_path)
    folders = [str(tmp_path / name) for name in ("test/proof", "test/engine", "test/mutation", "src")]
    monkeypatch.setattr(sys, "path", [*folders, *sys.path])
    prints = {proof_figures.fingerprint()}
    changed = ("engine/decide.py", "engine/rules.py", "laws/ground.py", "../../test/proof/proof_worlds.py")
    for count, name in enumerate((*changed, "../../test/engine/expected_decisions.py"), start=2):
        with (tmp_path / "src" / "amaze_autonomy" / name).open("a") as source:
            source.write("# another line\n")
        prints.add(proof_figures.fingerprint())
        assert len(prints) == count, name
    (tmp_path / "src" / "amaze_autonomy" / "bags" / "cli.py").write_text("")
    assert proof_figures.fingerprint() in prints


def test_a_commit_explores_all_worlds_again_unless_the_figures_are_of_its_sources():
    worlds = [f"world {number}" for number in range(30)]
    assert by_day(worlds, None, 5) == by_day(worlds, FOUND, 5) == tuple(worlds)
    drawn = by_day(worlds, replace(FOUND, sources=proof_figures.fingerprint()), 5)
    assert len({*drawn}) == 5
    assert {*drawn} < {*worlds}


@pytest.mark.parametrize("reason", [(), ("--reason", "ok")])
def test_nothing_is_accepted_without_a_reason(reason, capsys):
    assert prove.main(["accept", *reason]) == 2
    assert "why are these figures right now? Say it with --reason" in capsys.readouterr().err


def test_nothing_is_accepted_in_ci(monkeypatch, capsys):
    monkeypatch.setenv("CI", "true")
    assert prove.main(["accept", "--reason", "the engine lands again"]) == 2
    assert "figures are not accepted in CI (CI is set)" in capsys.readouterr().err


def test_a_proof_that_fails_cannot_be_accepted(monkeypatch, capsys):
    monkeypatch.setattr(prove, "_prove", lambda _: None)
    assert prove.main(["accept", "--reason", "the engine lands again"]) == 1
    assert "not accepted" in capsys.readouterr().err


def test_what_a_campaign_of_mutants_writes_is_what_the_page_shows(monkeypatch, tmp_path):
    monkeypatch.setattr(mutation_results, "RESULTS", tmp_path / "results.json")
    path = tmp_path / "safety.md"
    path.write_text(page(read()), encoding="utf-8")
    assert mutation_results.HEAD not in path.read_text(encoding="utf-8"), "none is kept"
    for seed in (7, 8):
        mutation_results.write(Results(seed, 100, {}, []), mutation_results.RESULTS, path)
        assert f"drawn by the seed {seed}" in path.read_text(encoding="utf-8")
        assert path.read_text(encoding="utf-8") == page(read())


def test_every_story_that_the_page_names_is_told():
    assert missing() == []
