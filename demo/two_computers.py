#!/usr/bin/env python3
"""What `./run demo` starts: the demo on two computers where this one can make them, else on this one alone.

On the near computer runs `./run demo` without its second recorder; on the far one that recorder, as `roslaunch --wait
amaze_autonomy recorder.launch platform:=second`, and an ssh server of its own (`computers.py`). The far one has its
recordings in a place that the near one does not see, so that they can only come over the cable.

AMAZE_COMPUTERS: 2 flies on two or not at all; else it is on two, or on one with a word why. `run` itself takes 1.
"""

from __future__ import annotations

import os
import shlex
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Dict, List, NoReturn, Tuple

from computers import FAR, NEAR, Computer, Unavailable, came, check, lay_cable, make_keys, start_sshd, tool
from ports import WEB, free_ports

ROOT = Path(__file__).resolve().parents[1]
DEMO = ROOT / "build" / "demo"
PRIVATE = DEMO / ".keys"  # a storage in memory is mounted there, which only this program and its children see
WANTED = os.environ.get("AMAZE_COMPUTERS", "")
# Whoever gives one of these says where what is recorded.
DECIDED = (
    "transfer",
    "second_recorder",
    "second_platform",
    "platform",
    "recorder",
    "record",
    "data_recorder",
    "simulation",
)
PROBE_LIMIT_S = 10.0


def say(text: str) -> None:
    """Tell the user, as `run` does."""
    print(f"\n== {text}", file=sys.stderr, flush=True)


def alone(why: str, arguments: List[str]) -> NoReturn:
    """Become the demo on this computer alone."""
    if WANTED == "2":
        sys.exit(f"demo-two-computers: {why}")
    say(f"the second recorder is a process on this computer: {why}")
    command = ["bash", str(ROOT / "run"), "demo", *arguments]
    os.execvpe(command[0], command, {**os.environ, "AMAZE_COMPUTERS": "1"})  # noqa: S606  (words, no shell)


