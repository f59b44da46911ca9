"""What pip installs as a command is an executable of the catkin package, too; each starts a function that exists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted((ROOT / "scripts").iterdir())
COMMANDS = dict(
    re.findall(r'^([a-z-]+) = "([a-z_.]+:main)"$', (ROOT / "pyproject.toml").read_text(), flags=re.MULTILINE)
)


def test_every_command_has_an_executable():
    commands = {path.name: target for path, target in map(target_of, SCRIPTS) if path.name in COMMANDS}

    assert commands == COMMANDS


def target_of(script: Path):
    return script, re.search(r"^from (\S+) import main$", script.read_text(), flags=re.MULTILINE)[1] + ":main"


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_an_executable_has_three_lines_and_starts_a_function_that_exists(script):
    _, target = target_of(script)
    module = ROOT / "src" / (target.split(":")[0].replace(".", "/") + ".py")

    assert script.read_text() == (
        f"#!/usr/bin/env python3\nfrom {target.split(':')[0]} import main\nraise SystemExit(main())\n"
    )
    assert script.stat().st_mode & 0o111
    names = {
        name
        for node in ast.parse(module.read_text()).body
        for name in (
            [node.name]
            if isinstance(node, ast.FunctionDef)
            else [alias.asname or alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert "main" in names
