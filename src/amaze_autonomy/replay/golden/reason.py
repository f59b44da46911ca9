"""What is accepted is accepted by a person, at a desk, who says why."""

from __future__ import annotations

import os
from typing import Mapping, Optional

from ..errors import GoldenError

__all__ = ["check_reason"]

_LEAST = 10
_CI = ("CI", "CONTINUOUS_INTEGRATION", "GITHUB_ACTIONS", "GITLAB_CI", "JENKINS_URL", "BUILD_NUMBER")


def check_reason(reason: str, what: str, environment: Optional[Mapping[str, str]] = None) -> None:
    """Let a person accept something who says why.

    Args:
        reason: as given.
        what: is accepted, in the plural, e.g. "goldens".
        environment: of the process; None: its own.

    Raises:
        GoldenError: Nobody says why, or this is no desk.
    """
    given = os.environ if environment is None else environment
    found = next((name for name in _CI if given.get(name)), None)
    if found is not None:
        raise GoldenError(f"{what} are not accepted in CI ({found} is set); accept them at a desk and commit them")
    if len(reason.strip()) < _LEAST:
        least = f"a sentence of {_LEAST} letters or more"
        raise GoldenError(f"why are these {what} right now? Say it with --reason, in {least}")
