"""A node's process: precedence over other programs, within the session and of it; words that start no node."""

from __future__ import annotations

import importlib
import os
import select
import subprocess
import sys
from pathlib import Path

import pytest

rospy = pytest.importorskip("rospy")

from amaze_autonomy.ros.arguments import NODES as TAKEN  # noqa: E402

AUTOGROUP = Path("/proc/self/autogroup")
SCRIPT = """
import os
from pathlib import Path
from amaze_autonomy.ros.node_main import take_precedence
{before}
refused = take_precedence({nice})
group = Path("/proc/self/autogroup")
print(os.getpriority(os.PRIO_PROCESS, 0), group.read_text().split()[-1] if group.exists() else "none", refused, sep="|")
"""
NOBODY = "os.setgroups([]); os.setgid(65534); os.setuid(65534)"


def outcome(nice, *, session, before=""):
    """Return (niceness of the process, of its session, what was refused) as a process of its own finds it."""
    script = SCRIPT.format(nice=nice, before=before)
    result = subprocess.run(
        [sys.executable, "-c", script],
        start_new_session=session,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return tuple(result.stdout.strip().split("|"))


SIGNALS = """
import os, signal, threading, time
from amaze_autonomy.ros.node_main import end_by_signals
lock, ended, both = threading.Lock(), [], threading.Event()
def end(name):
    with lock:
        ended.append(name)
    if len(ended) == 2:
        both.set()
    raise RuntimeError("once")
end_by_signals(end)
with lock:  # the handlers come while the main thread holds what the end needs
    for number in (signal.SIGINT, signal.SIGTERM):
        os.kill(os.getpid(), number)
    time.sleep(0.01)
both.wait(60.0)
print(*ended)
"""


def test_a_signal_at_the_worst_moment_ends_a_node_and_so_does_the_next_one():
    """roslaunch ends a group of nodes, and the group each of them: two signals within a tenth of a millisecond."""
    done = subprocess.run([sys.executable, "-c", SIGNALS], capture_output=True, text=True, check=False, timeout=120)
    assert (done.stdout, done.returncode) == ("SIGINT SIGTERM\n", 0), done.stderr


grouped = AUTOGROUP.exists() and AUTOGROUP.read_text().strip()  # empty: in a control group of its own, sched(7)
needs_autogroup = pytest.mark.skipif(not grouped, reason="this kernel does not group tasks by session here")


@needs_autogroup
def test_a_node_with_a_session_of_its_own_takes_precedence_for_the_session_too():
    assert outcome(5, session=True) == ("5", "5", "")


@needs_autogroup
def test_a_node_that_runs_in_a_terminals_session_leaves_that_alone():
    session = AUTOGROUP.read_text().split()[-1]
    assert outcome(5, session=False) == ("5", session, "")


@needs_autogroup
@pytest.mark.skipif(os.getuid() != 0, reason="only root can try what others may not")
def test_what_is_not_permitted_is_named():
    niceness, session, refused = outcome(-10, session=True, before=NOBODY)
    assert (niceness, session) == (str(os.getpriority(os.PRIO_PROCESS, 0)), "0")
    assert refused == "niceness -10: Permission denied; niceness -10 of the session: Permission denied"


NODES = {
    "autonomy": "nodes.autonomy.node",
    "autopilot": "nodes.vehicle.autopilot_node",
    "simulation": "nodes.simulation.node",
    "recorded_peers": "nodes.simulation.recorded_peers_node",
}


@pytest.mark.parametrize("name", NODES)
@pytest.mark.parametrize(
    "words, status, said",
    [
        (["--help"], 0, "usage: rosrun amaze_autonomy"),
        (["-h", "_nice:=0"], 0, "usage:"),
        (["--nice", "0"], 2, "no '--nice'"),
    ],
    ids=["help", "h", "wrong"],
)
def test_who_asks_for_help_starts_no_node_that_would_end_the_one_that_flies(
    monkeypatch, capsys, name, words, status, said
):
    module = importlib.import_module(f"amaze_autonomy.{NODES[name]}")
    monkeypatch.setattr(sys, "argv", [name, *words])
    monkeypatch.setattr(rospy, "init_node", lambda *_, **__: pytest.fail("it has started"))
    assert module.main() == status
    told = capsys.readouterr()
    assert said in (told.err if status else told.out)
    assert ("~" in told.out) == (status == 0), "its parameters are shown to who asks"


# --- whom is what it writes for ---------------------------------------------------------------------------------------

BEGINS = """\
import os, sys
import rospy
from amaze_autonomy.ros import node_main

os.umask(int(sys.argv[1], 8))
rospy.init_node = lambda *_, **__: open("log of the node", "w")
node_main.ask_master = lambda: None
node_main.begin("node")
open("file", "w")
os.mkdir("folder")
os.system("touch of_a_program")
names = ("log of the node", "file", "folder", "of_a_program")
os.write(1, " ".join(f"{os.stat(name).st_mode & 0o777:o}" for name in names).encode())
os._exit(0)
"""


@pytest.mark.parametrize("umask", ["000", "022", "077"])
def test_whoever_starts_a_node_what_it_and_its_programs_write_is_for_its_user_and_group(tmp_path, umask):
    command = [sys.executable, "-c", BEGINS, umask]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == ["640", "640", "750", "640"]


EACH = """\
import os, runpy, sys
import rosgraph, rospy
from amaze_autonomy.nodes.autonomy import node
from amaze_autonomy.nodes.recorder import node
from amaze_autonomy.nodes.simulation import node  # what all of them need is loaded once

def reached(*_, **__):
    os.write(2, f"{os.path.basename(sys.argv[0])} {os.umask(0):03o}\\n".encode())
    os._exit(0)

rospy.init_node = reached
rosgraph.is_master_online = lambda *_: True  # the page waits for one
for path in sys.argv[1:]:
    if os.fork() == 0:
        os.umask(0)
        sys.argv = [path, *(("--port", "0") if path.endswith("web") else ())]
        runpy.run_path(path)
    os.wait()
"""
NO_NODE = "mavlink_router"  # it becomes a program of others


def test_each_node_has_decided_that_before_it_is_one_and_before_it_writes_anything(tmp_path):
    names = sorted(set(TAKEN) - {NO_NODE})
    command = [sys.executable, "-c", EACH, *(str(Path(__file__).parents[2] / "scripts" / name) for name in names)]
    home = {"ROS_HOME": str(tmp_path / "home")}
    environment = {**os.environ, **home}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=120)
    assert done.stderr.splitlines() == [f"{name} 027" for name in names]
    written = {str(path.relative_to(tmp_path)): f"{path.stat().st_mode & 0o777:o}" for path in tmp_path.rglob("*")}
    assert written == {"home": "750", "home/amaze_autonomy": "750", "home/amaze_autonomy/web_token": "600"}


