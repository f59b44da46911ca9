"""A flight of this package, recorded by it: the replay of its bag decides as the flight did."""

from __future__ import annotations

import json
import math
from dataclasses import replace as changed
from pathlib import Path

import pytest
from replay_bags import START_NS, S, write_bag
from replay_demo import demo_bag, simulated
from replay_runs import CONFIG, moves, replay, texts

from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.engine.events import AutopilotStatus, CheckName, Mission, MissionSelected, UserCommand
from amaze_autonomy.engine.state import evolve
from amaze_autonomy.journal.journal import read
from amaze_autonomy.replay import maps
from amaze_autonomy.replay.compare import compare
from amaze_autonomy.replay.faults.stream import FaultedRecordings
from amaze_autonomy.replay.maps.topic_map import load_map
from amaze_autonomy.replay.plan import make_plan
from amaze_autonomy.replay.recordings.journals import FlightLog, selection_of
from amaze_autonomy.replay.recordings.sources import Recordings, topics_of
from amaze_autonomy.replay.recordings.statuses import EVENT_OF
from amaze_autonomy.replay.session import Session
from amaze_autonomy.replay.timeline import LineKind
from amaze_autonomy.simulation.scenario import Request, Scenario, Trigger
from amaze_autonomy.tester import Options, run_task, tasks_of
from amaze_autonomy.tester.command import main

MAPS = Path(maps.__file__).parent


@pytest.fixture(scope="module")
def flown():
    return simulated()


@pytest.fixture(scope="module")
def bag(flown, tmp_path_factory):
    return demo_bag(tmp_path_factory.mktemp("demo") / "demo.bag", flown)


def payloads_of(lines):
    return [line.payload for line in read("\n".join(lines) + "\n").lines]


def decided(lines):
    return [
        (p.before, p.after, p.rule)
        for p in payloads_of(lines)
        if type(p).__name__ == "Decision" and p.before != p.after
    ]


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


@pytest.fixture(scope="module")
def other_bag(tmp_path_factory):
    """A flight of a mission that is not the configuration's first."""
    return demo_bag(tmp_path_factory.mktemp("other") / "other.bag", simulated(mission="5"))


def test_the_mission_is_the_one_that_the_journal_selects(other_bag, tmp_path, capsys):
    assert main(["run", str(other_bag), "--map", "amaze_demo", "--out", str(tmp_path / "out"), "--no-html"]) == 0
    assert "\nMap amaze_demo, mission 5: ends in DATA_CLEANUP (COMPLETE)" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "result.json").read_text())["mission"] == "5"
    header = json.loads((tmp_path / "out" / "journal.jsonl").read_text().splitlines()[0])
    assert header["mission"]["id"] == "5"
    assert main(["run", str(other_bag), "--map", "amaze_demo", "--mission", "5"]) == 0


def test_another_mission_than_the_journal_selects_is_refused(other_bag, capsys):
    assert main(["run", str(other_bag), "--map", "amaze_demo", "--mission", "2"]) == 2
    assert capsys.readouterr().err == (
        "amaze-replay: mission 2 was not flown: the journal in the recording selects 5, and what it says is replayed; "
        "leave the mission out\n"
    )


def test_a_mission_that_the_configuration_does_not_know_is_named_as_it_was_flown(tmp_path, capsys):
    flown = [line.replace('"id":"5"', '"id":"field"') for line in simulated(mission="5")]
    bag = demo_bag(tmp_path / "field.bag", flown)
    assert main(["run", str(bag), "--map", "amaze_demo", "--html", str(tmp_path / "x.html")]) == 0
    assert "\nMap amaze_demo, mission field: ends in " in capsys.readouterr().out


def test_a_scenario_names_no_other_mission_than_the_journal_selects(other_bag, tmp_path):
    path = tmp_path / "x.scenario.yaml"
    for named, verdict in (("", "PASS"), ("missions: ['5']\n", "PASS"), ("missions: ['2']\n", "ERROR")):
        path.write_text(f"version: 1\ndescription: x\nbags: [{{path: {other_bag}}}]\nmap: amaze_demo\n{named}{FLIES}")
        (task,) = tasks_of([path], Options(goldens=False))
        result = run_task(task)
        assert result.verdict.value == verdict
    assert result.headline == (
        f"{path}:5: mission 2 was not flown: the journal in the recording selects 5, and what it says is replayed; "
        "leave the mission out"
    )


