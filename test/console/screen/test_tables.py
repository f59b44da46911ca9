"""The tables: what is left out when there is no room, and the order of what is wrong."""

from __future__ import annotations

import io
import random
from dataclasses import replace

import pytest
from console_scenes import CAMERA, GPS, LRF, REALSENSE
from rich.console import Console

from amaze_autonomy.console.model import PendingFailure, Snapshot
from amaze_autonomy.console.screen.style import ASCII
from amaze_autonomy.console.screen.tables import action_words, checks_table, failures_table
from amaze_autonomy.engine.events import Check, Verdict

WORDS = ("battery", "fraction", "range", "of", "the", "state_estimation:", "orientation", "a", "deviation")


def draw(table, width):
    out = io.StringIO()
    Console(file=out, width=width, color_system=None).print(table)
    return out.getvalue().splitlines()


def some_checks(random_):
    def words(most):
        return " ".join(random_.choice(WORDS) for _ in range(random_.randint(1, most)))

    return tuple(
        Check(
            f"{number} {words(2)}",
            random_.choice([Verdict.PASS] * 6 + list(Verdict)),
            random_.choice([None, 0.1, 123456.0, 1e-5]),
            random_.choice([None, 5.0]),
            random_.choice(["", "Hz", "m/s^2", "fraction"]),
            random_.choice([None, 0.5, 1234.5]),
            random_.choice(["", "", words(20)]),
        )
        for number in range(random_.randint(1, 45))
    )


@pytest.mark.parametrize("seed", range(60))
@pytest.mark.slow_rows
def test_what_has_not_passed_is_always_shown_and_the_rest_fits(seed):
    random_ = random.Random(seed)
    checks = some_checks(random_)
    width = random_.choice([60, 79, 80, 100, 120, 160])
    whole = draw(checks_table(checks, width, 10_000, ASCII), width)
    bad = tuple(check for check in checks if check.verdict is not Verdict.PASS)
    least = len(draw(checks_table(bad, width, 10_000, ASCII), width)) if bad else 2
    for rows in {least + 4, (least + 4 + len(whole)) // 2, len(whole)}:
        lines = draw(checks_table(checks, width, rows, ASCII), width)
        text = "\n".join(lines)
        assert len(lines) <= max(rows, least + 4)
        assert all(f"{check.name.split()[0]} " in text for check in bad)
        if rows >= len(whole):
            assert lines == whole


def test_the_number_of_rows_left_out_is_said():
    checks = tuple(Check(f"sensor {number}", Verdict.PASS) for number in range(30))
    lines = draw(checks_table(checks, 100, 10, ASCII), 100)
    assert [line.split()[1] for line in lines[2:-1]] == ["0", "1", "2", "3", "4", "5", "6"]
    assert lines[-1].strip() == "and 23 more that passed"


@pytest.mark.parametrize(
    "failure, words",
    [
        (LRF, "waits 6 s (restart limit), then LAND"),
        (REALSENSE, "waits 19 s (wait limit), then CONTINUE"),
        (GPS, "flies on without it"),
        (CAMERA, "LAND"),
        (PendingFailure("user_hold", 0, "wait", "land", None), "waits, then LAND"),
        (PendingFailure("pilot", 0, "pilot"), "PILOT"),
        (PendingFailure("x", 0, "wait", "", 0.5), "waits 0 s, then ?"),
    ],
)
def test_what_is_done_about_a_failure_in_words(failure, words):
    assert action_words(failure, 2.0) == words


def names(snapshot):
    return [line.split()[0] for line in draw(failures_table(snapshot, 0.0, ASCII), 160)[2:]]


def test_the_worst_and_most_urgent_comes_first():
    failures = (GPS, REALSENSE, LRF, CAMERA, PendingFailure("user_hold", 0, "wait", "land", None))
    snapshot = Snapshot(state="LAND", in_flight=True, failures=failures)
    assert names(snapshot) == ["mission_camera", "lrf", "realsense_camera", "user_hold", "gps"]


def test_faults_of_one_cause_are_one_row():
    cause = "no link to the autopilot"
    gps, imu = replace(GPS, cause=cause), PendingFailure("imu", 16, "land", "", None, "", cause, "silent")
    snapshot = Snapshot(state="LAND", in_flight=True, failures=(gps, LRF, imu))
    lines = draw(failures_table(snapshot, 0.0, ASCII), 120)
    assert lines[2].split() == ["2", "faults", "16", "LAND", *f"{cause}: imu, gps".split()]
    assert names(snapshot) == ["2", "lrf"]


def test_on_the_ground_nothing_is_done_about_a_failure():
    snapshot = Snapshot(state="PREFLIGHT", in_flight=False, failures=(CAMERA,))
    lines = draw(failures_table(snapshot, 0.0, ASCII), 120)
    assert lines[2].split() == ["mission_camera", "16", "-", *CAMERA.reason.split()]
