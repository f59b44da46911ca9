"""A flight is replayed alike whatever its clock says: that of a simulation, or of a boot, begins near 0."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from other_recordings import px4_rows, ulog_rows, write_ros2, write_ulog
from replay_bags import START_NS, S, flight_rows, write_bag
from replay_demo import demo_bag, simulated
from replay_runs import CONFIG, replay, texts

from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.journal.journal import decode
from amaze_autonomy.replay.errors import ReplayError
from amaze_autonomy.replay.maps.proposal import propose
from amaze_autonomy.replay.maps.topic_map import load_map
from amaze_autonomy.replay.plan import make_plan
from amaze_autonomy.replay.recordings.sources import Recordings, topics_of
from amaze_autonomy.replay.session import Session
from amaze_autonomy.tester.command import main


def stamped(rows, begin_s):
    """Return the messages of a flight as another clock stamps them: in the bag, and in their headers."""
    by_ns = round(begin_s * S) - rows[0][0]
    return [(t_ns + by_ns, topic, _moved(message, by_ns)) for t_ns, topic, message in rows]


def _moved(message, by_ns):
    header = getattr(message, "header", None)
    if header is None:
        return message
    t_ns = header.stamp.sec * S + header.stamp.nanosec + by_ns
    stamp = dataclasses.replace(header.stamp, sec=t_ns // S, nanosec=t_ns % S)
    return dataclasses.replace(message, header=dataclasses.replace(header, stamp=stamp))


def decided(outcome):
    return [dataclasses.replace(each, t_ns=each.t_ns - outcome.start_ns, values=()) for each in outcome.decisions]


@pytest.mark.slow_rows
@pytest.mark.parametrize("begin_s", [0.2, 1, 50, 1000])
@pytest.mark.parametrize("from_s", [0, 12])
def test_a_flight_of_a_clock_near_0_is_decided_as_that_of_any_day(tmp_path, flight_map, begin_s, from_s):
    rows = [row for row in flight_rows() if row[0] >= START_NS + from_s * S]
    any_day = replay(write_bag(tmp_path / "a.bag", rows), str(flight_map))[0]
    near_0, recordings = replay(write_bag(tmp_path / "b.bag", stamped(rows, begin_s)), str(flight_map))
    assert decided(near_0) == decided(any_day)
    assert texts(near_0) == texts(any_day)
    told = decode(near_0.journal[0]).payload["recording"]
    assert (told["start_ns"], told["shift_ns"]) == (round(begin_s * S), recordings.shift_ns)
    assert near_0.state.session.id.startswith("19700101T")


def test_one_of_a_later_day_is_not_moved(flight_bag, flight_map):
    outcome, recordings = replay(flight_bag, str(flight_map))
    assert recordings.shift_ns == 0
    assert "shift_ns" not in decode(outcome.journal[0]).payload["recording"]


def test_times_are_told_as_they_were_recorded(tmp_path, flight_map, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "b.bag", stamped(flight_rows(), 1))
    assert main(["run", "b.bag", "--map", str(flight_map), "--out", "out"]) == 0
    told = json.loads(Path("out/result.json").read_text())
    assert told["start_ns"] == S


def test_statuses_and_the_log_of_our_own_recording_are_moved_as_well(tmp_path):
    """The recorded engine's own journal, its statuses with their ages, and what the user asked."""
    lines = simulated()
    any_day = replay(demo_bag(tmp_path / "a.bag", lines), "amaze_demo")[0]
    rows = []
    demo_bag(tmp_path / "b.bag", lines, written=lambda path, found: rows.extend(found) or path)
    near_0 = replay(write_bag(tmp_path / "b.bag", stamped(rows, 1)), "amaze_demo")[0]
    assert decided(near_0) == decided(any_day)


def test_what_px4_said_is_decided_as_that_of_any_day_also_in_a_ulog_whose_gps_told_no_time(tmp_path):
    rows = [row for row in ulog_rows() if row[1] != "vehicle_gps_position"]
    any_day = write_ros2(tmp_path / "a", px4_rows(rows))
    near_0 = write_ros2(tmp_path / "b", stamped(px4_rows(rows), 1))
    boot = write_ulog(tmp_path / "c.ulg", rows)
    told = {}
    for path in (any_day, near_0, boot):
        (tmp_path / "map.yaml").write_text(propose([path]).text)
        plan = make_plan(load_configuration(CONFIG), load_map(str(tmp_path / "map.yaml")), "1", topics_of([path]))
        with Recordings([path], plan.topics, replayed=True) as recordings:
            told[path] = decided(Session(plan, recordings).run())
            assert bool(recordings.shift_ns) == (path != any_day)
    assert told[near_0] == told[boot] == told[any_day]
    assert len(told[any_day]) > 8


def test_what_is_read_without_room_for_the_script_is_refused(tmp_path, range_map):
    path = write_bag(tmp_path / "b.bag", stamped([row for row in flight_rows() if row[0] >= START_NS + 12 * S], 0))
    plan = make_plan(load_configuration(CONFIG), load_map(range_map), "1", ("/imu", "/range", "/mag", "/battery"))
    with Recordings([path], plan.topics) as recordings, pytest.raises(ReplayError, match="before time 0"):
        Session(plan, recordings)
