"""When the node ends, what it waits for before, and what its exit status says."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue

import pytest

pytest.importorskip("rospy")

sys.path.append(str(Path(__file__).parents[1] / "engine"))

from engine_peers import MISSION, SHIPPED
from engine_story import Story

from amaze_autonomy.engine.commands import (
    AutopilotLand,
    MissionAction,
    MissionCommand,
    StopRecording,
)
from amaze_autonomy.engine.events import (
    EngineStarted,
    Mission,
    Outcome,
    RecordingPhase,
    RecordingStatus,
    Reply,
    Shutdown,
    Tick,
)
from amaze_autonomy.engine.state import DataResult, EngineState, Flight, Peers, Recording, Result, Session, State
from amaze_autonomy.journal.report import MessageLog
from amaze_autonomy.nodes.autonomy import ending as endings
from amaze_autonomy.nodes.autonomy.ending import ENGINE_ENDED, Ended, Ending, Farewell, Pulse, first_reason, start_anew
from amaze_autonomy.nodes.autonomy.node import (
    EXIT_STATUS,
    data_outcome,
    data_summary,
    decided_again,
    exit_status,
    outcome,
)
from amaze_autonomy.nodes.autonomy.outbox import Timeline

LAND = MissionCommand(id=1, limit_ns=1, session_id="s", action=MissionAction.LAND)
SECOND = AutopilotLand(id=2, limit_ns=1)
SHUTDOWN = Shutdown(t_ns=1, signal="SIGINT")
WHOLE, LACKS, NOTHING = DataResult.COMPLETE, DataResult.INCOMPLETE, DataResult.NONE


class Watched(Farewell):
    """One that sees states without a doubt, unless one is given."""

    def see(self, event, commands, state=EngineState()):  # noqa: B008
        super().see(event, commands, state)


def reply(number, how=Outcome.ACCEPTED):
    return Reply(t_ns=2, command_id=number, outcome=how)


def waits(farewell, limit_s=0.05):
    began = time.monotonic()
    farewell.wait(limit_s)
    return time.monotonic() - began >= limit_s


def test_nothing_to_land_is_nothing_to_wait_for():
    farewell = Watched()
    farewell.see(SHUTDOWN, (StopRecording(id=9, limit_ns=1, session_id="s"),))
    assert not waits(farewell, 5.0)
    assert farewell.text() == ""


def test_it_waits_for_the_shutdown_to_be_decided_on():
    assert waits(Watched())


def test_it_waits_until_both_routes_have_accepted():
    farewell = Watched()
    farewell.see(SHUTDOWN, (LAND, SECOND))
    assert waits(farewell)
    farewell.see(reply(1), ())
    assert waits(farewell)
    farewell.see(reply(2), ())
    assert not waits(farewell, 5.0)
    assert farewell.text() == "mission planner: accepted, autopilot: accepted"


def test_who_waits_can_do_meanwhile_what_brings_the_replies():
    """Where the thread that decides has ended, nobody else reads them."""
    farewell, came = Watched(), [(SHUTDOWN, (LAND, SECOND)), (reply(1), ()), (reply(2), ())]
    farewell.wait(5.0, lambda: farewell.see(*came.pop(0)))
    assert came == []
    assert farewell.text() == "mission planner: accepted, autopilot: accepted"


def test_a_reply_ends_the_wait_at_once():
    farewell = Watched()
    farewell.see(SHUTDOWN, (LAND, SECOND))
    farewell.see(reply(1), ())
    threading.Timer(0.05, lambda: farewell.see(reply(2), ())).start()
    assert not waits(farewell, 5.0)


def test_a_route_that_failed_may_still_accept_a_repetition():
    farewell = Watched()
    farewell.see(SHUTDOWN, (LAND, SECOND))
    farewell.see(reply(1), ())
    farewell.see(reply(2, Outcome.UNAVAILABLE), ())
    assert waits(farewell)
    assert farewell.text() == "mission planner: accepted, autopilot: unavailable"
    farewell.see(Tick(t_ns=3), (replace(SECOND, id=3),))
    farewell.see(reply(3), ())
    assert not waits(farewell, 5.0)


def test_a_shutdown_while_a_takeover_is_suspected_is_waited_for_until_it_is_known_who_flies():
    """The engine keeps the signal meanwhile: denied, LAND goes out; confirmed, the pilot flies."""
    farewell = Watched()
    farewell.see(SHUTDOWN, (), EngineState(signal="SIGINT"))
    assert waits(farewell)
    farewell.see(Tick(t_ns=2), (LAND, SECOND))
    assert waits(farewell)
    farewell.see(reply(1), ())
    farewell.see(reply(2), ())
    assert not waits(farewell, 5.0)
    assert farewell.text() == "mission planner: accepted, autopilot: accepted"


def test_a_shutdown_whose_takeover_is_confirmed_is_over():
    farewell = Watched()
    farewell.see(SHUTDOWN, (), EngineState(signal="SIGINT"))
    farewell.see(Tick(t_ns=2), ())
    assert not waits(farewell, 5.0)


def test_what_was_sent_before_the_shutdown_does_not_count():
    farewell = Watched()
    farewell.see(Tick(t_ns=0), (LAND, SECOND))
    farewell.see(SHUTDOWN, ())
    farewell.see(reply(1), ())
    assert farewell.text() == ""


def ending(*, exit_when_ended=True):
    reasons = []
    return Ending(reasons.append, SHIPPED, exit_when_ended=exit_when_ended), reasons


def see(watched, *states, result=Result.NONE, queue=()):
    for state in states:
        watched.see(Tick(t_ns=1), EngineState(state=state, queue=queue, session=Session(result=result)))


def test_the_end_of_the_last_mission_ends_the_node():
    watched, reasons = ending()
    see(watched, State.PREFLIGHT, State.MISSION, State.DATA_CLEANUP)
    assert reasons == []
    see(watched, State.MISSION_ENDED, State.MISSION_ENDED, result=Result.COMPLETE)
    assert (reasons, watched.results) == (["mission ended"], [Ended(Result.COMPLETE)])


def test_a_mission_that_waits_is_still_flown():
    watched, reasons = ending()
    see(watched, State.PREFLIGHT)
    see(watched, State.MISSION_ENDED, result=Result.COMPLETE, queue=(Mission(id="2"),))
    assert reasons == []


def test_a_mission_that_was_given_up_was_not_flown():
    watched, reasons = ending()
    see(watched, State.PREFLIGHT, State.OUTREACH, State.MISSION_INPUT)
    assert (reasons, watched.results) == (["mission ended"], [Ended(Result.NOT_FLOWN)])


def test_the_next_mission_is_selected_after_an_end():
    watched, _ = ending()
    see(watched, State.PREFLIGHT)
    see(watched, State.MISSION_ENDED, State.MISSION_INPUT, result=Result.PILOT)
    assert watched.results == [Ended(Result.PILOT)]


def test_the_node_stays_when_it_is_not_asked_to_end():
    watched, reasons = ending(exit_when_ended=False)
    see(watched, State.PREFLIGHT, State.MISSION_ENDED)
    assert reasons == []


class Followed:
    """A story each step of which is seen, until the engine's process is killed and another one goes on."""

    def __init__(self, *missions):
        self.story, self.events = Story(SHIPPED, *missions), []
        self.watched, self.reasons = ending()
        self.timeline = Timeline()
        self.story.watch.append(self.see)
        self.story.start().after(0.5).select()

    def see(self, story, _before, event, commands):
        self.events.append(event)
        self.timeline.take(event.t_ns, commands)
        self.watched.see(event, story.state)

    def goes_on_in_another_process(self):
        self.watched, self.reasons = ending()
        before, self.timeline = self.timeline.text(), Timeline()
        state = decided_again(list(self.events), SHIPPED, MessageLog(), self.watched, self.timeline)
        assert self.timeline.text() == before
        assert (state, self.reasons) == (self.story.state, [])
        self.story.feed(EngineStarted, label="test", resumed=True)

    @property
    def results(self):
        return [(each.result, each.data) for each in self.watched.results]

    @property
    def status(self):
        return exit_status(self.watched.results, self.story.state)

    @property
    def summary(self):
        return data_summary(self.watched.results, self.story.state)


