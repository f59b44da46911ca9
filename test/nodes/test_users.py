"""The user's services: each is answered by the engine, or says truthfully what becomes of an unanswered request."""

from __future__ import annotations

import threading
import time
from queue import SimpleQueue

import pytest

rospy = pytest.importorskip("rospy")

from rospy.impl.tcpros import init_tcpros  # noqa: E402
from rospy.impl.tcpros_base import get_tcpros_server_address  # noqa: E402
from rospy.impl.tcpros_service import get_service_manager  # noqa: E402

from amaze_autonomy import srv  # noqa: E402
from amaze_autonomy.console.link import AnswerCame  # noqa: E402
from amaze_autonomy.console.model import Request, RequestKind, Verdict  # noqa: E402
from amaze_autonomy.console.ros_link import RosLink  # noqa: E402
from amaze_autonomy.engine.commands import Answer, AnswerKind  # noqa: E402
from amaze_autonomy.engine.events import (  # noqa: E402
    SAFE,
    EngineStarted,
    Mission,
    MissionSelected,
    UserCommand,
    UserRequest,
)
from amaze_autonomy.engine.rules import Rules  # noqa: E402
from amaze_autonomy.engine.state import EngineState, Session, State, evolve  # noqa: E402
from amaze_autonomy.nodes.autonomy import users  # noqa: E402
from amaze_autonomy.nodes.autonomy.engine_thread import EngineThread, Inbox  # noqa: E402
from amaze_autonomy.nodes.autonomy.users import UserDesk  # noqa: E402
from amaze_autonomy.ros.asker import AskedService  # noqa: E402
from amaze_autonomy.ros.clock import MonotonicClock  # noqa: E402
from amaze_autonomy.ros.service_client import ServiceClient  # noqa: E402

LIMIT_S = 60.0
COMMAND = "/autonomy/command"
MAYBE = "the engine did not answer in time; the command may still be carried out"
NEVER = "the engine did not answer in time; the command is not carried out"
UNSAFE = [each for each in UserCommand if each not in SAFE]
MISSIONS = (Mission(id="1", battery_needed_fraction=0.3, estimated_duration_s=60.0),)
OTHER = Mission(id="7", battery_needed_fraction=0.3, estimated_duration_s=60.0)


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(users, "_ANSWER_LIMIT_S", 0.1)


@pytest.fixture
def asked():
    return SimpleQueue()


@pytest.fixture
def desk(asked):
    return UserDesk(MISSIONS, asked.put, lambda: 5)


def command(desk, each):
    return desk._named(srv.UserCommandRequest(command=each.value))


class Asking(threading.Thread):
    """A user who asks, on a thread of its own; `result` is the answer, or what was raised."""

    def __init__(self, ask, *values):
        super().__init__(daemon=True)
        self._ask, self._values, self.result = ask, values, None
        self.start()

    def run(self):
        try:
            self.result = self._ask(*self._values)
        except rospy.ServiceException as error:
            self.result = error

    def end(self):
        self.join(LIMIT_S)
        return self.result


# --- a request and its answer ---


@pytest.mark.parametrize("each", list(UserCommand))
def test_a_command_is_put_and_answered_as_the_engine_says(monkeypatch, desk, asked, each):
    monkeypatch.setattr(users, "_ANSWER_LIMIT_S", LIMIT_S)
    user = Asking(command, desk, each)
    event = asked.get(timeout=LIMIT_S)
    assert event == UserRequest(t_ns=5, command=each, request_id=1)
    assert desk.take_up(event)
    desk.answer(Answer(request_id=1, answer=AnswerKind.ALREADY, message="It is so."))
    assert user.end() == srv.UserCommandResponse(answer=3, message="It is so.")


# --- without an answer ---


@pytest.mark.parametrize("each", UNSAFE)
def test_what_nobody_waits_for_any_more_is_not_taken_up_and_its_user_was_told_so(desk, asked, each):
    with pytest.raises(rospy.ServiceException, match=f"^{NEVER}$"):
        command(desk, each)
    assert not desk.take_up(asked.get(timeout=LIMIT_S))


@pytest.mark.parametrize("each", SAFE)
def test_what_stops_the_vehicle_is_taken_up_though_nobody_waits_for_it_any_more(desk, asked, each):
    with pytest.raises(rospy.ServiceException, match=f"^{MAYBE}$"):
        command(desk, each)
    assert desk.take_up(asked.get(timeout=LIMIT_S))


