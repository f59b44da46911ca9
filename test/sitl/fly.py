"""Fly scenarios with real autopilots in software-in-the-loop, each in a network of its own, and judge every flight.

    ./run sitl                         # all scenarios on both autopilots: more than an hour
    ./run sitl px4                     # on one of them
    ./run sitl ardupilot nominal cut_  # those whose names begin so
    ./run sitl px4 faults/             # those of config/faults, where a real autopilot can be made to do it
    ./run sitl --quick                 # the two flights of ./run test

PX4 and ArduCopter are looked for below AMAZE_SITL, else in ../shared/sitl: docs/simulation.md says how they are built.
Root only: it makes network namespaces. Everything of a flight stays in its folder: journal, report, bag, telemetry logs
of all links, what each process said. Exit status 0: all good; 1: some are bad; 77: there is no autopilot here.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

from sitl_autopilots import KINDS, ROOT, folder_of, ready_to_run
from sitl_faults import FOLDER, shipped
from sitl_judge import MEASURES, Verdict, judge
from sitl_scenario import Scenario, ScenarioError, load

SCENARIOS = Path(__file__).resolve().with_name("scenarios")
QUICK = (
    ("code_16_in_mission", "px4"),
    ("code_16_in_mission", "ardupilot"),
)
NOT_RUN = 77
_LONGEST_S = 300.0
_FLYING: List[subprocess.Popen[bytes]] = []
_COLUMNS = ("code_16_to_mode_s", "hold_to_mode_s", "resume_to_mode_s")


class Row(NamedTuple):
    """One flight in the table."""

    scenario: str
    autopilot: str
    verdict: Verdict
    wall_s: float
    folder: Path
    flown_again: bool = False


def main() -> int:
    """Fly, print one row for each as it ends, and count."""
    options = _options()
    found = {name: folder_of(name) for name in options.autopilots}
    missing = [name for name, folder in found.items() if folder is None]
    for name in missing:
        print(f"NO {name.upper()} IN SOFTWARE-IN-THE-LOOP HERE (AMAZE_SITL, ../shared/sitl): ITS FLIGHTS ARE NOT FLOWN")
    if len(missing) == len(found):
        return NOT_RUN
    if os.geteuid() != 0:
        print("NOT ROOT, SO NO NETWORK NAMESPACES: THE FLIGHTS WITH REAL AUTOPILOTS ARE NOT FLOWN")
        return NOT_RUN
    programs = {
        name: ready_to_run(name, folder, ROOT / "build") for name, folder in found.items() if folder is not None
    }
    flights = [each for each in _flights(options) if each[1] in programs]
    if not flights:
        print("no such scenario: " + ", ".join(path.stem for path in sorted(SCENARIOS.glob("*.yaml"))))
        return 2
    folder = Path(options.output or ROOT / "build" / "sitl" / time.strftime("%Y%m%dT%H%M%S"))
    print(f"{'scenario':<30} {'autopilot':<10}       {'result':<14} {'wall':>5}  " + _heads(), flush=True)
    with ThreadPoolExecutor(options.jobs) as pool:
        fly = partial(_fly, folder=folder, programs=programs, commit=_commit())
        try:
            rows = [row for tried in pool.map(fly, flights) for row in tried]
        except KeyboardInterrupt:
            for process in _FLYING.copy():  # in sessions of their own, they have not heard it
                process.send_signal(signal.SIGINT)
            os._exit(130)
    return _count(rows, folder, len(missing))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="px4, ardupilot, or how names of scenarios begin")
    parser.add_argument("--quick", action="store_true", help="the two flights of ./run test")
    parser.add_argument("-j", "--jobs", type=int, default=2, help="flights at the same time (default: 2)")
    parser.add_argument("-n", "--times", type=int, default=1, help="how often each is flown")
    parser.add_argument("--output", help="folder for what they write (default: build/sitl/DATE)")
    options = parser.parse_args()
    options.autopilots = [name for name in options.names if name in KINDS] or list(KINDS)
    options.names = [name for name in options.names if name not in KINDS]
    return options


def _flights(options: argparse.Namespace) -> List[Tuple[Scenario, str, int]]:
    """Return what is to be flown: scenario, autopilot, which time."""
    try:
        scenarios = {path.stem: load(path) for path in sorted(SCENARIOS.glob("*.yaml"))}
    except ScenarioError as error:
        raise SystemExit(f"sitl: {error}") from None
    if any(name.startswith("faults") for name in options.names):
        scenarios = _shipped()
    if options.quick:
        return [(scenarios[name], autopilot, 1) for name, autopilot in QUICK]
    return [
        (scenario, autopilot, number)
        for name, scenario in scenarios.items()
        if not options.names or any(name.startswith(each) for each in options.names)
        for autopilot in options.autopilots
        if autopilot in scenario.autopilots
        for number in range(1, options.times + 1)
    ]


def _shipped() -> Dict[str, Scenario]:
    """Return the scenarios of config/faults that can be done to a real autopilot; the others are named."""
    found: Dict[str, Scenario] = {}
    for path in sorted(FOLDER.glob("*.yaml")):
        try:
            found[f"faults/{path.stem}"] = shipped(path.stem)
        except ScenarioError as error:
            print(f"NOT FLOWN: {error}")
    return found


def _fly(flight: Tuple[Scenario, str, int], folder: Path, programs: Dict[str, Path], commit: str) -> List[Row]:
    """Fly one; one that failed before its takeoff is flown once more, and both are in the table."""
    scenario, autopilot, number = flight
    own = folder / f"{scenario.name.replace('/', '_')}_{autopilot}_{number}"
    row = _attempt(scenario, autopilot, own, programs[autopilot], commit)
    meant_to = all("TAKEOFF" in way for way in scenario.expect[autopilot]["states"])
    if not row.verdict.wrong or not meant_to or "TAKEOFF" in row.verdict.states:
        return [row]
    return [
        row._replace(flown_again=True),
        _attempt(scenario, autopilot, Path(f"{own}_again"), programs[autopilot], commit),
    ]


def _attempt(scenario: Scenario, autopilot: str, own: Path, program: Path, commit: str) -> Row:
    own.mkdir(parents=True)
    (own / "commit").write_text(commit + "\n", encoding="utf-8")
    began = time.monotonic()
    command = ["unshare", "--net", sys.executable, str(Path(__file__).with_name("sitl_flight.py"))]
    arguments = [scenario.name, autopilot, str(own), str(program)]
    with (own / "flight.txt").open("wb") as log:
        process = subprocess.Popen(
            [*command, *arguments], stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
        )
        _FLYING.append(process)
        try:
            process.wait(scenario.limit_s + _LONGEST_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        _FLYING.remove(process)
    try:
        verdict = judge(scenario, autopilot, own)
    except (OSError, ValueError) as error:  # a JournalError is one
        verdict = Verdict((f"it cannot be judged: {error}",), {}, "", (), (), "")
    row = Row(scenario.name, autopilot, verdict, time.monotonic() - began, own)
    (own / "verdict.json").write_text(json.dumps(_document(row), indent=2) + "\n", encoding="utf-8")
    print(_line(row), flush=True)
    return row


def _heads() -> str:
    return "  ".join(f"{name[:-2]:>15}" for name in _COLUMNS)


def _line(row: Row) -> str:
    verdict = row.verdict
    times = "  ".join(
        f"{verdict.measured[name]:>13.3f} s" if name in verdict.measured else " " * 15 for name in _COLUMNS
    )
    word = "BAD" if verdict.wrong else "good"
    first = (
        f"{row.scenario:<30} {row.autopilot:<10} {word:<5} {verdict.result:<14} {row.wall_s:4.0f} s  {times}".rstrip()
    )
    return "\n".join([first, *(f"{'':<30} {'':<10} {each}" for each in verdict.wrong)])


def _seconds(value: Optional[float]) -> str:
    return " " * 15 if value is None else f"{value:>13.3f} s"


def _count(rows: List[Row], folder: Path, missing: int) -> int:
    judged = [row for row in rows if not row.flown_again]
    bad = sum(1 for row in judged if row.verdict.wrong)
    document = {"measures": MEASURES, "flights": [_document(row) for row in rows]}
    (folder / "table.json").write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    skipped = "" if not missing else "; of one autopilot none was flown, see above"
    again = "" if len(judged) == len(rows) else f"; {len(rows) - len(judged)} failed before the takeoff and flew again"
    print(f"{len(judged) - bad} of {len(judged)} good{again}{skipped}; the table and everything else is in {folder}")
    return 1 if bad else 0


def _document(row: Row) -> Dict[str, Any]:
    return {
        "scenario": row.scenario,
        "autopilot": row.autopilot,
        "good": not row.verdict.wrong,
        "wrong": row.verdict.wrong,
        "result": row.verdict.result,
        "states": row.verdict.states,
        "modes": row.verdict.modes,
        "own_behaviour": row.verdict.own_behaviour,
        "measured": row.verdict.measured,
        "wall_s": round(row.wall_s, 1),
        "commit": (row.folder / "commit").read_text(encoding="utf-8").strip(),
        "folder": row.folder.name,
        "flown_again": row.flown_again,
    }


def _commit() -> str:
    done = subprocess.run(
        ["git", "-C", str(ROOT), "describe", "--always", "--dirty"], capture_output=True, check=False, timeout=60
    )
    return done.stdout.decode().strip() or "unknown"


if __name__ == "__main__":
    sys.exit(main())
