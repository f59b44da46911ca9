"""The closed loop of world and engine: missions are flown, every shipped scenario ends as it must, always the same."""

import hashlib
import os
import subprocess
import sys

import pytest
from expected_stories import REACTIONS_S, STORIES
from simulation_tools import S, scenario

from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.commands import (
    Answer,
    AnswerKind,
    AutopilotDisarm,
    AutopilotLand,
    Decision,
    Level,
    MissionCommand,
    Notify,
)
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import Event, WatchdogAction
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.engine.state import DataResult, EngineState, Result, State
from amaze_autonomy.journal import journal
from amaze_autonomy.simulation import load_scenario
from amaze_autonomy.simulation.run import run


@pytest.fixture(scope="session")
def flown(configuration, config_folder):
    """Return the run of a shipped scenario on mission 1; each is flown once."""
    runs = {}

    def fly(name):
        if name not in runs:
            story = load_scenario(config_folder / "faults" / f"{name}.yaml") if name else None
            runs[name] = run(configuration, (configuration.plan("1").mission,), story, seed=1)
        return runs[name]

    return fly


def states(result):
    """Return the states after MISSION_INPUT, each once in a row."""
    return tuple(decision.after for decision in result.decisions if decision.after != decision.before)


def motion(result):
    """Return (time, name) of every request of motion."""
    return [
        (t_ns, each.action.name if isinstance(each, MissionCommand) else type(each).__name__)
        for t_ns, each in result.commands
        if isinstance(each, (MissionCommand, AutopilotLand, AutopilotDisarm))
    ]


def in_short(names):
    """Return the names, equal ones in a row once; a landing is repeated by both routes: each of them once."""
    short = []
    for name in names:
        if not short or (short[-1] != name and not (name in ("LAND", "AutopilotLand") and name in short)):
            short.append(name)
    return tuple(short)


@pytest.mark.slow_rows
@pytest.mark.parametrize("mission_id", ["1", "2", "3", "4", "5"])
@pytest.mark.parametrize("seed", [0, 7])
def test_a_nominal_mission_is_nominal(configuration, mission_id, seed):
    result = run(configuration, (configuration.plan(mission_id).mission,), seed=seed)
    assert result.results == ((mission_id, Result.COMPLETE, DataResult.COMPLETE),)
    assert result.finished
    assert not [each for _, each in result.commands if isinstance(each, Notify) and each.level > Level.INFO]
    codes = {event.code for event in events_of(result) if isinstance(event, WatchdogAction)}
    assert codes == {Code.NOMINAL}


def events_of(result):
    lines = journal.read("".join(line + "\n" for line in result.lines)).lines
    return [line.payload for line in lines if isinstance(line.payload, Event)]


@pytest.mark.slow_rows
@pytest.mark.parametrize("name", ["", *STORIES])
def test_a_journal_of_delta_lines_decides_the_same(flown, name):
    """The law of the journal's short form: events and decisions of every flight, bit for bit."""
    whole = flown(name).lines
    payloads = [journal.decode(line).payload for line in whole]
    encoder = journal.DeltaEncoder()
    written = [encoder.encode(each) if isinstance(each, Event) else line for each, line in zip(payloads, whole)]
    again = journal.read("".join(f"{line}\n" for line in written))
    assert [line.payload for line in again.lines] == payloads
    rules, state, decided = journal.rules_of(again.lines[0]), EngineState(), []
    for line in again.lines:
        if isinstance(line.payload, Event):
            state, commands = decide(state, line.payload, rules)
            decided += [journal.encode_decision(each) for each in commands if isinstance(each, Decision)]
    assert decided == [line for line in whole if '"kind":"decision"' in line]
    statuses = [len(line) for line in whole if '"t_ns"' in line and '"kind":"event"' in line and "Status" in line]
    assert sum(statuses) > 3 * sum(len(line) for line in written if line[3] == '"')


def test_a_mission_takes_as_long_as_its_estimate_says(configuration):
    plan = configuration.plan("4")
    result = run(configuration, (plan.mission,))
    (takeoff,) = [decision.t_ns for decision in result.decisions if decision.rule == "takeoff"]
    (complete,) = [decision.t_ns for decision in result.decisions if decision.rule == "mission_complete"]
    assert (complete - takeoff) / S == pytest.approx(plan.mission.estimated_duration_s, rel=0.05)


