"""A takeoff is not carried out after its user was told that there is no answer, or has gone; a landing is.

Processes that are really stopped, and a network that is really away (which needs the right to make one: root).
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace
from urllib.parse import urlparse

import pytest
from waiting import wait_for

rospy = pytest.importorskip("rospy")

from amaze_autonomy.ros import asker as module  # noqa: E402
from amaze_autonomy.ros.asker import Asker, asker_of, note_accepted  # noqa: E402

LIMIT_S = 60.0
ENGINE_LIMIT_S, CONSOLE_LIMIT_S = 2.0, 1.0  # as in asking.py
MUCH_LATER_S = ENGINE_LIMIT_S + 2.0  # on a busy computer it takes a while before the asker has connected
REFUSED = "s ago, and the engine did not run; it is not carried out: look at the state and ask again"
TAKEN_BACK = "did not answer within the limit; it may have been carried out; if not by now, it is not any more"
pytestmark = pytest.mark.live


class Program:
    """A process of asking.py, in the network of another one; what it prints is read as it comes, and what it logs."""

    def __init__(self, *words, inside=()):
        command = [*inside, sys.executable, str(Path(__file__).with_name("asking.py")), *words]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, bufsize=1)
        self.lines, self.logged, self.seen = SimpleQueue(), SimpleQueue(), []
        for stream, lines in ((self.process.stdout, self.lines), (self.process.stderr, self.logged)):
            threading.Thread(target=self._read, args=(stream, lines), daemon=True).start()

    def _read(self, stream, lines):
        for line in stream:
            lines.put(line.strip())

    def line(self):
        """Return the next line."""
        self.seen.append(self.lines.get(timeout=LIMIT_S))
        return self.seen[-1]

    def until(self, words):
        while words not in self.line():
            pass
        return self.seen[-1]

    def until_logged(self, words):
        while words not in self.logged.get(timeout=LIMIT_S):
            pass

    def say(self, word):
        self.process.stdin.write(f"{word}\n")

    def send(self, number):
        self.process.send_signal(number)

    def stop(self):
        """Stop it, and wait until every thread stands: on a busy computer one may still read what comes."""
        self.send(signal.SIGSTOP)
        tasks = Path(f"/proc/{self.process.pid}/task")
        wait_for(lambda: all(") T " in (task / "stat").read_text("ascii") for task in tasks.iterdir()))

    def end(self):
        self.process.kill()
        self.process.wait()


class World:
    """The desk, those who ask it, and the network between them."""

    def __init__(self, begins=()):
        self._started = []
        self.inside = ()
        self.desk = self._start("desk", inside=begins)
        if begins:
            self.inside = ("nsenter", "-t", str(self.desk.process.pid), "-n")
        self.place = self.desk.until("rosrpc://")
        self.witness = self.user("proxy")

    def _start(self, *words, inside):
        self._started.append(Program(*words, inside=inside))
        return self._started[-1]

    def user(self, role):
        made = self._start(role, self.place, inside=self.inside)
        made.until("ready")
        return made

    def network(self, state):
        subprocess.run([*self.inside, "ip", "link", "set", "lo", state], check=True, timeout=20.0)

    def until_it_lies_in_a_socket(self):
        """Wait until something has come to the desk that it has not read."""
        place = f":{urlparse(self.place).port:04X}"
        table = Path(f"/proc/{self.desk.process.pid}/net/tcp")

        def lies():
            sockets = [line.split() for line in table.read_text("ascii").splitlines()[1:]]
            return any(
                ours.endswith(place) and int(queues.partition(":")[2], 16) for _, ours, _, _, queues, *_ in sockets
            )

        wait_for(lies)

    def decided(self):
        """Return what has been decided about so far: the hold that is asked for now is the last."""
        self.witness.say("hold")
        assert self.witness.line() == "DONE: done"
        self.desk.until("hold")
        found = [line for line in self.desk.seen if line in ("go", "land")]
        self.desk.seen.clear()
        return found

    def end(self):
        for each in self._started:
            each.end()


@pytest.fixture(scope="module")
def world():
    made = World()
    yield made
    made.end()


@pytest.fixture(scope="module")
def far():
    if subprocess.run(["unshare", "--net", "true"], check=False, capture_output=True, timeout=20.0).returncode:
        pytest.skip("no right to make a network namespace")
    made = World(("unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh"))
    yield made
    made.end()


# --- the engine is stopped ---


@pytest.mark.parametrize("role", ["console", "proxy", "once"])
def test_who_asks_an_engine_that_runs_is_answered(world, role):
    user = world.user(role)
    user.say("go")
    assert user.line() == "DONE: done"
    assert world.decided() == ["go"]


@pytest.mark.parametrize("stopped_s", [0.0, MUCH_LATER_S], ids=["soon", "much later"])
@pytest.mark.parametrize("word, then", [("go", []), ("land", ["land"])])
def test_what_the_console_shows_as_not_answered_is_not_decided_about_when_the_engine_goes_on(
    world, word, then, stopped_s
):
    user = world.user("console")
    world.desk.stop()
    user.say(word)
    answer = user.line()
    assert answer.startswith("NO_ANSWER")
    assert (TAKEN_BACK in answer) is (word == "go")
    time.sleep(stopped_s)
    world.desk.send(signal.SIGCONT)
    if then:
        world.desk.until(word)
    else:
        world.desk.until_logged("it is not carried out")
    assert world.decided() == then


@pytest.mark.parametrize("role", ["proxy", "once"])
def test_a_takeoff_that_lay_in_the_socket_for_long_is_refused_and_its_user_may_ask_again(world, role):
    user = world.user(role)
    world.desk.stop()
    user.say("go")
    time.sleep(MUCH_LATER_S)
    world.desk.send(signal.SIGCONT)
    answer = user.line()
    assert answer.startswith("REFUSED: it came ")
    assert answer.endswith(REFUSED)
    user.say("go")
    assert user.line() == "DONE: done"
    assert world.decided() == ["go"]


@pytest.mark.parametrize("role", ["proxy", "once"])
def test_a_landing_that_lay_in_the_socket_for_long_is_carried_out(world, role):
    user = world.user(role)
    world.desk.stop()
    user.say("land")
    time.sleep(MUCH_LATER_S)
    world.desk.send(signal.SIGCONT)
    assert user.line() == "DONE: done"
    assert world.decided() == ["land"]


@pytest.mark.parametrize("role", ["console", "proxy", "once"])
def test_a_takeoff_whose_user_waits_after_a_short_stop_is_carried_out(world, role):
    user = world.user(role)
    world.desk.stop()
    user.say("go")
    time.sleep(0.3)
    world.desk.send(signal.SIGCONT)
    assert user.line() == "DONE: done"
    assert world.decided() == ["go"]


@pytest.mark.parametrize("role", ["console", "proxy", "once"])
@pytest.mark.parametrize("word, then", [("go", []), ("land", ["land"])])
def test_a_takeoff_whose_user_has_gone_meanwhile_is_not_decided_about(world, role, word, then):
    user = world.user(role)
    world.desk.stop()
    user.say(word)
    world.until_it_lies_in_a_socket()
    user.end()
    world.desk.send(signal.SIGCONT)
    if role == "once":  # it has not been let in: it had not asked yet
        then = []
    elif then:
        world.desk.until(word)
    else:
        world.desk.until_logged("who asked has gone; it is not carried out")
    assert world.decided() == then


# --- the network is away ---


def test_what_the_console_shows_as_not_answered_does_not_arrive_when_the_network_returns(far):
    """A landing does, which shows that the takeoff would have come, too."""
    users = {word: far.user("console") for word in ("go", "land")}
    far.network("down")
    for word, user in users.items():
        user.say(word)
    for user in users.values():
        assert user.line().startswith("NO_ANSWER")
    far.network("up")
    far.desk.until("land")
    time.sleep(1.0)  # the kernel repeats both at about the same time
    assert far.decided() == ["land"]


@pytest.mark.parametrize("role", ["console", "proxy"])
@pytest.mark.slow_rows(1)
def test_a_takeoff_whose_user_has_gone_while_the_network_was_away_is_not_decided_about(far, role):
    """What rospy has sent comes all the same, and behind it that its user has gone."""
    user, other = far.user(role), far.user("proxy")
    far.network("down")
    user.say("go")
    other.say("land")
    time.sleep(0.5)
    user.end()
    time.sleep(1.5)
    far.network("up")
    if role == "proxy":
        far.desk.until_logged("go: who asked has gone; it is not carried out")
    assert other.line() == "DONE: done"
    time.sleep(1.0)
    assert far.decided() == ["land"]


# --- who asks ---


@pytest.fixture
def pair():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        theirs = socket.create_connection(listener.getsockname(), timeout=LIMIT_S)
        ours, _ = listener.accept()
    with ours, theirs:
        yield ours, theirs


def test_who_waits_has_not_gone(pair):
    assert not Asker(pair[0]).has_gone()
    assert not Asker(pair[0]).has_gone_behind_it()


@pytest.mark.parametrize("unread", [b"", b"more"])
def test_who_has_closed_his_connection_has_gone(pair, unread):
    ours, theirs = pair
    theirs.send(unread)
    theirs.close()
    assert Asker(ours).has_gone(LIMIT_S)


def test_nobody_waits_at_a_connection_that_is_closed_here(pair):
    pair[0].close()
    assert Asker(pair[0]).has_gone()


def test_a_request_of_no_connection_is_young_and_waited_for():
    for request in (None, SimpleNamespace(), SimpleNamespace(_connection_header={"callerid": "/somebody"})):
        asker = asker_of(request)
        assert asker.age_s < LIMIT_S
        assert not asker.has_gone()
        assert not asker.has_gone_behind_it()


def test_of_what_is_no_tcp_connection_no_age_is_known():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        note_accepted(ours)
        assert module._info(ours, module._LAST_DATA_AT) == 0


@pytest.mark.parametrize("after_s, age_s", [(0.0, 10.0), (module._AT_ONCE_S + 1.0, 0.0)])
def test_the_first_request_is_as_old_as_its_connection_unless_it_comes_much_later(monkeypatch, pair, after_s, age_s):
    now_s = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(module, "_info", lambda *_: 10_000)
    note_accepted(pair[0])
    monkeypatch.setattr(module, "_info", lambda *_: 0)
    now_s[0] += after_s
    ages = []
    monkeypatch.setattr(
        rospy.Service.__mro__[1],
        "_handle_request",
        lambda _service, _transport, request: (ages.append(asker_of(request).age_s)),
    )
    service = module.AskedService.__new__(module.AskedService)
    for _ in range(2):
        service._handle_request(SimpleNamespace(socket=pair[0], header={}), SimpleNamespace())
    assert ages == [age_s, 0.0], "the second request is asked by itself"
