"""How large the page of a flight is, and how long a browser takes to open it.

    python test/bench/flight_page.py [PAGE.html ...] [--minutes 30]

Without pages: that of a simulated flight of so many minutes, as its recorder would have made it, with all sensors.
A page is open when the last drawing of what is in view is done: the script asks Debian's Chromium, headless and without
a graphics card, three times, and prints the fastest; beside it the processor's time that the page itself took, which
says what it would be on a computer with nothing else to do. Then it asks for the track in three dimensions. What is
asked of a page: below 15 MB, and open within 2 s for half an hour. The status is 1 when a page misses one of them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import List, NamedTuple, Optional

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "src"), str(Path(__file__).parent)]

from flight_bag import written  # noqa: E402

from amaze_autonomy.bags import Recording  # noqa: E402
from amaze_autonomy.bags.merge.merge import MergeOptions, merge  # noqa: E402
from amaze_autonomy.tester.command import main as replay  # noqa: E402

ROUNDS = 3
TARGET_MS, TARGET_MB = 2000, 15.0
# The page is busy while a timer of 20 ms comes late; it is open when that happened for the last time. It tells that
# itself: a browser with a debugger at its side reads the scripts several times.
PROBE = """<script>{ let before = performance.now(), busy = before, pressed = 0;
const told = setInterval(() => { const now = performance.now(); if (now - before > 60) busy = now; before = now;
if (now - busy < 2000) return;
fetch(`http://127.0.0.1:PORT/${Math.round(busy - pressed)}`, { mode: "no-cors" });
if (pressed) { clearInterval(told); return; }
pressed = busy = before = now;
const solid = document.getElementById("solid");
if (solid) solid.click(); }, 20); }</script>"""


class Opened(NamedTuple):
    """How long a page took, in milliseconds: to be open, of the processor for that, and to draw three dimensions."""

    open_ms: int
    processor_ms: int
    solid_ms: int


class Told(HTTPServer):
    """Hears what the page tells: how long it took, and how long the track in three dimensions took."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Hear)
        self.told_ms: List[int] = []


class _Hear(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        """Take one figure."""
        assert isinstance(self.server, Told)
        self.server.told_ms.append(int(self.path[1:]))
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Say nothing."""


def opened(page: Path, folder: Path) -> Opened:
    """Open a page in a browser that was just started."""
    probed, told = folder / "probed.html", Told()
    probe = PROBE.replace("PORT", str(told.server_port))
    probed.write_text(page.read_text("utf-8").replace("<header>", f"{probe}<header>", 1), encoding="utf-8")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or sys.exit("there is no chromium")
    graphics = ["--enable-unsafe-swiftshader", "--use-gl=angle", "--use-angle=swiftshader"]
    profile = tempfile.mkdtemp(dir=folder)
    command = [chromium, "--headless=new", "--no-sandbox", *graphics, f"--user-data-dir={profile}"]
    command += ["--window-size=1500,1000", probed.as_uri()]
    browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        told.handle_request()
        processor_ms = _processor_ms(profile)
        told.handle_request()
    finally:
        browser.terminate()
        with suppress(subprocess.TimeoutExpired):
            browser.wait(10.0)
        browser.kill()
        browser.wait()
        told.server_close()
    return Opened(told.told_ms[0], processor_ms, told.told_ms[1])


def _processor_ms(profile: str) -> int:
    """Return the processor's time that the main threads of a browser's pages took so far."""
    ticks = 0
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (process / "cmdline").read_text(errors="replace")
            if "--type=renderer" in words and profile in words:
                main = (process / "task" / process.name / "stat").read_text().rsplit(")", 1)[1].split()
                ticks += sum(map(int, main[11:13]))
    return round(ticks * 1000 / os.sysconf("SC_CLK_TCK"))


def made(folder: Path, minutes: float) -> Path:
    """Make the page of a simulated flight, and say how long that takes."""
    one, bag, page = folder / "one.bag", folder / "flight.bag", folder / "flight.html"
    written(one, repetitions=2)
    with Recording(one) as recording:
        length_ns = (recording.end_ns or 0) - (recording.start_ns or 0)
    copies = max(1, round(minutes * 60e9 / length_ns))  # no battery lasts for half an hour: flown again and again
    offsets = tuple(number * length_ns for number in range(copies))
    merge([one] * copies, bag, MergeOptions(offsets_ns=offsets))
    began = time.perf_counter()
    replay(["run", str(bag), "--map", "amaze_demo", "--mission", "4", "--html", str(page)])
    print(f"{bag.stat().st_size / 1e6:.0f} MB of recording: page made in {time.perf_counter() - began:.1f} s")
    return page


def judged(page: Path, best: Opened) -> bool:
    """Print a page's figures, and return whether they are what is asked."""
    size_mb = page.stat().st_size / 1e6
    good = size_mb < TARGET_MB and best.open_ms <= TARGET_MS
    print(
        f"{page.name}: {size_mb:.1f} MB, open after {best.open_ms} ms ({best.processor_ms} ms of processor), "
        f"three dimensions {best.solid_ms} ms after they were asked for; "
        f"target {TARGET_MB:g} MB, {TARGET_MS} ms: {'met' if good else 'MISSED'}"
    )
    return good


def main(arguments: Optional[List[str]] = None) -> int:
    """Print a line for each page; return 1 when one misses what is asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", type=Path)
    parser.add_argument("--minutes", type=float, default=30.0)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pages = options.pages or [made(folder, options.minutes)]
        good = [judged(page, min(opened(page, folder) for _ in range(ROUNDS))) for page in pages]
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
