"""What goes out as a message comes in as the same event; what cannot be is refused by the name of its field."""

from __future__ import annotations

import re
from dataclasses import replace
from math import isnan, nan

import pytest

pytest.importorskip("rospy")

from amaze_autonomy import msg, srv
from amaze_autonomy.engine import events
from amaze_autonomy.engine.commands import Level, Notify
from amaze_autonomy.engine.events import Check, CheckName, ComponentStatus, Outcome, Verdict
from amaze_autonomy.engine.rules import Action, Code, Restart, Rules
from amaze_autonomy.engine.state import EngineState, Failure, FailureKind
from amaze_autonomy.interface import CHECK_SERVICES, STATUSES, InvalidMessageError
from amaze_autonomy.journal.report import report
from amaze_autonomy.nodes.autonomy.outbox import state_message
from amaze_autonomy.ros.interface import read_status, response_of, status_message

T, ROS, AGE = 7_000_000_000, 1_700_000_000_000_000_000, 30_000_000
LRF = ComponentStatus(name="lrf", code=Code.HOLD, restart=Restart.TRYING, until_ns=T + 2_000_000_000, reason="silent")
GPS = ComponentStatus(name="gps", code=Code.NON_CRITICAL, restart=Restart.GIVEN_UP)

EVENTS = (
    events.WatchdogAction(
        t_ns=T, sequence=3, loop_counter=9, code=Code.HOLD, latest_component="lrf", components=(LRF,), age_ns=0
    ),
    events.WatchdogInfo(t_ns=T, sequence=4, changed=("gps",), components=(GPS, LRF), age_ns=0),
    events.MissionStatus(
        t_ns=T,
        session_id="s-1",
        mission_id="1",
        phase=events.MissionPhase.FLYING,
        waypoint=2,
        waypoints=5,
        file_index=1,
        repetition=2,
        distance_left_m=12.5,
        time_left_s=None,
        message="on its way",
        age_ns=AGE,
    ),
    events.RecordingStatus(
        t_ns=T,
        session_id="s-1",
        phase=events.RecordingPhase.MERGING,
        progress=0.25,
        platforms=(
            events.PlatformRecording(
                platform="main", growing=True, written_bytes=10, byte_rate=2.0, free_fraction=None, location="here"
            ),
            events.PlatformRecording(
                platform="second", growing=False, free_fraction=0.5, cpu_fraction=0.25, clock_age_s=-1.5
            ),
        ),
        location="there",
        message="",
        age_ns=AGE,
    ),
    events.AutopilotStatus(
        t_ns=T,
        armed=True,
        landed=events.VehicleLanded.IN_AIR,
        mode="AUTO.MISSION",
        link_age_s=0.1,
        height_m=2.0,
        position_x_m=1.0,
        position_y_m=-1.0,
        vertical_speed_m_s=0.5,
        battery_fraction=0.75,
        battery_voltage_v=15.5,
        battery_age_s=0.5,
        battery_critical=True,
        gps_fix="RTK float",
        satellites=17.0,
        age_ns=AGE,
    ),
    events.AutopilotStatus(t_ns=T, armed=None, landed=events.VehicleLanded.UNKNOWN, link_age_s=None, age_ns=AGE),
    events.LandedStatus(t_ns=T, landed=events.Landed.AIRBORNE, distance_m=1.5, reason="far", age_ns=AGE),
    events.LandedStatus(t_ns=T, landed=events.Landed.UNKNOWN, distance_m=None, age_ns=AGE),
)
BY_MESSAGE = {status.shape.message: status for status in STATUSES}


def read(message, t_ns=T, ros_ns=ROS):
    return read_status(BY_MESSAGE[type(message).__name__], message, t_ns, ros_ns)


@pytest.mark.parametrize("event", EVENTS, ids=lambda event: type(event).__name__)
def test_an_event_survives_the_wire(event):
    assert read(status_message(event, ROS)) == event


def test_positions_name_the_frame_that_they_are_in():
    frames = {type(event).__name__: status_message(event, ROS).header.frame_id for event in EVENTS}
    assert frames == {**dict.fromkeys(frames, ""), "AutopilotStatus": "takeoff_enu"}


def _has_position(kind):
    own = any(re.search(r"position_[xyz]$", name) for name in kind.__slots__)
    inner = [getattr(msg, name.split("/")[-1].rstrip("[]"), None) for name in kind._slot_types]
    return own or any(map(_has_position, filter(None, inner)))


def test_every_message_of_ours_that_has_positions_names_their_frame():
    kinds = {name: kind for name, kind in vars(msg).items() if "header" in getattr(kind, "__slots__", ())}
    placed = {name for name, kind in kinds.items() if _has_position(kind)}
    written = [status_message(event, ROS) for event in EVENTS] + [state_message(report(EngineState(), Rules()), T, ROS)]
    frames = {type(each).__name__: each.header.frame_id for each in written}
    assert placed == {"AutopilotStatus", "AutonomyState"}
    assert {name: frames[name] for name in placed} == dict.fromkeys(placed, "takeoff_enu")


def test_the_age_is_what_the_stamp_says_on_arrival():
    message = status_message(EVENTS[-1], ROS)
    assert read(message, T, ROS + 1_000).age_ns == AGE + 1_000
    assert read(message, T, ROS - 40_000_000).age_ns == -10_000_000


