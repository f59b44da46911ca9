"""What `amaze-bag merge` and `amaze-bag verify` do; each returns whether something differs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple

from .errors import BagError
from .manifest import (
    declared_duplicates,
    manifest_path,
    merge_manifest,
    read_manifest,
    verified_manifest,
    write_manifest,
)
from .merge import MergeOptions, merge
from .report import merge_lines, show, verify_lines
from .terminal import progress_bar

if TYPE_CHECKING:
    from .verify import Verified

__all__ = ["merge_bags", "verify_bag"]


def merge_bags(options: argparse.Namespace) -> bool:
    """Merge, write the manifest, verify if asked."""
    if options.offsets_s and len(options.offsets_s) != len(options.inputs):
        raise BagError(
            "--offsets-s", f"{len(options.offsets_s)} offsets for {len(options.inputs)} inputs", "give one each"
        )
    how = MergeOptions(
        compression=options.compression,
        offsets_ns=options.offsets_s,
        duplicates=options.duplicates,
        window_ns=options.window_s,
        publishers_apart=not options.unify_publishers,
        replace=options.force,
    )
    with progress_bar("merge") as progress:
        merged = merge(options.inputs, options.output, how, progress)
    manifest = merge_manifest(merged, options.inputs, how)
    write_manifest(manifest_path(merged.path), manifest)
    lines = merge_lines(merged)
    verified = None
    if options.verify:
        verified, manifest = _verified(merged.path, options.inputs, how.offsets_ns, manifest, options.readers)
        lines += verify_lines(verified)
    show(lines, manifest, as_json=options.json)
    return bool(verified and verified.problems)


def verify_bag(options: argparse.Namespace) -> bool:
    """Verify a merged bag and write the verdict into its manifest."""
    place = manifest_path(options.bag)
    manifest = read_manifest(place) if place.is_file() else None
    inputs, offsets = options.inputs, options.offsets_s
    if not inputs and manifest:
        inputs, offsets = _inputs_of(manifest, options.bag.parent)
    elif manifest and len(inputs) == len(manifest["inputs"]) and not offsets:
        offsets = tuple(entry["offset_ns"] for entry in manifest["inputs"])
    if offsets and len(offsets) != len(inputs):
        raise BagError("--offsets-s", f"{len(offsets)} offsets for {len(inputs)} inputs", "give one each")
    verified, manifest = _verified(options.bag, inputs, offsets, manifest, options.readers)
    show(verify_lines(verified), manifest, as_json=options.json)
    return bool(verified.problems)


def _verified(
    bag: Path, inputs: List[Path], offsets: Tuple[int, ...], manifest: Optional[Dict[str, Any]], readers: str
) -> Tuple[Verified, Dict[str, Any]]:
    duplicates = declared_duplicates(manifest) if manifest else {}
    from .verify import verify  # noqa: PLC0415  (as long to load as all the rest, and not always wanted)

    with progress_bar("verify") as progress:
        verified = verify(bag, inputs, offsets_ns=offsets, duplicates=duplicates, readers=readers, progress=progress)
    new = verified_manifest(manifest, verified)
    if inputs:
        write_manifest(manifest_path(bag), new)
    return verified, new


def _inputs_of(manifest: Dict[str, Any], folder: Path) -> Tuple[List[Path], Tuple[int, ...]]:
    entries = manifest["inputs"]
    return [folder / entry["file"] for entry in entries], tuple(entry["offset_ns"] for entry in entries)