def test_what_was_taken_up_in_time_and_not_answered_may_still_be_carried_out(monkeypatch, desk, asked):
    monkeypatch.setattr(users, "_ANSWER_LIMIT_S", 1.0)
    user = Asking(command, desk, UserCommand.GO)
    assert desk.take_up(asked.get(timeout=LIMIT_S))
    assert str(user.end()) == MAYBE
    desk.answer(Answer(request_id=1, answer=AnswerKind.DONE))  # reaches nobody


def test_a_command_without_messages_of_ours_fails_in_the_same_words(desk):
    with pytest.raises(rospy.ServiceException, match=f"^{NEVER}$"):
        desk._triggered(UserCommand.GO, None)


@pytest.mark.parametrize("ids", [["1"], ["2"], []])
def test_a_selection_that_nobody_waits_for_any_more_is_not_taken_up(desk, asked, ids):
    with pytest.raises(rospy.ServiceException, match=f"^{NEVER}$"):
        desk._select(srv.SelectMissionRequest(mission_ids=ids))
    assert not desk.take_up(asked.get(timeout=LIMIT_S))


@pytest.mark.parametrize(
    "event",
    [
        MissionSelected(t_ns=5, missions=MISSIONS),
        *(UserRequest(t_ns=5, command=each) for each in UserCommand),
    ],
    ids=str,
)
def test_what_no_user_waits_for_by_its_nature_is_taken_up(desk, event):
    """The mission of a parameter, the switch of the transmitter, who answers in a user's place."""
    assert desk.take_up(event)


def test_of_what_no_user_asks_nobody_is_asked_whether_it_is_wanted(monkeypatch, engine):
    """A status that lands the vehicle goes by no lock that a user's thread has."""
    asked = []
    monkeypatch.setattr(engine.thread, "_take_up", lambda event: asked.append(event) or True)
    for event in (EngineStarted(t_ns=2), UserRequest(t_ns=3, command=UserCommand.LAND), EngineStarted(t_ns=4)):
        engine.inbox.put(event)
    assert [each.t_ns for each in engine.end()[1]] == [1, 2, 3, 4]
    assert asked == [UserRequest(t_ns=3, command=UserCommand.LAND)]


def test_an_answer_that_comes_with_the_limit_is_given_and_not_lost(monkeypatch, desk):
    monkeypatch.setattr(users, "_ANSWER_LIMIT_S", 0.0)
    done = Answer(request_id=1, answer=AnswerKind.DONE, message="Starting.")
    monkeypatch.setattr(desk, "_put", lambda event: desk.take_up(event) and desk.answer(done))
    for number in range(1, 200):
        done = Answer(request_id=number, answer=AnswerKind.DONE, message="Starting.")
        assert command(desk, UserCommand.GO).message == "Starting."


@pytest.mark.live
def test_who_is_told_that_it_is_not_carried_out_is_told_the_truth_however_close_it_was(monkeypatch):
    """Each way to end, at about the same moment on both sides: it was taken up, or its user knows that it never is."""
    monkeypatch.setattr(users, "_ANSWER_LIMIT_S", 0.001)
    taken, inbox = set(), SimpleQueue()
    desk = UserDesk(MISSIONS, inbox.put, lambda: 5)

    def take_up():
        for event in iter(inbox.get, None):
            time.sleep(event.request_id % 20 * 1e-4)
            if desk.take_up(event):
                taken.add(event.request_id)
                desk.answer(Answer(request_id=event.request_id, answer=AnswerKind.DONE))

    engine = threading.Thread(target=take_up, daemon=True)
    engine.start()
    told = {}
    for number in range(1, 501):
        try:
            told[number] = command(desk, UserCommand.GO).answer == AnswerKind.DONE.value
        except rospy.ServiceException as error:
            told[number] = str(error)
    inbox.put(None)
    engine.join(LIMIT_S)
    assert {number for number, words in told.items() if words == NEVER} == set(told) - taken
    assert NEVER in told.values(), "it was never late"


# --- with the engine's thread, and the console -----------------------------------------------------------------------


