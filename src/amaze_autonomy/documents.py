"""The parts of docs/ that are generated from the tables of the code, the markers around them; and autonomy.yaml.

    <!-- generated:severities -->
    (made by the function of that name, never by hand)
    <!-- end -->

A part is registered in `DOCUMENTS` of the module whose tables it shows, and stands wherever a page has its markers.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Callable, Dict, Iterable, Mapping, Tuple

from . import paths
from .config import load_configuration
from .config.reference import DOCUMENTS as CONFIGURATION
from .config.reference import shipped_file
from .journal.documents import DOCUMENTS as ENGINE
from .journal.documents import decision_table
from .simulation.documents import DOCUMENTS as SIMULATION
from .tester.documents import DOCUMENTS as TESTER

__all__ = [
    "DocumentError",
    "documents",
    "filled",
    "first_difference",
    "not_shown",
    "regenerated",
    "shipped_configuration",
]

_BEGIN, _END = "<!-- generated:", "<!-- end -->"
_MARKED = re.compile(
    r"(?P<begin><!-- generated:(?P<name>[^ \n]+) -->\n)(?P<text>(?:(?!<!-- generated:).)*?)(?P<end><!-- end -->)",
    re.DOTALL,
)


class DocumentError(ValueError):
    """A page has a marker that nothing is generated for, or half a pair of markers."""


def _shipped_decision_table() -> str:
    return decision_table(load_configuration(paths.config_folder()).rules)


def documents() -> Mapping[str, Callable[[], str]]:
    """Return every part that can be generated, by the name of its marker."""
    parts: Dict[str, Callable[[], str]] = {"decision-table": _shipped_decision_table}
    for registered in (ENGINE, CONFIGURATION, SIMULATION, TESTER):
        parts.update(registered)
    return parts


def _names(page: str) -> Tuple[str, ...]:
    """Return the names of the generated parts of a page, in order."""
    return tuple(found["name"] for found in _MARKED.finditer(page))


def filled(page: str, parts: Mapping[str, Callable[[], str]]) -> str:
    """Return a page with its generated parts made anew.

    Raises:
        DocumentError: a marker has no function, or no partner.
    """
    for name in _names(page):
        if name not in parts:
            raise DocumentError(f"nothing is generated for the marker {name}; there is {', '.join(sorted(parts))}")
    pairs = len(_names(page))
    if page.count(_BEGIN) != pairs or page.count(_END) != pairs:
        raise DocumentError(f"{page.count(_BEGIN)} markers begin a generated part, {page.count(_END)} end one")
    return _MARKED.sub(lambda found: f"{found['begin']}\n{parts[found['name']]().strip()}\n\n{found['end']}", page)


def regenerated(folder: Path) -> Tuple[Tuple[Path, str, str], ...]:
    """Return every page of a folder: its path, its text, and the text with the generated parts made anew.

    Raises:
        DocumentError: a page's markers are wrong.
    """
    parts, pages = documents(), []
    for path in sorted(folder.glob("*.md")):
        old = path.read_text(encoding="utf-8")
        try:
            pages.append((path, old, filled(old, parts)))
        except DocumentError as error:
            raise DocumentError(f"{path}: {error}") from None
    return tuple(pages)


def shipped_configuration() -> Tuple[Path, str, str]:
    """Return autonomy.yaml as it ships: its path, its text, and the text made anew from the engine's limits."""
    path = paths.config_folder() / "autonomy.yaml"
    return path, path.read_text(encoding="utf-8"), shipped_file("autonomy")


def not_shown(pages: Iterable[str]) -> Tuple[str, ...]:
    """Return the names of the parts that stand in none of the pages."""
    shown = [name for page in pages for name in _names(page)]
    return tuple(name for name in documents() if name not in shown)


def first_difference(old: str, new: str) -> Tuple[int, str, str]:
    """Return line number and both lines where two different texts first differ."""
    before, after = old.split("\n"), new.split("\n")
    for number, (one, other) in enumerate(zip(before, after), start=1):
        if one != other:
            return number, one, other
    number = min(len(before), len(after))
    return number + 1, "\n".join(before[number : number + 1]), "\n".join(after[number : number + 1])
