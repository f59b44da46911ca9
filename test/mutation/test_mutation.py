"""Mutants: nobody picks them, what a net caught is told apart from what survived, and the page shows what was found."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import mutation_campaign
import mutation_mutant
import mutation_results
import pytest
from mutation_code import diff, mutated, of_source, places, sample, span
from mutation_mutant import Mutant, Place
from mutation_nets import IMPORTS, Seen
from mutation_results import Results, Verdict, rate, read, section, summary, waivers, write

ROOT = Path(__file__).parents[2]
SOURCE = """\
LIMIT = 3


def judged(value, last):
    if value > LIMIT and value is not None:
        return last == value
    for each in last:
        value += each
    return value
"""
LIMIT, OTHER = "src/amaze_autonomy/engine/limit.py", "src/amaze_autonomy/engine/other.py"


@pytest.fixture
def repository(tmp_path):
    """Return a repository of one function, with one test."""
    files = {
        "src/amaze_autonomy/__init__.py": "",
        "src/amaze_autonomy/engine/__init__.py": "",
        LIMIT: "def over(value):\n    return value > 3\n\n\ndef unseen(value):\n    pass\n    return not value\n",
        "src/amaze_autonomy/journal/__init__.py": "",
        "src/amaze_autonomy/monitoring/__init__.py": "",
        "test/engine/test_limit.py": "from amaze_autonomy.engine.limit import over\n\n\n"
        "def test_over():\n    assert (over(2), over(9)) == (False, True)\n",
        "test/journal/test_no_line.py": "def test_nothing():\n    assert 1 < 2\n",
        "test/monitoring/test_nothing.py": "def test_nothing():\n    assert 1 < 2\n",
        "test/test_documents.py": "def test_nothing():\n    assert 1 < 2\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def run(repository, *more):
    program = (
        f"import sys, pathlib; sys.path.insert(0, {str(Path(__file__).parent)!r}); import mutate;"
        f"sys.exit(mutate.main(['--nets', 'unit', '--seed', '4', *{more!r}], pathlib.Path({str(repository)!r})))"
    )
    environment = {"PATH": "/usr/bin:/bin", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        cwd=repository,
        timeout=600,
    )
    assert done.stderr == ""
    return done.returncode, done.stdout


def test_each_place_is_found_with_each_operator_but_those_that_change_nothing():
    found = [(place.line, place.operator.rpartition("/")[2]) for place in of_source(SOURCE, "a.py")]
    assert {name for line, name in found if line == 1} == {"NumberReplacer"}
    assert {name for line, name in found if line == 7} == {"ZeroIterationForLoop"}
    assert "ReplaceAndWithOr" in {name for line, name in found if line == 5}
    assert "ReplaceComparisonOperator_Eq_NotEq" in {name for line, name in found if line == 6}
    assert not {name for _, name in found} & {name.rpartition("/")[2] for name in mutation_mutant.SAME_BY_NATURE}


def test_a_mutant_is_the_file_with_one_change():
    (place,) = (each for each in of_source(SOURCE, "a.py") if each.operator == "core/ReplaceAndWithOr")
    assert mutated(SOURCE, place) == SOURCE.replace(" and ", " or ")
    assert diff(SOURCE, place).splitlines()[3:] == [
        " def judged(value, last):",
        "-    if value > LIMIT and value is not None:",
        "+    if value > LIMIT or value is not None:",
        "         return last == value",
    ]


def test_a_sample_is_drawn_by_its_seed_and_a_larger_one_begins_with_it(repository):
    found = places(repository)
    some, more, others = (sample(found, *what, repository) for what in ((3, 1), (6, 1), (6, 2)))
    assert more[:3] == some == sample(found, 3, 1, repository)
    assert more != others
    assert len({mutant.key for mutant in more}) == 6
    assert len({mutant.place[:3] for mutant in some}) == 3, "places first"


def test_a_change_of_the_code_draws_anew_what_it_touches_alone(repository):
    before = sample(places(repository), 1000, 1, repository)
    path = repository / LIMIT
    path.write_text(f"LIMIT = 3\n\n\n{path.read_text()}", encoding="utf-8")
    after = sample(places(repository), 1000, 1, repository)
    new = [mutant for mutant in after if mutant.place.line == 1]
    assert new
    assert [mutant.key for mutant in after if mutant not in new] == [mutant.key for mutant in before]


def test_more_than_there_are_is_all_there_are(repository):
    found = places(repository)
    drawn = sample(found, 1000, 1, repository)
    assert sorted(mutant.place for mutant in drawn) == sorted(found)


@pytest.mark.parametrize(
    "line, statement", [(1, (0, 0)), (4, (0, 0)), (5, (5, 5)), (6, (6, 6)), (7, (7, 7)), (8, (8, 8)), (9, (9, 9))]
)
def test_a_mutant_belongs_to_a_statement_or_to_the_loading_of_its_module(line, statement):
    assert span(SOURCE, line) == statement


def test_a_statement_of_several_lines_is_one():
    source = "def one():\n    return [\n        1,\n        2,\n    ]\n\n\ntwo = {\n    3: 4,\n}\n"
    assert [span(source, line) for line in range(1, 11)] == [(0, 0), *[(2, 5)] * 4, *[(0, 0)] * 5]


@pytest.mark.night
def test_who_asks_catches_nobody_else_does_and_what_is_known_is_not_looked_at_again(repository):
    status, shown = run(repository)
    lines = shown.splitlines()
    caught = {line.rpartition(" ")[2] for line in lines if f"{LIMIT}:2" in line}
    unseen = {line.rpartition(" ")[2] for line in lines if f"{LIMIT}:7" in line}
    assert status == 1
    assert "test/engine/test_limit.py::test_over" in caught
    assert unseen == {"SURVIVED"}
    assert "-    return value > 3\n+    return value > 4" in shown, "a survivor is shown with its change"
    assert (repository / LIMIT).read_text(encoding="utf-8").startswith("def over(value):\n    return value > 3\n")
    again = run(repository)
    assert again[0] == 1
    assert again[1].splitlines()[1:] == lines[next(n for n, line in enumerate(lines) if not line) :]


@pytest.mark.night
def test_what_runs_at_the_import_alone_is_shown_to_all(repository):
    path, test = repository / LIMIT, repository / "test/engine/test_limit.py"
    path.write_text(
        path.read_text(encoding="utf-8") + "\n\ndef made(value):\n    return value + 4\n\n\nMADE = made(4)\n"
    )
    more = "\n\ndef test_made():\n    from amaze_autonomy.engine.limit import MADE\n\n    assert MADE == 8\n"
    test.write_text(test.read_text(encoding="utf-8") + more, encoding="utf-8")
    lines = [line for line in run(repository)[1].splitlines() if f"{LIMIT}:11" in line]
    assert lines
    assert not [line for line in lines if line.endswith("SURVIVED")]


@pytest.mark.night
def test_a_test_more_shows_the_survivors_again_and_them_alone(repository):
    before = run(repository)[1]
    more = "\n\ndef test_the_limit():\n    assert (over(3), over(4)) == (False, True)\n"
    path = repository / "test/engine/test_limit.py"
    path.write_text(path.read_text(encoding="utf-8") + more, encoding="utf-8")
    status, shown = run(repository)
    assert before.count("SURVIVED\n") > shown.count("SURVIVED\n") > 0
    assert "test_the_limit\n" in shown
    assert "test_over\n" not in shown
    assert status == 1


@pytest.mark.night
def test_a_campaign_goes_on_elsewhere_from_what_the_repository_keeps(repository):
    (repository / "docs").mkdir()
    (repository / "docs/safety.md").write_text("# Title\n", encoding="utf-8")
    before = run(repository, "--write")[1]
    shutil.rmtree(repository / "build")
    after = run(repository)[1]
    assert "test_over\n" in before
    assert "test_over\n" not in after
    assert before.count("SURVIVED\n") > after.count("SURVIVED\n") == 0, "nobody would look otherwise"
    test = repository / "test/engine/test_limit.py"
    test.write_text(test.read_text(encoding="utf-8") + "# new\n", encoding="utf-8")
    assert run(repository)[1].count("SURVIVED\n") == before.count("SURVIVED\n"), "whom nothing caught is shown again"
    (repository / LIMIT).write_text((repository / LIMIT).read_text(encoding="utf-8") + "# new\n", encoding="utf-8")
    assert "test_over\n" in run(repository)[1], "of other code nothing is known"


def test_what_has_caught_a_mutant_of_older_code_looks_first_and_alone(repository, monkeypatch):
    (mutant,) = (one for one in sample(places(repository), 99, 1, repository) if one.after == "return value > 4")
    by = {"unit": "test/engine/test_limit.py::test_9", "explorer": "a_law -> 7 (world 9)"}
    told = TOLD._replace(verdicts=[Verdict(mutant, by, "")], code={LIMIT: "older"})
    (repository / "docs").mkdir()
    (repository / "docs/safety.md").write_text("# Title\n", encoding="utf-8")
    write(told, repository / "test/mutation/results.json", repository / "docs/safety.md")
    campaign = mutation_campaign.Campaign(repository, repository / "build", 1)
    looks = []
    campaign._copy(campaign.root, campaign.trees[0])
    monkeypatch.setattr(mutation_campaign, "start", lambda _tree, job, *_: job() or 1)
    monkeypatch.setattr(mutation_campaign, "look", lambda which: looks.append((which.net, which.names)))
    try:
        assert campaign.known == {}, "of other code nothing is known"
        for net, name in (("unit", "test/engine/test_limit.py::test_{}"), ("explorer", "world {}")):
            campaign.observed = {net: {name.format(number): Seen(number, {LIMIT: [2]}) for number in range(7, 12)}}
            running = {}
            campaign._begin(mutation_campaign.Task(mutant, net), [campaign.trees[0]], running, print)
            campaign._look(running.pop(1), running)
    finally:
        campaign.close()
    (first, rest), (world, worlds) = looks[:2], looks[2:]
    assert first == ("unit", ("test/engine/test_limit.py::test_9",))
    assert rest == ("unit", tuple(f"test/engine/test_limit.py::test_{number}" for number in (7, 8, 10, 11)))
    assert world == ("explorer", ("world 9",))
    assert worlds == ("explorer", tuple(f"world {number}" for number in (9, 7, 8, 10, 11))), "all together reach"


@pytest.mark.parametrize(
    "net, line, of_worlds, imported, looks",
    [
        ("explorer", 2, {LIMIT: [2]}, {}, ("world",)),
        ("explorer", 2, {LIMIT: [6]}, {}, ("world",)),  # of its file another function: at a higher bound, this one, too
        ("explorer", 2, {OTHER: [1]}, {LIMIT: [1, 5]}, ()),
        ("explorer", 2, {OTHER: [1]}, {LIMIT: [2]}, ("world",)),  # it makes a table
        ("explorer", 0, {OTHER: [1]}, {LIMIT: [1]}, ("world",)),  # it is one
        ("explorer", 2, {}, {LIMIT: [2]}, ()),  # of the whole folder no world runs anything
        ("unit", 2, {OTHER: [1]}, {LIMIT: [1, 5]}, ("world",)),  # a test may run it in a process of its own
    ],
)
def test_what_no_world_runs_is_shown_to_none_unless_it_runs_at_the_import(
    repository, net, line, of_worlds, imported, looks
):
    campaign = mutation_campaign.Campaign(repository, repository / "build", 1)
    campaign.observed = {net: {"world": Seen(1, of_worlds), IMPORTS: Seen(0, imported)}}
    mutant = Mutant(Place(LIMIT, line, 0, "core/NumberReplacer", 0), "", "")
    try:
        assert campaign.names(mutation_campaign.Task(mutant, net)) == looks
    finally:
        campaign.close()


def test_a_net_that_is_not_green_without_a_mutant_is_no_net(repository):
    (repository / "test/engine/test_limit.py").write_text("def test_it():\n    assert 1 > 2\n", encoding="utf-8")
    with pytest.raises(AssertionError, match="unit: not green without a mutant"):
        run(repository)


def verdict(line, waived="", **caught_by):
    return Verdict(
        Mutant(Place("a/b.py", line, 0, "core/AddNot", 0), f"if {line}:", f"if not {line}:"), caught_by, waived
    )


TOLD = Results(
    seed=7,
    places=100,
    observed={"explorer": ["a/b.py"], "unit": ["a/b.py"], "scenarios": []},
    verdicts=(
        verdict(1, explorer="a_law (a world)", unit="", scenarios=""),
        verdict(2, explorer="", unit="test_it", scenarios="nominal"),
        verdict(3, explorer="", unit="", scenarios=""),
        verdict(4, "the same", explorer="", unit="", scenarios=""),
        verdict(5, "not so", explorer="", unit="test_it"),
    ),
)


def test_the_rates_leave_out_what_is_waived_and_what_was_not_shown():
    assert [rate(TOLD.verdicts, [net]) for net in ("explorer", "unit", "scenarios")] == [(1, 3), (1, 3), (1, 3)]
    assert rate(TOLD.verdicts, ["explorer", "unit", "scenarios"]) == (2, 3)
    assert [one.mutant.place.line for one in TOLD.survivors] == [3]
    assert [one.mutant.place.line for one in TOLD.not_needed] == [5]


def test_what_is_kept_is_read_again_and_shown_on_the_page(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"# Title\n\n{mutation_results.HEAD}\n\nold\n\n### older\n\n## Next\n", encoding="utf-8")
    write(TOLD, tmp_path / "results.json", page)
    again = read(tmp_path / "results.json")
    assert again == TOLD._replace(verdicts=[*TOLD.verdicts])
    assert page.read_text(encoding="utf-8") == f"# Title\n\n{section(TOLD)}\n## Next\n"
    assert "| a/b.py:3 | `if 3:` | `if not 3:` |\n" in section(TOLD)
    assert "| a/b.py:4 | `if 4:` | `if not 4:` | the same |\n" in section(TOLD)
    assert "| explorer | in files that it runs | 1 of 3 (33.3 %) |\n" in section(TOLD)


def test_a_page_without_the_part_gets_it_at_its_end(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Title\n\ntext\n", encoding="utf-8")
    write(TOLD, tmp_path / "results.json", page)
    assert page.read_text(encoding="utf-8").rstrip() == f"# Title\n\ntext\n\n{section(TOLD)}".rstrip()


def test_a_waiver_that_is_not_needed_is_said(repository, tmp_path, monkeypatch):
    kept = tmp_path / "waivers.yaml"
    kept.write_text(
        f"waivers:\n  - {{path: {LIMIT}, before: gone, after: other, reason: the line is gone}}\n"
        f"  - {{path: {LIMIT}, before: 'return value > 3', after: other, reason: not drawn}}\n",
        encoding="utf-8",
    )
    monkeypatch.setattr(mutation_results, "WAIVERS", kept)
    monkeypatch.setattr(mutation_results.waivers, "__defaults__", (kept,))
    shown = summary(TOLD._replace(verdicts=TOLD.verdicts[4:]), repository).splitlines()
    assert shown[-2:] == [
        "waiver not needed, caught: if 5: -> if not 5:",
        f"waiver not needed, {LIMIT} has no such line any more: gone -> other",
    ]


@pytest.mark.parametrize("path, before", sorted({(path, before) for path, before, _ in waivers()}))
def test_what_is_waived_is_still_in_the_code(path, before):
    assert before in [line.strip() for line in (ROOT / path).read_text(encoding="utf-8").splitlines()]


def test_a_waiver_needs_a_reason(tmp_path):
    kept = tmp_path / "waivers.yaml"
    kept.write_text("waivers: [{path: a.py, before: x, after: y, reason: ' '}]\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"a\.py: x: a waiver needs a reason"):
        waivers(kept)
