"""Lines of the timeline: as they are written, joined and marked; rows of the state check as they are followed."""

from __future__ import annotations

from math import radians

from amaze_autonomy.engine.commands import Decision, Value
from amaze_autonomy.engine.events import Check, Verdict
from amaze_autonomy.monitoring.specs import StateEstimationSpec
from amaze_autonomy.monitoring.state_estimation import Estimate, StateEstimationMonitor
from amaze_autonomy.replay.peers.answers import _FOLLOWED, Follower
from amaze_autonomy.replay.timeline import Line, LineKind, Source, decision_text, joined, marked, written

S = 1_000_000_000


def line(t_s, text="something"):
    return Line(round(t_s * S), Source.BAG, LineKind.MONITOR, text)


def test_a_decision_is_one_line_with_states_rule_values_and_commands():
    decision = Decision(
        t_ns=5 * S,
        sequence=3,
        event="Tick",
        before="MISSION",
        after="LAND",
        step="commanding",
        rule="land",
        values=(Value("age", 0.6123456789, 0.6, "s"), Value("action", "land"), Value("wait ends", 7 * S, None, "ns")),
        commands=("MissionCommand(LAND)#12",),
    )
    assert decision_text(decision, 2 * S) == (
        "MISSION -> LAND/commanding  by land (age 0.612346 s, limit 0.6 s; action land; wait ends at +5.000 s)"
        "  => MissionCommand(LAND)#12"
    )


def test_sources_are_named_in_one_order():
    assert [(Source.SCRIPT | Source.BAG).words, Source.LOG.words, Source.SCRIPT.words] == [
        "bag+script",
        "log",
        "script",
    ]


def test_equal_lines_in_a_row_become_one():
    (first, second) = joined([line(1), line(1.5), line(2), line(3, "other")])
    assert written(first, 0) == ("    +1.000", "bag", "something  [3 times until +2.000]")
    assert written(second, 0) == ("    +3.000", "bag", "other")


def test_lines_after_the_first_missed_command_are_marked():
    lines = marked([line(1), line(2), line(3)], 2 * S)
    assert [written(each, 0)[0] for each in lines] == ["    +1.000", "    +2.000", "~   +3.000"]
    assert marked([line(1)], None) == [line(1)]


def tilt(degrees_):
    verdict = Verdict.PASS if degrees_ <= 10 else Verdict.FAIL
    return (Check("tilt", verdict, radians(degrees_), radians(10.0), "rad", None, "" if degrees_ <= 10 else "tilted"),)


def notes(follower, *angles, in_flight=False):
    return [note.text for angle in angles for note in follower.take(tilt(angle), in_flight=in_flight)]


def test_a_row_that_begins_to_fail_is_noted_once_it_has_stood():
    follower = Follower()
    assert notes(follower, 1) == ["state check: tilt 1.0 deg, limit 10.0 deg, passes"]
    assert notes(follower, 20, 2, 20, 20) == []
    assert notes(follower, 25) == ["state check: tilt 25.0 deg, limit 10.0 deg (tilted)"]
    assert notes(follower, 41, 30, 5, 5) == []
    assert notes(follower, 4) == ["state check: tilt 4.0 deg, limit 10.0 deg, passes, furthest off 41.0 deg"]


def test_what_fails_in_flight_is_noted_and_is_no_error_the_check_is_one_before_takeoff():
    follower = Follower()
    levels = [note.level for angle in (1, 20, 20, 20) for note in follower.take(tilt(angle), in_flight=True)]
    assert levels == [0, 0]
    on_ground = Follower()
    levels = [note.level for angle in (1, 20, 20, 20) for note in on_ground.take(tilt(angle), in_flight=False)]
    assert levels == [0, 2]


def test_each_row_that_is_followed_is_one_of_the_check():
    monitor = StateEstimationMonitor(StateEstimationSpec(topic="/odometry", imu_topic="/imu"))
    monitor.add_estimate(0, Estimate((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), None, None, None))
    assert set(_FOLLOWED) <= {row.name for row in monitor.in_motion(0)}


def test_rows_that_are_asked_of_a_vehicle_at_rest_are_not_followed():
    shaking = Check("shaking", Verdict.FAIL, 3.0, 0.5, "m/s^2")
    magnitude = Check("gravity magnitude", Verdict.FAIL, 12.0, 10.3, "m/s^2")
    follower = Follower()
    assert follower.take((shaking,), in_flight=False) == []
    assert follower.take((magnitude,), in_flight=True) == []
    assert len(follower.take((magnitude,), in_flight=False)) == 1
