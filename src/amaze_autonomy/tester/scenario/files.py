"""From scenario files to cases: one for a file, or one for each combination of its matrix."""

from __future__ import annotations

import difflib
import os
import re
from itertools import product
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.config.document import Entry, Items, Scalar, Table, parse, read, replace
from amaze_autonomy.config.errors import ConfigError, Place
from amaze_autonomy.config.kinds import dotted, refuse

from ...replay.errors import ReplayError
from ..expect.model import Expectation
from .model import OVERRIDE, Anchor, Bag, Case, Need, schema_of

SUFFIX = ".scenario.yaml"
_S = 1_000_000_000
_LONGEST = 40
_Variant = Tuple[str, Entry]


def find_files(paths: Iterable[Path]) -> Tuple[Path, ...]:
    """Return all scenario files: those named, and those in the folders named, sorted by path.

    Raises:
        ReplayError: there is none at one of the paths.
    """
    found: List[Path] = []
    for path in paths:
        files = sorted(path.rglob(f"*{SUFFIX}")) if path.is_dir() else [path]
        if not files or not all(file.is_file() for file in files):
            raise ReplayError(f"{path}: there is no scenario; name a folder with *{SUFFIX}, or a file")
        found += files
    return tuple(dict.fromkeys(found))


def load_cases(path: Path) -> Tuple[Case, ...]:
    """Read a scenario file.

    Raises:
        ConfigError: the first mistake in it, with file and line.
    """
    return cases_of(read(path), path)


def cases_of(tree: Entry, path: Path) -> Tuple[Case, ...]:
    """Return the cases of a scenario; `path` is that of its file.

    Raises:
        ConfigError: the first mistake in it, with line.
    """
    tree = _with_version(tree)
    matrix = schema_of(tree).read(tree, (), {})["matrix"]
    if matrix is None:
        return (_case(tree, path, ""),)
    return tuple(_case(each, path, name) for name, each in _variants(tree, matrix))


def _with_version(tree: Entry) -> Entry:
    """Let `version: 1` be written without quotes."""
    if not isinstance(tree, Table) or "version" not in tree.entries:
        return tree
    place, version = tree.entries["version"]
    if not isinstance(version, Scalar) or version.tag != "int":
        return tree
    return Table(tree.place, {**tree.entries, "version": (place, Scalar(version.place, version.text, "str"))})


def _variants(tree: Entry, matrix: Mapping[str, Sequence[Entry]]) -> List[_Variant]:
    lasts = [address.rpartition(".")[2] for address in matrix]
    labels = [
        last if lasts.count(last) == 1 and not last.isdecimal() else address for address, last in zip(matrix, lasts)
    ]
    named = [_named(address, values) for address, values in matrix.items()]
    variants: List[_Variant] = []
    for values in product(*named):
        changed = tree
        for address, (_, value) in zip(matrix, values):
            changed = _set(changed, address, value)
        variants.append((",".join(f"{label}={word}" for label, (word, _) in zip(labels, values)), changed))
    return variants


def _named(address: str, values: Sequence[Entry]) -> Tuple[_Variant, ...]:
    """Return the values of an address with a name for each: two that would have one name are told apart by a number."""
    texts = [_short(value, number) for number, value in enumerate(values, 1)]
    names: List[str] = []
    for number, (text, value) in enumerate(zip(texts, values)):
        if isinstance(value, Scalar) and text in texts[:number]:
            refuse(value, ("matrix", address), f"has {text} twice", "must have each value once")
        names.append(f"{text}-{texts[: number + 1].count(text)}" if text in texts[:number] else text)
    return tuple(zip(names, values))


def _short(entry: Entry, number: int) -> str:
    """Return a value as part of a name: its text, or which it is when that is long."""
    text = _text(entry)
    return text if len(text) <= _LONGEST else str(number)


