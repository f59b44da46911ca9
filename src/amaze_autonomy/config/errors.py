"""What can be wrong with a configuration.

ConfigError        one mistake in one file: where it is, what is wrong, what would be right
EndpointError      a connection URL is none, or names what cannot be opened
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """Where something stands.

    Args:
        source: the file as it was opened, or an override such as "override autonomy.landing.land_limit_s=9".
        line: from 1; 0 where lines mean nothing (an override, a missing file).
    """

    source: str
    line: int = 0

    def __str__(self) -> str:
        return f"{self.source}:{self.line}" if self.line else self.source


class ConfigError(ValueError):
    """One mistake in a configuration. Its text is one line: `file:line: key: what is wrong; what would be right`.

    Args:
        place: file and line.
        key: dotted address of the key, or the column of a waypoint file; empty when the file as a whole is meant.
        wrong: what is wrong.
        right: what would be right.
    """

    def __init__(self, place: Place, key: str, wrong: str, right: str) -> None:
        super().__init__(_one_line(": ".join(part for part in (str(place), key, f"{wrong}; {right}") if part)))
        self.file, self.line, self.key, self.wrong, self.right = place.source, place.line, key, wrong, right


class EndpointError(ValueError):
    """A connection URL is none, or names what cannot be opened: one line, as of a `ConfigError`.

    Args:
        what: the URL.
        wrong: what is wrong.
        right: what would be right.
    """

    def __init__(self, what: str, wrong: str, right: str) -> None:
        super().__init__(f"{what}: {wrong}; {right}")
        self.what, self.wrong, self.right = what, wrong, right


def _one_line(text: str) -> str:
    """Escape what cannot be printed: a key may hold line breaks."""
    return "".join(char if char.isprintable() else repr(char)[1:-1] for char in text)
