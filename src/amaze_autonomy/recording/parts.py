"""What a platform recorded, made whole: open and damaged bags are recovered, and all are listed with their checksums.

What a recorder left open is closed where it lies: the bytes that this changes are in an undo file beside it. What is
damaged elsewhere than at its end is recovered into a new bag, and the original stays beside that. Where that is gone
later, or was cut, the new bag is all that there is, and stays listed. Where the storage has no space for it, it is
listed as it is: the collector makes it whole. So it does where a merge finds damaged data in a bag whose index is good.
A file of which nothing can be read is a loss that is told, and hinders no other. A bag whose name no recorder of its
groups gives, as one that somebody cut out of another, is named, and nothing else is done with it.
"""

from __future__ import annotations

import errno
import os
import struct
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import AbstractSet, Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Set

from amaze_autonomy.bags.errors import BagError, RecordError
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.recover.recover import read_undo, recover, recover_in_place, undo_is_of, undo_path
from amaze_autonomy.bags.recover.scan import Scan, scan
from amaze_autonomy.files import sha256_of, sync_folder

from .errors import TransferError
from .losses import Numbers, Stream, Written, account, header_numbers, recorded, written
from .programs import LogState, read_line
from .storage import PARTS, aside, is_as_listed, read_json, read_parts, recording_of, write_json

_RECOVERED, _ACTIVE = ".recovered.bag", ".active"
Progress = Callable[[int, int], None]


class Part(NamedTuple):
    """A bag that is whole: where it lies, how many messages were lost by damage (None: nobody knows), of which file.

    `lost_inside` are those of them that were not lost at its end. `undo_damaged` is the name of an undo file that
    nobody can read: the file may have been half changed when it was copied.
    """

    path: Path
    lost: Optional[int]
    file: str
    lost_inside: Optional[int] = 0
    undo_damaged: str = ""

    @property
    def losses(self) -> Dict[str, Any]:
        """Return what the list of its part says of what was lost."""
        undo = {"undo_damaged": self.undo_damaged} if self.undo_damaged else {}
        return {"lost": self.lost, **_inside(self.lost_inside), **undo}


def _inside(lost: Optional[int]) -> Dict[str, Optional[int]]:
    return {} if lost == 0 else {"lost_inside": lost}


def open_bags(folder: Path, groups: AbstractSet[str]) -> List[Path]:
    """Return what recorders wrote, in order of name; not what was recovered from it, nor what only lies there.

    What is gone is named where it was recovered before; where that is damaged now, it stands for what is gone.

    Args:
        folder: of the part.
        groups: that were recorded; none: nobody knows.
    """
    bags = [path for path in _bags(folder) if _is_recorders(path.name, groups)]
    recovered = {path for path in bags if path.name.endswith(_RECOVERED)}
    found = set(bags) - recovered
    for path in recovered - {_output(each, folder) for each in found}:
        original = folder / Path(str((read_json(_note(path)) or {}).get("file"))).name
        if _output(original, folder) == path:
            found.add(original if _is_good(path) else path)
    return sorted(found)


def _bags(folder: Path) -> List[Path]:
    found = (*folder.glob("*.bag"), *folder.glob(f"*.bag{_ACTIVE}"))
    return sorted(path for path in found if not path.name.startswith("."))


def _groups(folder: Path, facts: Mapping[str, Any]) -> Set[str]:
    """Return the groups of a recording; none where nobody names one. Of one that nobody remembers there is the log."""
    named = {str(group) for key in ("seen", "configured", "topics") for group in facts.get(key, {})}
    return named | {path.stem for path in folder.glob("*.log")} if named else named


def _is_recorders(name: str, groups: AbstractSet[str]) -> bool:
    """Return whether a recorder gave a bag its name, or what it is called that is recovered from such a one."""
    file = written(f"{recording_of(name)}.bag")
    return file is not None and (not groups or file.group in groups)


