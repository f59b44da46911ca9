"""One console at work: the desk, the link, and when it is over. The screen and the plain mode both drive it."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from typing import Callable, Optional

from ..engine.state import Result
from . import dialog
from .link import (
    AnswerCame,
    CollectingCame,
    Happening,
    Link,
    LinkClosed,
    LinkSays,
    Mailbox,
    MessagesCame,
    MissionsCame,
    MissionWanted,
    StateCame,
)
from .model import Desk, RequestKind, Snapshot, Verdict

CLOSED, NO_ROS, NOT_COMPLETE, NO_ENGINE, INTERRUPTED = 0, 2, 3, 4, 130
COMPLETE, NOT_SELECTED = 0, 2
_LOST_DATA = "mission_ended_incomplete"  # the key of a message


def _wall_clock() -> str:
    return time.strftime("%H:%M:%S")


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True  # somebody else's
    return True


class Session:
    """Applies what happens to the desk, in one thread.

    Args:
        desk: at the start.
        link: to the engine.
        mailbox: that the link fills.
        once: end when a mission has ended, and none is queued behind it; no other end is a good one then.
        wait_s: how long to wait for the engine's first state; None: for ever.
        pid: of the process with which it ends; None: with none.
        now: monotonic time in seconds.
        clock: wall time as it is shown.
    """

    def __init__(
        self,
        desk: Desk,
        link: Link,
        mailbox: Mailbox,
        *,
        once: bool = False,
        wait_s: Optional[float] = None,
        pid: Optional[int] = None,
        now: Callable[[], float] = time.monotonic,
        clock: Callable[[], str] = _wall_clock,
    ) -> None:
        self.desk = replace(desk, started_s=now())
        self.status: Optional[int] = None
        self.last_words = ""
        self.now = now
        self.clock = clock
        self._link, self._mailbox = link, mailbox
        self._once, self._wait_s, self._pid = once, wait_s, pid
        self._begun, self._all_complete = False, True

    def turn(self) -> None:
        """Take in what has happened, and what time has brought."""
        for happening in self._mailbox.empty():
            self._apply(happening)
        self._take(dialog.tick(self.desk, self.now()))
        self._look_for_a_mistake()
        if self.desk.snapshot is None and self._wait_s is not None and self.now() - self.desk.started_s > self._wait_s:
            self.end(NO_ENGINE, f"No engine on {self.desk.engine} within {self._wait_s:g} s.")
        if self._pid is not None and not _runs(self._pid):
            self.end(CLOSED, f"Process {self._pid} has ended.")

    def press(self, key: str) -> None:
        """Take in a key."""
        self._take(dialog.press(self.desk, key, self.now()))

    def typed(self, line: str) -> None:
        """Take in a line."""
        self._take(dialog.typed(self.desk, line, self.now()))

    def end(self, status: int, words: str = "") -> None:
        """Let it be over; the first to say so is heard."""
        self._end(NOT_COMPLETE if self._once and status == CLOSED else status, words)

    def _end(self, status: int, words: str) -> None:
        if self.status is None:
            self.status, self.last_words = status, words

    def farewell(self) -> str:
        """Return what is said at the end: how it ended, and that nothing else has ended by it."""
        snapshot = self.desk.snapshot
        if snapshot is None:
            return self.last_words or "Console closed."
        flying = ", IN FLIGHT" if snapshot.in_flight else ""
        nothing_else = f"Console closed; that ends nothing else. The engine's last state: {snapshot.state}{flying}."
        return f"{self.last_words} {nothing_else}".strip()

    def _take(self, turn: dialog.Turn) -> None:
        self.desk, requests = turn
        for request in requests:
            if request.kind is RequestKind.QUIT:
                self.end(CLOSED)
            else:
                self._link.send(request)

    def _apply(self, happening: Happening) -> None:
        if isinstance(happening, StateCame):
            self.desk = dialog.received(self.desk, happening.snapshot, self.now(), happening.age_s)
            self._look_for_the_end(happening.snapshot)
        elif isinstance(happening, CollectingCame):
            said = replace(happening.collecting, at_s=self.now() - happening.age_s)
            self.desk = replace(self.desk, collecting=said)
        elif isinstance(happening, MessagesCame):
            before = self.desk
            self.desk = dialog.noted(before, happening.run, happening.notes)
            self._look_for_lost_data(before)
        elif isinstance(happening, MissionsCame):
            self.desk = dialog.listed(self.desk, happening.request_id, happening.missions)
        elif isinstance(happening, AnswerCame):
            answer = happening
            self.desk = dialog.answered(self.desk, answer.request_id, answer.verdict, answer.message, self.now())
        elif isinstance(happening, MissionWanted):
            self.desk = replace(self.desk, wanted=self.desk.wanted or happening.missions)
        elif isinstance(happening, LinkSays):
            self.desk = replace(self.desk, link=happening.text, engine=happening.engine or self.desk.engine)
        elif isinstance(happening, LinkClosed):
            self.end(NO_ROS if happening.failed else CLOSED, happening.reason)

    def _look_for_the_end(self, snapshot: Snapshot) -> None:
        if not self._once:
            return
        if not snapshot.takes_mission:
            self._begun = self._begun or not self.desk.wanted  # else it is that of somebody else
        elif self._begun:
            complete = snapshot.state == "MISSION_ENDED" and snapshot.result == Result.COMPLETE.value
            complete = complete and snapshot.data_result != "INCOMPLETE"
            if not snapshot.queue:
                status = COMPLETE if complete and self._all_complete else NOT_COMPLETE
                self._end(status, self._ended(snapshot, complete))
            self._all_complete = self._all_complete and complete

    def _ended(self, snapshot: Snapshot, complete: bool) -> str:  # noqa: FBT001
        data = ", data INCOMPLETE" if snapshot.data_result == "INCOMPLETE" else ""
        ended = f"Mission ended: {snapshot.result}{data}." if snapshot.result else "The mission was given up."
        before = " One before it was not, or its data is INCOMPLETE." if complete and not self._all_complete else ""
        return ended + before

    def _look_for_lost_data(self, before: Desk) -> None:
        """Remember the end of a mission that no state shows, for the next one begins at once: its message tells."""
        if self._begun and before.run:
            lost = any(note.key == _LOST_DATA for note in self.desk.notes_since(before))
            self._all_complete = self._all_complete and not lost

    def _look_for_a_mistake(self) -> None:
        """End where the mission that was named is not selected, and nobody can name another."""
        desk, answer = self.desk, self.desk.answer
        if not self._once or desk.interactive or desk.requests:
            return
        if answer is not None and answer.request.startswith("mission "):
            if answer.verdict is Verdict.REFUSED:
                self._end(NOT_SELECTED, f"{answer.request}: {answer.verdict.value} {answer.message}")
        elif desk.error and not self._begun:
            self._end(NOT_SELECTED, desk.error)
