"""What happens on the console's desk: states arrive, answers arrive, keys and lines are typed. Pure.

Every function takes the desk and the time and returns the next desk, with the requests to send where there can be any.
"""

from __future__ import annotations

from dataclasses import replace
from difflib import get_close_matches
from typing import List, Optional, Tuple

from amaze_autonomy.engine.events import SAFE, UserCommand

from .keys import QUIT_KEY, Binding, binding_of_key, binding_of_word, goes_out, offered
from .model import Answer, Desk, MissionRow, Note, Question, Request, RequestKind, Snapshot, Verdict
from .wire import clean
from .words import duration, fraction

_ANSWER_SHOWN_S = 15.0
_ANSWER_READ_S = 2.0  # it vanishes with the state that it was for, but not before it can be read
_QUESTION_OPEN_S = 10.0
_REQUEST_FORGOTTEN_S = 60.0
_LIST_AGAIN_S = 5.0
_ENTRY_LIMIT = 60
_TYPING_PAUSE_S = 2.0  # who types a line has pressed its next key by then
_SCROLLS = {"up": -1, "down": 1, "page up": -8, "page down": 8}

Turn = Tuple[Desk, Tuple[Request, ...]]


# --- the engine speaks ---


def received(desk: Desk, snapshot: Snapshot, now_s: float, age_s: float = 0.0) -> Desk:
    """Take in a state that is so old by now."""
    before = desk.snapshot
    if before is not None and not desk.heard(now_s):
        desk = _list_anew(desk)
    desk = desk.with_state(snapshot, now_s - age_s)
    if before is not None and before.state != snapshot.state:
        desk = replace(desk, scroll=0)
    if before is not None and before.takes_mission and not snapshot.takes_mission:
        desk = _cut(desk, now_s)
    return _drop_question_if_void(desk)


def _cut(desk: Desk, now_s: float) -> Desk:
    """Drop what is being typed; its other letters are on their way, and each would be a command."""
    if not desk.entry:
        return replace(desk, error="")
    error = f'Dropped: "{desk.entry}", and what follows up to Enter. No mission is taken any more.'
    return replace(desk, entry="", cut_s=now_s, error=error)


def noted(desk: Desk, run: str, notes: Tuple[Note, ...]) -> Desk:
    """Take in the engine's last messages, numbered in one run of it; another run may have other missions."""
    if desk.run not in ("", run):
        desk = _list_anew(desk)
    return replace(desk, run=run, notes=notes)


def _list_anew(desk: Desk) -> Desk:
    """Have the missions listed anew: what is known of them may be that of an engine which is gone."""
    desk = replace(desk, missions=None, listed_s=None)
    if desk.question is None or desk.question.request.kind is not RequestKind.SELECT:
        return desk
    words = desk.question.request.words
    return replace(desk, question=None, error=f"Not sent: {words}. The engine lists its missions anew: choose again.")


def _drop_question_if_void(desk: Desk) -> Desk:
    """Drop a question whose command would not be done any more."""
    if desk.question is None or desk.snapshot is None:
        return desk
    request = desk.question.request
    possible = (
        request.kind is RequestKind.QUIT
        or (request.kind is RequestKind.SELECT and desk.snapshot.takes_mission)
        or (request.command is not None and goes_out(request.command, desk.snapshot))
    )
    if possible:
        return desk
    return replace(desk, question=None, error=f"Not sent: {request.words} is not possible any more.")


def listed(desk: Desk, request_id: int, missions: Tuple[MissionRow, ...]) -> Desk:
    """Take in the list of missions; it answers a request."""
    return replace(desk, missions=missions, requests=tuple(each for each in desk.requests if each.id != request_id))


def answered(desk: Desk, request_id: int, verdict: Verdict, message: str, now_s: float) -> Desk:
    """Take in an answer; one to a request that is not open is dropped."""
    request = next((each for each in desk.requests if each.id == request_id), None)
    if request is None:
        return desk
    desk = replace(desk, requests=tuple(each for each in desk.requests if each.id != request_id))
    if request.kind is RequestKind.LIST:
        return desk
    return _said(desk, request.words, verdict, message, now_s)


