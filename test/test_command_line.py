"""Every command ends with a documented status, and says one line for what a person can mend."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from amaze_autonomy.command_line import run_command


class KnownError(Exception):
    """What a person can mend."""


def raises(error):
    def command():
        raise error

    return command


@pytest.mark.parametrize(
    "command, status, told",
    [
        (lambda: 3, 3, ""),
        (raises(KeyboardInterrupt()), 130, ""),
        (raises(KnownError("flight.bag: is empty")), 2, "tool: flight.bag: is empty\n"),
        (raises(KnownError("bad\udcff.bag: is empty")), 2, "tool: bad\\udcff.bag: is empty\n"),
        (raises(PermissionError(13, "Permission denied", "out.bag")), 2, "tool: out.bag: Permission denied\n"),
        (raises(OSError("no more of it")), 2, "tool: no more of it\n"),
    ],
    ids=["done", "interrupted", "known", "any bytes", "file", "system"],
)
def test_what_comes_of_a_command(capsys, command, status, told):
    assert run_command("tool", command, (KnownError,), wrong=2) == status
    assert capsys.readouterr().err == told


def test_a_mistake_of_ours_shows_where_it_is_and_asks_for_a_report(capsys):
    assert run_command("tool", raises(KeyError("row")), (KnownError,), wrong=2) == 70
    trace, last = capsys.readouterr().err.rstrip("\n").rsplit("\n", 1)
    assert trace.startswith("Traceback")
    assert trace.endswith("KeyError: 'row'")
    assert last == "tool: this is an error in tool, please report it with the lines above"


@pytest.mark.parametrize(
    "arguments",
    [
        ["amaze_autonomy.cli", "missions"],
        ["amaze_autonomy.cli", "simulate", "--list"],
        ["amaze_autonomy.tester.command", "maps"],
    ],
    ids=["amaze-autonomy", "simulate", "amaze-replay"],
)
def test_a_reader_that_has_had_enough_is_no_error(arguments):
    program = f"import sys; from {arguments[0]} import main; sys.exit(main({arguments[1:]!r}))"
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ended = subprocess.run(
            [sys.executable, "-c", program], check=False, stdout=writer, stderr=subprocess.PIPE, timeout=60
        )
    finally:
        os.close(writer)
    assert (ended.returncode, ended.stderr) == (0, b"")
