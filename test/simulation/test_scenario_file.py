"""Scenarios from YAML: what they may say, and one error with file and line for what they may not."""

import pytest

from amaze_autonomy.config import ConfigError
from amaze_autonomy.engine.events import UserCommand
from amaze_autonomy.interface import PEERS, SERVICES
from amaze_autonomy.simulation import (
    KINDS,
    Fault,
    Request,
    Scenario,
    Subject,
    Trigger,
    load_scenario,
    parse_scenario,
)

S = 1_000_000_000

GOOD = """\
description: The range finder falls silent, the battery drops.
faults:
  - component: lrf
    fault: silent
    after: {event: waypoint, number: 2, occurrence: 3, delay_s: 1.5}
    for_s: 5.0
    restart: fails
  - fault: battery_drops
    to_fraction: 0.2
    at_s: 7
  - service: mission_planner/load
    fault: slow
    delay_s: 2.5
requests:
  - request: give_up
    after: {state: OUTREACH}
"""


def test_a_scenario_says_what_goes_wrong_and_what_the_user_does():
    assert parse_scenario(GOOD) == Scenario(
        description="The range finder falls silent, the battery drops.",
        faults=(
            Fault(
                KINDS[Subject.COMPONENT, "silent"],
                "lrf",
                Trigger(event="waypoint", number=2, occurrence=3, delay_ns=1_500_000_000),
                5 * S,
                (("restart", "fails"), ("restart_takes_s", 2.0)),
            ),
            Fault(
                KINDS[Subject.WORLD, "battery_drops"],
                "",
                Trigger(at_ns=7 * S),
                None,
                (("to_fraction", 0.2), ("over_s", 0.0)),
            ),
            Fault(KINDS[Subject.SERVICE, "slow"], "mission_planner/load", Trigger(at_ns=0), None, (("delay_s", 2.5),)),
        ),
        requests=(Request(UserCommand.GIVE_UP, Trigger(state="OUTREACH")),),
    )


def test_a_fault_knows_where_it_was_written():
    assert [fault.where for fault in parse_scenario(GOOD, "story.yaml").faults] == [
        "story.yaml:3",
        "story.yaml:8",
        "story.yaml:11",
    ]


MISTAKES = (
    ("fault: silent", "fault: silnt", 4, "is the text 'silnt'; must be one of silent, killed"),
    ("fault: silent", "fault: refuses", 4, "is refuses; must be given with service"),
    ("fault: silent", "fault: does_not_arm", 4, "must be given with no component, process or service"),
    ("    fault: silent\n", "", 3, "faults.0.fault: is missing"),
    ("to_fraction: 0.2", "to_fraction: 1.2", 9, "is 1.2; must be a number at least 0 and at most 1"),
    ("    to_fraction: 0.2\n", "", 8, "faults.1.to_fraction: is missing"),
    ("to_fraction: 0.2", "to_percent: 20", 9, "did you mean to_fraction (20 percent are 0.2 fraction)?"),
    ("component: lrf", "component: lrf\n    process: watchdog", 3, "has both component and process"),
    ("state: OUTREACH", "state: OUTRECH", 16, "is the text 'OUTRECH'; must be one of MISSION_INPUT"),
    ("event: waypoint", "event: weypoint", 5, "is the text 'weypoint'; must be one of armed"),
    ("event: waypoint", "event: airborne", 5, "must be given with the event waypoint only"),
    ("event: waypoint, number: 2", "delay_s: 0", 5, "given twice"),
    ("event: waypoint, number: 2, ", "", 5, "has neither event nor state"),
    ("event: waypoint,", "event: waypoint, state: HOLD,", 5, "has both event and state"),
    ("at_s: 7", "at_s: 7\n    after: {state: HOLD}", 8, "has both at_s and after"),
    ("at_s: 7", "at_s: -7", 10, "is -7; must be a number at least 0"),
    ("for_s: 5.0", "for_s: 0", 6, "must be a number above 0"),
    ("for_s: 5.0", "for_ms: 5", 6, "did you mean for_s (5 ms are 0.005 s)?"),
    ("restart: fails", "restart: maybe", 7, "must be one of succeeds, fails"),
    ("mission_planner/load", "planner/load", 11, "must be one of watchdog/start"),
    ("request: give_up", "request: giveup", 15, "must be one of go, retry, give_up"),
    ("request: give_up", "ask: give_up", 15, "is an unknown key"),
    ("description: The range", "descr: The range", 1, "did you mean description?"),
    ("faults:", "fault:", 2, "did you mean faults?"),
    (
        "component: lrf\n    fault: silent",
        "process: state_estimation\n    fault: silent",
        3,
        "must be one of watchdog, landing",
    ),
    ("component: lrf\n    fault: silent", "process: autopilot\n    fault: stuck", 3, "must be one of watchdog"),
    ("component: lrf", "component: lrf\n    component: lrf", 4, "is given twice (first in line 3)"),
)


@pytest.mark.parametrize("old, new, line, words", MISTAKES, ids=[mistake[1].strip()[:40] for mistake in MISTAKES])
def test_a_mistake_is_one_error_with_file_line_and_what_would_be_right(tmp_path, old, new, line, words):
    assert old in GOOD
    file = tmp_path / "story.yaml"
    file.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(ConfigError) as error:
        load_scenario(file)
    assert (error.value.file, error.value.line) == (str(file), line)
    assert words in str(error.value)


def test_a_file_that_is_not_there_is_an_error(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_scenario(tmp_path / "nothing.yaml")


def written(kind):
    """Return a fault of a kind as it is written, with everything it must be given."""
    target = {
        Subject.COMPONENT: "component: lrf, ",
        Subject.PROCESS: f"process: {(kind.targets or PEERS)[0]}, ",
        Subject.SERVICE: f"service: {next(iter(SERVICES))}, ",
        Subject.WORLD: "",
    }[kind.subject]
    given = "".join(
        f", {each.name}: {each.choices[0] if each.choices else max(each.low, 0.5)}"
        for each in kind.parameters
        if each.default is None
    )
    return f"description: a kind\nfaults:\n  - {{{target}fault: {kind.name}{given}}}\n"


@pytest.mark.parametrize(
    "kind", KINDS.values(), ids=[f"{kind.subject or 'world'} {kind.name}" for kind in KINDS.values()]
)
def test_every_kind_of_fault_can_be_written(kind):
    (fault,) = parse_scenario(written(kind)).faults
    assert fault.kind is kind
    for parameter in kind.parameters:
        value = fault.number(parameter.name) if parameter.is_number else fault.word(parameter.name)
        assert isinstance(value, float if parameter.is_number else str)


def test_a_parameter_that_a_kind_does_not_have_is_an_error_in_the_program():
    (fault,) = parse_scenario(GOOD).faults[:1]
    with pytest.raises(KeyError):
        fault.number("rate_fraction")


def test_every_shipped_scenario_loads_and_says_what_happens(config_folder):
    files = sorted((config_folder / "faults").glob("*.yaml"))
    assert len(files) > 40
    for file in files:
        story = load_scenario(file)
        assert story.description.endswith(".")
        assert story.faults or story.requests
