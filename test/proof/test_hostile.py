"""Hostile values wherever something is read: every field of every message, journals, scenarios. Never an exception.

The fields come from the .msg and .srv files themselves, so that a new one is tried as soon as it is there. What is read
goes on into `decide`, in every phase of a mission, under all laws.
"""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Dict, List, Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from proof_moves import BOOT, Node, perform
from proof_worlds import SEEDS, WORLDS

from amaze_autonomy.config import ConfigError
from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine.events import CheckName
from amaze_autonomy.interface import CHECK_SERVICES, STATUSES, InvalidMessageError
from amaze_autonomy.journal import journal
from amaze_autonomy.journal.report import report
from amaze_autonomy.laws import judge, observed
from amaze_autonomy.simulation.scenario_file import parse_scenario
from amaze_autonomy.tester.scenario.files import parse_cases

ROOT = Path(__file__).parents[2]
RULES = WORLDS["start"].rules
FLOATS = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, 9.0, 1e-300, 1e300, -1e300, 1e18, math.nan, math.inf, -math.inf])
TEXTS = st.sampled_from(
    ["", "lrf", "imu", "gps", "AUTO.LAND", "POSCTL", "x" * 5000, "\0", "\ud800", "{reason}", "%s", "é"]
)
SECONDS = st.sampled_from([0, 1, 4, 5, 6, 2**31, 2**32 - 1])


def integers(bits: int, *, signed: bool) -> Any:
    least, most = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    return st.sampled_from(
        [value for value in (least, -1, 0, 1, 2, 3, 4, 8, 16, 5, 255, most) if least <= value <= most]
    )


SCALARS: Dict[str, Any] = {
    "bool": st.booleans(),
    "string": TEXTS,
    "geometry_msgs/Vector3": st.builds(SimpleNamespace, x=FLOATS, y=FLOATS, z=FLOATS),
    "float32": FLOATS,
    "float64": FLOATS,
    "time": st.builds(SimpleNamespace, secs=SECONDS, nsecs=st.sampled_from([0, 1, 10**9 - 1, 2**32 - 1])),
    "duration": st.builds(SimpleNamespace, secs=SECONDS, nsecs=st.just(0)),
    **{f"uint{bits}": integers(bits, signed=False) for bits in (8, 16, 32, 64)},
    **{f"int{bits}": integers(bits, signed=True) for bits in (8, 16, 32, 64)},
}


def fields(text: str) -> List[Tuple[str, str]]:
    """Return (type, name) of each field of a message; constants are none."""
    lines = [line.split("#")[0].strip() for line in text.splitlines()]
    return [(line.split()[0], line.split()[1]) for line in lines if line and "=" not in line and line != "---"]


def message(text: str) -> Any:
    return st.builds(SimpleNamespace, **{name: values(kind) for kind, name in fields(text)})


def values(kind: str) -> Any:
    if kind.endswith("[]"):
        return st.lists(values(kind[:-2]), max_size=3)
    if kind in SCALARS:
        return SCALARS[kind]
    if kind in ("Header", "std_msgs/Header"):
        return st.builds(SimpleNamespace, seq=st.just(0), stamp=SCALARS["time"], frame_id=TEXTS)
    return message((ROOT / "msg" / f"{kind.rpartition('/')[2]}.msg").read_text())


READERS = {status.shape.message: status for status in STATUSES}
ANSWERS = {
    "StartWatchdog": CheckName.WATCHDOG,
    "CheckBattery": CheckName.BATTERY,
    "CheckAutopilot": CheckName.AUTOPILOT,
    "CheckLanded": CheckName.ON_GROUND,
    "CheckState": CheckName.STATE_ESTIMATION,
}
PLACES: Dict[str, Node] = {}


def at(place: str) -> Node:
    if place not in PLACES:
        node = BOOT
        for move in SEEDS[place]:
            node = perform(node, move, RULES)
        PLACES[place] = node
    return PLACES[place]


def goes_on(place: str, *events: Any) -> None:
    """Give events to the engine at a place, under all laws."""
    state, _, witness, _ = at(place)
    observe = judge({})
    for event in events:
        after, commands = engine.decide(state, event, RULES)
        moment = observed(witness, state, event, commands, after, RULES)
        observe(moment)
        report(after, RULES)
        journal.decode(journal.encode_event(event))
        state, witness = after, moment.seen


