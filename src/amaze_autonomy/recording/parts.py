"""What a platform recorded, made whole: open and damaged bags are recovered, and all are listed with their checksums.

What a recorder left open is closed where it lies: the bytes that this changes are in an undo file beside it. What is
damaged elsewhere than at its end is recovered into a new bag, and the original stays beside that. Where the storage has
no space for it, the open one is listed as it is: the collector makes it whole.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.recover.recover import read_undo, recover, recover_in_place, undo_path
from amaze_autonomy.whole_file import sha256_of

from .errors import TransferError
from .losses import Numbers, Stream, Written, account, header_numbers, recorded, written
from .programs import LogState, read_line
from .storage import PARTS, read_json, write_json

_RECOVERED = ".recovered.bag"
Progress = Callable[[int, int], None]


class Part(NamedTuple):
    """A bag that is whole: where it lies, and how many messages were lost by damage (None: nobody knows)."""

    path: Path
    lost: Optional[int]


def open_bags(folder: Path) -> List[Path]:
    """Return what recorders wrote, in order of name; not what was recovered from it."""
    found = [*folder.glob("*.bag"), *folder.glob("*.bag.active")]
    return sorted(path for path in found if not path.name.endswith(_RECOVERED) and not path.name.startswith("."))


def whole_bags(
    folder: Path, content: Mapping[str, Any], target: Path, progress: Optional[Progress] = None
) -> List[Part]:
    """Return a whole bag for each that the list of a part names, recovering into `target` what was left open.

    Raises:
        BagError: One cannot be recovered.
    """
    found = [_whole(folder / str(entry["file"]), target, progress) for entry in content["files"]]
    return [part for part in found if part is not None]


def _whole(path: Path, target: Path, progress: Optional[Progress]) -> Optional[Part]:
    if path.stat().st_size == 0:
        return None  # not a byte was written
    if path.name.endswith(".bag") and _is_good(path):
        return Part(path, 0)
    output = target / f"{path.name.split('.bag')[0]}{_RECOVERED}"
    if output.exists() and _is_good(output):
        return Part(output, _lost_before(target, output))
    target.mkdir(parents=True, exist_ok=True)
    done = recover(path, output, check_data=path.name.endswith(".bag"), replace=True, progress=progress)
    return Part(output, done.scan.lost)


def _lost_before(folder: Path, bag: Path) -> Optional[int]:
    """Return what an earlier recovery lost, as far as it is written down."""
    listed = (read_json(folder / PARTS) or {}).get("files", [])
    return next((each.get("lost") for each in listed if each.get("file") == bag.name), None)


def _is_good(path: Path) -> bool:
    try:
        Index(path).close()
    except BagError:
        return False
    return True


def close_parts(folder: Path, facts: Mapping[str, Any], progress: Optional[Progress] = None) -> Dict[str, Any]:
    """Make a platform's part whole and write its list; return the list.

    Args:
        folder: of the part.
        facts: of the recording, for the list: session, platform, gaps, dropped, when recorders were seen.
        progress: called with bytes done and all bytes.

    Raises:
        BagError: A bag is damaged beyond recovery.
        FolderError: The list cannot be written.
    """
    paths = open_bags(folder)
    meter = _Meter(sum(path.stat().st_size for path in paths), progress)
    entries: List[Dict[str, Any]] = []
    files: List[Written] = []
    for path in paths:
        size = path.stat().st_size
        listed = _listed(folder, path)
        entries += listed
        files += _written(folder, path, listed)
        meter.add(size)
    known = account(files, facts.get("gaps", []))
    logs = sorted(folder.glob("*.log"))
    content = {"parts": 1, **facts, **known._asdict(), "files": entries, "logs": [path.name for path in logs]}
    content["dropped"] = max(int(facts.get("dropped", 0)), sum(map(_warnings, logs)))
    content["recorded"] = recorded(files, known.gaps, facts.get("seen", {}))
    content["uncounted"] = _uncounted(folder, entries, files)
    write_json(folder / PARTS, content)
    return content


def _warnings(log: Path) -> int:
    """Return how often recorders said in a log that messages were dropped, whether or not somebody read it then."""
    state = LogState()
    with suppress(OSError), log.open(encoding="utf-8", errors="replace") as lines:  # then what was seen has to do
        for line in lines:
            state = read_line(state, line)
    return state.dropped


def _uncounted(folder: Path, entries: Sequence[Mapping[str, Any]], files: Sequence[Written]) -> List[str]:
    """Return the topics whose messages have no numbers, so that nobody can tell whether one is missing."""
    counted = {topic for file in files for (topic, _), numbers in file.numbers.items() if numbers.counts}
    topics: Set[str] = set()
    for entry in entries:
        if not entry.get("open"):
            with Index(folder / str(entry["file"])) as index:
                topics |= {each.topic for each in index.connections.values()}
    return sorted(topics - counted)


def _written(folder: Path, path: Path, listed: Sequence[Mapping[str, Any]]) -> List[Written]:
    """Return what is known of a file that a recorder wrote: times and numbers of what is whole of it."""
    file = written(str(listed[0].get("recovered_from", path.name)) if listed else path.name)
    if file is None:
        return []
    times: List[int] = []
    numbers: Dict[Stream, Numbers] = {}
    for entry in listed:
        if not entry.get("open"):
            whole = folder / str(entry["file"])
            with Index(whole) as index:
                filled = [chunk for chunk in index.chunks if chunk.messages]
                times += [each for chunk in filled for each in (chunk.start_ns, chunk.end_ns)]
            numbers = header_numbers(whole)
            if file.closed and entry.get("lost") != 0:  # damage is told as such
                numbers = {stream: each._replace(missing=0) for stream, each in numbers.items()}
    first_ns, last_ns = min(times, default=None), max(times, default=None)
    return [file._replace(first_ns=first_ns, last_ns=last_ns, numbers=numbers, empty=not listed)]


def _listed(folder: Path, path: Path) -> List[Dict[str, Any]]:
    """Return the entries of one recorded bag: itself, or what was recovered from it."""
    closed = _closed_in_place(path)
    if closed is not None:
        return [{**_entry(closed), **_before(closed)}]
    try:
        part = _whole(path, folder, None)
    except BagError as error:
        return [{**_entry(path), "open": True, "lost": None, "problem": str(error)}]
    if part is None:
        return []
    entry = {**_entry(part.path), "lost": part.lost}
    return [entry] if part.path == path else [{**entry, "recovered_from": path.name}]


def _closed_in_place(path: Path) -> Optional[Path]:
    """Return a bag that was closed where it lies, now or before; None where that cannot be, or has not to be."""
    if path.name.endswith(".bag"):
        return path if undo_path(path).exists() and _is_good(path) else None
    if path.stat().st_size == 0:
        return None
    try:
        return recover_in_place(path, check_data=False).path  # a merge looks at every message
    except BagError:
        return None  # it has to be copied, and if that cannot be either, the words are there


def _before(path: Path) -> Dict[str, Any]:
    """Return what the list says of a bag that was closed in place: its name before, what was lost, how to undo it."""
    undo = undo_path(path)
    try:
        was = read_undo(undo)
    except BagError:
        return {"recovered_from": f"{path.name}.active", "lost": None}
    return {"recovered_from": was.name, "lost": was.lost, "undo": undo.name}


def _entry(path: Path) -> Dict[str, Any]:
    messages, size = 0, path.stat().st_size
    if path.name.endswith(".bag"):
        with Index(path) as index:
            messages = sum(chunk.messages for chunk in index.chunks)
    return {"file": path.name, "bytes": size, "messages": messages, "sha256": sha256_of(path)}


def check_arrived(folder: Path, *, checksums: bool = True) -> Dict[str, Any]:
    """Return the list of a part whose files are all there, as they were sent.

    Raises:
        TransferError: One is missing or different, or there is no list.
    """
    content = read_json(folder / PARTS)
    if content is None:
        raise TransferError(
            f"{folder / PARTS}: is missing, so nobody knows whether the part is whole; transfer it again"
        )
    for entry in content["files"]:
        path = folder / str(entry["file"])
        if path.name != entry["file"]:
            raise TransferError(f"{folder / PARTS}: names a file that is none of this part, {entry['file']!r}")
        if not path.is_file():
            raise TransferError(f"{path}: did not arrive; retry, and it is transferred again")
        if path.stat().st_size != entry["bytes"] or (checksums and sha256_of(path) != entry["sha256"]):
            path.replace(path.with_name(f".{path.name}.bad"))
            raise TransferError(f"{path}: is not what was sent, and was put aside; retry, and it is transferred again")
    return content


class _Meter:
    """Bytes done of all bytes, for a progress function."""

    def __init__(self, total: int, report: Optional[Progress]) -> None:
        self._done, self._total, self._report = 0, total, report

    def add(self, size: int) -> None:
        self._done += size
        if self._report is not None:
            self._report(self._done, self._total)
