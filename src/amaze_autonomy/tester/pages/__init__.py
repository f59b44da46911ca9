"""The report of a suite as one HTML page: everything is in it, nothing is loaded."""

from __future__ import annotations

from .page import write_page

__all__ = ["write_page"]
