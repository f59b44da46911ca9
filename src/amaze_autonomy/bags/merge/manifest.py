"""What bags hold, summed up: the manifest beside a merged bag, and the checksums in it. JSON.

The manifest says what a bag was made of, what it has, and whether that was verified. The checksums of messages can be
added and subtracted, whatever their order.
"""

from __future__ import annotations

import json
import os
import sys
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import lz4
import numpy as np

from amaze_autonomy.files import sha256_of, write_whole

from ..errors import BagError
from ..index import Index

if TYPE_CHECKING:  # loading them all would be a good part of a short run
    from .merge import Merged, MergeOptions
    from .verify import Counted, Verified

# --- checksums that can be added --------------------------------------------------------------------------------------


_MASK = (1 << 64) - 1


class Tally(NamedTuple):
    """How many messages, and the sum of their checksums (modulo 2**64)."""

    messages: int = 0
    checksum: int = 0

    def plus(self, other: Tally) -> Tally:
        """Return both together."""
        return Tally(self.messages + other.messages, (self.checksum + other.checksum) & _MASK)

    def minus(self, other: Tally) -> Tally:
        """Return this without the other."""
        return Tally(self.messages - other.messages, (self.checksum - other.checksum) & _MASK)


TopicKey = Tuple[str, str, str]  # topic, type, md5


class Tallies:
    """A tally for each topic, type and definition."""

    def __init__(self) -> None:
        self.by_topic: Dict[TopicKey, Tally] = {}

    def add(self, key: TopicKey, tally: Tally) -> None:
        """Add messages of a topic."""
        self.by_topic[key] = self.by_topic.get(key, Tally()).plus(tally)


def payload_checksums(buffer: Any, payload: List[int], end: List[int]) -> Any:
    """Return the CRC-32 of each message's bytes."""
    view, crc32 = memoryview(buffer), zlib.crc32
    return np.array([crc32(view[start:stop]) for start, stop in zip(payload, end)], np.uint64)


def checksums(crc: Any, length: Any, t_ns: Any) -> Any:
    """Return a 64-bit checksum of each message: its bytes, their number, and its record time.

    The mixing is that of SplitMix64, so that sums of them do not cancel out as sums of CRCs would.
    """
    mixed = crc | (length.astype(np.uint64) << np.uint64(32))
    return _mix(_mix(mixed) ^ t_ns.astype(np.uint64))


def _mix(value: Any) -> Any:
    value = value + np.uint64(0x9E3779B97F4A7C15)
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


# --- the manifest -----------------------------------------------------------------------------------------------------


def manifest_path(bag: Path) -> Path:
    """Return where the manifest of a bag lies."""
    return bag.with_name(f"{bag.name[:-4] if bag.name.endswith('.bag') else bag.name}.manifest.json")


def bag_of(manifest: Path, bag: Path) -> Path:
    """Return the bag that the manifest in a bag's place is of: those of `flight.bag` and `flight` have the same."""
    try:
        named = manifest.with_name(Path(str(read_manifest(manifest)["output"]["file"])).name)
    except (ValueError, KeyError, TypeError):
        return bag
    return named if named.exists() and manifest_path(named) == manifest else bag


def check_place(bag: Path) -> None:
    """Refuse a bag whose manifest would have the place of another bag's.

    Raises:
        BagError: That one's lies there.
    """
    place = manifest_path(bag)
    other = bag_of(place, bag)
    if other.name != bag.name:
        wrong = f"is the manifest of {other.name}, and would be that of {bag.name}"
        raise BagError(str(place), wrong, "give one of the two another name")


def merge_manifest(merged: Merged, inputs: Sequence[Path], options: MergeOptions) -> Dict[str, Any]:
    """Return the manifest of a bag that was merged and not verified yet; reads indexes only."""
    offsets, origins = options.offsets_ns or (0,) * len(inputs), options.origins_of(len(inputs))
    return {
        "manifest": 1,
        "output": _indexed(merged.path, merged.path.parent),
        "inputs": [
            {**_indexed(path, merged.path.parent), "offset_ns": offset, "origin": origin}
            for path, offset, origin in zip(inputs, offsets, origins)
        ],
        "duplicates": {"what": options.duplicates, "window_ns": options.window_ns, "topics": _rows(merged.duplicates)},
        "compression": options.compression,
        "warnings": list(merged.warnings),
        "versions": _versions(),
        "verified": None,
    }


