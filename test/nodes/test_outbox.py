"""What was decided goes out whatever the disk does; what the node itself has to say reaches the operator, too."""

from __future__ import annotations

import shutil
import sys
import threading
import time
from functools import partial
from types import SimpleNamespace

import pytest
from waiting import wait_for

pytest.importorskip("rospy")

from diagnostic_updater import DiagnosticStatusWrapper

from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.commands import Level, Notify
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import Event, Tick
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.journal.journal import read
from amaze_autonomy.journal.report import MessageLog, end_on_the_way
from amaze_autonomy.nodes.autonomy import journal_file, outbox
from amaze_autonomy.nodes.autonomy.journal_file import create
from amaze_autonomy.nodes.autonomy.outbox import Diagnostics, Outbox, PeerClocks, StatePublisher, Timeline
from amaze_autonomy.nodes.autonomy.run_folder import Place
from amaze_autonomy.paths import config_folder
from amaze_autonomy.ros.clock import SimulatedClock
from amaze_autonomy.simulation.run import run as simulate
from amaze_autonomy.simulation.scenario import Scenario

CLOCK = SimulatedClock(lambda: 10**9)


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(outbox, "JournalTopic", lambda *_: SimpleNamespace(close=lambda _: None))
    folder = tmp_path / "out"
    folder.mkdir()
    return create(folder, '{"kind":"header","version":1}', Place(str(folder)).elsewhere)


class Outboxes:
    """An outbox that notes when it has published the state."""

    def __init__(self, journal):
        self.published_s, self.moved = [], []
        self.made = Outbox(
            journal,
            Timeline(),
            CLOCK,
            lambda _: self.published_s.append(time.monotonic()),
            lambda *_: None,
            lambda: None,
            lambda: self.moved.append(journal.path),
        )

    def longest_gap_s(self):
        return max(after - before for before, after in zip(self.published_s, self.published_s[1:]))


class SlowDisk:
    """A disk that takes its time to keep what was written."""

    def __init__(self, monkeypatch, takes_s):
        self.descriptors, self.at_once, self.most = [], 0, 0
        self._takes_s, self._lock = takes_s, threading.Lock()
        monkeypatch.setattr(journal_file.os, "fdatasync", self.sync)

    def sync(self, descriptor):
        with self._lock:
            self.descriptors.append(descriptor)
            self.at_once += 1
            self.most = max(self.most, self.at_once)
        time.sleep(self._takes_s)
        with self._lock:
            self.at_once -= 1


@pytest.mark.live
def test_a_disk_that_takes_seconds_silences_no_state(run, monkeypatch):
    disk = SlowDisk(monkeypatch, 3.1)
    box = Outboxes(run)
    began_s = time.monotonic()
    box.made.start(EngineState())
    for number in range(40):
        box.made.put(Tick(t_ns=number), EngineState(), ())
        time.sleep(0.1)
    assert box.longest_gap_s() < 2.0
    assert disk.most == 1, "one at a time"
    assert 2 <= len(disk.descriptors) <= 1 + (time.monotonic() - began_s) / 3.1, "none waits for its turn"
    box.made.stop()


@pytest.mark.parametrize("trouble", [OSError(24, "Too many open files"), RuntimeError("can't start new thread")])
def test_a_disk_that_cannot_be_asked_is_said_and_asked_again(run, monkeypatch, trouble):
    def refused(*_, **__):
        raise trouble

    run.append("a")
    run.flush()
    with monkeypatch.context() as patched:
        patched.setattr(journal_file.os, "dup", refused)
        if isinstance(trouble, RuntimeError):
            patched.setattr(journal_file.threading, "Thread", refused)
        run.sync()
    assert run.problem == f"{run.path}: {trouble}"
    run.sync()
    wait_for(lambda: run.problem == "")
    run.close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_what_is_left_when_its_thread_has_ended_is_written_by_who_stops_it(run):
    made = Outboxes(run).made
    made.start(EngineState())
    made.log(sys.exit)
    wait_for(lambda: not made.alive)
    made.put(Tick(t_ns=7), EngineState(), ())
    made.stop()
    assert [line.payload for line in read(run.path.read_text()).lines][1:] == [Tick(t_ns=7)]


def test_the_end_of_a_mission_goes_out_also_where_one_event_ends_it_and_begins_the_next(run):
    configuration = load_configuration(config_folder())
    missions = {each.id: each for each in configuration.missions}
    lines = simulate(configuration, (missions["2"], missions["1"]), Scenario()).lines
    published = []
    ended = partial(end_on_the_way, rules=configuration.rules)
    box = Outbox(run, Timeline(), CLOCK, published.append, lambda *_: None, lambda: None, ended=ended)
    state = EngineState()
    for payload in (line.payload for line in read("\n".join(lines) + "\n").lines):
        if isinstance(payload, Event):
            state, commands = decide(state, payload, configuration.rules)
            box.put(payload, state, commands)
    box.start(state)
    box.stop()
    states = [
        (each.state.value, each.session.id, each.session.mission.id, each.session.result.value, len(each.queue))
        for before, each in zip(published, published[1:])
        if before.state is not each.state and each.session.mission is not None
    ]
    first, second = states[0][1], states[-1][1]
    at = states.index(("MISSION_ENDED", first, "2", "COMPLETE", 1))
    assert (states[at - 1][0], states[at + 1]) == ("DATA_CLEANUP", ("PREFLIGHT", second, "1", "", 0))
    assert states[-1] == ("MISSION_ENDED", second, "1", "COMPLETE", 0)
    assert [each[0] for each in states].count("MISSION_ENDED") == 2


