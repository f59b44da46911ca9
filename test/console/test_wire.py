"""Messages become clean values; nonsense becomes unknown, never an exception."""

from __future__ import annotations

import time
from math import inf, nan
from types import SimpleNamespace

import pytest

from amaze_autonomy.console.model import (
    Collecting,
    MissionRow,
    Note,
    PendingFailure,
    Platform,
    Snapshot,
    Telemetry,
    Verdict,
)
from amaze_autonomy.console.wire import collecting_of, missions_of, notes_of, snapshot_of, verdict_of
from amaze_autonomy.engine.events import Check
from amaze_autonomy.engine.events import Verdict as CheckVerdict

FAILURE = SimpleNamespace(
    name="lrf", code=8, action="wait", fallback="land", time_left=12.5, limit="restart limit", cause="", reason="silent"
)


def state_message(**changes):
    fields = {
        "state": "HOLD",
        "step": "holding",
        "session_id": "s-1",
        "mission_id": "1",
        "mission_description": "Square",
        "file_index": 1,
        "files": 2,
        "repetition": 0,
        "repetitions": 3,
        "in_flight": True,
        "checks": [
            SimpleNamespace(name="tilt", verdict=3, value=0.3, limit=0.17, unit="rad", age=0.1, advice="Level it."),
            SimpleNamespace(name="gps", verdict=9, value=nan, limit=inf, unit="", age=nan, advice=""),
        ],
        "failures": [FAILURE],
        "waiting_for": "lrf",
        "time_left": 12.5,
        "message": "Holding",
        "message_level": 1,
        "advice": "Wait.",
        "user_commands": ["land", "abort"],
        "waypoint": 3,
        "waypoints": 8,
        "recording_phase": "RECORDING",
        "recording_progress": nan,
        "data_location": "",
        "result": "",
    }
    return SimpleNamespace(**{**fields, **changes})


def test_a_state_message_becomes_a_snapshot():
    assert snapshot_of(state_message()) == Snapshot(
        state="HOLD",
        step="holding",
        session_id="s-1",
        mission_id="1",
        mission_description="Square",
        file_index=1,
        files=2,
        repetition=0,
        repetitions=3,
        in_flight=True,
        checks=(
            Check("tilt", CheckVerdict.FAIL, 0.3, 0.17, "rad", 0.1, "Level it."),
            Check("gps", CheckVerdict.UNKNOWN, None, None, "", None, ""),
        ),
        failures=(PendingFailure("lrf", 8, "wait", "land", 12.5, "restart limit", "", "silent"),),
        waiting_for="lrf",
        time_left_s=12.5,
        message="Holding",
        message_level=1,
        advice="Wait.",
        user_commands=("land", "abort"),
        waypoint=3,
        waypoints=8,
        recording_phase="RECORDING",
        recording_progress=None,
        data_location="",
        result="",
    )


def test_a_message_without_any_field_is_unknown_and_counts_as_in_flight():
    assert snapshot_of(object()) == Snapshot(state="", in_flight=True)


def test_fields_of_the_wrong_type_are_unknown():
    nonsense = snapshot_of(state_message(state=7, time_left="soon", files=None, message=b"bytes", checks=[None]))
    expected = Snapshot(
        **{
            **vars(snapshot_of(state_message())),
            "state": "",
            "time_left_s": None,
            "files": 0,
            "message": "",
            "checks": (Check("", CheckVerdict.UNKNOWN),),
        }
    )
    assert nonsense == expected


def test_every_text_is_cleaned():
    evil = "\x1b[2Jx\x07"
    snapshot = snapshot_of(
        state_message(
            state=evil,
            step=evil,
            message=evil,
            advice=evil,
            user_commands=[evil],
            checks=[SimpleNamespace(name=evil, unit=evil, advice=evil)],
            failures=[SimpleNamespace(name=evil, action=evil, fallback=evil, reason=evil)],
            data_location=evil,
            result=evil,
            mission_id=evil,
            mission_description=evil,
            waiting_for=evil,
            recording_phase=evil,
            session_id=evil,
        )
    )
    assert "\x1b" not in repr(snapshot).encode("ascii", "backslashreplace").decode("unicode_escape")
    assert (snapshot.message, snapshot.checks[0].name, snapshot.failures[0].reason) == ("x?", "x?", "x?")


def test_a_flood_of_rows_is_bounded():
    assert len(snapshot_of(state_message(failures=[SimpleNamespace(name="f")] * 100_000)).failures) == 200


def test_missions():
    row = SimpleNamespace(
        id="1", description="Square", files=1, repetitions=2, estimated_duration=nan, battery_needed=0.4, error=""
    )
    assert missions_of(SimpleNamespace(missions=[row])) == (MissionRow("1", "Square", 1, 2, None, 0.4, ""),)


@pytest.mark.parametrize(
    "number, verdict",
    [(1, Verdict.DONE), (2, Verdict.REFUSED), (3, Verdict.ALREADY), (0, Verdict.NO_ANSWER), (None, Verdict.NO_ANSWER)],
)
def test_answers(number, verdict):
    assert verdict_of(number) is verdict


@pytest.mark.parametrize(
    "message, collecting",
    [
        (SimpleNamespace(session_id="s-1", phase=6, remaining=7.5), Collecting("s-1", "MERGING", 7.5)),
        (SimpleNamespace(session_id="s-1", phase=2, remaining=nan), Collecting("s-1", "RECORDING", None)),
        (SimpleNamespace(session_id=1, phase=99, remaining=-1.0), Collecting("", "", None)),
        (object(), Collecting("", "IDLE", None)),
        (
            SimpleNamespace(
                session_id="s-1",
                phase=5,
                platforms=[
                    SimpleNamespace(platform="main", message=""),
                    SimpleNamespace(platform="second", message="does not answer"),
                ],
            ),
            Collecting(
                "s-1", "TRANSFERRING", platforms=(Platform("main"), Platform("second", message="does not answer"))
            ),
        ),
    ],
)
def test_a_recorder_status_becomes_what_it_says_of_its_phase(message, collecting):
    assert collecting_of(message) == collecting


def test_a_platform_that_names_itself_is_named_once():
    platforms = (Platform("main", message="main: the disk is full"), Platform("second", message="does not answer"))
    assert Collecting(platforms=platforms).troubles == ("main: the disk is full", "second: does not answer")


def test_the_last_messages_become_notes_with_their_time_and_number():
    stamp = SimpleNamespace(secs=1_795_000_000, nsecs=0)
    rows = [
        SimpleNamespace(number=n, stamp=stamp, level=1, text=f"no. {n}\x1b[2J", advice="", key="ready")
        for n in range(1, 301)
    ]
    run, notes = notes_of(SimpleNamespace(run="r-1", messages=rows))
    clock = time.strftime("%H:%M:%S", time.localtime(1_795_000_000))
    assert (run, len(notes), notes[-1]) == ("r-1", 200, Note(clock, 1, "no. 300", "", 300, "ready"))


def test_what_the_vehicle_says_of_itself_with_nan_as_unknown():
    said = SimpleNamespace(age=0.1, mode="AUTO\x07", armed=True, battery_fraction=nan, altitude=3.5)
    expected = Telemetry(age=0.1, mode="AUTO?", armed=True, landed="", battery_fraction=None, altitude=3.5)
    assert snapshot_of(state_message(telemetry=said)).telemetry == expected
