"""What the process itself does for speed: threads that take turns quickly, no pauses for garbage, precedence."""

from __future__ import annotations

import gc
import logging
import os
import sys

__all__ = ["settle", "take_precedence"]

_SWITCH_INTERVAL_S = 0.0005
_log = logging.getLogger(__name__)


def take_precedence(nice: int) -> None:
    """Ask for a niceness; what the system does not permit is left as it is."""
    try:
        os.setpriority(os.PRIO_PROCESS, 0, nice)
    except (PermissionError, OSError) as error:
        _log.info("niceness %d is not permitted: %s", nice, error)


def settle() -> None:
    """Call once everything is loaded: what is there now is never searched for garbage again."""
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
