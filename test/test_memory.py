"""No command takes more memory for a chunk than --memory says: what unpacks to more is refused, or named."""

from __future__ import annotations

import argparse
import sys
import tracemalloc
from pathlib import Path

import pytest

sys.path += [str(Path(__file__).parent / folder) for folder in ("bags", "replay")]

from bag_tools import bomb
from replay_bags import START_NS, header, make

from amaze_autonomy import cli
from amaze_autonomy.bags import cli as bags_cli
from amaze_autonomy.tester import command

PERMITTED_MB, UNPACKS = 5, 60_000_000
TOO_LARGE = f"takes {UNPACKS // 10**6} MB of memory, {PERMITTED_MB} may be taken (--memory 60 permits it)"
PROGRAMS = {
    "amaze-bag": (bags_cli.main, bags_cli._parser()),
    "amaze-replay": (command.main, command._parser(scenarios=True)),
    "amaze-autonomy": (cli.main, cli._parser()),
}
MAP = "about: x\nreadings: {battery: {topic: /a, fraction: sequence}}\n"
SCENARIO = """\
version: 1
description: x
bags: [{path: bomb.bag}]
map: map.yaml
expectations: [{expect: never, of: {state: MISSION}}]
"""
FAULT = "faults: [{topic: /a, fault: silent, at_s: 9.0}]\n"
COMMANDS = {
    "amaze-bag info": ("bomb.bag", 0, ""),  # the index alone
    "amaze-bag doctor": ("bomb.bag", 3, TOO_LARGE),
    "amaze-bag recover": ("bomb.bag -o new.bag", 3, TOO_LARGE),
    "amaze-bag merge": ("bomb.bag -o new.bag --compression none", 1, TOO_LARGE),
    "amaze-bag filter": ("bomb.bag -o new.bag --compression none", 1, TOO_LARGE),
    "amaze-bag cut": ("bomb.bag -o new.bag --compression none", 1, TOO_LARGE),
    "amaze-bag verify": ("bomb.bag", 1, TOO_LARGE),
    "amaze-replay run": ("bomb.bag --map map.yaml", 3, TOO_LARGE),
    "amaze-replay map": ("bomb.bag", 3, TOO_LARGE),
    "amaze-replay export": ("bomb.bag -o new.mcap", 3, TOO_LARGE),
    "amaze-replay journal": ("bomb.bag", 2, TOO_LARGE),
    "amaze-replay laws": ("bomb.bag", 2, TOO_LARGE),
    "amaze-replay agree": ("bomb.bag bomb.bag", 2, TOO_LARGE),
    "amaze-replay test": ("x.scenario.yaml --no-goldens", 3, TOO_LARGE),
    "amaze-replay corpus": ("x.scenario.yaml --no-goldens -j 1", 3, TOO_LARGE),
    "amaze-replay accept": ("x.scenario.yaml --reason because_it_is_right", 1, TOO_LARGE),
    "amaze-replay coverage": ("x.scenario.yaml", 1, TOO_LARGE),
    "amaze-replay mutate": ("x.scenario.yaml --only hold_again", 1, TOO_LARGE),
    "amaze-replay what-if": ("x.scenario.yaml --against autonomy.require_go=true", 4, TOO_LARGE),
    "amaze-replay sweep": ("fault.scenario.yaml --from 1 --to 2", 2, TOO_LARGE),
    "amaze-replay shrink": ("x.scenario.yaml --rule ready", 2, TOO_LARGE),
    "amaze-autonomy propose-config": ("bomb.bag --output new", 1, TOO_LARGE),
}
"""By program and command: arguments, exit status, what is said."""

READ_NO_BAG = {
    "amaze-replay maps",
    *(f"amaze-autonomy {name}" for name in ("check-config", "docs", "doctor", "import-cns", "missions")),
    *(f"amaze-autonomy {name}" for name in ("simulate", "vehicle")),
}


def commands():
    for program, (_, parser) in PROGRAMS.items():
        (table,) = [each for each in parser._actions if isinstance(each, argparse._SubParsersAction)]
        for name, own in table.choices.items():
            yield f"{program} {name}", {text for action in own._actions for text in action.option_strings}


def test_each_command_that_reads_bags_has_the_option_and_is_tested_here():
    assert {name for name, options in commands() if "--memory" in options} == set(COMMANDS)


def test_a_command_without_the_option_reads_no_bag():
    assert {name for name, options in commands() if "--memory" not in options} == READ_NO_BAG


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    entry = make("amaze_autonomy/msg/JournalEntry", header=header(START_NS), sequence=0, kind="event", line="x")
    bomb(tmp_path / "bomb.bag", UNPACKS, UNPACKS, entry)
    Path("map.yaml").write_text(MAP)
    Path("x.scenario.yaml").write_text(SCENARIO)
    Path("fault.scenario.yaml").write_text(SCENARIO + FAULT)
    return tmp_path


@pytest.mark.slow_rows
@pytest.mark.parametrize("name", COMMANDS)
def test_a_small_bag_that_unpacks_to_much_takes_no_more_than_is_permitted(folder, capsys, name):
    program, verb = name.split()
    arguments, status, said = COMMANDS[name]
    assert (folder / "bomb.bag").stat().st_size < 10_000
    tracemalloc.start()
    found = PROGRAMS[program][0]([verb, *arguments.split(), "--memory", str(PERMITTED_MB)])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    out, err = capsys.readouterr()
    assert (found, said in out + err, "Traceback" in err) == (status, True, False), out + err
    assert peak < UNPACKS / 2
