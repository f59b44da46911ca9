"""Where something stands in a scenario file, for mistakes that only show when it is run."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Iterable, Optional, Tuple

from amaze_autonomy.config.document import Entry, Items, Table, read
from amaze_autonomy.config.errors import ConfigError, Place

__all__ = ["meant", "place_of", "placed"]


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
