#!/usr/bin/env python3
"""How many of our modules does one thing go through? `./run bench modules_entered`: each path, its count, its bar.

    live code 16   from the socket on which the watchdog's message comes to the socket on which LAND goes out
    decide         of that the engine alone: one call of `decide`
    bag to verdict a scenario on a recorded flight: from the command line to PASS, everything in one process

A module counts when a function of it, or of a class in it, is called; with --names they are listed. The status is 1
when a bar is missed. What is called but once, at the import, does not count: the path is warm.
"""

from __future__ import annotations

import argparse
import io
import socket
import struct
import sys
import threading
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any, Iterator, List, Set

HERE = Path(__file__).resolve().parent
for _folder in ("engine", "nodes"):
    sys.path.insert(0, str(HERE.parent / _folder))

from engine_beginnings import at  # noqa: E402
from test_inbox import Desk, action  # noqa: E402

from amaze_autonomy.engine.commands import MissionCommand  # noqa: E402
from amaze_autonomy.engine.decide import decide  # noqa: E402
from amaze_autonomy.engine.events import WatchdogAction  # noqa: E402
from amaze_autonomy.engine.rules import Code  # noqa: E402
from amaze_autonomy.engine.timers import next_deadline  # noqa: E402
from amaze_autonomy.interface import SERVICES  # noqa: E402
from amaze_autonomy.nodes.autonomy.engine_thread import EngineThread  # noqa: E402
from amaze_autonomy.nodes.autonomy.requests import Requests  # noqa: E402
from amaze_autonomy.ros.interface import SERVICE_CLASSES  # noqa: E402
from amaze_autonomy.ros.service_client import Connection, ServiceClient  # noqa: E402
from amaze_autonomy.tester.command import main as replay_main  # noqa: E402

PACKAGE = f"{Path(decide.__code__.co_filename).parents[1]}/"
SCENARIO = HERE.parent / "scenarios" / "demo_flight.scenario.yaml"
BARS = (("live code 16", 14), ("decide", 8), ("bag to verdict", 110))


@contextmanager
def entered(found: Set[str]) -> Iterator[None]:
    """Collect the modules of ours in which a function is called meanwhile, on all threads."""

    def look(frame: Any, what: str, _: Any) -> None:
        code = frame.f_code
        if what == "call" and code.co_name != "<module>" and code.co_filename.startswith(PACKAGE):
            found.add(code.co_filename[len(PACKAGE) :])

    threading.setprofile(look)
    sys.setprofile(look)
    try:
        yield
    finally:
        sys.setprofile(None)
        threading.setprofile(None)


def live() -> Set[str]:
    """Return what a code 16 enters on its way through the engine's process in flight."""
    story, desk = at("MISSION flying").after(1.0), Desk()
    desk.clock.ns = story.now
    clients = {each: ServiceClient(each, SERVICE_CLASSES[each], "", "/bench") for each in SERVICES}
    requests = Requests(clients, lambda _: None, desk.clock.now_ns)
    found: Set[str] = set()
    for turn in range(2):  # the first one warms up
        ours, far = socket.socketpair()
        clients["mission_planner/command"]._idle.append(Connection(ours))
        far.settimeout(5.0)
        watchdog = desk.publisher("watchdog/action", f"/watchdog{turn}")
        nothing = (lambda _: None, lambda *_: None)
        shell = (story.rules, desk.clock, desk.inbox, requests.send, *nothing, story.state)
        thread = EngineThread(decide, next_deadline, *shell)
        desk.send(watchdog, action(16, counter=10_000))
        found.clear()
        with entered(found):
            thread._turn(0.0)
        (length,) = struct.unpack("<I", far.recv(4))
        if not far.recv(length):
            raise SystemExit("modules_entered: no LAND came out")
    desk.inbox.reader.close()
    return found


def decided() -> Set[str]:
    """Return what one call of `decide` enters that lands for a code 16."""
    found: Set[str] = set()
    story = at("MISSION flying").after(1.0)
    event = WatchdogAction(t_ns=story.now, sequence=1, loop_counter=10_000, code=Code.ABORT, latest_component="imu")
    with entered(found):
        _, commands = decide(story.state, event, story.rules)
    if not any(isinstance(each, MissionCommand) for each in commands):
        raise SystemExit("modules_entered: nothing was commanded")
    return found


def bag() -> Set[str]:
    """Return what a scenario on a recorded flight enters, from its command line to its verdict."""
    found: Set[str] = set()
    for _ in range(2):
        found.clear()
        with entered(found), redirect_stdout(io.StringIO()) as said:
            status = replay_main(["test", str(SCENARIO), "--jobs", "1"])
        if status:
            raise SystemExit(f"modules_entered: {SCENARIO.name} does not pass: {said.getvalue()[-500:]}")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--names", action="store_true", help="list them")
    options = parser.parse_args()
    missed: List[str] = []
    for (words, bar), names in zip(BARS, (live(), decided(), bag())):
        print(f"{words:16}{len(names):5} modules, bar {bar}{'' if len(names) <= bar else '  MISSED'}")
        if options.names:
            print(*(f"    {name}" for name in sorted(names)), sep="\n")
        missed += [words] if len(names) > bar else []
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
