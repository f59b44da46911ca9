"""Two runs under each other: what became of each decision, and how the first difference is told."""

from __future__ import annotations

from dataclasses import replace

from amaze_autonomy.engine.commands import Decision, Value
from amaze_autonomy.tester.difference import ChangeKind, align, counted, is_same, told

S = 1_000_000_000


def decision(t_s, before, after, rule, number=0, *, commands=(), values=()):
    return Decision(
        t_ns=round(t_s * S),
        sequence=number,
        event="Tick",
        before=before,
        after=after,
        step="",
        rule=rule,
        values=values,
        commands=commands,
    )


TAKEOFF = decision(1, "LOAD_MISSION", "TAKEOFF", "takeoff", 0, commands=("MissionCommand(TAKEOFF)#4",))
FLIES = decision(3, "TAKEOFF", "MISSION", "at_takeoff_height", 1)
HOLDS = decision(
    9, "MISSION", "HOLD", "hold", 2, commands=("MissionCommand(HOLD)#5",), values=(Value("age", 0.31, 0.3, "s"),)
)
LANDS = decision(12, "HOLD", "LAND", "land", 3, commands=("MissionCommand(LAND)#6",))
RUN = (TAKEOFF, FLIES, HOLDS, LANDS)


def kinds(after):
    return [change.kind.value for change in align(RUN, after)]


def test_the_same_run_is_the_same():
    assert kinds(RUN) == ["same"] * 4
    assert told(align(RUN, RUN), 0) == ()


def test_a_decision_that_comes_later_has_moved_and_those_behind_it_are_the_same():
    assert kinds((TAKEOFF, FLIES, replace(HOLDS, t_ns=9_350_000_000), LANDS)) == [
        "same",
        "same",
        "moved in time",
        "same",
    ]


def test_one_decision_more_does_not_make_the_later_ones_different():
    more = (TAKEOFF, decision(2, "TAKEOFF", "TAKEOFF", "lifted_off", 1), FLIES, HOLDS, LANDS)
    assert kinds(more) == ["same", "added", "same", "same", "same"]


def test_numbers_that_follow_from_one_more_are_not_changes_of_their_own():
    one = decision(2, "TAKEOFF", "TAKEOFF", "lifted_off", 1, commands=("RunCheck(BATTERY)#5",))
    rest = tuple(
        replace(each, sequence=each.sequence + 1, commands=tuple(c.replace("#5", "#6") for c in each.commands))
        for each in RUN[1:]
    )
    assert kinds((TAKEOFF, one, *rest)) == ["same", "added", "alike", "alike", "alike"]


def test_a_decision_that_changed_its_place_is_reordered():
    assert kinds((TAKEOFF, LANDS, FLIES, HOLDS)) == ["same", "reordered", "same", "same"]


def test_values_and_commands_that_changed():
    other = replace(HOLDS, values=(Value("age", 0.41, 0.4, "s"),))
    assert kinds((TAKEOFF, FLIES, other)) == ["same", "same", "changed value", "removed"]


def test_the_first_difference_is_told_with_what_it_looked_at():
    other = replace(HOLDS, t_ns=9_350_000_000, values=(Value("age", 0.41, 0.4, "s"),))
    lines = told(align(RUN, (TAKEOFF, FLIES, other)), 0, "amaze-replay test x")
    assert lines[:8] == (
        "decision at +9.350 s changed value, 0.350 s later: MISSION -> HOLD by hold => MissionCommand(HOLD)",
        "  golden   +9.000 s  MISSION -> HOLD by hold => MissionCommand(HOLD)",
        "           age 0.31 s, limit 0.3 s",
        "  new      +9.350 s  MISSION -> HOLD by hold => MissionCommand(HOLD)",
        "           age 0.41 s, limit 0.4 s",
        "decisions: 2 same, 1 changed value, 1 removed",
        "states   0 s                                                             12.000 s",
        "golden   iiiiiiTTTTTTTTTTTTMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMHHHHHHHHHHHHHHHHHL",
    )
    assert lines[8:10] == (
        "new      iiiiiiTTTTTTTTTTTTMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMMHHHHHHHHHHHHHHHH",
        "                                                               ^^               ^",
    )
    assert lines[-1] == "reproduce: amaze-replay test x"


def test_only_numbers_are_told_to_who_asks_and_no_difference_to_a_golden():
    changes = align(RUN, (TAKEOFF, FLIES, HOLDS, replace(LANDS, sequence=7)))
    assert told(changes, 0)[0] == "decision at +12.000 s alike: HOLD -> LAND by land => MissionCommand(LAND)"
    assert is_same(changes)


def test_counts_are_in_a_fixed_order():
    assert counted(align(RUN, RUN[:2])) == "2 same, 2 removed"
    assert counted(()) == "no decisions"
    assert next(iter(ChangeKind)) is ChangeKind.SAME


ASKS = decision(
    9,
    "START_RECORDING",
    "LOAD_MISSION",
    "recording_proven",
    3,
    commands=("LoadMission(5)#7", "RunCheck(WATCHDOG)#8", "RunCheck(BATTERY)#9"),
    values=(Value("oldest check", 0.0964, 10.0, "s"),),
)


def became(*, commands=ASKS.commands, values=ASKS.values, after=ASKS.after):
    return align([ASKS], [replace(ASKS, commands=commands, values=values, after=after)])[0].kind.value


def test_one_check_more_is_the_same_to_a_golden():
    more = ("LoadMission(5)#7", "RunCheck(WATCHDOG)#8", "RunCheck(STORAGE)#9", "RunCheck(BATTERY)#10")
    assert became(commands=more) == "alike"
    assert is_same(align([ASKS], [replace(ASKS, commands=more)]))


def test_no_checks_any_more_are_a_difference():
    assert became(commands=("LoadMission(5)#7",)) == "changed value"
    assert became(commands=("RunCheck(WATCHDOG)#7", "RunCheck(BATTERY)#8")) == "changed value"


def test_a_command_that_is_sent_twice_is_a_difference():
    assert became(commands=("LoadMission(5)#7", *ASKS.commands)) == "changed value"
    twice = replace(LANDS, commands=("MissionCommand(LAND)#6", "MissionCommand(LAND)#7"))
    assert kinds((TAKEOFF, FLIES, HOLDS, twice)) == ["same", "same", "same", "changed value"]
    assert "MissionCommand(LAND), MissionCommand(LAND)" in told(align(RUN, (TAKEOFF, FLIES, HOLDS, twice)), 0)[0]


def test_how_quickly_others_answered_has_a_tolerance_and_nothing_else():
    assert became(values=(Value("oldest check", 0.0904, 10.0, "s"),)) == "alike"
    assert became(values=(Value("oldest check", 0.1204, 10.0, "s"),)) == "changed value"
    assert became(values=(Value("oldest check", 0.0904, 9.0, "s"),)) == "changed value"
    assert became(values=(Value("height", 0.0904, 10.0, "s"),)) == "changed value"
    assert became(values=()) == "changed value"
