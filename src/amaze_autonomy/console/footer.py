"""The foot of the screen, always visible: the answer, what was wrong with the input, the question, the keys."""

from __future__ import annotations

from typing import List

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from .dialog import oldest_open
from .keys import QUIT_KEY, offered
from .model import Desk
from .style import Style, Tone, tone_of_answer

__all__ = ["footer"]

_SLOW_S = 1.0


def footer(desk: Desk, now_s: float, width: int, style: Style) -> RenderableType:
    """Return the foot of the screen."""
    parts = _said(desk, now_s, style)
    if desk.question is not None:
        yes = "Y or Enter = yes" if desk.question.enter_is_yes else "Y = yes"
        parts.append(style.text(f"{desk.question.text}  {yes}, any other key = no", Tone.WARN))
    elif desk.interactive:
        parts.append(_keys(desk, style))
    return Group(style.text(style.rule * width), Padding(Group(*parts), (0, 1)))


def _said(desk: Desk, now_s: float, style: Style) -> List[RenderableType]:
    """Return what became of the last request, or that there is no answer yet, and what was wrong with the input."""
    parts: List[RenderableType] = []
    request = oldest_open(desk)
    if request is not None and now_s - request.sent_s >= _SLOW_S:
        parts.append(style.text(f"{request.words}: no answer for {now_s - request.sent_s:.0f} s", Tone.WARN))
    elif request is not None:
        parts.append(style.text(f"{request.words}: asked ..."))
    answer = desk.answer
    if answer is not None:
        verdict = style.label(answer.verdict.value, tone_of_answer(answer.verdict))
        parts.append(Text.assemble(f"{answer.request}: ", verdict, f" {answer.message}", overflow="fold"))
    if desk.error:
        parts.append(style.text(desk.error, Tone.BAD))
    return parts


def _keys(desk: Desk, style: Style) -> Text:
    keys = Text(overflow="fold")
    if desk.snapshot is not None and desk.snapshot.takes_mission:
        keys.append(f"mission id, then Enter (several: 1 2 3): {desk.entry}{style.cursor}  ", style.band(Tone.STRONG))
        for binding in offered(desk.snapshot):
            keys.append_text(style.label(f"{binding.key.upper()} Enter", Tone.INFO)).append(f" {binding.words}  ")
        keys.append_text(style.label("Ctrl-C", Tone.INFO)).append(" close console only")
        return keys
    for binding in offered(desk.snapshot):
        keys.append_text(style.label(binding.key.upper(), Tone.INFO)).append(f" {binding.words}   ")
    keys.append_text(style.label(QUIT_KEY.upper(), Tone.INFO)).append(" close console only")
    return keys
