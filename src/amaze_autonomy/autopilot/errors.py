"""What can be wrong with a link.

AutopilotError
  KeyFileError     a file with the signing key cannot be used

That a connection URL is none is an `EndpointError` of the configuration, which names it.
"""

from __future__ import annotations


class AutopilotError(ValueError):
    """The link cannot be made. Its text is one line: `what: what is wrong; what would be right`.

    Args:
        what: the file.
        wrong: what is wrong.
        right: what would be right.
    """

    def __init__(self, what: str, wrong: str, right: str) -> None:
        super().__init__(f"{what}: {wrong}; {right}")
        self.what, self.wrong, self.right = what, wrong, right


class KeyFileError(AutopilotError):
    """A file with the signing key cannot be used."""
