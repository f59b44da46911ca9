"""What a flight was: good or bad, in sentences; and what was measured on the wire.

Besides what its scenario expects, every flight keeps the rules of RULES_OF_ALL, its journal is decided again without a
difference, and breaks no law of the proof.
"""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

from sitl_scenario import SKIPPED, Scenario
from sitl_wire import Order, Wire, read_wire

from amaze_autonomy.engine.events import AutopilotStatus, VehicleLanded
from amaze_autonomy.journal.journal import read

_TOGETHER_S = 0.05  # what was on its way when the engine decided
_ON_GROUND_M = 0.25
_FLOWN_M = 1.0  # higher than its height drifts on the ground
_SAME_S = 0.1
_MAP = "px4_telemetry"  # it names messages, which both autopilots send
_MODES = {"HOLD": "AUTO.LOITER", "RESUME": "AUTO.MISSION", "LAND": "AUTO.LAND"}

MEASURES: Mapping[str, str] = {
    "code_16_to_order_s": "from the watchdog's code 16, as the engine has it, to the order LAND on the wire",
    "code_16_to_mode_s": "from there to the landing mode in a heartbeat",
    "hold_to_mode_s": "from the engine's HOLD to the mode in a heartbeat",
    "resume_to_mode_s": "from the engine's RESUME to the mode in a heartbeat",
    "land_to_mode_s": "from the engine's first LAND to the mode in a heartbeat",
    "pilot_after_mode_s": "from a mode that the ground station commanded, in a heartbeat, to the state PILOT",
    "flight_s": "armed",
    "max_height_m": "above the ground",
    "journal_mb_per_hour": "what the engine's journal grows by while the state is MISSION, for the first time",
}


class Journal(NamedTuple):
    """What is in the journal, with times in s since 1970.

    Args:
        states: (time, state) of each change.
        decisions: (time, row).
        code_16_s: when the first code 16 came in flight; None: never.
        text: all of it.
        mb_per_hour: by which it grows while the state is MISSION, for the first time; None: it never left that.
    """

    states: Tuple[Tuple[float, str], ...]
    decisions: Tuple[Tuple[float, Mapping[str, Any]], ...]
    code_16_s: Optional[float]
    text: str
    mb_per_hour: Optional[float] = None

    def first(self, state: str) -> Optional[float]:
        """Return when a state was first entered."""
        return next((t_s for t_s, name in self.states if name == state), None)

    def sent(self, action: str) -> Optional[float]:
        """Return when the engine first told the planner something."""
        words = f"MissionCommand({action})"
        found = (t_s for t_s, row in self.decisions if any(each.startswith(words) for each in row["commands"]))
        return next(found, None)


class Verdict(NamedTuple):
    """How a flight went: what is wrong with it (nothing: good), what was measured, what the autopilot did by itself."""

    wrong: Tuple[str, ...]
    measured: Mapping[str, float]
    result: str
    states: Tuple[str, ...]
    modes: Tuple[str, ...]
    own_behaviour: str = ""


