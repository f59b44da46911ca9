"""What a platform did not record, from its files alone: whoever watched, or nobody.

Each recorder of a group writes the next file. Between two files of a group there is a gap when the first was not closed
or when the machine saw its recorder end; it lasts from the last message of the one to the first of the other, by their
record times. A group whose last file was not closed may have missed all that came after it.
"""

from __future__ import annotations

import re
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence

from .header_numbers import Numbers, Stream, between

__all__ = ["Account", "Written", "account", "written"]

_S = 1_000_000_000
_NAME = re.compile(r"(.+)-(\d\d+)(?:_(\d+))?\.bag(\.active)?")
_UNSEEN = "its file was not closed, and nobody saw it end"


class Written(NamedTuple):
    """One file of a recorder.

    Args:
        group: that it recorded.
        number: of the recorder in the session.
        split: number of the file of that recorder.
        closed: whether the recorder closed it.
        first_ns: time of the first message; None: there is none.
        last_ns: time of the last one.
        numbers: in the headers of its messages.
    """

    group: str
    number: int
    split: int = 0
    closed: bool = True
    first_ns: Optional[int] = None
    last_ns: Optional[int] = None
    numbers: Mapping[Stream, Numbers] = {}


class Account(NamedTuple):
    """What was not recorded.

    Args:
        gaps: times in which a group was not recorded, with the numbers that are missing over each.
        missing: numbers that are missing elsewhere, by topic.
        open_ends: time of the last message of each group whose last file was not closed.
    """

    gaps: List[Dict[str, Any]]
    missing: Dict[str, int]
    open_ends: Dict[str, int]


def written(name: str) -> Optional[Written]:
    """Return what the name of a recorder's file tells; None when it is no such name."""
    match = _NAME.fullmatch(name)
    if match is None:
        return None
    return Written(match[1], int(match[2]), int(match[3] or 0), closed=match[4] is None)


def account(files: Iterable[Written], gaps: Sequence[Mapping[str, Any]]) -> Account:
    """Return what was not recorded.

    Args:
        files: of the part.
        gaps: that the machine saw.
    """
    found = Account([dict(each) for each in gaps], {}, {})
    by_group: Dict[str, List[Written]] = {}
    for each in sorted(files, key=lambda each: (each.group, each.number, each.split)):
        by_group.setdefault(each.group, []).append(each)
    for group, mine in by_group.items():
        _account_group(found, group, [each for each in mine if each.last_ns is not None])
        if mine and not mine[-1].closed:
            _account_end(found, group, mine)
    return found


def _account_group(found: Account, group: str, files: List[Written]) -> None:
    for each in files:
        for (topic, _), numbers in each.numbers.items():
            _add(found.missing, topic, numbers.missing)
    for before, after in zip(files, files[1:]):
        missing = _missing_between(before, after)
        gap = None if before.number == after.number else _gap(found, group, before, after)
        if gap is None:
            for topic, count in missing.items():
                _add(found.missing, topic, count)
            continue
        gap["seconds"] = max(0, (after.first_ns or 0) - (before.last_ns or 0)) / _S
        if sum(missing.values()):
            gap["missing"] = sum(missing.values())


def _gap(found: Account, group: str, before: Written, after: Written) -> Optional[Dict[str, Any]]:
    """Return the gap between two recorders, noted or not; None when the first was ended as it should be."""
    seen = [
        gap
        for gap in found.gaps
        if gap["group"] == group and before.number < gap["file"] <= after.number and not gap.get("inside")
    ]
    for again in seen[1:]:  # recorders in between wrote nothing: it is one gap
        found.gaps.remove(again)
    if seen:
        return seen[0]
    if before.closed:
        return None
    found.gaps.append({"group": group, "file": after.number, "seconds": 0.0, "ending": _UNSEEN})
    return found.gaps[-1]


def _account_end(found: Account, group: str, files: List[Written]) -> None:
    """Note the end of a group whose last file is open, unless the machine saw the gap that follows."""
    last = max((each.last_ns for each in files if each.last_ns is not None), default=None)
    seen = any(gap["group"] == group and gap["file"] > files[-1].number for gap in found.gaps)
    if last is not None and not seen:
        found.open_ends[group] = last


def _missing_between(before: Written, after: Written) -> Dict[str, int]:
    missing: Dict[str, int] = {}
    for stream, numbers in before.numbers.items():
        if stream in after.numbers:
            _add(missing, stream[0], between(numbers, after.numbers[stream]))
    return missing


def _add(counts: Dict[str, int], topic: str, count: int) -> None:
    if count:
        counts[topic] = counts.get(topic, 0) + count
