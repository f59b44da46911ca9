"""Each commit draws another quarter of what takes long, and always the same one."""

from pathlib import Path

import drawn
from proof_stories import STORIES


def test_every_file_that_is_named_is_one():
    assert [str(path) for path in drawn.FILES if not path.is_file()] == []


def test_a_commit_draws_a_quarter_and_the_same_one_again():
    names = [f"test_{number}" for number in range(3000)]
    taken = [name for name in names if drawn.is_drawn(name, "one commit")]
    assert 650 < len(taken) < 850
    assert taken == [name for name in names if drawn.is_drawn(name, "one commit")]


def test_a_few_commits_have_everything_between_them():
    names = {f"test_{number}" for number in range(3000)}
    for commit in range(48):
        names -= {name for name in names if drawn.is_drawn(name, f"commit {commit}")}
    assert names == set()


def test_without_a_seed_everything_is_tested():
    assert drawn.is_drawn("anything", "")
    assert drawn.some_of(["one", "two"], "") == ["one", "two"]


def test_of_flights_a_commit_draws_a_quarter_but_never_none():
    names = [f"flight_{number}" for number in range(10)]
    assert [len(drawn.some_of(names[:count], "one commit")) for count in (0, 1, 3, 4, 10)] == [0, 1, 1, 1, 3]
    assert {name for commit in range(24) for name in drawn.some_of(names, f"commit {commit}")} == set(names)


def test_what_forbids_a_command_against_a_pilot_or_a_landing_is_never_left_out():
    told = [each.split("::") for story in STORIES for each in story.pure]
    assert [each for file, each in told if not drawn.is_kept(Path(file).parent.name, each)] == []
    assert drawn.is_kept("autopilot", "test_the_pilot_is_not_fought")
    assert not drawn.is_kept("replay", "test_a_pilot_s_own_flights_are_nobody_s_mission")
    assert not drawn.is_kept("autopilot", "test_a_file_is_loaded")