def read_journal(path: Path, unix_minus_monotonic_s: float) -> Journal:
    """Read a journal; it need not be whole."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    decisions: List[Tuple[float, Mapping[str, Any]]] = []
    code_16_s: Optional[float] = None
    for line in text.splitlines():
        if '"kind":"decision"' in line:
            row = json.loads(line)
            decisions.append((row["t_ns"] * 1e-9 + unix_minus_monotonic_s, row))
        elif code_16_s is None and '"event":"WatchdogAction"' in line and '"code":"ABORT"' in line:
            code_16_s = json.loads(line)["t_ns"] * 1e-9 + unix_minus_monotonic_s
    changes = [(t_s, row["after"]) for t_s, row in decisions]
    states = tuple(next(group) for _, group in itertools.groupby(changes, key=lambda each: each[1]))
    return Journal(states, tuple(decisions), code_16_s, text, _growth(text))


def _growth(text: str) -> Optional[float]:
    """Return by how many MB an hour the text grows while the state is MISSION, for the first time."""
    size, began = 0, None
    for line in text.splitlines(keepends=True):
        if '"kind":"decision"' in line:
            row = json.loads(line)
            if began is None and row["after"] == "MISSION":
                began = (size, row["t_ns"])
            elif began is not None and row["after"] != "MISSION" and row["t_ns"] > began[1]:
                return (size - began[0]) / (row["t_ns"] - began[1]) * 3600 * 1000
        size += len(line.encode())
    return None


def judge(scenario: Scenario, autopilot: str, folder: Path) -> Verdict:
    """Judge a flight by what lies in its folder."""
    path = folder / "facts.json"
    if not path.exists():
        return Verdict(("it was not flown: see its flight.txt",), {}, "?", (), ())
    facts = json.loads(path.read_text(encoding="utf-8"))
    journal = read_journal(folder / "run" / "journal.jsonl", facts["unix_minus_monotonic_s"])
    wire = read_wire(folder, autopilot)
    ended = folder / "run" / "result.json"
    result = json.loads(ended.read_text(encoding="utf-8"))["result"] if ended.exists() else "?"
    states = tuple(name for name in _way(journal) if name not in SKIPPED)
    measured = _measured(journal, wire)
    wrong = [
        *_ended(facts),
        *_expected(scenario.expect[autopilot], result, states, wire, measured, journal),
        *_rules(journal, wire, result),
        *_replayed(folder / "run" / "journal.jsonl"),
        *_log_replayed(folder, facts, scenario, scenario.expect[autopilot].get("log_within_s", _SAME_S)),
    ]
    own = scenario.expect[autopilot].get("own_behaviour", "")
    return Verdict(tuple(wrong), measured, result, states, tuple(wire.armed_modes), own)


def _way(journal: Journal) -> List[str]:
    return [name for _, name in journal.states]


def _ended(facts: Mapping[str, Any]) -> List[str]:
    wrong = [] if facts["ended_by"] == "itself" else [f"it was ended by {facts['ended_by']}"]
    if facts["not_done"]:
        wrong.append(f"it never came to {', '.join(facts['not_done'])}")
    if facts["armed_at_end"]:
        wrong.append("the vehicle is armed at the end")
    return wrong


def _expected(
    expect: Mapping[str, Any],
    result: str,
    states: Tuple[str, ...],
    wire: Wire,
    measured: Mapping[str, float],
    journal: Journal,
) -> List[str]:
    wrong: List[str] = []
    if expect["result"] != [""] and result not in expect["result"]:
        wrong.append(f"the result is {result}, not {' or '.join(expect['result'])}")
    flown = [list(states)[: len(way)] if expect.get("begins") else list(states) for way in expect["states"]]
    if not any(mine == way for mine, way in zip(flown, expect["states"])):
        wanted = " or ".join(" ".join(way) for way in expect["states"])
        wrong.append(f"the states are {' '.join(states)}, not {wanted}")
    if "modes" in expect:
        ways = expect["modes"] if isinstance(expect["modes"][0], list) else [expect["modes"]]
        if wire.armed_modes not in ways:
            wanted = " or ".join(" ".join(way) for way in ways)
            wrong.append(f"the modes are {' '.join(wire.armed_modes)}, not {wanted}")
    for name, limit in {**expect.get("at_most", {}), **expect.get("at_least", {})}.items():
        value, least = measured.get(name), name in expect.get("at_least", {})
        if value is None:
            wrong.append(f"{name} was never measured")
        elif value < limit if least else value > limit:
            wrong.append(f"{name} is {value:.3f}, must be {'at least' if least else 'at most'} {limit:g}")
    wrong += [f"the journal never says {words!r}" for words in expect.get("texts", ()) if words not in journal.text]
    return wrong


def _rules(journal: Journal, wire: Wire, result: str = "") -> List[str]:
    """Check what holds in every flight."""
    wrong: List[str] = []
    highest_m = max((height for _, height in wire.heights), default=0.0)
    if result == "NOT_FLOWN" and highest_m > _FLOWN_M:
        wrong.append(f"it was {highest_m:.1f} m up, and is said to be NOT_FLOWN")
    ours = [each for each in wire.orders if each.who != "station"]
    for each in ours:
        if each.what == "DISARM" and each.height_m > _ON_GROUND_M:
            wrong.append(f"{each.who} sent DISARM at {each.height_m:.1f} m")
            break
    land_s = journal.first("LAND")
    if land_s is not None:
        wrong += _against(
            ours, land_s + _TOGETHER_S, _end(wire, land_s), ("AUTO.LAND", "DISARM"), "while the engine lands"
        )
    pilot_s = journal.first("PILOT")
    if pilot_s is not None:
        begin_s, end_s = pilot_s + _TOGETHER_S, _end(wire, pilot_s)
        lifted = any(height > _ON_GROUND_M for t_s, height in wire.heights if t_s < end_s)
        good = () if lifted else ("DISARM",)  # our own arming is taken back; DISARM in the air is bad anyway
        wrong += _against(ours, begin_s, end_s, good, "while the pilot has control")
    return wrong


def _end(wire: Wire, after_s: float) -> float:
    """Return when the vehicle was disarmed after a time; the end of the log when it was not."""
    return next((each.t_s for each in wire.shown if each.t_s > after_s and not each.armed), float("inf"))


def _against(ours: List[Order], begin_s: float, end_s: float, good: Tuple[str, ...], when: str) -> List[str]:
    bad = [each for each in ours if begin_s < each.t_s < end_s and each.what not in good]
    if not bad:
        return []
    first = bad[0]
    return [f"{first.who} ordered {first.what} {first.t_s - begin_s:.2f} s later, {when} ({len(bad)} such orders)"]


def _measured(journal: Journal, wire: Wire) -> Dict[str, float]:
    """Measure what MEASURES names."""
    found: Dict[str, Optional[float]] = {}
    if journal.code_16_s is not None:
        found["code_16_to_order_s"] = _since(journal.code_16_s, wire.first_order("AUTO.LAND", journal.code_16_s))
        found["code_16_to_mode_s"] = _since(journal.code_16_s, wire.first_shown("AUTO.LAND", journal.code_16_s))
    for action, mode in _MODES.items():
        sent_s = journal.sent(action)
        if sent_s is not None:
            found[f"{action.lower()}_to_mode_s"] = _since(sent_s, wire.first_shown(mode, sent_s))
    taken_s, pilot_s = _taken(wire), journal.first("PILOT")
    if taken_s is not None and pilot_s is not None:
        found["pilot_after_mode_s"] = pilot_s - taken_s
    armed_s = next((each.t_s for each in wire.shown if each.armed), None)
    if armed_s is not None:
        found["flight_s"] = _since(armed_s, _end(wire, armed_s))
    found["max_height_m"] = max((height for _, height in wire.heights), default=None)
    found["journal_mb_per_hour"] = journal.mb_per_hour
    return {name: value for name, value in found.items() if value is not None}


def _taken(wire: Wire) -> Optional[float]:
    order = next((each for each in wire.orders if each.who == "station"), None)
    return None if order is None else wire.first_shown(order.what, order.t_s)


def _since(begin_s: float, end_s: Optional[float]) -> Optional[float]:
    return None if end_s is None else end_s - begin_s


def _replayed(path: Path) -> List[str]:
    """Decide the journal again, and check the laws on it."""
    if not path.exists():
        return ["it has no journal"]
    tool = str(Path(sys.executable).with_name("amaze-replay"))
    wrong = []
    for words, command in (("its journal is decided differently", "journal"), ("it breaks a law", "laws")):
        done = subprocess.run([tool, command, str(path)], capture_output=True, text=True, check=False, timeout=600)
        if done.returncode != 0:
            lines = (done.stdout + done.stderr).strip().splitlines()
            wrong.append(f"{words}: {lines[-1] if lines else done.returncode}")
    return wrong


def _log_replayed(folder: Path, facts: Mapping[str, Any], scenario: Scenario, within_s: float) -> List[str]:
    """Replay the telemetry log of the autopilot node's link: armed, mode and landed state as heard, when heard."""
    live, log = folder / "run" / "journal.jsonl", folder / "node.tlog"
    nobody_listened = any(each.get("node") == "autopilot" or each["do"] == "kill_engine" for each in facts["done"])
    nobody_listened |= any(each.get("process") == "autopilot" for each in scenario.world.get("faults", ()))
    if not live.exists() or nobody_listened:
        return []
    with tempfile.TemporaryDirectory() as out:
        command = [str(Path(sys.executable).with_name("amaze-replay")), "run", str(log), "--map", _MAP, "--out", out]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
        replayed = Path(out) / "journal.jsonl"
        if not replayed.exists():
            return [f"its telemetry log cannot be replayed: {(done.stderr.strip().splitlines() or ['?'])[-1]}"]
        heard, again = _told(live, facts["unix_minus_monotonic_s"]), _told(replayed, 0.0)
    return [each for name, changes in heard.items() for each in _compared(name, changes, again[name], within_s)]


