"""The terminal in key mode, on a pseudo terminal within this process."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import termios
import threading
import time

import pytest

from amaze_autonomy.console.errors import TerminalError
from amaze_autonomy.console.terminal import Terminal, Wake, never_frozen, owns_terminal, read_if_ready

LIMIT_S = 10.0


@pytest.fixture
def terminal():
    """A pseudo terminal: (its user's side, the console's side)."""
    user, console = pty.openpty()
    yield user, console
    for descriptor in (user, console):
        with contextlib.suppress(OSError):  # a test may have closed it
            os.close(descriptor)


def test_keys_come_one_by_one_without_enter(terminal):
    user, console = terminal
    reader = Terminal(Wake(), console, console)
    with reader:
        os.write(user, b"l")
        assert reader.keys(LIMIT_S) == ("l",)
        os.write(user, b"y\r")
        assert reader.keys(LIMIT_S) == ("y", "enter")


def test_a_lone_escape_is_a_key(terminal):
    user, console = terminal
    reader = Terminal(Wake(), console, console)
    with reader:
        os.write(user, b"\x1b")
        assert reader.keys(LIMIT_S) == ("escape",)


def keys_within(reader, limit_s):
    """Return the keys that come within so many seconds, read as the screen reads them."""
    keys, end_s = [], time.monotonic() + limit_s
    while time.monotonic() < end_s:
        keys += reader.keys(0.1)
    return keys


@pytest.mark.parametrize("begun", [b"\x1b[200~some te", b"\x1b["])
def test_a_paste_whose_end_is_lost_takes_no_key_a_second_later(terminal, begun):
    user, console = terminal
    reader = Terminal(Wake(), console, console)
    with reader:
        os.write(user, begun)
        assert keys_within(reader, 1.5) == []
        os.write(user, b"l\r")
        assert keys_within(reader, 0.3) == ["l", "enter"]


def test_a_paste_that_comes_slowly_is_one(terminal):
    user, console = terminal
    reader = Terminal(Wake(), console, console)
    with reader:
        for piece in (b"\x1b[200~l", b"\r", b"y\r", b"l\r", b"\x1b[201~h"):
            os.write(user, piece)
            keys = keys_within(reader, 0.6)
        assert keys == ["h"]


def test_a_paste_that_waited_for_a_console_that_stood_still_is_one(terminal):
    user, console = terminal
    reader = Terminal(Wake(), console, console)
    with reader:
        os.write(user, b"\x1b[200~l\r")
        assert reader.keys(LIMIT_S) == ()
        os.write(user, b"l\r\x1b[201~h")
        time.sleep(1.5)
        assert reader.keys(LIMIT_S) == ("h",)


def test_nothing_is_echoed_and_ctrl_s_freezes_nothing(terminal):
    _, console = terminal
    reader = Terminal(Wake(), console, console)
    with reader:
        local, controls = termios.tcgetattr(console)[3], termios.tcgetattr(console)[6]
        assert not local & (termios.ECHO | termios.ICANON)
        assert local & termios.ISIG
        assert controls[termios.VINTR] == b"\x03"
        assert controls[termios.VSUSP] == controls[termios.VQUIT] == b"\x00"
        assert not termios.tcgetattr(console)[0] & termios.IXON


def test_the_terminal_is_left_as_it_was_even_after_an_error(terminal):
    _, console = terminal
    before = termios.tcgetattr(console)
    with pytest.raises(ZeroDivisionError), Terminal(Wake(), console, console):
        1 // (termios.tcgetattr(console) == before)
    assert termios.tcgetattr(console) == before


def test_what_was_typed_but_not_read_does_not_reach_the_shell(terminal):
    user, console = terminal
    with Terminal(Wake(), console, console):
        os.write(user, b"rm -rf everything\n")
        assert select.select([console], [], [], LIMIT_S)[0] == [console]
    assert read_if_ready(console, Wake(), 0.0) is None


def test_another_thread_ends_the_wait(terminal):
    _, console = terminal
    wake = Wake()
    reader = Terminal(wake, console, console)
    with reader:
        threading.Timer(0.05, wake.set).start()
        assert reader.keys(LIMIT_S) == ()


def test_a_wake_before_the_wait_is_not_lost_and_many_are_one(terminal):
    _, console = terminal
    wake = Wake()
    for _ in range(100_000):
        wake.set()
    assert read_if_ready(console, wake, LIMIT_S) is None
    assert read_if_ready(console, wake, 0.0) is None


def test_a_terminal_that_goes_away_ends_the_console(terminal):
    user, console = terminal
    reader = Terminal(Wake(), console, console)
    with reader:
        os.close(user)
        assert reader.keys(LIMIT_S) == ("quit",)


def test_what_is_no_terminal_is_refused(tmp_path):
    with (tmp_path / "file").open("w+b") as file:
        assert not owns_terminal(file.fileno())
        with pytest.raises(TerminalError, match=r"this is no terminal for single keys .* use --plain"):
            Terminal(Wake(), file.fileno(), file.fileno()).__enter__()


def test_a_terminal_that_belongs_to_others_is_not_owned(terminal):
    assert not owns_terminal(terminal[1])


@pytest.mark.parametrize("what", ["nothing", "a pipe"])
def test_what_is_no_terminal_is_never_frozen_and_stays_as_it_is(what):
    source, sink = os.pipe()
    with never_frozen(None if what == "nothing" else source):
        os.write(sink, b"land\n")
    assert os.read(source, 4096) == b"land\n"
    os.close(source)
    os.close(sink)


def test_a_terminal_that_goes_away_is_not_put_back(terminal):
    user, console = terminal
    with never_frozen(console):
        assert not termios.tcgetattr(console)[0] & termios.IXON
        os.close(console)
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(console)
    assert os.write(user, b"") == 0


def test_a_pipe_says_that_it_has_ended():
    source, sink = os.pipe()
    os.write(sink, b"land\n")
    assert read_if_ready(source, Wake(), LIMIT_S) == b"land\n"
    os.close(sink)
    assert read_if_ready(source, Wake(), LIMIT_S) == b""
    os.close(source)
    assert read_if_ready(None, Wake(), 0.0) is None
