"""Work that kills its process, for tests of what becomes of the other work; the processes import it by its name."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from amaze_autonomy.tester.coverage import Survival
from amaze_autonomy.tester.run import run_task


def dying(task):
    """Run a task; the process of the long one is killed: once, or each time, as the environment says."""
    died = Path(os.environ["DIED"])
    if "long" in task.path and (os.environ["DIES"] == "always" or not died.exists()):
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return run_task(task)


def examining(bag, memory):  # noqa: ARG001
    """Look through a bag; of the long one the process is killed."""
    if "long" in bag.name:
        os.kill(os.getpid(), signal.SIGKILL)
    return [f"{bag.name}: looked at"]


def hunting(hunt):
    """Hunt a mutant; of one the process is killed."""
    if hunt.mutant == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    return Survival(hunt.mutant, "lrf", 1)
