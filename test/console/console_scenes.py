"""Scenes of a flight day as the console's desk holds them: every state of the engine, and what can go wrong beside."""

from __future__ import annotations

from dataclasses import replace
from typing import Dict

from amaze_autonomy.console.model import (
    Answer,
    Collecting,
    Desk,
    MissionRow,
    Note,
    PendingFailure,
    Platform,
    Question,
    Request,
    RequestKind,
    Snapshot,
    Telemetry,
    Verdict,
)
from amaze_autonomy.engine.events import Check, UserCommand
from amaze_autonomy.engine.events import Verdict as CheckVerdict
from amaze_autonomy.engine.state import State
from amaze_autonomy.journal.report import WAITS

NOW_S = 1000.0

MISSIONS = (
    MissionRow("1", "Short square, less than a minute", 1, 1, 41.6, 0.3),
    MissionRow("2", "Survey of 20 m x 10 m", 2, 3, 412.0, 0.71),
    MissionRow(
        "wall", "Along the north wall", 1, 1, None, None, "wall.csv line 7: z is -1.5 m, must be at least 0.5 m"
    ),
)

CHECKS = (
    Check("watchdog: gps", CheckVerdict.PASS, 5.0, 3.5, "Hz", 0.19, other_limit=6.5),
    Check("watchdog: mission_camera", CheckVerdict.PASS, 10.0, 8.0, "Hz", 0.06, other_limit=12.0),
    Check(
        "watchdog: realsense_camera",
        CheckVerdict.WARN,
        7.2,
        8.0,
        "Hz",
        0.05,
        "tolerated by this mission",
        other_limit=12.0,
    ),
    Check("watchdog: lrf", CheckVerdict.PASS, 20.0, 16.0, "Hz", 0.03, other_limit=24.0),
    Check(
        "battery fraction",
        CheckVerdict.FAIL,
        0.25,
        0.3,
        "fraction",
        0.07,
        "25% is left, no mission starts below 30%: change or charge the battery",
    ),
    Check("on ground: distance to ground", CheckVerdict.PASS, 0.002, 0.1, "m", 0.1),
    Check("state estimation", CheckVerdict.UNKNOWN, advice="asked, no answer yet"),
)

PASSED = (
    *CHECKS[:2],
    Check("watchdog: realsense_camera", CheckVerdict.PASS, 10.0, 8.0, "Hz", 0.05, other_limit=12.0),
    CHECKS[3],
    Check("battery fraction", CheckVerdict.PASS, 0.9984, 0.3, "fraction", 0.07),
    CHECKS[5],
    Check("state estimation: tilt", CheckVerdict.PASS, 0.009, 0.1745, "rad", 0.01),
    Check("computers: main CPU load", CheckVerdict.PASS, 0.42, None, "fraction"),
    Check("computers: main free storage", CheckVerdict.PASS, 0.61, 0.05, "fraction"),
)

LRF = PendingFailure(
    "lrf", 8, "wait", "land", 8.1, "restart limit", "", "no message on /lrf/range for longer than 0.3 s"
)
REALSENSE = PendingFailure(
    "realsense_camera", 4, "wait", "continue", 21.0, "wait limit", "", "node /realsense: connection refused"
)
GPS = PendingFailure("gps", 2, "continue", "", None, "", "", "3.1 Hz, expected 5 Hz")
CAMERA = PendingFailure(
    "mission_camera", 16, "land", "", None, "", "", "no message on /camera/image for longer than 0.3 s"
)

_NOTES = (
    Note("10:14:31", 0, "Pre-flight checks of mission 1 are running."),
    Note("10:14:36", 0, "Ready."),
    Note("10:14:40", 0, "Takeoff."),
    Note("10:15:02", 1, "Flying on: gps fault (3.1 Hz, expected 5 Hz)."),
)

TELEMETRY = Telemetry(
    age=0.1,
    link_age=0.05,
    mode="AUTO.MISSION",
    armed=True,
    armed_known=True,
    landed="IN_AIR",
    gps="nominal",
    gps_fix="3D",
    satellites=12.0,
    battery_fraction=0.72,
    battery_limit=0.15,
    battery_voltage=15.6,
    altitude=5.02,
    altitude_limit=30.0,
    position_x=4.0,
    position_y=2.6,
    distance=4.8,
    distance_limit=100.0,
    speed=1.0,
    climb=0.0,
    flight_time=83.0,
    flight_time_limit=900.0,
)

