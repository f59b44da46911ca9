"""`amaze-bag`: look into bags, find damage, recover, merge, filter, cut, verify; on any machine, without ROS.

A command loads only what it needs: numpy alone takes longer to load than a recovery in place takes.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterator, List, Optional, Sequence, Tuple

from amaze_autonomy.command_line import run_command, say_wrong
from amaze_autonomy.files import Kind, OutputError, check_output
from amaze_autonomy.units import MB, SECOND

from ..paths import expanded
from .errors import BagError
from .format import MEMORY

if TYPE_CHECKING:
    from .merge.merge import Merged
    from .merge.verify import Verified
    from .recover.recover import Recovered
    from .recover.scan import Scan

DONE, IMPOSSIBLE, USAGE, LOST = 0, 1, 2, 3
_COMPRESSIONS = ("auto", "none", "lz4", "bz2")
_STATUSES = """\
exit status:
  0  done, nothing is wrong
  1  cannot be done (one line says why and what to do)
  2  wrong use of the command
  3  done, but data was lost, or is damaged, or differs
"""
_UNCHECKED = "; the data of whole chunks was not checked"
_EXAMPLES = {
    None: """\
examples:
  amaze-bag info flight.bag
  amaze-bag recover flight.bag.active
  amaze-bag merge main.bag camera.bag -o flight.bag --verify
""",
    "info": """\
examples:
  amaze-bag info flight.bag
  amaze-bag info --json *.bag | python3 -m json.tool
""",
    "doctor": """\
examples:
  amaze-bag doctor flight.bag           reads all of it
  amaze-bag doctor --quick flight.bag   headers and index only: finds what is cut, not what is damaged inside
""",
    "recover": """\
examples:
  amaze-bag recover flight.bag.active                 writes flight.bag
  amaze-bag recover broken.bag -o good.bag
  amaze-bag recover --trust-data flight.bag.active    in a hurry: what is whole is copied and not looked at
  amaze-bag recover --in-place flight.bag.active      no copy: flight.bag, and flight.bag.undo
  amaze-bag recover --undo flight.bag                 flight.bag.active as it was
""",
    "merge": """\
examples:
  amaze-bag merge main.bag camera.bag -o flight.bag
  amaze-bag merge main_*.bag camera_*.bag -o flight.bag --compression lz4 --verify
  amaze-bag merge main.bag camera.bag -o flight.bag --offsets-s 0,-3.02     the camera's clock was 3.02 s ahead
  amaze-bag merge main.bag camera.bag -o flight.bag --duplicates drop       both recorded /rosout
  amaze-bag merge main_0.bag main_1.bag camera.bag -o flight.bag --duplicates drop --origins main,main,camera
""",
    "filter": """\
examples:
  amaze-bag filter flight.bag -o small.bag --without '/camera/*'
  amaze-bag filter flight.bag -o imu.bag --types sensor_msgs/Imu --verify
  amaze-bag filter flight.bag -o landing.bag --topics '/px4/*' /odometry --from 12 --latched
""",
    "cut": """\
examples:
  amaze-bag cut flight.bag -o part.bag --from 12 --to 20.5                seconds from the first message
  amaze-bag cut flight.bag -o noon.bag --from 2026-11-22T12:00:00Z --latched
""",
    "verify": """\
examples:
  amaze-bag verify flight.bag                         its inputs are in the manifest beside it
  amaze-bag verify flight.bag main.bag camera.bag --readers read
""",
}


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command line; return the exit status."""
    options = _parser().parse_args(arguments)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # starting its threads takes longer than many a command

    def command() -> int:
        _check_named(options)
        return LOST if options.command(options) else DONE

    return run_command("amaze-bag", command, (BagError, OutputError), wrong=IMPOSSIBLE)


