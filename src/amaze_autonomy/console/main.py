"""The command `console`: reads the command line, chooses screen or plain mode, ends with a status that says how."""

from __future__ import annotations

import argparse
import errno
import os
import signal
import sys
from typing import Any, Callable, List, Optional, Tuple

from amaze_autonomy.console.errors import ConsoleError, UsageError
from amaze_autonomy.console.link import Happening, Link, Mailbox
from amaze_autonomy.console.model import DEFAULT_ENGINE, Desk
from amaze_autonomy.console.plain import run_plain
from amaze_autonomy.console.session import CLOSED, INTERRUPTED, Session
from amaze_autonomy.console.terminal import Terminal, Wake, is_in_background, never_frozen, owns_terminal

from ..paths import expanded
from .wire import clean

_USAGE_STATUS = 2

_DESCRIPTION = """\
The operator's terminal of amaze_autonomy: select a mission, follow the checks and the flight, command.

Closing it, by Q, Ctrl-C or by closing its window, never touches the flight: the engine goes on without it.
Several consoles may look at one engine. Without a terminal it prints what changes, one line each.
"""

_EPILOG = """\
examples:
  rosrun amaze_autonomy console                      the full screen, in a second terminal
  rosrun amaze_autonomy console --plain | tee log    lines only
  rosrun amaze_autonomy console --mission 1 --once   fly mission 1, end with it
  rosrun amaze_autonomy console --engine /uav2/autonomy
  printf '1\\ny\\n' | rosrun amaze_autonomy console --plain --once

exit status:
  0    closed by the user, a signal or with --pid; --once: the mission is complete, all of several
  2    wrong usage, or ROS is not there; --once: the mission is not selected, and nobody can name another
  3    --once: all else, e.g. the mission or one before it has ended otherwise or lacks data, or this
       console was ended before
  4    --wait: no engine in time
  130  Ctrl-C
"""

MakeLink = Callable[[Callable[[Happening], None], Optional[str], bool], Link]


def main(arguments: Optional[List[str]] = None, make_link: Optional[MakeLink] = None) -> int:
    """Run the console and return its exit status.

    Args:
        arguments: the command line without the program's name; None: the process's own.
        make_link: makes the link to the engine from (post, engine's name, quiet); None: the one over ROS.
    """
    _open_what_is_closed()
    given = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args([each for each in given if ":=" not in each])
    try:
        return _run(options, make_link or _ros_link)
    except ConsoleError as error:
        print(f"console: {error}", file=sys.stderr)  # noqa: T201
        return _USAGE_STATUS


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="console", description=_DESCRIPTION, epilog=_EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--engine", metavar="NAME", help="the engine's node (parameter ~engine; default autonomy)")
    parser.add_argument(
        "--mission",
        metavar="ID",
        action="append",
        default=[],
        help="select it without asking (parameter ~mission); may be repeated",
    )
    parser.add_argument("--once", action="store_true", help="end when the mission has ended, the last one of several")
    parser.add_argument("--pid", metavar="PID", type=int, help="end with this process, e.g. the launch file's")
    parser.add_argument("--page", metavar="ADDRESS", default="", help="of the operator's page, to be shown")
    parser.add_argument(
        "--wait", metavar="S", type=float, help="wait so many seconds for the engine (default: for ever)"
    )
    parser.add_argument(
        "--plain", action="store_true", help="lines only, no colour, no cursor; without a terminal by itself"
    )
    parser.add_argument("--ascii", action="store_true", help="no unicode; by itself where the locale has none")
    parser.add_argument(
        "--pictures", metavar="DIR", type=expanded, help="save the screen as SVG whenever the state changes"
    )
    return parser


def _ros_link(post: Callable[[Happening], None], engine: Optional[str], quiet: bool) -> Link:  # noqa: FBT001
    try:
        from amaze_autonomy.console.ros_link import RosLink  # noqa: PLC0415 (offline there is no ROS)
    except ImportError as error:
        raise UsageError(
            f"ROS or the messages of amaze_autonomy are not there ({error}): source devel/setup.bash"
        ) from error
    link: Link = RosLink(post, engine, quiet=quiet)
    return link


def _run(options: argparse.Namespace, make_link: MakeLink) -> int:
    full = not options.plain and owns_terminal(0) and os.isatty(1) and _has_rich()
    wake = Wake()
    mailbox = Mailbox(wake)
    link = make_link(mailbox.post, options.engine, full)
    wanted = tuple(name for each in options.mission for name in clean(each).replace(",", " ").split())
    desk = Desk(engine=clean(options.engine or DEFAULT_ENGINE, 80), wanted=wanted, page=clean(options.page))
    session = Session(desk, link, mailbox, once=options.once, wait_s=options.wait, pid=options.pid)
    _end_on_signals(session, wake)
    link.start()
    try:
        if full:
            _run_screen(session, wake, options)
        else:
            source = _input()
            with never_frozen(source):
                run_plain(session, wake, source)
    finally:
        link.close()
    return CLOSED if session.status is None else session.status


def _run_screen(session: Session, wake: Wake, options: argparse.Namespace) -> None:
    from amaze_autonomy.console.screen.screen import run_screen  # noqa: PLC0415 (the plain mode needs no rich)
    from amaze_autonomy.console.screen.style import ASCII, UNICODE  # noqa: PLC0415

    sys.stdout.reconfigure(errors="replace")  # type: ignore[union-attr]
    encoding = (sys.stdout.encoding or "").lower().replace("-", "")
    plain_letters = options.ascii or encoding != "utf8" or os.environ.get("TERM") == "linux"
    try:
        run_screen(session, Terminal(wake), ASCII if plain_letters else UNICODE, options.pictures)
        print(session.farewell(), flush=True)  # noqa: T201
    except OSError as error:
        if error.errno not in (errno.EIO, errno.EPIPE):
            raise
        session.end(CLOSED)  # the window was closed
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _has_rich() -> bool:
    try:
        import rich  # noqa: F401, PLC0415
    except ImportError:
        print("console: the library rich is not installed, so there are lines only", file=sys.stderr)  # noqa: T201
        return False
    return os.environ.get("TERM") not in (None, "", "dumb")


def _open_what_is_closed() -> None:
    """Open standard input, output and errors on nothing where they are closed: something else would become them."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest number that is free
    sys.stdout = sys.stdout or os.fdopen(1, "w", encoding="utf-8")
    sys.stderr = sys.stderr or os.fdopen(2, "w", encoding="utf-8")


def _input() -> Optional[int]:
    """Return standard input, unless reading from it would stop this process (a shell's background)."""
    return None if is_in_background(0) else 0


def _end_on_signals(session: Session, wake: Wake) -> None:
    """End in order, with the terminal as it was, on every signal that asks for it; look again when the size changes."""
    statuses: Tuple[Tuple[signal.Signals, int, str], ...] = (
        (signal.SIGINT, INTERRUPTED, "Interrupted."),
        (signal.SIGTERM, CLOSED, "Terminated."),
        (signal.SIGHUP, CLOSED, "The terminal was closed."),
    )
    for number, status, words in statuses:
        signal.signal(number, _ender(session, wake, status, words))
    signal.signal(signal.SIGWINCH, lambda *_: wake.set())


def _ender(session: Session, wake: Wake, status: int, words: str) -> Any:
    def end(*_: Any) -> None:
        session.end(status, words)
        wake.set()

    return end
