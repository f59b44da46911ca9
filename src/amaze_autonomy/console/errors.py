"""Errors of the console.

ConsoleError
├── UsageError      the command line or a parameter is wrong
└── TerminalError   the terminal cannot do what a full screen needs
"""

from __future__ import annotations


class ConsoleError(Exception):
    """Base of the console's errors: one sentence for the user."""


class UsageError(ConsoleError):
    """The command line or a parameter is wrong; the text says what would be right."""


class TerminalError(ConsoleError):
    """The terminal cannot do what a full screen needs."""