def _check_named(options: argparse.Namespace) -> None:
    """Refuse a folder that has not even a name, to which others could be given."""
    for path in (*vars(options).values(), *getattr(options, "inputs", ()), *getattr(options, "bags", ())):
        if isinstance(path, Path) and not path.name:
            raise BagError(str(path), "is a folder", "name a bag in it")


def _parser() -> argparse.ArgumentParser:
    parser = _with_help(argparse.ArgumentParser(prog="amaze-bag", description=__doc__.split("`: ", 1)[1]), None)
    adder = parser.add_subparsers(metavar="COMMAND", dest="name", required=True)

    info = _command(adder, "info", "topics, types, counts, rates, gaps; reads the index only", _info)
    info.add_argument("bags", nargs="+", type=expanded, metavar="BAG")

    doctor = _command(adder, "doctor", "find damage, with offsets; changes nothing", _doctor)
    doctor.add_argument("bags", nargs="+", type=expanded, metavar="BAG")
    doctor.add_argument("--quick", action="store_true", help="do not read the data of whole chunks")

    recover = _command(adder, "recover", "write what is good into a new bag, or close a bag in place", _recover)
    recover.add_argument("bag", type=expanded, metavar="BAG", help="is only read, but for --in-place and --undo")
    where = recover.add_mutually_exclusive_group()
    where.add_argument("-o", "--output", type=expanded, help="default: x.bag for x.bag.active, else x.recovered.bag")
    where.add_argument("--in-place", action="store_true", help="no copy: change the end of the bag, keep x.bag.undo")
    where.add_argument("--undo", action="store_true", help="make the original of what was recovered in place")
    recover.add_argument("--trust-data", action="store_true", help="do not look at the data of whole chunks")
    recover.add_argument("--check-data", action="store_true", help=argparse.SUPPRESS)  # what it does anyway
    recover.add_argument("--force", action="store_true", help="replace an existing output")

    _add_merge(adder)
    _add_filter(adder)
    verify = _command(adder, "verify", "compare a merged bag with its inputs, and readers with each other", _verify)
    verify.add_argument("bag", type=expanded, metavar="BAG")
    verify.add_argument("inputs", nargs="*", type=expanded, metavar="INPUT", help="default: those of the manifest")
    verify.add_argument("--offsets-s", type=_seconds, default=(), metavar="S,S,...", help="that the merge applied")
    _add_readers(verify)
    return parser


def _add_merge(adder: Any) -> None:
    merge = _command(adder, "merge", "several bags into one, in order of time", _merge)
    merge.add_argument("inputs", nargs="+", type=expanded, metavar="INPUT", help="is only read")
    merge.add_argument("-o", "--output", type=expanded, required=True)
    merge.add_argument(
        "--compression",
        choices=_COMPRESSIONS,
        default="auto",
        help="of the output; auto (default): copied chunks as they are, all others none",
    )
    merge.add_argument("--offsets-s", type=_seconds, default=(), metavar="S,S,...", help="added to each input's times")
    merge.add_argument(
        "--duplicates",
        choices=("count", "drop", "ignore"),
        default="count",
        help="messages that inputs of several origins have; drop keeps the one that was recorded first",
    )
    words = "who recorded each input, as main,main,camera: files of one recorder are not compared (default: all are)"
    merge.add_argument("--origins", type=_names, default=(), metavar="NAME,NAME,...", help=words)
    merge.add_argument(
        "--window-s", type=_second, default=SECOND, metavar="S", help="in which duplicates are (default 1)"
    )
    merge.add_argument("--unify-publishers", action="store_true", help="one connection for all publishers of a topic")
    merge.add_argument("--force", action="store_true", help="replace an existing output")
    words = "then verify, as the command verify does; without, nobody looks into chunks that stay compressed"
    merge.add_argument("--verify", action="store_true", help=words)
    _add_readers(merge)


