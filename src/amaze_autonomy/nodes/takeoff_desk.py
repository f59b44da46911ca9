"""Answers take-off checks: the first waits for the components to come up, later ones are answered at once."""

from __future__ import annotations

from queue import SimpleQueue
from typing import List, Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.checks import Verdict
from amaze_autonomy.engine.events import ComponentStatus
from amaze_autonomy.engine.mission import Mission
from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.watchdog import TakeoffCheck, Watchdog

__all__ = ["TakeoffAnswer", "TakeoffDesk", "TakeoffRequest"]


class TakeoffAnswer(NamedTuple):
    """The answer to srv/StartWatchdog.srv.

    Args:
        t_ns: when it was made.
        check: the rows, and whether it may take off.
        components: the condition of every component.
        message: for a person.
    """

    t_ns: int
    check: TakeoffCheck
    components: Tuple[ComponentStatus, ...]
    message: str


class TakeoffRequest(NamedTuple):
    """A take-off check that somebody waits for.

    Args:
        mission_id: what is to be flown; empty: nothing in particular.
        required: names of components; empty: those of the configuration.
        startup_ns: how long the first one may wait for components to come up.
        answer: where the answer goes.
    """

    mission_id: str
    required: Tuple[str, ...]
    startup_ns: int
    answer: SimpleQueue[TakeoffAnswer]


class TakeoffDesk:
    """Take-off checks; used by the thread that watches.

    Args:
        watchdog: that is asked.
        missions: by id.
    """

    def __init__(self, watchdog: Watchdog, missions: Mapping[str, Mission]) -> None:
        self._watchdog, self._missions = watchdog, missions
        self._waiting: List[TakeoffRequest] = []
        self._until_ns = 0

    @property
    def next_ns(self) -> int:
        """When an answer is due at the latest."""
        return self._until_ns if self._waiting else FOREVER_NS

    def ask(self, now_ns: int, request: TakeoffRequest) -> None:
        """Begin to watch for a mission, or make a new check."""
        first = not self._watchdog.started
        mission = self._missions.get(request.mission_id)
        self._watchdog.start(
            now_ns,
            mission.severities if mission is not None else (),
            request.required,
            mission.tolerated if mission is not None else (),
            request.startup_ns,
        )
        if first:
            self._until_ns = now_ns + request.startup_ns
        if first or self._waiting:
            self._waiting.append(request)
        else:
            self._reply(now_ns, request, self._watchdog.checks(now_ns))

    def turn(self, now_ns: int) -> None:
        """Answer those that wait, once everything has come up or has had the time to."""
        if not self._waiting:
            return
        check = self._watchdog.checks(now_ns)
        coming_up = any(row.verdict is Verdict.UNKNOWN for row in check.checks)
        if check.ready or not coming_up or now_ns >= self._until_ns:
            waiting, self._waiting = self._waiting, []
            for request in waiting:
                self._reply(now_ns, request, check)

    def _reply(self, now_ns: int, request: TakeoffRequest, check: TakeoffCheck) -> None:
        components = self._watchdog.evaluate(now_ns)
        request.answer.put(TakeoffAnswer(now_ns, check, components, self._message(request, check)))

    def _message(self, request: TakeoffRequest, check: TakeoffCheck) -> str:
        failed = [row.name for row in check.checks if not row.passed]
        unknown: Optional[str] = None
        if request.mission_id and request.mission_id not in self._missions:
            unknown = f"mission {request.mission_id!r} is not in missions.yaml: severities are those of sensors.yaml"
        parts = ["ready" if check.ready else f"not nominal: {', '.join(failed)}", unknown]
        return "; ".join(part for part in parts if part)
