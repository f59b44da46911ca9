"""The manifest beside a merged bag: what it was made of, what it has, and whether that was verified. JSON."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Sequence

import lz4
import numpy as np

from .errors import BagError
from .index import Index
from .tally import Tally, TopicKey

if TYPE_CHECKING:  # loading them all would be a good part of a short run
    from .count import Counted
    from .merge import Merged, MergeOptions
    from .verify import Verified

__all__ = [
    "declared_duplicates",
    "manifest_path",
    "merge_manifest",
    "read_manifest",
    "verified_manifest",
    "write_manifest",
]

_PIECE = 1 << 20


def manifest_path(bag: Path) -> Path:
    """Return where the manifest of a bag lies."""
    return bag.with_name(f"{bag.name[:-4] if bag.name.endswith('.bag') else bag.name}.manifest.json")


def merge_manifest(merged: Merged, inputs: Sequence[Path], options: MergeOptions) -> Dict[str, Any]:
    """Return the manifest of a bag that was merged and not verified yet; reads indexes only."""
    offsets = options.offsets_ns or (0,) * len(inputs)
    return {
        "manifest": 1,
        "output": _indexed(merged.path, merged.path.parent),
        "inputs": [
            {**_indexed(path, merged.path.parent), "offset_ns": offset} for path, offset in zip(inputs, offsets)
        ],
        "duplicates": {"what": options.duplicates, "window_ns": options.window_ns, "topics": _rows(merged.duplicates)},
        "compression": options.compression,
        "warnings": list(merged.warnings),
        "versions": _versions(),
        "verified": None,
    }


def verified_manifest(manifest: Optional[Dict[str, Any]], verified: Verified) -> Dict[str, Any]:
    """Return a manifest with checksums of files and messages, and the verdict."""
    folder = verified.output.path.parent
    new = dict(manifest or {"manifest": 1, "warnings": [], "duplicates": None})
    known = {entry["file"]: entry for entry in new.get("inputs", [])}
    new["output"] = {**new.get("output", {}), **_counted(verified.output, folder)}
    new["inputs"] = [
        {**known.get(_relative(each.path, folder), {"offset_ns": 0}), **_counted(each, folder)}
        for each in verified.inputs
    ]
    new["versions"] = _versions()
    new["verified"] = {
        "ok": not verified.problems,
        "problems": list(verified.problems),
        "readers": {each.reader: each.error or "agrees" for each in verified.readings},
    }
    return new


def declared_duplicates(manifest: Dict[str, Any]) -> Dict[TopicKey, Tally]:
    """Return the messages that a merge says it dropped."""
    found = manifest.get("duplicates") or {}
    if found.get("what") != "drop":
        return {}
    return {
        (row["topic"], row["type"], row["md5"]): Tally(row["messages"], int(row["checksum"], 16))
        for row in found["topics"]
    }


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
    half = path.with_name(f".{path.name}.part")
    with half.open("w", encoding="utf-8") as file:
        json.dump(manifest, file, indent=2, sort_keys=True)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())
    half.replace(path)


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
        "sha256": _sha256(counted.path),
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


def _sha256(path: Path) -> str:
    from hashlib import sha256  # noqa: PLC0415  (slow to load, and only wanted here)

    digest = sha256()
    with path.open("rb") as file:
        for piece in iter(lambda: file.read(_PIECE), b""):
            digest.update(piece)
    return digest.hexdigest()


def _versions() -> Dict[str, str]:
    return {"python": sys.version.split()[0], "numpy": np.__version__, "lz4": lz4.__version__}
