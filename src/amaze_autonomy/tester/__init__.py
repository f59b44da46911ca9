"""Tests of the decisions: scenarios are run, judged, compared with their goldens, and told.

The seam for programs: `run_task` takes a `Task` and returns a `Result`. Both are plain frozen values that can be
pickled; nothing is kept between two calls, so that tasks may run in any process, on any machine, in any order::

    results = [run_task(task) for task in tasks_of([Path("test/scenarios")])]

`scenario/` reads the files, `play.py` plays a case, `expect/` judges it, `golden.py` compares it with what was
accepted, `run.py` is all of this. `coverage.py` says what of the engine's tables is tested. `command.py` is
`amaze-replay`.
"""

from __future__ import annotations

from .run import run_task
from .task import Figures, Options, Result, Task, Verdict, tasks_of

__all__ = ["Figures", "Options", "Result", "Task", "Verdict", "run_task", "tasks_of"]
