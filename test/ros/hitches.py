"""How late this machine's processes run: what a reaction that is measured here may take in addition.

A thread asks to be woken every 5 ms and notes by how much it was late. On a quiet machine that is nothing, so that a
limit is the limit; where other work holds up the test, the nodes that it measures were held up as well.
"""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from typing import List, Tuple

PATIENCE = 4.0  # what merely has to come is waited for so many times as long as a quiet machine needs at most
_EVERY_S, _USUAL_S = 0.005, 0.001
_late: List[Tuple[float, float]] = []  # woken when, late by how much (monotonic, s)


def allowed_s(limit_s: float, began_s: float, ended_s: float = float("inf")) -> float:
    """Return a limit, and by how much this machine was late in the meantime (times of the monotonic clock, s)."""
    return limit_s + sum(late_s for at_s, late_s in list(_late) if began_s < at_s and at_s - late_s < ended_s)


def idle_s() -> float:
    """Return how long this machine's processors were idle since its start, in sum (/proc/stat, proc(5)), s."""
    ticks = Path("/proc/stat").read_text().split()
    return (int(ticks[4]) + int(ticks[5])) / os.sysconf("SC_CLK_TCK")  # idle, iowait


def _watch() -> None:
    while True:
        due_s = time.monotonic() + _EVERY_S
        time.sleep(_EVERY_S)
        now_s = time.monotonic()
        if now_s - due_s > _USUAL_S:
            _late.append((now_s, now_s - due_s))


threading.Thread(target=_watch, daemon=True).start()
