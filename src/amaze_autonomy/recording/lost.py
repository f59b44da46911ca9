"""What was lost of a recording, in words: one line each for the manifest, the last line and the operator."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Optional, Sequence, Set, Tuple

from .accounts import written

__all__ = ["losses"]

_S = 1_000_000_000
_LEAST_NS = 100_000_000


def losses(content: Mapping[str, Any], end_ns: Optional[int] = None) -> List[str]:
    """Return what a part has lost.

    Args:
        content: its list (`parts.py`).
        end_ns: when the recording was to end, on the platform's clock; None: unknown.
    """
    known = _accounted(content, end_ns)
    found = [words for entry in content["files"] for words in _of_file(entry, known)]
    found += _of_gaps(content.get("gaps", []))
    found += _of_ends(content.get("open_ends", {}), end_ns)
    return found + _of_drops(content.get("dropped", 0), content.get("missing", {}))


def _accounted(content: Mapping[str, Any], end_ns: Optional[int]) -> Set[Tuple[str, int]]:
    """Return the open files, by group and number, after which a gap is told: what their ends lack is in it."""
    found = {(str(gap["group"]), int(gap["file"]) - 1) for gap in content.get("gaps", []) if not gap.get("inside")}
    if end_ns is not None:
        for entry in content["files"]:
            file = written(str(entry.get("recovered_from", "")))
            if file is not None and file.group in content.get("open_ends", {}):
                found.add((file.group, file.number))
    return found


def _of_file(entry: Mapping[str, Any], accounted: Set[Tuple[str, int]]) -> List[str]:
    lost, file = entry.get("lost", 0), written(str(entry.get("recovered_from", "")))
    if lost is None and file is not None and not file.closed and (file.group, file.number) in accounted:
        return []
    if lost is None:
        return [f"{entry['file']}: an unknown number of messages"]
    return [f"{entry['file']}: {lost:,} messages"] if lost else []


def _of_gaps(gaps: Sequence[Mapping[str, Any]]) -> List[str]:
    """Return the times in which a group was not recorded, one line for each group and cause."""
    found: Dict[Tuple[str, str], List[Mapping[str, Any]]] = {}
    for gap in gaps:
        found.setdefault((gap["group"], gap["ending"]), []).append(gap)
    return [_of_cause(group, ending, mine) for (group, ending), mine in found.items()]


def _of_cause(group: str, ending: str, gaps: Sequence[Mapping[str, Any]]) -> str:
    times = "" if len(gaps) == 1 else f"{len(gaps)} times, together "
    missing = sum(gap.get("missing", 0) for gap in gaps)
    counted = f", at least {missing:,} messages," if missing else ","
    return (
        f"{group}: {times}{sum(gap['seconds'] for gap in gaps):.1f} s{counted} in which nothing was recorded ({ending})"
    )


def _of_ends(open_ends: Mapping[str, int], end_ns: Optional[int]) -> List[str]:
    """Return the ends of groups whose last file was not closed."""
    if end_ns is None:
        return []
    return [
        f"{group}: up to {(end_ns - last_ns) / _S:.1f} s at the end (its last file was not closed)"
        for group, last_ns in open_ends.items()
        if end_ns - last_ns >= _LEAST_NS
    ]


def _of_drops(warnings: int, missing: Mapping[str, int]) -> List[str]:
    counted = sum(missing.values())
    if not warnings and not counted:
        return []
    why = []
    if counted:
        topics = ", ".join(f"{count:,} of {topic}" for topic, count in sorted(missing.items()))
        why.append(f"by the numbers in headers: {topics}")
    if warnings:
        why.append(f"warnings of the recorder: {warnings}, one in 5 s at most; topics without numbers are not counted")
    most = max(warnings, counted)
    return [f"at least {most:,} message{'' if most == 1 else 's'} dropped ({'; '.join(why)})"]
