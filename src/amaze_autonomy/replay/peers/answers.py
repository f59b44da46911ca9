"""The answers to the pre-flight checks: from the recording where it tells, else from the script."""

from __future__ import annotations

from dataclasses import replace
from math import degrees
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import RunCheck
from amaze_autonomy.engine.events import (
    CheckReply,
    ComponentStatus,
    Landed,
    LandedStatus,
    Outcome,
    VehicleLanded,
    WatchdogInfo,
)
from amaze_autonomy.monitoring.battery import CELL_VOLTAGE
from amaze_autonomy.monitoring.specs import BatterySpec

from ...engine.events import Check, CheckName, Verdict
from ...engine.rules import Code
from ...journal.report import limit_words
from ..monitors.monitors import Monitors
from ..plan import Plan, recorded_words
from ..timeline import Source
from .recorded_nodes import RecordedNodes


class Recorded(NamedTuple):
    """How a check is answered by a recording.

    Args:
        row: name of the row that the script answers with, where the recording does not tell.
        readings: readings of the recording that it rests on.
        found: what the recording tells; None: nothing.
    """

    row: str
    readings: Tuple[str, ...] = ()
    found: Callable[[Answers, int, RunCheck], Optional[Dict[str, Any]]] = lambda *_: None


class Answers:
    """Answers checks.

    Args:
        plan: of the replay.
        monitors: that know what the recording tells.
        recorded: what the recorded watchdog said of components that have no topic there.
        landed: whether the recorded vehicle says at a time that it is on the ground; None: it says nothing.
    """

    def __init__(
        self,
        plan: Plan,
        monitors: Monitors,
        recorded: RecordedNodes,
        landed: Callable[[int], Optional[VehicleLanded]],
    ) -> None:
        self._plan, self._monitors, self._recorded, self._landed = plan, monitors, recorded, landed
        self.recorded_info: Optional[WatchdogInfo] = None
        self.recorded_landed: Optional[LandedStatus] = None
        self.last: Dict[CheckName, Tuple[Source, Tuple[Check, ...]]] = {}

    def answer(self, t_ns: int, command: RunCheck, source: Source) -> Tuple[CheckReply, Source]:
        """Return the answer to a check at a time, and where it comes from; `source` is that of the samples now."""
        found = RECORDED[command.check].found(self, t_ns, command)
        if found is None:
            names = (RECORDED[command.check].row, *command.required)
            rows: Tuple[Check, ...] = tuple(Check(name, Verdict.PASS, advice="scripted") for name in names)
            found, source = {"ok": True, "checks": rows}, Source.SCRIPT
        self.last[command.check] = source, found["checks"]
        reply = CheckReply(
            t_ns=t_ns, command_id=command.id, check=command.check, outcome=Outcome.ACCEPTED, **_explained(found)
        )
        return reply, source

    def watchdog_waits(self, t_ns: int) -> bool:
        """Return True while a component may still come up, so that the first answer is worth waiting for."""
        verdict = self._monitors.watchdog.checks(t_ns)
        return not verdict.ready and verdict.fixable

    def battery(self, t_ns: int, command: RunCheck) -> Optional[Dict[str, Any]]:
        """Return what the recorded battery tells."""
        if self._monitors.battery is None:
            return None
        battery, spec = self._monitors.battery.check(t_ns, command.required_fraction), self._monitors.battery.spec
        return {"ok": battery.ok, "checks": tuple(_of_cells(row, battery.voltage_v, spec) for row in battery.checks)}

    def state_estimation(self, t_ns: int, _: RunCheck) -> Optional[Dict[str, Any]]:
        """Return what the recorded estimate tells."""
        state = self._monitors.check_state(t_ns)
        return None if state is None else {"ok": state.valid, "checks": state.checks}

    def watchdog(self, t_ns: int, _: RunCheck) -> Optional[Dict[str, Any]]:
        """Return what the recorded components tell."""
        compared = self._recorded.compares("watchdog_info")
        if "watchdog_info" in self._plan.topic_map.statuses and not compared:
            return None if self.recorded_info is None else self._recorded_watchdog(self.recorded_info)
        verdict = self._monitors.watchdog.checks(t_ns)
        others = tuple(self._recorded.foreign.values())
        tolerated = self._plan.mission.tolerated
        needed = (each for each in others if each.name in self._plan.elsewhere)
        rows = tuple(_component_row(each, tolerated=each.name in tolerated) for each in needed)
        good = all(row.passed for row in rows)
        unseen = (each for each in self._plan.unseen.items() if each[0] not in self._recorded.foreign)
        return {
            "ok": verdict.ready and good,
            "checks": (*verdict.checks, *rows, *(_unseen_row(*each) for each in unseen)),
            "fixable": verdict.fixable and good,
            "being_fixed": verdict.being_fixed and good,
            "until_ns": verdict.until_ns,
            "components": (*self._monitors.watchdog.evaluate(t_ns), *others),
        }

    def _recorded_watchdog(self, info: WatchdogInfo) -> Dict[str, Any]:
        mission = self._plan.mission
        rows = tuple(_component_row(c, tolerated=c.name in mission.tolerated) for c in info.components)
        needed = mission.required or tuple(component.name for component in info.components)
        ok = all(row.passed for row in rows if row.name in needed)
        return {"ok": ok, "checks": rows, "components": info.components}

    def on_ground(self, t_ns: int, _: RunCheck) -> Optional[Dict[str, Any]]:
        """Return what the recorded landing detection or range finder tells; without both, the vehicle itself."""
        if self.recorded_landed is not None:
            said = self.recorded_landed
            good = said.landed is Landed.ON_GROUND
            verdict = Verdict.PASS if good else Verdict.FAIL
            rows: Tuple[Check, ...] = (
                Check("distance to ground", verdict, said.distance_m, None, "m", None, said.reason),
            )
            return {"ok": good, "checks": rows}
        checks, landed = self._monitors.check_ground(t_ns), self._landed(t_ns)
        if checks is None and landed is not None:
            verdict = Verdict.PASS if landed is VehicleLanded.ON_GROUND else Verdict.FAIL
            checks = (Check("landed state", verdict, advice=f"the recorded vehicle says {landed.name}"),)
        return None if checks is None else {"ok": all(row.passed for row in checks), "checks": checks}