def _add_filter(adder: Any) -> None:
    named = _command(adder, "filter", "some topics, types, or some time of a bag as a bag", _filter)
    cut = _command(adder, "cut", "a time of a bag as a bag", _filter)
    named.add_argument("--topics", nargs="+", default=(), metavar="PATTERN", help="that are wanted, as '/camera/*'")
    named.add_argument("--without", nargs="+", default=(), metavar="PATTERN", help="topics that are not wanted")
    named.add_argument("--types", nargs="+", default=(), metavar="PATTERN", help="that are wanted, as 'sensor_msgs/*'")
    cut.set_defaults(topics=(), without=(), types=())
    for parser in (named, cut):
        parser.add_argument("bag", type=expanded, metavar="BAG", help="is only read")
        parser.add_argument("-o", "--output", type=expanded, required=True)
        words = "from the first message in seconds, or a date and time in UTC (2026-11-22T12:00:00Z)"
        parser.add_argument("--from", type=_moment, dest="begin", metavar="TIME", help=f"from then on: {words}")
        parser.add_argument("--to", type=_moment, dest="end", metavar="TIME", help="before then, likewise")
        words = "of latched topics, such as /tf_static, also the last message before --from, with its own time"
        parser.add_argument("--latched", action="store_true", help=words)
        words = "of the output; auto (default): chunks that are wanted whole as they are, all others none"
        parser.add_argument("--compression", choices=_COMPRESSIONS, default="auto", help=words)
        parser.add_argument("--force", action="store_true", help="replace an existing output")
        parser.add_argument("--verify", action="store_true", help="then compare with the original, message by message")
        _add_readers(parser)


def _moment(text: str) -> Tuple[int, bool]:
    """Return a time in ns, and whether it is counted from the first message."""
    if "-" not in text[1:]:
        return _second(text), True
    try:
        when = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither seconds nor a date and time") from None
    seconds = (when if when.tzinfo else when.replace(tzinfo=timezone.utc)).timestamp()
    return round(seconds * 1e6) * 1000, False


def _add_readers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--readers",
        choices=("none", "open", "read"),
        default="open",
        help="what other readers are asked, where installed: nothing, the index (default), every message",
    )


def _command(
    adder: Any, name: str, text: str, function: Callable[[argparse.Namespace], bool]
) -> argparse.ArgumentParser:
    parser = _with_help(adder.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}."), name)
    parser.set_defaults(command=function)
    parser.add_argument("--json", action="store_true", help="for programs")
    add_memory(parser)
    return parser


def add_memory(parser: argparse.ArgumentParser) -> None:
    """Add the option that says how much memory a chunk may take."""
    words = f"that the data of a chunk may take (default {MEMORY // MB}): a small file can hold gigabytes"
    parser.add_argument("--memory", type=_megabytes, default=MEMORY, metavar="MB", help=words)


def _megabytes(text: str) -> int:
    try:
        size = int(text) * MB
    except ValueError:
        size = 0
    if size <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of megabytes")
    return size


def _with_help(parser: argparse.ArgumentParser, name: Optional[str]) -> argparse.ArgumentParser:
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = f"{_EXAMPLES[name]}\n{_STATUSES}"
    return parser


def _second(text: str) -> int:
    from decimal import Decimal, InvalidOperation

    try:
        return int(Decimal(text) * SECOND)
    except (InvalidOperation, ValueError, OverflowError):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds") from None


def _seconds(text: str) -> Tuple[int, ...]:
    parts: List[str] = text.split(",")
    return tuple(_second(part) for part in parts)


def _names(text: str) -> Tuple[str, ...]:
    names = tuple(part.strip() for part in text.split(","))
    if not all(names):
        raise argparse.ArgumentTypeError(f"{text!r} has an empty name")
    return names


# --- info and doctor --------------------------------------------------------------------------------------------------


def _info(options: argparse.Namespace) -> bool:
    """Show topics, counts, times and rates."""
    from .info import info_result

    results, errors = _each(options.bags, lambda path: info_result(path, options.memory))
    lines: List[str] = []
    for result in results:
        if "error" not in result:
            lines += [*([""] if lines else []), *_info_lines(result)]
    _show(lines, results, as_json=options.json)
    _raise_last(errors)
    return any(result.get("damaged") for result in results)


