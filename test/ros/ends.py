#!/usr/bin/env python3
"""How the node ends and comes back: signals in flight, exit status, a killed engine that resumes."""

from __future__ import annotations

import json
import signal
import subprocess
import time

from behaviours import Behaviours
from hitches import allowed_s
from stack import Stack

from amaze_autonomy.engine.events import EngineStarted, Shutdown
from amaze_autonomy.journal.journal import read

BEFORE = ["data_recorder/start", "mission_planner/load"]
#: A recorder that writes nothing for a second of the first flight.
LOSES = """\
description: a second of the first flight is not recorded
faults:
  - {fault: recording_does_not_grow, platform: second, after: {event: mission, delay_s: 0.3}, for_s: 1.0}
"""
TWO_HOPS_S = 80.0
ends = Behaviours()


def lands_when_told_to_end(stack: Stack, number: int) -> None:
    stack.wait_state("MISSION")
    told_ns = stack.signal_engine(number)
    status = stack.wait_end(10.0)
    delays = stack.routes_after(told_ns)
    assert set(delays) == {"LAND", "autopilot/land"}, f"landing was sent by {set(delays)} only"
    assert all(0.0 <= delay < allowed_s(0.1, told_ns / 1e9) for delay in delays.values()), (
        f"landing was sent after {delays}"
    )
    assert status == 8
    name = signal.Signals(number).name
    assert f"ended by {name} IN FLIGHT" in stack.log()
    assert "LAND was sent (mission planner: accepted, autopilot: accepted)" in stack.log()
    result = stack.result()
    assert (result["exit_status"], result["result"], result["in_flight"]) == (8, "INTERRUPTED_IN_FLIGHT", True)
    journal = read((stack.output / "journal.jsonl").read_text())
    assert not journal.truncated
    assert [event.signal for event in stack.events(Shutdown)] == [name]


@ends.add("shutdown_in_flight", mission="long", night=True)
def sigint_in_flight_lands_by_both_routes(stack: Stack) -> None:
    lands_when_told_to_end(stack, signal.SIGINT)


@ends.add("shutdown_in_flight", mission="long")
def sigterm_in_flight_lands_by_both_routes(stack: Stack) -> None:
    lands_when_told_to_end(stack, signal.SIGTERM)


@ends.add("shutdown_in_flight", mission="long")
def sighup_in_flight_lands_by_both_routes(stack: Stack) -> None:
    lands_when_told_to_end(stack, signal.SIGHUP)


@ends.add(mission="")
def signal_before_any_mission_ends_well(stack: Stack) -> None:
    stack.wait_state("MISSION_INPUT")
    stack.signal_engine(signal.SIGINT)
    assert stack.wait_end(10.0) == 0
    assert stack.received() == []
    assert (stack.result()["state"], stack.result()["result"]) == ("MISSION_INPUT", "NO_MISSION")
    assert "COMPLETE" not in stack.log()


@ends.add("shutdown_before_takeoff", overrides=("autonomy.recording.recording_lead_s=10.0",))
def signal_while_recording_stops_the_recording(stack: Stack) -> None:
    stack.wait_received("data_recorder/start")
    stack.wait(lambda: stack.states[-1].recording_phase == "RECORDING", "the recording")
    stack.signal_engine(signal.SIGTERM)
    assert stack.wait_end(10.0) == 7
    assert stack.commands() == ["data_recorder/start", "data_recorder/stop"]


@ends.add(
    faults="description: tilted\nfaults:\n  - {fault: tilted, tilt_deg: 25}\n",
    parameters={"exit_when_ended": True, "unattended": True},
    night=True,
)
def nobody_there_to_answer_ends_at_outreach(stack: Stack) -> None:
    assert stack.wait_end() == 5
    assert stack.result()["result"] == "NOT_FLOWN"
    assert stack.commands() == []


@ends.add(
    faults="description: a pilot\nfaults:\n  - fault: pilot_takes_over\n    after: {event: mission, delay_s: 0.3}\n"
    "    land_after_s: 1.0\n",
    mission="long",
    parameters={"exit_when_ended": True, "unattended": True},
    night=True,
)
def nobody_there_to_acknowledge_a_pilots_landing_ends_all_the_same(stack: Stack) -> None:
    assert stack.wait_end() == 4
    assert stack.result()["result"] == "PILOT"
    assert stack.commands() == [*BEFORE, "TAKEOFF", "data_recorder/stop"]


@ends.add(mission="hop,hop", faults=LOSES, parameters={"exit_when_ended": True})
def what_the_first_mission_of_a_queue_lacks_is_in_exit_status_and_result(stack: Stack) -> None:
    assert stack.wait_end(TWO_HOPS_S) == 6
    lacks_data_of_its_first_mission(stack)


