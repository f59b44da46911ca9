"""The bounded proof: no law is broken, everything is reached, every defect is caught, and the page says so."""

from __future__ import annotations

import sys
from dataclasses import fields
from pathlib import Path

import pytest
from proof_defects import DEFECTS
from proof_figures import Figures, differences, figures_of, read
from proof_induction import Induction
from proof_pages import page
from proof_run import BOUND, Proof, prove, self_test
from proof_worlds import WORLDS

# One process explores, another one tests the test; both are done once, on the newer Python.
explored_once = pytest.mark.skipif(
    sys.version_info < (3, 9), reason="explored once, on the newer Python; test/engine runs on both"
)
explores = [explored_once, pytest.mark.xdist_group("proof")]
breaks = [explored_once, pytest.mark.xdist_group("defects"), pytest.mark.night]
PAGE = Path(__file__).parents[2] / "docs" / "safety.md"


@pytest.fixture(scope="module")
def proof():
    return prove(BOUND)


@pytest.fixture(scope="module")
def caught():
    return self_test()


class TestProof:
    pytestmark = explores

    @pytest.mark.parametrize("world", WORLDS)
    def test_no_law_is_broken(self, world, proof):
        assert proof.broken.get(world) is None

    def test_every_row_every_failure_and_every_place_is_reached(self, proof):
        assert proof.missing == []

    def test_every_law_has_something_to_say(self, proof):
        assert [name for name, count in proof.applied.items() if count == 0] == []

    def test_what_was_explored_is_what_was_accepted(self, proof):
        parts = [field.name for field in fields(Figures) if field.name not in ("defects", "induction", "reason")]
        assert differences(read(), figures_of(proof, {}, Induction()), *parts) == ()


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
