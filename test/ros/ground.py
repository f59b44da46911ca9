#!/usr/bin/env python3
"""What happens before and after a flight: checks, recorder, planner, data, and the user's answers."""

from __future__ import annotations

from typing import Any, Dict, List

import rospy
from behaviours import Behaviours
from documented import OURS, calls
from hitches import allowed_s
from one_node import wait_for_service
from stack import CHECKS, Stack, without_repetitions

from amaze_autonomy import msg
from amaze_autonomy.interface import SERVICES

DONE, REFUSED = 1, 2
BEFORE = ["data_recorder/start", "mission_planner/load"]
FLIGHT = [*BEFORE, "TAKEOFF", "data_recorder/stop"]
PASSING = (1, 2)
YES = ("accepted", "success", *(row.ok for row in SERVICES.values() if row.check is not None))
ground = Behaviours()


def scenario(*lines: str) -> str:
    return "description: on the ground\nfaults:\n" + "".join(f"  - {{{line}}}\n" for line in lines)


def outreach_then_fly(stack: Stack, row: str) -> None:
    """A check fails with its row and its advice, nothing has been commanded; the user retries until it flies."""
    stack.wait_state("OUTREACH")
    bad = [check for check in stack.states[-1].checks if check.verdict not in PASSING]
    assert any(row in check.name for check in bad), f"no row {row!r} among {[check.name for check in bad]}"
    assert all(check.advice for check in bad), "a row that failed gives no advice"
    assert stack.commands() == [], "something was commanded although a check failed"
    retry_until_it_flies(stack)
    stack.wait_state("MISSION")
    assert stack.commands() == [*BEFORE, "TAKEOFF"]


def retry_until_it_flies(stack: Stack) -> None:
    def flies() -> bool:
        stack.retry()
        return "TAKEOFF" in stack.passed

    stack.wait(flies, "TAKEOFF after a retry")


# The longest first: what starts last ends last.
@ground.add("mission_selected", mission="")
def user_selects_missions_and_is_told_of_mistakes(stack: Stack) -> None:
    stack.wait_peers()
    accepted, message = stack.select("nothing")
    assert not accepted
    assert "hop" in message, "it does not say which missions there are"
    assert stack.ask("land")[0] == REFUSED
    assert stack.select("hop", "hop")[0]
    stack.wait(
        lambda: stack.passed.count("MISSION_ENDED") >= 1 and len(stack.decisions("data_complete")) == 2,
        "both ends",
        60.0,
    )
    assert stack.commands() == [*FLIGHT, *FLIGHT]
    sessions = [each.session for each in stack.received() if each.service == "data_recorder/start"]
    assert len(set(sessions)) == 2, "two missions share a session"


@ground.add(
    mission="",
    processes=("landing_detection,state_estimation,autopilot,mission_planner,data_recorder", "watchdog"),
)
def restarted_peer_is_found_again(stack: Stack) -> None:
    stack.wait_peers()
    assert stack.select("hop")[0]
    stack.wait_state("MISSION_ENDED")
    stack.peers[1].kill()
    stack.peers[1].wait()
    assert stack.select("hop")[0]
    stack.wait_state("OUTREACH")
    assert "watchdog" in stack.states[-1].message
    stack.start_peers(1)
    stack.wait(lambda: retried(stack), "the second end", 60.0)
    assert stack.commands() == [*FLIGHT, *FLIGHT]


def retried(stack: Stack) -> bool:
    stack.retry()
    return len(stack.decisions("data_complete")) == 2


@ground.add("checks_failed", faults=scenario("component: gps, fault: unhealthy, for_s: 12"))
def failed_watchdog_check(stack: Stack) -> None:
    outreach_then_fly(stack, "watchdog")


@ground.add("checks_failed", faults=scenario("fault: battery_unknown, for_s: 24"), night=True)
def failed_battery_check(stack: Stack) -> None:
    outreach_then_fly(stack, "battery")


@ground.add("checks_failed", faults=scenario("fault: not_ready, what: rc, for_s: 12"), night=True)
def failed_autopilot_check(stack: Stack) -> None:
    outreach_then_fly(stack, "autopilot")


@ground.add("checks_failed", faults=scenario("fault: raised, height_m: 0.5, for_s: 12"), night=True)
def failed_ground_check(stack: Stack) -> None:
    outreach_then_fly(stack, "on ground")


@ground.add("checks_failed", faults=scenario("fault: tilted, tilt_deg: 25, for_s: 12"), night=True)
def failed_state_estimation_check(stack: Stack) -> None:
    outreach_then_fly(stack, "state estimation")


@ground.add("checks_repeated", faults=scenario("component: mission_camera, fault: killed"))
def watchdog_fixes_before_the_flight(stack: Stack) -> None:
    stack.wait_state("MISSION_ENDED")
    assert "OUTREACH" not in stack.passed
    assert stack.commands() == FLIGHT
    checks = [each for each in stack.received() if each.service == "watchdog/start"]
    assert len(checks) >= 3, "the watchdog was not asked again"