@ends.add(mission="hop,hop", faults=LOSES)
def engine_that_is_killed_after_its_last_mission_ends_with_the_result_of_all(stack: Stack) -> None:
    """The one that is started again shall end with the last mission, and it has ended."""
    ended = lambda: stack.state == "MISSION_ENDED" and stack.states[-1].session_id.endswith("-002")  # noqa: E731
    stack.wait(ended, "the end of the second mission", TWO_HOPS_S)
    assert stack.engine is not None
    stack.engine.kill()
    stack.engine.wait()
    stack.parameters["exit_when_ended"] = True
    stack.start_engine()
    assert stack.wait_end() == 6
    assert [event.resumed for event in stack.events(EngineStarted)] == [False, True]
    lacks_data_of_its_first_mission(stack)


def lacks_data_of_its_first_mission(stack: Stack) -> None:
    first = next(each.session_id for each in stack.states if each.session_id)
    assert [each.rule for each in stack.decisions() if each.after == "MISSION_ENDED"] == ["data_lost", "data_complete"]
    result = stack.result()
    assert (result["result"], result["data_result"], result["exit_status"]) == ("COMPLETE", "INCOMPLETE", 6)
    assert result["data_summary"].startswith(f"{first}: second: "), result
    assert f"data     INCOMPLETE: {result['data_summary']}" in stack.log()


@ends.add(mission="nothing", parameters={"exit_when_ended": True}, start=False)
def unknown_mission_ends_with_one_line(stack: Stack) -> None:
    stack.start_engine()
    assert stack.wait_end() == 2
    assert "there is no such mission; there are hop, long, far, two" in stack.log()
    assert "Traceback" not in stack.log()


@ends.add(mission="long")
def killed_engine_goes_on_where_it_was(stack: Stack) -> None:
    stack.wait_state("MISSION")
    stack.wait(lambda: stack.states[-1].waypoint >= 1, "the first waypoint")
    assert stack.engine is not None
    stack.engine.kill()
    stack.engine.wait()
    with (stack.output / "journal.jsonl").open("a") as journal:
        journal.write('{"half a li')
    seen = len(stack.states)
    stack.start_engine()
    stack.wait(lambda: len(stack.states) > seen, "the engine to be back")
    stack.wait_state("MISSION")
    assert stack.ask("land")[0] == 1
    stack.wait_state("MISSION_ENDED")
    assert stack.commands() == [*BEFORE, "TAKEOFF", "LAND", "data_recorder/stop"], (
        "something was sent twice, or not at all"
    )
    started = stack.events(EngineStarted)
    assert [event.resumed for event in started] == [False, True]
    assert stack.states[-1].session_id == stack.states[seen - 1].session_id


@ends.add(mission="long", crippled=("--thread-ends-at=FOLDER/end",))
def engine_whose_thread_ends_in_flight_lands_by_both_routes_and_goes_on_as_another(stack: Stack) -> None:
    lands_and_goes_on(stack, 0.5)


@ends.add(mission="long", crippled=("--thread-hangs-at=FOLDER/end",))
def engine_whose_thread_hangs_in_flight_lands_by_both_routes_and_goes_on_as_another(stack: Stack) -> None:
    lands_and_goes_on(stack, 6.0)
    assert "crippled_autonomy.py" in stack.log(), "nobody says where it hangs"


@ends.add(mission="long", crippled=("--writer-ends-at=FOLDER/end",))
def engine_whose_journal_nobody_writes_any_more_lands_by_both_routes_and_goes_on_as_another(stack: Stack) -> None:
    lands_and_goes_on(stack, 1.5)


@ends.add(mission="long", crippled=("--all-hangs-at=FOLDER/end",))
def engine_that_hangs_in_all_its_threads_ends_and_says_where(stack: Stack) -> None:
    """Roslaunch, for which it is required, ends the other nodes then, of which two land: test/ros/launches.py."""
    stack.wait_state("MISSION")
    (stack.folder / "end").touch()
    assert stack.wait_end(30.0) == 1
    assert "Timeout" in stack.log()


def lands_and_goes_on(stack: Stack, limit_s: float) -> None:
    """Make the thread that decides useless, in flight."""
    stack.wait_state("MISSION")
    assert stack.engine is not None
    ended_ns = time.monotonic_ns()
    (stack.folder / "end").touch()
    stack.wait(lambda: len(stack.events(EngineStarted)) == 2, "the engine to start anew")
    delays = stack.routes_after(ended_ns)
    assert set(delays) == {"LAND", "autopilot/land"}, f"landing was sent by {set(delays)} only"
    assert all(0.0 <= delay < allowed_s(limit_s, ended_ns / 1e9) for delay in delays.values()), (
        f"landing was sent after {delays}"
    )
    stack.wait_state("MISSION_ENDED")
    assert [event.resumed for event in stack.events(EngineStarted)] == [False, True]
    assert [event.signal for event in stack.events(Shutdown)] == ["a failure of the engine's thread"]
    assert "autonomy: ended by a failure of the engine's thread IN FLIGHT in MISSION" in stack.log()
    assert "autonomy: LAND was sent (mission planner: accepted, autopilot: accepted)" in stack.log()
    assert stack.states[-1].result == "LANDED_EARLY"
    assert set(stack.commands()) == {*BEFORE, "TAKEOFF", "LAND", "autopilot/land", "data_recorder/stop"}
    stack.signal_engine(signal.SIGINT)
    assert stack.wait_end(10.0) == 3