FLIES = "expectations:\n  - {expect: exists, of: {state: MISSION}}\n"


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


def test_a_recorded_status_of_the_vehicle_is_told_whole_and_each_of_its_fields_can_decide(tmp_path, flown):
    recorded = []

    def tilted(path, rows):
        for t_ns, topic, message in rows:
            if topic == "/autopilot/status":
                message.tilt = math.radians(80.0 if 20 * S <= t_ns - START_NS < 25 * S else 0.0)
                recorded.append(EVENT_OF["autopilot"](message, t_ns))
        return write_bag(path, rows)

    outcome, _ = replay(demo_bag(tmp_path / "tilted.bag", flown, written=tilted), "amaze_demo")
    told = [each for each in payloads_of(outcome.journal) if isinstance(each, AutopilotStatus)]
    assert [each for each in told if each.t_ns >= recorded[0].t_ns] == recorded
    (landing,) = [each for each in outcome.decisions if each.after == "LAND"][:1]
    assert [value.value for value in landing.values if value.name == "failure"] == ["tilt"]


def test_the_session_is_that_of_the_flight(bag, flown):
    outcome, _ = replay(bag, "amaze_demo")
    sessions = {line.split('"session_id":"')[1].split('"')[0] for line in flown if '"session_id":"s' in line}
    assert outcome.state.session.id in sessions


def test_without_the_journal_the_script_selects_and_the_sessions_are_matched(tmp_path, flown):
    outcome, _ = replay(demo_bag(tmp_path / "x.bag", flown, with_journal=False), "amaze_demo")
    assert moves(outcome) == decided(flown)[: len(moves(outcome))]
    assert moves(outcome)[-1][1] == "DATA_CLEANUP"
    assert outcome.state.session.id == "20200913T122640-001"


@pytest.mark.slow_rows
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


UNSEEN = "mission_camera is not in the recording: it is required, and takeoff does not wait for it here"


def test_a_required_component_that_was_not_recorded_is_said_everywhere(tmp_path, flown, capsys):
    without = ("/watchdog/info", "/watchdog/action")
    path = demo_bag(tmp_path / "x.bag", flown, with_journal=False, without=without)
    outcome, _ = replay(path, "amaze_demo")
    assert "mission_camera" in outcome.scripted
    assert "mission_camera" in outcome.unseen
    assert f"+0.000 bag {UNSEEN}" in texts(outcome, LineKind.NOTE)
    rows = {row.name: (row.verdict.value, row.advice) for row in outcome.checks[CheckName.WATCHDOG][1]}
    assert rows["mission_camera"] == ("warn", "it is required, and not in the recording")
    assert rows["lrf"][0] == "pass"
    assert main(["run", str(path), "--map", "amaze_demo"]) == 0
    assert f"\n{UNSEEN}.\n" in capsys.readouterr().out


def test_one_of_which_a_topic_was_not_recorded_is_said_with_that_topic(tmp_path, flown):
    path = demo_bag(tmp_path / "x.bag", flown, with_journal=False, without=("/watchdog/info", "/watchdog/action"))
    outcome, _ = replay(path, "amaze_demo", overrides=["sensors.components.lrf.topics./lrf/status.rate_hz=10.0"])
    words = "in the recording without /lrf/status"
    assert f"+0.000 bag lrf is {words}: it is required, and takeoff does not wait for it here" in texts(
        outcome, LineKind.NOTE
    )
    rows = {row.name: (row.verdict.value, row.advice) for row in outcome.checks[CheckName.WATCHDOG][1]}
    assert rows["lrf"] == ("warn", f"it is required, and {words}")


