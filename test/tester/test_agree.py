"""Two runs on one clock: the same decisions within a tolerance, or not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import Shutdown, Tick
from amaze_autonomy.journal.journal import Journal, JournalLine
from amaze_autonomy.tester import Options, run_task, tasks_of
from amaze_autonomy.tester.command import main
from amaze_autonomy.tester.difference import agree, agreement_lines

S = 1_000_000_000


def decision(t_s, rule, commands=(), event="Tick"):
    return Decision(
        t_ns=round(t_s * S),
        sequence=1,
        event=event,
        before="MISSION",
        after="HOLD",
        step="",
        rule=rule,
        values=(),
        commands=commands,
    )


HOLDS, LANDS = decision(5, "hold", ("MissionCommand(HOLD)#5",)), decision(9, "land", ("MissionCommand(LAND)#6",))


def journal(*decisions, until_s=20, more=()):
    payloads = (Tick(t_ns=S), *decisions, Tick(t_ns=until_s * S), *more)
    return Journal(tuple(JournalLine("", payload, number) for number, payload in enumerate(payloads)), truncated=False)


def test_the_same_decisions_agree_and_say_how_far_apart_they_are():
    later = replace(HOLDS, t_ns=HOLDS.t_ns + 30_000_000, commands=("MissionCommand(HOLD)#7",), sequence=4)
    result = agree(journal(HOLDS, LANDS), journal(later, LANDS), 0.15)
    assert result.agreed
    assert agreement_lines(result) == [
        "     +4.000 s  +0.030 s  MISSION -> HOLD by hold => MissionCommand(HOLD)",
        "     +8.000 s  +0.000 s  MISSION -> HOLD by land => MissionCommand(LAND)",
        "agree: 2 of 2 decisions are the same within 0.15 s; the furthest apart by 0.030 s",
    ]


@pytest.mark.parametrize(
    "other, words",
    [
        ((replace(HOLDS, t_ns=6 * S), LANDS), "TOO FAR"),
        ((replace(HOLDS, commands=()), LANDS), "OTHER COMMANDS"),
        ((HOLDS,), "removed"),
        ((HOLDS, decision(7, "resume"), LANDS), "added"),
        ((replace(LANDS, t_ns=4 * S), HOLDS), "reordered"),
    ],
)
def test_anything_else_differs(other, words):
    result = agree(journal(HOLDS, LANDS), journal(*other), 0.15)
    assert not result.agreed
    assert any(words in line for line in agreement_lines(result))
    assert agreement_lines(result)[-1].startswith("DIFFER: ")


def replay_of(run):
    """Return the same as a replay, which is never told to end."""
    header = JournalLine("header", {"program": "amaze-replay"}, 1)
    return replace(run, lines=(header, *run.lines))


def test_a_run_that_died_while_the_other_went_on_is_no_agreement():
    result = agree(journal(HOLDS, until_s=8), journal(HOLDS, LANDS), 0.15)
    assert not result.agreed
    assert agreement_lines(result)[-2:] == [
        "the first ends at +7.000 s: 1 decisions of the other were not compared",
        "BROKEN OFF: 1 of 1 decisions are the same within 0.15 s; the furthest apart by 0.000 s",
    ]
    assert not agree(replay_of(journal(HOLDS, LANDS)), journal(HOLDS, until_s=8), 0.15).agreed


def test_a_journal_that_is_cut_off_is_no_agreement():
    cut = replace(journal(HOLDS, LANDS), truncated=True)
    for one, other in ((cut, journal(HOLDS, LANDS)), (journal(HOLDS, LANDS), cut), (replay_of(cut), journal(HOLDS))):
        assert not agree(one, other, 0.15).agreed
    said = agreement_lines(agree(journal(HOLDS, LANDS), cut, 0.15))[-2]
    assert said == "the second is cut off at +19.000 s: 0 decisions of the other were not compared"


def test_a_bag_with_several_journals_is_refused(folder, capsys, monkeypatch):  # noqa: ARG001
    monkeypatch.setattr("amaze_autonomy.tester.cli.read_journals", lambda *_, **__: (journal(HOLDS), journal(LANDS)))
    assert main(["agree", "one.bag", "other.bag"]) == 2
    words = "one.bag: holds 2 journals, of an engine that was started anew; name the file of one of them instead"
    assert capsys.readouterr().err == f"amaze-replay: {words}\n"


def test_what_comes_after_the_end_of_the_shorter_run_or_of_its_end_does_not_count():
    ends = decision(15, "interrupted", event="Shutdown")
    longer = journal(HOLDS, LANDS, until_s=15, more=(Shutdown(t_ns=15 * S, signal="SIGINT"), ends))
    result = agree(replay_of(journal(HOLDS, until_s=8)), longer, 0.15)
    assert result.agreed
    assert agreement_lines(result)[-2] == "the first ends at +7.000 s: 1 decisions of the other were not compared"
    assert agree(longer, journal(HOLDS, LANDS), 0.15).agreed


def test_nothing_to_compare_is_no_agreement():
    result = agree(journal(), journal(), 0.15)
    assert not result.agreed
    assert agreement_lines(result) == [
        "NO DECISION TO COMPARE: 0 of 0 decisions are the same within 0.15 s; the furthest apart by 0.000 s"
    ]


def test_the_verb_compares_journals_of_two_runs(folder, capsys):
    for name, override in (("one", ()), ("other", ("sensors.components.lrf.severity=moderate",))):
        (task,) = tasks_of([folder], Options(overrides=override, goldens=False, story=True))
        Path(name).write_text("".join(f"{line}\n" for line in run_task(task).story))
    assert main(["agree", "one", "one"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("agree: 16 of 16 decisions are the same within 0.3 s")
    assert main(["agree", "one", "other"]) == 1
    assert capsys.readouterr().out.splitlines()[-1].startswith("DIFFER: ")
