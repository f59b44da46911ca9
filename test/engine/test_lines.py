"""Forms of lines: they write what the JSON encoder writes, and leave to it what they do not know."""

from __future__ import annotations

from enum import IntEnum
from math import inf, nan

import pytest

from amaze_autonomy.engine import events, journal
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.lines import form_of
from amaze_autonomy.engine.severity import Code


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


def test_an_unknown_number_is_null_and_a_text_is_ascii():
    write = form_of(events.PlatformRecording)
    status = events.PlatformRecording('a "b" \u00fc\n', growing=True, written_bytes=2**70, free_fraction=0.1)
    status.__dict__.update(byte_rate=nan)
    assert write(status) == (
        '{"byte_rate":null,"free_fraction":0.1,"growing":true,"location":"","message":"",'
        '"platform":"a \\"b\\" \\u00fc\\n","written_bytes":1180591620717411303424}'
    )
    status.__dict__.update(byte_rate=-inf, free_fraction=-0.0)
    assert '"byte_rate":null,"free_fraction":-0.0,' in write(status)


def test_a_class_that_may_hold_anything_has_no_form():
    assert form_of(Decision) is None
    assert form_of(events.MissionSelected) is None
    assert form_of(events.Tick, (("kind", "event"),))(events.Tick(t_ns=5)) == '{"kind":"event","t_ns":5}'
