"""The row "clocks" on /diagnostics: whose stamps are not of the present, by how much, and what to do about it."""

from __future__ import annotations

import pytest

pytest.importorskip("rospy")

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import DiagnosticStatusWrapper

from amaze_autonomy.engine.events import Landed, LandedStatus, MissionPhase, MissionStatus, Tick, WatchdogAction
from amaze_autonomy.engine.rules import Code, Limits
from amaze_autonomy.nodes.autonomy.outbox import PeerClocks

MS = 1_000_000


def beat(age_ms):
    return WatchdogAction(t_ns=0, sequence=1, loop_counter=1, code=Code.NOMINAL, age_ns=age_ms * MS)


def mission(age_ms):
    return MissionStatus(t_ns=0, session_id="s", mission_id="1", phase=MissionPhase.IDLE, age_ns=age_ms * MS)


def ground(age_ms):
    return LandedStatus(t_ns=0, landed=Landed.ON_GROUND, age_ns=age_ms * MS)


SILENT = {
    "watchdog": "not heard",
    "mission_planner": "not heard",
    "data_recorder": "not heard",
    "autopilot": "not heard",
    "landing_detection": "not heard",
}


def row(*events):
    """Return level, words and lines of the row after some events."""
    clocks = PeerClocks(Limits(status_max_age_ns=1000 * MS, clock_tolerance_ns=200 * MS))
    for event in events:
        clocks.see(event)
    status = clocks.write(DiagnosticStatusWrapper())
    return status.level, status.message, {each.key: each.value for each in status.values}


def test_a_peer_that_was_not_heard_is_no_fault_of_its_clock():
    good = (DiagnosticStatus.OK, "all stamps are of the present", SILENT)
    assert row() == row(Tick(t_ns=5)) == good


def test_stamps_within_their_limits_are_shown_with_them():
    assert row(beat(1000), ground(-200)) == (
        DiagnosticStatus.OK,
        "all stamps are of the present",
        {
            **SILENT,
            "watchdog": "1.000 s old on arrival, limit 1 s",
            "landing_detection": "0.200 s ahead on arrival, limit 0.2 s",
        },
    )


def test_stamps_that_are_too_old_or_of_the_future_are_named_with_advice():
    assert row(mission(1001), ground(-201)) == (
        DiagnosticStatus.ERROR,
        "stamps of landing_detection, mission_planner are not of the present:"
        " set the clocks of all computers by chrony",
        {
            **SILENT,
            "mission_planner": "1.001 s old on arrival, limit 1 s",
            "landing_detection": "0.201 s ahead on arrival, limit 0.2 s",
        },
    )


def test_the_last_status_counts():
    assert row(beat(5000), beat(3))[0] == DiagnosticStatus.OK
    assert row(beat(3), beat(5000))[0] == DiagnosticStatus.ERROR
