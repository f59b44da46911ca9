"""The terminal: single keys without echo, a way to be woken from other threads, and everything as it was at the end."""

from __future__ import annotations

import codecs
import os
import re
import select
import signal
import sys
import termios
import time
import unicodedata
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import Any, Iterator, List, Mapping, Optional, Tuple, Type

from .errors import TerminalError

_PASTE_MARKS_ON, _PASTE_MARKS_OFF = b"\x1b[?2004h", b"\x1b[?2004l"
_ESCAPE_PAUSE_S = 0.05
_END_LOST_S = 1.0  # without a byte: the end of what has begun does not come any more


class Wake:
    """Ends the wait of one thread from any other thread, or from a signal handler."""

    def __init__(self) -> None:
        self._read, self._write = os.pipe()
        os.set_blocking(self._read, False)
        os.set_blocking(self._write, False)

    def fileno(self) -> int:
        """Return what `select` waits for."""
        return self._read

    def set(self) -> None:
        """End the wait; harmless when it has been done already."""
        try:
            os.write(self._write, b"!")
        except (BlockingIOError, OSError):  # full: it is awake; closed: it is over
            return

    def clear(self) -> None:
        """Be ready for the next wait."""
        try:
            while os.read(self._read, 4096):
                pass
        except BlockingIOError:
            return


def owns_terminal(descriptor: int) -> bool:
    """Return True when a terminal is this process's own, and in its foreground.

    Under roslaunch a node shares a terminal that it does not own; in a shell's background reading would stop it.
    """
    try:
        return os.isatty(descriptor) and os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        return False


def is_in_background(descriptor: int) -> bool:
    """Return True when to read or set a terminal would stop this process: another job of its shell has it.

    Nobody stops a process for a terminal that is not its controlling one (under roslaunch).
    """
    try:
        return os.isatty(descriptor) and os.tcgetpgrp(descriptor) != os.getpgrp()
    except OSError:
        return False


@contextmanager
def never_frozen(source: Optional[int]) -> Iterator[None]:
    """Let Ctrl-S freeze no terminal for as long as the `with` lasts: who cannot print there reads no line either.

    While this process is stopped (Ctrl-Z) its shell sets what it likes; what is set here is set anew with `fg`.
    """
    if source is None or not os.isatty(source):
        yield
        return
    before = termios.tcgetattr(source)
    flowing = [before[0] & ~termios.IXON, *before[1:]]
    handler = signal.signal(signal.SIGCONT, lambda *_: _set(source, flowing))
    _set(source, flowing)
    try:
        yield
    finally:
        signal.signal(signal.SIGCONT, handler)
        _set(source, before)


def _set(source: int, attributes: List[Any]) -> None:
    if not is_in_background(source):
        with suppress(termios.error):  # it is gone
            termios.tcsetattr(source, termios.TCSANOW, attributes)


def read_if_ready(descriptor: Optional[int], wake: Wake, limit_s: float) -> Optional[bytes]:
    """Wait for bytes, a wake or the limit; return the bytes, b"" at their end, None when there are none."""
    wanted: List[Any] = [wake] if descriptor is None else [wake, descriptor]
    ready, _, _ = select.select(wanted, [], [], limit_s)
    wake.clear()
    if descriptor is None or descriptor not in ready:
        return None
    try:
        return os.read(descriptor, 4096)
    except BlockingIOError:
        return None
    except OSError:  # the terminal is gone
        return b""


