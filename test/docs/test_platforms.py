"""Where it runs: the page that says what was seen, the README, the classifiers and `./run test-bare` name the same."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def rows():
    """Return the cells of each row of the table of platforms."""
    page = (ROOT / "docs" / "building.md").read_text(encoding="utf-8")
    table = page.partition("## Platforms")[2].partition("### ")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:2] == "| "]


def versions(text):
    """Return the versions of Python that are named, also as `3.8 to 3.14`."""
    spans = [(int(first), int(last or first)) for first, last in re.findall(r"\b3\.(\d+)(?: to 3\.(\d+))?", text)]
    return {number for first, last in spans for number in range(first, last + 1)}


def test_readme_and_page_promise_the_same_debians():
    promised = {
        re.search(r"Debian (\d+)", system)[1] for system, _, promise, _ in rows() if promise[:10] == "everything"
    }
    named = re.search(r"bare Debian ((?:\d+(?:, | or )?)+) with", (ROOT / "README.md").read_text(encoding="utf-8"))[1]
    assert promised == set(re.findall(r"\d+", named))


def test_each_promised_debian_is_one_that_is_made_bare():
    promised = {re.search(r"\((\w+)\)", system)[1] for system, _, promise, _ in rows() if promise[:10] == "everything"}
    offered = re.search(
        r"^run_test-bare\(\) { # \[([a-z|]+)\]", (ROOT / "run").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert promised <= set(offered[1].split("|"))


def test_readme_classifiers_and_page_promise_the_same_pythons():
    offline = versions(next(python for system, python, _, _ in rows() if "without ROS" in system))
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert {int(number) for number in re.findall(r'"Programming Language :: Python :: 3\.(\d+)"', project)} == offline
    assert f'requires-python = ">=3.{min(offline)}"' in project
    sentence = re.search(
        r"offline commands on any Linux with Python ([^;]+);", (ROOT / "README.md").read_text(encoding="utf-8")
    )
    assert versions(sentence[1]) == offline


def test_whatever_system_is_promised_has_a_python_that_is():
    offline = versions(next(python for system, python, _, _ in rows() if "without ROS" in system))
    systems = {system: versions(python.partition(",")[0]) for system, python, _, _ in rows()[1:]}
    assert len(systems) > 3
    assert {system: named for system, named in systems.items() if not named or named - offline} == {}
