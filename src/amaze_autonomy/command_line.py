"""How every command of this package ends: one line for what a person can put right, a trace for what only we can."""

from __future__ import annotations

import os
import sys
from contextlib import contextmanager
from typing import Any, Callable, Iterator, Tuple, Type, cast

DONE, BROKEN, INTERRUPTED = 0, 70, 130
"""Exit statuses that mean the same in every command; 70 is EX_SOFTWARE of sysexits.h, 130 is 128 + SIGINT."""


def run_command(name: str, command: Callable[[], int], known: Tuple[Type[BaseException], ...], *, wrong: int) -> int:
    """Run a command and return its exit status, whatever happens.

    Args:
        name: of the command, as a person calls it.
        command: does the work, and returns the status.
        known: errors whose text is a whole message to the user.
        wrong: the status after one of those, or after a file that cannot be read or written.

    Returns:
        The status of the command; `wrong`; DONE when the reader of the output has had enough (`| head`);
        INTERRUPTED; BROKEN, with a trace, for anything else.
    """
    try:
        status = command()
        sys.stdout.flush()
    except BrokenPipeError:
        _to_nobody(sys.stdout)
        return DONE
    except KeyboardInterrupt:
        return INTERRUPTED
    except known as error:
        return say_wrong(name, str(error), wrong)
    except OSError as error:
        return say_wrong(name, f"{error.filename}: {error.strerror}" if error.filename else str(error), wrong)
    except Exception:  # noqa: BLE001 - a mistake of ours, of any kind
        import traceback  # noqa: PLC0415  (slow to load, and seldom wanted)

        traceback.print_exc()
        return say_wrong(name, f"this is an error in {name}, please report it with the lines above", BROKEN)
    return status


@contextmanager
def outlasting_readers() -> Iterator[None]:
    """Let a command that gives a verdict do all its work when the reader of its output has had enough.

    What it prints from then on goes nowhere; its files and its exit status are those that it would have had.
    """
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (cast("Any", _Outlasting(stream)) for stream in before)
    try:
        yield
        sys.stdout.flush()
    finally:
        sys.stdout, sys.stderr = before


class _Outlasting:
    """A stream that takes text when nobody reads it any more."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        try:
            return int(self._stream.write(text))
        except BrokenPipeError:
            _to_nobody(self._stream)
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except BrokenPipeError:
            _to_nobody(self._stream)


def _to_nobody(stream: Any) -> None:
    """Let what a stream still holds, and all that is written to it, go nowhere."""
    nobody = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nobody, stream.fileno())
    os.close(nobody)


def say_wrong(name: str, text: str, status: int) -> int:
    """Write one line to the standard error, whatever bytes its names hold, and return the status."""
    sys.stderr.write(f"{name}: {text.encode('utf-8', 'backslashreplace').decode()}\n")
    return status
