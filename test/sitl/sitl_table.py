"""Prints flights as a Markdown table, one row a scenario: from the folders that fly.py left.

.venv/bin/python test/sitl/sitl_table.py build/sitl/*      # of several, the last flight of each counts
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional

from sitl_autopilots import KINDS

_TIMES = {
    "code_16_to_mode_s": "16",
    "hold_to_mode_s": "hold",
    "resume_to_mode_s": "resume",
    "pilot_after_mode_s": "pilot",
}


def main() -> int:
    """Print the table, and below it what is wrong with those that are bad."""
    found: Dict[str, Dict[str, Mapping[str, Any]]] = {}
    folders = sorted((Path(name) for name in sys.argv[1:]), key=lambda path: path.stat().st_mtime)
    for path in (verdict for folder in folders for verdict in sorted(folder.glob("*/verdict.json"))):
        flight = json.loads(path.read_text(encoding="utf-8"))
        if not flight["flown_again"]:
            found.setdefault(flight["scenario"], {})[flight["autopilot"]] = flight
    print("| scenario | " + " | ".join(KINDS) + " |\n" + "|---|" * (1 + len(KINDS)))
    wrong: List[str] = []
    own: List[str] = []
    for scenario, flights in sorted(found.items()):
        print(f"| `{scenario}` | " + " | ".join(_cell(flights.get(name)) for name in KINDS) + " |")
        for name, flight in sorted(flights.items()):
            wrong += [f"- `{scenario}`, {name} ({flight['commit']}): {words}" for words in flight["wrong"]]
            if flight.get("own_behaviour"):
                own.append(f"- `{scenario}`, {name}: {flight['own_behaviour']}")
    print("\nWhat is bad:\n\n" + "\n".join(wrong or ["nothing"]))
    print("\nWhat is the autopilot's own:\n\n" + "\n".join(own or ["nothing"]))
    return 0


def _cell(flight: Optional[Mapping[str, Any]]) -> str:
    if flight is None:
        return "not flown"
    times = [f"{words} {flight['measured'][name]:.2f}" for name, words in _TIMES.items() if name in flight["measured"]]
    seconds = f", {flight['measured'].get('flight_s', 0.0):.0f} s"
    return f"{'good' if flight['good'] else '**bad**'}, {flight['result']}{seconds}" + (
        f" ({', '.join(times)})" if times else ""
    )


if __name__ == "__main__":
    sys.exit(main())
