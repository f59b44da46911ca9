"""What the user is answered, for every command in every state, and where a command that is done leads. Written by hand.

`D` done, `R` refused with the reason, `A` already so. In the order of `COMMANDS`.
"""

from __future__ import annotations

from typing import Dict, NamedTuple, Tuple

COMMANDS: Tuple[str, ...] = ("go", "retry", "give_up", "hold", "resume", "land", "abort", "acknowledge")


class Answers(NamedTuple):
    """One row: a letter for each command, and where each that is done leads."""

    letters: str
    leads: Dict[str, str]


_IN_AIR = {"hold": "HOLD confirming", "land": "LAND commanding", "abort": "LAND commanding"}
_HELD = {"resume": "HOLD resuming", "land": "LAND commanding", "abort": "LAND commanding"}
_END = dict.fromkeys(("give_up", "land", "abort"), "MISSION_INPUT")
_CLEAN_UP = dict.fromkeys(("give_up", "land", "abort"), "DATA_CLEANUP")

EXPECTED: Dict[str, Answers] = {
    "MISSION_INPUT": Answers("RRRRRRRR", {}),
    "PREFLIGHT": Answers("RADRRDDR", _END),
    "OUTREACH": Answers("RDDRRRRR", {"retry": "PREFLIGHT", "give_up": "MISSION_INPUT"}),
    "OUTREACH recorded": Answers("RDDRRRRR", {"retry": "PREFLIGHT", "give_up": "DATA_CLEANUP"}),
    "OUTREACH data": Answers("RDDRRRRR", {"retry": "DATA_CLEANUP", "give_up": "MISSION_ENDED"}),
    "OUTREACH data queued": Answers(
        "RDDRRDDR", {"retry": "DATA_CLEANUP", "give_up": "MISSION_ENDED", "land": "OUTREACH", "abort": "OUTREACH"}
    ),
    "READY": Answers("DRDRRDDR", {"go": "START_RECORDING", **_END}),
    "START_RECORDING": Answers("ARDRRDDR", _CLEAN_UP),
    "LOAD_MISSION": Answers("ARDRRDDR", _CLEAN_UP),
    "TAKEOFF arming": Answers("ARRRADDR", {"land": "LAND descending", "abort": "TAKEOFF cancelling"}),
    "TAKEOFF lifting_off": Answers("ARRRADDR", {"land": "LAND commanding", "abort": "TAKEOFF cancelling"}),
    "TAKEOFF cancelling": Answers("ARRRADAR", {"land": "LAND commanding"}),
    "TAKEOFF climbing": Answers("ARRDADDR", _IN_AIR),
    "MISSION flying": Answers("ARRDADDR", _IN_AIR),
    "MISSION touchdown": Answers("ARDRADDR", _CLEAN_UP),
    "HOLD confirming": Answers("RRRADDDR", {**_HELD, "resume": "HOLD confirming"}),
    "HOLD holding": Answers("RRRADDDR", _HELD),
    "HOLD holding takeoff": Answers("RRRADDDR", _HELD),
    "HOLD resuming": Answers("RRRDADDR", {**_HELD, "hold": "HOLD confirming"}),
    "LAND commanding": Answers("RRRRRAAR", {}),
    "LAND descending": Answers("RRRRRAAR", {}),
    "PILOT": Answers("RRRRRRRR", {}),
    "PILOT landed": Answers("RRRRRRRD", {"acknowledge": "DATA_CLEANUP"}),
    "DATA_CLEANUP": Answers("RARRRRRR", {}),
    "DATA_CLEANUP queued": Answers("RADRRDDR", _CLEAN_UP),
    "MISSION_ENDED": Answers("RRARRRRR", {}),
}

SELECTION: Dict[str, str] = {**dict.fromkeys(EXPECTED, "REFUSED"), "MISSION_INPUT": "DONE", "MISSION_ENDED": "DONE"}
