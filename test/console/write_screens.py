"""Write the screens that the tests compare with, and the pictures of the documentation, from the scenes.

Run it after a change that is meant to be seen, and look at what has changed: python3 test/console/write_screens.py
"""

from __future__ import annotations

import io
from pathlib import Path

from console_scenes import NOW_S, SCENES
from rich.console import Console

from amaze_autonomy.console.picture import svg
from amaze_autonomy.console.style import ASCII, UNICODE, Style
from amaze_autonomy.console.view import Screen

HERE = Path(__file__).parent
PICTURES = {
    "mission-input": 22,
    "outreach": 28,
    "ready": 24,
    "mission": 24,
    "hold": 26,
    "land": 24,
    "alarm": 24,
    "mission-ended": 22,
    "stale": 28,
}


def screen(name: str, width: int, style: Style) -> str:
    """Return a scene as plain text, without blanks at the ends of lines."""
    out = io.StringIO()
    console = Console(file=out, width=width, color_system=None, force_terminal=False, legacy_windows=False)
    console.print(Screen(SCENES[name], NOW_S, style), end="")
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def main() -> None:
    """Write all files."""
    (HERE / "screens").mkdir(exist_ok=True)
    for name in SCENES:
        for width, style in ((100, UNICODE), (60, ASCII)):
            (HERE / "screens" / f"{name}-{width}.txt").write_text(screen(name, width, style), encoding="utf-8")
    images = HERE.parent.parent / "docs" / "images"
    images.mkdir(exist_ok=True)
    for name, height in PICTURES.items():
        picture = svg(Screen(SCENES[name], NOW_S, UNICODE, height), 100, f"The console: {name}")
        (images / f"console-{name}.svg").write_text(picture, encoding="utf-8")


if __name__ == "__main__":
    main()