_CLIMBS = replace(
    TELEMETRY, mode="AUTO.TAKEOFF", altitude=1.1, position_x=0.0, position_y=0.0, distance=0.1, speed=0.0, climb=0.7
)
_HOVERS = replace(TELEMETRY, mode="AUTO.LOITER", speed=0.0)
_SINKS = replace(TELEMETRY, mode="AUTO.LAND", speed=0.0, climb=-0.7)
_BY_HAND = replace(TELEMETRY, mode="POSCTL", speed=0.4)
_STANDS = replace(
    _CLIMBS,
    mode="AUTO.LOITER",
    armed=False,
    landed="ON_GROUND",
    battery_fraction=0.9984,
    altitude=0.0,
    distance=0.0,
    climb=0.0,
    flight_time=None,
)
_TOO_LOW, _LANDED = replace(_STANDS, battery_fraction=0.25), replace(_STANDS, battery_fraction=0.69)

_MISSION = Snapshot(
    telemetry=_STANDS,
    state="MISSION",
    session_id="20261121T101431-001",
    mission_id="1",
    mission_description=MISSIONS[0].description,
    files=1,
    repetitions=1,
)
_FLYING = replace(
    _MISSION,
    step="flying",
    in_flight=True,
    message="Takeoff altitude reached, starting the mission.",
    user_commands=("hold", "land", "abort"),
    waypoint=3,
    waypoints=8,
    recording_phase="RECORDING",
    telemetry=TELEMETRY,
)


def _desk(snapshot: Snapshot | None, **changes: object) -> Desk:
    return replace(
        Desk(started_s=NOW_S - 75.0, snapshot=snapshot, received_s=NOW_S - 0.2, missions=MISSIONS), **changes
    )


_INPUT = Snapshot(
    telemetry=_STANDS, state="MISSION_INPUT", message="Select a mission.", advice="Choose a mission from the list."
)
_HOLD = replace(
    _FLYING,
    telemetry=_HOVERS,
    state="HOLD",
    step="holding",
    failures=(GPS, REALSENSE, LRF),
    waiting_for="lrf, realsense_camera",
    time_left_s=8.1,
    limit="restart limit",
    message="Holding for up to 12 s, then landing: lrf fault, restarting it "
    "(no message on /lrf/range for longer than 0.3 s).",
    message_level=1,
    advice="Wait, or land.",
    user_commands=("hold", "land", "abort"),
)
_OUTREACH = replace(
    _MISSION,
    telemetry=_TOO_LOW,
    state="OUTREACH",
    checks=CHECKS,
    message="Pre-flight checks failed: battery: 25% is left, no mission starts below 30%.",
    waiting_for=WAITS[State.OUTREACH],
    message_level=2,
    advice="Follow the advice in the table, then retry, or give up.",
    user_commands=("retry", "give_up"),
)
_HOLD_REQUEST = Request(RequestKind.COMMAND, 7, UserCommand.HOLD, sent_s=NOW_S - 2.3)
_LAND_REQUEST = Request(RequestKind.COMMAND, command=UserCommand.LAND)