def become_private(arguments: List[str]) -> None:
    """Become a process with mounts of its own, which end with it and its children.

    Raises:
        Unavailable: This system does not permit it.
    """
    if os.environ.get("AMAZE_PRIVATE") == str(os.getpid()):
        return
    words = [tool("unshare"), "--mount", "--net"]
    done = subprocess.run([*words, "true"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise Unavailable(f"no network namespaces: {' '.join(done.stderr.split())}")
    command = [tool("unshare"), "--mount", "--propagation", "private", sys.executable, __file__, *arguments]
    os.execve(command[0], command, {**os.environ, "AMAZE_PRIVATE": str(os.getpid())})  # noqa: S606


def private_folder() -> Path:
    """Return a folder in memory that nobody else sees.

    Raises:
        Unavailable: This system does not permit it.
    """
    PRIVATE.mkdir(mode=0o700, parents=True, exist_ok=True)
    words = [tool("mount"), "-t", "tmpfs", "-o", "mode=700,size=1m", "tmpfs", str(PRIVATE)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise Unavailable(f"no mounts: {' '.join(done.stderr.split())}")
    return PRIVATE


def split(arguments: List[str]) -> Tuple[Path, List[str], List[str]]:
    """Return the output folder, the other arguments, and those of them that the other computer needs, too."""
    given = dict(each.split(":=", 1) for each in arguments if ":=" in each)
    named = given.pop("output", None)
    output = new_folder(DEMO / time.strftime("%Y%m%dT%H%M%S")) if named is None else Path(named).expanduser().resolve()
    shared = {name: value for name, value in given.items() if name in ("config", "overrides")}
    if "config" in shared:
        shared["config"] = str(Path(shared["config"]).expanduser().resolve())
    demo = [each for each in arguments if not each.startswith("output:=")]
    return output, demo, [f"{name}:={value}" for name, value in shared.items()]


def new_folder(path: Path) -> Path:
    """Make a folder, or the same with a number behind it where another demo has just made it; return which."""
    folder = path
    for number in range(2, 100):
        with suppress(FileExistsError):
            folder.mkdir(parents=True)
            break
        folder = path.with_name(f"{path.name}_{number}")
    return folder


def make_computers(cleanup: ExitStack, output: Path) -> Tuple[Computer, Computer, Dict[str, str]]:
    """Return two computers of which the near one can fetch from the far one, and the near one's environment.

    Raises:
        Unavailable: This system cannot make them.
    """
    folder = private_folder()
    near, far = Computer(cleanup), Computer(cleanup)
    lay_cable(near, far)
    programs = make_keys(folder)
    far.do(tool("mount"), "--bind", str(output / "second_computer"), str(output / "recordings" / "second"))
    start_sshd(cleanup, far, folder)
    environment = {**os.environ, "AMAZE_NEAR_IP": NEAR, "PATH": f"{programs}:{os.environ['PATH']}"}
    words = near.words(str(programs / "ssh"), "-n", "-oBatchMode=yes", "second", "rsync", "--version")
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=PROBE_LIMIT_S)
    except subprocess.TimeoutExpired as error:
        raise Unavailable(f"the ssh server does not answer within {PROBE_LIMIT_S:g} s") from error
    if done.returncode:
        raise Unavailable(f"ssh to the other computer: {' '.join(done.stderr.split())}")
    return near, far, environment


def start_far(cleanup: ExitStack, far: Computer, output: Path, shared: List[str]) -> None:
    """Start the recorder of the far computer; what it says goes to a file."""
    place = output / "recordings" / "second"
    command = ["roslaunch", "--wait", "amaze_autonomy", "recorder.launch", "platform:=second", f"folder:={place}"]
    environment = {**os.environ, "ROS_MASTER_URI": f"http://{NEAR}:11311", "ROS_IP": FAR}
    with (output / "second_computer" / "roslaunch.log").open("wb") as log:
        far.start(cleanup, "INT", [*command, *shared], env=environment, stdout=log, stderr=log)


def fly(cleanup: ExitStack, arguments: List[str]) -> int:
    """Fly the demo on two computers; return its exit status.

    Raises:
        Unavailable: This system cannot make them.
    """
    output, demo, shared = split(arguments)
    for each in (output / "recordings" / "second", output / "second_computer"):
        each.mkdir(parents=True, exist_ok=True)
    near, far, environment = make_computers(cleanup, output)
    say("the second recorder runs on a computer of its own, a network namespace; its part comes with rsync over ssh")
    (DEMO / "near").write_text(f"{near.holder.pid}\n")  # for ./run console
    cleanup.callback(forget, near.holder.pid)
    start_far(cleanup, far, output, shared)
    if not any(each.startswith("web:=") for each in demo):
        demo = [*demo, "web:=true", f"web_port:={show_page(cleanup, near)}"]
    command = ["bash", str(ROOT / "run"), "demo", *demo, f"output:={output}"]
    words = [*command, "second_recorder:=false", "transfer:=rsync"]
    flight = near.start(cleanup, "TERM", words, foreground=True, env=environment)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # it lands the vehicle and ends its nodes
        signal.signal(number, lambda *_: flight.send_signal(signal.SIGTERM))
    status = flight.wait()
    size = f"{came(near) / 1e6:.1f} MB came from the second computer"
    print(f"{'cable':12} {size}, whose own part and log lie in {output / 'second_computer'}", flush=True)
    if status and any((output / "second_computer").glob("*/second/*.bag*")):
        print(f"{'one_bag':12} {by_hand(output)}", flush=True)
    return status


def show_page(cleanup: ExitStack, near: Computer) -> int:
    """Have the near computer's page reached from here, where the browser is; return its port, here and there.

    A socket belongs to the network in which it was made: one that listens here is accepted from over there.
    """
    port = free_ports(cleanup, WEB, 1, socket.SOCK_STREAM, "127.0.0.1")
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", port))
        listener.listen()
        number = listener.fileno()
        command = [sys.executable, str(ROOT / "demo" / "computers.py"), str(number), str(port)]
        near.start(cleanup, "TERM", command, pass_fds=(number,))
    return port


def by_hand(output: Path) -> str:
    """Return how to make one bag of what both computers recorded, when the flight did not come to that."""
    near, far = (shlex.quote(str(output / name)) for name in ("recordings/main", "second_computer"))
    parts = f"{near}/*/main/*.bag {far}/*/second/*.bag"
    made = shlex.quote(str(output / "all.bag"))
    return f"if none was made of both recordings: amaze-bag merge {parts} -o {made} --verify"


def forget(pid: int) -> None:
    """Forget the near computer, unless there is another demo by now."""
    with suppress(OSError):
        if (DEMO / "near").read_text() == f"{pid}\n":
            (DEMO / "near").unlink()


def remove_empty(output: Path) -> None:
    """Remove folders that were made for two computers."""
    for each in (output / "recordings" / "second", output / "recordings", output / "second_computer", output):
        with suppress(OSError):
            each.rmdir()


def main() -> int:
    """Fly; return the exit status of the flight."""
    arguments = sys.argv[1:]
    given = [each.split(":=", 1)[0] for each in arguments if ":=" in each]
    for name in DECIDED:
        if name in given:
            alone(f"{name}:= says where what is recorded", arguments)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, leave)
    output = split(arguments)[0]
    try:
        check()
        become_private(arguments)
        with ExitStack() as cleanup:
            return fly(cleanup, arguments)
    except Unavailable as error:
        remove_empty(output)
        alone(str(error), arguments)


def leave(number: int, _frame: Any) -> NoReturn:
    """End in an orderly way."""
    sys.exit(128 + number)


if __name__ == "__main__":
    sys.exit(main())