@ground.add("planner_refused", faults=scenario("service: mission_planner/load, fault: refuses, for_s: 14"))
def planner_refuses(stack: Stack) -> None:
    stack.wait_state("OUTREACH")
    assert stack.decisions()[-1].rule == "planner_refused"
    assert "TAKEOFF" not in stack.commands()
    retry_until_it_flies(stack)
    stack.wait_state("MISSION")
    assert len([each for each in stack.received() if each.service == "data_recorder/start"]) == 1, (
        "recording was not kept"
    )


@ground.add(
    "planner_silent",
    "planner_refused",
    faults=scenario("service: mission_planner/load, fault: hangs"),
    overrides=("autonomy.takeoff.load_limit_s=2.0", "missions.planner.transfer_limit_s=1.0"),
)
def planner_is_silent(stack: Stack) -> None:
    stack.wait_state("OUTREACH")
    assert stack.decisions()[-1].rule in ("planner_refused", "planner_silent")
    stack.wait_received("mission_planner/load")
    asked, silent = (decision.t_ns for decision in stack.decisions()[-2:])
    assert 1.9 <= (silent - asked) / 1e9 <= allowed_s(2.3, asked / 1e9)
    assert stack.ask("give_up")[0] == DONE
    stack.wait_state("MISSION_ENDED")
    assert stack.commands() == [*BEFORE, "data_recorder/stop"]
    assert stack.states[-1].result == "NOT_FLOWN"


@ground.add("recording_refused", faults=scenario("service: data_recorder/start, fault: refuses, for_s: 12"))
def recorder_refuses(stack: Stack) -> None:
    stack.wait_state("OUTREACH")
    assert stack.decisions()[-1].rule == "recording_refused"
    assert stack.commands() == ["data_recorder/start"]
    retry_until_it_flies(stack)
    stack.wait_state("MISSION")


@ground.add(
    "recording_not_proven",
    faults=scenario("fault: recording_does_not_grow"),
    overrides=("autonomy.recording.recording_start_limit_s=3.0", "recording.start_limit_s=2.0"),
)
def recorder_does_not_grow(stack: Stack) -> None:
    stack.wait_state("OUTREACH")
    assert stack.decisions()[-1].rule == "recording_not_proven"
    assert stack.commands() == ["data_recorder/start"]
    assert stack.ask("give_up")[0] == DONE
    stack.wait_state("MISSION_ENDED")
    assert stack.commands() == ["data_recorder/start", "data_recorder/stop"], (
        "a recording that was started was not stopped"
    )


@ground.add("data_incomplete", faults=scenario("fault: data_incomplete, after: {event: merging}, for_s: 4"))
def incomplete_data_is_collected_at_the_second_try(stack: Stack) -> None:
    stack.wait_state("OUTREACH")
    assert stack.states[-1].data_location or "missing" in stack.states[-1].message
    assert "second" in stack.states[-1].message, "it does not say whose part is missing"

    def complete() -> bool:
        stack.retry()
        return stack.state == "MISSION_ENDED"

    stack.wait(complete, "the end after a retry")
    assert stack.states[-1].result == "COMPLETE"


@ground.add("data_incomplete", faults=scenario("fault: data_incomplete"), night=True)
def incomplete_data_is_given_up(stack: Stack) -> None:
    stack.wait_state("OUTREACH")
    assert stack.ask("go")[0] == REFUSED
    assert stack.ask("give_up")[0] == DONE
    stack.wait_state("MISSION_ENDED")
    assert (stack.states[-1].result, stack.states[-1].data_result) == ("COMPLETE", "INCOMPLETE")


INITIALISED = "sensors.initialisation.service=/{}/estimator/init_service"
LIMIT = "sensors.initialisation.limit_s=3.0"


@ground.add(
    "checks_failed",
    faults=scenario("fault: not_initialised, for_s: 12"),
    overrides=(INITIALISED.format("simulated_estimator_is_initialised_on_a_retry"), LIMIT),
    night=True,
)
def simulated_estimator_is_initialised_on_a_retry(stack: Stack) -> None:
    outreach_then_fly(stack, "estimator initialisation")


@ground.add("give_up_unrecorded", faults=scenario("fault: tilted, tilt_deg: 25"), night=True)
def user_gives_up_before_anything_was_recorded(stack: Stack) -> None:
    stack.wait_state("OUTREACH")
    assert stack.ask("give_up")[0] == DONE
    stack.wait_state("MISSION_INPUT")
    assert stack.commands() == []


@ground.add("go", overrides=("autonomy.require_go=true",))
def go_is_waited_for(stack: Stack) -> None:
    stack.wait_state("READY")
    assert stack.ask("resume")[0] == REFUSED
    assert stack.commands() == []
    assert "go" in stack.states[-1].user_commands
    assert stack.ask("go")[0] == DONE
    stack.wait_state("MISSION_ENDED")
    assert stack.commands() == FLIGHT