def test_a_mission_that_the_queue_passes_on_from_counts_with_its_data():
    """One event ends it and begins the next: its end is no state between two events."""
    followed = Followed(MISSION, Mission(id="2"))
    story = followed.story.until("DATA_CLEANUP")
    story.recorder.says["lost"] = "second: 37.9 s"
    story.until("PREFLIGHT")
    assert followed.reasons == []
    story.recorder.says.clear()
    story.until("MISSION_ENDED")
    assert (followed.results, followed.status) == ([(Result.COMPLETE, LACKS), (Result.COMPLETE, WHOLE)], 6)
    assert followed.summary == "test-001: second: 37.9 s"
    assert followed.reasons == ["mission ended"]


def test_data_that_was_given_up_is_named_beside_that_of_the_next_mission():
    followed = Followed(MISSION)
    story = followed.story.until("DATA_CLEANUP")
    story.recorder.says.update(phase=RecordingPhase.FAILED, message="module2: no space left")
    story.until("OUTREACH").user("give_up")
    story.expect("MISSION_ENDED")
    assert followed.summary == "module2: no space left", "of one mission, what the recorder says"
    story.recorder.says.clear()
    story.after(5.0).select().until("MISSION_ENDED")
    assert (followed.results, followed.status) == ([(Result.COMPLETE, LACKS), (Result.COMPLETE, WHOLE)], 6)
    assert followed.summary == "test-001: module2: no space left"