class Engine:
    """The thread that decides, which hangs in the decision about its start until it is let go on."""

    def __init__(self):
        self.hangs, self.goes_on = threading.Event(), threading.Event()
        self.decided, self.recorded = SimpleQueue(), SimpleQueue()
        clock = MonotonicClock()
        self.inbox = Inbox(clock)
        self.desk = UserDesk(MISSIONS, self.inbox.put, clock.now_ns)
        self.thread = EngineThread(
            self._decide,
            lambda *_: None,
            Rules(),
            clock,
            self.inbox,
            print,
            self.desk.answer,
            lambda event, *_: self.recorded.put(event),
            take_up=self.desk.take_up,
        )
        self.thread.start()
        self.inbox.put(EngineStarted(t_ns=1))
        assert self.hangs.wait(LIMIT_S)

    def _decide(self, state, event, _rules):
        self.decided.put(event)
        if isinstance(event, EngineStarted):
            self.hangs.set()
            self.goes_on.wait(LIMIT_S)
            return evolve(state, t_ns=event.t_ns), ()
        return evolve(state, t_ns=event.t_ns), (Answer(request_id=event.request_id, answer=AnswerKind.DONE),)

    def end(self):
        """Let it go on to its end; return what was decided about and what was recorded."""
        self.goes_on.set()
        self.thread.stop(LIMIT_S)
        return [list(iter(queue.get, None)) for queue in (self.decided, self.recorded) if queue.put(None) is None]


@pytest.fixture
def engine():
    made = Engine()
    yield made
    made.goes_on.set()
    made.thread.stop(LIMIT_S)


def test_an_engine_that_hung_decides_about_a_landing_and_not_about_a_takeoff_and_its_journal_has_only_that(engine):
    for each in (UserCommand.GO, UserCommand.LAND):
        with pytest.raises(rospy.ServiceException):
            command(engine.desk, each)
    decided, recorded = engine.end()
    assert [getattr(each, "command", None) for each in decided] == [None, UserCommand.LAND]
    assert recorded == decided


def test_a_takeoff_that_is_still_waited_for_is_decided_about_when_the_engine_goes_on(monkeypatch, engine):
    monkeypatch.setattr(users, "_ANSWER_LIMIT_S", LIMIT_S)
    user = Asking(command, engine.desk, UserCommand.GO)
    threading.Timer(0.1, engine.goes_on.set).start()
    assert user.end().answer == AnswerKind.DONE.value


def test_a_defect_of_the_taking_up_keeps_nothing_from_being_decided(monkeypatch, engine, caplog):
    def broken(_event):
        raise KeyError("a defect")

    monkeypatch.setattr(engine.thread, "_take_up", broken)
    for t_ns in (2, 3):
        engine.inbox.put(UserRequest(t_ns=t_ns, command=UserCommand.GO))
    assert [each.t_ns for each in engine.end()[1]] == [1, 2, 3]
    assert caplog.text.count("the engine could not take up") == 1


@pytest.fixture
def console(monkeypatch, desk):
    """What a console is answered by the desk, over real sockets and without a master."""
    init_tcpros()
    service = AskedService(COMMAND, srv.UserCommand, desk._named)
    monkeypatch.setattr(ServiceClient, "_look_up", lambda *_: get_tcpros_server_address())
    came = SimpleQueue()
    link = RosLink(came.put, None, quiet=False)
    link._services = {"command": ServiceClient(COMMAND, srv.UserCommand, "", "/console")}

    def ask(each):
        link.send(Request(RequestKind.COMMAND, 7, each))
        return came.get(timeout=LIMIT_S)

    yield ask
    get_service_manager().unregister(COMMAND, service)


@pytest.mark.live
@pytest.mark.parametrize("each, words", [(UserCommand.GO, NEVER), (UserCommand.LAND, MAYBE)])
def test_the_console_shows_a_request_without_an_answer_as_no_answer_and_in_these_words(console, each, words):
    said = f"{COMMAND}: failed: service cannot process request: {words}"
    assert console(each) == AnswerCame(7, Verdict.NO_ANSWER, said)


@pytest.mark.parametrize(
    "at, queue, words",
    [
        (State.HOLD, (), "has mission 1"),
        (State.READY, (OTHER,), "has missions 1, 7"),
        (State.MISSION_ENDED, (), "has ended its missions"),
        (State.MISSION_INPUT, (), "has ended its missions"),
    ],
)
def test_a_run_that_goes_on_says_with_which_mission_and_that_those_of_the_launch_are_not_used(at, queue, words):
    session = Session(mission=None if at is State.MISSION_INPUT else MISSIONS[0])
    state = evolve(EngineState(), state=at, session=session, queue=queue)
    assert users.not_selected(state, ("2", "3")) == (
        f"the run that is gone on with {words}; mission:=2,3 of this launch is not used"
    )
