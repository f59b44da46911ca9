"""The journal: what is written is what is read, the same bytes everywhere, and damage is named."""

from __future__ import annotations

import enum
import json
import typing
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from math import inf, nan

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from amaze_autonomy.engine import events
from amaze_autonomy.engine.commands import Decision, Value
from amaze_autonomy.engine.events import Check, CheckName, Mission, Verdict
from amaze_autonomy.engine.rules import Code, ComponentRule, Limits, Restart, Rules, Severity
from amaze_autonomy.interface import STATUSES
from amaze_autonomy.journal import journal

CHECKS = ("watchdog", "battery", "autopilot", "on_ground", "state_estimation")
EVENT_CLASSES = [
    value
    for name, value in sorted(vars(events).items())
    if isinstance(value, type) and issubclass(value, events.Event) and value is not events.Event
]

NUMBERS = st.floats(allow_nan=True, allow_infinity=True) | st.integers(-(10**6), 10**6)
FINITE = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(10**6), 10**6)
ANYTHING = st.none() | st.booleans() | st.integers() | FINITE | st.text(max_size=8)
SPECIAL = {
    (events.ClockStatus, "stalled_s"): st.floats(0.0, 1e6),
    (Mission, "id"): st.text(min_size=1, max_size=8),
    (Mission, "files"): st.integers(1, 9),
    (Mission, "repetitions"): st.integers(1, 9),
    (Mission, "battery_needed_fraction"): st.none() | st.floats(0.0, 1.0),
    (Mission, "estimated_duration_s"): st.none() | FINITE,
    (Mission, "max_height_m"): st.none() | FINITE,
    (Mission, "max_distance_m"): st.none() | FINITE,
}


def values_of(hint):
    """Return a strategy for an annotation, written apart from the codec that it tests."""
    if hint is object:
        return ANYTHING | st.tuples(ANYTHING, ANYTHING)
    simple = {bool: st.booleans(), int: st.integers(0, 2**63), float: FINITE, str: st.text(max_size=12)}
    if hint in simple:
        return simple[hint]
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return st.sampled_from(hint)
    if is_dataclass(hint):
        return instances_of(hint)
    arguments = hint.__args__
    if type(None) in arguments:
        inner = NUMBERS if float in arguments else values_of(next(a for a in arguments if a is not type(None)))
        return st.none() | inner
    if arguments[-1] is ...:
        return st.lists(values_of(arguments[0]), max_size=3).map(tuple)
    return st.tuples(*[values_of(argument) for argument in arguments])


def instances_of(kind):
    hints = typing.get_type_hints(kind)
    strategies = {
        f.name: SPECIAL[kind, f.name] if (kind, f.name) in SPECIAL else values_of(hints[f.name]) for f in fields(kind)
    }
    if kind is events.MissionSelected:
        strategies["missions"] = st.lists(instances_of(Mission), min_size=1, max_size=2).map(tuple)
    return st.builds(kind, **strategies)


def test_every_event_class_is_known_to_the_journal():
    assert len(EVENT_CLASSES) == 15
    assert sorted(kind.__name__ for kind in EVENT_CLASSES) == sorted(journal._EVENTS)


@pytest.mark.parametrize("kind", EVENT_CLASSES, ids=lambda kind: kind.__name__)
def test_every_event_is_read_as_it_was_written(kind):
    @settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(instances_of(kind))
    def check(event):
        line = journal.encode_event(event)
        assert journal.decode(line, 7) == journal.JournalLine("event", event, 7)
        assert journal.encode_event(journal.decode(line).payload) == line
        assert line == json.dumps(json.loads(line), sort_keys=True, separators=(",", ":"))
        assert line == journal._encode_event(event), "the form of its class says what the encoder says"

    check()


def named_as_today(decision):
    """Names of before are read as those of today; nothing is written under them."""
    return not {decision.rule, *(value.name for value in decision.values)} & set(journal._RENAMED)


@settings(max_examples=100, deadline=None)
@given(instances_of(Decision).filter(named_as_today))
def test_every_decision_is_read_as_it_was_written(decision):
    line = journal.encode_decision(decision)
    assert journal.decode(line, 3) == journal.JournalLine("decision", decision, 3)
    assert journal.encode_decision(journal.decode(line).payload) == line