def verified_manifest(
    manifest: Optional[Dict[str, Any]], verified: Verified, offsets_ns: Sequence[int]
) -> Dict[str, Any]:
    """Return a manifest with checksums of files and messages, and the verdict.

    An input that the manifest names keeps its place there, also where a copy of it was looked at: whether a bag can be
    made again is seen by the files from which it was made.

    Args:
        manifest: of the bag; None when it has none yet.
        verified: what was found.
        offsets_ns: with which that was, of each input; empty for none.
    """
    folder = verified.output.path.parent
    new = dict(manifest or {"manifest": 1, "warnings": [], "duplicates": None})
    known = list(new.get("inputs", []))
    new["output"] = {**new.get("output", {}), **_counted(verified.output, folder)}
    looked_at = [
        _input({**_counted(each, folder), "offset_ns": offset}, known)
        for each, offset in zip(verified.inputs, offsets_ns or (0,) * len(verified.inputs))
    ]
    new["inputs"] = looked_at or known
    new["versions"] = _versions()
    new["verified"] = {
        "ok": not verified.problems,
        "problems": list(verified.problems),
        "readers": {each.reader: each.error or "agrees" for each in verified.readings},
    }
    return new


def _input(now: Dict[str, Any], known: List[Dict[str, Any]]) -> Dict[str, Any]:
    """Return the entry of an input with what else is known of it, which is taken out of what is known of all."""
    for key in ("file", "sha256"):
        for was in known:
            if was.get(key) == now[key]:
                known.remove(was)
                return {**was, **now, "file": was["file"]}
    return now


def changed_inputs(manifest: Dict[str, Any], other: Dict[str, Any]) -> Optional[List[str]]:
    """Return the inputs of a verified manifest that are not what they were in another one; None: it names others."""
    files, others = (sorted((each["file"], each.get("sha256")) for each in one["inputs"]) for one in (manifest, other))
    if [name for name, _ in files] != [name for name, _ in others]:
        return None
    return [name for (name, sha256), (_, before) in zip(files, others) if before not in (None, sha256)]


def applied_offsets(manifest: Dict[str, Any], inputs: Sequence[Path], folder: Path) -> Tuple[int, ...]:
    """Return what a merge added to the times of inputs, in whatever order these are named.

    Args:
        manifest: of the merged bag.
        inputs: paths; those of other files than it names, as of moved ones, are told apart by their places.
        folder: of the bag.
    """
    entries = manifest["inputs"]
    named: Dict[str, List[int]] = {}
    for entry in entries:
        named.setdefault(entry["file"], []).append(entry["offset_ns"])
    by_place = [entry["offset_ns"] for entry in entries] if len(entries) == len(inputs) else [0] * len(inputs)
    known = [named.get(_relative(path, folder)) for path in inputs]
    return tuple(each.pop(0) if each else offset for each, offset in zip(known, by_place))


def declared_duplicates(manifest: Dict[str, Any]) -> Dict[TopicKey, Tally]:
    """Return the messages that a merge says it dropped."""
    found = manifest.get("duplicates") or {}
    if found.get("what") != "drop":
        return {}
    return tallies_of(found["topics"])


def tallies_of(rows: Sequence[Mapping[str, Any]]) -> Dict[TopicKey, Tally]:
    """Return what a manifest says of topics."""
    return {(row["topic"], row["type"], row["md5"]): Tally(row["messages"], int(row["checksum"], 16)) for row in rows}


def read_manifest(path: Path) -> Dict[str, Any]:
    """Read a manifest.

    Raises:
        BagError: It is none.
    """
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        if manifest["manifest"] != 1:
            raise BagError(str(path), "is a manifest of another version", "name the inputs instead")
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, BagError):
            raise
        raise BagError(str(path), f"is no manifest ({error})", "name the inputs instead") from error
    return dict(manifest)


def write_manifest(path: Path, manifest: Dict[str, Any]) -> None:
    """Write a manifest so that a reader finds the old one or the new one."""
    write_whole(path, json.dumps(manifest, indent=2, sort_keys=True) + "\n")


def _indexed(path: Path, folder: Path) -> Dict[str, Any]:
    with Index(path) as index:
        filled = [chunk for chunk in index.chunks if chunk.counts]
        return {
            "file": _relative(path, folder),
            "bytes": index.size,
            "messages": sum(chunk.messages for chunk in filled),
            "start_ns": min((chunk.start_ns for chunk in filled), default=None),
            "end_ns": max((chunk.end_ns for chunk in filled), default=None),
        }


def _counted(counted: Counted, folder: Path) -> Dict[str, Any]:
    return {
        "file": _relative(counted.path, folder),
        "bytes": counted.size,
        "sha256": sha256_of(counted.path),
        "messages": counted.messages,
        "start_ns": counted.start_ns,
        "end_ns": counted.end_ns,
        "topics": _rows(counted.topics),
    }


def _relative(path: Path, folder: Path) -> str:
    return os.path.relpath(path.resolve(), folder.resolve())


def _rows(tallies: Dict[TopicKey, Tally]) -> List[Dict[str, Any]]:
    return [
        {"topic": topic, "type": kind, "md5": md5, "messages": tally.messages, "checksum": f"{tally.checksum:016x}"}
        for (topic, kind, md5), tally in sorted(tallies.items())
    ]


def _versions() -> Dict[str, str]:
    return {"python": sys.version.split()[0], "numpy": np.__version__, "lz4": lz4.__version__}
