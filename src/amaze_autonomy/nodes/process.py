"""What the process itself does for speed: threads that take turns quickly, no pauses for garbage, precedence."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import rospy

__all__ = ["END_SIGNALS", "settle", "survive_a_closed_terminal", "take_precedence", "take_precedence_or_say"]

#: What ends a node in good order; a terminal that closes is no reason to leave a flying vehicle to itself.
END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_SWITCH_INTERVAL_S = 0.0005
_AUTOGROUP = Path("/proc/self/autogroup")


class _Outlet(io.TextIOBase):
    """A stream for people that nobody may read any more."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        """Be the stream in everything else."""
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write where that is possible, and at once: what a node said before it was killed stands in its log."""
        with suppress(OSError, ValueError):
            self._stream.write(text)
            self._stream.flush()
        return len(text)

    def flush(self) -> None:
        """Write out where that is possible."""
        with suppress(OSError, ValueError):
            self._stream.flush()


def survive_a_closed_terminal() -> None:
    """Have words to people never fail: a node writes to the terminal of roslaunch, which may be closed in flight.

    Call it before `rospy.init_node`, which keeps both streams for its log.
    """
    sys.stdout, sys.stderr = _Outlet(sys.stdout), _Outlet(sys.stderr)


def take_precedence(nice: int) -> str:
    """Ask for a niceness; return what the system did not permit, empty when it did.

    Where the kernel groups tasks by session (sched_autogroup_enabled, the default of Debian and Ubuntu), a niceness
    counts only among those of the same session, and roslaunch gives each node one: the niceness of the session's group
    is what counts against everybody else (sched(7)). It is set only for a session of our own, not for a terminal's.
    """
    refused = []
    try:
        os.setpriority(os.PRIO_PROCESS, 0, nice)
    except OSError as error:
        refused.append(f"niceness {nice}: {error.strerror}")
    if os.getsid(0) == os.getpid():
        try:
            _AUTOGROUP.write_text(f"{nice}\n", encoding="ascii")
        except FileNotFoundError:
            return "; ".join(refused)  # this kernel does not group by session
        except OSError as error:
            refused.append(f"niceness {nice} of the session: {error.strerror}")
    return "; ".join(refused)


def take_precedence_or_say(nice: int) -> None:
    """Ask for a niceness, and say once what the system did not permit."""
    refused = take_precedence(nice)
    if refused:
        rospy.logwarn(
            "Precedence over other programs was not permitted (%s): reactions are late when the computer is busy."
            " Run as root, with CAP_SYS_NICE or with a limit of nice in /etc/security/limits.conf; or set ~nice to 0.",
            refused,
        )


def settle() -> None:
    """Call once everything is loaded: what is there now is never searched for garbage again."""
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