def test_a_line_is_canonical_text_down_to_the_byte():
    event = events.WatchdogAction(
        t_ns=12,
        sequence=3,
        loop_counter=4,
        code=Code.HOLD,
        latest_component="lrf",
        components=(
            events.ComponentStatus("lrf", Code.HOLD, Restart.TRYING, 99, "no message for 0.31 s, limit 0.15 s"),
        ),
    )
    assert journal.encode_event(event) == (
        '{"age_ns":0,"code":"HOLD","components":[{"code":"HOLD","name":"lrf","reason":"no message for 0.31 s, '
        'limit 0.15 s","restart":"TRYING","until_ns":99}],"event":"WatchdogAction","kind":"event",'
        '"latest_component":"lrf","loop_counter":4,"publisher":"","sequence":3,"t_ns":12}'
    )


def test_a_mission_keeps_its_own_severities():
    mission = Mission(id="2", severities=(("gps", Severity.HIGHEST), ("lrf", Severity.LOW)), required=("imu",))
    event = events.MissionSelected(t_ns=0, missions=(mission,))
    assert journal.decode(journal.encode_event(event)).payload == event


DECISION = Decision(t_ns=1, sequence=0, event="Tick", before="READY", after="READY", step="", rule="none")


def test_what_is_not_finite_is_unknown_or_said_in_words():
    check = Check("battery fraction", Verdict.UNKNOWN, value=nan, limit=inf)
    reply = events.CheckReply(
        t_ns=1, command_id=1, check=CheckName.BATTERY, outcome=events.Outcome.ACCEPTED, checks=(check,)
    )
    assert journal.decode(journal.encode_event(reply)).payload.checks[0].value is None
    values = (Value("age", inf, nan, "s"), Value("code", Code.HOLD), Value("names", ("a", "b")))
    decision = replace(DECISION, values=values)
    read = journal.decode(journal.encode_decision(decision)).payload
    assert read.values == (Value("age", "inf", "nan", "s"), Value("code", "HOLD"), Value("names", ("a", "b")))


def test_the_header_carries_the_rules_to_decide_with():
    rules = Rules(
        components=(ComponentRule("lrf", "other", True, Severity.HIGH, 15_000_000_000),),
        limits=Limits(max_height_m=12.5),
        require_go=True,
    )
    header = journal.make_header(rules, {"limits": {"max_height_m": 12.5}}, "abc", program="a test")
    line = journal.decode(journal.encode_header(header))
    assert (line.kind, line.payload["hash"], line.payload["program"]) == ("header", "abc", "a test")
    assert journal.rules_of(line) == replace(rules, checks=tuple(check.value for check in CheckName))


def test_a_journal_is_decided_again_with_the_checks_that_there_were_when_it_was_written():
    """A check that comes later would be asked, never answered, and shift the number of every command."""
    header = journal.make_header(replace(Rules(), checks=CHECKS[:4]), {}, "abc")
    line = journal.decode(journal.encode_header(header))
    assert journal.rules_of(line).checks == CHECKS[:4]
    assert journal.rules_of(line, Rules(require_go=True)) == Rules(require_go=True, checks=CHECKS[:4])
    del header["rules"]["checks"]
    assert journal.rules_of(journal.decode(journal.encode_header(header))).checks == CHECKS


def test_a_journal_with_a_check_that_there_is_no_more_is_refused_unless_rules_are_given():
    header = journal.make_header(Rules(), {}, "abc")
    header["rules"]["checks"] = ["watchdog", "propellers"]
    line = journal.decode(journal.encode_header(header))
    with pytest.raises(journal.JournalError, match=r"rules\.checks: there is no check propellers .*another version"):
        journal.rules_of(line)
    assert journal.rules_of(line, Rules(require_go=True)) == Rules(require_go=True)


@pytest.mark.parametrize("unwritable", [object(), float("nan")])
def test_a_header_that_json_cannot_hold_is_refused(unwritable):
    with pytest.raises(journal.JournalError, match="the header cannot be written"):
        journal.encode_header({"about": unwritable})


def test_a_header_whose_rules_cannot_be_is_refused_with_its_line():
    header = journal.make_header(Rules(), {}, "abc", program="a test")
    header["rules"]["require_go"] = "perhaps"
    line = replace(journal.decode(journal.encode_header(header)), line_number=7)
    with pytest.raises(journal.JournalError, match=r"line 7: rules\.require_go: .*\(written by another version\)"):
        journal.rules_of(line)
    for other in (replace(line, kind="event"), replace(line, payload=[]), replace(line, payload={})):
        with pytest.raises(journal.JournalError, match=r"line 7: no rules here"):
            journal.rules_of(other)


