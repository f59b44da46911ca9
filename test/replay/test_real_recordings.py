"""What the replay finds in the real recordings, which are no part of the repository (AMAZE_DATA)."""

from __future__ import annotations

import re
from math import degrees

import pytest
from replay_bags import S, rewrite
from replay_runs import ROOT, moves, recording, replay, texts

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import CheckName, Verdict
from amaze_autonomy.engine.state import State
from amaze_autonomy.replay.maps.topic_map import load_map
from amaze_autonomy.replay.timeline import LineKind
from amaze_autonomy.tester.command import main

RECORDINGS = (
    "ardrone_indoor_flight",
    "crazyflie_sine",
    "example_lz4",
    "handheld_roll_pitch_yaw",
    "husky_outdoor_drive",
)


def row(outcome, name):
    _, rows = outcome.checks[CheckName.STATE_ESTIMATION]
    return next(each for each in rows if each.name == name)


def test_the_ar_drones_link_gaps_are_seen_as_silence_and_as_a_slow_rate_with_their_times():
    outcome, recordings = replay(recording("ardrone_indoor_flight.bag"))
    imu = [text for text in texts(outcome, LineKind.MONITOR) if "watchdog: imu" in text]
    silence = "no message on /ardrone/imu for longer than 0.2 s"
    assert [text for text in imu if silence in text] == [
        f"+100.140 bag watchdog: imu code 2 -> 16 {silence}",
        f"~ +101.880 bag watchdog: imu code 2 -> 16 {silence}",
        f"~ +104.260 bag watchdog: imu code 2 -> 16 {silence}",
        f"~ +105.580 bag watchdog: imu code 2 -> 16 {silence}",
    ]
    assert "+20.180 bag watchdog: imu code 1 -> 2 110 Hz on /ardrone/imu, too slow, expected 200 Hz" in imu
    figures = {each.topic: each for each in recordings.figures()}["/ardrone/imu"]
    assert (figures.messages, round(figures.rate_hz, 1), round(figures.longest_gap_s, 3)) == (23093, 181.8, 0.238)


def test_the_ar_drone_would_have_landed_at_its_first_long_gap():
    outcome, _ = replay(recording("ardrone_indoor_flight.bag"))
    assert ("MISSION", "LAND", "land") in moves(outcome)
    assert (outcome.missed, round((outcome.counterfactual_ns - outcome.start_ns) / S, 2)) == (
        MissionAction.LAND,
        100.14,
    )


def test_the_ar_drones_gravity_points_down():
    outcome, _ = replay(recording("ardrone_indoor_flight.bag"))
    assert {name: row(outcome, name).verdict for name in ("gravity magnitude", "tilt")} == {
        "gravity magnitude": Verdict.PASS,
        "tilt": Verdict.PASS,
    }
    assert not any("state check: tilt" in text and "passes" not in text for text in texts(outcome))


def test_the_huskys_gravity_does_not_point_down_because_its_imu_lies_on_its_side():
    outcome, _ = replay(recording("husky_outdoor_drive.bag"))
    tilt = row(outcome, "tilt")
    assert (tilt.verdict, round(degrees(tilt.value))) == (Verdict.FAIL, 90)
    assert "imu_mounting_rpy_deg is wrong" in tilt.advice
    assert [move for move in moves(outcome) if move[1] == "OUTREACH"] == [
        ("PREFLIGHT", "OUTREACH", "checks_failed")
    ] * 3
    assert outcome.state.state is State.MISSION_INPUT


def test_with_its_mounting_the_huskys_gravity_points_down(tmp_path):
    text = (load_map.__globals__["MAPS"] / "husky_outdoor_drive.yaml").read_text()
    path = tmp_path / "mounted.yaml"
    path.write_text(text + "\nstate_estimation: {imu_mounting_rpy_deg: [90.0, 0.0, 0.0]}\n")
    outcome, _ = replay(recording("husky_outdoor_drive.bag"), str(path))
    assert row(outcome, "tilt").verdict is Verdict.PASS


def test_the_hand_held_tilts_are_followed():
    outcome, _ = replay(recording("handheld_roll_pitch_yaw.bag"))
    tilts = [text for text in texts(outcome, LineKind.MONITOR) if "state check: tilt" in text]
    sides = [text.split("deg ")[-1].split(",")[0] for text in tilts if "vehicle is tilted" in text]
    assert sides[:4] == ["forward", "backward", "to the left", "to the right"]
    assert sum("passes" in text for text in tilts) >= len(sides)
    assert "passes" in tilts[-1]


