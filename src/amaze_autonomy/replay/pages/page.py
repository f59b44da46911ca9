"""Puts page.html, page.css, page.js and the content together into one file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Optional, Sequence

from amaze_autonomy.whole_file import write_whole

from ..suite.coverage import Coverage
from ..suite.result import Result
from .content import page_content

__all__ = ["write_page"]

_HERE = Path(__file__).parent


def write_page(path: Path, results: Sequence[Result], coverage: Optional[Coverage], wall_s: float) -> None:
    """Write the report.

    Args:
        path: of the file.
        results: with their stories.
        coverage: of them; None: it is not shown.
        wall_s: how long the run took.

    Raises:
        OSError: it cannot be written.
    """
    content = json.dumps(page_content(results, coverage, wall_s), separators=(",", ":"), allow_nan=False)
    page = (_HERE / "page.html").read_text("utf-8")
    parts = {"css": "page.css", "js": "page.js"}
    for mark, name in parts.items():
        page = page.replace(f"@{mark}@", (_HERE / name).read_text("utf-8"))
    # "</script>" inside a text would end the script; JSON allows to write "<" as an escape.
    write_whole(path, page.replace("@content@", content.replace("<", "\\u003c")))