def test_a_decision_of_before_has_the_names_of_today():
    decision = replace(DECISION, rule="ready_revoked", values=(Value("action", "wait"),))
    written = journal.encode_decision(decision).replace("ready_revoked", "ready_taken_back").replace("action", "verb")
    assert '"verb"' in written
    assert journal.decode(written).payload == decision


def test_fields_that_an_older_journal_lacks_take_their_defaults():
    line = '{"event":"UserRequest","kind":"event","command":"GO","t_ns":5}'
    assert journal.decode(line).payload == events.UserRequest(t_ns=5, command=events.UserCommand.GO)


GOOD_HEADER = '{"kind":"header","version":1}'
GOOD_TICK = '{"event":"Tick","kind":"event","t_ns":5}'


@pytest.mark.parametrize(
    "line,message",
    [
        (
            '{"kind":"even',
            "line 4: not JSON: Unterminated string starting at: line 1 column 9 (char 8) (truncated or damaged)",
        ),
        ("[1]", "line 4: is list, must be an object"),
        ('{"kind":"noise"}', "line 4: kind is 'noise' (must be header, event or decision)"),
        ('{"kind":"header","version":9}', "line 4: version is 9 (this program reads version 1)"),
        (
            '{"event":"Tick","kind":"event"}',
            "line 4: t_ns: is missing, Tick needs it (written by another version, or damaged)",
        ),
        (
            '{"event":"Tick","kind":"event","t_ns":5,"who":1}',
            "line 4: who: Tick has no such field (written by another version, or damaged)",
        ),
        (
            '{"event":"Tick","kind":"event","t_ns":-5}',
            "line 4: Tick.t_ns is -5, must be a whole number of nanoseconds, not negative "
            "(written by another version, or damaged)",
        ),
        (
            '{"event":"Tick","kind":"event","t_ns":true}',
            "line 4: t_ns: is True, must be a whole number (written by another version, or damaged)",
        ),
        (
            '{"command":"FLY","event":"UserRequest","kind":"event","t_ns":5}',
            "line 4: command: is 'FLY', must be one of GO, RETRY, GIVE_UP, HOLD, RESUME, LAND, ABORT, ACKNOWLEDGE "
            "(written by another version, or damaged)",
        ),
        (
            '{"event":"WatchdogInfo","kind":"event","t_ns":5,"sequence":1,"changed":[],"components":[{"name":"lrf"}]}',
            "line 4: components[0].code: is missing, ComponentStatus needs it (written by another version, or damaged)",
        ),
        ('{"kind":"event","kind":"event"}', "line 4: not JSON: kind stands there twice (truncated or damaged)"),
        (
            '{"event":"Tick","kind":"event","t_ns":NaN}',
            "line 4: not JSON: NaN is no number (truncated or damaged)",
        ),
    ],
)
def test_a_damaged_line_is_refused_with_its_number_and_what_is_wrong(line, message):
    with pytest.raises(journal.JournalError) as caught:
        journal.decode(line, 4)
    assert (str(caught.value), caught.value.line_number) == (message, 4)


def test_an_unknown_event_class_is_refused_with_the_known_ones():
    with pytest.raises(journal.JournalError, match="event: is 'Explosion', must be one of AutopilotStatus, CheckReply"):
        journal.decode('{"event":"Explosion","kind":"event","t_ns":5}')


def test_what_is_no_event_is_not_written():
    with pytest.raises(journal.JournalError, match="Event is no event of the engine"):
        journal.encode_event(events.Event(t_ns=1))
    with pytest.raises(journal.JournalError, match="Reply cannot be written"):
        journal.encode_event(events.Reply(t_ns=1, command_id=2, outcome="accepted"))


def test_a_last_line_that_a_crash_cut_off_is_left_out_and_said():
    text = f"{GOOD_HEADER}\n{GOOD_TICK}\n{GOOD_TICK[:20]}"
    whole = journal.read(text)
    assert [line.kind for line in whole.lines] == ["header", "event"]
    assert whole.truncated
    assert text.encode()[: journal.whole_lines(text.encode())].decode() == f"{GOOD_HEADER}\n{GOOD_TICK}\n"


def test_a_whole_journal_is_not_called_truncated():
    assert not journal.read(f"{GOOD_HEADER}\n{GOOD_TICK}\n").truncated
    assert not journal.read(f"{GOOD_HEADER}\n{GOOD_TICK}").truncated


def test_a_damaged_line_in_the_middle_is_not_tolerated():
    with pytest.raises(journal.JournalError, match="line 2: not JSON"):
        journal.read(f"{GOOD_HEADER}\n{GOOD_TICK[:20]}\n{GOOD_TICK}\n")


