"""The bounded proof: no law is broken, everything is reached, every defect is caught, and the page says so."""

from __future__ import annotations

import sys
from dataclasses import fields
from pathlib import Path

import pytest
from proof_defects import DEFECTS
from proof_figures import OF_NO_RUN, Figures, by_day, differences, figures_of, otherwise, read
from proof_induction import Induction
from proof_pages import page
from proof_run import BOUND, Proof, expected_coverage, explored, self_test
from proof_worlds import WORLDS

from amaze_autonomy.laws import LAWS

# One process explores, another one tests the test; both are done once, on the newer Python.
explored_once = pytest.mark.skipif(
    sys.version_info < (3, 9), reason="explored once, on the newer Python; test/engine runs on both"
)
explores = [explored_once, pytest.mark.xdist_group("proof")]
breaks = [explored_once, pytest.mark.xdist_group("defects"), pytest.mark.night]
PAGE = Path(__file__).parents[2] / "docs" / "safety.md"
DAY = by_day([*WORLDS], read(), 8)
WHOLE = [] if len(DAY) == len(WORLDS) else [pytest.mark.night]


@pytest.fixture(scope="module")
def proof():
    return Proof()


@pytest.fixture
def explore(proof):
    def each(world):
        if world not in proof.stats:
            _, proof.stats[world], broken = explored((world, BOUND))
            if broken is not None:
                proof.broken[world] = broken
        return proof.stats[world]

    return each


@pytest.fixture(scope="module")
def caught():
    return self_test()


class TestProof:
    pytestmark = explores

    @pytest.mark.parametrize(
        "world", [pytest.param(world, marks=[] if world in DAY else pytest.mark.night) for world in WORLDS]
    )
    def test_no_law_is_broken_and_what_is_explored_is_what_was_accepted(self, world, explore, proof):
        stats = explore(world)
        assert proof.broken.get(world) is None
        assert otherwise(read(), world, stats) == ""

    @pytest.mark.parametrize("all_worlds", [pytest.param(WORLDS, marks=WHOLE, id="all")])
    def test_what_all_worlds_reach_together_is_what_was_accepted(self, all_worlds, explore, proof):
        for world in all_worlds:
            explore(world)
        assert proof.broken == {}
        assert proof.missing == []
        parts = [each.name for each in fields(Figures) if each.name not in ("defects", "induction", *OF_NO_RUN)]
        assert differences(read(), figures_of(proof, {}, Induction()), *parts) == ()


def test_every_row_every_failure_and_every_place_is_reached():
    expected, accepted = expected_coverage(), read()
    assert expected.rules <= {*accepted.rules}
    assert {" -> ".join(pair) for pair in expected.failures} <= {*accepted.failures}
    assert {" ".join(place).strip() for place in expected.places} <= {*accepted.places}


def test_every_law_has_something_to_say():
    accepted = read()
    assert {*accepted.laws} == {*LAWS}
    assert [name for name, count in accepted.laws.items() if count == 0] == []


class TestDefects:
    pytestmark = breaks

    def test_every_deliberate_defect_is_caught(self, caught):
        assert [words for words, by in caught.items() if by is None] == []
        assert len(caught) == len(DEFECTS) >= 40

    def test_what_was_caught_is_what_was_accepted(self, caught):
        assert differences(read(), figures_of(Proof(), caught, Induction()), "defects") == ()


def test_the_page_says_what_was_accepted():
    assert PAGE.read_text(encoding="utf-8") == page(read())


def test_every_pair_of_rows_with_different_verbs_is_explored():
    rows = ("gps", "barometer", "lrf", "imu")
    pairs = {f"{one} and {other}" for number, one in enumerate(rows) for other in rows[number + 1 :]}
    assert pairs <= set(WORLDS)