def _doctor(options: argparse.Namespace) -> bool:
    """Show what is damaged."""
    from .recover.scan import scan

    lines: List[str] = []
    damaged = False

    def look(path: Path) -> Dict[str, Any]:
        nonlocal damaged
        with _progress_bar(f"look through {path.name}") as progress:
            found = scan(path, check_data=not options.quick, memory=options.memory, progress=progress)
        step, start_ns = None, 0
        if not options.quick:  # it takes numpy, whose start takes longer than the look at most bags
            from .info import clock_set_back

            step, start_ns = clock_set_back(found)
        lines.extend(_scan_lines(found, [] if step is None else [step.words(start_ns)]))
        damaged = damaged or bool(found.damages) or not found.closed or step is not None
        return {**_scan_result(found), "clock_set_back_s": None if step is None else step.by_ns / SECOND}

    results, errors = _each(options.bags, look)
    _show(lines, results, as_json=options.json)
    _raise_last(errors)
    return damaged


def _each(bags: Sequence[Path], look: Callable[[Path], Dict[str, Any]]) -> Tuple[List[Dict[str, Any]], List[BagError]]:
    """Return what is found of each bag, and what was wrong with those that could not be read."""
    results: List[Dict[str, Any]] = []
    errors: List[BagError] = []
    for path in bags:
        try:
            results.append(look(path))
        except BagError as error:
            errors.append(error)
            results.append({"file": str(path), "error": f"{error.wrong}; {error.remedy}"})
    return results, errors


def _raise_last(errors: Sequence[BagError]) -> None:
    """Say what was wrong, one line each; the last one is said by whoever ends the command."""
    for error in errors[:-1]:
        say_wrong("amaze-bag", str(error), IMPOSSIBLE)
    if errors:
        raise errors[-1]


# --- recover ----------------------------------------------------------------------------------------------------------


def _recover(options: argparse.Namespace) -> bool:
    """Write what is good into a new bag, or close a bag in place, or undo that."""
    from .recover.recover import restore

    if options.undo:
        original = restore(options.bag)
        _show([f"{original}: as it was"], {"file": str(original), "restored": True}, as_json=options.json)
        return False
    with _progress_bar(f"recover {options.bag.name}") as progress:
        done = _recovered(options, progress)
    result = {**_scan_result(done.scan), "output": str(done.path), "output_bytes": done.size}
    _show(_recover_lines(done), result, as_json=options.json)
    return not done.complete


def _recovered(options: argparse.Namespace, progress: Any) -> Recovered:
    from .recover.recover import recover, recover_in_place, recovered_name

    how = {"check_data": not options.trust_data, "memory": options.memory, "progress": progress}
    if options.in_place:
        return recover_in_place(options.bag, **how)
    output = options.output or recovered_name(options.bag)
    return recover(options.bag, output, replace=options.force, **how)


# --- merge and verify -------------------------------------------------------------------------------------------------