SCENES: Dict[str, Desk] = {
    "waiting-master": _desk(None, link="Waiting for the ROS master at http://uav1:11311"),
    "waiting-engine": _desk(None),
    "mission-input": _desk(_INPUT),
    "mission-input-error": _desk(
        _INPUT, entry="2 walk", error='There is no mission "walk". Did you mean wall? There are: 1, 2, wall.'
    ),
    "mission-input-confirm": _desk(
        _INPUT,
        question=Question(
            "Fly mission 1: Short square, less than a minute (42 s, battery needed 30 %)?",
            Request(RequestKind.SELECT, missions=("1",)),
            NOW_S,
            enter_is_yes=False,
        ),
    ),
    "preflight": _desk(
        replace(
            _MISSION,
            state="PREFLIGHT",
            telemetry=_TOO_LOW,
            checks=CHECKS[:5],
            waiting_for=WAITS[State.PREFLIGHT],
            time_left_s=2.6,
            message="Pre-flight checks of mission 1 are running.",
            user_commands=("abort", "give_up"),
        )
    ),
    "outreach": _desk(_OUTREACH, notes=_NOTES[:1]),
    "ready": _desk(
        replace(
            _MISSION,
            state="READY",
            checks=PASSED,
            time_left_s=52.0,
            message="Ready. Waiting for the operator's go.",
            advice="Press G to take off, U to cancel.",
            user_commands=("go", "abort", "give_up"),
        )
    ),
    "start-recording": _desk(
        replace(
            _MISSION,
            state="START_RECORDING",
            checks=PASSED,
            time_left_s=13.0,
            waiting_for=WAITS[State.START_RECORDING],
            message="Recording is starting.",
            user_commands=("abort", "give_up"),
            recording_phase="STARTING",
        )
    ),
    "load-mission": _desk(
        replace(
            _MISSION,
            state="LOAD_MISSION",
            checks=PASSED,
            time_left_s=9.0,
            waiting_for=WAITS[State.LOAD_MISSION],
            message="Mission 1 is sent to the mission planner.",
            user_commands=("abort", "give_up"),
            recording_phase="RECORDING",
        )
    ),
    "takeoff": _desk(
        replace(
            _FLYING,
            state="TAKEOFF",
            telemetry=_CLIMBS,
            step="climbing",
            time_left_s=24.0,
            waypoint=0,
            message="Takeoff.",
            user_commands=("land", "abort"),
        )
    ),
    "mission": _desk(replace(_FLYING, failures=(GPS,), time_left_s=781.0), notes=_NOTES),
    "hold": _desk(_HOLD, notes=_NOTES),
    "hold-land-asked": _desk(_HOLD, question=Question("LAND at the present position?", _LAND_REQUEST, NOW_S)),
    "land": _desk(
        replace(
            _FLYING,
            state="LAND",
            telemetry=_SINKS,
            step="commanding",
            failures=(CAMERA,),
            time_left_s=117.0,
            message="Landing: mission_camera: no message on /camera/image for longer than 0.3 s.",
            message_level=2,
            advice="Watch the vehicle; be ready to take over.",
            user_commands=(),
        ),
        notes=_NOTES,
        answer=Answer("hold", Verdict.REFUSED, "A hold never interrupts a landing.", NOW_S - 2.0),
    ),
    "alarm": _desk(
        replace(
            _FLYING,
            state="LAND",
            step="commanding",
            failures=(CAMERA,),
            time_left_s=111.0,
            message="PILOT: THE VEHICLE DOES NOT LAND. TAKE OVER.",
            message_level=3,
            advice="Take over by remote control.",
            user_commands=(),
        )
    ),
    "pilot": _desk(
        replace(
            _FLYING,
            state="PILOT",
            telemetry=_BY_HAND,
            step="",
            message="The pilot or the autopilot has control: the pilot flies (flight mode POSCTL).",
            message_level=1,
            advice="Fly and land; acknowledge when on the ground and disarmed.",
            user_commands=("acknowledge",),
        )
    ),
    "data-cleanup": _desk(
        replace(
            _MISSION,
            state="DATA_CLEANUP",
            telemetry=_LANDED,
            time_left_s=1702.0,
            message="On the ground: recording is stopped, data is collected.",
            recording_phase="TRANSFERRING",
            recording_progress=0.43,
            data_location="main:/data/20261121T101431-001",
        )
    ),
    "data-cleanup-merging": _desk(
        replace(
            _MISSION,
            state="DATA_CLEANUP",
            telemetry=_LANDED,
            time_left_s=1640.0,
            message="On the ground: recording is stopped, data is collected.",
            recording_phase="MERGING",
            recording_progress=0.31,
            data_location="main:/data/20261121T101431-001",
        ),
        collecting=Collecting(_MISSION.session_id, "MERGING", 72.6, NOW_S - 0.3),
    ),
    "data-cleanup-trouble": _desk(
        replace(
            _MISSION,
            state="DATA_CLEANUP",
            telemetry=_LANDED,
            time_left_s=1750.0,
            message="On the ground: recording is stopped, data is collected.",
            recording_phase="TRANSFERRING",
            recording_progress=0.43,
            data_location="main:/data/20261121T101431-001",
        ),
        collecting=Collecting(
            _MISSION.session_id,
            "TRANSFERRING",
            None,
            NOW_S - 0.3,
            (Platform("second", message="second: the cable is cut: tried again for 20 s"),),
        ),
    ),
    "mission-ended": _desk(
        replace(
            _MISSION,
            state="MISSION_ENDED",
            telemetry=_LANDED,
            message="Mission ended: COMPLETE. The data is at /data/20261121T101431-001.bag.",
            advice="Select the next mission.",
            recording_phase="COMPLETE",
            recording_progress=1.0,
            data_location="/data/20261121T101431-001.bag",
            result="COMPLETE",
            data_result="COMPLETE",
        ),
        entry="2",
    ),
    "mission-ended-incomplete": _desk(
        replace(
            _MISSION,
            state="MISSION_ENDED",
            telemetry=_LANDED,
            message="Mission ended: COMPLETE; its data is INCOMPLETE. The data is at main:/data/20261121T101431-001.",
            message_level=2,
            recording_phase="FAILED",
            data_location="main:/data/20261121T101431-001",
            result="COMPLETE",
            data_result="INCOMPLETE",
        )
    ),
    "stale": replace(_desk(_HOLD, requests=(_HOLD_REQUEST,)), received_s=NOW_S - 7.4),
}

ON_THE_PAGE = {
    name: desk
    for name, desk in SCENES.items()
    if desk.snapshot is not None
    and name not in ("stale", "mission-input-error")  # the engine silent; a mission typed in
}
"""Those that the operator's page shows as well."""