# --- words to people --------------------------------------------------------------------------------------------------

NODE = """\
import logging, os, sys
from amaze_autonomy.ros import node_main

file = logging.FileHandler(sys.argv[1])
file.setFormatter(logging.Formatter("%(name)s %(message)s"))
logging.getLogger().addHandler(file)
sys.stdout, sys.stderr = node_main.Outlet(sys.stdout), node_main.Outlet(sys.stderr)
node_main.atexit.register(node_main.say_last_words)
node_main.detach_files()
node_main.detach_files()
for number in range(int(sys.argv[2])):
    print(f"{number} ä" + 60 * " ", flush=True)
    logging.warning("%d said", number)
os.write(2, b"said")
"""


def start_node(file, count):
    process = subprocess.Popen(
        [sys.executable, "-c", NODE, str(file), str(count)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    said = select.select([process.stderr], [], [], 60.0)[0] and os.read(process.stderr.fileno(), 4)
    return process, said


def test_what_a_node_says_last_is_written_in_its_order_once(tmp_path):
    process, _ = start_node(tmp_path / "log", 50)
    assert [line.split() for line in process.communicate(timeout=60)[0].decode().splitlines()] == [
        [str(number), "ä"] for number in range(50)
    ]
    assert (tmp_path / "log").read_text().splitlines() == [f"root {number} said" for number in range(50)]


@pytest.mark.parametrize("count", [3_000, 30_000])  # more than a pipe holds, and more than may wait
def test_a_terminal_and_a_disk_that_are_held_hold_up_nobody_and_a_node_ends_all_the_same(tmp_path, count):
    os.mkfifo(tmp_path / "log")
    held = os.open(tmp_path / "log", os.O_RDWR)
    process, said = start_node(tmp_path / "log", count)
    os.close(held)  # a file that hangs would be waited for at the end, by logging itself
    try:
        assert said == b"said", "it waits for who takes nothing"
        assert process.wait(timeout=60) == 0
    finally:
        process.kill()
        process.communicate(timeout=10)


def test_on_a_terminal_a_warning_has_its_colour():
    """rospy asks the stream whether it is one."""
    master, terminal = os.openpty()
    script = "import sys; from amaze_autonomy.ros import node_main; made = node_main.Outlet(sys.stdout)\n"
    script += "made.write(f'{made.isatty()} {made.fileno()}')"
    try:
        subprocess.run(
            [sys.executable, "-c", f"{script}; node_main.say_last_words()"], stdout=terminal, check=True, timeout=120
        )
        assert os.read(master, 100) == b"True 1"
    finally:
        os.close(terminal)
        os.close(master)


def test_who_reads_no_more_ends_no_node(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", NODE, str(tmp_path / "log"), "9"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    process.stdout.close()
    assert process.wait(timeout=60) == 0
    assert len((tmp_path / "log").read_text().splitlines()) == 9
