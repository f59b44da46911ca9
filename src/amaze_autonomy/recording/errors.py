"""What can go wrong with a recording.

RecordingError      the base
├── FolderError     a folder or a file of the session cannot be made, read or written
└── TransferError   what another platform recorded does not arrive, or not as it was sent
"""

from __future__ import annotations


class RecordingError(Exception):
    """Base of all errors of the recording. The text is one line: what is wrong, where, and what to do."""


class FolderError(RecordingError):
    """A folder or a file of the session cannot be made, read or written."""


class TransferError(RecordingError):
    """What another platform recorded does not arrive, or not as it was sent."""
