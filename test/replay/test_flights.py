"""Every flight of a recording is judged by itself, and a part of it from where it begins."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from replay_bags import START_NS, S, flight_rows, write_bag
from replay_runs import recording

from amaze_autonomy.tester.command import main

LATER_S = 60


@pytest.fixture
def two(tmp_path, flight_map):
    """A recording of two flights, the second a minute after the first; what runs it by its map."""
    again = flight_rows(silent={"/imu": (20.0, 20.6)})
    rows = flight_rows() + [(t_ns + LATER_S * S, topic, message) for t_ns, topic, message in again]
    return ["run", str(write_bag(tmp_path / "two.bag", rows)), "--map", flight_map]


def verdict(capsys):
    return capsys.readouterr().out.splitlines()[-1]


def test_both_are_named_and_the_whole_is_judged_as_one_recording(two, capsys):
    assert main(two) == 0
    lines = capsys.readouterr().out.splitlines()
    place = lines.index("2 flights; --flight N judges one by itself, --flights each:")
    assert [line[:16] for line in lines[place + 1 : place + 3]] == ["  1, armed +7.6 ", "  2, armed +67.6"]
    assert main([*two, "--json"]) == 0
    flights = json.loads(capsys.readouterr().out)["flights"]
    assert [round(each["armed_s"]) for each in flights] == [8, 68]


def test_each_is_judged_by_itself(two, capsys):
    assert main([*two, "--flight", "1"]) == 0
    assert "ends in MISSION_ENDED (COMPLETE)" in verdict(capsys)
    assert main([*two, "--flight", "2"]) == 0
    assert "the recorded vehicle did not do what was commanded then (LAND)" in verdict(capsys)
    assert main([*two, "--flights"]) == 0
    one, other = capsys.readouterr().out.splitlines()
    assert one.startswith("flight 1, armed +7.6 s to +31.5 s: ends in MISSION_ENDED (COMPLETE) after ")
    assert other.startswith("flight 2, armed +67.6 s to +91.5 s: ends in ")
    assert "did not do what was commanded then (LAND)" in other


@pytest.mark.parametrize("script", ["select_at_s: -2.5, select_before_arming_s: 4.5", "select_at_s: 0.5"])
def test_a_flight_that_begins_late_is_judged_or_it_is_said_how(tmp_path, flight_map, capsys, script):
    """A minute on the ground before it."""
    idle = [row for row in flight_rows() if row[0] < START_NS + 7 * S]
    before = [(t_ns + turn * 7 * S, topic, message) for turn in range(9) for t_ns, topic, message in idle]
    flown = [(t_ns + 63 * S, topic, message) for t_ns, topic, message in flight_rows()]
    path = tmp_path / "late.yaml"
    path.write_text(re.sub("select_at_s: 3.0", script, Path(flight_map).read_text()))
    bag = write_bag(tmp_path / "late.bag", [*before, *flown])
    assert main(["run", str(bag), "--map", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    complete = "before_arming" in script
    assert ("ends in MISSION_ENDED (COMPLETE)" in lines[-1]) == complete
    assert ("1 flight; --flight N judges one by itself, --flights each:" in lines) != complete
    assert ("  1, armed +70.6 s to +94.6 s" in lines) != complete
    assert main(["run", str(bag), "--map", str(path), "--flight", "1"]) == 0
    assert "ends in MISSION_ENDED (COMPLETE)" in verdict(capsys)


def test_a_part_in_the_middle_of_a_flight_begins_in_the_air(two, capsys):
    assert main([*two, "--from", "15", "--to", "34"]) == 0
    out = capsys.readouterr().out
    assert "the recording begins in the air at 3.0 m (landed is IN_AIR)" in out
    assert out.splitlines()[-1].startswith("Map flight, mission 1: ends in MISSION_ENDED (COMPLETE)")


@pytest.mark.parametrize(
    "words,wrong",
    [
        (["--flight", "3"], "there is no flight 3: the recording tells of 2 armings"),
        (["--flight", "0"], "there is no flight 0: the recording tells of 2 armings"),
        (["--flights", "--from", "5"], "--flights goes without --from; judge one with --flight N for that"),
        (
            ["--flights", "--flight", "1", "--out", "x", "--json", "--to", "9", "--html", "x"],
            "--flights goes without --to, --flight, --out, --html, --json; judge one with --flight N for that",
        ),
        (["--flight", "1", "--to", "9"], "--flight goes without --to; name either"),
        (["--from", "40", "--to", "45"], "there is no message between --from and --to"),
    ],
)
def test_what_is_not_there_is_one_clear_error(two, capsys, words, wrong):
    assert main([*two, *words]) == 2
    assert capsys.readouterr().err == f"amaze-replay: {wrong}\n"


def test_a_key_that_nothing_looked_at_is_named_for_each_flight(two, capsys):
    assert main([*two, "--flights", "--set", "autonomy.flight.max_distance_m=50.0"]) == 4
    _, first, _, other = capsys.readouterr().out.splitlines()
    words = "  VACUOUS: autonomy.flight.max_distance_m was not looked at: "
    assert first.startswith(words)
    assert other.startswith(words)
    assert main([*two, "--flights", "--set", "autonomy.takeoff.takeoff_height_m=1.1"]) == 0


def test_a_key_is_not_looked_at_where_nothing_was_flown(tmp_path, flight_map, capsys):
    bag = write_bag(tmp_path / "idle.bag", [row for row in flight_rows() if row[0] < START_NS + 5 * S])
    idle = ["run", str(bag), "--map", flight_map, "--flights"]
    assert main(idle) == 0
    assert main([*idle, "--set", "autonomy.takeoff.takeoff_height_m=1.1"]) == 4
    assert capsys.readouterr().out == 2 * "the recording tells of no arming\n" + (
        "VACUOUS: autonomy.takeoff.takeoff_height_m was not looked at: the recording tells of no arming\n"
    )


def test_the_real_log_of_an_arducopter_holds_seven_flights(capsys):
    assert main(["run", str(recording("copter_low_battery.tlog")), "--flights"]) == 3  # its last record is cut
    cut, *lines = capsys.readouterr().out.splitlines()
    assert cut.endswith("its last 19 bytes, from byte 2723821 on, are no whole record: it was cut there")
    assert [line.partition(":")[0] for line in lines] == [
        "flight 1, armed +462.0 s to +574.7 s",
        "flight 2, armed +591.8 s to +734.7 s",
        "flight 3, armed +771.1 s to +776.4 s",
        "flight 4, armed +780.4 s to +785.2 s",
        "flight 5, armed +793.4 s to +856.9 s",
        "flight 6, armed +923.2 s to +952.2 s",
        "flight 7, armed +966.3 s to +1037.7 s",
    ]
    assert all("PILOT" in line for line in lines)
