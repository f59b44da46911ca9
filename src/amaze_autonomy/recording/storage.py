"""Where everything of a session lies, whether there is space for it, and what may be removed.

FOLDER/SESSION_MISSION/             one per session, on each platform
    PLATFORM/                       what a platform recorded; on the collector also what was fetched
        GROUP-01.bag  GROUP.log     one bag per recorder, a further one where it had to be started again
        parts.json                  the bags, with bytes, messages and sha256; losses
    journal.jsonl  configuration/   of the engine
    SESSION_MISSION.bag             the complete recording, and SESSION_MISSION.manifest.json
"""

from __future__ import annotations

import json
import logging
import math
import re
import shutil
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any, Callable, Dict, FrozenSet, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.recover.recover import undo_is_of, undo_path
from amaze_autonomy.config.schemas.recording import Storage, TopicGroup
from amaze_autonomy.files import sha256_of, write_whole
from amaze_autonomy.units import GB, MB

from .errors import FolderError
from .status import Space

# --- folders and files ------------------------------------------------------------------------------------------------


PARTS = "parts.json"
STATE = ".recorder-{platform}.json"
LOCK = ".recorder-{platform}.lock"


def session_name(session_id: str, mission_id: str) -> str:
    """Return the name of a session's folder: time and mission are in it."""
    name = f"{session_id}_{mission_id}" if mission_id else session_id
    return re.sub(r"[^A-Za-z0-9_.+-]", "-", name).lstrip(".")[:200] or "session"


def write_json(path: Path, value: Any) -> None:
    """Write a file so that a reader finds the old one or the new one.

    Raises:
        FolderError: It cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(value, indent=1, sort_keys=True) + "\n")
    except OSError as error:
        raise FolderError(
            f"{path}: cannot be written ({error.strerror}); make space, or choose another folder"
        ) from error


def read_json(path: Path) -> Optional[Dict[str, Any]]:
    """Return what a file holds; None when there is none, or it is no object of JSON."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return value if isinstance(value, dict) else None


def is_as_listed(path: Path, entry: Mapping[str, Any]) -> bool:
    """Tell whether a file is what the list of its part says of it, byte for byte; one that cannot be read is not."""
    with suppress(OSError):
        return path.is_file() and path.stat().st_size == entry.get("bytes") and sha256_of(path) == entry.get("sha256")
    return False


def aside(path: Path) -> Path:
    """Return a hidden name for a file that nothing has."""
    names = (path.with_name(f".{path.name}.bad{number if number > 1 else ''}") for number in count(1))
    return next(each for each in names if not each.exists())


