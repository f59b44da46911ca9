"""How large the page of a flight is, and how long a browser takes to open it.

    python test/bench/flight_page.py [PAGE.html ...] [--minutes 30]

Without pages: that of a simulated flight of so many minutes, as its recorder would have made it, with all sensors.
A page is open when its last drawing is done, plots, track in three dimensions and all: the script asks Debian's
Chromium, headless and without a graphics card, three times, and prints the fastest. What is asked of a page: below
15 MB, and open within 2 s for half an hour. Asserts nothing.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "src"), str(Path(__file__).parent)]

from flight_bag import written  # noqa: E402

from amaze_autonomy.bags import Recording  # noqa: E402
from amaze_autonomy.bags.merge import MergeOptions, merge  # noqa: E402
from amaze_autonomy.tester.command import main as replay  # noqa: E402

ROUNDS = 3
# The page is busy while a timer of 20 ms comes late; it is open when that happened for the last time.
PROBE = """<script>{ let before = performance.now(), busy = before; const began = before;
setInterval(() => { const now = performance.now(); if (now - before > 60) busy = now; before = now;
document.documentElement.dataset.opened = Math.round(busy); }, 20); }</script>"""


def opened_ms(page: Path, folder: Path) -> int:
    """Return when the page was open, in milliseconds after the browser began to read it."""
    probed = folder / "probed.html"
    probed.write_text(page.read_text("utf-8").replace("<header>", f"{PROBE}<header>", 1), encoding="utf-8")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or sys.exit("there is no chromium")
    graphics = ["--enable-unsafe-swiftshader", "--use-gl=angle", "--use-angle=swiftshader"]
    command = [chromium, "--headless=new", "--no-sandbox", *graphics, f"--user-data-dir={folder / 'browser'}"]
    command += ["--window-size=1500,1000", "--timeout=8000", "--dump-dom", probed.as_uri()]
    dom = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True, text=True).stdout
    found = re.search(r'data-opened="(\d+)"', dom)
    return int(found.group(1)) if found else sys.exit(f"{page}: the browser said nothing")


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


def main() -> None:
    """Print a line for each page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", type=Path)
    parser.add_argument("--minutes", type=float, default=30.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for page in options.pages or [made(folder, options.minutes)]:
            took_ms = min(opened_ms(page, folder) for _ in range(ROUNDS))
            print(f"{page.name}: {page.stat().st_size / 1e6:.1f} MB, open after {took_ms} ms")


if __name__ == "__main__":
    main()
