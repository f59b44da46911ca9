"""What the node says on /diagnostics, through diagnostic_updater."""

from __future__ import annotations

import time
from typing import Any, Callable, Dict

import diagnostic_updater
from diagnostic_msgs.msg import DiagnosticStatus

from amaze_autonomy.engine.commands import Level
from amaze_autonomy.engine.state import EngineState

from .journal_file import JournalFile

__all__ = ["Diagnostics"]

_PERIOD_S = 1.0
_OK, _WARN, _ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
_LEVELS = {Level.INFO: _OK, Level.WARNING: _WARN, Level.ERROR: _ERROR, Level.ALARM: _ERROR}


class Diagnostics:
    """Three rows: the engine, its inputs, the journal.

    Args:
        state: returns the engine's present state.
        journal: on disk.
        rejected: how many messages of each topic were invalid.
        open_calls: returns how many service calls wait for an answer.
    """

    def __init__(
        self,
        state: Callable[[], EngineState],
        journal: JournalFile,
        rejected: Dict[str, int],
        open_calls: Callable[[], int],
    ) -> None:
        self._state, self._journal, self._rejected, self._open_calls = state, journal, rejected, open_calls
        self._due_s = 0.0
        self._updater = diagnostic_updater.Updater()
        self._updater.setHardwareID("none")
        self._updater.add("engine", self._engine)
        self._updater.add("inputs", self._inputs)
        self._updater.add("journal", self._disk)

    def publish(self) -> None:
        """Publish all rows, at most once a second."""
        now_s = time.monotonic()
        if now_s >= self._due_s:
            self._due_s = now_s + _PERIOD_S
            self._updater.force_update()

    def _engine(self, status: Any) -> Any:
        state = self._state()
        status.summary(_LEVELS.get(Level(state.message_level), _OK), f"{state.state.value}: {state.message}")
        status.add("mission", state.mission.id if state.mission else "")
        status.add("session", state.session_id)
        status.add("in flight", str(state.in_flight))
        status.add("decisions", str(state.decisions))
        status.add("failures", ", ".join(failure.name for failure in state.failures))
        return status

    def _inputs(self, status: Any) -> Any:
        invalid = sum(self._rejected.values())
        if invalid:
            status.summary(_WARN, f"{invalid} invalid messages")
        else:
            status.summary(_OK, "all messages were valid")
        for topic, count in sorted(self._rejected.items()):
            status.add(f"invalid on {topic}", str(count))
        status.add("calls that wait", str(self._open_calls()))
        return status

    def _disk(self, status: Any) -> Any:
        journal = self._journal
        status.summary(_ERROR if journal.problem else _OK, journal.problem or str(journal.path))
        status.add("lines", str(journal.lines))
        status.add("gap", str(journal.gap))
        return status