@pytest.mark.parametrize("name", READERS)
def test_every_field_of_a_message_may_be_anything(name):  # hollow: a broken law is raised
    @settings(max_examples=300)
    @given(
        place=st.sampled_from(sorted(SEEDS)),
        said=st.lists(message((ROOT / "msg" / f"{name}.msg").read_text()), min_size=1, max_size=3),
        ours=st.booleans(),
    )
    def check(place, said, ours):
        state = at(place).state
        events = []
        for each in said:
            if ours and hasattr(each, "session_id"):
                each.session_id = state.session.id
            if ours:
                each.header.stamp = SimpleNamespace(secs=5, nsecs=0)
            try:
                age_ns = 5 * 10**9 - each.header.stamp.secs * 10**9 - each.header.stamp.nsecs
                events.append(READERS[name].read(each, state.t_ns, age_ns))
            except InvalidMessageError:
                continue
        goes_on(place, *events)

    check()


@pytest.mark.parametrize("name", ANSWERS)
def test_every_field_of_an_answer_may_be_anything(name):  # hollow: a broken law is raised
    reply = (ROOT / "srv" / f"{name}.srv").read_text().partition("\n---\n")[2]

    @settings(max_examples=200)
    @given(place=st.sampled_from(["selected", "loading", "touchdown"]), said=message(reply))
    def check(place, said):
        state = at(place).state
        current = next(record.command_id for record in state.preflight.checks if record.check is ANSWERS[name])
        try:
            event = CHECK_SERVICES[ANSWERS[name]].reply(said, current, state.t_ns)
        except InvalidMessageError:
            return
        goes_on(place, event)

    check()


PIECES = st.sampled_from(["", "nan", ".inf", "-1", "1e999", "[", "{", "&a *a", "null", "\t", "x: y", "'"]) | st.text(
    max_size=8
)
SCENARIO = (ROOT / "test" / "proof" / "hostile_scenario.yaml").read_text()


@settings(max_examples=300)
@given(data=st.data())
def test_any_scenario_is_read_or_is_one_mistake(data):
    begin = data.draw(st.integers(0, len(SCENARIO)))
    end = data.draw(st.integers(begin, min(len(SCENARIO), begin + 40)))
    mistake = ""
    try:
        parse_scenario(SCENARIO[:begin] + data.draw(PIECES) + SCENARIO[end:])
    except ConfigError as error:
        mistake = str(error)
    assert mistake == "" or mistake.isprintable()


def test_the_scenario_that_is_broken_here_is_a_good_one():
    assert len(parse_scenario(SCENARIO).faults) == 3


TESTS = {path.name: path for path in (ROOT / "test" / "scenarios").glob("*.scenario.yaml")}


@settings(max_examples=300)
@given(data=st.data())
def test_any_scenario_of_the_tester_is_read_or_is_one_mistake(data):
    path = TESTS[data.draw(st.sampled_from(sorted(TESTS)))]
    text = path.read_text()
    begin = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(begin, min(len(text), begin + 40)))
    mistake = ""
    try:
        parse_cases(text[:begin] + data.draw(PIECES) + text[end:], path)
    except ConfigError as error:
        mistake = str(error)
    assert mistake == "" or mistake.isprintable()


@settings(max_examples=300)
@given(data=st.data())
def test_any_journal_is_read_or_is_one_mistake(data):  # hollow: whatever else is raised fails it
    path = data.draw(st.sampled_from(sorted((ROOT / "test" / "proof" / "found").glob("*.jsonl"))))
    text = path.read_text()
    begin = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(begin, min(len(text), begin + 60)))
    piece = data.draw(
        st.sampled_from(["", "\n", "null", "1e999", "NaN", '"', "}", "[]", "-1", "true", "\0"]) | st.text(max_size=8)
    )
    try:
        found = journal.read(text[:begin] + piece + text[end:])
        rules = journal.rules_of(found.lines[0])
    except journal.JournalError:
        return
    state = engine.EngineState()
    for line in found.lines:
        if line.kind == "event":
            state, _ = engine.decide(state, line.payload, rules)
