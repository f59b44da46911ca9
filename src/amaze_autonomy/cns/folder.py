"""What the files of a folder of the CNS Flight Stack say, as rows: missions, topics, nodes and drivers, read strictly.

A file of its stack that cannot be read is refused; one that is none of it is left out, and named in the report.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, NoReturn, Optional, Set, Tuple

import yaml

MISSIONS, ENTITY = "missions", "entity_id"
KINDS: Mapping[str, Tuple[str, ...]] = {
    "topics": ("rate", "margin", "node_name", "window_size"),
    "nodes": ("max_restart_attempts", "restart_timeout"),
    "drivers": ("check_script", "restart_script"),
}  # keys of a row, beside the entity's: a file in which a row has both is one of the watchdog's
ONE_FLIGHT, HOVER = "sequence_multiple_in_flight", "hover_after_mission_completion"
_OPTIONS = (ONE_FLIGHT, HOVER)  # of a mission, or beside the missions: of each
_OF_ITS_STACK = re.compile(rf"^\s*['\"]?{MISSIONS}['\"]?\s*:|\b{ENTITY}\b", re.MULTILINE)
_HINTS: Tuple[Tuple[re.Pattern[str], str], ...] = (
    (
        re.compile(r"aux|land_channel|(?<![a-z])rc(?![a-z])", re.IGNORECASE),
        "no switch lands; set land_switch.channel (from 1) and its threshold land_switch.above_us in autopilot.yaml",
    ),
    (
        re.compile(r"bound|(?<![a-z])(min|max)_?[xyz](?![a-z])", re.IGNORECASE),
        "where waypoints may be is not taken from here; with peers:=cns say cns_bounds:=X,Y,Z,X,Y,Z, the least and the "
        "most in metres",
    ),
)  # keys that have no counterpart in a file of ours, by their names, and what to do
_SHELL = re.compile(r"[;&|<>()$`*?{}\n]|(^|\s)~")  # in a command, outside of quotes


class ImportFolderError(ValueError):
    """A folder cannot be imported: what is wrong, and what would be right."""


@dataclass
class Report:
    """What became of a folder.

    Args:
        translated: what it says, and what that is here.
        no_counterpart: what it says and nothing here does.
        assumed: what is here and it does not say.
    """

    translated: List[str] = field(default_factory=list)
    no_counterpart: List[str] = field(default_factory=list)
    assumed: List[str] = field(default_factory=list)

    def text(self) -> str:
        """Return it for a person."""
        parts = (("Translated", self.translated), ("No counterpart", self.no_counterpart), ("Assumed", self.assumed))
        return "\n".join(
            "\n".join((f"{title}:", *(f"  {line}" for line in lines or ["nothing"]))) for title, lines in parts
        )


# --- rows -------------------------------------------------------------------------------------------------------------


class Row(NamedTuple):
    """A mission, a topic, a node or a driver, as a file has it."""

    file: Path
    name: str
    values: Mapping[str, Any]

    def refuse(self, wrong: str, right: str) -> NoReturn:
        """Say what is wrong with it.

        Raises:
            ImportFolderError: always.
        """
        raise ImportFolderError(f"{self.file}: {self.name}: {wrong}; {right}")

    def _refuse_value(self, key: str, right: str) -> NoReturn:
        value = self.values.get(key)
        self.refuse(f"{key} is {'missing' if value is None else repr(value)}", right)

    def text(self, key: str) -> str:
        """Return a text; empty: there is none."""
        value = self.values.get(key)
        if isinstance(value, (dict, list)):
            self._refuse_value(key, "must be a text")
        return "" if value is None else str(value)

    def flag(self, key: str) -> bool:
        """Return what is true or false; false: it does not say."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            self._refuse_value(key, "must be true or false, without quotes")
        return value

    def count(self, key: str) -> int:
        """Return a whole number above 0; 1: it does not say."""
        value: Any = self.values.get(key, 1)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            self._refuse_value(key, "must be a whole number, at least 1")
        return int(value)

    def number(self, key: str, otherwise: Optional[float] = None) -> float:
        """Return a number; None: it must be there."""
        value = self.values.get(key, otherwise)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value < float("inf"):
            self._refuse_value(key, "must be a number, not negative")
        if key == "rate" and value <= 0.0:
            self._refuse_value(key, "must be above 0, in Hz")
        return float(value)

    def items(self, key: str, right: str) -> List[Any]:
        """Return a list; empty: there is none."""
        value = self.values.get(key)
        if value is not None and not isinstance(value, list):
            self._refuse_value(key, right)
        return value or []

    def trajectories(self) -> List[str]:
        """Return the paths of the trajectories of a mission."""
        right = "must be a list of trajectories, e.g. [square.csv]"
        found = self.items("filepaths", right)
        if not found:
            self._refuse_value("filepaths", right)
        for path in found:
            if not isinstance(path, str) or not parts_of(path):
                self.refuse(f"filepaths has {path!r}", "must be the path of a trajectory")
        return found

    def command(self, key: str) -> List[str]:
        """Return a program and its arguments; empty: there is none."""
        value = self.values.get(key)
        text = value if isinstance(value, str) else ""
        try:
            words = shlex.split(text)
        except ValueError:  # a quote is not closed
            words = []
        if value not in (None, "") and (not words or _SHELL.search(re.sub("'[^']*'", "", text))):
            self._refuse_value(key, "must be a program and its arguments, without what a shell alone understands")
        return words