def _merge(options: argparse.Namespace) -> bool:
    """Merge, write the manifest, verify if asked."""
    from .merge.manifest import check_place, manifest_path, merge_manifest, write_manifest
    from .merge.merge import MergeOptions, merge

    for option, given in (("--offsets-s", options.offsets_s), ("--origins", options.origins)):
        if given and len(given) != len(options.inputs):
            what = option[2:].split("-")[0]
            raise BagError(option, f"{len(given)} {what} for {len(options.inputs)} inputs", "give one each")
    how = MergeOptions(
        compression=options.compression,
        offsets_ns=options.offsets_s,
        duplicates=options.duplicates,
        origins=tuple(map(list(dict.fromkeys(options.origins)).index, options.origins)),
        window_ns=options.window_s,
        publishers_apart=not options.unify_publishers,
        replace=options.force,
        memory=options.memory,
    )
    check_output(manifest_path(options.output), "-o", Kind("manifest", _is_manifest))
    check_place(options.output)
    with _progress_bar("merge") as progress:
        merged = merge(options.inputs, options.output, how, progress)
    manifest = merge_manifest(merged, options.inputs, how)
    write_manifest(manifest_path(merged.path), manifest)
    lines = _merge_lines(merged)
    verified = None
    if options.verify:
        verified, manifest = _verified(merged.path, options.inputs, how.offsets_ns, manifest, options)
        lines += _verify_lines(verified)
    _show(lines, manifest, as_json=options.json)
    if verified:
        _keep_verdict(merged.path, manifest)
    return bool(verified and verified.problems)


def _is_manifest(path: Path) -> bool:
    from .merge.manifest import read_manifest

    try:
        read_manifest(path)
    except BagError:
        return False
    return True


def _filter(options: argparse.Namespace) -> bool:
    """Write a part of a bag, verify it if asked."""
    from .merge.filter import Part, filter_bag, verify_part
    from .merge.merge import MergeOptions

    begin, end = options.begin or (0, None), options.end or (None, None)
    if None not in (begin[1], end[1]) and begin[1] != end[1]:
        raise BagError("--from and --to", "are not of one kind", "give both in seconds, or both as dates")
    relative = begin[1] is not False and end[1] is not False
    times = (begin[0], end[0], relative)
    if not relative or end[0] is None or begin[0] < end[0]:
        part = Part(tuple(options.topics), tuple(options.without), tuple(options.types), *times, options.latched)
    else:
        raise BagError("--from and --to", f"{begin[0] / SECOND} s is not before {end[0] / SECOND} s", "exchange them")
    how = MergeOptions(compression=options.compression, replace=options.force, memory=options.memory)
    with _progress_bar(options.name) as progress:
        merged = filter_bag(options.bag, options.output, part, how, progress)
    lines, problems = _merge_lines(merged), False
    result: Dict[str, Any] = {"output": str(merged.path), "bytes": merged.size, "messages": merged.messages}
    if options.verify:
        with _progress_bar("verify") as progress:
            asked = {"readers": options.readers, "memory": options.memory, "progress": progress}
            verified = verify_part(options.bag, options.output, part, **asked)
        lines, problems = [*lines, *_verify_lines(verified)], bool(verified.problems)
        result["problems"] = list(verified.problems)
    _show(lines, result, as_json=options.json)
    return problems


def _verify(options: argparse.Namespace) -> bool:
    """Verify a merged bag and write the verdict into its manifest, where that is of these inputs."""
    from .merge.manifest import applied_offsets, changed_inputs, check_place, manifest_path, read_manifest

    check_place(options.bag)
    place = manifest_path(options.bag)
    manifest = read_manifest(place) if place.is_file() else None
    inputs, offsets = options.inputs, options.offsets_s
    if not inputs and manifest:
        inputs = [options.bag.parent / entry["file"] for entry in manifest["inputs"]]
        gone = [path for path in inputs if not path.exists()]
        if gone and not offsets and (manifest.get("verified") or {}).get("ok"):
            return _verify_without(options, manifest, gone)
    if manifest and not offsets:
        offsets = applied_offsets(manifest, inputs, options.bag.parent)
    if offsets and len(offsets) != len(inputs):
        raise BagError("--offsets-s", f"{len(offsets)} offsets for {len(inputs)} inputs", "give one each")
    verified, new = _verified(options.bag, inputs, offsets, manifest, options)
    _show(_verify_lines(verified), new, as_json=options.json)
    changed = changed_inputs(new, manifest) if manifest else []
    if manifest and inputs and changed != []:
        words = _other_inputs(new, manifest, changed)
        say_wrong("amaze-bag", f"{place}: {words}; the verdict was not written into it", DONE)
    elif inputs:
        _keep_verdict(options.bag, new)
    return bool(verified.problems)