@ground.add(mission="", overrides=("autonomy.require_go=true",))
def services_are_called_as_the_documentation_says(stack: Stack) -> None:
    """Each `rosservice call` of docs/integrator.md to the engine, in its order."""
    stack.wait_peers()
    said: Dict[str, Any] = {}
    before = {"go": "READY", "hold": "MISSION", "resume": "HOLD", "land": "MISSION"}
    for call in calls("long"):
        if call.name.startswith(OURS):
            if call.word in before:
                stack.wait_state(before[call.word])
            said[call.word] = call.ask(f"/{stack.name}")
    assert said["select_mission"].accepted, said["select_mission"].message
    done = {word for word, answer in said.items() if getattr(answer, "success", False)}
    assert done == {"go", "hold", "resume", "land", "abort"}, said
    assert "retry" in said["retry"].message, "a refusal gives no reason"
    assert said["command"].answer == 3, "it lands already"
    others = {"list_missions", "select_mission", "retry", "give_up", "acknowledge", "command"}
    assert set(said) == done | others, "services without an example"


@ground.add(start=False)
def peers_are_asked_as_the_documentation_says(stack: Stack) -> None:
    """Each `rosservice call` of docs/integrator.md to a peer, in its order and without an engine: a flight by hand."""
    space = f"/{stack.name}"
    stack.start_peers(0)
    wait_for_service(f"{space}/watchdog/start")
    phases: List[int] = []
    rospy.Subscriber(f"{space}/mission_planner/status", msg.MissionStatus, lambda status: phases.append(status.phase))
    said: Dict[str, Any] = {}
    asked = [call for call in calls("long") if not call.name.startswith(OURS)]
    for call in asked:
        if call.name == "/autopilot/land":
            stack.wait(lambda: phases[-1:] == [msg.MissionStatus.FLYING], "the mission", alive=False)
        if call.word != "load_waypoints":  # our planner alone takes them: mission_planner.py
            said[call.name] = stack.wait(lambda call=call: yes(call.ask(space)), call.name, alive=False)
    assert {name.lstrip("/") for name in said} == set(SERVICES), "services without an example"
    assert [call.word for call in asked].count("load_waypoints") == 1
    rows = [row for answer in said.values() for row in getattr(answer, "checks", ())]
    assert rows, "no check says what it looked at"
    assert [row for row in rows if row.verdict not in PASSING] == [], "a check says yes with a row that failed"
    received = without_repetitions([each.name for each in stack.received() if each.service not in CHECKS])
    flown = ["mission_planner/load", "TAKEOFF", "autopilot/land", "autopilot/disarm"]
    assert received == ["data_recorder/start", *flown, "data_recorder/stop"], received


def yes(answer: Any) -> Any:
    """Return an answer that says yes, or nothing: a check takes a moment, a disarming waits for the ground."""
    return answer if any(getattr(answer, name, False) for name in YES) else None


@ground.add(mission="long")
def statuses_of_an_old_session_change_nothing(stack: Stack) -> None:
    recorder = rospy.Publisher(f"/{stack.name}/data_recorder/status", msg.RecordingStatus, queue_size=10)
    planner = rospy.Publisher(f"/{stack.name}/mission_planner/status", msg.MissionStatus, queue_size=10)
    stack.wait_state("MISSION")
    stack.wait(lambda: recorder.get_num_connections() and planner.get_num_connections(), "the connections")
    old = msg.RecordingStatus(session_id="old", phase=msg.RecordingStatus.COMPLETE, location="old.bag")
    done = msg.MissionStatus(
        session_id="old", mission_id="long", phase=msg.MissionStatus.LANDED, waypoint=2, waypoints=2
    )
    for _ in range(5):
        old.header.stamp = done.header.stamp = rospy.Time.now()
        recorder.publish(old)
        planner.publish(done)
    stack.wait(lambda: stack.state == "MISSION" and stack.states[-1].waypoint >= 1, "the mission to go on")
    assert stack.ask("land")[0] == DONE
    stack.wait_state("MISSION_ENDED")
    assert stack.commands() == [*BEFORE, "TAKEOFF", "LAND", "data_recorder/stop"]
    assert stack.states[-1].data_location != "old.bag"


@ground.add()
def invalid_messages_are_warned_of_once_and_ignored(stack: Stack) -> None:
    action = rospy.Publisher(f"/{stack.name}/watchdog/action", msg.WatchdogAction, queue_size=10)
    stack.wait(action.get_num_connections, "the connection")
    for _ in range(3):
        action.publish(msg.WatchdogAction(code=3))
    stack.wait_state("MISSION_ENDED")
    assert stack.states[-1].result == "COMPLETE"
    stack.wait(lambda: "invalid message" in stack.log(), "the warning")
    warnings = [line for line in stack.log().splitlines() if "invalid message" in line]
    assert len(warnings) == 1
    assert f"/{stack.name}/watchdog/action" in warnings[0]
    assert "code is 3" in warnings[0]


@ground.add(processes=("",), parameters={"peers_limit": 20.0})
def engine_may_start_before_its_peers(stack: Stack) -> None:
    stack.wait_state("MISSION_ENDED")
    assert stack.states[-1].result == "COMPLETE"


if __name__ == "__main__":
    ground.main("amaze_autonomy", "ground")
