"""Every override that is shown, in pages, launch files, comments and --help, is one that the configuration takes."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from amaze_autonomy import cli
from amaze_autonomy.bags import cli as bags_cli
from amaze_autonomy.config import FILES, load_configuration
from amaze_autonomy.paths import config_folder
from amaze_autonomy.simulation import cli as simulation_cli
from amaze_autonomy.simulation import px4_udp as vehicle_cli
from amaze_autonomy.tester import command

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
OVERRIDE = re.compile(
    rf"(?<![\w./])((?:{'|'.join(FILES)})(?:\.[\w/]+)+=(?:\[[^\]]*\]|[^\s'\"`;,)<>]+)|vehicle=[a-z]\w+)"
)


def helps_of(parser):
    """Yield what --help of a command and of those below it says."""
    yield parser.prog, parser.format_help()
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for each in action.choices.values():
                yield from helps_of(each)


def helps():
    """Yield what --help of every command says, by its name."""
    parsers = (cli._parser(), bags_cli._parser(), command._parser(scenarios=True))
    for parser in (*parsers, simulation_cli._parser(), vehicle_cli._parser()):
        yield from helps_of(parser)


def lines_of(where, text):
    return [(f"{where}:{number}", line) for number, line in enumerate(text.splitlines(), 1)]


def texts():
    """Yield where something is shown, and a text in which overrides stand that go together: a line, or an argument."""
    for path in PAGES:
        yield from lines_of(path.name, path.read_text())
    for path in sorted((ROOT / "launch").glob("*.launch")):
        yield from ((f"{path.name}, {each.get('name')}", each.get("doc", "")) for each in ET.parse(path).iter("arg"))
    for path in sorted((ROOT / "src").rglob("*.py")):
        yield from (each for each in lines_of(path.name, path.read_text()) if each[1].lstrip().startswith("#"))
    for program, said in helps():
        yield from lines_of(f"{program} --help", said)


SHOWN = {f"{where} {' '.join(found)}": found for where, text in texts() for found in [OVERRIDE.findall(text)] if found}


@pytest.mark.parametrize("shown", SHOWN)
def test_an_override_that_is_shown_is_one_that_the_configuration_takes(shown):
    assert load_configuration(config_folder(), SHOWN[shown]) is not None


@pytest.mark.parametrize(
    "place", ["README.md", "configuration.md", "integrator.md", "tester.md", "autonomy.launch", "loader.py", "--help"]
)
def test_overrides_are_found_where_they_are_shown(place):
    assert any(place in shown for shown in SHOWN)
