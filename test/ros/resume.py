#!/usr/bin/env python3
"""The engine is killed (SIGKILL) at 20 random moments of five missions; it resumes it and repeats nothing.

Each flight has a fixed seed: a failure comes again. The time to resume is printed; test/bench/resume.py measures it.
"""

from __future__ import annotations

import os
import random
import shutil
import time
from pathlib import Path
from typing import List

import rospy
from behaviours import Behaviours
from stack import Stack

from amaze_autonomy.engine.events import EngineStarted, MissionPhase, MissionStatus

KILLS = 4
IN_FLIGHT = ("TAKEOFF", "MISSION", "HOLD", "LAND")
AFTER_FLIGHT = (*IN_FLIGHT, "PILOT", "DATA_CLEANUP", "OUTREACH", "MISSION_ENDED")
#: what reaches the vehicle's side only as often as it was decided, and how the journal has it
ONCE = {
    "data_recorder/start": "StartRecording(",
    "mission_planner/load": "LoadMission(",
    "TAKEOFF": "MissionCommand(TAKEOFF)",
}
resume = Behaviours()


def killed_at_random(stack: Stack, seed: int) -> None:
    chance = random.Random(seed)
    for number in range(KILLS):
        time.sleep(chance.uniform(0.05, 2.5))  # the moment is the point of the test
        kill_and_start(stack, number)
    finish(stack)
    names = [each.name for each in stack.received()]
    legs = names.count("mission_planner/load")
    assert names.count("TAKEOFF") <= legs, f"more takeoffs than loaded files: {names}"
    assert len(stack.events(EngineStarted)) == KILLS + 1


def kill_and_start(stack: Stack, number: int) -> None:
    assert stack.engine is not None
    stack.engine.kill()
    stack.engine.wait()
    known, before = stack.states[-1], decided(stack)
    began = rospy.Time.now()
    stack.start_engine()
    stack.wait(lambda: len(stack.events(EngineStarted)) == number + 2, f"start {number + 2}")
    started = stack.events(EngineStarted)[-1]
    stack.wait(lambda: stack.states[-1].header.stamp > began, "its state")
    first = next(each for each in stack.states if each.header.stamp > began)  # what the one before said may come late
    assert started.resumed, "it did not find its journal"
    assert first.session_id == known.session_id or not known.session_id
    if known.state in IN_FLIGHT:
        assert first.state in AFTER_FLIGHT, f"{known.state} became {first.state}"
        assert decided(stack) == before, f"decided again: {before} became {decided(stack)}"
        assert all(sent <= told for sent, told in zip(once(stack), before)), f"sent again: {once(stack)}, not {before}"
    took_s = birth_to_decision(stack, started)
    print(f"{stack.name}: killed in {known.state}, in {first.state} again {took_s:.2f} s after its birth", flush=True)


def once(stack: Stack) -> List[int]:
    names = [each.name for each in stack.received()]
    return [names.count(name) for name in ONCE]


def decided(stack: Stack) -> List[int]:
    texts = [text for each in stack.decisions() for text in each.commands]
    return [sum(text.startswith(began) for text in texts) for began in ONCE.values()]


def birth_to_decision(stack: Stack, started: EngineStarted) -> float:
    """Return the seconds from the birth of the running engine to its first decision (both on the monotonic clock)."""
    assert stack.engine is not None
    fields = Path(f"/proc/{stack.engine.pid}/stat").read_text().rpartition(")")[2].split()
    return started.t_ns / 1e9 - int(fields[19]) / os.sysconf("SC_CLK_TCK")  # starttime, proc(5)


def finish(stack: Stack) -> None:
    """Land what flies, give up what waits for a person, and wait for the end."""
    stack.wait_state("MISSION", "HOLD", "LAND", "OUTREACH", "MISSION_ENDED")
    if stack.state in ("MISSION", "HOLD"):
        assert stack.ask("land")[0] in (1, 3)

    def ended() -> bool:  # killed before the recorder was asked: first the recording is missing, then its data
        stack.retry("give_up")
        return stack.state in ("MISSION_ENDED", "MISSION_INPUT")

    stack.wait(ended, "MISSION_ENDED or MISSION_INPUT")


@resume.add(start=False)
def killed_before_its_mission_was_selected(stack: Stack) -> None:
    """It waits for peers that are not there; the next one knows the mission from its own parameter."""
    stack.start_engine()
    stack.wait_state("MISSION_INPUT")
    stack.wait(lambda: stack.events(EngineStarted), "its start on the disk: its state is shown before")
    kill_and_start(stack, 0)
    stack.start_peers(0)
    stack.wait_state("MISSION_ENDED")
    assert stack.states[-1].result == "COMPLETE"


@resume.add(mission="long")
def killed_after_its_folder_was_removed_in_flight(stack: Stack) -> None:
    """The operator is told where the journal goes on, and the next engine finds it."""
    stack.wait_state("MISSION")
    shutil.rmtree(stack.output)
    words = f"The journal was removed: {stack.output}/journal.jsonl. It is there again, whole."
    stack.wait(lambda: words in stack.states[-1].advice, "the word to the operator")
    assert words in stack.log()
    kill_and_start(stack, 0)
    finish(stack)
    assert once(stack) == [1, 1, 1]


@resume.add(mission="hop", overrides=("missions.flight.landing_speed_m_s=0.25",))
def killed_in_the_planners_own_landing(stack: Stack) -> None:
    """The next engine hears planner and vehicle before it commands: what lands, lands, and the mission is complete."""
    landing = lambda: [each for each in stack.events(MissionStatus) if each.phase is MissionPhase.LANDING]  # noqa: E731
    stack.wait(landing, "the planner's landing")
    assert stack.state == "MISSION"
    kill_and_start(stack, 0)
    stack.wait_over()
    told = [text for each in stack.decisions() for text in each.commands]
    assert not [text for text in told if "HOLD" in text or "LAND" in text or "Land" in text], told
    assert stack.states[-1].result == "COMPLETE"


def _add(mission: str, seed: int) -> None:
    def killed(stack: Stack) -> None:
        killed_at_random(stack, seed)

    killed.__name__ = f"killed_four_times_{mission}_{seed}"
    resume.add(mission=mission)(killed)


for _mission, _seed in (("long", 1), ("long", 2), ("hop", 3), ("hop", 4), ("two", 5)):
    _add(_mission, _seed)

if __name__ == "__main__":
    resume.main("amaze_autonomy", "resume", at_once=2)