def _other_inputs(new: Dict[str, Any], manifest: Dict[str, Any], changed: Optional[Sequence[str]]) -> str:
    """Return how what was verified is not of the inputs that a manifest names: of one that rotted the bag is better."""
    if not changed:
        return "is of other inputs"
    intact = new["output"]["sha256"] == manifest["output"].get("sha256")
    said = "is not what it was" if len(changed) == 1 else "are not what they were"
    bag = f", and {new['output']['file']} is" if intact else ""
    return f"{', '.join(changed)} {said} when this was verified{bag}"


def _verify_without(options: argparse.Namespace, manifest: Dict[str, Any], gone: Sequence[Path]) -> bool:
    """Verify a bag whose inputs are gone, as parts that were removed on purpose, by what its manifest says of it."""
    verified, new = _verified(options.bag, [], (), manifest, options, before=manifest["output"])
    names = [os.path.relpath(path, options.bag.parent) for path in gone]
    said = "compared with what the manifest says since it was verified"
    said = f"  inputs that cannot be found: {', '.join(names)}; {said}"
    head = 1 + len(verified.problems)
    lines = _verify_lines(verified)
    _show([*lines[:head], said, *lines[head:]], {**new, "gone": names}, as_json=options.json)
    return bool(verified.problems)


def _verified(
    bag: Path,
    inputs: List[Path],
    offsets: Tuple[int, ...],
    manifest: Optional[Dict[str, Any]],
    options: argparse.Namespace,
    before: Optional[Dict[str, Any]] = None,
) -> Tuple[Verified, Dict[str, Any]]:
    from .merge.manifest import declared_duplicates, verified_manifest
    from .merge.verify import verify

    duplicates = declared_duplicates(manifest) if manifest else {}

    with _progress_bar("verify") as progress:
        how = {"readers": options.readers, "memory": options.memory, "progress": progress}
        verified = verify(bag, inputs, offsets_ns=offsets, duplicates=duplicates, before=before, **how)
    return verified, verified_manifest(manifest, verified, offsets)


def _keep_verdict(bag: Path, manifest: Dict[str, Any]) -> None:
    """Write a manifest with a verdict that was shown; where that cannot be, as on a read-only medium, say so."""
    from .merge.manifest import manifest_path, write_manifest

    try:
        write_manifest(manifest_path(bag), manifest)
    except OSError as error:
        say_wrong("amaze-bag", f"{manifest_path(bag)}: {error.strerror}; the verdict was not written into it", DONE)


# --- lines and JSON ---------------------------------------------------------------------------------------------------


def _show(lines: Sequence[str], result: Any, *, as_json: bool) -> None:
    """Print one or the other; what is not UTF-8, or would move a terminal's cursor, is shown with escapes."""
    text = json.dumps(result, indent=2) if as_json else "\n".join(map(_escaped, lines))
    if text:
        sys.stdout.write(text.encode("utf-8", "backslashreplace").decode() + "\n")


def _escaped(line: str) -> str:
    return "".join(each if each.isprintable() or "\ud800" <= each <= "\udfff" else ascii(each)[1:-1] for each in line)


