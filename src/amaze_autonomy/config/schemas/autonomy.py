"""Schema of autonomy.yaml: the rows of `engine.rules.Limits`, in their groups, and the rates of the status streams."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Dict, Tuple

from amaze_autonomy.engine.rules import LimitRow, Limits, Rules

from ...engine.events import CheckName
from ..kinds import Flag, Kind, Number, Whole
from ..schema import Group, Key, Named, Row, bind, group_of


@dataclass(frozen=True)
class Streams:
    """How often each peer sends its status; the limits of the failsafe conditions are measured against it.

    Args:
        watchdog_action_rate_hz: heartbeat of the watchdog.
        planner_status_rate_hz: of the mission planner.
        autopilot_status_rate_hz: of the autopilot node.
        landing_detection_rate_hz: of the landing detection.
        recorder_status_rate_hz: of the data recorder.
    """

    watchdog_action_rate_hz: float = 5.0
    planner_status_rate_hz: float = 5.0
    autopilot_status_rate_hz: float = 5.0
    landing_detection_rate_hz: float = 5.0
    recorder_status_rate_hz: float = 2.0


_UNITS = ("_ns", "_m", "_m_s", "_deg", "_fraction")


def _kind(name: str, row: LimitRow) -> Kind:
    if not name.endswith(_UNITS):
        return Whole(1, int(row.most))
    if name.endswith("_fraction"):
        return Number(above=0.0, below=1.0)
    return Number(minimum=row.least, maximum=row.most) if row.least else Number(above=0.0, maximum=row.most)


_CHECKS = tuple(check.value for check in CheckName)
_REPLIES = Key(
    "reply_limits_s",
    Named(f"checks {', '.join(_CHECKS)}", "|".join(_CHECKS), Number(above=0.0, maximum=60.0)),
    "checks with a time of their own in the place of check_reply_limit_s",
    "a supervisor that looks at its estimate for 10 s is no reason to wait as long for a battery",
    {},
)
_AGES = Key(
    "max_ages_s",
    Named(f"checks {', '.join(_CHECKS)}", "|".join(_CHECKS), Number(above=0.0, maximum=60.0)),
    "checks with an age of their own in the place of check_max_age_s",
    "a battery changes slowly, a vehicle on the ground can be lifted",
    {},
)
_OWN = {"check_reply_limit_ns": (_REPLIES,), "check_max_age_ns": (_AGES,)}


def _limit_groups() -> Dict[str, Group]:
    """Return the groups of limits, in the order of the engine's rows."""
    found: Dict[str, Group] = {}
    for entry in fields(Limits):
        row: LimitRow = entry.metadata["row"]
        key = bind(Limits, entry.name, _kind(entry.name, row), row.words, row.reason)
        keys = found[row.group].keys if row.group in found else ()
        found[row.group] = Group(row.about, (*keys, key, *_OWN.get(entry.name, ())))
    return found


_RATE = Number(minimum=0.5, maximum=50.0)
# fmt: off
_STREAM_ROWS: Tuple[Row, ...] = (
    ("watchdog_action_rate_hz", _RATE, "heartbeat of the watchdog", "its loss is seen within its limit"),
    ("planner_status_rate_hz", _RATE, "status of the mission planner", ""),
    ("autopilot_status_rate_hz", _RATE, "status of the autopilot node", ""),
    ("landing_detection_rate_hz", _RATE, "judgement of the landing detection", ""),
    ("recorder_status_rate_hz", _RATE, "status of the data recorder", ""),
)
# fmt: on


_STATUS = "how often each peer sends its status"

AUTONOMY = Group(
    "the engine",
    (
        bind(
            Rules, "require_go", Flag(), "Ready waits for the operator's go", "off: it takes off as soon as it is ready"
        ),
        *(Key(name, group, group.said, "", {}) for name, group in _limit_groups().items()),
        Key("streams", group_of(Streams, _STATUS, _STREAM_ROWS), _STATUS, "", {}),
    ),
)
