"""Prints flights as a page in Markdown, one row a scenario: from the folders that fly.py left.

.venv/bin/python test/sitl/sitl_table.py build/sitl/* >docs/flights.md   # of several, the last flight of each counts
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Dict, List, Mapping

from fly import SCENARIOS
from mavsdk_flight import FIGURES
from sitl_autopilots import KINDS
from sitl_faults import FOLDER, shipped
from sitl_scenario import ScenarioError, load

_TIMES = {
    "code_16_to_mode_s": "16",
    "hold_to_mode_s": "hold",
    "resume_to_mode_s": "resume",
    "pilot_after_mode_s": "pilot",
}
_HEAD = """# Flights with real autopilots

What `./run sitl` flew ([simulation.md](simulation.md)), as `test/sitl/sitl_table.py` prints it: every scenario on PX4
v1.16.1 and ArduCopter 4.5.6 in software-in-the-loop, with roslaunch and all real nodes, two flights at a time on two
cores. A flight is good when its states, result and modes are the expected ones, nobody of ours did what nobody may,
its journal is decided again without a difference and breaks no law, and the telemetry log of its link says the same
within 0.1 s (half a second where the autopilot itself starts anew). Then come its result, the time in the air, and what
was measured on the wire, in seconds: from a code 16, a hold or a resume to the mode that the vehicle shows, and from
another's mode to PILOT. In a link that is cut, the mode is shown when it is back.

A flight that fails before its takeoff is flown once more, and both are listed: on two busy cores nodes that all start
at once do not run for half a second, and the pre-flight check refuses.
"""
_NOMINAL = "nominal"


def main() -> int:
    """Print the page: the table, what is bad, what failed first and was good later, what is the autopilot's own."""
    found: Dict[str, Dict[str, List[Mapping[str, Any]]]] = {}
    folders = sorted((Path(name) for name in sys.argv[1:]), key=lambda path: path.stat().st_mtime)
    for path in (verdict for folder in folders for verdict in sorted(folder.glob("*/verdict.json"))):
        flight = json.loads(path.read_text(encoding="utf-8"))
        found.setdefault(flight["scenario"], {}).setdefault(flight["autopilot"], []).append(flight)
    not_for = {path.stem: load(path).not_for for path in SCENARIOS.glob("*.yaml")}
    print(_HEAD + "\n| scenario | " + " | ".join(KINDS) + " |\n|---" + "|---" * len(KINDS) + "|")
    listed: Dict[str, List[str]] = {"What is bad": [], "What failed first": [], "What is the autopilot's own": []}
    for scenario, flights in sorted(found.items()):
        cells = [_cell(flights.get(name, ()), not_for.get(scenario, {}).get(name, "")) for name in KINDS]
        print(f"| `{scenario}` | " + " | ".join(cells) + " |")
        for name, flown in sorted(flights.items()):
            for flight in flown:
                last = flight is flown[-1] or (scenario == _NOMINAL and not flight["flown_again"])
                where = listed["What is bad" if last else "What failed first"]
                wrong = "; ".join(flight["wrong"])
                where += [f"- `{scenario}`, {name} ({flight['commit']}): {wrong}"] if wrong else []
            if flown[-1].get("own_behaviour"):
                listed["What is the autopilot's own"].append(f"- `{scenario}`, {name}: {flown[-1]['own_behaviour']}")
    print("\n" + "\n".join(_by_mavsdk([folder / FIGURES for folder in folders if (folder / FIGURES).exists()])))
    for title, lines in listed.items():
        print(f"\n## {title}\n\n" + "\n".join(lines or ["Nothing."]))
    print("\n## What a real autopilot is not made to do\n\n" + "\n".join(_not_to_be_flown()))
    return 0


def _not_to_be_flown() -> List[str]:
    """Return a line for each scenario that ships and is flown in simulation alone."""
    lines = []
    for path in sorted(FOLDER.glob("*.yaml")):
        try:
            shipped(path.stem)
        except ScenarioError as error:
            lines.append(f"- `{error}".replace(": ", "`: ", 1))
    return lines


def _by_mavsdk(files: List[Path]) -> List[str]:
    """Return a section with what the same orders take by MAVSDK."""
    rows = [row for path in files for row in json.loads(path.read_text(encoding="utf-8"))]
    lines = ["## The same orders by MAVSDK", ""]
    if not rows:
        return [*lines, "Not flown."]
    lines += [
        "From the call to the mode that the vehicle shows, in seconds: the nominal mission of `./run sitl-mavsdk`.",
        "",
    ]
    names = list(next((row["to_mode_s"] for row in rows if row["to_mode_s"]), ()))
    lines += ["| autopilot | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for row in rows:
        times = [f"{row['to_mode_s'][name]:.2f}" for name in names] if row["to_mode_s"] else ["**failed**"] * len(names)
        lines.append(f"| {row['autopilot']} | " + " | ".join(times) + " |")
    return lines


def _cell(flown: List[Mapping[str, Any]], why_not: str) -> str:
    if not flown:
        return f"not for it: {why_not}" if why_not else "**not flown**"
    flight, good = flown[-1], sum(1 for each in flown if each["good"])
    times = [f"{words} {flight['measured'][name]:.2f}" for name, words in _TIMES.items() if name in flight["measured"]]
    seconds = f", {flight['measured'].get('flight_s', 0.0):.0f} s"
    often = f", {good} of {len(flown)}" if flight["scenario"] == _NOMINAL else ""
    return f"{'good' if flight['good'] else '**bad**'}{often}, {flight['result']}{seconds}" + (
        f" ({', '.join(times)})" if times else ""
    )


if __name__ == "__main__":
    sys.exit(main())