def test_files_without_a_touchdown_are_flown_in_one_flight(config_folder):
    touched, straight = (
        load_configuration(config_folder, [f"missions.missions.2.touchdown_between_files={value}"])
        for value in ("true", "false")
    )
    flights = [run(each, (each.plan("2").mission,)) for each in (touched, straight)]
    assert [result.results for result in flights] == [(("2", Result.COMPLETE, DataResult.COMPLETE),)] * 2
    assert [[name for _, name in motion(result)].count("TAKEOFF") for result in flights] == [3, 1]
    assert straight.plan("2").mission.estimated_duration_s < touched.plan("2").mission.estimated_duration_s


@pytest.mark.parametrize(
    "channel, off, result",
    [(7, False, Result.LANDED_EARLY), (12, False, Result.LANDED_EARLY), (7, True, Result.COMPLETE)],
)
def test_the_switch_of_the_transmitter_lands_unless_the_mission_is_flown_without(config_folder, channel, off, result):
    overrides = [f"autopilot.land_switch.channel={channel}", f"missions.missions.1.land_switch={not off}"]
    configuration = load_configuration(config_folder, overrides)
    thrown = scenario("fault: land_switch, after: {event: mission, delay_s: 3}, for_s: 2")
    flight = run(configuration, (configuration.plan("1").mission,), thrown)
    assert flight.results == (("1", result, DataResult.COMPLETE),)
    landed = [decision.t_ns - flight.history[0][0] for decision in flight.decisions if decision.rule == "user_land"]
    assert len(landed) == (result is Result.LANDED_EARLY)
    assert all(700_000_000 <= after_ns <= 1_400_000_000 for after_ns in landed)


@pytest.mark.parametrize("asked", ["request: land", "fault: land_switch"])
def test_a_dead_engine_hears_neither_its_user_nor_the_switch(config_folder, asked):
    configuration = load_configuration(config_folder, ["autopilot.land_switch.channel=7"])
    dies = "process: autonomy, fault: restarted, after: {state: MISSION, delay_s: 3}, for_s: 10"
    asks = f"{asked}, after: {{state: MISSION, delay_s: 6}}"
    told = (dies, asks) if asked.startswith("request") else (f"{dies}\n{asks}, for_s: 2", "")
    flight = run(configuration, (configuration.plan("1").mission,), scenario(*told))
    died_ns, back_ns = (t_ns for t_ns, text, _ in flight.history if text.endswith("autonomy restarted"))
    assert back_ns - died_ns == 10 * S
    assert not [each for each in flight.decisions if died_ns <= each.t_ns < back_ns]
    assert "user_land" not in [each.rule for each in flight.decisions]
    lines = [text for _, text, _ in flight.history if text.startswith("the user asks")]
    assert lines == ["the user asks: land (nobody hears it: the engine is dead)"] * asked.startswith("request")


def test_a_mission_is_selected_as_soon_as_the_engine_lives(configuration):
    dead = scenario("process: autonomy, fault: restarted, at_s: 4, for_s: 3")
    flight = run(configuration, (configuration.plan("1").mission,), dead)
    assert flight.decisions[0].t_ns == 7 * S
    assert flight.results == (("1", Result.COMPLETE, DataResult.COMPLETE),)


def test_there_is_a_story_for_every_shipped_scenario_and_no_other(config_folder):
    assert sorted(STORIES) == sorted(file.stem for file in (config_folder / "faults").glob("*.yaml"))


@pytest.mark.slow_rows
@pytest.mark.parametrize("name", STORIES)
def test_a_shipped_scenario_ends_as_it_must(flown, name):
    result, expected = flown(name), STORIES[name]
    assert states(result) == expected.states
    assert in_short(each for _, each in motion(result)) == expected.motion
    ended = () if expected.result is None else (("1", Result(expected.result), DataResult(expected.data)),)
    assert result.results == ended
    assert result.finished


@pytest.mark.parametrize("name", REACTIONS_S)
def test_the_reaction_comes_in_time(flown, name):
    command, limit_s = REACTIONS_S[name]
    result = flown(name)
    begun_ns = result.history[0][0]
    reaction_ns = next(t_ns for t_ns, each in motion(result) if each == command)
    assert 0 <= reaction_ns - begun_ns <= round(limit_s * S)