def _said(desk: Desk, request: str, verdict: Verdict, message: str, now_s: float) -> Desk:
    state = "" if desk.snapshot is None else desk.snapshot.state
    return replace(desk, answer=Answer(request=request, verdict=verdict, message=message, at_s=now_s, state=state))


# --- time passes ---


def tick(desk: Desk, now_s: float) -> Turn:
    """Forget what is old; ask for the missions when they are needed; select what a parameter named."""
    if desk.answer is not None and now_s - desk.answer.at_s > _shown_s(desk, desk.answer):
        desk = replace(desk, answer=None)
    if desk.question is not None and now_s - desk.question.asked_s > _QUESTION_OPEN_S:
        desk = replace(desk, question=None, error=f"Not sent: {desk.question.request.words} was not confirmed in time.")
    desk = _fade_error(desk, now_s)
    requests = tuple(each for each in desk.requests if now_s - each.sent_s <= _REQUEST_FORGOTTEN_S)
    desk = replace(desk, requests=requests)
    if desk.snapshot is None or not desk.snapshot.takes_mission:
        return _forget_missions(desk), ()
    if not desk.heard(now_s):  # what was being typed is no key that goes out without contact, nor its beginning
        return desk if desk.listed_s is None else replace(desk, listed_s=None, entry=""), ()
    if desk.listed_s is None or (desk.missions is None and now_s - desk.listed_s > _LIST_AGAIN_S):
        return _send(replace(desk, listed_s=now_s), Request(kind=RequestKind.LIST), now_s)
    return _select_wanted(desk, now_s)


def _shown_s(desk: Desk, answer: Answer) -> float:
    """Return for how long an answer is shown."""
    there = desk.snapshot is None or desk.snapshot.state == answer.state
    return _ANSWER_SHOWN_S if there else _ANSWER_READ_S


def _fade_error(desk: Desk, now_s: float) -> Desk:
    """Forget what was wrong with an input after a while, unless a better one is waited for."""
    if desk.error != desk.error_since[0]:
        return replace(desk, error_since=(desk.error, now_s))
    waiting = desk.snapshot is not None and desk.snapshot.takes_mission
    return desk if waiting or now_s - desk.error_since[1] <= _ANSWER_SHOWN_S else replace(desk, error="")


def _forget_missions(desk: Desk) -> Desk:
    """Ask for the list anew when it is needed next: battery and files may differ then. Drop what cannot be selected."""
    desk = replace(desk, listed_s=None)
    if desk.snapshot is None or not desk.wanted:
        return desk
    wanted = ", ".join(desk.wanted)
    return replace(desk, wanted=(), error=f"Mission {wanted} was not selected: the engine is in {desk.snapshot.state}.")


def _select_wanted(desk: Desk, now_s: float) -> Turn:
    if not desk.wanted or desk.missions is None:
        return desk, ()
    ids, error = chosen(" ".join(desk.wanted), desk.missions)
    desk = replace(desk, wanted=(), error=error)
    return (desk, ()) if error else _send(desk, Request(kind=RequestKind.SELECT, missions=ids), now_s)


# --- the user types ---


def press(desk: Desk, key: str, now_s: float) -> Turn:
    """Take in one key: a letter, or "enter", "escape", "backspace", "clear", "quit", or one of `_SCROLLS`."""
    if key in _SCROLLS:
        lines = 0 if desk.snapshot is None else 40 + 2 * len(desk.snapshot.checks) + len(desk.notes)
        return replace(desk, scroll=min(lines, max(0, desk.scroll + _SCROLLS[key]))), ()
    if key == "quit":
        return desk, (Request(kind=RequestKind.QUIT),)
    if desk.cut_s is not None and now_s - desk.cut_s <= _TYPING_PAUSE_S:
        desk = replace(desk, cut_s=None if key in ("enter", "escape") else now_s)
        if not _counts_in_a_cut_line(desk, key):
            return desk, ()
    binding = binding_of_key(key)
    if desk.question is not None and not _lands_instead(desk.question, binding):
        yes = key.lower() == "y" or (key == "enter" and desk.question.enter_is_yes)
        return _reply(desk, desk.question, yes, now_s)
    if desk.question is None and desk.snapshot is not None and desk.snapshot.takes_mission:
        return _edit(desk, key, now_s)
    if key.lower() == QUIT_KEY:
        return _quit(desk, now_s)
    return (desk, ()) if binding is None else _command(desk, binding, now_s)


