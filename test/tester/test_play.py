"""A case on bags: a fault changes what is decided, not when the flight is asked for, nor what the recording lacks."""

from __future__ import annotations

from pathlib import Path

import pytest
from replay_bags import break_chunk, flight_rows, write_bag

from amaze_autonomy.tester import Options
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