_Change = Tuple[float, str, float]


def _told(path: Path, offset_s: float) -> Dict[str, List[_Change]]:
    """Return what the autopilot's statuses of a journal say, as changes; unknown is left out.

    Each has its time, and for how long nothing had come over the link before it.
    """
    found: Dict[str, List[_Change]] = {"armed": [], "mode": [], "landed": []}
    silent_s = 0.0
    for line in read(path.read_text(encoding="utf-8")).lines:
        status = line.payload
        if not isinstance(status, AutopilotStatus):
            continue
        told = {"armed": "" if status.armed is None else str(status.armed), "mode": status.mode}
        told["landed"] = "" if status.landed is VehicleLanded.UNKNOWN else status.landed.name
        for name, value in told.items():
            if value and (not found[name] or found[name][-1][1] != value):
                found[name].append((status.t_ns * 1e-9 + offset_s, value, silent_s))
        silent_s = status.link_age_s or 0.0
    return found


def _compared(name: str, heard: List[_Change], again: List[_Change], within_s: float) -> List[str]:
    """Compare from the second value on: when the first was heard depends on when somebody began to listen.

    The log is written where the link begins: what is heard after a silence was on its way for that long at most.
    """
    mine, its = heard[1:], again[-(len(heard) - 1) :] if len(heard) > 1 else []
    if [value for _, value, _ in mine] != [value for _, value, _ in its]:
        words = " ".join(value for _, value, _ in again)
        return [f"its telemetry log says of {name} {words}, the flight heard {' '.join(one[1] for one in heard)}"]
    off_s = max((abs(one - other) - silent_s for (one, _, silent_s), (other, _, _) in zip(mine, its)), default=0.0)
    return (
        [] if off_s <= within_s else [f"its telemetry log has {name} {off_s:.3f} s earlier or later than it was heard"]
    )
