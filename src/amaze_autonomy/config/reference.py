"""The reference of the configuration as Markdown, made from the schema: what is said in docs/ cannot differ from it."""

from __future__ import annotations

import textwrap
from functools import partial
from typing import Any, Callable, Iterator, List, Mapping, Tuple

import yaml

from ..paths import config_folder
from .consistency import LOSS_RATES, ORDER
from .kinds import ListOf, unit_words
from .loader import FILES
from .schema import Group, Key, Named, is_required

_WIDTH = 119


def file_reference(name: str) -> str:
    """Return a table for each group of a file, e.g. "sensors": key, what it takes, default, meaning."""
    return group_reference(FILES[name])


def group_reference(group: Group) -> str:
    """Return a table for each group of a schema: key, what it takes, default, meaning."""
    return "\n".join(_group("", group)).strip() + "\n"


def order_reference() -> str:
    """Return the table of what must be true between keys of autonomy.yaml."""
    lines = ["| This | must be | that | because |", "|---|---|---|---|"]
    for order in ORDER:
        word = "at most" if order.equal else "below"
        lines.append(f"| `{order.low}` | {word} | `{order.high}` | {order.reason} |")
    for limit, rate in LOSS_RATES:
        lines.append(f"| `{limit}` | at least | 2 periods of `{rate}` | one lost message is no loss |")
    return "\n".join(lines) + "\n"


def _group(path: str, group: Group) -> Iterator[str]:
    """Yield the table of a group's single keys, then the groups in it."""
    inner = [key for key in group.keys if isinstance(key.kind, (Group, Named))]
    single = [key for key in group.keys if key not in inner or _is_plain(key)]
    if single:
        yield from ("| Key | Takes | Default | Meaning |", "|---|---|---|---|")
        yield from (_row(key) for key in single)
        yield ""
    for key in inner:
        if not _is_plain(key):
            yield from _inner(f"{path}{key.name}", key)


def _is_plain(key: Key) -> bool:
    """Return whether the key is a group of names with single values, which needs no table of its own."""
    return isinstance(key.kind, Named) and not isinstance(key.kind.kind, Group)


def _inner(path: str, key: Key) -> Iterator[str]:
    kind: Any = key.kind
    if isinstance(kind, Named):
        path, kind = f"{path}.<name>", kind.kind
    yield from (f"### `{path}`", "", _sentence(key.meaning, key.reason), "")
    yield from _group(f"{path}.", kind)


def _sentence(meaning: str, reason: str) -> str:
    words = f"{meaning} ({reason})" if reason else meaning
    return words[0].upper() + words[1:] + ("" if words[-1] in "?." else ".")


def _row(key: Key) -> str:
    takes = key.kind.words(unit_words(key.name))
    if isinstance(key.kind, Named):
        takes = f"{key.kind.words()}: {key.kind.kind.words()}"
    cells: Tuple[str, ...] = (f"`{key.name}`", takes, _default(key), _sentence(key.meaning, key.reason))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _default(key: Key) -> str:
    if is_required(key):
        return "must be given"
    if key.default is None:
        return "left out"
    if key.default in ({}, []) and isinstance(key.kind, (Named, ListOf)):
        return "none"
    return f"`{_written(key.default)}`"


def _written(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        items: List[str] = [_written(item) for item in value]
        return f"[{', '.join(items)}]"
    return '""' if value == "" else str(value)


# --- the file itself --------------------------------------------------------------------------------------------------

_HEAD = """\
# The engine: its limits, and how often its peers send their status.
#
# The unit is the last part of a key. Above each: what it is (why it is there, or why this value). Every value here is
# the default; a key may be left out. What each key takes: docs/configuration.md. Check after a change:
#     amaze-autonomy check-config FOLDER
"""


def shipped_file(name: str) -> str:
    """Return a file with every key at its default, and what the schema says of each above it."""
    blocks = [_HEAD]
    for key in FILES[name].keys:
        inner = isinstance(key.kind, Group)
        said = f"# {_sentence(key.meaning, key.reason)}" if inner else _comment(key, "")
        lines = [said, f"{key.name}:" if inner else f"{key.name}: {_written(key.default)}"]
        for each in key.kind.keys if isinstance(key.kind, Group) else ():
            lines += [_comment(each, "  "), f"  {each.name}: {_written(each.default)}"]
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def _comment(key: Key, indent: str) -> str:
    unit = unit_words(key.name).replace("in ", "", 1).replace("as ", "", 1)
    words = f"{key.meaning} ({key.reason})" if key.reason else key.meaning
    mark = f"{indent}# "
    said = f"{unit}: {words}" if unit else words
    return textwrap.fill(said, _WIDTH, initial_indent=mark, subsequent_indent=mark, break_on_hyphens=False)


DOCUMENTS: Mapping[str, Callable[[], str]] = {
    **{f"{name}.yaml": partial(file_reference, name) for name in FILES},
    "order-of-limits": order_reference,
}
"""What docs/ shows of the configuration, by the name of its marker."""


# --- what a configuration that is written for somebody takes from the one that ships, as it stands there --------------


_COMPARED = ("parameters", "ardupilot_parameters", "offboard_parameters")
COMPARED = (
    "autopilot.yaml: before a takeoff parameters of the autopilot's failsafes are compared with the values that ship: "
    "compare them with what you want of your vehicle"
)


def compared_parameters() -> str:
    """Return the lists of parameters that are compared before a takeoff, with their comments.

    Raises:
        OSError: the file that ships cannot be read.
    """
    text = (config_folder() / "autopilot.yaml").read_text(encoding="utf-8")
    paragraphs = (each.strip("\n") for each in text.split("\n\n"))
    return "\n\n".join(each for each in paragraphs if (yaml.safe_load(each) or {}).keys() & set(_COMPARED)) + "\n"
