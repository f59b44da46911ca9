"""Forms of lines: they write what the JSON encoder writes, and leave to it what they do not know."""

from __future__ import annotations

from enum import IntEnum
from math import inf, isfinite, nan

import pytest

from amaze_autonomy.engine import events
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.journal import journal
from amaze_autonomy.journal.codec import form_of


class Whole(int):
    """A number of another type."""


class Number(IntEnum):
    """One more."""

    SEVEN = 7


def told(*names):
    components = tuple(events.ComponentStatus(name, Code.HOLD) for name in names)
    return events.WatchdogInfo(t_ns=1, sequence=2, changed=(), components=components)


STRANGE = (
    events.WatchdogAction(t_ns=Whole(3), sequence=Number.SEVEN, loop_counter=1, code=Code.HOLD),
    events.WatchdogInfo(t_ns=1, sequence=2, changed=["a", "b"], components=[]),
    events.Reply(t_ns=1, command_id=2, outcome=events.MissionPhase.IDLE),
    events.Reply(t_ns=1, command_id="two", outcome=events.Outcome.ACCEPTED, message=None),
)


@pytest.mark.parametrize("event", STRANGE, ids=lambda event: type(event).__name__)
def test_what_is_of_another_type_than_annotated_is_written_as_ever(event):
    assert journal.encode_event(event) == journal._encode_event(event)


def test_a_list_that_was_written_last_is_known_by_itself_not_by_its_value():
    first, second = told("imu", "gps"), told("imu", "lrf")
    lines = [journal.encode_event(event) for event in (first, first, second, told(), first)]
    assert lines == [journal._encode_event(event) for event in (first, first, second, told(), first)]


@pytest.mark.parametrize("value", [nan, inf, -inf, -0.0, 1e-320, 1e22, 5])
def test_a_number_that_is_none_is_null_also_where_it_slipped_in(value):
    status = events.PlatformRecording("module1", growing=True, free_fraction=0.1, cpu_fraction=0.5, clock_age_s=0.0)
    told = events.RecordingStatus(t_ns=1, session_id="", phase=events.RecordingPhase.IDLE, platforms=(status,))
    status.__dict__.update(byte_rate=value)
    told.__dict__.update(progress=value)
    line = journal.encode_event(told)
    assert line == journal._encode_event(told)
    assert line.count("null") == (0 if isfinite(value) else 2)


def test_a_text_is_ascii_and_may_have_the_name_of_a_number():
    status = events.LandedStatus(t_ns=2**70, landed=events.Landed.AIRBORNE, distance_m=0.5, reason='nan "\u00fc"\n inf')
    assert journal.encode_event(status) == (
        '{"age_ns":0,"distance_m":0.5,"event":"LandedStatus","kind":"event","landed":"AIRBORNE",'
        '"reason":"nan \\"\\u00fc\\"\\n inf","t_ns":1180591620717411303424}'
    )


def test_a_class_that_may_hold_anything_has_no_form():
    assert form_of(Decision) is None
    assert form_of(events.MissionSelected) is None
    assert form_of(events.Tick, (("kind", "event"),))(events.Tick(t_ns=5)) == '{"away_ns":0,"kind":"event","t_ns":5}'
