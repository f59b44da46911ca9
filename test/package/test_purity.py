"""What import contracts cannot say: the engine uses the standard library only, and no part of it that acts or asks."""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from typing import Iterator

import pytest

import amaze_autonomy.engine

MODULES = sorted(Path(amaze_autonomy.engine.__file__).parent.rglob("*.py"))
IMPURE = {
    "asyncio",
    "io",
    "logging",
    "multiprocessing",
    "os",
    "random",
    "secrets",
    "select",
    "socket",
    "subprocess",
} | {"sys", "tempfile", "threading", "time", "uuid"}


def imported(module: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield str(node.module)


@pytest.mark.skipif(sys.version_info < (3, 10), reason="Python does not list its own modules before 3.10")
@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.name)
def test_the_engine_imports_itself_and_the_standard_library(module):
    foreign = [
        name
        for name in imported(module)
        if name.split(".")[0] not in sys.stdlib_module_names and not name.startswith("amaze_autonomy.engine")
    ]

    assert foreign == []


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.name)
def test_the_engine_imports_no_clock_no_thread_no_chance_and_no_input(module):
    assert IMPURE.intersection(name.split(".")[0] for name in imported(module)) == set()
