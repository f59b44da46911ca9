"""The plain mode: what differs between two moments, one line each, no colour, no cursor; and who prints that.

It reads lines where there are any, and never waits for them. One thread.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from math import floor
from typing import Dict, Iterator, List, Optional, TextIO, Tuple

from ..engine.events import SAFE, Check
from ..engine.events import Verdict as CheckVerdict
from .dialog import oldest_open
from .keys import binding_of_word, offered
from .model import Desk, MissionRow, PendingFailure, Snapshot, Verdict
from .session import CLOSED, Session
from .terminal import Wake, read_if_ready
from .wire import clean
from .words import age, duration, fraction, level, limits, quantity, seconds, waypoint_words

_SLOW_S = 3.0


def changes(before: Desk, before_s: float, after: Desk, after_s: float) -> List[str]:
    """Return a line for each thing that is different, the most important first."""
    return [
        *_contact(before, before_s, after, after_s),
        *_messages(before, after),
        *_engine(before.snapshot, after, after_s),
        *_recorders(before.troubles(before_s), after.troubles(after_s)),
        *_dialog(before, before_s, after, after_s),
    ]


def _contact(before: Desk, before_s: float, after: Desk, after_s: float) -> Iterator[str]:
    if after.link and after.link != before.link:
        yield f"WAIT      {after.link}"
    was, now = before.stale(before_s), after.stale(after_s)
    if now and not was:
        silent = seconds(after.age_s(after_s))
        yield f"CONTACT   LOST: the engine ({after.engine}) has been silent for {silent}. Watch the vehicle."
    elif was and not now:
        yield "CONTACT   the engine is heard again"


def _messages(before: Desk, after: Desk) -> Iterator[str]:
    """Yield each new message; of those before this console was there, the last one."""
    if after.notes == before.notes:
        return
    new = after.notes_since(before)
    if not before.run:
        shown = "" if before.snapshot is None else before.snapshot.message
        new = tuple(note for note in new[-1:] if note.text != shown)
    for note in new:
        yield f"{level(note.level):<9} {note.text}"


def _engine(before: Optional[Snapshot], desk: Desk, now_s: float) -> Iterator[str]:
    after = desk.snapshot
    if after is None or before == after:
        return
    old = before or Snapshot(state="")
    new_state = (old.state, old.step, old.in_flight) != (after.state, after.step, after.in_flight)
    if new_state or (old.session_id, old.mission_id) != (after.session_id, after.mission_id):
        yield _state_line(after)
    if (old.file_index, old.repetition) != (after.file_index, after.repetition):
        repetition = f"repetition {after.repetition + 1} of {after.repetitions}"
        yield f"PROGRESS  file {after.file_index + 1} of {after.files}, {repetition}"
    if not desk.run and after.message and (after.state, after.message) != (old.state, old.message):
        yield f"{level(after.message_level):<9} {after.message}"  # an engine that numbers none
    yield from _failures(old.failures, after.failures)
    yield from _checks(old.checks, after.checks)
    yield from _progress(old, after, desk.remaining_s(now_s))
    if after.waiting_for and after.waiting_for != old.waiting_for:
        yield f"WAIT      {after.waiting_for}"
    if after.advice and (after.state, after.advice) != (old.state, old.advice):
        yield f"ADVICE    {after.advice}"
    if after.data_location and after.data_location != old.data_location:
        yield f"DATA      {after.data_location}"
    if after.state == "MISSION_ENDED" and (old.state, old.result) != (after.state, after.result):
        yield f"RESULT    {after.result}" + (", data INCOMPLETE" if after.data_result == "INCOMPLETE" else "")
    if desk.interactive and after.user_commands != old.user_commands and after.user_commands:
        yield f"COMMANDS  {', '.join(each.command.value.replace('_', ' ') for each in offered(after))}"


def _state_line(after: Snapshot) -> str:
    step = f" ({after.step.replace('_', ' ')})" if after.step else ""
    flying = ", IN FLIGHT" if after.in_flight else ""
    mission = f", mission {after.mission_id} {after.mission_description}".rstrip() if after.mission_id else ""
    left = "" if after.time_left_s is None else f", {seconds(after.time_left_s)} left"
    return f"STATE     {after.state}{step}{flying}{mission}{left}"


def _failures(old: Tuple[PendingFailure, ...], new: Tuple[PendingFailure, ...]) -> Iterator[str]:
    known: Dict[str, PendingFailure] = {each.name: each for each in old}
    for failure in new:
        last = known.pop(failure.name, None)
        if last is None or (last.code, last.action, last.fallback) != (failure.code, failure.action, failure.fallback):
            limit = f" ({failure.limit})" if failure.limit else ""
            left = "" if failure.time_left_s is None else f", {seconds(failure.time_left_s)} left{limit}"
            then = f", then {failure.fallback}" if failure.fallback else ""
            code = f" code {failure.code}" if failure.code else ""
            cause = f" [{failure.cause}]" if failure.cause else ""
            yield f"FAULT     {failure.name}{code}: {failure.action}{then}{left}: {failure.reason}{cause}"
    for name in known:
        yield f"CLEARED   {name}"


def _checks(old: Tuple[Check, ...], new: Tuple[Check, ...]) -> Iterator[str]:
    known: Dict[str, List[CheckVerdict]] = {}
    for each in old:
        known.setdefault(each.name, []).append(each.verdict)
    for check in new:
        last = known.get(check.name)
        if (last.pop(0) if last else None) != check.verdict:
            yield _check_line(check)


def _check_line(check: Check) -> str:
    value = quantity(check.value, check.unit)
    limit = "" if check.limit is None else f", limit {limits(check)}"
    old = "" if check.age_s is None else f", age {age(check.age_s)}"
    advice = f": {check.advice}" if check.advice and check.verdict is not CheckVerdict.PASS else ""
    return f"CHECK     {check.verdict.value.upper():<7} {check.name} {value}{limit}{old}{advice}"


def _progress(old: Snapshot, new: Snapshot, left_s: Optional[float]) -> Iterator[str]:
    if new.waypoints and waypoint_words(old) != waypoint_words(new):
        yield f"PROGRESS  waypoint {waypoint_words(new)}"
    tenth = None if new.recording_progress is None else floor(new.recording_progress * 10)
    last = None if old.recording_progress is None else floor(old.recording_progress * 10)
    if new.recording_phase and (old.recording_phase, last) != (new.recording_phase, tenth):
        done = "" if new.recording_progress is None else f" {fraction(new.recording_progress)}"
        left = "" if left_s is None else f", about {seconds(left_s)} left"
        yield f"RECORDING {new.recording_phase.lower()}{done}{left}"


def _recorders(old: Tuple[str, ...], new: Tuple[str, ...]) -> Iterator[str]:
    for trouble in new:
        if trouble not in old:
            yield f"RECORDER  {trouble}"


def _dialog(before: Desk, before_s: float, after: Desk, after_s: float) -> Iterator[str]:
    if after.missions is not None and after.missions != before.missions:
        yield from mission_lines(after.missions)
    slow = oldest_open(after)
    if slow is not None and before_s - slow.sent_s <= _SLOW_S < after_s - slow.sent_s:
        yield f"ANSWER    {slow.words}: none for {_SLOW_S:.0f} s"
    answer = after.answer
    if answer is not None and answer != before.answer:
        yield f"ANSWER    {answer.request}: {answer.verdict.value} {answer.message}".rstrip()
    if after.error and after.error != before.error:
        yield f"INPUT     {after.error}"
    if after.question is not None and after.question != before.question:
        yield f"QUESTION  {after.question.text} Type y and Enter for yes, anything else for no."
    elif after.interactive and _asks_for_mission(after) and not _asks_for_mission(before):
        yield "QUESTION  Which mission? Type its id and Enter; several: 1 2 3."


def _asks_for_mission(desk: Desk) -> bool:
    answer = desk.answer
    if answer is not None and answer.verdict is Verdict.DONE and answer.request.startswith("mission "):
        return False  # selected; the engine's next state will say so
    listed = bool(desk.missions) and not desk.requests and not desk.wanted
    return desk.snapshot is not None and desk.snapshot.takes_mission and listed and desk.question is None


def mission_lines(missions: Tuple[MissionRow, ...]) -> Iterator[str]:
    """Return the list of missions."""
    if not missions:
        yield "MISSION   none: look at the engine's missions.yaml"
    for row in missions:
        numbers = f"{duration(row.duration_s)}, battery needed {fraction(row.battery_needed)}"
        about = f"CANNOT BE FLOWN: {row.error}" if row.error else numbers
        yield f"MISSION   {row.id}: {row.description or 'no description'} ({about})"


# --- printer ----------------------------------------------------------------------------------------------------------


_LOOK_S = 0.25
_LONGEST_LINE = 4096
_FLOW_KEYS = b"\x11\x13"  # Ctrl-Q, Ctrl-S: they freeze nothing, and are no letters
_QUIT_WORDS = ("q", "quit", "exit")


class _Lines:
    """Bytes made into lines; a line that is too long is dropped."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> List[str]:
        *lines, self._rest = (self._rest + data.translate(None, _FLOW_KEYS)).split(b"\n")
        if len(self._rest) > _LONGEST_LINE:
            self._rest = b""
        return [line[:_LONGEST_LINE].decode("utf-8", "replace") for line in lines]

    def close(self) -> List[str]:
        rest, self._rest = self._rest, b""
        return [rest.decode("utf-8", "replace")] if rest.strip() else []


