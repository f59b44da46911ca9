"""What pip installs as a command is an executable of the catkin package, too; each starts a function that exists."""

from __future__ import annotations

import ast
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted((ROOT / "scripts").iterdir())
START = "amaze_autonomy.start"
COMMANDS = dict(
    re.findall(rf'^([a-z-]+) = "{START}:([a-z_]+)"$', (ROOT / "pyproject.toml").read_text(), flags=re.MULTILINE)
)


def test_every_command_has_an_executable():
    assert sorted(COMMANDS) == ["amaze-autonomy", "amaze-bag", "amaze-replay"]
    for name, function in COMMANDS.items():
        assert called(ROOT / "scripts" / name) == (function, "")


def called(script: Path):
    """Return the function of `start` that an executable calls, and the module that it names, "" where it names none."""
    lines = script.read_text().splitlines()
    function = re.fullmatch(rf"from {START} import (\w+)", lines[1])[1]
    module = re.fullmatch(rf'raise SystemExit\({function}\((?:"([\w.]+)")?\)\)', lines[2])[1] or ""
    return function, module


def loaded(script: Path) -> str:
    """Return the module whose `main` an executable starts."""
    function, module = called(script)
    if module:
        return module
    names = re.findall(rf'def {function}\(\) -> int:\n.*\n    return start_command\("([\w.]+)"\)', STARTS)
    return names[0]


STARTS = (ROOT / "src" / "amaze_autonomy" / "start.py").read_text()


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_an_executable_has_three_lines_and_starts_a_function_that_exists(script):
    module = ROOT / "src" / (loaded(script).replace(".", "/") + ".py")

    assert script.read_text().splitlines()[0] == "#!/usr/bin/env python3"
    assert len(script.read_text().splitlines()) == 3
    node = loaded(script).startswith("amaze_autonomy.nodes.")
    assert (called(script)[0] == "start_node") == node
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


LOADS_FOR_LONG = """\
import os, sys, time

class Slow:
    @staticmethod
    def find_spec(name, *_):
        if name == os.environ["SLOW"]:
            print("loading", flush=True)
            for _ in range(600):  # a signal that comes just before a sleep does not end it
                time.sleep(0.1)

sys.meta_path.insert(0, Slow)
"""


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
@pytest.mark.slow_rows
def test_ctrl_c_while_an_executable_is_still_loaded_ends_it_without_a_traceback(tmp_path, script):
    (tmp_path / "sitecustomize.py").write_text(LOADS_FOR_LONG)
    paths = os.pathsep.join([str(tmp_path), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])
    begun = subprocess.Popen(
        ["env", "--default-signal=INT", sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": paths, "SLOW": loaded(script)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert begun.stdout.readline() == "loading\n"
        begun.send_signal(signal.SIGINT)
        said = begun.communicate(timeout=30)
    finally:
        begun.kill()
    node = loaded(script).startswith("amaze_autonomy.nodes.")
    assert (begun.returncode, *said) == (0 if node else 130, "", "")
