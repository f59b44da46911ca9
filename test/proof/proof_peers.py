"""The peers as the explorer plays them: what each says now, and the events in which it says so.

Time goes in units. Every limit is a small number of units, so that the order of any two deadlines, and whether a peer
spoke before or after one, is what is explored; how long a unit is does not matter.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Dict, NamedTuple, Tuple

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.events import Mission
from amaze_autonomy.engine.rules import Code, ComponentRule, Limits, Restart, Rules, Severity
from amaze_autonomy.engine.state import EngineState, evolve

UNIT = 1_000_000_000
NEVER = 1_000_000 * UNIT

LIMITS = Limits(
    check_reply_limit_ns=2 * UNIT,
    watchdog_startup_time_ns=UNIT,
    preflight_fix_limit_ns=2 * UNIT,
    preflight_fix_poll_ns=UNIT,
    preflight_rounds_limit=2,
    check_max_age_ns=2 * UNIT,
    ready_limit_ns=2 * UNIT,
    recording_lead_ns=UNIT,
    recording_start_limit_ns=2 * UNIT,
    load_limit_ns=2 * UNIT,
    arm_limit_ns=2 * UNIT,
    lift_off_limit_ns=2 * UNIT,
    takeoff_limit_ns=3 * UNIT,
    cancel_limit_ns=2 * UNIT,
    command_reply_limit_ns=UNIT,
    hold_confirm_limit_ns=3 * UNIT,
    resume_confirm_limit_ns=2 * UNIT,
    user_hold_limit_ns=3 * UNIT,
    unlisted_wait_limit_ns=2 * UNIT,
    land_repeat_period_ns=UNIT,
    land_second_route_after_ns=2 * UNIT,
    land_alarm_after_ns=3 * UNIT,
    land_limit_ns=4 * UNIT,
    descent_time_ns=UNIT,
    ground_disarm_after_ns=UNIT,
    ground_disarm_period_ns=UNIT,
    confirm_limit_ns=2 * UNIT,
    flight_end_confirm_ns=UNIT,
    pilot_confirm_ns=UNIT,
    hold_repeat_after_ns=2 * UNIT,
    data_cleanup_limit_ns=4 * UNIT,
    watchdog_heartbeat_limit_ns=UNIT,
    planner_status_limit_ns=UNIT,
    planner_idle_limit_ns=UNIT,
    landing_stall_limit_ns=3 * UNIT,
    vehicle_unknown_limit_ns=2 * UNIT,
    pilot_silence_limit_ns=2 * UNIT,
    autopilot_status_limit_ns=UNIT,
    autopilot_link_limit_ns=UNIT,
    position_age_limit_ns=2 * UNIT,
    recorder_status_limit_ns=UNIT,
    landing_detection_limit_ns=UNIT,
    status_max_age_ns=UNIT,
    clock_tolerance_ns=UNIT // 5,
    battery_age_limit_ns=2 * UNIT,
    max_flight_time_ns=NEVER,
)

ROWS: Dict[str, ComponentRule] = {
    "gps": ComponentRule("gps", "px4", restart=False, severity=Severity.LOW, wait_limit_ns=2 * UNIT),
    "barometer": ComponentRule("barometer", "px4", restart=False, severity=Severity.MODERATE, wait_limit_ns=2 * UNIT),
    "lrf": ComponentRule("lrf", "other", restart=True, severity=Severity.HIGH, wait_limit_ns=3 * UNIT),
    "imu": ComponentRule("imu", "px4", restart=False, severity=Severity.HIGHEST, wait_limit_ns=2 * UNIT),
}
"""One component of each row of the decision table; the others of the row are the same but for their names."""

RULES = Rules(components=tuple(ROWS.values()), limits=LIMITS)

MISSIONS: Dict[str, Mission] = {
    "one": Mission(id="one", battery_needed_fraction=0.4),
    "two": Mission(id="two", files=2, battery_needed_fraction=0.4),
    "own": Mission(
        id="own",
        files=2,
        repetitions=2,
        severities=(("gps", Severity.HIGHEST), ("lrf", Severity.LOW), ("imu", Severity.MODERATE)),
        tolerated=("barometer",),
        max_height_m=10.0,
        max_distance_m=50.0,
        max_flight_time_ns=4 * UNIT,
    ),
    "some": Mission(id="some", battery_needed_fraction=0.4, required=("imu", "lrf"), tolerated=("gps",)),
    "points": Mission(id="points", battery_needed_fraction=0.4, set_points=True),
}


def limited(rules: Rules = RULES, *, require_go: bool = False, **limits: Any) -> Rules:
    """Return the rules with other limits."""
    return replace(rules, limits=replace(rules.limits, **limits), require_go=require_go)


_L = ev.VehicleLanded
SCENES: Dict[str, Dict[str, Any]] = {
    # what a vehicle does
    "ground": {"armed": False, "landed": _L.ON_GROUND, "mode": "AUTO.LOITER"},
    "armed": {"armed": True, "landed": _L.ON_GROUND, "mode": "AUTO.TAKEOFF"},
    "lifting": {"armed": True, "landed": _L.TAKING_OFF, "mode": "AUTO.TAKEOFF", "height_m": 0.5},
    "flying": {
        "armed": True,
        "landed": _L.IN_AIR,
        "mode": "AUTO.MISSION",
        "height_m": 2.0,
        "horizontal_speed_m_s": 3.0,
    },
    "loitering": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.LOITER", "height_m": 2.0},
    "guided": {
        "armed": True,
        "landed": _L.IN_AIR,
        "mode": "OFFBOARD",
        "height_m": 2.0,
        "horizontal_speed_m_s": 3.0,
    },
    "held": {"armed": True, "landed": _L.IN_AIR, "mode": "OFFBOARD", "height_m": 2.0},
    "rising": {"armed": True, "landed": _L.IN_AIR, "mode": "OFFBOARD", "height_m": 2.0, "vertical_speed_m_s": 3.0},
    "landing": {
        "armed": True,
        "landed": _L.LANDING,
        "mode": "AUTO.LAND",
        "height_m": 1.0,
        "vertical_speed_m_s": -0.5,
    },
    "touched": {"armed": True, "landed": _L.ON_GROUND, "mode": "AUTO.LAND"},
    # what it should not do, or cannot know
    "sinking": {
        "armed": True,
        "landed": _L.IN_AIR,
        "mode": "AUTO.MISSION",
        "height_m": 2.0,
        "vertical_speed_m_s": -0.5,
    },
    "put_down": {"armed": True, "landed": _L.ON_GROUND, "mode": "AUTO.MISSION"},
    "hovering": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.LAND", "height_m": 1.0},
    "pilot": {"armed": True, "landed": _L.IN_AIR, "mode": "POSCTL", "height_m": 2.0, "pilot_in_control": True},
    "failsafe": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.RTL", "height_m": 2.0, "failsafe": True},
    "failsafe_landing": {"armed": True, "landed": _L.LANDING, "mode": "AUTO.LAND", "height_m": 1.0, "failsafe": True},
    "flagged": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": 2.0, "failsafe": True},
    "flagged_hold": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.LOITER", "height_m": 2.0, "failsafe": True},
    "foreign": {"armed": True, "landed": _L.IN_AIR, "mode": "POSCTL", "height_m": 2.0},
    "unknown": {"armed": None, "landed": _L.UNKNOWN, "mode": "", "height_m": None, "position_x_m": None},
    "armed?": {"armed": None, "landed": _L.ON_GROUND, "mode": "AUTO.LAND"},
    "landed?": {"armed": False, "landed": _L.UNKNOWN, "mode": "AUTO.LAND"},
    "armed_landed?": {"armed": True, "landed": _L.UNKNOWN, "mode": "AUTO.LAND"},
    "disarmed_flying": {"armed": False, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": 2.0},
    "link_lost": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": 2.0, "link_age_s": 9.0},
    "link_unknown": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": 2.0, "link_age_s": None},
    "too_high": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": 99.0},
    "too_far": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": 2.0, "position_x_m": 999.0},
    "too_tilted": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": 2.0, "tilt_deg": 70.1},
    "leaning": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": 2.0, "tilt_deg": 70.0},
    "far_both_ways": {
        "armed": True,
        "landed": _L.IN_AIR,
        "mode": "AUTO.MISSION",
        "height_m": 2.0,
        "position_x_m": 80.0,
        "position_y_m": -80.0,
    },
    "high_for_one": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": 15.0},
    "far_for_one": {
        "armed": True,
        "landed": _L.IN_AIR,
        "mode": "AUTO.MISSION",
        "height_m": 2.0,
        "position_x_m": 40.0,
        "position_y_m": 40.0,
    },
    # two facts in one status
    "pilot_critical": {
        "armed": True,
        "landed": _L.IN_AIR,
        "mode": "POSCTL",
        "height_m": 2.0,
        "pilot_in_control": True,
        "battery_fraction": 0.1,
    },
    "failsafe_lost": {
        "armed": True,
        "landed": _L.IN_AIR,
        "mode": "AUTO.RTL",
        "height_m": 99.0,
        "failsafe": True,
        "link_age_s": 9.0,
    },
    "high_critical": {
        "armed": True,
        "landed": _L.IN_AIR,
        "mode": "AUTO.MISSION",
        "height_m": 99.0,
        "battery_fraction": 0.1,
    },
    "height_nan": {"armed": True, "landed": _L.IN_AIR, "mode": "AUTO.MISSION", "height_m": float("nan")},
}
BATTERIES: Dict[str, Dict[str, Any]] = {
    "good": {"battery_fraction": 0.9},
    "critical": {"battery_fraction": 0.1},
    "unknown": {"battery_fraction": float("nan")},
    "negative": {"battery_fraction": -0.53},
    "aged": {"battery_fraction": 0.9, "battery_age_s": 1.0},
    "old": {"battery_fraction": 0.9, "battery_age_s": 2.5},
    "ageless": {"battery_fraction": 0.9, "battery_age_s": None},
}


UNNAMED = UNCOUNTED = "?"
_AGES = {"old": 9 * UNIT, "early": -9 * UNIT}


class Peers(NamedTuple):
    """What each peer says now.

    `silent` are those that say nothing; `loop`: the watchdog's loop stands still; `old-` and `early-` with a peer: what
    it says is from long ago, or from the future. A component of the name `UNNAMED` is a code that nobody is named with.
    A planner's phase that ends with `UNCOUNTED` comes without waypoints.
    """

    vehicle: str = "ground"
    battery: str = "good"
    detection: str = "ON_GROUND"
    planner: str = ""
    leg: Tuple[int, int] = (0, 0)
    done: bool = False
    recorder: str = ""
    components: Tuple[Tuple[str, int, str], ...] = ()
    silent: Tuple[str, ...] = ()


_BASE: Dict[str, Any] = {
    "height_m": 0.0,
    "position_x_m": 0.0,
    "position_y_m": 0.0,
    "vertical_speed_m_s": 0.0,
    "horizontal_speed_m_s": 0.0,
    "battery_voltage_v": 15.0,
    "battery_age_s": 0.0,
    "tilt_deg": 0.0,
}
_KEPT: Dict[Any, Any] = {}
"""Events that were made before: the same but for their time."""


def _vehicle(peers: Peers, state: EngineState) -> ev.Event:
    key = (peers.vehicle, peers.battery)
    if key not in _KEPT:
        said = {**_BASE, **BATTERIES[peers.battery], **SCENES[peers.vehicle]}
        _KEPT[key] = ev.AutopilotStatus(t_ns=0, **said)
    return evolve(_KEPT[key], t_ns=state.t_ns)


def _statuses(peers: Peers) -> Tuple[ev.ComponentStatus, ...]:
    if peers.components not in _KEPT:
        _KEPT[peers.components] = tuple(
            ev.ComponentStatus(name, Code(code), Restart(restart), None, f"{name} at {code}")
            for name, code, restart in peers.components
            if name != UNNAMED
        )
    found: Tuple[ev.ComponentStatus, ...] = _KEPT[peers.components]
    return found


def _action(peers: Peers, state: EngineState) -> ev.Event:
    listed = tuple(s for s in _statuses(peers) if s.code >= Code.INCONVENIENT)
    alone = (Code(code) for name, code, _ in peers.components if name == UNNAMED)
    code = max((*alone, *(s.code for s in listed)), default=Code.NOMINAL)
    counter = state.peers.action.loop_counter if state.peers.action is not None else 0
    counter += "loop" not in peers.silent or state.peers.action is None
    latest = listed[0].name if listed else ""
    return ev.WatchdogAction(
        t_ns=state.t_ns, sequence=0, loop_counter=counter, code=code, latest_component=latest, components=listed
    )


def _info(peers: Peers, state: EngineState) -> ev.Event:
    return ev.WatchdogInfo(t_ns=state.t_ns, sequence=0, changed=(), components=_statuses(peers))


def _planner(peers: Peers, state: EngineState) -> ev.Event:
    mission = state.session.mission.id if state.session.mission is not None else ""
    key = ("planner", peers.planner, peers.leg, peers.done, state.session.id, mission)
    if key not in _KEPT:
        said: Dict[str, Any] = {"session_id": state.session.id, "mission_id": mission}
        if not peers.planner.endswith(UNCOUNTED):
            said.update(waypoint=3 if peers.done else 1, waypoints=3, repetition=peers.leg[0], file_index=peers.leg[1])
        _KEPT[key] = ev.MissionStatus(t_ns=0, phase=ev.MissionPhase[peers.planner.rstrip(UNCOUNTED)], **said)
    return evolve(_KEPT[key], t_ns=state.t_ns)


def _recorder(peers: Peers, state: EngineState) -> ev.Event:
    key = ("recorder", peers.recorder, state.session.id)
    if key not in _KEPT:
        stalled = peers.recorder == "STALLED"
        lost = "some of it" if peers.recorder == "LOST" else ""
        phase = ev.RecordingPhase["RECORDING" if stalled else "COMPLETE" if lost else peers.recorder]
        grows = phase is ev.RecordingPhase.RECORDING
        platforms = (ev.PlatformRecording("a", growing=grows), ev.PlatformRecording("b", growing=grows and not stalled))
        where = "/data" if phase is ev.RecordingPhase.COMPLETE else ""
        _KEPT[key] = ev.RecordingStatus(
            t_ns=0,
            session_id=state.session.id,
            phase=phase,
            platforms=platforms,
            lost=lost,
            location=where,
            message=where and "1 GB",
        )
    return evolve(_KEPT[key], t_ns=state.t_ns)


def _detection(peers: Peers, state: EngineState) -> ev.Event:
    if ("detection", peers.detection) not in _KEPT:
        _KEPT["detection", peers.detection] = ev.LandedStatus(t_ns=0, landed=ev.Landed[peers.detection])
    return evolve(_KEPT["detection", peers.detection], t_ns=state.t_ns)


_SAYS = {
    "autopilot": _vehicle,
    "watchdog": _action,
    "info": _info,
    "planner": _planner,
    "recorder": _recorder,
    "landing": _detection,
}


def say(peer: str, peers: Peers, state: EngineState) -> ev.Event:
    """Return the event in which a peer says now what it says; `info` is the watchdog's second stream."""
    event, speaker = _SAYS[peer](peers, state), "watchdog" if peer == "info" else peer
    age_ns = next((ns for said, ns in _AGES.items() if f"{said}-{speaker}" in peers.silent), 0)
    return evolve(event, age_ns=age_ns) if age_ns else event


def unheard(peer: str) -> Tuple[str, ...]:
    """Return what is among the silent ones while a peer says nothing, or nothing of now."""
    return (peer, *(f"{said}-{peer}" for said in _AGES))


def beat(peers: Peers, state: EngineState) -> Tuple[str, ...]:
    """Return the peers whose status comes with every unit of time."""
    speaks = ["autopilot", "watchdog"]
    if peers.planner and state.session.id:
        speaks.append("planner")
    if peers.recorder and state.session.id:
        speaks.append("recorder")
    speaks.append("landing")
    return tuple(peer for peer in speaks if peer not in peers.silent)