class _Printer:
    """Prints what is different since the last time.

    Args:
        out: where to.
        session: that is looked at.
    """

    def __init__(self, out: TextIO, session: Session) -> None:
        self._out, self._session = out, session
        self._desk, self._seen_s = replace(session.desk), session.now()
        self.line(f"START     console of {session.desk.engine}, {time.strftime('%Y-%m-%d, local time %z')}")

    def look(self) -> None:
        desk, now_s = self._session.desk, self._session.now()
        for words in changes(self._desk, self._seen_s, desk, now_s):
            self.line(words)
        self._desk, self._seen_s = desk, now_s

    def line(self, words: str) -> None:
        """Print one line at once; a reader that has gone ends the console, nothing else."""
        try:
            self._out.write(f"{self._session.clock()} {words}\n")
            self._out.flush()
        except OSError:
            self._session.end(CLOSED)
            if self._out is sys.stdout:  # what is left in it would make the exit status 120
                os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def run_plain(session: Session, wake: Wake, source: Optional[int], out: Optional[TextIO] = None) -> None:
    """Run the console line by line until the session is over.

    Args:
        session: that is shown.
        wake: ends the wait for input.
        source: descriptor that lines are read from; None: nobody types.
        out: where to print; None: standard output.
    """
    session.desk = replace(session.desk, interactive=source is not None)
    printer = _Printer(out or sys.stdout, session)
    lines, waiting = _Lines(), []  # type: _Lines, List[str]
    while session.status is None:
        session.turn()
        waiting = _pass_on(session, waiting, printer)
        printer.look()
        if session.status is not None:
            break
        data = read_if_ready(source, wake, _LOOK_S)
        if data == b"":
            source = None
            session.desk = replace(session.desk, interactive=bool(waiting))
            waiting += lines.close()
        elif data is not None:
            waiting += lines.feed(data)
    printer.line(f"END       {session.farewell()}")


def _pass_on(session: Session, lines: List[str], printer: _Printer) -> List[str]:
    """Pass lines on as soon as they can mean something, and return the others: a script may be too early.

    What stops the vehicle or brings it down waits for nothing. What waits before it is dropped: nobody who asks for a
    landing wants the mission any more that he asked for before.
    """
    while lines:
        if not _means_something(session.desk, lines[0]):
            urgent = next((number for number, line in enumerate(lines) if _is_safe(line)), None)
            if urgent is None:
                return lines
            session.desk = replace(session.desk, error=f"Not sent: {', '.join(map(clean, lines[:urgent]))}.")
            printer.look()
            lines = lines[urgent:]
        session.typed(lines[0])
        printer.look()
        lines = lines[1:]
    return []


def _means_something(desk: Desk, line: str) -> bool:
    """Return True when a line can be passed on: what it may name is known, or it is taken at any time."""
    known = desk.snapshot is not None and (not desk.snapshot.takes_mission or desk.missions is not None)
    return known or line.strip().lower() in _QUIT_WORDS or _is_safe(line)


def _is_safe(line: str) -> bool:
    """Return True for a whole word that is sent at any time; a letter may be a mission's id."""
    binding = binding_of_word(line)
    return binding is not None and binding.command in SAFE
