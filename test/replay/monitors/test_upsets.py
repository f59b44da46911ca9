"""Free fall, an impact, a tilt in flight, and ranges at their own limit are lines with the worst value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from replay_bags import START_NS, S, flight_rows, height_m, write_bag
from replay_runs import DATA, recording, replay, texts

from amaze_autonomy.engine.events import AutopilotStatus, VehicleLanded
from amaze_autonomy.replay.monitors.upsets import airborne, upset_lines

T_S = np.arange(0.0, 20.0, 0.01)
AIR = [(5.0, 15.0)]


def words(acceleration=None, tilt=None, spans=AIR):
    given = [None if each is None else (T_S, np.array(each, float)) for each in (acceleration, tilt)]
    return [(round((line.t_ns - START_NS) / S, 3), line.text) for line in upset_lines(spans, *given, START_NS)]


def level(value, *changes):
    values = np.full(len(T_S), value)
    for begin_s, end_s, other in changes:
        values[(begin_s <= T_S) & (end_s > T_S)] = other
    return values


def test_a_fall_and_the_impact_that_ends_it():
    acceleration = level(9.81, (14.0, 14.6, 0.9), (14.6, 14.63, 41.5))
    assert words(acceleration) == [
        (14.0, "free fall for 0.59 s: acceleration down to 0.9 m/s^2, below 3 m/s^2"),
        (14.6, "impact: acceleration up to 41.5 m/s^2, above 25 m/s^2"),
    ]


def test_an_impact_just_behind_the_air_counts_and_one_on_the_ground_does_not():
    assert [at for at, _ in words(level(9.81, (16.9, 16.92, 30.0)))] == [16.9]
    assert words(level(9.81, (17.1, 17.12, 30.0), (2.0, 2.1, 30.0))) == []


def test_a_bump_is_no_fall_and_several_peaks_of_one_impact_are_one():
    assert words(level(9.81, (8.0, 8.1, 0.5))) == []
    bounces = level(9.81, (8.0, 8.02, 30.0), (8.4, 8.42, 33.0), (9.2, 9.22, 26.0))
    assert words(bounces) == [(8.0, "impact: acceleration up to 33.0 m/s^2, above 25 m/s^2")]


def test_a_fall_that_is_broken_by_a_good_sample_begins_anew():
    broken = level(9.81, (8.0, 8.1, 0.5), (8.11, 8.2, 0.5))
    assert words(broken) == []


def test_a_tilt_beyond_the_limit_in_flight_with_its_worst_value_and_duration():
    assert words(None, level(3.0, (7.0, 8.0, 60.0), (7.5, 7.6, 81.4), (1.0, 3.0, 90.0))) == [
        (7.0, "tilted in flight: up to 81 deg, limit 45 deg, for 0.99 s")
    ]
    assert words(None, level(3.0, (7.0, 7.1, 60.0))) == []


def test_what_is_not_a_number_is_no_upset():
    assert words(level(np.nan), level(np.nan)) == []


def test_the_air_is_what_the_landed_states_say():
    said = [(0, "ON_GROUND"), (2, "TAKING_OFF"), (3, "IN_AIR"), (8, "UNKNOWN"), (9, "LANDING"), (10, "ON_GROUND")]
    said += [(12, "IN_AIR"), (14, "IN_AIR")]
    statuses = [AutopilotStatus(t_ns=START_NS + at * S, armed=None, landed=VehicleLanded[name]) for at, name in said]
    assert airborne(statuses, START_NS) == [(2.0, 10.0), (12.0, 14.0)]


def test_a_replay_has_them_in_its_timeline(tmp_path, flight_map):
    rows = flight_rows()
    at_s = next(t / 10 for t in range(300) if height_m(t / 10) > 1.0)
    for t_ns, topic, message in rows:
        if topic == "/imu" and at_s + 2.0 <= (t_ns - START_NS) / S < at_s + 2.5:
            message.linear_acceleration.z = 0.4
    outcome, _ = replay(write_bag(tmp_path / "flight.bag", rows), flight_map)
    (line,) = [text for text in texts(outcome) if "free fall" in text]
    assert line.split(" ", 2)[1:] == ["bag", "free fall for 0.48 s: acceleration down to 0.4 m/s^2, below 3 m/s^2"]
    assert [each.t_ns for each in outcome.timeline] == sorted(each.t_ns for each in outcome.timeline)


def test_ranges_at_their_own_limit_are_said_to_be_that_and_the_map_s_limit_wins(tmp_path, flight_map):
    rows = flight_rows()
    for _, topic, message in rows:
        if topic == "/range":
            message.max_range = 1.5
    bag = write_bag(tmp_path / "flight.bag", rows)
    own, _ = replay(bag, flight_map)
    (line,) = [text for text in texts(own) if "max_range" in text]
    assert "readings are at or above the max_range of their own message, 1.5 m, until " in line
    assert line.endswith(": nothing seen")
    other = tmp_path / "other.yaml"
    other.write_text(
        Path(flight_map).read_text().replace("min_range_m: 0.01}", "min_range_m: 0.01, max_range_m: 40.0}")
    )
    given, _ = replay(bag, str(other))
    (line,) = [text for text in texts(given) if "max_range" in text]
    assert line.endswith(": the map's 40 m count")

    def judged(outcome):
        said = [text.partition(" landing detection: ")[2] for text in texts(outcome)]
        return [each.split()[0] for each in said if each]

    assert "UNKNOWN" in judged(own)[1:]
    assert "UNKNOWN" not in judged(given)[1:]


@pytest.mark.skipif(not DATA.is_dir(), reason="no recordings: set AMAZE_DATA")
@pytest.mark.parametrize(
    "name, expected",
    [
        ("ardrone_indoor_flight.bag", ["impact"]),
        ("husky_outdoor_drive.bag", []),
        ("handheld_roll_pitch_yaw.bag", []),
    ],
)
@pytest.mark.slow_rows(1)
def test_real_recordings(name, expected):
    path = recording(name)
    outcome, _ = replay(path)
    found = [line.text.split(":")[0].split(" ")[0] for line in outcome.timeline if line.level == 2]
    assert [each for each in found if each in ("free", "impact", "tilted")] == expected