class _Loader(yaml.SafeLoader):
    """Refuses a name that is there twice: the first would be lost."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Dict[Any, Any]:  # noqa: FBT001, FBT002
        """Return a group."""
        names: Set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in names:
                raise yaml.constructor.ConstructorError(None, None, f"{key.value} is there twice", key.start_mark)
            names.add(key.value if isinstance(key, yaml.ScalarNode) else "")
        return super().construct_mapping(node, deep=deep)


def read_folder(folder: Path, report: Report) -> Dict[str, Dict[str, Row]]:
    """Return what the YAML files hold, by kind and name.

    Raises:
        ImportFolderError: a file of its stack cannot be read, or there are no missions or no topics.
    """
    found: Dict[str, Dict[str, Row]] = {kind: {} for kind in (MISSIONS, *KINDS)}
    for path in sorted(path for end in ("yaml", "yml") for path in folder.rglob(f"*.{end}") if path.is_file()):
        name = path.relative_to(folder).as_posix()
        try:
            content = _content(path)
        except _ForeignError as error:
            report.no_counterpart.append(f"{name}: is not read as YAML: {error}")
            continue
        kind = _kind(content)
        if kind is None:
            report.no_counterpart.append(f"{name}: neither missions nor a file of the watchdog")
            report.assumed += _hints(name, content)
            continue
        rows = _missions(path, name, content, report) if kind == MISSIONS else _rows(path, name, content, report)
        twice = next((row.name for row in rows if row.name in found[kind]), None)
        if twice is not None:
            raise ImportFolderError(f"{path}: {twice} is in another file as well; must be in one of the {kind}")
        found[kind].update((row.name, row) for row in rows)
    for kind in (MISSIONS, "topics"):
        if not found[kind]:
            left = f"; left out: {', '.join(report.no_counterpart)}" if report.no_counterpart else ""
            right = f"must hold the missions and the watchdog's files{left}"
            raise ImportFolderError(f"{folder}: no file with {kind} was found; {right}")
    return found


class _ForeignError(Exception):
    """A file is none of its stack, and none that can be read: why."""


def _content(path: Path) -> Any:
    """Return what a file holds.

    Raises:
        ImportFolderError: it is one of its stack and cannot be read.
        _ForeignError: it is none of its stack and cannot be read.
    """
    raw = path.read_bytes()
    try:
        return yaml.load(raw.decode("utf-8"), _Loader)  # noqa: S506 - a safe one
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None) or str(error)
        why = " ".join((f"line {mark.line + 1}: {problem}" if mark is not None else problem).split())
        if _OF_ITS_STACK.search(raw.decode("utf-8", "replace")):
            raise ImportFolderError(f"{path}: is not YAML: {why}") from None
        raise _ForeignError(why) from None


def _kind(content: Any) -> Optional[str]:
    """Return what a file has rows of; None: of nothing that is imported."""
    if not isinstance(content, dict):
        return None
    if MISSIONS in content:
        return MISSIONS
    keys = [set(row) for row in content.values() if isinstance(row, dict) and ENTITY in row]
    return next((kind for kind, own in KINDS.items() if any(row.intersection(own) for row in keys)), None)


def _rows(path: Path, name: str, content: Mapping[Any, Any], report: Report) -> List[Row]:
    """Return the rows of a file of the watchdog."""
    rows = [Row(path, str(each), values) for each, values in content.items() if isinstance(values, dict)]
    report.translated.append(f"{name}: {len(rows)} {_kind(content)}")
    report_left(name, content, tuple(row.name for row in rows), report)
    return rows


def _missions(path: Path, name: str, content: Mapping[Any, Any], report: Report) -> List[Row]:
    """Return the missions of a file, each with the options beside them."""
    missions, options = content[MISSIONS], {key: content[key] for key in content if key in _OPTIONS}
    if not isinstance(missions, dict):
        right = "must be groups by their names, e.g. mission_1"
        raise ImportFolderError(f"{path}: {MISSIONS} is {missions!r}; {right}")
    rows = []
    for each, values in missions.items():
        if not isinstance(values, dict):
            Row(path, str(each), {}).refuse(f"is {values!r}", "must be a group of keys")
        rows.append(Row(path, str(each), {**options, **values}))
    report.translated.append(f"{name}: {len(rows)} {MISSIONS}")
    words = "of each mission that does not say it itself"
    report.translated += [f"{name}: {key}: {value}: {words}" for key, value in options.items()]
    report_left(name, content, (MISSIONS, *_OPTIONS), report)
    return rows


def report_left(where: str, row: Mapping[Any, Any], known: Tuple[str, ...], report: Report) -> None:
    """Report the keys that are not known."""
    left = {str(key): value for key, value in row.items() if str(key) not in known}
    hints = [pattern for pattern, _ in _HINTS]
    report.assumed += _hints(where, {key: left[key] for key in left if any(each.search(key) for each in hints)})
    report.no_counterpart += [
        f"{where}: {key}: {value}" for key, value in left.items() if not any(each.search(key) for each in hints)
    ]


def _hints(where: str, content: Any) -> Iterator[str]:
    """Yield a line for the keys of a group, at any depth, whose counterpart is none of the files here."""
    if not isinstance(content, dict):
        return
    left = {str(key): value for key, value in content.items()}
    for pattern, words in _HINTS:
        found = {key: left.pop(key) for key in tuple(left) if pattern.search(key)}
        if found:
            yield f"{where}: {', '.join(f'{key}: {value}' for key, value in found.items())}: {words}"
    for value in left.values():
        yield from _hints(where, value)


def parts_of(path: str) -> List[str]:
    """Return the folders and the name of a path, without those that lead upwards."""
    return [part for part in Path(path).parts if part not in ("/", "..", ".")]