class Terminal:
    """A terminal in key mode for as long as the `with` lasts. To be used by one thread; only `wake` is for others.

    Ctrl-C stays a signal. Ctrl-S, Ctrl-Z and Ctrl-Backslash do nothing: a frozen or suspended console would look alive.

    Raises:
        TerminalError: Input is not a terminal.
    """

    def __init__(self, wake: Wake, source: Optional[int] = None, sink: Optional[int] = None) -> None:
        self._wake = wake
        self._source = sys.stdin.fileno() if source is None else source
        self._sink = sys.stdout.fileno() if sink is None else sink
        self._keys = KeyDecoder()
        self._came_s = 0.0
        self._before: List[Any] = []

    def __enter__(self) -> None:
        try:
            self._before = termios.tcgetattr(self._source)
            termios.tcsetattr(self._source, termios.TCSADRAIN, _key_mode(termios.tcgetattr(self._source)))
        except termios.error as error:
            raise TerminalError(f"this is no terminal for single keys ({error}); use --plain") from error
        self._write(_PASTE_MARKS_ON)

    def __exit__(
        self, kind: Optional[Type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        """Put the terminal back, and drop what was typed but not read: it was not meant for the shell."""
        self._write(_PASTE_MARKS_OFF)
        try:
            termios.tcsetattr(self._source, termios.TCSAFLUSH, self._before)
        except termios.error:  # it is gone: nothing to put back
            return

    def keys(self, limit_s: float) -> Tuple[str, ...]:
        """Wait for keys, a wake or the limit, and return the keys; "quit" when the terminal is gone."""
        data = read_if_ready(self._source, self._wake, limit_s)
        if data == b"":
            return ("quit",)
        if data is not None:
            self._came_s = time.monotonic()
        elif time.monotonic() - self._came_s > _END_LOST_S:
            self._keys.forget()
        keys = self._keys.feed(data or b"")
        if data is not None and data.endswith(b"\x1b"):
            more = read_if_ready(self._source, self._wake, _ESCAPE_PAUSE_S)
            keys += self._keys.feed(more) if more else self._keys.flush()
        return tuple(keys)

    def _write(self, data: bytes) -> None:
        try:
            os.write(self._sink, data)
        except OSError:
            return


def _key_mode(attributes: List[Any]) -> List[Any]:
    """Return the attributes for single keys without echo."""
    attributes[0] &= ~(termios.IXON | termios.IXOFF)
    attributes[3] &= ~(termios.ICANON | termios.ECHO)
    controls = attributes[6]
    controls[termios.VMIN], controls[termios.VTIME] = 1, 0
    controls[termios.VSUSP] = controls[termios.VQUIT] = b"\x00"
    return attributes


# --- keys -------------------------------------------------------------------------------------------------------------
# Bytes of a terminal made into keys; pure. A key is the letter itself, or one of "enter", "escape", "backspace",
# "clear" (Ctrl-U), "quit" (Ctrl-C, Ctrl-D), "up", "down", "page up", "page down". Other function keys, mouse reports
# and everything that is pasted are nothing: pasted text must never land a vehicle.


_CONTROLS: Mapping[str, str] = {
    "\r": "enter",
    "\n": "enter",
    "\x7f": "backspace",
    "\x08": "backspace",
    "\x15": "clear",
    "\x03": "quit",
    "\x04": "quit",
}
_SCROLLS: Mapping[str, str] = {
    "\x1b[A": "up",
    "\x1bOA": "up",
    "\x1b[B": "down",
    "\x1bOB": "down",
    "\x1b[5~": "page up",
    "\x1b[6~": "page down",
}
_NO_LETTERS = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
_PASTE, _PASTE_END = "\x1b[200~", "\x1b[201~"
_SEQUENCE = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|O[ -~]|(?=[^\[O]))")
_LONGEST_SEQUENCE = 40


class KeyDecoder:
    """Remembers what has come of a sequence that is not complete."""

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._rest = ""
        self._pasting = False

    def feed(self, data: bytes) -> List[str]:
        """Return the keys that are complete with these bytes."""
        self._rest += self._decoder.decode(data)
        keys: List[str] = []
        while self._rest:
            if self._pasting:
                if not self._skip_paste():
                    break
            elif self._rest[0] != "\x1b":
                keys += _key(self._rest[0])
                self._rest = self._rest[1:]
            else:
                found = self._take_sequence()
                if found is None:
                    break
                keys += found
        return keys

    def flush(self) -> List[str]:
        """Return "escape" when nothing followed an ESC: to be called after a pause."""
        if self._pasting or not self._rest:
            return []
        lone, self._rest = self._rest == "\x1b", ""
        return ["escape"] if lone else []

    def forget(self) -> None:
        """Drop what has begun and not ended: to be called after a long pause, for its end was lost under way."""
        self._decoder.reset()
        self._rest, self._pasting = "", False

    def _skip_paste(self) -> bool:
        """Drop what is pasted up to its end mark; return False when the mark has not come yet."""
        at = self._rest.find(_PASTE_END)
        if at < 0:
            self._rest = self._rest[-len(_PASTE_END) + 1 :]
            return False
        self._rest, self._pasting = self._rest[at + len(_PASTE_END) :], False
        return True

    def _take_sequence(self) -> Optional[List[str]]:
        """Take one escape sequence and return its key, mostly none; None when it is not complete."""
        found = _SEQUENCE.match(self._rest)
        if found is None:
            if len(self._rest) > _LONGEST_SEQUENCE:
                self._rest = ""
            return None
        self._rest = self._rest[found.end() :]
        self._pasting = found.group() == _PASTE
        if found.group() == "\x1b":  # another key came with it, on a slow link: Escape is a "no", and must not vanish
            return ["escape"]
        return [_SCROLLS[found.group()]] if found.group() in _SCROLLS else []


def _key(letter: str) -> List[str]:
    if letter in _CONTROLS:
        return [_CONTROLS[letter]]
    return [letter] if letter != "\ufffd" and unicodedata.category(letter) not in _NO_LETTERS else []
