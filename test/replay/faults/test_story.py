"""Faults of peers and of the engine in a replay: what comes in the place of an answer, and what is done anyway."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from replay_bags import START_NS, flight_rows, write_bag

from amaze_autonomy.config.document import parse
from amaze_autonomy.engine.commands import StartRecording
from amaze_autonomy.engine.events import Outcome, Shutdown
from amaze_autonomy.replay.faults import RECORDED_FAULT
from amaze_autonomy.replay.faults.kinds import Acting
from amaze_autonomy.replay.faults.story import Story
from amaze_autonomy.tester import Options
from amaze_autonomy.tester.play import play
from amaze_autonomy.tester.scenario.files import load_cases

S = 1_000_000_000
START = StartRecording(id=7, limit_ns=S, session_id="a", mission_id="1")


def story(text, begin_s=0):
    fault = RECORDED_FAULT.read(parse(f"{{{text}}}", "x.yaml"), ("faults", "0"), {})
    return Story([Acting(fault, begin_s * S, None)])


@pytest.mark.parametrize(
    "delay_s, wait_s, outcome", [(0.5, 0.5, None), (1.0, 1.0, "TIMED_OUT"), (2.0, 1.0, "TIMED_OUT")]
)
def test_a_slow_service_does_what_it_is_asked_and_is_heard_within_the_limit_only(delay_s, wait_s, outcome):
    spoilt, delay_ns, instead = story(f"service: data_recorder/start, fault: slow, delay_s: {delay_s}").answer(0, START)
    assert (spoilt, delay_ns / S) == (False, wait_s)
    assert instead is None if outcome is None else instead.outcome is Outcome[outcome]


def test_an_interruption_counts_when_the_engine_hears_it():
    told = story("process: autonomy, fault: interrupted", begin_s=5)
    (event,) = told.events()
    assert (event, told.touched) == (Shutdown(t_ns=5 * S), [0])
    assert told.heard(event) is event
    assert told.touched == [1]


def test_a_recorder_that_answers_too_late_records(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(Path("flight.bag"), flight_rows())
    Path("flight.yaml").write_text((Path(__file__).parents[1] / "flight.yaml").read_text())
    Path("x.scenario.yaml").write_text(
        "version: 1\ndescription: x\nbags: [{path: flight.bag}]\nmap: flight.yaml\n"
        "faults: [{service: data_recorder/start, fault: slow, delay_s: 30.0}]\n"
    )
    (case,) = load_cases(Path("x.scenario.yaml"))
    lines = [json.loads(line) for line in play(case, Options(goldens=False)).lines]
    answers = [line["outcome"] for line in lines if line.get("event") == "Reply" and line["command_id"] == 6]
    assert answers == ["TIMED_OUT"]
    assert any('"growing": true' in json.dumps(line) for line in lines)


@pytest.mark.parametrize("journal", ["kept", "lost"])
def test_a_dead_engine_hears_nothing_before_it_is_started_again_at_that_very_instant(tmp_path, monkeypatch, journal):
    monkeypatch.chdir(tmp_path)
    write_bag(Path("flight.bag"), flight_rows())
    Path("flight.yaml").write_text((Path(__file__).parents[1] / "flight.yaml").read_text())
    Path("x.scenario.yaml").write_text(
        "version: 1\ndescription: x\nbags: [{path: flight.bag}]\nmap: flight.yaml\n"
        f"faults: [{{process: autonomy, fault: restarted, journal: {journal}, at_s: 12.0, for_s: 3.0}}]\n"
    )
    (case,) = load_cases(Path("x.scenario.yaml"))
    lines = [json.loads(line) for line in play(case, Options(goldens=False)).lines]
    first, *later = [line for line in lines if line.get("t_ns", 0) >= START_NS + 12 * S]
    assert (first["event"], first["t_ns"]) == ("EngineStarted", START_NS + 15 * S)
    assert any(line["t_ns"] == START_NS + 15 * S for line in later)  # the peers speak at that instant, to the new one
