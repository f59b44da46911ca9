"""Choosing from the list of missions: what was typed, and what is wrong with it."""

from __future__ import annotations

from difflib import get_close_matches
from typing import List, Optional, Tuple

from .model import MissionRow
from .text import clean
from .words import duration, fraction

__all__ = ["chosen", "mission_question"]


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
            return (), _unknown(name, [each.id for each in missions])
        if row.error:
            return (), f"Mission {name} cannot be flown: {row.error}"
    return ids, ""


def _unknown(name: str, known: List[str]) -> str:
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