def test_a_journal_without_lines_or_header_is_refused():
    with pytest.raises(journal.JournalError, match="the journal is empty"):
        journal.read("")
    with pytest.raises(journal.JournalError, match="line 1: the first line is no header"):
        journal.read(f"{GOOD_TICK}\n")


# --- delta lines ------------------------------------------------------------------------------------------------------

STATUS_CLASSES = [kind for kind in EVENT_CLASSES if kind.__name__ in journal.DELTA_LETTERS.values()]


def delta_lines(some):
    encoder = journal.DeltaEncoder()
    return [encoder.encode(event) for event in some]


def full_lines(lines):
    decoder = journal.DeltaDecoder()
    return [decoder.full(line) for line in lines]


def test_what_comes_all_the_time_has_a_letter():
    assert {status.event.__name__ for status in STATUSES} == set(journal.DELTA_LETTERS.values())


@st.composite
def streams(draw):
    """Return events as a flight has them: often with some of the fields of the last of its kind."""
    last, stream = {}, []
    for _ in range(draw(st.integers(1, 12))):
        kind = draw(st.sampled_from(STATUS_CLASSES) | st.sampled_from(EVENT_CLASSES))
        event = draw(instances_of(kind))
        if kind in last and draw(st.booleans()):
            kept = draw(st.sets(st.sampled_from([field.name for field in fields(kind)])))
            with suppress(ValueError):  # of two that do not go together
                event = replace(last[kind], **{name: getattr(event, name) for name in kept})
        last[kind] = event
        stream.append(event)
    return stream


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much])
@given(streams())
def test_full_lines_are_made_of_delta_lines_to_the_byte(stream):
    assert full_lines(delta_lines(stream)) == [journal.encode_event(event) for event in stream]


def heartbeat(number, code=Code.NOMINAL):
    t_ns, sequence, loops = 10**12 + 200_000_000 * number, 100 + number, 1000 + 10 * number
    return events.WatchdogAction(t_ns=t_ns, sequence=sequence, loop_counter=loops, code=code)


def test_a_delta_line_says_which_numbers_are_others():
    lines = delta_lines([heartbeat(0), heartbeat(1), heartbeat(2, Code.HOLD), heartbeat(3)])
    assert lines[1] == '{"W":"12+10 4+1 2+200000000 49a4"}'
    assert lines[2] == journal.encode_event(heartbeat(2, Code.HOLD)), "what changes in words stands in full"
    assert lines[3] == journal.encode_event(heartbeat(3))


def test_a_number_of_single_precision_takes_no_more_digits_than_it_has():
    metres = (1.0, 4.984846115112305, 0.1, 1e300, None)
    heights = [events.LandedStatus(t_ns=1, landed=events.Landed.AIRBORNE, distance_m=each) for each in metres]
    lines = delta_lines(heights)
    assert [line[6:-7] for line in lines[1:]] == ["3~4.984846", "3=0.1", "3=1e+300", "3=null"]
    assert full_lines(lines) == list(map(journal.encode_event, heights))


def test_a_status_stands_in_full_now_and_then():
    lines = delta_lines(map(heartbeat, range(1000)))
    assert [number for number, line in enumerate(lines) if '"kind"' in line] == [0, 301, 602, 903]


@pytest.mark.parametrize("damage", ["missing", "another", "edited"])
def test_a_delta_line_that_rests_on_another_line_is_refused(damage):
    lines = [GOOD_HEADER, *delta_lines(map(heartbeat, range(5)))]
    if damage == "missing":
        del lines[3]
    elif damage == "another":
        lines[1] = journal.encode_event(heartbeat(7))
    else:
        lines[3] = lines[3].replace("+10", "+20")
    with pytest.raises(journal.JournalError, match=r"line \d: says what differs from a line that is not there \(a gap"):
        journal.read("".join(f"{line}\n" for line in lines))
    with pytest.raises(journal.JournalError, match="a delta line, which says nothing alone"):
        journal.decode(lines[-1])


def test_a_delta_line_at_the_end_may_be_cut_off():
    lines = [GOOD_HEADER, *delta_lines(map(heartbeat, range(3)))]
    text = "".join(f"{line}\n" for line in lines)[:-3]
    found = journal.read(text)
    assert (len(found.lines), found.truncated) == (3, True)


def test_behind_a_gap_that_is_known_full_lines_are_written():
    encoder = journal.DeltaEncoder()
    encoder.encode(heartbeat(1))
    encoder.forget()
    assert encoder.encode(heartbeat(2)) == journal.encode_event(heartbeat(2))