def _foreign(folder: Path, groups: AbstractSet[str]) -> Dict[str, List[str]]:
    """Return the names of bags that are no recorder's, as a copy or a cut; nothing when there are none."""
    foreign = [path.name for path in _bags(folder) if not _is_recorders(path.name, groups)]
    return {"foreign": foreign} if foreign else {}


def _size(path: Path) -> int:
    """Return the bytes of a file; of one that is not there any more there are none."""
    return path.stat().st_size if path.exists() else 0


def whole_bags(
    folder: Path, content: Mapping[str, Any], target: Path, progress: Optional[Progress] = None
) -> List[Part]:
    """Return a whole bag for each that the list of a part names, recovering into `target` what was left open.

    Of a file of which nothing can be read there is none: whoever asks sees that from the list.

    Raises:
        BagError: One cannot be recovered now, as for want of space.
    """
    found: List[Optional[Part]] = []
    for entry in content["files"]:
        path = folder / str(entry["file"])
        if entry.get("unreadable"):
            continue
        try:
            found.append(_whole(path, target, progress))
        except BagError as error:
            if error.path != str(path) or not isinstance(error.__cause__, (RecordError, struct.error)):
                raise  # not for what is in it
    return [part for part in found if part is not None]


def recover_damaged(folder: Path, bag: Path, target: Path, progress: Optional[Progress] = None) -> bool:
    """Recover what is good of a bag that could not be merged; return whether `whole_bags` has another one now.

    It says no where all data was looked at before, or nothing is wrong with it.

    Args:
        folder: of the part.
        bag: as `whole_bags` returned it.
        target: as it was told.
        progress: called with bytes done and all bytes.

    Raises:
        BagError: It cannot be recovered, as for want of space.
    """
    for entry in (read_parts(folder) or {"files": []})["files"]:
        path = folder / str(entry["file"])
        output = _output(path, target)
        if bag.resolve() not in (path.resolve(), output.resolve()) or not bag.exists():
            continue
        checked = bag.name == output.name and (read_json(_note(output)) or {}).get("checked")
        if checked or not scan(path).damages:
            return False
        _recovered(path, output, check_data=True, progress=progress)
        return True
    return False


def _whole(path: Path, target: Path, progress: Optional[Progress]) -> Optional[Part]:
    output = _output(path, target)
    before = _recovered_before(path, output)
    if before is not None:
        return before
    if _size(path) == 0:
        return None  # not a byte was written
    if path.name.endswith(".bag") and _is_good(path):
        return Part(path, 0, path.name)
    return _recovered(path, output, check_data=path.name.endswith(".bag"), progress=progress)


def _output(path: Path, target: Path) -> Path:
    """Return where what is recovered from a file is to lie."""
    return target / f"{path.name.split('.bag')[0]}{_RECOVERED}"


def _note(output: Path) -> Path:
    """Return the file beside a recovered bag that says what it was made of and what was lost."""
    return output.with_suffix(".json")


def _recovered(path: Path, output: Path, *, check_data: bool, progress: Optional[Progress]) -> Part:
    """Recover a bag, and write down what was lost: who comes after a kill must not have to guess."""
    output.parent.mkdir(parents=True, exist_ok=True)
    _note(output).unlink(missing_ok=True)
    if output.exists():  # it was not what is wanted, and may have what is nowhere else
        output.replace(aside(output))
    undo = _damaged_undo(path)
    with _without_undo(path) if undo else nullcontext(path) as source:
        done = recover(source, output, check_data=check_data, progress=progress)
    part = Part(output, done.scan.lost, path.name, done.scan.lost_inside)
    if undo:
        part = part._replace(lost=None, lost_inside=None, undo_damaged=undo)
    write_json(_note(output), {"file": path.name, "bytes": done.scan.size, **part.losses, "checked": check_data})
    return part


def _damaged_undo(path: Path) -> str:
    """Return the name of a bag's undo file that nobody can read; an empty text when it is good, or there is none."""
    undo = undo_path(path)
    try:
        if undo.exists():
            read_undo(undo)
    except BagError:
        return undo.name
    return ""


