"""How `./run docs` makes a site of README.md, CHANGELOG.md and docs/ (Sphinx), with a search that needs no server.

Its table of contents is what README.md links to, in that order; a page that it forgets is a warning, as is a link that
leads nowhere, and a warning is an error.
"""

from __future__ import annotations

import re

project = "amaze_autonomy"
extensions = ["myst_parser"]
root_doc = "README"
include_patterns = ["*.md", "docs/*.md"]
exclude_patterns = ["build", ".venv", "src", "test", "config"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = "amaze_autonomy"
html_copy_source = html_show_sourcelink = html_show_copyright = False


def setup(app):
    """Have the table of contents added to README.md."""
    app.connect("source-read", add_contents)


def add_contents(_app, page, source):
    """Append the table of contents to README.md as it is read."""
    if page == root_doc:
        pages = dict.fromkeys(re.findall(r"\]\(((?:docs/)?\w+)\.md[#)]", source[0]))
        source[0] += "\n".join(["\n```{toctree}", ":hidden:", "", *pages, "CHANGELOG", "```\n"])
