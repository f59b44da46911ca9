#!/usr/bin/env python3
"""The demo on two computers: `./run demo-two-computers`. Needs root.

Both computers are network namespaces with a cable between them, a pair of virtual interfaces: nothing reaches the
machine's own network, nor is reached from it. On the near one runs `./run demo` without its second recorder; on the far
one that recorder, as `roslaunch --wait amaze_autonomy recorder.launch platform:=second`, and an ssh server of its own.
The far one has its recordings in a place that the near one does not see, so that they can only come over the cable.

What holds the namespaces, and all that runs in them, is ended at the end, however that comes; the kernel ends it when
this program is killed. The keys are made for one run.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NEAR, FAR = "10.213.53.1", "10.213.53.2"
END_LIMIT_S = 25.0
SSH_CONFIG = """Host second
HostName {far}
User root
IdentityFile {folder}/user
IdentitiesOnly yes
UserKnownHostsFile {folder}/known_hosts
StrictHostKeyChecking yes
"""
SSHD_CONFIG = """ListenAddress {far}
Port 22
HostKey {folder}/host
AuthorizedKeysFile {folder}/user.pub
PidFile none
StrictModes no
UsePAM no
PermitRootLogin prohibit-password
PasswordAuthentication no
KbdInteractiveAuthentication no
"""


def until_parent_dies(name, *command):
    """Return the command as one that gets a signal when the process that starts it has died."""
    return ["setpriv", "--pdeathsig", name, *command]


class Computer:
    """Namespaces for network and mounts, held by a process that sleeps."""

    def __init__(self, cleanup):
        words = ["unshare", "--net", "--mount", "--propagation", "private", "sleep", "infinity"]
        self.holder = subprocess.Popen(until_parent_dies("KILL", *words), start_new_session=True)
        cleanup.callback(end, self.holder, signal.SIGKILL)
        wait_for(self._sleeps, "a network namespace")
        self.do("ip", "link", "set", "lo", "up")

    def _sleeps(self):
        """Whether both namespaces are made: what holds them has become `sleep` then."""
        assert self.holder.poll() is None, "a network namespace cannot be made"
        return Path(f"/proc/{self.holder.pid}/comm").read_text() == "sleep\n"

    def words(self, *command):
        """Return the words of a command on this computer; it becomes the command, it does not start it."""
        return ["nsenter", "--target", str(self.holder.pid), "--net", "--mount", f"--wd={Path.cwd()}", *command]

    def do(self, *command):
        """Carry a short command out."""
        return subprocess.run(self.words(*command), check=True, stdout=subprocess.PIPE, text=True).stdout

    def start(self, cleanup, name, command, **more):
        """Start what is sent the signal of this name at the end, or when this program dies."""
        words = until_parent_dies(name, *self.words(*command))
        process = subprocess.Popen(words, stdin=subprocess.DEVNULL, start_new_session=True, **more)
        cleanup.callback(end, process, getattr(signal, f"SIG{name}"))
        return process


def end(process, number):
    """End a process that may have ended; one that does not is killed."""
    if process.poll() is None:
        process.send_signal(number)
    try:
        process.wait(END_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def wait_for(condition, what, limit_s=20.0):
    deadline = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > deadline:
            sys.exit(f"demo-two-computers: {what} did not come within {limit_s:g} s")
        time.sleep(0.02)


def lay_cable(near, far):
    """Connect two computers."""
    near.do("ip", "link", "add", "cable", "type", "veth", "peer", "name", "cable", "netns", str(far.holder.pid))
    for computer, address in ((near, NEAR), (far, FAR)):
        computer.do("ip", "address", "add", f"{address}/30", "dev", "cable")
        computer.do("ip", "link", "set", "cable", "up")


def make_keys(folder):
    """Make the keys of host and user, and a program `ssh` that knows them: it alone reads another configuration."""
    for name in ("host", "user"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)], check=True)
    (folder / "known_hosts").write_text(f"{FAR} {(folder / 'host.pub').read_text()}")
    (folder / "ssh_config").write_text(SSH_CONFIG.format(far=FAR, folder=folder))
    (folder / "sshd_config").write_text(SSHD_CONFIG.format(far=FAR, folder=folder))
    (folder / "bin").mkdir()
    (folder / "bin" / "ssh").write_text(f'#!/bin/sh\nexec {shutil.which("ssh")} -F {folder}/ssh_config "$@"\n')
    (folder / "bin" / "ssh").chmod(0o755)


def start_sshd(cleanup, far, folder):
    """Start an ssh server at the far end of the cable; /run is one of its own there, for the folder that sshd wants."""
    far.do("mount", "-t", "tmpfs", "tmpfs", "/run")
    far.do("mkdir", "-m", "755", "/run/sshd")
    log = folder / "sshd.log"
    server = shutil.which("sshd", path="/usr/sbin:/usr/local/sbin:/usr/bin")
    command = [server, "-D", "-E", str(log), "-f", str(folder / "sshd_config")]
    process = far.start(cleanup, "TERM", command)

    def listens():
        if process.poll() is not None:
            sys.exit(f"demo-two-computers: sshd ended: {log.read_text() if log.exists() else process.returncode}")
        return log.exists() and "listening" in log.read_text()

    wait_for(listens, "sshd")


def split(arguments):
    """Return the output folder, the other arguments, and those of them that the other computer needs, too."""
    given = dict(each.split(":=", 1) for each in arguments if ":=" in each)
    output = Path(given.pop("output", ROOT / "build" / "demo" / time.strftime("%Y%m%dT%H%M%S"))).resolve()
    shared = {name: value for name, value in given.items() if name in ("config", "overrides")}
    if "config" in shared:
        shared["config"] = str(Path(shared["config"]).resolve())
    demo = [each for each in arguments if not each.startswith("output:=")]
    return output, demo, [f"{name}:={value}" for name, value in shared.items()]


def came(near):
    """Return the bytes that came over the cable to the near computer."""
    line = next(each for each in near.do("cat", "/proc/net/dev").splitlines() if each.strip().startswith("cable:"))
    return int(line.split(":")[1].split()[0])


def fly(cleanup, arguments):
    """Fly the demo on two computers; return its exit status."""
    output, demo, shared = split(arguments)
    folder = Path(cleanup.enter_context(tempfile.TemporaryDirectory(prefix="amaze-two-computers-")))
    place, disk = output / "recordings" / "second", output / "second_computer"
    for each in (place, disk):
        each.mkdir(parents=True, exist_ok=True)
    make_keys(folder)
    near, far = Computer(cleanup), Computer(cleanup)
    lay_cable(near, far)
    far.do("mount", "--bind", str(disk), str(place))
    start_sshd(cleanup, far, folder)
    command = ["roslaunch", "--wait", "amaze_autonomy", "recorder.launch", "platform:=second", f"folder:={place}"]
    environment = {**os.environ, "ROS_MASTER_URI": f"http://{NEAR}:11311", "ROS_IP": FAR}
    far.start(cleanup, "INT", [*command, *shared], env=environment)
    command = ["bash", str(ROOT / "run"), "demo", *demo, f"output:={output}"]
    environment = {**os.environ, "AMAZE_NEAR_IP": NEAR, "PATH": f"{folder}/bin:{os.environ['PATH']}"}
    flight = near.start(cleanup, "TERM", [*command, "second_recorder:=false", "transfer:=rsync"], env=environment)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # it lands the vehicle and ends its nodes
        signal.signal(number, lambda *_: flight.send_signal(signal.SIGTERM))
    status = flight.wait()
    print(f"{'cable':12} {came(near) / 1e6:.1f} MB came from the second computer, whose own part lies in {disk}")
    return status


def main():
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _: sys.exit(128 + number))
    with ExitStack() as cleanup:
        return fly(cleanup, sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
