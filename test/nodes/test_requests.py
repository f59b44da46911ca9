"""Every request ends as exactly one reply, whatever its peer does; the peers' side reads what this side writes."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from queue import SimpleQueue

import pytest

pytest.importorskip("rospy")

from amaze_autonomy import msg, srv
from amaze_autonomy.engine import commands
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import CheckName, CheckReply, Outcome, Reply
from amaze_autonomy.interface import CHECK_SERVICES, SERVICES
from amaze_autonomy.nodes.autonomy.requests import Requests
from amaze_autonomy.ros.errors import BrokenCallError, CallTimeoutError, UnavailableError
from amaze_autonomy.ros.interface import SERVICE_CLASSES, response_of

S = 1_000_000_000
HOUR = 3600 * S
COMMANDS = (
    commands.LoadMission(id=1, limit_ns=S, session_id="s", mission_id="m", file_index=2, repetition=3),
    *(commands.MissionCommand(id=2, limit_ns=S, session_id="s", action=action) for action in MissionAction),
    commands.StartRecording(id=3, limit_ns=S, session_id="s", mission_id="m"),
    commands.StopRecording(id=4, limit_ns=S, session_id="s"),
    commands.AutopilotLand(id=5, limit_ns=S),
    commands.AutopilotDisarm(id=6, limit_ns=S),
    commands.RunCheck(
        id=7, limit_ns=S, check=CheckName.WATCHDOG, mission_id="m", required=("lrf",), startup_time_ns=2 * S
    ),
    commands.RunCheck(id=8, limit_ns=S, check=CheckName.BATTERY, required_fraction=0.5),
    commands.RunCheck(id=8, limit_ns=S, check=CheckName.BATTERY),
    commands.RunCheck(id=9, limit_ns=S, check=CheckName.AUTOPILOT),
    commands.RunCheck(id=10, limit_ns=S, check=CheckName.ON_GROUND),
    commands.RunCheck(id=11, limit_ns=S, check=CheckName.STATE_ESTIMATION),
)


class Connection:
    """One connection of such a client."""

    closed = False

    def close(self):
        self.closed = True


class Client:
    """A service client of which the test says what comes of a call."""

    spare = 0

    def __init__(self, name, ends, connected):
        self.name, self._ends, self._connected = name, ends, connected
        self.sent, self.connection = [], Connection()

    def serialize(self, request):
        return request

    def send_now(self, data):
        if not self._connected:
            return None
        self.sent.append(data)
        return self.connection

    def call(self, data, _deadline_s):
        self.sent.append(data)
        return self._end()

    def finish(self, _connection, _deadline_s):
        return self._end()

    def keep(self, _limit_s):
        self.sent.append("kept")

    def _end(self):
        result = self._ends(self.name)
        if isinstance(result, Exception):
            raise result
        return result


def send(command, ends, *, connected=True):
    replies = SimpleQueue()
    clients = {name: Client(name, ends, connected) for name in SERVICES}
    requests = Requests(clients, replies.put, lambda: 77)
    requests.send(command)
    return replies.get(timeout=2.0), [(each.name, sent) for each in clients.values() for sent in each.sent], requests


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: type(command).__name__)
def test_the_peers_side_reads_the_same_command(command):
    _, [(name, request)], _ = send(command, lambda name: SERVICE_CLASSES[name]._response_class())
    read = SERVICES[name].command(request, command.id, HOUR)
    assert read.limit_ns == HOUR
    assert type(command)(**{**vars(read), "limit_ns": command.limit_ns}) == command


@pytest.mark.parametrize("connected", [True, False])
def test_a_request_is_sent_once(connected):
    _, sent, _ = send(COMMANDS[1], lambda name: SERVICE_CLASSES[name]._response_class(), connected=connected)
    assert len(sent) == 1


@pytest.mark.parametrize("outcome", [Outcome.ACCEPTED, Outcome.REFUSED])
@pytest.mark.parametrize("command", [each for each in COMMANDS if not isinstance(each, commands.RunCheck)])
def test_yes_and_no_come_through(command, outcome):
    answer = Reply(t_ns=77, command_id=command.id, outcome=outcome, message="because")
    reply, _, _ = send(command, lambda name: response_of(SERVICES[name], answer, 77))
    assert reply == answer


@pytest.mark.parametrize(
    "error, outcome",
    [
        (UnavailableError("no such service"), Outcome.UNAVAILABLE),
        (CallTimeoutError("did not answer within the limit"), Outcome.TIMED_OUT),
        (BrokenCallError("died in mid-call"), Outcome.BROKEN),
        (RuntimeError("a defect"), Outcome.BROKEN),
    ],
)
@pytest.mark.parametrize("command", [COMMANDS[0], COMMANDS[-1]], ids=lambda command: type(command).__name__)
def test_every_failure_has_its_outcome_and_names_its_service(command, error, outcome):
    reply, [(name, _)], requests = send(command, lambda _: error)
    assert (reply.command_id, reply.outcome, reply.t_ns) == (command.id, outcome, 77)
    assert reply.message.startswith(f"{name}: ")
    assert str(error) in reply.message
    assert isinstance(reply, CheckReply if isinstance(command, commands.RunCheck) else Reply)
    deadline = time.monotonic() + 2.0
    while requests.open and time.monotonic() < deadline:
        pass
    assert requests.open == {}


def test_an_answer_that_cannot_be_is_broken():
    bad = srv.CheckLandedResponse(on_ground=True, checks=[msg.Check(verdict=99)])
    command = next(each for each in COMMANDS if getattr(each, "check", None) is CheckName.ON_GROUND)
    reply, _, _ = send(command, lambda _: bad)
    assert (reply.outcome, reply.ok) == (Outcome.BROKEN, False)
    assert reply.message == "landing_detection/check: checks.verdict is 99, must be one of 1, 2, 3, 4"


def test_each_check_has_its_service():
    assert set(CHECK_SERVICES) == set(CheckName)
    assert {service.name for service in CHECK_SERVICES.values()} < set(SERVICES)


# --- threads ----------------------------------------------------------------------------------------------------------

LANDING = (
    commands.MissionCommand(id=20, limit_ns=S, session_id="s", action=MissionAction.LAND),
    commands.AutopilotLand(id=21, limit_ns=S),
)


class Peers:
    """Peers; those in `mute` answer only when the test ends. No thread can be started any more."""

    def __init__(self, monkeypatch, *, connected=True):
        self.mute, self._over = set(), threading.Event()
        self.replies = SimpleQueue()
        self.clients = {name: Client(name, self._answer, connected) for name in SERVICES}
        self.requests = Requests(self.clients, self.replies.put, lambda: 77)
        monkeypatch.setattr(threading.Thread, "start", lambda _: self._refuse())

    def _answer(self, name):
        if name in self.mute:
            self._over.wait(5.0)
        return SERVICE_CLASSES[name]._response_class()

    @staticmethod
    def _refuse():
        raise RuntimeError("can't start new thread")

    def reply(self):
        return self.replies.get(timeout=2.0).command_id

    def fill(self, command):
        """Ask until no thread is left; return how often."""
        self.mute.add("watchdog/start")
        for count in range(100):
            try:
                self.requests.send(replace(command, id=100 + count))
            except RuntimeError:
                return count
        raise AssertionError("there is no end of threads")

    def end(self):
        self._over.set()


@pytest.fixture
def peers(monkeypatch):
    peers = Peers(monkeypatch)
    yield peers
    peers.end()


def check(name):
    return next(each for each in COMMANDS if getattr(each, "check", None) is name)


def test_every_request_has_a_thread_from_the_start(peers):
    for command in COMMANDS:
        peers.requests.send(command)
        assert peers.reply() == command.id


def test_as_many_checks_as_there_are_and_a_command_are_open_at_once_without_a_new_thread(peers):
    assert peers.fill(check(CheckName.WATCHDOG)) >= len(CheckName) + 1


def test_a_landing_never_waits_behind_others(peers):
    peers.fill(check(CheckName.WATCHDOG))
    for command in LANDING:
        peers.requests.send(command)
    assert {peers.reply(), peers.reply()} == {20, 21}


def test_landings_that_nobody_answers_are_repeated_on_the_threads_of_others(peers):
    peers.mute |= {"mission_planner/command", "autopilot/land"}
    for command in LANDING * 6:
        peers.requests.send(command)
    sent = [len(peers.clients[name].sent) for name in ("mission_planner/command", "autopilot/land")]
    assert sent == [6, 6]


def test_who_asks_is_told_that_nobody_can_wait_for_the_answer(peers):
    count = peers.fill(check(CheckName.WATCHDOG))
    client = peers.clients["watchdog/start"]
    assert len(client.sent) == count + 1, "what cannot be answered went out all the same"
    assert client.connection.closed, "a late answer would be taken for that of the next request"
    assert sorted(peers.requests.open) == list(range(100, 100 + count)), "what was refused waits for no answer"


def test_a_landing_that_can_be_neither_sent_nor_waited_for_is_told(monkeypatch):
    peers = Peers(monkeypatch, connected=False)
    peers.fill(check(CheckName.WATCHDOG))
    peers.mute |= {"mission_planner/command"}
    for _ in range(6):
        peers.requests.send(LANDING[0])
    with pytest.raises(RuntimeError, match="can't start new thread"):
        peers.requests.send(LANDING[1])
    peers.end()


def test_connections_are_kept_again_once_there_is_a_thread_for_it(peers, caplog):
    for client in peers.clients.values():
        client.spare = 1
    peers.fill(check(CheckName.WATCHDOG))
    for _ in range(3):
        peers.requests.keep_connected()
    assert caplog.text.count("connections cannot be opened ahead of time") == 1
    peers.end()
    deadline_s = time.monotonic() + 2.0
    while "kept" not in peers.clients["autopilot/land"].sent and time.monotonic() < deadline_s:
        peers.requests.keep_connected()
    assert "kept" in peers.clients["autopilot/land"].sent


def test_an_answer_that_there_is_no_memory_for_is_said(caplog):
    reply, _, _ = send(COMMANDS[1], lambda _: MemoryError())
    assert reply.message == "mission_planner/command: MemoryError: "
    assert "the answer to mission_planner/command could not be taken" in caplog.text