def _set(tree: Entry, address: str, value: Entry) -> Entry:
    path: Tuple[str, ...] = tuple(address.split("."))
    if re.fullmatch(OVERRIDE, address):
        path = ("configuration", "set", address)
    if path[0] in ("matrix", "version", "description"):
        refuse(value, ("matrix", address), "cannot vary", "must address anything else of the scenario")
    changed = replace(tree, path, value) if _leads(tree, path) else None
    if changed is None:
        refuse(value, ("matrix", address), "addresses nothing", "must be a key of the scenario, e.g. faults.0.at_s")
    return changed


def _leads(tree: Entry, path: Tuple[str, ...]) -> bool:
    """Return True when a path leads through no list that is not there: "faults.0.at_s" where there are no faults."""
    if not isinstance(tree, Table):
        return True
    if path[0] not in tree.entries:
        return not any(each.isdecimal() for each in path)
    return len(path) == 1 or _leads(tree.entries[path[0]][1], path[1:])


def _text(entry: Entry) -> str:
    """Return a value of a matrix as part of a name: a fault by what fails and how."""
    if isinstance(entry, Scalar):
        return entry.text
    if isinstance(entry, Table):
        words = (
            entry.entries[key][1]
            for key in ("component", "process", "service", "topic", "fault")
            if key in entry.entries
        )
        return "-".join(_text(word) for word in words).strip("/").replace("/", ".") or "group"
    return "+".join(_text(item) for item in entry.items) if isinstance(entry, Items) else "value"


def _case(tree: Entry, path: Path, variant: str) -> Case:
    values: Dict[str, Any] = schema_of(tree).read(tree, (), {})
    folder = path.parent
    configuration = values["configuration"] or {}
    anchors: Tuple[Anchor, ...] = tuple((values["anchors"] or {}).values())
    expectations: Tuple[Expectation, ...] = tuple(values["expectations"])
    from_s, to_s = values.get("from_s") or 0.0, values.get("to_s")
    if to_s is not None and to_s <= from_s:
        raise ConfigError(placed(tree, ("to_s",)), "to_s", f"is {to_s:g}", f"must be above from_s ({from_s:g})")
    if "bags" in values and len(values["missions"] or ()) > 1:
        right = "must be one with bags: a recording is of one mission"
        raise ConfigError(placed(tree, ("missions",)), "missions", f"has {len(values['missions'])}", right)
    _check_bags(tree, [bag["path"] for bag in values.get("bags", ())])
    _check_anchors(tree, anchors, expectations, len(values.get("faults", ())))
    return Case(
        path=path,
        name=scenario_name(path),
        variant=variant,
        description=values["description"],
        bags=tuple(Bag(_located(folder, bag["path"]), bag["sha256"] or "") for bag in values.get("bags", ())),
        journal=_beside(folder, values.get("journal")),
        events=tuple(values.get("events", ())),
        checks=tuple(values.get("checks") or ()),
        from_ns=round(values.get("from_s", 0.0) * _S),
        to_ns=None if values.get("to_s") is None else round(values["to_s"] * _S),
        topic_map=_map(folder, values.get("map")),
        missions=tuple(values.get("missions") or ()),
        configuration=_beside(folder, configuration.get("folder")),
        overrides=dict(configuration.get("set") or {}),
        seed=values.get("seed", 0),
        limit_ns=round(values.get("limit_s", 7200.0) * _S),
        needs=tuple(
            Need(need["topic"], need["rate_hz"], None if need["gap_s"] is None else round(need["gap_s"] * _S))
            for need in values.get("needs", ())
        ),
        anchors=anchors,
        faults=tuple(values.get("faults", ())),
        requests=tuple(values.get("requests", ())),
        expectations=expectations,
        tags=tuple(values["tags"]),
        requirements=tuple(values["requirements"]),
    )


def scenario_name(path: Path) -> str:
    """Return the name of the scenario in a file, which can be read or not."""
    return path.name[: -len(SUFFIX)] if path.name.endswith(SUFFIX) else path.stem


