"""How every command of this package ends: one line for what a person can put right, a trace for what only we can."""

from __future__ import annotations

import os
import sys
from typing import Callable, Tuple, Type

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
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
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


def say_wrong(name: str, text: str, status: int) -> int:
    """Write one line to the standard error, whatever bytes its names hold, and return the status."""
    sys.stderr.write(f"{name}: {text.encode('utf-8', 'backslashreplace').decode()}\n")
    return status