RECORDED: Mapping[CheckName, Recorded] = {
    **{name: Recorded(name.value.replace("_", " ")) for name in CheckName},  # no recording tells
    CheckName.WATCHDOG: Recorded("watchdog", (), Answers.watchdog),
    CheckName.BATTERY: Recorded("battery fraction", ("battery",), Answers.battery),
    CheckName.ON_GROUND: Recorded("distance to ground", ("range",), Answers.on_ground),
    CheckName.STATE_ESTIMATION: Recorded("tilt", ("imu", "estimate"), Answers.state_estimation),
}


def _of_cells(row: Check, voltage_v: Optional[float], spec: BatterySpec) -> Check:
    """Return a row; one of a voltage that is wrong with the configured cells says with how many it would be right."""
    if row.passed or row.name != CELL_VOLTAGE or voltage_v is None:
        return row
    cells = [n for n in range(1, 25) if spec.cell_voltage_min_v <= voltage_v / n <= spec.cell_voltage_max_v]
    if not cells:
        return row
    words = f"as {voltage_v:.1f} V of {' or '.join(map(str, cells))} cells it would be right"
    return replace(row, advice=f"{row.advice}; {words} (--set sensors.battery.cells={cells[0]})")


def _component_row(status: ComponentStatus, *, tolerated: bool) -> Check:
    verdict = Verdict.PASS if status.code is Code.NOMINAL else Verdict.FAIL
    if status.code is Code.NON_CRITICAL and tolerated:
        verdict = Verdict.WARN
    return Check(status.name, verdict, float(status.code), float(Code.NOMINAL), "code", None, status.reason)


