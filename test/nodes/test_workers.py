"""Threads that run jobs at once, also where the system gives no new one: a limit of processes, or of memory."""

from __future__ import annotations

import threading
import time
from queue import SimpleQueue

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.ros.clock import Workers

NO_THREAD = RuntimeError("can't start new thread")


@pytest.fixture
def no_threads(monkeypatch):
    """Return what makes the system refuse every new thread, with an error."""

    def refuse(error=NO_THREAD):
        def start(_thread):
            raise error

        monkeypatch.setattr(threading.Thread, "start", start)

    return refuse


class Held:
    """A job that waits until the test lets it go."""

    def __init__(self):
        self.began, self._go = SimpleQueue(), threading.Event()

    def __call__(self):
        self.began.put(threading.current_thread().name)
        assert self._go.wait(5.0)

    def let_go(self):
        self._go.set()


def ready(workers, count):
    """Wait until so many workers are free."""
    deadline_s = time.monotonic() + 2.0
    while workers._free != count:
        assert time.monotonic() < deadline_s, f"{workers._free} are free"
        time.sleep(0.001)


def test_a_job_is_run_at_once_whatever_the_others_do():
    workers, held = Workers("call"), Held()
    for _ in range(3):
        workers.submit(held)
    assert {held.began.get(timeout=2.0) for _ in range(3)} == {"call-1", "call-2", "call-3"}
    held.let_go()


def test_a_thread_is_used_again():
    workers, names = Workers("call"), SimpleQueue()
    for _ in range(3):
        workers.submit(lambda: names.put(threading.current_thread().name))
        assert names.get(timeout=2.0) == "call-1"
        ready(workers, 1)


@pytest.mark.parametrize("error", [NO_THREAD, MemoryError()], ids=repr)
def test_without_a_new_thread_a_free_one_takes_the_job(no_threads, error):
    workers, names = Workers("call"), SimpleQueue()
    workers.prepare(2)
    ready(workers, 2)
    no_threads(error)
    for _ in range(5):
        workers.submit(lambda: names.put(threading.current_thread().name))
        assert names.get(timeout=2.0) in {"call-1", "call-2"}
        ready(workers, 2)


@pytest.mark.parametrize("error", [NO_THREAD, MemoryError()], ids=repr)
def test_a_job_that_nobody_can_run_is_refused_and_never_run(no_threads, error):
    workers, held, late = Workers("call"), Held(), SimpleQueue()
    workers.prepare(1)
    ready(workers, 1)
    no_threads(error)
    workers.submit(held)
    assert held.began.get(timeout=2.0) == "call-1"
    with pytest.raises(type(error)):
        workers.submit(lambda: late.put("refused, and run all the same"))
    held.let_go()
    ready(workers, 1)
    workers.submit(lambda: late.put("run"))
    assert late.get(timeout=2.0) == "run"
    ready(workers, 1)


def test_after_a_refusal_it_counts_as_before(monkeypatch):
    workers, held = Workers("call"), Held()
    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", lambda _: (_ for _ in ()).throw(NO_THREAD))
        with pytest.raises(RuntimeError, match="can't start"):
            workers.submit(held)
    workers.submit(held)
    assert held.began.get(timeout=2.0) == "call-1"
    held.let_go()
    ready(workers, 1)


@pytest.mark.parametrize("error", [NO_THREAD, MemoryError()], ids=repr)
def test_fewer_threads_than_were_wanted_ahead_are_said_once_and_do(no_threads, error, caplog):
    no_threads(error)
    workers = Workers("call")
    workers.prepare(4)
    assert caplog.text.count("no more than 0 of 4 threads of call can be had") == 1


def test_a_job_that_fails_is_said_and_its_thread_goes_on(caplog):
    workers, names = Workers("call"), SimpleQueue()

    def fail():
        raise MemoryError("no room")

    workers.submit(fail)
    ready(workers, 1)
    workers.submit(lambda: names.put(threading.current_thread().name))
    assert names.get(timeout=2.0) == "call-1"
    assert "a job of call failed" in caplog.text
    assert "MemoryError: no room" in caplog.text


def test_a_job_that_fails_where_nothing_can_be_logged_is_said_in_ready_made_words(monkeypatch, capfd):
    workers, names = Workers("call"), SimpleQueue()

    def no_memory(*_, **__):
        raise MemoryError

    monkeypatch.setattr("amaze_autonomy.ros.clock._log.exception", no_memory)
    workers.submit(no_memory)
    ready(workers, 1)
    workers.submit(lambda: names.put(threading.current_thread().name))
    assert names.get(timeout=2.0) == "call-1"
    assert capfd.readouterr().err == "amaze_autonomy: an error could not be logged: memory is too short\n"