def test_a_recorder_that_says_nothing_at_all_leaves_that_it_was_given_up():
    results = [Ended(Result.COMPLETE, LACKS, "test-001"), Ended(Result.COMPLETE, WHOLE, "test-002")]
    assert data_summary(results, EngineState()) == "test-001: given up"
    assert data_summary([], EngineState()) == ""


@pytest.mark.parametrize(
    "message, lost, flown_on, said",
    [
        ("verified", "", False, "verified"),
        ("verified; lost: 2 s", "2 s", False, "verified; lost: 2 s"),
        ("", "2 s", False, "2 s"),
        ("verified", "", True, "verified; what the vehicle flew on behind the end of the recording"),
    ],
)
def test_what_is_said_of_the_data_names_all_that_is_lost(message, lost, flown_on, said):
    recorder = RecordingStatus(t_ns=1, session_id="s", phase=RecordingPhase.COMPLETE, message=message, lost=lost)
    state = EngineState(peers=Peers(recorder=recorder), recording=Recording(flown_on=flown_on))
    assert endings.said_of_data(state) == said


def test_a_mission_that_is_ended_before_anything_is_recorded_is_not_flown():
    followed = Followed(MISSION)
    followed.story.until("PREFLIGHT").feed(Shutdown, signal="SIGINT")
    assert (followed.results, followed.status) == ([(Result.NOT_FLOWN, NOTHING)], 5)


def test_what_ended_before_a_restart_counts():
    followed = Followed(MISSION)
    followed.story.until("MISSION", "flying").user("land")
    followed.story.until("MISSION_ENDED").select().until("MISSION", "flying")
    followed.goes_on_in_another_process()
    assert followed.reasons == []
    followed.story.until("MISSION_ENDED")
    assert (followed.results, followed.status) == ([(Result.LANDED_EARLY, WHOLE), (Result.COMPLETE, WHOLE)], 3)
    assert followed.reasons == ["mission ended"]


def test_the_report_after_a_restart_tells_of_the_flight_before_it_too():
    followed = Followed(MISSION)
    followed.story.until("MISSION", "flying")
    followed.goes_on_in_another_process()
    followed.story.until("MISSION_ENDED")
    text = followed.timeline.text()
    steps = ["READY -> ", " -> MISSION/flying", "The engine was restarted", " -> MISSION_ENDED"]
    assert sorted(steps, key=text.index) == steps, text
    assert text.startswith("     0.000 s  ")


