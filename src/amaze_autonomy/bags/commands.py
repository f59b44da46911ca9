"""What the commands of `amaze-bag` do; each returns whether data was lost, is damaged, or differs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

from .errors import BagError
from .inplace import recover_in_place
from .manifest import (
    declared_duplicates,
    manifest_path,
    merge_manifest,
    read_manifest,
    verified_manifest,
    write_manifest,
)
from .merge import MergeOptions, merge
from .recover import Recovered, recover, recovered_name
from .report import (
    info_lines,
    info_result,
    merge_lines,
    recover_lines,
    scan_lines,
    scan_result,
    show,
    verify_lines,
)
from .scan import scan
from .terminal import progress_bar
from .undo import restore
from .verify import Verified, verify

__all__ = ["doctor", "info", "merge_bags", "recover_bag", "verify_bag"]


def info(options: argparse.Namespace) -> bool:
    """Show topics, counts, times and rates."""
    results = [info_result(path) for path in options.bags]
    lines: List[str] = []
    for result in results:
        lines += [*([""] if lines else []), *info_lines(result)]
    show(lines, results, as_json=options.json)
    return False


def doctor(options: argparse.Namespace) -> bool:
    """Show what is damaged."""
    lines, results, damaged = [], [], False
    for path in options.bags:
        with progress_bar(f"look through {path.name}") as progress:
            found = scan(path, check_data=not options.quick, progress=progress)
        lines += scan_lines(found)
        results.append(scan_result(found))
        damaged = damaged or bool(found.damages) or not found.closed
    show(lines, results, as_json=options.json)
    return damaged


def recover_bag(options: argparse.Namespace) -> bool:
    """Write what is good into a new bag, or close a bag in place, or undo that."""
    if options.undo:
        original = restore(options.bag)
        show([f"{original}: as it was"], {"file": str(original), "restored": True}, as_json=options.json)
        return False
    with progress_bar(f"recover {options.bag.name}") as progress:
        done = _recovered(options, progress)
    result = {**scan_result(done.scan), "output": str(done.path), "output_bytes": done.size}
    show(recover_lines(done), result, as_json=options.json)
    return not done.complete


def _recovered(options: argparse.Namespace, progress: Any) -> Recovered:
    if options.in_place:
        return recover_in_place(options.bag, check_data=options.check_data, progress=progress)
    output = options.output or recovered_name(options.bag)
    return recover(options.bag, output, check_data=options.check_data, replace=options.force, progress=progress)


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
    with progress_bar("verify") as progress:
        verified = verify(bag, inputs, offsets_ns=offsets, duplicates=duplicates, readers=readers, progress=progress)
    new = verified_manifest(manifest, verified)
    if inputs:
        write_manifest(manifest_path(bag), new)
    return verified, new


def _inputs_of(manifest: Dict[str, Any], folder: Path) -> Tuple[List[Path], Tuple[int, ...]]:
    entries = manifest["inputs"]
    return [folder / entry["file"] for entry in entries], tuple(entry["offset_ns"] for entry in entries)
