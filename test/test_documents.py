"""The generated parts of docs/: what stands there is what the code says."""

from __future__ import annotations

from pathlib import Path

import pytest

from amaze_autonomy.documents import (
    DocumentError,
    documents,
    filled,
    first_difference,
    not_shown,
    regenerated,
    shipped_configuration,
)

DOCS = Path(__file__).parents[1] / "docs"
PAGES = [DOCS.parent / "README.md", *sorted(DOCS.glob("*.md"))]
PAGE = "# Title\n\n<!-- generated:one -->\nold\n<!-- end -->\n\nmiddle\n\n<!-- generated:two -->\n<!-- end -->\n"
PARTS = {"one": lambda: "1\n", "two": lambda: "2"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_page_differs_from_the_code(page):
    text = page.read_text(encoding="utf-8")
    assert filled(text, documents()) == text, "run: amaze-autonomy docs"


def test_autonomy_yaml_is_what_the_limits_of_the_engine_say():
    path, is_there, should_be = shipped_configuration()
    assert path.name == "autonomy.yaml"
    assert is_there == should_be, "run: amaze-autonomy docs"


def test_every_part_is_shown_by_a_page():
    assert not_shown(page.read_text(encoding="utf-8") for page in PAGES) == ()


def test_a_page_is_filled_between_its_markers_alone():
    first = "# Title\n\n<!-- generated:one -->\n\n1\n\n<!-- end -->\n\n"
    expected = f"{first}middle\n\n<!-- generated:two -->\n\n2\n\n<!-- end -->\n"
    assert filled(PAGE, PARTS) == expected
    assert filled(expected, PARTS) == expected


def test_a_marker_that_nothing_is_generated_for_is_refused():
    with pytest.raises(DocumentError) as caught:
        filled(PAGE, {"one": PARTS["one"]})
    assert str(caught.value) == "nothing is generated for the marker two; there is one"


@pytest.mark.parametrize("page", ["<!-- generated:one -->\n", "<!-- end -->\n", "<!-- generated:one -->\n" + PAGE])
def test_half_a_pair_of_markers_is_refused(page):
    with pytest.raises(DocumentError, match=r"^\d markers begin a generated part, \d end one$"):
        filled(page, PARTS)


def test_the_pages_of_a_folder_are_made_anew(tmp_path):
    (tmp_path / "a.md").write_text("<!-- generated:severities -->\nold\n<!-- end -->\n")
    ((path, old, new),) = regenerated(tmp_path)
    assert path == tmp_path / "a.md"
    assert "\nold\n" in old
    assert "| Severity |" in new
    assert "severities" not in not_shown([new])
    assert "transitions" in not_shown([new])


def test_a_mistake_names_its_page(tmp_path):
    (tmp_path / "a.md").write_text("<!-- end -->\n")
    with pytest.raises(DocumentError) as caught:
        regenerated(tmp_path)
    assert str(caught.value) == f"{tmp_path}/a.md: 0 markers begin a generated part, 1 end one"


@pytest.mark.parametrize(
    "old, new, difference",
    [("a\nb\nc", "a\nx\nc", (2, "b", "x")), ("a", "a\nb", (2, "", "b")), ("a\nb", "a", (2, "b", ""))],
)
def test_the_first_difference_is_shown(old, new, difference):
    assert first_difference(old, new) == difference
