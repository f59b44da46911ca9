"""The process that reads and writes bags for a recorder's node: so the node stays small, and answers at once.

It reads one line of JSON from its standard input, which says what to do, and writes lines of JSON: progress, and in the
end the result. It ends when its standard input does, because then nobody waits for it any more. It can be killed at any
moment; the next one goes on.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, Mapping

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.engine.events import RecordingPhase as Phase

from .complete import Plan, Source, collect
from .errors import RecordingError
from .parts import close_parts

__all__ = ["main", "plan_of", "run"]

_PERIOD_S = 0.2
_FAILED = 1
_Tell = Callable[[Mapping[str, Any]], None]


class _Meter:
    """Tells progress, not more often than a person can read it."""

    def __init__(self, tell: _Tell) -> None:
        self._tell, self._phase, self._due_s = tell, Phase.IDLE, 0.0

    def __call__(self, phase: Phase, done: int, total: int) -> None:
        now_s = time.monotonic()
        if phase is self._phase and now_s < self._due_s and done < total:
            return
        self._phase, self._due_s = phase, now_s + _PERIOD_S
        self._tell({"phase": phase.name, "progress": done / total if total else 1.0})


def plan_of(request: Mapping[str, Any]) -> Plan:
    """Return the plan that a request holds."""
    return Plan(
        output=Path(request["output"]),
        sources=tuple(Source(**{**each, "folder": Path(each["folder"])}) for each in request["sources"]),
        duplicates=request["duplicates"],
        facts=request["facts"],
    )


def run(request: Mapping[str, Any], tell: _Tell) -> Dict[str, Any]:
    """Do what a request asks; return the result: an empty `problem` when all is well."""
    meter = _Meter(tell)
    try:
        if request["do"] == "collect":
            summary = collect(plan_of(request), meter)
            return {"problem": "", "verified": True, **summary._asdict(), "message": summary.message}
        content = close_parts(
            Path(request["folder"]), request["facts"], lambda done, total: meter(Phase.RECOVERING, done, total)
        )
    except (BagError, RecordingError) as error:
        return {"problem": str(error)}
    except OSError as error:
        return {"problem": f"{error.filename or 'the storage'}: {error.strerror}; make space or repair it, then retry"}
    return {"problem": "", "files": len(content["files"])}


def _end_with_parent() -> None:
    while os.read(0, 4096):  # not the buffered reader, whose lock would be held at the end of the process
        pass
    os._exit(_FAILED)


def main() -> int:
    """Run one job; return 0 when it was done."""
    request = json.loads(sys.stdin.buffer.readline())
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def tell(line: Mapping[str, Any]) -> None:
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()

    result = run(request, tell)
    tell({"result": result})
    return _FAILED if result["problem"] else 0


if __name__ == "__main__":
    sys.exit(main())
