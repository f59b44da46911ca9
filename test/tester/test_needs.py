"""What a scenario needs is asked of the whole range that is played: a topic that ends half-way does not offer it."""

from __future__ import annotations

from pathlib import Path

import pytest
from replay_bags import START_NS, S, flight_rows, write_bag

from amaze_autonomy.tester import Options, run_task, tasks_of
from amaze_autonomy.tester.command import main

MAP = Path(__file__).parents[1] / "replay" / "flight.yaml"
SCENARIO = """\
version: 1
description: x
bags: [{path: flight.bag}]
map: flight.yaml
needs: [{topic: /mag, rate_hz: %s, gap_s: %s}]
expectations: [{expect: exists, of: {state: PREFLIGHT}}]
"""


def result(rate_hz, gap_s, silent=(), more="", script="select_at_s: 3.0"):
    Path("flight.bag").unlink(missing_ok=True)
    write_bag(Path("flight.bag"), flight_rows(silent={"/mag": silent} if silent else None))
    Path("flight.yaml").write_text(MAP.read_text().replace("select_at_s: 3.0", script))
    Path("x.scenario.yaml").write_text(SCENARIO % (rate_hz, gap_s) + more)
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    found = run_task(task)
    return found.verdict.value, found.problems


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_topic_that_comes_all_the_time_offers_its_rate():
    assert result(9.9, 0.2)[0] == "PASS"


LACKS = {
    (18.0, 99.0): ("/mag: 4.97 Hz, at least 9.9 Hz are needed", "/mag: silent for 18.080 s at +17.900 s"),
    (0.0, 18.0): ("/mag: 4.97 Hz, at least 9.9 Hz are needed", "/mag: silent for 18.000 s at +0.000 s"),
}


@pytest.mark.parametrize("silent", LACKS)
def test_a_topic_that_ends_or_begins_half_way_does_not(silent):
    rate, gap = LACKS[silent]
    assert result(9.9, 0.2, silent) == ("INCONCLUSIVE", (rate, f"{gap}, at most 0.2 s are allowed"))


def test_only_the_range_that_is_played_is_looked_at():
    assert result(9.8, 0.2, (18.0, 99.0), "to_s: 17.9\n")[0] == "PASS"
    assert result(9.8, 0.2, (0.0, 18.0), "from_s: 18.0\n")[0] != "INCONCLUSIVE"


def test_a_range_that_the_recording_does_not_reach_is_inconclusive():
    assert result(9.8, 0.2, more="to_s: 36.5\n")[0] == "PASS"  # a rounded length
    words = "to_s is 60.000 s, and the recording ends at +35.980 s"
    assert result(9.8, 0.2, more="to_s: 60.0\n") == ("INCONCLUSIVE", (words,))


def test_a_silence_that_a_clock_hid_by_being_set_back_is_inconclusive():
    """The later messages lie in the hole; of the flight nothing else is known to be wrong."""
    assert result(9.8, 0.2)[0] == "PASS"
    rows = flight_rows(silent={"/mag": (20.0, 24.0)})
    Path("flight.bag").unlink()
    write_bag(Path("flight.bag"), [(t_ns - 4 * S * (t_ns >= START_NS + 24 * S), *rest) for t_ns, *rest in rows])
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    found = run_task(task)
    words = "flight.bag: its clock was set back by 3.980 s or more at +23.980 s: "
    assert (found.verdict.value, found.headline[: len(words)]) == ("INCONCLUSIVE", words)
    assert main(["run", "flight.bag", "--map", "flight.yaml"]) == 3
    assert result(9.8, 0.2, more="to_s: 19.9\n")[0] == "PASS"


def test_what_the_script_plays_until_a_topic_begins_is_not_missing():
    script = "select_at_s: 3.0, sensors_until_s: 18.0"
    assert result(9.8, 0.2, (0.0, 18.0), script=script)[0] == "PASS"
    assert result(9.8, 0.2, (2.0, 18.0), script=script) == (
        "INCONCLUSIVE",
        (
            "/mag: 5.53 Hz, at least 9.8 Hz are needed",
            "/mag: silent for 16.100 s at +1.900 s, at most 0.2 s are allowed",
        ),
    )
