"""What the parts of the recorder node have in common: one lock around both machines, clocks, threads, requests."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, List, Type

import rospy

from amaze_autonomy.config import Configuration
from amaze_autonomy.recording import Answer

from .clock import MonotonicClock
from .recorder_jobs import RecorderJobs
from .workers import Workers

__all__ = ["RecorderShare"]


@dataclass(frozen=True)
class RecorderShare:
    """Made once per node.

    Args:
        configuration: as loaded.
        folder: of the recordings.
        stamp_ns: the clock that stamps.
        now_ns: the clock of the machines; processes and disks know no simulated time.
        lock: held whenever a machine is asked or told something.
        wake: set when there is something to do before the next turn.
        jobs: processes that work on files.
        workers: threads that wait for them, and for other platforms.
    """

    configuration: Configuration
    folder: Path
    stamp_ns: Callable[[], int]
    now_ns: Callable[[], int] = field(default_factory=lambda: MonotonicClock().now_ns)
    lock: threading.RLock = field(default_factory=threading.RLock)
    wake: threading.Event = field(default_factory=threading.Event)
    jobs: RecorderJobs = field(default_factory=RecorderJobs)
    workers: Workers = field(default_factory=lambda: Workers("recorder"))
    services: List[Any] = field(default_factory=list)

    def serve(self, name: str, service: Type[Any], answer: Callable[[Any], Answer]) -> None:
        """Offer a service that is answered at once; what comes of it is done by the working thread."""

        def handle(request: Any) -> Any:
            given = answer(request)
            self.wake.set()
            return service._response_class(accepted=given.accepted, message=given.message)

        self.services.append(rospy.Service(name, service, handle))
