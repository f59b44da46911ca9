#!/usr/bin/env python3
"""Peers that do not answer as they should never keep the engine from deciding on something else."""

from __future__ import annotations

import json
import subprocess
import sys
import time

from behaviours import Behaviours
from hitches import allowed_s
from nasty_peer import NastyPeer
from stack import HERE, Stack

from amaze_autonomy import srv
from amaze_autonomy.engine.events import Outcome, Reply

MOST_S = 0.05
BUT_RECORDER = "watchdog,landing_detection,state_estimation,autopilot,mission_planner"
OVERRIDES = (
    "autonomy.commands.command_reply_limit_s=3.0",
    "autonomy.recording.recording_start_limit_s=4.0",
    "recording.start_limit_s=3.0",
)
WAITING = (*OVERRIDES, "autonomy.require_go=true")
peers = Behaviours()


class Prober:
    """Asks the engine something again and again, in a process of its own: this one has too much to do to measure."""

    def __init__(self, stack: Stack) -> None:
        command = [sys.executable, str(HERE / "ask_often.py"), f"/{stack.name}/autonomy/command", "resume", "1.0"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def slowest_answer_s(self) -> float:
        """Ask for a second; return the longest time to an answer."""
        output, _ = self._process.communicate("go\n", timeout=30.0)
        answered = json.loads(output)
        assert answered["count"] >= 30, f"{answered} within a second"
        return float(answered["slowest_s"])


def ends_with(stack: Stack, outcome: Outcome, words: str) -> None:
    """The request to the recorder ended with an outcome and a reason, in the state that is named for it."""
    stack.wait_state("OUTREACH")
    assert stack.decisions()[-1].rule in ("recording_refused", "recording_not_proven")
    replies = [event for event in stack.events(Reply) if "data_recorder/start" in event.message]
    assert [reply.outcome for reply in replies] == [outcome]
    assert words in replies[0].message
    assert "data_recorder" in stack.states[-1].message or "record" in stack.states[-1].message


def nasty(stack: Stack, manner: str, outcome: Outcome, words: str) -> None:
    peer = NastyPeer(f"/{stack.name}/data_recorder/start", srv.StartRecording, manner)
    try:
        stack.wait_state("READY")
        prober = Prober(stack)
        stack.ask("go")
        stack.wait_state("START_RECORDING", "OUTREACH")
        slowest = prober.slowest_answer_s()
        assert slowest < MOST_S, f"an answer took {slowest:.3f} s while a peer {manner}"
        if outcome is Outcome.TIMED_OUT:
            assert stack.state == "START_RECORDING", "it was not asked while the peer was waited for"
        ends_with(stack, outcome, words)
    finally:
        peer.end()


def recorder(manner: str, outcome: Outcome, words: str) -> None:
    """Add one behaviour."""

    def run(stack: Stack) -> None:
        nasty(stack, manner, outcome, words)

    run.__name__ = f"recorder_{manner}"
    peers.add(processes=(BUT_RECORDER,), overrides=WAITING, parameters={"peers_limit": 2.0})(run)


recorder("hangs", Outcome.TIMED_OUT, "did not answer within the limit")
recorder("hangs_in_handshake", Outcome.TIMED_OUT, "did not answer within the limit")
recorder("half_an_answer", Outcome.TIMED_OUT, "did not answer within the limit")
recorder("dies", Outcome.BROKEN, "died in mid-call")
recorder("dies_in_handshake", Outcome.BROKEN, "died in mid-call")
recorder("nonsense", Outcome.BROKEN, "answered nonsense")
recorder("endless", Outcome.BROKEN, "more than any answer has")


@peers.add(processes=(BUT_RECORDER,), overrides=OVERRIDES, parameters={"peers_limit": 2.0})
def recorder_is_not_there(stack: Stack) -> None:
    ends_with(stack, Outcome.UNAVAILABLE, "no such service")


@peers.add(
    faults="description: late\nfaults:\n  - {service: data_recorder/start, fault: slow, delay_s: 5.0}\n",
    overrides=OVERRIDES,
)
def recorder_answers_late(stack: Stack) -> None:
    stack.wait_state("MISSION_ENDED")
    started = next(each for each in stack.decisions() if any("StartRecording" in text for text in each.commands))
    number = int(started.commands[0].split("#")[1])
    replies = [event.outcome for event in stack.events(Reply) if event.command_id == number]
    assert replies == [Outcome.TIMED_OUT], "a late answer came through"
    assert stack.states[-1].result == "COMPLETE", "that the recorder records is seen from its status"


@peers.add(
    faults="description: hung\nfaults:\n"
    "  - {service: mission_planner/command, fault: hangs, after: {event: airborne}}\n",
    mission="long",
)
def hung_planner_in_flight_delays_nothing(stack: Stack) -> None:
    stack.wait_state("MISSION")
    stack.ask("hold")
    stack.wait_state("HOLD")
    before = time.monotonic_ns()
    stack.ask("land")
    landed = stack.wait_received("LAND")
    assert (landed.t_ns - before) / 1e9 < allowed_s(MOST_S, before / 1e9), "LAND waited for the HOLD that hangs"


if __name__ == "__main__":
    peers.main("amaze_autonomy", "peers", at_once=5)  # it measures milliseconds