@contextmanager
def _without_undo(path: Path) -> Iterator[Path]:
    """Give a path of a bag beside which there is no undo file, so that it can be copied as it is."""
    with TemporaryDirectory(prefix="amaze-copied-") as folder:
        link = Path(folder) / path.name
        link.symlink_to(path.resolve())
        try:
            yield link
        except BagError as error:
            if error.path != str(link):
                raise
            raise BagError(str(path), error.wrong, error.remedy) from error.__cause__


def _recovered_before(path: Path, output: Path) -> Optional[Part]:
    """Return what was recovered from a file before; None where that is not written down, or there is more in it now."""
    note = read_json(_note(output)) or {}
    if note.get("file") != path.name or "lost" not in note or not _is_good(output):
        return None
    if note.get("bytes") != _size(path) and _found(path) > _found(output):
        return None
    return Part(output, note["lost"], path.name, note.get("lost_inside", 0), note.get("undo_damaged", ""))


def _found(path: Path) -> int:
    """Return how many messages can be found in a file: none in what is no bag, or not there."""
    with suppress(BagError):
        return scan(path, check_data=False).messages if path.exists() else 0
    return 0


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
        facts: of the recording, for the list: session, platform, groups, gaps, dropped, when recorders were seen;
            `anew` says that nothing was recorded since it was listed, so what is not as it was then is a loss.
        progress: called with bytes done and all bytes.

    Raises:
        BagError: A bag is damaged beyond recovery.
        FolderError: The list cannot be written.
    """
    before, anew = read_parts(folder) or {"files": []}, bool(facts.get("anew"))
    groups = _groups(folder, facts)
    paths = open_bags(folder, groups)
    by_hand = _recovered_by_hand(paths)
    paths = [path for path in paths if path.with_name(f"{path.name}{_ACTIVE}") not in by_hand]
    meter = _Meter(sum(map(_size, paths)), progress)
    entries: List[Dict[str, Any]] = []
    files: List[Written] = []
    for path in paths:
        size = _size(path)
        listed = [_compared(folder, each, before, anew=anew) for each in by_hand.get(path) or _listed(folder, path)]
        entries += listed
        files += _written(folder, path, listed)
        meter.add(size)
    known = account(files, facts.get("gaps", []))
    logs = sorted(folder.glob("*.log"))
    more = {**_gone(folder, entries, before, anew=anew), **_foreign(folder, groups)}
    facts = {key: value for key, value in facts.items() if key != "anew"}
    content = {"parts": 1, **facts, **known._asdict(), **more, "files": entries, "logs": [path.name for path in logs]}
    content["dropped"] = max(int(facts.get("dropped", 0)), sum(map(_warnings, logs)))
    content["recorded"] = recorded(files, known.gaps, facts.get("seen", {}))
    content["uncounted"] = _uncounted(folder, entries, files)
    if content != before or not anew:
        _put_on_disk(folder, entries)
        write_json(folder / PARTS, content)
    return content


def _put_on_disk(folder: Path, entries: Sequence[Mapping[str, Any]]) -> None:
    """Wait until all files that a list is to name are on the disk: rosbag closes them without that."""
    for entry in entries:
        file = os.open(folder / str(entry["file"]), os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(file)
        finally:
            os.close(file)
    sync_folder(folder)


_KNOWN = ("lost", "lost_inside", "undo_damaged", "changed", "listed_as")  # of a file, from when it was listed before


def _compared(folder: Path, entry: Dict[str, Any], before: Mapping[str, Any], *, anew: bool) -> Dict[str, Any]:
    """Return an entry with what is known of it since it was listed before; `anew`: it should be as it was then.

    What was listed first, whoever has it whole, is named: as `changed` of a file of the same name, and as `listed_as`
    of one that had to be recovered since.
    """
    names = (entry["file"], entry.get("recovered_from"))
    unreadable = bool(entry.get("unreadable"))
    listed = (each for each in before["files"] if each["file"] in names and (unreadable or not each.get("open")))
    was = next(listed, None)
    if was is None or (entry.get("open") and not unreadable):
        return entry
    if unreadable:  # who has it as it was then has it whole
        first = was.get("changed") or was.get("sha256")
        return {**entry, "changed": first} if first else entry
    if (was["file"], was.get("sha256")) == (entry["file"], entry["sha256"]):
        now = {key: value for key, value in entry.items() if key not in _KNOWN}
        original = was.get("recovered_from")  # somebody may have removed it since
        origin = {"recovered_from": original} if original and not (folder / str(original)).exists() else {}
        return {**origin, **now, **{key: was[key] for key in _KNOWN if key in was}}
    if not anew:
        return entry
    if was["file"] == entry["file"]:
        first = {"listed_as": was["listed_as"]} if "listed_as" in was else {}
        return {**entry, **first, "lost": None, "changed": was.get("changed") or was.get("sha256")}
    missing = was.get("messages", 0) - entry["messages"]  # it had to be recovered since
    lost = (was.get("lost", 0), missing if missing > 0 else entry["lost"])
    listed_as = was.get("changed") or was.get("sha256")
    return {**entry, "listed_as": listed_as, "lost": None if None in lost else sum(lost)}


def _gone(
    folder: Path, entries: Sequence[Mapping[str, Any]], before: Mapping[str, Any], *, anew: bool
) -> Dict[str, List[str]]:
    """Return the names of files that were listed before and are nowhere; nothing when there are none.

    Those of which that was said before stay said. Others may have been removed when they were verified, unless the part
    is listed anew.
    """
    here = {name for entry in entries for name in (entry["file"], entry.get("recovered_from"))}
    names = {*(each["file"] for each in before["files"] if anew), *before.get("gone", ())}
    gone = sorted(name for name in names - here if not (folder / name).exists())
    return {"gone": gone} if gone else {}


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
    file = written(str(listed[0].get("recovered_from", listed[0]["file"])) if listed else path.name)
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


def _recovered_by_hand(paths: Sequence[Path]) -> Dict[Path, List[Dict[str, Any]]]:
    """Return each open bag that somebody recovered already under its name without `.active`; only one may be listed.

    With it comes the entry of that; none where that is not good, or has fewer messages than are in the open bag.
    """
    found: Dict[Path, List[Dict[str, Any]]] = {}
    for path in (each for each in paths if each.name.endswith(_ACTIVE)):
        whole = path.with_name(path.name[: -len(_ACTIVE)])
        if whole in paths:
            with suppress(BagError):  # of one that is no bag there is nothing twice
                here, there = scan(path), scan(whole, check_data=False)
                if here.chunks and _start_ns(here) == _start_ns(there):
                    told = {"lost": here.lost, **_inside(here.lost_inside), "recovered_from": path.name}
                    better = _is_good(whole) and there.messages >= here.messages
                    found[path] = [_entry(whole, told)] if better else []
    return found


def _start_ns(found: Scan) -> Optional[int]:
    return min((chunk.start_ns for chunk in found.chunks), default=None)


def _listed(folder: Path, path: Path) -> List[Dict[str, Any]]:
    """Return the entries of one recorded bag: itself, or what was recovered from it."""
    closed = _closed_in_place(path)
    if closed is not None:
        return [_entry(closed, _before(closed))]
    try:
        part = _whole(path, folder, None)
    except BagError as error:
        return [_entry(path, {"open": True, "lost": None, "problem": str(error)})]
    if part is None:
        return []
    return [_entry(part.path, part.losses if part.path == path else {**part.losses, "recovered_from": path.name})]


def _closed_in_place(path: Path) -> Optional[Path]:
    """Return a bag that was closed where it lies, now or before; None where that cannot be, or has not to be."""
    if _size(path) == 0:
        return None
    if path.name.endswith(".bag"):
        closed = undo_path(path).exists() and _undo_is_of(path) is not False and _is_good(path)
        return path if closed else None
    if _recovered_before(path, _output(path, path.parent)) is not None:
        return None
    try:
        return recover_in_place(path, check_data=False).path  # a merge looks at every message
    except BagError:
        return None  # it has to be copied, and if that cannot be either, the words are there


def _undo_is_of(path: Path) -> Optional[bool]:
    """Return whether an undo file is of its bag; None where nobody can tell: what it says was lost is believed."""
    try:
        return undo_is_of(path)
    except BagError:
        return None


def _before(path: Path) -> Dict[str, Any]:
    """Return what the list says of a bag that was closed in place: its name before, what was lost, how to undo it.

    Without an undo file it was closed by its recorder, which was killed before it gave it its name. What one
    that cannot be used any more says was lost is believed, and it is not named.
    """
    undo = undo_path(path)
    if not undo.exists():
        return {"lost": 0}
    try:
        was = read_undo(undo)
    except BagError:
        was_active = f"{path.name}.active"
        return {"recovered_from": was_active, "lost": None, "lost_inside": None, "undo_damaged": undo.name}
    told = {"recovered_from": was.name, "lost": was.lost, **_inside(was.lost_inside)}
    return {**told, "undo": undo.name} if _undo_is_of(path) else told


def _entry(path: Path, told: Mapping[str, Any]) -> Dict[str, Any]:
    """Return what the list says of a file, with what is told of it besides; all of one with a bad sector is a loss."""
    messages, size = 0, path.stat().st_size
    try:
        sha256 = sha256_of(path)
    except OSError as error:
        remedy = _COPY if error.errno == errno.EIO else "mend that and retry"
        problem = f"{path}: cannot be read ({error.strerror}); {remedy}"
        return {"file": path.name, "bytes": size, "open": True, "unreadable": True, "lost": None, "problem": problem}
    if path.name.endswith(".bag"):
        with suppress(BagError), Index(path) as index:  # of one that cannot be recovered here nobody knows
            messages = sum(chunk.messages for chunk in index.chunks)
    return {"file": path.name, "bytes": size, "messages": messages, "sha256": sha256, **told}


_COPY = "copy it with a tool that passes over bad sectors, recover the copy, put it in its place and retry"
_ANEW = "retry, and its platform lists anew what is there"
_AGAIN = "retry, and it is transferred again"


def check_arrived(folder: Path, *, checksums: bool = True) -> Dict[str, Any]:
    """Return the list of a part whose files are all there, as they were sent.

    Args:
        folder: of the part.
        checksums: it was sent, so checksums are looked at, and what is different is put aside. A part in place was
            not: its file may be the only one there is, and is left alone.

    Raises:
        TransferError: One is missing or different, or there is no list.
    """
    content = read_parts(folder)
    unchanged, remedy = ("", _AGAIN) if checksums else ("nothing was changed; ", _ANEW)
    if content is None:
        wrong = "is missing, or no list of a part; nobody knows whether it is whole"
        raise TransferError(f"{folder / PARTS}: {wrong}; {unchanged}{_ANEW}")
    for entry in content["files"]:
        path = folder / str(entry["file"])
        if path.name != entry["file"]:
            raise TransferError(f"{folder / PARTS}: names a file that is none of this part, {entry['file']!r}")
        wrong = "" if entry.get("unreadable") else _difference(path, entry, checksums=checksums)
        if wrong and checksums and path.is_file():
            path.replace(aside(path))
            wrong += ", and was put aside"
        if wrong:
            raise TransferError(f"{path}: {wrong}; {unchanged}{remedy}")
    return content


def _difference(path: Path, entry: Mapping[str, Any], *, checksums: bool) -> str:
    """Return how a file is not what the list of its part says; an empty text when it is."""
    if not path.is_file():
        return "did not arrive" if checksums else "is not there, and its list names it"
    size, listed = path.stat().st_size, entry.get("bytes")
    if not checksums:
        return "" if size == listed else f"has {size} bytes and not {listed}, as its list says"
    return "" if is_as_listed(path, entry) else "is not what was sent"


class _Meter:
    """Bytes done of all bytes, for a progress function."""

    def __init__(self, total: int, report: Optional[Progress]) -> None:
        self._done, self._total, self._report = 0, total, report

    def add(self, size: int) -> None:
        self._done += size
        if self._report is not None:
            self._report(self._done, self._total)