def test_a_message_without_a_stamp_is_as_old_as_ros_time():
    assert read(msg.Landed(landed=1)).age_ns == ROS


def test_until_counts_from_the_stamp_of_the_message():
    event = replace(EVENTS[0], age_ns=0)
    message = status_message(event, ROS)
    late = read(message, T + AGE, ROS + AGE)
    assert late.components[0].until_ns == LRF.until_ns


@pytest.mark.parametrize("value", [nan, float("inf"), -float("inf"), 1e300])
def test_an_until_that_is_no_time_is_none(value):
    bad = msg.WatchdogAction(code=8, components=[msg.ComponentState(name="lrf", code=8, until=value)])
    assert read(bad).components[0].until_ns is None


def test_what_the_flags_call_invalid_is_unknown():
    message = msg.AutopilotStatus(armed=True, height=3.0, position_x=1.0, position_y=1.0, battery_fraction=-1.0)
    event = read(message)
    assert (event.armed, event.height_m, event.position_x_m, event.position_y_m) == (None, None, None, None)
    assert event.battery_fraction is None


BAD = (
    (msg.WatchdogAction(code=3), "code is 3, must be one of 1, 2, 4, 8, 16"),
    (
        msg.WatchdogAction(code=4, components=[msg.ComponentState(name="", code=4)]),
        "components.name is '', must be the name of a component",
    ),
    (
        msg.WatchdogInfo(components=[msg.ComponentState(name="lrf", code=4, restart=9)]),
        "components.restart is 9, must be one of 0, 1, 2",
    ),
    (msg.MissionStatus(phase=8), "phase is 8, must be one of 0, 1, 2, 3, 4, 5, 6, 7"),
    (msg.RecordingStatus(phase=10), "phase is 10, must be"),
    (msg.AutopilotStatus(landed=5), "landed is 5, must be one of 0, 1, 2, 3, 4"),
    (msg.Landed(landed=3), "landed is 3, must be one of 0, 1, 2"),
)


@pytest.mark.parametrize("message, words", BAD)
def test_what_cannot_be_is_refused_by_the_name_of_its_field(message, words):
    with pytest.raises(InvalidMessageError) as refused:
        read(message)
    assert str(refused.value).startswith(words)


ROWS = (
    Check("level", Verdict.PASS, 0.75, 0.5, "fraction", 0.25),
    Check("cells", Verdict.WARN, 3.5, 3.25, "V", None, "charge it", other_limit=4.25),
    Check("age", Verdict.UNKNOWN, advice="wait"),
    Check("tilt", Verdict.FAIL, 0.5, 0.25, "rad", 0.0, "level it"),
    Check("distance", Verdict.PASS, 0.125, 0.25, "m"),
)
COMPONENTS = {"fixable": True, "being_fixed": True, "until_ns": T + 5_000_000_000, "components": (LRF, GPS)}


@pytest.mark.parametrize("check", list(CheckName))
def test_the_answer_of_a_check_survives_the_wire(check):
    more = {**COMPONENTS, "message": "wait for it"} if check is CheckName.WATCHDOG else {}
    reply = events.CheckReply(t_ns=T, command_id=5, check=check, outcome=Outcome.ACCEPTED, ok=True, checks=ROWS, **more)
    service = CHECK_SERVICES[check]
    assert service.reply(response_of(service, reply, T), 5, T) == reply


def test_numbers_of_an_answer_are_found_by_their_unit():
    reply = events.CheckReply(t_ns=T, command_id=5, check=CheckName.BATTERY, outcome=Outcome.ACCEPTED, checks=ROWS)
    battery = response_of(CHECK_SERVICES[CheckName.BATTERY], reply, T)
    assert (battery.fraction, battery.voltage) == (0.75, 3.5)
    tilt = response_of(CHECK_SERVICES[CheckName.STATE_ESTIMATION], reply, T)
    assert tilt.tilt == 0.5
    assert isnan(tilt.gravity.z)


def test_a_verdict_that_does_not_exist_is_refused():
    with pytest.raises(InvalidMessageError, match=r"checks\.verdict is 0, must be one of 1, 2, 3, 4"):
        CHECK_SERVICES[CheckName.AUTOPILOT].reply(srv.CheckAutopilotResponse(checks=[msg.Check(name="x")]), 5, T)


def test_the_report_becomes_a_message():
    failure = Failure("lrf", FailureKind.COMPONENT, 8, Action.WAIT, Action.LAND, T, T + 3_000_000_000, "silent")
    state = EngineState(failures=(failure,), shown=Notify(level=Level.INFO, key="", text="hello"))
    message = state_message(report(state, Rules()), T + 1_000_000_000, ROS)
    assert (message.state, message.message, message.message_level) == ("MISSION_INPUT", "hello", 0)
    assert message.header.stamp.to_nsec() == ROS
    assert isnan(message.time_left)
    assert isnan(message.recording_progress)
    [shown] = message.failures
    assert (shown.name, shown.code, shown.action, shown.fallback, shown.time_left) == ("lrf", 8, "wait", "land", 2.0)