@pytest.mark.parametrize("more", ["", "recorded_statuses: decide\n"])
def test_one_that_the_recorded_watchdog_speaks_of_is_not(tmp_path, bag, more):
    topic_map = tmp_path / "own.yaml"
    topic_map.write_text((MAPS / "amaze_demo.yaml").read_text() + more)
    outcome, _ = replay(bag, str(topic_map))
    assert outcome.unseen == {}
    assert "not in the recording" not in str(outcome.checks[CheckName.WATCHDOG])


def test_a_map_that_names_its_components_lacks_none(flight_bag, flight_map):
    assert replay(flight_bag, str(flight_map))[0].unseen == {}


FROM_S = 25  # it flies


def judged_from(path, from_s):
    """Replay the part of a recording that begins so late."""
    plan = make_plan(load_configuration(CONFIG), load_map("amaze_demo"), "1", topics_of([path]))
    with Recordings([path], plan.topics, replayed=True) as recordings:
        return Session(plan, FaultedRecordings(recordings, from_s * S, None)).run()


def test_a_part_that_begins_in_the_air_is_no_takeover(bag):
    outcome = judged_from(bag, FROM_S)
    assert outcome.beginning.airborne
    states = [decision.after for decision in outcome.decisions]
    assert "PILOT" not in states
    assert states[-1] == "DATA_CLEANUP"
    assert (outcome.flown, outcome.parting) == (None, None)  # its decisions began before the part


def test_a_part_is_judged_as_a_recording_without_a_journal_from_there(tmp_path, bag, flown):
    other = demo_bag(tmp_path / "x.bag", flown, with_journal=False)
    assert moves(judged_from(bag, FROM_S)) == moves(judged_from(other, FROM_S))


def test_what_the_user_asks_within_the_part_counts(tmp_path):
    asked = Scenario(requests=(Request(command=UserCommand.LAND, trigger=Trigger(event="airborne", delay_ns=20 * S)),))
    lines = simulated(asked)
    path = demo_bag(tmp_path / "x.bag", lines)
    assert "user_land" in [decision.rule for decision in judged_from(path, FROM_S).decisions]


def test_a_part_that_begins_before_takeoff_is_led_by_the_selection_of_its_flight(bag):
    outcome = judged_from(bag, 1)
    assert moves(outcome) == moves(replay(bag, "amaze_demo")[0])
    assert outcome.parting is None
    assert len(outcome.flown) > 5


def test_a_selection_leads_until_its_flight_has_taken_off(flown):
    selections = (MissionSelected(t_ns=1, missions=(Mission("1"),)), MissionSelected(t_ns=50, missions=(Mission("2"),)))
    takes_off = next(each for each in payloads_of(flown) if getattr(each, "after", "") == "TAKEOFF")
    log = FlightLog("s", selections, (evolve(takes_off, t_ns=20),))
    assert [selection_of(log, t_ns) for t_ns in (0, 10, 20, 30, 60)] == [1, 1, 1, 50, 50]
    assert selection_of(changed(log, events=selections[:1]), 30) is None


JOURNAL = "/autonomy/journal"


def bag_without(path, lines, numbers):
    """Write the bag of a flight whose recorder lost some lines of the journal."""

    def written(at, rows):
        return write_bag(at, [row for row in rows if row[1] != JOURNAL or row[2].sequence not in numbers])

    return demo_bag(path, lines, written=written)


def numbers_of(lines, *words):
    return [number for number, line in enumerate(lines) if any(word in line for word in words)]


def told(path, capsys):
    """Return the status of a run, what of the bag it says to be damaged, and what it says of the flight's decisions."""
    status = main(["run", str(path), "--map", "amaze_demo"])
    out = capsys.readouterr().out.splitlines()
    return status, [line for line in out if line.startswith("DAMAGED")], out[-2:]


def test_a_lost_decision_of_the_flight_is_said_and_is_no_other_decision(tmp_path, flown, capsys):
    (lost,) = numbers_of(flown, '"rule":"at_takeoff_height"')
    status, damaged, last = told(bag_without(tmp_path / "x.bag", flown, [lost]), capsys)
    assert status == 3
    assert len(damaged) == 1
    assert damaged[0].startswith(f"DAMAGED: {JOURNAL}: line {lost + 1} is missing, +")
    assert damaged[0].endswith(" s: what was asked and decided there is unknown")
    assert last[0].startswith("In flight the same ")
    assert last[0].endswith("; those after the first lost line of its journal were not compared.")
    assert "counterfactual" not in last[1]