@ends.add(
    mission="long", crippled=("--thread-ends-at=FOLDER/end",), overrides=("autonomy.require_go=true",), night=True
)
def engine_whose_thread_ends_on_the_ground_goes_on_as_another_where_it_was(stack: Stack) -> None:
    stack.wait_state("READY")
    session = stack.states[-1].session_id
    (stack.folder / "end").touch()
    stack.wait(lambda: len(stack.events(EngineStarted)) == 2, "the engine to start anew")
    stack.wait_state("READY")
    assert stack.events(Shutdown) == []
    assert stack.states[-1].session_id == session
    assert stack.commands() == []
    assert "autonomy: ended by a failure of the engine's thread in READY" in stack.log()


@ends.add(
    mission="long",
    crippled=("--no-threads-at=FOLDER/full",),
    overrides=("autonomy.commands.command_reply_limit_s=5.0",),
    faults="description: imu fails, and for four seconds nobody answers\nfaults:\n"
    "  - {service: mission_planner/command, fault: hangs, after: {event: mission, delay_s: 0.5}}\n"
    "  - {service: autopilot/land, fault: hangs, after: {event: mission, delay_s: 0.5}, for_s: 5.5}\n"
    "  - {component: imu, fault: unhealthy, after: {event: mission, delay_s: 2.0}}\n",
)
def engine_that_gets_no_new_thread_in_flight_lands_and_ends_the_mission(stack: Stack) -> None:
    """Some fifteen landings wait for an answer at the same time."""
    stack.wait_state("MISSION")
    (stack.folder / "full").touch()
    stack.wait_received("autopilot/land")
    stack.wait_received("data_recorder/stop")
    stack.wait_state("MISSION_ENDED")
    assert stack.states[-1].result == "LANDED_EARLY"


@ends.add("started_armed", mission="long")
def engine_whose_journal_is_damaged_lands_what_flies(stack: Stack) -> None:
    stack.wait_state("MISSION")
    assert stack.engine is not None
    stack.engine.kill()
    stack.engine.wait()
    with (stack.output / "journal.jsonl").open("a") as journal:
        journal.write("damaged\n")
    stack.parameters["mission"] = ""
    stack.start_engine()
    stack.wait_received("autopilot/land")
    assert stack.commands()[:3] == [*BEFORE, "TAKEOFF"]
    assert {"LAND", "autopilot/land"} >= set(stack.commands()[3:5])
    assert "It is kept, and a new one begins." in stack.log()
    earlier = stack.output / "earlier" / "journal.jsonl"
    whole, damage, rest = earlier.read_text().rpartition("damaged\n")
    assert (damage, rest) == ("damaged\n", "")
    earlier.write_text(whole)  # its flight kept the laws, too


@ends.add("shutdown_in_flight", mission="long")
def node_that_is_killed_by_name_in_flight_lands(stack: Stack) -> None:
    stack.wait_state("MISSION")
    told_ns = time.monotonic_ns()
    subprocess.run(["rosnode", "kill", f"/{stack.name}/autonomy"], check=True, stdout=subprocess.DEVNULL, timeout=60)
    assert stack.wait_end(10.0) == 8
    assert set(stack.routes_after(told_ns)) == {"LAND", "autopilot/land"}
    assert stack.result()["result"] == "INTERRUPTED_IN_FLIGHT"
    assert read((stack.output / "journal.jsonl").read_text()).truncated is False


@ends.add(mission="hop", parameters={"exit_when_ended": True}, night=True)
def second_run_in_a_folder_keeps_the_first(stack: Stack) -> None:
    stack.wait_end()
    first = (stack.output / "journal.jsonl").read_text()
    stack.parameters["mission"] = ""
    stack.parameters["exit_when_ended"] = False
    stack.start_engine()
    stack.wait(lambda: (stack.output / "journal.jsonl").exists() and stack.state == "MISSION_INPUT", "the second run")
    assert (stack.output / "earlier" / "journal.jsonl").read_text() == first
    assert json.loads((stack.output / "earlier" / "result.json").read_text())["result"] == "COMPLETE"


if __name__ == "__main__":
    ends.main("amaze_autonomy", "ends")