def test_no_time_is_left_of_a_hold_when_restarting_is_given_up_and_it_lands(flown):
    """As seen: 1.9 s were left, each attempt to restart was counted with its whole limit."""
    result = flown("lrf")
    landed_ns = next(t_ns for t_ns, each in motion(result) if each == "LAND")
    lines = journal.read("".join(line + "\n" for line in result.lines)).lines
    said = [each.payload for each in lines if isinstance(each.payload, WatchdogAction)]
    ends_ns = [part.until_ns for each in said for part in each.components if part.until_ns is not None]
    assert abs(ends_ns[-1] - landed_ns) <= 0.3 * S


@pytest.mark.slow_rows
@pytest.mark.parametrize("name", STORIES)
def test_every_request_of_the_scenarios_user_is_done(flown, name):
    answers = [each for _, each in flown(name).commands if isinstance(each, Answer)]
    assert {answer.answer for answer in answers} == {AnswerKind.DONE}


@pytest.mark.parametrize("name", ["", "lrf", "flapping", "pilot_takeover", "land_ignored"])
def test_the_journal_alone_gives_the_same_decisions(flown, name):
    result = flown(name)
    lines = journal.read("".join(line + "\n" for line in result.lines)).lines
    rules, state = journal.rules_of(lines[0]), EngineState()
    told, again = [], []
    for line in lines[1:]:
        if line.kind == "decision":
            told.append(line.payload)
            continue
        state, commands = decide(state, line.payload, rules)
        again += [command for command in commands if type(command).__name__ == "Decision"]
    assert again == told == list(result.decisions)
    assert state == result.state


def test_several_missions_follow_each_other(configuration):
    missions = tuple(configuration.plan(name).mission for name in ("1", "3", "1"))
    result = run(configuration, missions)
    assert result.results == tuple((name, Result.COMPLETE, DataResult.COMPLETE) for name in "131")
    assert result.state.sessions == 3


def test_an_outreach_that_nobody_answers_ends_the_run(configuration):
    result = run(configuration, (configuration.plan("1").mission,), scenario("fault: tilted, tilt_deg: 30"))
    assert (result.finished, result.state.state, result.results) == (True, State.OUTREACH, ())


def test_the_limit_of_simulated_time_ends_the_run(configuration):
    result = run(configuration, (configuration.plan("4").mission,), limit_ns=60 * S)
    assert (result.finished, result.state.state) == (False, State.MISSION)
    assert result.state.t_ns <= 61 * S


def test_the_same_seed_gives_the_same_journal_and_another_seed_another(configuration):
    missions = (configuration.plan("1").mission,)
    first, again, other = (run(configuration, missions, seed=seed).lines for seed in (3, 3, 4))
    assert first == again
    assert first[1:] != other[1:]


PROGRAM = """
import hashlib, sys
from amaze_autonomy.config import load_configuration
from amaze_autonomy.simulation import load_scenario
from amaze_autonomy.simulation.run import run
configuration = load_configuration(sys.argv[1])
story = load_scenario(sys.argv[1] + "/faults/flapping.yaml")
lines = run(configuration, (configuration.plan("2").mission,), story, seed=5).lines
print(hashlib.sha256("\\n".join(lines).encode()).hexdigest())
"""


@pytest.mark.parametrize("hash_seed", ["0", "1", "4711"])
def test_the_journal_does_not_depend_on_the_hash_seed(configuration, config_folder, hash_seed):
    story = load_scenario(config_folder / "faults" / "flapping.yaml")
    lines = run(configuration, (configuration.plan("2").mission,), story, seed=5).lines
    expected = hashlib.sha256("\n".join(lines).encode()).hexdigest()
    told = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(config_folder)],
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        capture_output=True,
        text=True,
        check=True,
        timeout=600,
    )
    assert told.stdout.strip() == expected


def test_a_mission_is_complete_and_its_data_is_not_when_files_did_not_grow_in_flight(configuration):
    faults = scenario("fault: recording_does_not_grow, platform: second, for_s: 4, after: {event: mission}")
    result = run(configuration, (configuration.plan("1").mission,), faults)
    assert result.results == (("1", Result.COMPLETE, DataResult.INCOMPLETE),)
    assert result.state.peers.recorder.lost == "second: 3.9 s in which nothing was recorded"
    assert [decision.rule for decision in result.decisions][-1] == "data_lost"
