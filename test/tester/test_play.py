"""A case on bags: a fault changes what is decided, not when the flight is asked for, nor what the recording lacks."""

from __future__ import annotations

from pathlib import Path

import pytest
from replay_bags import START_NS, S, break_chunk, flight_rows, write_bag

from amaze_autonomy.tester import Options, run_task, tasks_of
from amaze_autonomy.tester.expect.model import about
from amaze_autonomy.tester.golden import decisions_of
from amaze_autonomy.tester.play import play
from amaze_autonomy.tester.scenario.files import load_cases

MAP = Path(__file__).parents[1] / "replay" / "flight.yaml"
SCENARIO = "version: 1\ndescription: x\nbags: [{path: flight.bag}]\nmap: flight.yaml\n"
HELD = {
    0: ["/armed: 44", "/battery: 9", "/imu: 216", "/landed: 43", "/range: 87"],
    2: ["/armed: 45", "/battery: 9", "/imu: 226", "/landed: 45", "/range: 90"],
}
"""By its place: what a chunk of the bag holds of each topic that is looked into."""
CALM = "faults: [{topic: /mag, fault: silent, %s, for_s: 1.5}]\n"


@pytest.fixture(autouse=True)
def flight(tmp_path, monkeypatch):
    """A flight that is armed at 7.6 s, and whose mission is selected 4.6 s before the last word that it is not."""
    monkeypatch.chdir(tmp_path)
    Path("flight.yaml").write_text(MAP.read_text().replace("select_at_s: 3.0", "select_before_arming_s: 4.6"))
    return write_bag(tmp_path / "flight.bag", flight_rows(), "lz4")


def played(more):
    Path("x.scenario.yaml").write_text(SCENARIO + more)
    (case,) = load_cases(Path("x.scenario.yaml"))
    return play(case, Options(goldens=False))


@pytest.mark.parametrize(
    "fault",
    [
        "fault: silent, at_s: 7.0, for_s: 1.5",
        "fault: silent, at_s: 0.0",
        "fault: delayed, delay_s: 2.0, at_s: 0.0",
    ],
)
def test_a_fault_on_the_topic_of_the_arming_does_not_move_the_selection(fault):
    found = played(f"faults: [{{topic: /armed, {fault}}}]\n")
    selected = [each.t_ns for each in found.trace.decisions if each.rule == "mission_selected"]
    assert list(map(found.trace.seconds, selected)) == [2.9]


@pytest.mark.parametrize("when", ["at_s: 12.0", "after: {state: MISSION}"])
@pytest.mark.parametrize("place", [0, 2])
def test_a_message_that_cannot_be_read_is_counted_once_however_often_it_is_asked_for(flight, place, when):
    break_chunk(flight, place, 300, 50)
    broken = played(CALM % when).broken
    assert sorted(line.partition(" messages")[0] for line in broken) == HELD[place]


PART = "from_s: 10.0\nto_s: 25.0\n"


def judged(more):
    Path("x.scenario.yaml").write_text(SCENARIO + PART + more)
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    return run_task(task)


def test_times_of_a_part_count_from_the_first_message_of_the_recording():
    """It is up at 8 s."""
    fault = "faults: [{topic: /imu, fault: silent, at_s: 12.0, for_s: 2.0}]\n"
    anchors = "anchors: {late: {at_s: 14.0}, fails: {fault: 1}}\n"
    windows = ("from: 12.0, to: 13.0", "from: fails, to: late", "from: 11.0, to: 12.0")
    expected = "".join(f"  - {{expect: exists, of: {{component: imu, code: 8}}, {window}}}\n" for window in windows)
    found = judged(f"{fault}{anchors}expectations:\n{expected}")
    assert [finding.grade.value for finding in found.findings] == ["PASS", "PASS", "FAIL"]
    assert [(finding.begin_s, finding.end_s) for finding in found.findings] == [
        (12.0, 13.0),
        (12.0, 14.0),
        (11.0, 12.0),
    ]
    assert [mark[:3] for mark in found.marks if mark[0] == "fault"] == [("fault", 12.0, 14.0)]
    failed = next(each for each in decisions_of(found.lines) if about(each) == "imu")
    assert 12.0 < (failed.t_ns - START_NS) / S < 12.5
    assert found.figures.flown_s == pytest.approx(15.0)


def test_a_window_that_begins_with_the_run_begins_where_the_part_does():
    windows = ("to: 20.0", "from: 0.0, to: 20.0", "from: 9.5, to: 20.0")
    expected = "".join(f"  - {{expect: never, of: {{command: LAND}}, {window}}}\n" for window in windows)
    found = judged(f"expectations:\n{expected}")
    assert [(finding.grade.value, finding.begin_s, finding.end_s) for finding in found.findings] == [
        ("PASS", 10.0, 20.0)
    ] * 3


BEFORE = {
    "expectations: [{expect: never, of: {command: LAND}, from: 5.0, to: 20.0}]\n": "never command LAND, from 5 s, "
    "to 20 s: nothing to look at: the run begins at +10.000 s",
    "anchors: {early: {at_s: 5.0}}\nexpectations: [{expect: never, of: {command: LAND}, from: early}]\n": "never "
    "command LAND, from early: nothing to look at: early did not happen",
    "faults: [{topic: /imu, fault: silent, at_s: 5.0}]\n": "/imu silent never began",
    "requests: [{request: land, at_s: 5.0}]\n": "land was never asked",
}


@pytest.mark.parametrize("more", BEFORE)
def test_what_is_timed_before_the_part_is_vacuous(more):
    found = judged(more)
    assert (found.verdict.value, found.headline) == ("VACUOUS", BEFORE[more])


def test_the_place_of_a_silence_counts_from_there_as_well():
    Path("flight.bag").unlink()
    write_bag(Path("flight.bag"), flight_rows(silent={"/mag": (12.0, 15.0)}), "lz4")
    found = judged("needs: [{topic: /mag, gap_s: 1.0}]\n")
    assert found.headline == "/mag: silent for 3.100 s at +11.900 s, at most 1 s are allowed"
