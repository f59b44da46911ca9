"""Every message to the user: one row each. The operator's page in docs/ is generated from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Mapping

from .commands import Level

__all__ = ["MESSAGES", "Message"]


@dataclass(frozen=True)
class Message:
    """One message: how loud, the sentence (fields in braces), and what the user can do."""

    level: Level
    text: str
    advice: str = ""


_I, _W, _E, _A = Level.INFO, Level.WARNING, Level.ERROR, Level.ALARM

MESSAGES: Mapping[str, Message] = {
    "mission_input": Message(_I, "Select a mission.", "Choose a mission from the list."),
    "mission_invalid": Message(
        _E, "Mission {mission_id} cannot be flown: {error}", "Choose another mission, or fix this one."
    ),
    "resumed": Message(_W, "The engine was restarted and goes on in {state}."),
    "preflight": Message(_I, "Pre-flight checks of mission {mission_id} are running."),
    "preflight_fixing": Message(_W, "Not ready yet: {reason}", "Wait; the checks are repeated."),
    "ready": Message(_I, "Ready."),
    "ready_wait_go": Message(_I, "Ready. Waiting for the operator's go.", "Press G to take off, U to cancel."),
    "ready_old": Message(_W, "Ready has expired after {limit_s:.0f} s: repeating the checks."),
    "ready_taken_back": Message(_W, "No longer ready: {reason}", "The checks are repeated."),
    "check_failed": Message(_W, "A check failed before takeoff: {reason}", "The checks are repeated."),
    "checks_failed": Message(
        _E, "Pre-flight checks failed: {reason}", "Follow the advice in the table, then retry, or give up."
    ),
    "start_recording": Message(_I, "Recording is starting."),
    "recording_refused": Message(
        _E, "The recorder does not record: {reason}", "Check storage and recorder, then retry, or give up."
    ),
    "load_mission": Message(_I, "Mission {mission_id} is sent to the mission planner."),
    "planner_refused": Message(
        _E,
        "The mission planner did not accept the mission: {reason}",
        "Check planner and mission, then retry, or give up.",
    ),
    "takeoff": Message(_I, "Takeoff."),
    "takeoff_refused": Message(
        _E, "Takeoff was refused or did not happen: {reason}", "Check autopilot and planner, then retry, or give up."
    ),
    "takeoff_cancelled": Message(
        _W, "Takeoff is being cancelled: {reason}", "Keep clear until the vehicle is disarmed."
    ),
    "mission": Message(_I, "Takeoff altitude reached, starting the mission."),
    "touchdown": Message(_I, "Touched down: the next waypoint file is prepared."),
    "next_takeoff_failed": Message(
        _W, "No further takeoff: {reason}", "The data is collected; select the mission again to go on."
    ),
    "hold": Message(_W, "Holding position: {reason}", "Wait, or land."),
    "user_hold": Message(_I, "Holding position as you asked.", "Resume, or land."),
    "resuming": Message(_I, "Resuming the mission."),
    "resumed_flight": Message(_I, "The mission goes on."),
    "land": Message(_E, "Landing: {reason}", "Watch the vehicle; be ready to take over."),
    "land_user": Message(_W, "Landing as you asked.", "Watch the vehicle."),
    "land_shown": Message(_I, "Landing confirmed by the autopilot."),
    "takeover_suspected": Message(_W, "Somebody else seems to have control: {reason} Nothing is commanded."),
    "takeover_denied": Message(_W, "The vehicle answers to the engine: supervision goes on."),
    "landing_given_up": Message(
        _A,
        "Acknowledged without knowledge: whether the vehicle has landed is not known. Recording is stopped and kept.",
        "Keep clear until the vehicle is found and switched off.",
    ),
    "clock_stands": Message(
        _E, "/clock has stood still for {stalled_s:.1f} s: no limit can be kept.", "Start what publishes /clock."
    ),
    "clock_runs": Message(_I, "/clock runs again."),
    "land_second_route": Message(_E, "No sign of landing: sending LAND to the autopilot."),
    "land_alarm": Message(_A, "PILOT: THE VEHICLE DOES NOT LAND. TAKE OVER.", "Take over by remote control."),
    "land_limit": Message(_A, "PILOT: NOT LANDED AFTER {limit_s:.0f} s. TAKE OVER.", "Take over by remote control."),
    "autopilot_lost": Message(
        _A, "PILOT: THE AUTOPILOT IS SILENT. TAKE OVER IF YOU CAN.", "Take over by remote control."
    ),
    "disarm": Message(_W, "On the ground but still armed: disarming.", "Keep clear."),
    "pilot": Message(
        _W,
        "The pilot or the autopilot has control: {reason}",
        "Fly and land; acknowledge when on the ground and disarmed.",
    ),
    "landing_unconfirmed": Message(_W, "Landed and disarmed; the landing detection does not confirm it: {reason}"),
    "data_cleanup": Message(_I, "On the ground: recording is stopped, data is collected."),
    "data_incomplete": Message(_E, "The data is not complete: {reason}", "Retry, or give up; nothing is deleted."),
    "mission_ended": Message(_I, "Mission ended: {result}. {location}", "Select the next mission."),
    "mission_ended_incomplete": Message(
        _E,
        "Mission ended: {result}; its data is INCOMPLETE. {location}",
        "Nothing was deleted. Select the next mission.",
    ),
    "queue_dropped": Message(_W, "Remaining missions cancelled: {missions}", "Select them again."),
    "shutdown": Message(
        _E,
        "Told to end ({signal}) in flight: landing on both routes.",
        "Watch the vehicle; take over if it does not land.",
    ),
    "failure_continue": Message(_W, "{name}: {reason} The mission goes on."),
    "failure_wait": Message(_W, "{name}: {reason} The mission waits."),
    "failure_while_landing": Message(_W, "{name}: {reason} It is landing already."),
    "failure_land": Message(_E, "{name}: {reason} Landing."),
    "failure_pilot": Message(_W, "{name}: {reason} The pilot has control."),
    "failure_back": Message(_I, "{name} is back."),
    "flown_without": Message(_W, "{name} did not come back in time: the mission goes on without it."),
}