def test_what_is_shown_is_in_the_journal(run):
    """So that a kill takes nothing that people have seen."""
    shown = []

    def show(state):
        shown.append((state.t_ns, len(run.path.read_text().splitlines()) - 1))

    box = Outbox(run, Timeline(), CLOCK, show, lambda *_: None, lambda: None)
    box.start(EngineState())
    for number in range(1, 201):
        said = Notify(level=Level.INFO, key="x", text=f"{number}", advice="")
        box.put(Tick(t_ns=number), EngineState(t_ns=number), (said,))
    box.stop()
    assert {t_ns for t_ns, _ in shown} >= set(range(1, 201))
    assert [(t_ns, lines) for t_ns, lines in shown if lines < t_ns] == []


@pytest.mark.live
def test_a_disk_that_holds_up_a_write_for_ever_silences_neither_state_nor_messages(run, monkeypatch):
    answers, write = threading.Event(), journal_file.os.write
    monkeypatch.setattr(journal_file, "_HELD_UP_S", 0.2)
    monkeypatch.setattr(journal_file.os, "write", lambda *words: answers.wait(30.0) and write(*words))
    states, messages, logged = [], [], []
    monkeypatch.setitem(outbox._SAY, Level.ALARM, lambda _, text, advice: logged.append(text + advice))
    box = Outbox(run, Timeline(), CLOCK, states.append, lambda t_ns, _: messages.append(t_ns), lambda: None)
    box.start(EngineState())
    for number in range(1, 4):
        alarm = Notify(level=Level.ALARM, key="x", text=f"{number}", advice="")
        box.put(Tick(t_ns=number), EngineState(t_ns=number), (alarm,))
        wait_for(lambda number=number: number in {each.t_ns for each in states} and number in messages)
    box.put(Tick(t_ns=9), EngineState(t_ns=9), ())
    wait_for(lambda: 9 in {each.t_ns for each in states})
    wait_for(lambda: run.remarks)
    assert run.remarks[0].startswith(f"The journal cannot be written: {run.path}: the disk has not answered for more")
    assert logged == []
    assert box.alive
    answers.set()
    wait_for(lambda: not run.remarks and logged == ["1", "2", "3"])
    box.stop()
    assert [line.payload for line in read(run.path.read_text()).lines][1:] == [Tick(t_ns=t_ns) for t_ns in (1, 2, 3, 9)]


# --- what the node says itself ----------------------------------------------------------------------------------------


def test_a_folder_that_is_removed_in_flight_is_told_to_the_operator(run, tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr(outbox.rospy, "Publisher", lambda *_, **__: SimpleNamespace(publish=said.append))
    monkeypatch.setattr(outbox.diagnostic_updater, "Updater", Updater)
    publisher = StatePublisher(Rules(), CLOCK, lambda: run.remarks, "run", MessageLog(), 0.0)
    diagnostics = Diagnostics(EngineState, run, {}, {}, lambda: 0, PeerClocks(Rules().limits), tuple)
    box = Outboxes(run)
    shutil.rmtree(tmp_path / "out")
    box.made._keep()
    assert box.moved == [run.path] == [tmp_path / "out" / "journal.jsonl"]
    words = f"The journal was removed: {run.path}. It is there again, whole."
    publisher.publish(EngineState())
    assert [each.advice for each in said if hasattr(each, "advice")] == [words]
    assert diagnostics._updater.row("journal") == (1, words)


def test_what_is_left_out_of_long_lists_is_counted_on_diagnostics(run, monkeypatch):
    monkeypatch.setattr(outbox.diagnostic_updater, "Updater", Updater)
    left_out = {"watchdog/info components": 1900}
    diagnostics = Diagnostics(EngineState, run, {}, left_out, lambda: 0, PeerClocks(Rules().limits), tuple)
    assert diagnostics._updater.row("inputs") == (1, "entries of too long lists were left out")
    assert diagnostics._updater.rows["inputs"] == {
        "left out on watchdog/info components": "1900",
        "calls that wait": "0",
    }


def test_a_disk_that_cannot_be_written_is_told_to_the_operator(run, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    assert run.remarks == ()
    run.append("a")
    with monkeypatch.context() as patched:
        patched.setattr(journal_file.os, "write", full)
        run.flush()
    assert run.remarks == (
        f"The journal cannot be written: {run.path}: No space left on device."
        " The engine goes on; check the disk, and make room on it.",
    )
    run.flush(force=True)
    assert run.remarks == ()


class Updater:
    """In the place of the one of diagnostic_updater."""

    def __init__(self):
        self._rows, self.rows = {}, {}

    def setHardwareID(self, _):  # noqa: N802
        """Be told."""

    def add(self, name, row):
        self._rows[name] = row

    def row(self, name):
        status = DiagnosticStatusWrapper()
        self._rows[name](status)
        self.rows[name] = {each.key: each.value for each in status.values}
        return status.level if isinstance(status.level, int) else status.level[0], status.message


def test_what_the_disk_could_not_keep_is_said_until_it_can(run, monkeypatch):
    failing = threading.Event()

    def sync(_descriptor):
        if failing.is_set():
            raise OSError(5, "Input/output error")

    monkeypatch.setattr(journal_file.os, "fdatasync", sync)
    for fails, problem in ((True, f"{run.path}: Input/output error"), (False, "")):
        (failing.set if fails else failing.clear)()
        run.append("a")
        run.flush()
        run._synced_s = 0.0
        run.sync()
        wait_for(lambda problem=problem: run.problem == problem)
    run.close()