def _info_lines(result: Dict[str, Any]) -> List[str]:
    """Return a bag as a table."""
    start, end = result["start_ns"], result["end_ns"]
    length = f", {(end - start) / SECOND:.2f} s from {_date(start)} to {_date(end)}" if start is not None else ""
    lines = [
        result["file"],
        f"  {result['messages']:,} messages{length}; {_size(result['bytes'])}; {_version(result['version'])}",
        f"  chunks: {', '.join(_chunks(*each) for each in result['compression'].items()) or 'none'}",
        *(
            []
            if result["closed"]
            else [f"  {result['problem']}{': this is what is in its chunks' * bool(result['chunks'])}"]
        ),
    ]
    wide = max((len(row["topic"]) for row in result["topics"]), default=0)
    kinds = max((len(row["type"]) for row in result["topics"]), default=0)
    for row in result["topics"]:
        rate = f"{row['rate_hz']:9.2f} Hz" if row["rate_hz"] is not None else " " * 12
        gap = f"   longest gap {row['longest_gap_s']:.3f} s" if row["messages"] else ""
        several = f"   {row['connections']} publishers" if row["connections"] > 1 else ""
        md5 = f"   {result['types'][row['type']]}"
        lines.append(
            f"  {row['topic']:<{wide}}  {row['type']:<{kinds}}  {row['messages']:>9,}{rate}{gap}{several}{md5}"
        )
    return [line.rstrip() for line in lines]


def _version(version: str) -> str:
    return f"version {version}" if version[0].isdigit() else version


def _chunks(kind: str, known: Dict[str, int]) -> str:
    """Return how chunks are compressed, as `12 lz4 (45.3 % of 1.2 MB)`."""
    of = (
        ""
        if kind == "none" or not known["size"]
        else f" ({known['stored'] / known['size']:.1%} of {_size(known['size'])})"
    )
    return f"{known['chunks']} {kind}{of}"


def _date(t_ns: int) -> str:
    return datetime.fromtimestamp(t_ns // SECOND, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")


def _size(size: int) -> str:
    return f"{size / MB:,.1f} MB"


def _lost(lost: Optional[int]) -> str:
    return "an unknown number of messages" if lost is None else f"{lost:,} messages"


def _scan_result(found: Scan) -> Dict[str, Any]:
    """Return what was found in a file."""
    return {
        "file": str(found.path),
        "bytes": found.size,
        "closed": found.closed,
        "chunks": len(found.chunks),
        "messages": found.messages,
        "lost": found.lost,
        "checked": found.checked,
        "damages": [each._asdict() for each in found.damages],
        "bytes_read": found.bytes_read,
    }


def _scan_lines(found: Scan, besides: Sequence[str]) -> List[str]:
    """Return the damages of a file, and what is wrong besides."""
    verdict = "is good" if not (found.damages or besides) and found.closed else f"lost: {_lost(found.lost)}"
    verdict += _UNCHECKED if not found.checked else ""
    head = f"{found.path}: {found.messages:,} messages in {len(found.chunks):,} chunks; {verdict}"
    return [head, *(f"  {each}" for each in (*found.damages, *besides))]


def _recover_lines(done: Recovered) -> List[str]:
    """Return what was recovered."""
    head = f"{done.path}: {done.scan.messages:,} messages, {_size(done.size)}; lost: {_lost(done.scan.lost)}"
    head += _UNCHECKED if not done.scan.checked else ""
    return [head, *(f"  {each}" for each in done.scan.damages)]


def _merge_lines(merged: Merged) -> List[str]:
    """Return what was merged."""
    return [
        f"{merged.path}: {merged.messages:,} messages, {_size(merged.size)}",
        *(f"  warning: {line}" for line in merged.warnings),
    ]


def _verify_lines(verified: Verified) -> List[str]:
    """Return the verdict, the problems, and who was asked."""
    output = verified.output
    of = f" of {len(verified.inputs)} inputs" if verified.inputs else ""
    verdict = f"{len(verified.problems)} problems" if verified.problems else "verified"
    lines = [f"{output.path}: {output.messages:,} messages{of}: {verdict}"]
    lines += [f"  problem: {line}" for line in verified.problems]
    for each in verified.readings:
        lines.append(f"  {each.reader}: {each.error or f'{sum(each.messages.values()):,} messages'}")
    return lines


Report = Callable[[int, int], None]


@contextmanager
def _progress_bar(what: str) -> Iterator[Optional[Report]]:
    """Show a progress bar on the standard error stream when it is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


if __name__ == "__main__":
    raise SystemExit(main())
