"""Every request ends as exactly one reply, whatever its peer does; the peers' side reads what this side writes."""

from __future__ import annotations

import time
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


class Client:
    """A service client of which the test says what comes of a call."""

    spare = 0

    def __init__(self, name, ends, connected):
        self.name, self._ends, self._connected = name, ends, connected
        self.sent = []

    def serialize(self, request):
        return request

    def send_now(self, data):
        if not self._connected:
            return None
        self.sent.append(data)
        return "connection"

    def call(self, data, _deadline_s):
        self.sent.append(data)
        return self._end()

    def finish(self, _connection, _deadline_s):
        return self._end()

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