def _counts_in_a_cut_line(desk: Desk, key: str) -> bool:
    """Return whether a key counts before the end of a line that was dropped: L asks, all but that Enter answers."""
    return key != "enter" and (desk.question is not None or _is_land(binding_of_key(key)))


def _lands_instead(question: Question, binding: Optional[Binding]) -> bool:
    """Return whether a key asks for LAND, and not as the answer to that very question: it is held down then."""
    return _is_land(binding) and question.request.command is not UserCommand.LAND


def _is_land(binding: Optional[Binding]) -> bool:
    return binding is not None and binding.command is UserCommand.LAND


def typed(desk: Desk, line: str, now_s: float) -> Turn:
    """Take in one line: yes or no, mission ids, a command's name or its key, "quit"."""
    words = " ".join(line.split())
    named = binding_of_word(words)
    if desk.question is not None and named is not None and named.command in SAFE:
        return _command(replace(desk, question=None), named, now_s, sure=True)
    if desk.question is not None and _lands_instead(desk.question, binding_of_key(words)):
        return press(desk, words, now_s)
    if desk.question is not None:
        return _reply(desk, desk.question, words.lower() in ("y", "yes"), now_s)
    if not words:
        return desk, ()
    takes_mission = desk.snapshot is not None and desk.snapshot.takes_mission
    if takes_mission and desk.heard(now_s) and any(row.id == words for row in desk.missions or ()):
        return _choose(desk, words, now_s)
    if words.lower() in (QUIT_KEY, "quit", "exit"):
        return desk, (Request(kind=RequestKind.QUIT),)
    binding = named or binding_of_key(words)
    if binding is not None:
        return _command(desk, binding, now_s, sure=len(words) > 1)
    return _choose(desk, words, now_s) if takes_mission else (replace(desk, error=_unknown(desk, words, now_s)), ())


def _edit(desk: Desk, key: str, now_s: float) -> Turn:
    """Edit the line in which a mission is named."""
    if key == "enter":
        return typed(replace(desk, entry=""), desk.entry, now_s)
    if key in ("escape", "clear"):
        return replace(desk, entry="", error=""), ()
    if key == "backspace":
        return replace(desk, entry=desk.entry[:-1]), ()
    if len(key) == 1 and len(desk.entry) < _ENTRY_LIMIT:
        return replace(desk, entry=desk.entry + key), ()
    return desk, ()


def _choose(desk: Desk, words: str, now_s: float) -> Turn:
    if not desk.heard(now_s):
        return _no_contact(desk, f"mission {words}")
    if desk.missions is None:
        return replace(desk, error="The list of missions has not come yet; try again in a moment."), ()
    ids, error = chosen(words, desk.missions)
    if error:
        return replace(desk, error=error), ()
    question = mission_question(ids, desk.missions)
    return _ask(desk, question, Request(kind=RequestKind.SELECT, missions=ids), now_s, enter_is_yes=False), ()


def _unknown(desk: Desk, words: str, now_s: float) -> str:
    bindings = offered(desk.snapshot, heard=desk.heard(now_s))
    names = [f"{binding.command.value.replace('_', ' ')} ({binding.key})" for binding in bindings]
    return f'"{words}" is not a command. Possible now: {", ".join([*names, "quit"])}.'


def _command(desk: Desk, binding: Binding, now_s: float, *, sure: bool = False) -> Turn:
    request = Request(kind=RequestKind.COMMAND, command=binding.command)
    if not goes_out(binding.command, desk.snapshot, heard=desk.heard(now_s)):
        return _kept_back(desk, binding, request.words, now_s)
    if binding.question and not sure:
        return _ask(desk, binding.question, request, now_s, enter_is_yes=binding.enter_is_yes), ()
    return _send(desk, request, now_s)


