"""Tones: what warns how."""

from __future__ import annotations

import pytest

from amaze_autonomy.console.model import Verdict
from amaze_autonomy.console.screen.style import (
    ASCII,
    UNICODE,
    Tone,
    tone_of_answer,
    tone_of_check,
    tone_of_code,
    tone_of_level,
    tone_of_state,
)
from amaze_autonomy.engine.events import Verdict as CheckVerdict
from amaze_autonomy.engine.state import State


def test_tones_of_the_states():
    tones = {state.value: tone_of_state(state.value, "").value for state in State}
    assert tones == {
        "MISSION_INPUT": "info",
        "PREFLIGHT": "info",
        "OUTREACH": "warn",
        "READY": "good",
        "START_RECORDING": "info",
        "LOAD_MISSION": "info",
        "TAKEOFF": "good",
        "MISSION": "good",
        "HOLD": "warn",
        "LAND": "bad",
        "PILOT": "pilot",
        "DATA_CLEANUP": "info",
        "MISSION_ENDED": "warn",
    }


@pytest.mark.parametrize(
    "result, tone",
    [
        ("COMPLETE", Tone.GOOD),
        ("LANDED_EARLY", Tone.WARN),
        ("PILOT", Tone.WARN),
        ("NOT_FLOWN", Tone.WARN),
        ("surprise", Tone.WARN),
    ],
)
def test_tones_of_the_results(result, tone):
    assert tone_of_state("MISSION_ENDED", result) is tone


def test_incomplete_data_is_bad_however_the_mission_ended():
    assert tone_of_state("MISSION_ENDED", "COMPLETE", "INCOMPLETE") is Tone.BAD
    assert tone_of_state("MISSION_ENDED", "COMPLETE", "COMPLETE") is Tone.GOOD


@pytest.mark.parametrize(
    "code, action, tone",
    [
        (2, "continue", Tone.INFO),
        (4, "continue", Tone.WARN),
        (4, "wait", Tone.WARN),
        (8, "wait", Tone.WARN),
        (8, "land", Tone.BAD),
        (16, "land", Tone.BAD),
        (0, "land", Tone.BAD),
        (0, "wait", Tone.WARN),
        (0, "pilot", Tone.PILOT),
    ],
)
def test_tones_of_failures(code, action, tone):
    assert tone_of_code(code, action) is tone


def test_tones_of_levels_checks_and_answers():
    assert [tone_of_level(level) for level in (0, 1, 2, 3)] == [Tone.INFO, Tone.WARN, Tone.BAD, Tone.BAD]
    assert [tone_of_check(verdict) for verdict in CheckVerdict] == [Tone.GOOD, Tone.WARN, Tone.BAD, Tone.BAD]
    assert [tone_of_answer(verdict) for verdict in Verdict] == [Tone.GOOD, Tone.BAD, Tone.INFO, Tone.BAD]


def test_bars_never_leave_their_width():
    assert [ASCII.bar(value, 4) for value in (-1.0, 0.0, 0.5, 1.0, 9.0)] == ["....", "....", "##..", "####", "####"]
    assert UNICODE.bar(0.5, 4) == "██░░"
