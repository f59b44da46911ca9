"""A flight of this package, recorded by it: the replay of its bag decides as the flight did."""

from __future__ import annotations

import pytest
from replay_bags import START_NS
from replay_demo import demo_bag, simulated
from replay_runs import moves, replay, texts

from amaze_autonomy.journal.journal import read
from amaze_autonomy.replay.compare import compare
from amaze_autonomy.replay.timeline import LineKind
from amaze_autonomy.tester.command import main


@pytest.fixture(scope="module")
def flown():
    return simulated()


@pytest.fixture(scope="module")
def bag(flown, tmp_path_factory):
    return demo_bag(tmp_path_factory.mktemp("demo") / "demo.bag", flown)


def decided(lines):
    payloads = [line.payload for line in read("\n".join(lines) + "\n").lines]
    return [(p.before, p.after, p.rule) for p in payloads if type(p).__name__ == "Decision" and p.before != p.after]


def test_the_journal_of_a_simulated_flight_is_decided_again_without_difference(flown):
    comparison = compare(read("\n".join(flown) + "\n"))
    assert (comparison.differences, comparison.first) == (0, None)
    assert comparison.decisions > 5


def test_the_journal_in_its_bag_is_decided_again_without_difference(bag):
    assert main(["journal", str(bag)]) == 0


def test_the_replay_of_its_bag_makes_the_decisions_of_the_flight(bag, flown):
    outcome, _ = replay(bag, "amaze_demo")
    made = decided(flown)
    assert moves(outcome) == made[: len(moves(outcome))]
    assert moves(outcome)[-1][1] == "DATA_CLEANUP"
    assert outcome.counterfactual_ns is None


def test_it_says_that_the_decisions_are_those_of_the_flight(bag, capsys):
    assert main(["run", str(bag), "--map", "amaze_demo"]) == 0
    out = capsys.readouterr().out
    assert "In flight the same " in out
    assert "decisions were made, in the same order.\n" in out


def test_it_names_the_first_decision_that_is_not_that_of_the_flight(bag, capsys):
    assert main(["run", str(bag), "--map", "amaze_demo", "--set", "autonomy.require_go=true"]) == 0
    out = capsys.readouterr().out
    assert "Decision 2 is not that of the flight: there READY -> START_RECORDING by go_not_required, here " in out
    assert out.rstrip().endswith("the flight decided otherwise then.")


def test_what_the_user_asked_comes_from_the_log_and_statuses_from_the_bag(bag):
    outcome, _ = replay(bag, "amaze_demo")
    lines = texts(outcome, LineKind.DECISION)
    assert lines[0].split()[1] == "log"
    assert "mission_selected" in lines[0]
    assert [line.split()[1] for line in lines if "by at_takeoff_height" in line] == ["bag"]


def test_the_session_is_that_of_the_flight(bag, flown):
    outcome, _ = replay(bag, "amaze_demo")
    sessions = {line.split('"session_id":"')[1].split('"')[0] for line in flown if '"session_id":"s' in line}
    assert outcome.state.session.id in sessions


def test_without_the_journal_the_script_selects_and_the_sessions_are_matched(tmp_path, flown):
    outcome, _ = replay(demo_bag(tmp_path / "x.bag", flown, with_journal=False), "amaze_demo")
    assert moves(outcome) == decided(flown)[: len(moves(outcome))]
    assert moves(outcome)[-1][1] == "DATA_CLEANUP"
    assert outcome.state.session.id == "20200913T122640-001"


@pytest.mark.parametrize(
    "topic",
    ["/watchdog/action", "/mission_planner/status", "/autopilot/status", "/landing_detection/landed", "/px4/imu"],
)
def test_muting_any_topic_changes_the_journal(bag, topic):
    whole, muted = replay(bag, "amaze_demo")[0], replay(bag, "amaze_demo", muted=[topic])[0]
    assert whole.journal[1:] != muted.journal[1:]
    assert whole.start_ns == muted.start_ns == START_NS


def test_a_status_that_holds_what_cannot_be_is_left_out_and_said(tmp_path, flown):
    path = demo_bag(tmp_path / "x.bag", flown, planner_phase=99)
    outcome, recordings = replay(path, "amaze_demo")
    damage = recordings.damage["/mission_planner/status"]
    assert damage.reason == "phase is 99, must be one of 0, 1, 2, 3, 4, 5, 6, 7"
    assert moves(outcome)[-1][1] != "MISSION_ENDED"
