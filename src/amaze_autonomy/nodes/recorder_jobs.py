"""The processes that work on a recorder's files: jobs on bags, and rsync. None of them outlives the node for long."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Sequence, Set

from amaze_autonomy.config.recording_schema import Transfer
from amaze_autonomy.recording.programs import mounted, problem_of, progress_of, transfer_command
from amaze_autonomy.recording.storage import PARTS, read_json

__all__ = ["RecorderJobs"]

_LAST_WORDS = 400
Progress = Callable[[Mapping[str, Any]], None]
Ended = Callable[[Mapping[str, Any]], None]


class RecorderJobs:
    """Starts them, each with a thread of its own that waits for it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._processes: Set[subprocess.Popen[Any]] = set()
        self._over = False

    @property
    def pids(self) -> List[int]:
        """Return the numbers of the processes that run."""
        with self._lock:
            return [process.pid for process in self._processes]

    def stop(self) -> None:
        """End all of them."""
        with self._lock:
            self._over = True
            processes = list(self._processes)
        for process in processes:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)

    # --- jobs on bags ---------------------------------------------------------------------------------------------

    def run(self, request: Mapping[str, Any], progress: Progress, ended: Ended) -> None:
        """Run a job of `amaze_autonomy.recording.job`.

        Args:
            request: what it shall do.
            progress: called with each line of its progress.
            ended: called with its result: its problem, or an empty text; `killed` when it was.
        """
        threading.Thread(target=self._run, args=(request, progress, ended), name="job", daemon=True).start()

    def _run(self, request: Mapping[str, Any], progress: Progress, ended: Ended) -> None:
        result: Dict[str, Any] = {}
        command = [sys.executable, "-m", "amaze_autonomy.recording.job"]
        try:
            process = self._start(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
        except OSError as error:
            ended({"problem": f"the job cannot be started: {error}"})
            return
        last = _Tail(process.stderr)
        with suppress(OSError):
            process.stdin.write((json.dumps(request) + "\n").encode())
            process.stdin.flush()
        for line in process.stdout:
            with suppress(ValueError):
                said = json.loads(line)
                result = said.get("result", result)
                if "progress" in said:
                    progress(said)
        status = self._wait(process)
        if not result:
            words = "; ".join(last.text().splitlines()[-2:])
            why = f"killed by {signal.Signals(-status).name}" if status < 0 else words or f"status {status}"
            result = {"problem": f"the process that works on the bags has ended ({why})", "killed": status < 0}
        ended(result)

    # --- transfer -------------------------------------------------------------------------------------------------

    def fetch(self, transfer: Transfer, location: str, target: Path, progress: Callable[[float], None]) -> str:
        """Fetch a part, waiting for it; return why it did not come, or an empty text.

        Args:
            transfer: how.
            location: of the part, as the platform names it.
            target: folder on this computer.
            progress: called with 0..1.
        """
        if not location:
            return "the platform did not say where its part lies"
        if transfer.by == "here":
            return "" if (Path(location) / PARTS).is_file() else f"{location} is not on this computer"
        source = mounted(transfer, location)
        if transfer.by == "shared" and not Path(source).is_dir():
            return f"{source} is not there: is the other platform's storage mounted?"
        try:
            target.mkdir(parents=True, exist_ok=True)
            problem = self._rsync(transfer, location, target, [PARTS], progress)
            content = read_json(target / PARTS)
            if problem or content is None:
                return problem or f"{location}/{PARTS} cannot be read"
            files = [str(each["file"]) for each in content["files"]]
            return self._rsync(transfer, location, target, [*files, *content.get("logs", [])], progress)
        except OSError as error:
            return f"{target}: {error.strerror}"

    def _rsync(
        self, transfer: Transfer, location: str, target: Path, names: Sequence[str], progress: Callable[[float], None]
    ) -> str:
        listing = target / ".wanted"
        listing.write_text("".join(f"{name}\n" for name in names), encoding="utf-8")
        process = self._start(transfer_command(transfer, location, target, listing), stderr=subprocess.PIPE)
        last = _Tail(process.stderr)
        while True:
            data = os.read(process.stdout.fileno(), 4096)
            if not data:
                break
            done = progress_of(data.decode("utf-8", "replace"))
            if done is not None and names != [PARTS]:
                progress(done)
        status = self._wait(process)
        listing.unlink()
        return "" if status == 0 else f"rsync: {problem_of(last.text(), status)}"

    # --- processes ------------------------------------------------------------------------------------------------

    def _start(self, command: Sequence[str], **options: Any) -> Any:
        options.setdefault("stdin", subprocess.DEVNULL)
        with self._lock:
            if self._over:
                raise OSError(0, "the node ends")
            process = subprocess.Popen(list(command), stdout=subprocess.PIPE, start_new_session=True, **options)
            self._processes.add(process)
        return process

    def _wait(self, process: Any) -> int:
        status = int(process.wait())
        with self._lock:
            self._processes.discard(process)
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        return status


class _Tail:
    """Reads a stream to its end on a thread of its own, and keeps its last words."""

    def __init__(self, stream: Any) -> None:
        self._data = b""
        self._thread = threading.Thread(target=self._read, args=(stream,), name="stderr", daemon=True)
        self._thread.start()

    def _read(self, stream: Any) -> None:
        with stream:
            while True:
                data = stream.read1(4096)
                if not data:
                    return
                self._data = (self._data + data)[-_LAST_WORDS:]

    def text(self) -> str:
        self._thread.join(1.0)
        lines = [line.strip() for line in self._data.decode("utf-8", "replace").splitlines() if line.strip()]
        return "\n".join(lines)
