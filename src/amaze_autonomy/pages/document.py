"""One HTML file of content, style, scripts and the plot library: it opens without a network, and loads nothing.

Names in recordings are hostile: everything that is shown comes as JSON in which no "<" is left, and the scripts put it
into the page as text, or escape it where the plot library would read it as markup.
"""

from __future__ import annotations

import json
import pkgutil
from html import escape
from pathlib import Path
from typing import Any, Mapping, Sequence

from amaze_autonomy.files import write_whole

_HERE = Path(__file__).parent
_DOCTYPE = "<!DOCTYPE html>"
_HEAD_BYTES = 1000
_PLOTS = ("plotly", "package_data/plotly.min.js")


class PageError(Exception):
    """A page cannot be made here; the text says why, and what would help."""


def write_document(path: Path, title: str, parts: Sequence[str], content: Mapping[str, Any]) -> None:
    """Write a page.

    Args:
        path: of the file.
        title: of the page.
        parts: names of the page's own files in this folder besides the shared ones: NAME.html, NAME.css, NAME.js.
        content: plain values, which the scripts find as CONTENT.

    Raises:
        OSError: it cannot be written.
        PageError: the plot library is not installed.
    """
    plots = need_plots()
    data = json.dumps(content, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    style, scripts = _texts(parts, "css"), _texts(parts, "js")
    write_whole(
        path,
        f'{_DOCTYPE}\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{escape(title)}</title>\n'
        f"<style>\n{style}</style>\n</head>\n<body>\n{_texts(parts, 'html')}"
        f"<script>\n{plots}\n</script>\n<script>\nconst CONTENT = {data};\n{scripts}</script>\n</body>\n</html>\n",
    )


def is_document(path: Path, title: str = "") -> bool:
    """Tell whether a file is a page, and one whose title begins so.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES).decode("utf-8", "replace")
    return head.startswith(_DOCTYPE) and f"<title>{escape(title)}" in head


def _texts(parts: Sequence[str], kind: str) -> str:
    """Return the files of a kind, the shared one first."""
    paths = [_HERE / f"{name}.{kind}" for name in ("parts", *parts)]
    return "".join(path.read_text("utf-8") for path in paths if path.is_file())


def need_plots() -> str:
    """Return the plot library for the browser.

    Raises:
        PageError: it is not installed.
    """
    try:
        data = pkgutil.get_data(*_PLOTS)
    except (ImportError, OSError):
        data = None
    if data is None:
        words = "no page without the plot library plotly, which is not installed here"
        raise PageError(f"{words}: pip install 'amaze_autonomy[page]', or make the page on a computer that has it")
    return data.decode("utf-8")
