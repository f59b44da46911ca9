"""The simulated data recorder: two platforms that record, and the way from their parts to one verified recording.

No file is written, so it names none.
"""

from __future__ import annotations

from typing import Dict, List, Optional, Tuple

from amaze_autonomy.engine.commands import Request, StartRecording, StopRecording
from amaze_autonomy.engine.events import Event, PlatformRecording, RecordingPhase, RecordingStatus

from .peer import Cadence, Peer, Site, accepted, refused, slowness

_S = 1_000_000_000
_BYTE_RATE = (25_000_000, 8_000_000)
_CPU = (0.45, 0.3)
_STORAGE_BYTES = 256_000_000_000

_NEXT: Dict[RecordingPhase, Tuple[RecordingPhase, int]] = {
    RecordingPhase.STARTING: (RecordingPhase.RECORDING, _S),
    RecordingPhase.STOPPING: (RecordingPhase.RECOVERING, _S),
    RecordingPhase.RECOVERING: (RecordingPhase.TRANSFERRING, _S // 2),
    RecordingPhase.TRANSFERRING: (RecordingPhase.MERGING, 3 * _S),
    RecordingPhase.MERGING: (RecordingPhase.VERIFYING, 2 * _S),
    RecordingPhase.VERIFYING: (RecordingPhase.COMPLETE, _S),
}
_WRITING = (RecordingPhase.STARTING, RecordingPhase.RECORDING)
_OPEN = (RecordingPhase.IDLE, RecordingPhase.COMPLETE, RecordingPhase.FAILED)


class Recorder(Peer):
    """The collector: it stands for the recorders of all platforms."""

    name = "data_recorder"

    def __init__(self, site: Site) -> None:
        super().__init__(site)
        self._phase = RecordingPhase.IDLE
        self._session = self._message = ""
        self._since_ns = self._t_ns = 0
        self._written: Dict[str, int] = dict.fromkeys(site.settings.platforms, 0)
        self._lost_ns: Dict[str, int] = dict.fromkeys(site.settings.platforms, 0)
        self._growing: Dict[str, bool] = dict.fromkeys(site.settings.platforms, False)
        self._cadence = Cadence(site.settings.rates.recorder_status_rate_hz)

    def answer(self, t_ns: int, command: Request) -> Optional[Event]:
        """Start, or stop and go on to the complete recording."""
        if isinstance(command, StartRecording):
            problem = self._start(t_ns, command)
        elif isinstance(command, StopRecording):
            problem = self._stop(t_ns, command)
        else:
            return super().answer(t_ns, command)
        return refused(command, problem) if problem else accepted(command)

    def step(self, t_ns: int) -> List[Event]:
        """Write, go through the phases, and tell."""
        self._write(t_ns)
        while self._go_on(t_ns):
            pass
        key = (self._phase, self._session, self._message, tuple(self._growing.values()))
        return [self._status(t_ns)] if self._cadence.due(t_ns, key, slowness(self.site, self.name)) else []

    def _start(self, t_ns: int, command: StartRecording) -> str:
        if self._phase not in _OPEN:
            same = command.session_id == self._session and self._phase in _WRITING
            return "" if same else f"busy with session {self._session} ({self._phase.name})"
        self._session, self._message = command.session_id, ""
        for name in self._written:
            self._written[name] = self._lost_ns[name] = 0
        self._enter(RecordingPhase.STARTING, t_ns)
        return ""

    def _stop(self, t_ns: int, command: StopRecording) -> str:
        if command.session_id != self._session or not self._session:
            return f"session {command.session_id!r} is not recorded here"
        if self._phase in _WRITING:
            self._enter(RecordingPhase.STOPPING, t_ns)
        elif self._phase == RecordingPhase.FAILED:
            self._message = ""
            self._enter(RecordingPhase.TRANSFERRING, t_ns)
        return ""

    def _enter(self, phase: RecordingPhase, t_ns: int) -> None:
        self._phase, self._since_ns = phase, t_ns
        if phase == RecordingPhase.RECORDING:
            self.site.note("recording")
        elif phase == RecordingPhase.MERGING:
            self.site.note("merging")
        elif phase == RecordingPhase.COMPLETE:
            self.site.note("complete")

    def _go_on(self, t_ns: int) -> bool:
        """Go to the next phase when its time has come; return whether it did."""
        if self._phase not in _NEXT:
            return False
        following, lasts_ns = _NEXT[self._phase]
        end_ns = self._since_ns + lasts_ns
        if t_ns < end_ns or (self._phase == RecordingPhase.STARTING and not all(self._growing.values())):
            return False
        broken = self._broken("data_incomplete")
        if self._phase == RecordingPhase.VERIFYING and broken:
            self._message = f"the part of platform {broken} is missing; the parts are kept"
            following = RecordingPhase.FAILED
        self._enter(following, max(end_ns, self._since_ns))
        return True

    def _write(self, t_ns: int) -> None:
        elapsed = max(0, t_ns - self._t_ns) if self._phase in _WRITING else 0
        since = max(self._t_ns, self._since_ns)
        elapsed = max(0, t_ns - since) if self._phase == RecordingPhase.STARTING else elapsed
        still, dead = self._broken("recording_does_not_grow"), self._broken("recording_fails")
        for number, name in enumerate(self._written):
            works = self._phase in _WRITING and name not in (still, dead)
            self._growing[name] = works
            if self._phase == RecordingPhase.RECORDING and not works and self.site.vehicle.armed:
                self._lost_ns[name] += elapsed
            if works:
                self._written[name] += _BYTE_RATE[min(number, len(_BYTE_RATE) - 1)] * elapsed // _S
        if dead and self._phase == RecordingPhase.RECORDING:
            self._message = f"the recorder of platform {dead} has ended by itself"
            self._enter(RecordingPhase.FAILED, t_ns)
        self._t_ns = t_ns

    def _broken(self, kind: str) -> str:
        """Return the platform that a fault of a kind is about; empty when there is no such fault now."""
        fault = self.site.world_fault(kind)
        return "" if fault is None else fault.word("platform") or self.site.settings.platforms[-1]

    def _status(self, t_ns: int) -> RecordingStatus:
        return RecordingStatus(
            t_ns=t_ns,
            session_id=self._session,
            phase=self._phase,
            progress=self._progress(t_ns),
            platforms=tuple(self._platform(number, name) for number, name in enumerate(self._written)),
            message=self._message,
            lost=self._lost() if self._phase == RecordingPhase.COMPLETE else "",
        )

    def _lost(self) -> str:
        gaps = [f"{name}: {ns / _S:.1f} s in which nothing was recorded" for name, ns in self._lost_ns.items() if ns]
        return "; ".join(gaps)

    def _progress(self, t_ns: int) -> Optional[float]:
        if self._phase == RecordingPhase.COMPLETE:
            return 1.0
        if self._phase not in _NEXT:
            return None
        return round(min(1.0, (t_ns - self._since_ns) / _NEXT[self._phase][1]), 3)

    def _platform(self, number: int, name: str) -> PlatformRecording:
        growing = self._growing[name]
        return PlatformRecording(
            platform=name,
            growing=growing,
            written_bytes=self._written[name],
            byte_rate=float(_BYTE_RATE[min(number, len(_BYTE_RATE) - 1)]) if growing else 0.0,
            free_fraction=round(1.0 - self._written[name] / _STORAGE_BYTES, 6),
            message="" if growing or self._phase not in _WRITING else "its files do not grow",
            cpu_fraction=_CPU[min(number, len(_CPU) - 1)],
        )
