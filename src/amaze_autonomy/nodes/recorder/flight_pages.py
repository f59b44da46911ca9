"""The page beside each finished recording, made when nobody else wants the computer.

`python -m amaze_autonomy.nodes.recorder.flight_pages JOURNAL...` makes one page after the other, in one group of
processes: it is ended as a whole, and outlives the node as a whole.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Set

_PAGE, _PAGE_LIMIT_S = "flight.html", 600.0
_LAST_WORDS = 500  # characters


class FlightPages:
    """Makes the page beside each finished recording: in a process of its own, about which nobody else need know.

    It reads what is finished, when nobody else wants the processor, and puts its one file there when it is whole. It
    goes on for a while when the node ends. While something is recorded none is made: what was begun is made after that.
    What fails is a warning.

    Args:
        say: takes what came of a page, and whether all is well.
    """

    def __init__(self, say: Callable[[str, bool], None]) -> None:
        self._say = say
        self._lock = threading.Lock()
        self._process: Optional[subprocess.Popen[bytes]] = None
        self._begun: Set[Path] = set()
        self._waiting: List[Path] = []
        self._stopped, self._killed = False, None  # type: bool, Optional[subprocess.Popen[bytes]]

    def add(self, folder: Path) -> None:
        """Make the page of a session's folder, once, where its recording is complete and nothing is recorded."""
        bag, journal = folder / f"{folder.name}.bag", folder / "journal.jsonl"
        with self._lock:
            if folder in self._begun or not bag.is_file():
                return
            self._begun.add(folder)
            self._waiting.append(journal if journal.is_file() else bag)
        self._start()

    def stop(self) -> None:
        """End what is being made: the next flight needs the computer."""
        with self._lock:
            self._stopped, process = True, self._process
            self._killed = process or self._killed
        if process is not None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)

    def go_on(self) -> None:
        """Make what waits: nothing is recorded any more."""
        with self._lock:
            self._stopped = False
        self._start()

    def _start(self) -> None:
        """Begin with all that waits, unless something is recorded or made."""
        with self._lock:
            sources = tuple(self._waiting)
            if not sources or self._stopped or self._process is not None:
                return
            command = [sys.executable, "-m", __name__, *map(str, sources)]
            try:
                words: Any = tempfile.TemporaryFile()  # noqa: SIM115  # `_wait` closes it; a pipe would end with the node
                self._process = process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=words, stderr=words, start_new_session=True
                )
            except OSError as error:
                self._say(f"no {sources[0].parent / _PAGE}: {error}", False)
                return
            self._waiting.clear()
        threading.Thread(target=self._wait, args=(process, sources, words), daemon=True).start()

    def _wait(self, process: Any, sources: Sequence[Path], words: Any) -> None:
        """Wait for a process; say what came of each page, and go on with what waits."""
        process.wait()
        with words:
            words.seek(0)
            said = _last_words(words.read().decode("utf-8", "replace"), sources)
        with self._lock:
            self._process = None
            left = [each for each in sources if process is self._killed and not (each.parent / _PAGE).is_file()]
            self._waiting[:0] = left
        for source in sources:
            page = source.parent / _PAGE
            if source in left:
                self._say(f"no {page} yet: it is made after the recording that has begun", True)
            else:
                there = page.is_file()
                self._say(str(page) if there else f"no {page}: {said[source][:_LAST_WORDS]}", there)
        self._start()


def _last_words(text: str, sources: Sequence[Path]) -> Dict[Path, str]:
    """Return the last line that was said of each page."""
    found: Dict[Path, str] = {}
    for source in reversed(sources):
        text, _, own = text.rpartition(f"\n{source}\n")
        found[source] = "".join(own.strip().splitlines()[-1:])
    return found


def _make_each(sources: Sequence[str]) -> None:
    """Make the page of each journal or recording, with the lowest precedence; what it says stands below its name."""
    os.nice(19)
    for each in sources:
        print(f"\n{each}", flush=True)
        page = str(Path(each).parent / _PAGE)
        replay = [sys.executable, "-m", "amaze_autonomy.tester.command", "journal", each, "--html", page]
        try:
            subprocess.run(replay, stdin=subprocess.DEVNULL, timeout=_PAGE_LIMIT_S, check=False)
        except subprocess.TimeoutExpired:
            print(f"it was not made in {_PAGE_LIMIT_S:.0f} s", flush=True)


if __name__ == "__main__":
    _make_each(sys.argv[1:])