def space_of(folder: Path) -> Optional[Space]:
    """Return the space of the storage that a folder lies on, or will lie on; None when nobody can say."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        usage = shutil.disk_usage(folder)
    except OSError:
        return None
    return Space(usage.free, usage.free / usage.total if usage.total else 0.0)


# --- the list of a part -----------------------------------------------------------------------------------------------
# A stranger may have written it. What is not there, or null, is not known; what cannot be makes it none.


_log = logging.getLogger(__name__)
Shape = Callable[[Any], bool]


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and value.isprintable()


def _is_sha256(value: Any) -> bool:
    return isinstance(value, str) and re.fullmatch("[0-9a-fA-F]{64}", value) is not None


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _is_length(value: Any) -> bool:
    return isinstance(value, (int, float)) and -math.inf < value < math.inf


def _or_null(shape: Shape) -> Shape:
    return lambda value: value is None or shape(value)


def _several(shape: Shape) -> Shape:
    return lambda value: isinstance(value, list) and all(map(shape, value))


def _by_name(shape: Shape) -> Shape:
    return lambda value: isinstance(value, dict) and all(map(shape, value.values()))


def _are_others(entries: Sequence[Mapping[str, Any]]) -> bool:
    return len({each["file"] for each in entries}) == len(entries)


def _object(needed: Mapping[str, Shape], others: Mapping[str, Shape]) -> Shape:
    shapes = {**needed, **others}

    def is_one(value: Any) -> bool:
        if not isinstance(value, dict) or not needed.keys() <= value.keys():
            return False
        return all(shape(value[key]) for key, shape in shapes.items() if key in value)

    return is_one


_CHECKSUMS = ("sha256", "changed", "listed_as")
_FILE = {"file": _is_name}
_TOLD = {
    "messages": _is_count,
    **dict.fromkeys(("lost", "lost_inside"), _or_null(_is_count)),
    **dict.fromkeys(_CHECKSUMS, _is_sha256),
    **dict.fromkeys(("recovered_from", "undo", "undo_damaged", "problem"), _is_text),
}
_WHOLE = _object({**_FILE, "bytes": _is_count, "sha256": _is_sha256}, _TOLD)
_UNREADABLE = _object({**_FILE, "unreadable": bool}, _TOLD)  # it has no checksum
_GAP = _object(
    {"group": _is_text, "file": _is_count, "seconds": _or_null(_is_length), "ending": _is_text},
    {"from_ns": _or_null(_is_count), "to_ns": _or_null(_is_count), "missing": _is_count},
)
_SAYS_NULL = ("lost", "lost_inside", "seconds", "from_ns", "to_ns")
_ENDS = 2  # from when to when
_SPAN = _several(_or_null(_is_count))
_SHAPES: Mapping[str, Shape] = {
    "files": lambda value: _several(lambda each: _UNREADABLE(each) or _WHOLE(each))(value) and _are_others(value),
    "logs": _several(_is_name),
    "topics": _by_name(_several(_is_text)),
    "gaps": _several(_GAP),
    "recorded": _by_name(lambda each: _SPAN(each) and len(each) == _ENDS),
    **dict.fromkeys(("open_ends", "missing"), _by_name(_is_count)),
    "dropped": _is_count,
    **dict.fromkeys(("uncounted", "gone", "foreign", "set_back"), _several(_is_text)),
}


def read_parts(folder: Path) -> Optional[Dict[str, Any]]:
    """Return the list of a part, checksums in small letters; None when there is none, or it says what cannot be."""
    content = read_json(folder / PARTS)
    if content is None:
        return None
    known = {key: _known(value) if key in _SHAPES else value for key, value in content.items() if value is not None}
    wrong = [key for key, shape in _SHAPES.items() if key in known and not shape(known[key])]
    if wrong or "files" not in known:
        _log.warning("%s: %s: that cannot be", folder / PARTS, ", ".join(wrong or ["files"]))
        return None
    gaps, set_back = told_gaps(known.get("gaps", ()))
    if set_back:  # an earlier version wrote it
        known.update(gaps=gaps, set_back=list(dict.fromkeys((*known.get("set_back", ()), *set_back))))
    return {**known, "files": [{**each, **_small(each)} for each in known["files"]]}


def _known(value: Any) -> Any:
    """Return what a key of a list holds without what is null in its objects, but where null says something."""
    if isinstance(value, list):
        return [_known(each) for each in value]
    if isinstance(value, dict):
        return {key: _known(each) for key, each in value.items() if each is not None or key in _SAYS_NULL}
    return value


def told_gaps(gaps: Sequence[Mapping[str, Any]]) -> Tuple[List[Dict[str, Any]], List[str]]:
    """Return gaps, and the groups whose clock was set back by them: one is shorter than 0 s, and told as null."""
    back = [gap["seconds"] is not None and gap["seconds"] < 0 for gap in gaps]
    told = [{**gap, "seconds": None} if is_back else dict(gap) for gap, is_back in zip(gaps, back)]
    return told, list(dict.fromkeys(str(gap["group"]) for gap, is_back in zip(gaps, back) if is_back))


def _small(entry: Mapping[str, Any]) -> Dict[str, str]:
    """Return the checksums of an entry in small letters, as ours are."""
    return {key: str(entry[key]).lower() for key in _CHECKSUMS if key in entry}


# --- a part that is fetched again -------------------------------------------------------------------------------------
# Where it lies it may have gone bad since it came: changed, cut, or gone. What is whole here stays, and is used.


_SUFFIX = re.compile(r"(\.recovered)*\.bag(\.active)?$")


def recording_of(name: str) -> str:
    """Return the name of what a recorder wrote, whether a file is that or was recovered from it."""
    return _SUFFIX.sub("", name)


def joined(folder: Path, sent: Mapping[str, Any]) -> Tuple[Dict[str, Any], FrozenSet[str]]:
    """Return the list of a part that is fetched again, and the files that it has of the list before.

    Those came whole, and their platform has them no more as they were. Who lists a part tells what its files lack: of
    files that are here after all, too much may be told, and never too little.

    Args:
        folder: of the part here, with the list of what came before.
        sent: the list as its platform has it now.
    """
    before = read_parts(folder) or {"files": []}
    kept: Dict[str, Mapping[str, Any]] = {}
    entries: List[Mapping[str, Any]] = []
    for entry in sent["files"]:
        was = _came_whole(folder, entry, before)
        if was is not None:
            kept[str(was["file"])] = was
        entries.append(was or entry)
    recorded = {recording_of(str(each["file"])) for each in sent["files"]}
    gone = [each for each in before["files"] if recording_of(str(each["file"])) not in recorded]
    kept.update({str(each["file"]): each for each in gone if is_as_listed(folder / str(each["file"]), each)})
    if not kept:
        return dict(sent), frozenset()
    entries += [each for each in gone if str(each["file"]) in kept]
    entries.sort(key=lambda each: str(each["file"]))
    if _same_files(entries, before["files"]) and all(before.get(key) == sent.get(key) for key in ("seen", "dropped")):
        return before, frozenset(kept)  # nothing was recorded since: it lacks what it lacked then
    missing = {
        topic: max(each.get("missing", {}).get(topic, 0) for each in (before, sent))
        for topic in {**before.get("missing", {}), **sent.get("missing", {})}
    }
    content = {**sent, "files": entries, "missing": missing}
    content["gone"] = [name for name in sent.get("gone", ()) if name not in kept]
    return content, frozenset(kept)


def _same_files(one: Sequence[Mapping[str, Any]], other: Sequence[Mapping[str, Any]]) -> bool:
    names = [sorted((str(each["file"]), str(each.get("sha256"))) for each in entries) for entries in (one, other)]
    return names[0] == names[1]


def _came_whole(folder: Path, entry: Mapping[str, Any], before: Mapping[str, Any]) -> Optional[Mapping[str, Any]]:
    """Return what to list for an entry whose file is not what was listed first: what came before it, if it is here."""
    firsts = ((entry.get("recovered_from"), entry.get("listed_as")), (entry["file"], entry.get("changed")))
    for name, first in firsts:
        if not name or not first or entry.get("sha256") == first:
            continue
        for was in before["files"]:
            same = was["file"] == name and first in (was.get("sha256"), was.get("changed"))
            if same and is_as_listed(folder / str(name), was):
                return dict(was)
        path = folder / str(name)
        here = {"file": name, "bytes": path.stat().st_size if path.is_file() else 0, "sha256": first, "lost": None}
        if is_as_listed(path, here):  # the list before is gone: what it lacked nobody knows
            return here
    return None


# --- space ------------------------------------------------------------------------------------------------------------


_MARGIN = 1.5  # a mission holds, and collects


def reserve_bytes(storage: Storage) -> int:
    """Return the free space at which recording stops."""
    return storage.reserve_mb * MB


def needed_bytes(storage: Storage, groups: Sequence[TopicGroup], duration_s: float) -> int:
    """Return the free space that a mission of this length needs on a platform that records these groups."""
    expected = sum(group.expected_mb_s for group in groups) * MB * duration_s * _MARGIN
    return max(round(storage.min_free_gb * GB), reserve_bytes(storage) + round(expected))


def too_little(storage: Storage, needed: int, space: Space, folder: str) -> str:
    """Return why there is too little space to begin; an empty text when there is enough."""
    if space.free_bytes < needed:
        return (
            f"{space.free_bytes / GB:.2f} GB are free in {folder}, {needed / GB:.2f} GB are needed for this mission: "
            "make space"
        )
    if space.free_fraction < storage.min_free_fraction:
        return (
            f"{space.free_fraction:.1%} of the storage of {folder} is free, at least {storage.min_free_fraction:.1%} "
            "must be: make space"
        )
    return ""


def time_left_s(space: Optional[Space], rate: float, reserve: int) -> Optional[float]:
    """Return how long the space lasts at a rate in bytes per second; None when that is unknown."""
    if space is None or not rate > 0.0:
        return None
    return max(0, space.free_bytes - reserve) / rate


# --- removal ----------------------------------------------------------------------------------------------------------


def remove_part(folder: Path, recordings: Path, verified: Mapping[str, str]) -> None:
    """Remove what is in the verified recording: files that the list of a part names, each with its undo file.

    A damaged file that one of them was recovered from stays: nothing has verified that all that it holds was found. So
    does an undo file that lies there for another bag of that name: it is the only way back to that one's original.

    Args:
        folder: of the part.
        recordings: the folder of all recordings; nothing is removed outside of it.
        verified: names of files and their sha256, as the manifest of the verified recording has them. A file that is
            otherwise, by the list or on the disk, stays.
    """
    content = read_parts(folder)
    if content is None or folder.parent.parent != recordings:
        _log.warning("%s is no part of a session here; nothing is removed", folder)
        return
    for entry in content["files"]:
        path, proof = folder / str(entry["file"]), verified.get(str(entry["file"]))
        if path.parent != folder or not path.is_file():
            continue
        if not proof or proof != entry.get("sha256") or proof != sha256_of(path):
            _log.warning("%s is not in the verified recording as it is here: it is kept", path)
            continue
        undo = folder / str(entry.get("undo") or path.name)
        if undo == undo_path(path) and undo.is_file() and _is_done_with(path):
            undo.unlink()
        path.unlink()


def _is_done_with(bag: Path) -> bool:
    """Return whether nobody needs the undo file of a bag once the bag is gone: it is of that one, or of no use."""
    try:
        return undo_is_of(bag) is True
    except BagError:
        return True
