"""Wait in a test for what another thread or process does."""

from __future__ import annotations

import time

_LIMIT_S = 60.0


def wait_for(condition, what="it"):
    """Wait for something that becomes true.

    Args:
        condition: asked without arguments, every few milliseconds.
        what: its name, for who reads that it did not come.

    Raises:
        AssertionError: It did not become true within a limit that is long on a busy computer.
    """
    until_s = time.monotonic() + _LIMIT_S
    while not condition():
        assert time.monotonic() < until_s, f"{what} did not come"
        time.sleep(0.005)