def _unseen_row(name: str, missing: Tuple[str, ...]) -> Check:
    """Return the row of a required component that was not recorded: a warning, as nobody knows how it was."""
    return Check(name, Verdict.WARN, advice=f"it is required, and {recorded_words(missing)}")


def _explained(found: Dict[str, Any]) -> Dict[str, Any]:
    """Add the reason in words: what the rows that did not pass advise."""
    bad = [row for row in found["checks"] if not row.passed]
    return {**found, "message": "; ".join(f"{row.name}: {row.advice}" if row.advice else row.name for row in bad)}


# --- follower ---------------------------------------------------------------------------------------------------------
# Follows the rows of the check of the states through a recording: when each begins and ceases to pass.
#
# The check is made before takeoff; a replay looks at it all the time. Shaking and turning are asked of a vehicle that
# stands still and say nothing of one that is carried or flies, so they are left to the check itself. What fails in
# flight is noted, and is no error: a vehicle tilts to fly.


_FOLLOWED = (
    "IMU age",
    "gravity magnitude",
    "tilt",
    "estimate age",
    "estimate rate",
    "estimated tilt",
    "tilt agreement",
)
_ON_GROUND_ONLY = ("gravity magnitude",)
_STANDS = 3  # looks in a row, so that a row at its limit does not fill the timeline


class Note(NamedTuple):
    """One line: text, and level as in `timeline.Line`."""

    text: str
    level: int


class _Row:
    """One row over time."""

    def __init__(self) -> None:
        self.passed: Optional[bool] = None
        self.looks = 0
        self.worst: Optional[Check] = None


class Follower:
    """Remembers each row."""

    def __init__(self) -> None:
        self._rows: Dict[str, _Row] = {}
        self._seen: Tuple[str, ...] = ()

    @property
    def settled(self) -> bool:
        """True when every row passes, and nothing speaks against any of them: one that passes again changes nothing."""
        rows = self._rows
        return all(name in rows and rows[name].passed is True and not rows[name].looks for name in self._seen)

    def take(self, rows: Sequence[Check], *, in_flight: bool) -> List[Note]:
        """Take the rows as they are now; return what has changed and stood for some looks."""
        notes: List[Note] = []
        self._seen = tuple(row.name for row in rows if row.name in _FOLLOWED)
        for row in rows:
            if row.name in _FOLLOWED and not (in_flight and row.name in _ON_GROUND_ONLY):
                note = self._follow(self._rows.setdefault(row.name, _Row()), row)
                if note is not None:
                    notes.append(note._replace(level=0) if in_flight else note)
        return notes

    def _follow(self, known: _Row, row: Check) -> Optional[Note]:
        if not row.passed and row.value is not None and (known.worst is None or _off(row) > _off(known.worst)):
            known.worst = row
        if row.passed is known.passed:
            known.looks = 0
            return None
        known.looks += 1
        if known.looks < _STANDS and known.passed is not None:
            return None
        known.passed, known.looks = row.passed, 0
        worst, known.worst = known.worst, None if row.passed else row
        if not row.passed:
            return Note(f"state check: {row_text(row)}", 1 if row.verdict is Verdict.UNKNOWN else 2)
        furthest = f", furthest off {_value(worst, worst.value)}" if worst is not None else ""
        return Note(f"state check: {row_text(row)}, passes{furthest}", 0)


def _off(row: Check) -> float:
    return abs((row.value or 0.0) - (row.limit or 0.0))


def row_text(row: Check) -> str:
    """Return a row of a check as one line; angles in degrees."""
    limits = limit_words(row, lambda each: _value(row, each))
    advice = f" ({row.advice})" if row.advice and not row.passed else ""
    return f"{row.name} {_value(row, row.value)}{f', limit {limits}' if limits else ''}{advice}"


def _value(row: Check, value: Optional[float]) -> str:
    if value is None:
        return "unknown"
    if row.unit == "rad":
        return f"{degrees(value):.1f} deg"
    return f"{value:.3g} {row.unit}".rstrip()
