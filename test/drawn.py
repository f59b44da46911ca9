"""What a commit tests of what takes long: a quarter that it draws; the night has the others.

`./run test` sets AMAZE_DRAW to the name of the commit: the same commit draws the same, and each another quarter.
Without it, as with arguments (`./run test test/bags`), everything is tested.
"""

from __future__ import annotations

import os
import re
import sys
from hashlib import sha256
from pathlib import Path
from typing import List, Sequence

sys.path.append(str(Path(__file__).parent / "proof"))
from proof_stories import STORIES

SEED = os.environ.get("AMAZE_DRAW", "")
OF = 4

# Whole flights, recordings and suites, a second of a processor each. Builds, and another Python
# (HYPOTHESIS_PROFILE=few), have a quarter of everything.
DRAWN = {
    "autopilot": "client link_fuzz modes_and_ages planner_ardupilot planner_recorded sequencer vehicle_lies"
    " vehicle_recorded",
    "bags": "bag_cli definitions real_bags",
    "bags/merge": "filter lz4_chunk_copy merge_bits",
    "bags/recover": "recover scan",
    "cns": "flights sequencer served_planner",
    "config": "fuzz",
    "nodes": "node_group web_page",
    "pages": "flight",
    "recording": "complete damaged job network_cut parts",
    "replay": "beginning cli demo_bag determinism flights journal_command light near_zero real_recordings run"
    " sensors_decide truth",
    "replay/maps": "first_configuration proposal",
    "replay/recordings": "export other_recordings status_tapes telemetry",
    "simulation": "cli run",
    "simulation/px4": "recordings soak",
    "simulation/vehicle": "vehicle_laws",
    "tester": "corpus outputs recipes suite_bags suite_cli suite_mistakes suite_tools vacuous",
}
FILES = frozenset(
    Path(__file__).parent / folder / f"test_{name}.py" for folder, names in DRAWN.items() for name in names.split()
)


# What forbids a command against a pilot or a landing is not drawn, each commit has all of it: by its name where
# vehicles are flown, and by the table of stories in docs/safety.md.
_TOLD = frozenset(each.split("::")[1] for told in STORIES for each in told.pure)
_CARE, _CARED_FOR = re.compile("pilot|disarm|land|taken|takes_over|takeover"), ("autopilot", "cns")


def is_kept(folder: str, function: str) -> bool:
    """Return whether every commit has a test of a folder (`autopilot`) and function, though its file is drawn from."""
    return function in _TOLD or (folder in _CARED_FOR and _CARE.search(function) is not None)


def _number(name: str, seed: str) -> int:
    return int.from_bytes(sha256(f"{seed} {name}".encode()).digest(), "big")


def is_drawn(name: str, seed: str = SEED) -> bool:
    """Return whether a seed draws what has this name: one of four; without a seed everything is."""
    return not seed or _number(name, seed) % OF == 0


def some_of(names: Sequence[str], seed: str = SEED) -> List[str]:
    """Return the quarter of these names that a seed draws, at least one, in their order; without a seed all."""
    count = -(-len(names) // OF) if seed else len(names)
    taken = set(sorted(names, key=lambda name: _number(name, seed))[:count])
    return [name for name in names if name in taken]
