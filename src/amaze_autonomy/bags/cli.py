"""`amaze-bag`: look into bags, find damage, recover, merge, verify; on any machine, without ROS."""

from __future__ import annotations

import argparse
import os
from importlib import import_module
from pathlib import Path
from typing import Any, List, Optional, Sequence, Tuple

from amaze_autonomy.command_line import run_command

from .errors import BagError

__all__ = ["main"]

DONE, IMPOSSIBLE, USAGE, LOST = 0, 1, 2, 3
_COMPRESSIONS = ("auto", "none", "lz4", "bz2")
_STATUSES = """\
exit status:
  0  done, nothing is wrong
  1  cannot be done (one line says why and what to do)
  2  wrong use of the command
  3  done, but data was lost, or is damaged, or differs
"""
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
  amaze-bag recover broken.bag -o good.bag --check-data
  amaze-bag recover --in-place flight.bag.active      no copy: flight.bag, and flight.bag.undo
  amaze-bag recover --undo flight.bag                 flight.bag.active as it was
""",
    "merge": """\
examples:
  amaze-bag merge main.bag camera.bag -o flight.bag
  amaze-bag merge main_*.bag camera_*.bag -o flight.bag --compression lz4 --verify
  amaze-bag merge main.bag camera.bag -o flight.bag --offsets-s 0,-3.02     the camera's clock was 3.02 s ahead
  amaze-bag merge main.bag camera.bag -o flight.bag --duplicates drop       both recorded /rosout
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
    module, function = options.command.split(".")  # loaded after that, and only what this command needs

    def command() -> int:
        _check_named(options)
        lost = getattr(import_module(f".{module}", __package__), function)(options)
        return LOST if lost else DONE

    return run_command("amaze-bag", command, (BagError,), wrong=IMPOSSIBLE)


def _check_named(options: argparse.Namespace) -> None:
    """Refuse a folder that has not even a name, to which others could be given."""
    for path in (*vars(options).values(), *getattr(options, "inputs", ()), *getattr(options, "bags", ())):
        if isinstance(path, Path) and not path.name:
            raise BagError(str(path), "is a folder", "name a bag in it")


def _parser() -> argparse.ArgumentParser:
    parser = _with_help(argparse.ArgumentParser(prog="amaze-bag", description=__doc__.split("`: ", 1)[1]), None)
    adder = parser.add_subparsers(metavar="COMMAND", dest="name", required=True)

    info = _command(adder, "info", "topics, types, counts, rates, gaps; reads the index only", "looking.info")
    info.add_argument("bags", nargs="+", type=Path, metavar="BAG")

    doctor = _command(adder, "doctor", "find damage, with offsets; changes nothing", "looking.doctor")
    doctor.add_argument("bags", nargs="+", type=Path, metavar="BAG")
    doctor.add_argument("--quick", action="store_true", help="do not read the data of whole chunks")

    recover = _command(
        adder, "recover", "write what is good into a new bag, or close a bag in place", "recovering.recover_bag"
    )
    recover.add_argument("bag", type=Path, metavar="BAG", help="is only read, but for --in-place and --undo")
    where = recover.add_mutually_exclusive_group()
    where.add_argument("-o", "--output", type=Path, help="default: x.bag for x.bag.active, else x.recovered.bag")
    where.add_argument("--in-place", action="store_true", help="no copy: change the end of the bag, keep x.bag.undo")
    where.add_argument("--undo", action="store_true", help="make the original of what was recovered in place")
    recover.add_argument("--check-data", action="store_true", help="check the data of whole chunks, too (reads it all)")
    recover.add_argument("--force", action="store_true", help="replace an existing output")

    _add_merge(adder)
    verify = _command(
        adder, "verify", "compare a merged bag with its inputs, and readers with each other", "merging.verify_bag"
    )
    verify.add_argument("bag", type=Path, metavar="BAG")
    verify.add_argument("inputs", nargs="*", type=Path, metavar="INPUT", help="default: those of the manifest")
    verify.add_argument("--offsets-s", type=_seconds, default=(), metavar="S,S,...", help="that the merge applied")
    _add_readers(verify)
    return parser


def _add_merge(adder: Any) -> None:
    merge = _command(adder, "merge", "several bags into one, in order of time", "merging.merge_bags")
    merge.add_argument("inputs", nargs="+", type=Path, metavar="INPUT", help="is only read")
    merge.add_argument("-o", "--output", type=Path, required=True)
    merge.add_argument(
        "--compression",
        choices=_COMPRESSIONS,
        default="auto",
        help="of the output; auto (default): copied chunks as they are, all others none",
    )
    merge.add_argument("--offsets-s", type=_seconds, default=(), metavar="S,S,...", help="added to each input's times")
    merge.add_argument(
        "--duplicates", choices=("count", "drop", "ignore"), default="count", help="messages that several inputs have"
    )
    merge.add_argument(
        "--window-s", type=_second, default=1_000_000_000, metavar="S", help="in which duplicates are (default 1)"
    )
    merge.add_argument("--unify-publishers", action="store_true", help="one connection for all publishers of a topic")
    merge.add_argument("--force", action="store_true", help="replace an existing output")
    merge.add_argument("--verify", action="store_true", help="then verify, as the command verify does")
    _add_readers(merge)


def _add_readers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--readers",
        choices=("none", "open", "read"),
        default="open",
        help="what other readers are asked, where installed: nothing, the index (default), every message",
    )


def _command(adder: Any, name: str, text: str, function: str) -> argparse.ArgumentParser:
    parser = _with_help(adder.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}."), name)
    parser.set_defaults(command=function)
    parser.add_argument("--json", action="store_true", help="for programs")
    return parser


def _with_help(parser: argparse.ArgumentParser, name: Optional[str]) -> argparse.ArgumentParser:
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = f"{_EXAMPLES[name]}\n{_STATUSES}"
    return parser


def _second(text: str) -> int:
    from decimal import Decimal, InvalidOperation  # noqa: PLC0415  (seldom wanted)

    try:
        return int(Decimal(text) * 1_000_000_000)
    except (InvalidOperation, ValueError, OverflowError):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds") from None


def _seconds(text: str) -> Tuple[int, ...]:
    parts: List[str] = text.split(",")
    return tuple(_second(part) for part in parts)


if __name__ == "__main__":
    raise SystemExit(main())