def test_the_hand_held_board_passes_its_checks_once_it_lies_still():
    outcome, _ = replay(recording("handheld_roll_pitch_yaw.bag"))
    passed = [d for d in outcome.decisions if d.rule == "checks_passed"]
    assert round((passed[-1].t_ns - outcome.start_ns) / S) == 36
    failed = [d for d in outcome.decisions if d.rule == "checks_failed"]
    assert len(failed) == 6


def test_the_crazyflies_range_in_millimetres_tells_ground_and_air():
    outcome, _ = replay(recording("crazyflie_sine.bag"))
    landing = [text for text in texts(outcome, LineKind.MONITOR) if "landing detection: " in text]
    assert [text.split(": ")[1].split(" ")[0] for text in landing] == [
        "UNKNOWN",
        "ON_GROUND",
        "AIRBORNE",
        "ON_GROUND",
        "UNKNOWN",
    ]
    assert landing[2].startswith("+8.201 bag")
    assert landing[3].startswith("+24.201 bag")


def test_the_crazyflies_invalid_orientation_is_not_used():
    outcome, _ = replay(recording("crazyflie_sine.bag"))
    source, rows = outcome.checks[CheckName.STATE_ESTIMATION]
    assert source.words == "bag"
    assert {each.name: each.verdict for each in rows}["tilt"] is Verdict.PASS


def test_the_crazyflies_sensors_end_before_the_end_of_its_flight_is_believed():
    """It is on the ground 0.6 s before its logs end: what has not been seen to agree for long enough is landed for."""
    outcome, _ = replay(recording("crazyflie_sine.bag"), overrides=["autonomy.takeoff.takeoff_height_m=0.3"])
    assert [move[2] for move in moves(outcome)][-3:] == ["takeoff", "at_takeoff_height", "land"]


def test_a_recording_without_a_vehicle_shows_rates_of_custom_types():
    outcome, recordings = replay(recording("example_lz4.bag"))
    assert [(each.messages, round(each.rate_hz, 1)) for each in recordings.figures()] == [(1344, 62.5), (1344, 62.5)]
    assert outcome.state.state is not None


def quoted(page):
    """Return the lines of timelines that a page quotes: continued ones joined, cut ones without their end.

    The number of a request is left out: one more check would be one more request before it.
    """
    lines = []
    for line in page.splitlines():
        if re.match(r"[~ ] +[+-]\d+\.\d{3}  (bag|script|log)", line):
            lines.append(line)
        elif lines and line.startswith(" " * 20) and not line.lstrip().startswith(("state ", "value ", "command ")):
            lines[-1] += " " + line.strip()
    return [unnumbered(" ".join(line.split(" ...")[0].split())) for line in lines]


def unnumbered(text):
    return re.sub(r"#\d+", "#", text)


def test_what_the_documentation_quotes_is_what_the_replay_says():
    lower = ["autonomy.takeoff.takeoff_height_m=0.3"]
    said = {
        unnumbered(text)
        for name, overrides in [*((name, ()) for name in RECORDINGS), ("crazyflie_sine", lower)]
        for text in texts(replay(recording(f"{name}.bag"), overrides=overrides)[0])
    }
    lines = quoted((ROOT / "docs" / "replay.md").read_text())
    assert len(lines) > 15
    assert [line for line in lines if not any(text.startswith(line) for text in said)] == []


def test_a_recording_without_messages_is_one_clear_error(capsys):
    assert main(["run", str(recording("no_messages.bag")), "--map", "husky_outdoor_drive"]) == 2
    assert capsys.readouterr().err == "amaze-replay: no_messages.bag: there is no message in it\n"


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("name", RECORDINGS)
def test_the_journal_of_every_recording_is_decided_again_without_difference(tmp_path, name):
    assert main(["run", str(recording(f"{name}.bag")), "--out", str(tmp_path)]) == 0
    assert main(["journal", str(tmp_path / "journal.jsonl")]) == 0


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("name", ["ardrone_indoor_flight", "crazyflie_sine", "example_lz4"])
def test_the_compression_of_a_real_recording_does_not_matter(tmp_path, name):
    source = recording(f"{name}.bag")
    whole = replay(source)[0].journal
    for compression in ("none", "lz4"):
        assert replay(rewrite(source, tmp_path / f"{compression}.bag", compression), name)[0].journal == whole


@pytest.mark.slow_rows(1)
@pytest.mark.long
@pytest.mark.parametrize("name", RECORDINGS)
def test_muting_any_required_topic_of_a_real_recording_changes_the_journal(name):
    source = recording(f"{name}.bag")
    whole = replay(source)[0].journal
    required = [component for component in load_map(name).components if component.required]
    assert required
    for component in required:
        assert replay(source, muted=[component.topic.topic])[0].journal[1:] != whole[1:], component.name
