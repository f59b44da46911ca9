"""A console process on a link that has no ROS behind it: python3 fake_engine.py LOG SCENE [console arguments].

The link shows one scene, 2 Hz, answers every request DONE and appends it to LOG, one line each. A file LOG.silent makes
it silent; a command `abort` makes the console's own thread fail, as a defect would.
"""

from __future__ import annotations

import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Optional

from console_scenes import MISSIONS, SCENES

from amaze_autonomy.console.link import AnswerCame, Happening, Link, MissionsCame, StateCame
from amaze_autonomy.console.main import main
from amaze_autonomy.console.model import Request, RequestKind, Verdict
from amaze_autonomy.engine.events import UserCommand


class FakeLink(Link):
    """Shows one scene and writes down what is asked for."""

    def __init__(self, post: Callable[[Happening], None], log: Path, scene: str) -> None:
        self._post, self._log, self._scene = post, log, scene
        self._closed = threading.Event()

    def start(self) -> None:
        threading.Thread(target=self._run, daemon=True).start()

    def send(self, request: Request) -> None:
        if request.command is UserCommand.ABORT:
            raise ValueError("the console has a defect")
        if request.kind is RequestKind.LIST:
            self._post(MissionsCame(request.id, MISSIONS))
            return
        with self._log.open("a", encoding="utf-8") as out:
            out.write(f"{request.words}\n")
        threading.Thread(target=self._answer, args=(request,), daemon=True).start()

    def close(self) -> None:
        self._closed.set()

    def _answer(self, request: Request) -> None:
        self._post(AnswerCame(request.id, Verdict.DONE, "as asked"))

    def _run(self) -> None:
        snapshot = SCENES[self._scene].snapshot
        number = 0
        while snapshot is not None and not self._closed.is_set():
            if not Path(f"{self._log}.silent").exists():
                self._post(StateCame(replace(snapshot, waypoint=min(number // 10, snapshot.waypoints))))
            number += 1
            self._closed.wait(0.5)


def run(log: str, scene: str, *arguments: str) -> int:
    def make(post: Callable[[Happening], None], _engine: Optional[str], _quiet: bool) -> Any:  # noqa: FBT001
        return FakeLink(post, Path(log), scene)

    return main(list(arguments), make)


if __name__ == "__main__":
    sys.exit(run(*sys.argv[1:]))
