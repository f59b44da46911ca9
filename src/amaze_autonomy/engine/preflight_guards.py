"""The conditions before a takeoff: checks, the watchdog's fixes, Ready taken back, the planner's confirmation."""

from __future__ import annotations

from typing import Optional, Tuple

from .absorb import lacking
from .checks import CHECKS, CheckName
from .commands import Seen, Value, because
from .events import MissionPhase, Outcome
from .failures import clocks_words
from .fitness import unfit
from .guards import both, holds_if, timer
from .state import CheckRecord, ClockApart
from .timers import passed
from .turn import Turn

__all__ = [
    "all_answered",
    "all_answered_values",
    "all_checks_passed",
    "answers_too_old",
    "check_failed",
    "checks_failed",
    "fix_in_progress",
    "go_not_required",
    "next_takeoff_failed",
    "planner_confirmed",
    "planner_refused",
    "taken_back",
    "too_many_rounds",
]

_NS = 1e9
_REFUSED = (Outcome.REFUSED, Outcome.UNAVAILABLE)


def all_checks_passed(turn: Turn) -> Optional[Seen]:
    """Every check has answered and passed, and no answer is too old."""
    records = turn.state.checks
    if _clocks_apart(turn):
        return None
    if len(records) < len(CheckName) or not all(record.ok for record in records):
        return None
    ages = [turn.now - record.replied_ns for record in records if record.replied_ns is not None]
    oldest, limit = max(ages), turn.limits.check_max_age_ns
    return holds_if(
        len(ages) == len(CheckName) and oldest <= limit, Value("oldest check", oldest / _NS, limit / _NS, "s")
    )


def _failed(turn: Turn) -> Optional[Seen]:
    failed = [(r.check.value, r.message or "failed") for r in turn.state.checks if r.outcome and not r.ok]
    clocks = [("clocks", clocks_words(turn, apart.peer)) for apart in _clocks_apart(turn)]
    found = (*failed, *clocks)
    values = tuple(Value(f"check {name}", why) for name, why in found)
    return holds_if(found, *values, reason="; ".join(f"{name}: {why}" for name, why in found))


def _clocks_apart(turn: Turn) -> Tuple[ClockApart, ...]:
    """Return the peers whose stamps have been too far from the present for longer than a status lasts."""
    limit_ns = turn.limits.status_max_age_ns
    return tuple(apart for apart in turn.state.clocks_apart if turn.now - apart.since_ns >= limit_ns)


def all_answered(turn: Turn) -> bool:
    """Return True when no check is open."""
    return bool(turn.state.checks) and all(record.outcome is not None for record in turn.state.checks)


def all_answered_values(turn: Turn) -> Optional[Seen]:
    """No check is open."""
    return holds_if(all_answered(turn))


def answers_too_old(turn: Turn) -> Optional[Seen]:
    """All have answered and passed, but the first answers are too old by now."""
    fresh = all_checks_passed(turn) is not None
    passed_once = all_answered(turn) and all(record.ok for record in turn.state.checks)
    return holds_if(passed_once and not fresh, Value("checks", "too old"))


def check_failed(turn: Turn) -> Optional[Seen]:
    """One of the checks has answered that it failed."""
    return _failed(turn)


def _comes(turn: Turn, record: CheckRecord) -> bool:
    """Return True when a check that failed can pass soon: it is being fixed, or what it waits for comes by itself."""
    if CHECKS[record.check].watches and (record.fixable or record.being_fixed):
        return True
    if record.outcome is Outcome.UNAVAILABLE:  # its node may still be starting, like this one
        return turn.now - (turn.state.started_ns or 0) < turn.limits.watchdog_startup_time_ns
    bad = [row for row in record.rows if not row.passed]
    return bool(bad) and all(row.heals for row in bad)


def _being_fixed(turn: Turn) -> bool:
    """Return True when all that failed can pass soon; clocks are set by their daemons."""
    bad = [record for record in turn.state.checks if not record.ok]
    return (bool(bad) or bool(_clocks_apart(turn))) and all(_comes(turn, record) for record in bad)


def checks_failed(turn: Turn) -> Optional[Seen]:
    """All checks have answered, one has failed, and it neither is fixed nor comes by itself, or not in time."""
    if not all_answered(turn) or not _failed(turn):
        return None
    if _being_fixed(turn) and not passed("preflight_fix_limit", turn.state, turn.rules, turn.now):
        return None
    return _failed(turn)


def fix_in_progress(turn: Turn) -> Optional[Seen]:
    """What failed is being fixed or comes by itself, and it is time to ask again."""
    if not all_answered(turn) or not _failed(turn) or not _being_fixed(turn):
        return None
    return _failed(turn) if passed("preflight_fix_poll", turn.state, turn.rules, turn.now) else None


def too_many_rounds(turn: Turn) -> Optional[Seen]:
    """The checks were passed and taken back too often without a word of the user."""
    rounds, limit = turn.state.rounds, turn.limits.preflight_rounds_limit
    return holds_if(rounds > limit, Value("rounds of checks", rounds, limit))


def taken_back(turn: Turn) -> Optional[Seen]:
    """A required component is not at code 1 (nor tolerated at code 2), or the watchdog is silent."""
    status = lacking(turn.state.mission, turn.state.components)
    if status is not None:
        values = (Value("component", status.name), Value("code", int(status.code), 1), Value("reason", status.reason))
        return Seen(values, status.reason)
    if not passed("watchdog_heartbeat_limit", turn.state, turn.rules, turn.now):
        return None
    limit = Value("limit", turn.limits.watchdog_heartbeat_limit_ns / _NS, None, "s")
    return because("reason", "the watchdog's heartbeat is lost", limit)


def go_not_required(turn: Turn) -> Optional[Seen]:
    """The configuration does not ask for the operator's go."""
    return holds_if(not turn.rules.require_go, Value("require_go", False))


def planner_confirmed(turn: Turn) -> Optional[Seen]:
    """The planner has accepted this file of this mission, and says so in its status."""
    state, planner = turn.state, turn.state.planner
    if planner is None or state.mission is None or state.load_outcome is not Outcome.ACCEPTED:
        return None
    same = (planner.mission_id, planner.file_index, planner.repetition) == (
        state.mission.id,
        state.file_index,
        state.repetition,
    )
    return holds_if(same and planner.phase is MissionPhase.LOADED, Value("planner phase", "LOADED"))


def planner_refused(turn: Turn) -> Optional[Seen]:
    """The planner did not accept the mission."""
    refused = turn.state.load_outcome in _REFUSED
    return because("planner", turn.state.load_message or "refused") if refused else None


def next_takeoff_failed(turn: Turn) -> Optional[Seen]:
    """On the ground between two files: whatever forbids a takeoff forbids the next one."""
    for guard in (
        check_failed,
        taken_back,
        planner_refused,
        both(planner_confirmed, timer("load_limit"), unfit),
        timer("load_limit"),
        both(all_answered_values, timer("check_max_age")),
    ):
        seen = guard(turn)
        if seen is not None:
            return seen
    return None