def test_what_the_queue_passed_before_a_restart_counts():
    followed = Followed(MISSION, Mission(id="2"))
    followed.story.until("DATA_CLEANUP").until("START_RECORDING")
    followed.goes_on_in_another_process()
    followed.story.until("MISSION_ENDED")
    assert (followed.results, followed.status) == ([(Result.COMPLETE, WHOLE)] * 2, 0)


def test_a_process_that_is_killed_before_it_has_written_the_result_is_ended_by_the_next():
    followed = Followed(MISSION)
    followed.story.until("MISSION_ENDED")
    followed.goes_on_in_another_process()
    assert followed.reasons == ["mission ended"]
    assert (followed.results, followed.status) == ([(Result.COMPLETE, WHOLE)], 0)
    followed.story.after(1.0)
    assert followed.reasons == ["mission ended"], "said once"


def test_a_process_that_is_killed_after_a_mission_was_given_up_is_ended_by_the_next():
    followed = Followed(MISSION)
    followed.story.user("give_up")
    followed.story.expect("MISSION_INPUT")
    followed.goes_on_in_another_process()
    assert (followed.reasons, followed.results, followed.status) == (
        ["mission ended"],
        [(Result.NOT_FLOWN, NOTHING)],
        5,
    )


def test_a_mission_that_waits_is_not_flown_by_the_next_process_and_the_one_before_it_counts_once():
    """Told to end while data was collected, then killed: nothing was passed on, and nobody has the rest in mind."""
    followed = Followed(MISSION, Mission(id="2"))
    followed.story.until("DATA_CLEANUP").feed(Shutdown, signal="SIGTERM")
    followed.story.until("MISSION_ENDED")
    followed.goes_on_in_another_process()
    followed.story.expect("MISSION_ENDED")
    assert followed.story.state.queue == ()
    assert followed.results == [(Result.COMPLETE, WHOLE)]


def test_a_process_that_starts_with_nothing_waits_for_a_mission():
    watched, reasons = ending()
    see(watched, State.MISSION_INPUT, State.MISSION_INPUT)
    assert (reasons, watched.results) == ([], [])


def at(state, *, in_flight=False):
    return EngineState(state=state, flight=Flight(active=in_flight))


@pytest.mark.parametrize(
    "results, state, words, status",
    [
        ([], at(State.MISSION_INPUT), "NO_MISSION", 0),
        ([Ended(Result.COMPLETE)], at(State.MISSION_ENDED), "COMPLETE", 0),
        ([Ended(Result.LANDED_EARLY)], at(State.MISSION_ENDED), "LANDED_EARLY", 3),
        ([Ended(Result.PILOT)], at(State.MISSION_ENDED), "PILOT", 4),
        ([Ended(Result.NOT_FLOWN)], at(State.MISSION_INPUT), "NOT_FLOWN", 5),
        ([], at(State.START_RECORDING), "INTERRUPTED", 7),
        ([Ended(Result.COMPLETE)], at(State.MISSION, in_flight=True), "INTERRUPTED_IN_FLIGHT", 8),
    ],
)
def test_the_exit_status_is_the_worst_that_happened(results, state, words, status):
    assert (outcome(results, state), exit_status(results, state)) == (words, status)


@pytest.mark.parametrize(
    "results, state, words, data, status",
    [
        ([Ended(Result.COMPLETE, WHOLE)], at(State.MISSION_ENDED), "COMPLETE", WHOLE, 0),
        ([Ended(Result.COMPLETE, LACKS)], at(State.MISSION_ENDED), "COMPLETE", LACKS, 6),
        ([Ended(Result.LANDED_EARLY, LACKS)], at(State.MISSION_ENDED), "LANDED_EARLY", LACKS, 6),
        ([Ended(Result.COMPLETE, LACKS), Ended(Result.COMPLETE, WHOLE)], at(State.MISSION_ENDED), "COMPLETE", LACKS, 6),
        ([Ended(Result.COMPLETE, LACKS)], at(State.MISSION, in_flight=True), "INTERRUPTED_IN_FLIGHT", LACKS, 8),
        ([Ended(Result.NOT_FLOWN)], at(State.MISSION_INPUT), "NOT_FLOWN", DataResult.NONE, 5),
    ],
)
def test_what_became_of_the_data_is_said_apart_and_has_a_status_of_its_own(results, state, words, data, status):
    assert (outcome(results, state), data_outcome(results), exit_status(results, state)) == (words, data, status)


