"""The process that works on bags: its lines, its end with its parent, and killed at any moment."""

import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest
from bag_tools import bag, digest, left_over, multiset, rows
from part_tools import FACTS, killed, two_platforms

from amaze_autonomy.recording.job import run

pytestmark = pytest.mark.live


def request(session):
    return {
        "do": "collect",
        "output": str(session / "s1_m.bag"),
        "sources": [
            {"platform": "main", "folder": str(session / "main")},
            {"platform": "second", "folder": str(session / "second"), "fetched": True},
        ],
        "duplicates": "count",
        "facts": {"session_id": "s1"},
    }


def started(asked):
    process = subprocess.Popen(
        [sys.executable, "-m", "amaze_autonomy.recording.job"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    process.stdin.write((json.dumps(asked) + "\n").encode())
    process.stdin.flush()
    return process


def forked(asked):
    """Do a job in a process that has everything loaded already; return its number."""
    child = os.fork()
    if child:
        return child
    try:
        run(asked, lambda _: None)
    finally:
        os._exit(0)


def ended(process):
    lines = [json.loads(line) for line in process.stdout]
    process.wait(timeout=60)
    process.stdin.close()
    process.stdout.close()
    process.stderr.close()
    return lines


def test_it_tells_phases_and_progress_and_in_the_end_the_result(tmp_path):
    session = two_platforms(tmp_path)
    process = started(request(session))
    *lines, last = ended(process)
    assert process.returncode == 0
    assert list(dict.fromkeys(line["phase"] for line in lines)) == ["MERGING", "VERIFYING"]
    assert lines[-1]["progress"] == 1.0
    result = last["result"]
    assert (result["problem"], result["verified"], result["messages"]) == ("", True, 900)
    assert result["location"] == str(session / "s1_m.bag")


def test_a_problem_is_one_line_and_a_status(tmp_path):
    process = started(request(tmp_path / "nothing"))
    (line,) = ended(process)
    assert process.returncode == 1
    assert line["result"]["problem"].endswith("nothing was changed; retry, and its platform lists anew what is there")


def test_it_closes_a_part(tmp_path):
    killed(tmp_path, "states-01.bag.active", rows("/a", 100))
    lines = []
    assert run({"do": "close", "folder": str(tmp_path), "facts": FACTS}, lines.append) == {
        "problem": "", "files": 1, "foreign": []
    }  # fmt: skip
    assert lines == [{"phase": "RECOVERING", "progress": 1.0}]


def test_a_storage_that_fails_is_a_problem_and_no_traceback():
    assert run({"do": "close", "folder": "/proc/1/nothing", "facts": FACTS}, print)["problem"].startswith("/proc/1/")


def test_it_ends_when_nobody_waits_for_it_any_more(tmp_path):
    session = two_platforms(tmp_path, 20_000)
    process = started(request(session))
    process.stdout.readline()
    process.stdin.close()
    process.wait(10.0)
    assert process.returncode == 1
    process.stdout.close()
    process.stderr.close()


@pytest.mark.night
@pytest.mark.parametrize("seed", [1])
def test_killed_at_twenty_random_moments_it_goes_on_and_the_recording_is_complete(tmp_path, seed):
    session = tmp_path / "s1_m"
    for name in ("main", "second"):
        (session / name).mkdir(parents=True)
        bag(session / name / f"{name}-01.bag", rows(f"/{name}", 8000, 1))
        killed(session / name, f"{name}-02.bag.active", rows(f"/{name}", 500, 1, first_ms=9000))
        run({"do": "close", "folder": str(session / name), "facts": FACTS}, lambda _: None)
    inputs = sorted(path for path in session.rglob("*.bag") if "active" not in path.name)
    before = [digest(path) for path in inputs]
    began = time.monotonic()
    os.waitpid(forked(request(session)), 0)
    whole_s = time.monotonic() - began
    expected = digest(session / "s1_m.bag")
    (session / "s1_m.bag").unlink()
    chance, kills = random.Random(seed), 0
    while kills < 20:
        child = forked(request(session))
        time.sleep(chance.uniform(0.0, whole_s))  # the moment of the kill is what is tested
        os.kill(child, signal.SIGKILL)
        kills += os.WIFSIGNALED(os.waitpid(child, 0)[1])
        if (session / "s1_m.bag").exists():
            assert digest(session / "s1_m.bag") == expected
            (session / "s1_m.bag").unlink()
    result = ended(started(request(session)))[-1]["result"]
    assert (result["problem"], result["messages"]) == ("", 17_000)
    assert digest(session / "s1_m.bag") == expected
    assert multiset(session / "s1_m.bag") == multiset(*inputs)
    assert [digest(path) for path in inputs] == before
    assert left_over(session) == []
    print(f"20 kills within {whole_s:.2f} s; nothing lost of 17,000 messages")