def _beside(folder: Path, path: Optional[str]) -> Optional[Path]:
    return None if path is None else _located(folder, path)


def _located(folder: Path, path: str) -> Path:
    """Return a path from the folder of the scenario; one that begins with ${NAME} is from where the variable says."""
    variable = re.match(r"\$\{(\w+)\}/?", path)
    if variable is None:
        return folder / path
    value = os.environ.get(variable.group(1))
    return Path(path) if value is None else Path(value) / path[variable.end() :]


def _map(folder: Path, name: Optional[str]) -> str:
    """Return a shipped map's name, or the path of a map beside the scenario."""
    return "" if name is None else str(folder / name) if name.endswith(".yaml") else name


def _check_bags(tree: Entry, paths: Sequence[str]) -> None:
    """Refuse a bag that is named twice: each of its messages would come twice."""
    for number, path in enumerate(paths):
        if path in paths[:number]:
            address = ("bags", str(number), "path")
            raise ConfigError(placed(tree, address), dotted(address), f"is {path} again", "must name each bag once")


def _check_anchors(tree: Entry, anchors: Sequence[Anchor], expectations: Sequence[Expectation], faults: int) -> None:
    """Refuse an expectation about an anchor that is not there, and an anchor at a fault that is not there."""
    names = [anchor.name for anchor in anchors]
    for anchor in anchors:
        if anchor.fault > faults:
            right = f"must be one of the {faults} faults, from 1" if faults else "there is no fault"
            address = ("anchors", anchor.name, "fault")
            raise ConfigError(placed(tree, address), dotted(address), f"is {anchor.fault}", right)
    for number, expectation in enumerate(expectations):
        for key, instant in (("from", expectation.begin), ("to", expectation.end)):
            if isinstance(instant, str) and instant not in names:
                close = difflib.get_close_matches(instant, names, n=1)
                known = f"did you mean {close[0]}?" if close else f"must be one of {', '.join(names) or 'none'}"
                file, _, line = expectation.where.rpartition(":")
                place = Place(file, int(line)) if line.isdecimal() else tree.place
                raise ConfigError(place, f"expectations.{number}.{key}", f"{instant} is no anchor", known)


def parse_cases(text: str, path: Path) -> Tuple[Case, ...]:
    """Read a scenario from a text; `path` is that of its file, which need not exist.

    Raises:
        ConfigError: the first mistake in it, with line.
    """
    return cases_of(parse(text, str(path)), path)


# --- places -----------------------------------------------------------------------------------------------------------
# Where something stands in a scenario file, for mistakes that only show when it is run.


def place_of(path: Path, *addresses: Tuple[str, ...]) -> Place:
    """Return where the first of some addresses stands that a scenario file has; else the file."""
    try:
        tree = read(path)
    except ConfigError:
        return Place(str(path))
    found = (_place(tree, address) for address in addresses)
    return next((place for place in found if place is not None), Place(str(path)))


def placed(tree: Entry, address: Tuple[str, ...]) -> Place:
    """Return where an address stands; where the tree begins when it has none."""
    return _place(tree, address) or tree.place


def _place(tree: Entry, address: Tuple[str, ...]) -> Optional[Place]:
    place, entry = tree.place, tree
    for name in address:
        if isinstance(entry, Table) and name in entry.entries:
            place, entry = entry.entries[name]
        elif isinstance(entry, Items) and name.isdecimal() and int(name) < len(entry.items):
            entry = entry.items[int(name)]
            place = entry.place
        else:
            return None
    return place


def meant(name: str, known: Iterable[str], otherwise: str = "there is") -> str:
    """Return the second half of an error about a name: which was meant, else which there are."""
    names = tuple(dict.fromkeys(known))
    close = difflib.get_close_matches(name, names, n=1)
    return f"did you mean {close[0]}?" if close else f"{otherwise} {', '.join(names) or 'none'}"