# --- the end of the thread that decides -------------------------------------------------------------------------------


def test_a_reason_to_end_is_waited_for():
    reasons = SimpleQueue()
    threading.Timer(0.05, lambda: reasons.put("SIGINT")).start()
    assert first_reason(reasons, lambda: True) == "SIGINT"


def test_the_first_reason_counts_also_beside_a_thread_that_has_ended():
    reasons = SimpleQueue()
    for reason in ("SIGTERM", "SIGINT"):
        reasons.put(reason)
    assert first_reason(reasons, lambda: False) == "SIGTERM"


def test_the_end_of_the_thread_that_decides_is_noticed_within_a_quarter_of_a_second():
    alive = [True]
    threading.Timer(0.05, alive.clear).start()
    began_s = time.monotonic()
    assert first_reason(SimpleQueue(), lambda: bool(alive)) == ENGINE_ENDED
    assert time.monotonic() - began_s < 0.05 + 0.25 + 0.2


@pytest.mark.parametrize("alive, turns, goes_on", [(True, 1, True), (True, 0, False), (False, 1, False)])
def test_threads_go_on_that_live_and_of_which_the_one_that_decides_has_turned_within_five_seconds(
    alive, turns, goes_on
):
    seen = iter(range(0, 10_000, turns) if turns else [7] * 100)
    pulse = Pulse(lambda: alive, lambda: next(seen))
    assert [pulse.look() for _ in range(25)] == [alive] * 25
    assert (pulse.look(), pulse.hangs) == (goes_on, turns == 0)


def test_a_thread_that_turns_again_in_time_does_not_hang():
    turns = [*[1] * 25, 2, *[2] * 24]
    pulse = Pulse(lambda: True, lambda: turns.pop(0))
    assert [pulse.look() for _ in range(50)] == [True] * 50


ANEW = """\
import fcntl, os, sys, threading
sys.argv[1:2] == ["a word"] or sys.exit("its words are lost")
print("born", os.getpid(), flush=True)
lock = os.open("lock", os.O_RDWR | os.O_CREAT)
fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
if "AGAIN" not in os.environ:
    os.environ["AGAIN"] = "yes"
    threading.Thread(target=threading.Event().wait).start()
    from amaze_autonomy.nodes.autonomy.ending import start_anew
    start_anew()
print("ended", threading.active_count())
"""


def test_a_process_that_starts_anew_keeps_its_id_and_words_and_nothing_else(tmp_path):
    (tmp_path / "program.py").write_text(ANEW, encoding="utf-8")
    command = [sys.executable, "program.py", "a word", "ä b"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, cwd=tmp_path, **pipes) as process:
        said = process.communicate(timeout=30.0)[0]
    assert said == f"born {process.pid}\nborn {process.pid}\nended 1\n"
    assert process.returncode == 0


def test_a_process_that_cannot_start_anew_says_so_and_goes_on_to_its_end(monkeypatch, capsys):
    def refuse(*_):
        raise OSError(12, os.strerror(12))

    monkeypatch.setattr(endings.os, "execv", refuse)
    start_anew()
    assert capsys.readouterr().err == "autonomy: it cannot start anew: Cannot allocate memory\n"


def test_an_engine_that_has_failed_has_a_status_of_its_own():
    assert EXIT_STATUS["ENGINE_FAILED"] == 9
    assert list(EXIT_STATUS.values()) == [0, 0, *range(3, 10)], "one each, but for the two of no trouble"