def test_another_decision_before_the_lost_line_is_still_named(tmp_path, flown):
    (lost,) = numbers_of(flown, '"rule":"mission_complete"')
    path = bag_without(tmp_path / "x.bag", flown, [lost])
    outcome, recordings = replay(path, "amaze_demo", overrides=["autonomy.require_go=true"])
    assert outcome.parting.number == 2
    assert len(recordings.problems) == 1


def test_a_log_without_the_selection_does_not_lead_and_that_is_said(tmp_path, flown, capsys):
    asked = numbers_of(flown, '"event":"MissionSelected","kind":"event"')
    status, damaged, last = told(bag_without(tmp_path / "x.bag", flown, asked), capsys)
    assert status == 3
    assert f"DAMAGED: {JOURNAL}: no line of it selects a mission, what was asked is scripted" in damaged
    assert "In flight the same" not in last[0]
    assert "ends in DATA_CLEANUP" in last[1]


def test_a_bag_whose_journal_begins_behind_the_selection_is_scripted_and_not_damaged(tmp_path, flown, capsys):
    """Of a second split: what was asked before it is nothing that it could hold."""
    (asked,) = numbers_of(flown, '"event":"MissionSelected","kind":"event"')
    path = bag_without(tmp_path / "x.bag", flown, list(range(asked + 1)))
    assert main(["run", str(path), "--map", "amaze_demo"]) == 0
    assert "DAMAGED" not in capsys.readouterr().out


def test_a_part_that_ends_before_the_lost_line_is_whole(tmp_path, flown, capsys):
    (lost,) = numbers_of(flown, '"rule":"mission_complete"')
    path = bag_without(tmp_path / "x.bag", flown, [lost])
    assert main(["run", str(path), "--map", "amaze_demo", "--to", "20"]) == 0
    assert "DAMAGED" not in capsys.readouterr().out


def test_a_message_of_the_journal_that_cannot_be_read_costs_that_line(tmp_path, flown, capsys):
    path = demo_bag(tmp_path / "x.bag", flown)
    content = bytearray(path.read_bytes())
    begin = content.rfind(b'{"after"', 0, content.find(b'"rule":"at_takeoff_height"'))
    content[begin - 4 : begin] = b"\xff\xff\xff\x7f"  # the length of the line
    path.write_bytes(content)
    status, damaged, last = told(path, capsys)
    assert status == 3
    assert "is missing, +" in damaged[0]
    assert damaged[1].startswith(f"DAMAGED: 1 messages of {JOURNAL} from +")
    assert "counterfactual" not in last[1]
    assert main(["journal", str(path)]) == 2
    assert f"{path}: a message of {JOURNAL} cannot be read (" in capsys.readouterr().err


def test_a_line_of_the_journal_that_nobody_knows_costs_that_line(tmp_path, flown, capsys):
    path = demo_bag(tmp_path / "x.bag", flown)
    path.write_bytes(path.read_bytes().replace(b'"event":"WatchdogInfo"', b'"event":"WatchdogInfX"', 1))
    status, damaged, last = told(path, capsys)
    assert status == 3
    assert len(damaged) == 1
    assert damaged[0].startswith(f"DAMAGED: {JOURNAL}: a line cannot be read: line ")
    assert "counterfactual" not in last[1]


def test_a_recorded_watchdog_that_has_said_nothing_yet_forbids_no_takeoff(bag, tmp_path):
    """Until its first word the script answers in its place, for each component that the mission requires."""
    lines = (MAPS / "amaze_demo.yaml").read_text().splitlines()
    (tmp_path / "map.yaml").write_text(
        "\n".join([each for each in lines if "journal:" not in each]) + "\nrecorded_statuses: decide\n"
    )
    outcome, _ = replay(bag, str(tmp_path / "map.yaml"))
    assert "takeoff" in [decision.rule for decision in outcome.decisions]