def _kept_back(desk: Desk, binding: Binding, words: str, now_s: float) -> Turn:
    """Say why a command does not go out: what the engine would answer, as long as that is known."""
    if desk.snapshot is None or not desk.heard(now_s):
        return _no_contact(desk, words)
    known = desk.snapshot.answer_to(binding.command)
    if known is not None:  # what the engine would answer; asked, it might do it in a state that nobody has seen yet
        return _said(desk, words, known.verdict, known.message, now_s), ()
    return replace(desk, error=f"{words} is not possible now in {desk.snapshot.state}."), ()


def _no_contact(desk: Desk, words: str) -> Turn:
    safe = ", ".join(each.value for each in SAFE)
    return replace(desk, error=f"Not sent: {words}. No contact: only {safe} are sent."), ()


def _quit(desk: Desk, now_s: float) -> Turn:
    request = Request(kind=RequestKind.QUIT)
    if desk.snapshot is not None and desk.snapshot.in_flight:
        return _ask(desk, "Close this console? The flight goes on without it.", request, now_s), ()
    return desk, (request,)


def _ask(desk: Desk, text: str, request: Request, now_s: float, *, enter_is_yes: bool = True) -> Desk:
    question = Question(text=text, request=request, asked_s=now_s, enter_is_yes=enter_is_yes)
    return replace(desk, question=question, error="")


def _reply(desk: Desk, question: Question, yes: bool, now_s: float) -> Turn:  # noqa: FBT001
    desk = replace(desk, question=None)
    if not yes:
        return replace(desk, error=f"Not sent: {question.request.words}."), ()
    request = question.request
    if request.kind is not RequestKind.QUIT and request.command not in SAFE and not desk.heard(now_s):
        return _no_contact(desk, request.words)  # it was lost while the question was open
    return _send(desk, request, now_s)


def _send(desk: Desk, request: Request, now_s: float) -> Turn:
    if request.kind is RequestKind.QUIT:
        return desk, (request,)
    request = replace(request, id=desk.next_id, sent_s=now_s)
    answer = desk.answer if request.kind is RequestKind.LIST else None
    error = desk.error if request.kind is RequestKind.LIST else ""
    desk = replace(desk, next_id=desk.next_id + 1, requests=(*desk.requests, request), answer=answer, error=error)
    return desk, (request,)


def oldest_open(desk: Desk) -> Optional[Request]:
    """Return the oldest request of the user that is not answered."""
    return next((each for each in desk.requests if each.kind is not RequestKind.LIST), None)


# --- missions ---------------------------------------------------------------------------------------------------------
# Choosing from the list of missions: what was typed, and what is wrong with it.


def chosen(words: str, missions: Tuple[MissionRow, ...]) -> Tuple[Tuple[str, ...], str]:
    """Return the ids that were typed, separated by blanks or commas, and what is wrong; one of both is empty."""
    rows = {row.id: row for row in missions}
    if clean(words) in rows:
        ids: Tuple[str, ...] = (clean(words),)
    else:
        ids = tuple(clean(word) for word in words.replace(",", " ").split())
    if not ids:
        return (), "No mission was named."
    for name in ids:
        row = rows.get(name)
        if row is None:
            return (), _not_on_the_list(name, [each.id for each in missions])
        if row.error:
            return (), f"Mission {name} cannot be flown: {row.error}"
    return ids, ""


def _not_on_the_list(name: str, known: List[str]) -> str:
    near = get_close_matches(name, known, n=1)
    hint = f" Did you mean {near[0]}?" if near else ""
    there = f"There are: {', '.join(known)}." if known else "The engine knows no mission."
    return f'There is no mission "{name}".{hint} {there}'


def mission_question(ids: Tuple[str, ...], missions: Tuple[MissionRow, ...]) -> str:
    """Return the question that confirms a selection."""
    rows = [row for name in ids for row in missions if row.id == name]
    if len(rows) == 1:
        row = rows[0]
        about = f"{duration(row.duration_s)}, battery needed {fraction(row.battery_needed)}"
        return f"Fly mission {row.id}: {row.description or 'no description'} ({about})?"
    durations = [row.duration_s for row in rows]
    total: Optional[float] = None if None in durations else sum(each or 0.0 for each in durations)
    return f"Fly missions {', '.join(ids)}, one after the other ({duration(total)} in the air)?"
