"""Two computers on one: network namespaces with a cable between them, and an ssh server on the far one. Needs root.

Neither reaches the machine's own network, nor is reached from it, but for the page that `relay` carries. Whatever runs
on them is ended with the program that made them, however that ends: the kernel sees to it when it is killed. The keys
are made for one run, and lie in memory.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Callable, List

__all__ = ["FAR", "NEAR", "Computer", "Unavailable", "came", "lay_cable", "make_keys", "start_sshd", "wait_for"]

NEAR, FAR = "10.213.53.1", "10.213.53.2"
_END_LIMIT_S = 25.0
_TOOLS = {
    "ip": "iproute2",
    "nsenter": "util-linux",
    "unshare": "util-linux",
    "setpriv": "util-linux",
    "mount": "mount",
    "rsync": "rsync",
    "ssh": "openssh-client",
    "ssh-keygen": "openssh-client",
    "sshd": "openssh-server",
}
_PATH = f"{os.environ.get('PATH', os.defpath)}:/usr/local/sbin:/usr/sbin:/sbin"  # sshd is in nobody's path
_SSH_CONFIG = """Host second
HostName {far}
User root
IdentityFile {folder}/user
IdentitiesOnly yes
UserKnownHostsFile {folder}/known_hosts
StrictHostKeyChecking yes
"""
_SSHD_CONFIG = """ListenAddress {far}
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


class Unavailable(Exception):  # noqa: N818  (a state of this system, not of the program)
    """Two computers cannot be made here; the text says why."""


def tool(name: str) -> str:
    """Return the path of a program.

    Raises:
        Unavailable: It is not there.
    """
    found = shutil.which(name, path=_PATH)
    if found is None:
        raise Unavailable(f"there is no {name} ({_TOOLS[name]})")
    return found


def check() -> None:
    """See whether this system can make two computers.

    Raises:
        Unavailable: It cannot.
    """
    if os.geteuid() != 0:
        raise Unavailable("only root can make network namespaces")
    for name in _TOOLS:
        tool(name)


def until_parent_dies(name: str, *command: str) -> List[str]:
    """Return the command as one that gets a signal when the process that starts it has died."""
    return [tool("setpriv"), "--pdeathsig", name, *command]


class Computer:
    """Namespaces for network and mounts, held by a process that sleeps.

    Args:
        cleanup: an ExitStack; closing it ends the computer.
    """

    def __init__(self, cleanup: Any) -> None:
        words = [tool("unshare"), "--net", "--mount", "--propagation", "private", "sleep", "infinity"]
        self.holder = subprocess.Popen(
            until_parent_dies("KILL", *words), start_new_session=True, stderr=subprocess.PIPE, text=True
        )
        cleanup.callback(end, self.holder, signal.SIGKILL)
        wait_for(self._sleeps, "a network namespace")
        self.do(tool("ip"), "link", "set", "lo", "up")

    def _sleeps(self) -> bool:
        """Return whether both namespaces are made: what holds them has become `sleep` then."""
        if self.holder.poll() is not None:
            raise Unavailable(f"no network namespaces: {(self.holder.stderr or ()).read().strip()}")
        return Path(f"/proc/{self.holder.pid}/comm").read_text() == "sleep\n"

    def words(self, *command: str) -> List[str]:
        """Return the words of a command on this computer; it becomes the command, it does not start it."""
        place = ["--target", str(self.holder.pid), "--net", "--mount", f"--wd={Path.cwd()}"]
        return [tool("nsenter"), *place, "--", *command]

    def do(self, *command: str) -> str:
        """Carry a short command out; return what it says.

        Raises:
            Unavailable: It fails.
        """
        done = subprocess.run(self.words(*command), capture_output=True, text=True, check=False)
        if done.returncode:
            raise Unavailable(f"{' '.join(command)}: {' '.join(done.stderr.split()) or f'status {done.returncode}'}")
        return done.stdout

    def start(
        self, cleanup: Any, name: str, command: List[str], *, foreground: bool = False, **more: Any
    ) -> subprocess.Popen[Any]:
        """Start what is sent the signal of this name at the end, or when this program dies.

        Args:
            cleanup: an ExitStack; closing it ends the process.
            name: of the signal.
            command: its words.
            foreground: whether it has this program's terminal, with its keys and its Ctrl-C.
            more: for `subprocess.Popen`.
        """
        words = until_parent_dies(name, *self.words(*command))
        source = None if foreground else subprocess.DEVNULL
        process = subprocess.Popen(words, stdin=source, start_new_session=not foreground, **more)
        cleanup.callback(end, process, getattr(signal, f"SIG{name}"))
        return process


def end(process: subprocess.Popen[Any], number: int) -> None:
    """End a process that may have ended; one that does not is killed."""
    if process.poll() is None:
        process.send_signal(number)
    try:
        process.wait(_END_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stderr is not None:
        process.stderr.close()


def wait_for(condition: Callable[[], Any], what: str, limit_s: float = 20.0) -> Any:
    """Wait for a condition; return what it returned.

    Raises:
        Unavailable: It did not come.
    """
    deadline = time.monotonic() + limit_s
    while True:
        found = condition()
        if found:
            return found
        if time.monotonic() > deadline:
            raise Unavailable(f"{what} did not come within {limit_s:g} s")
        time.sleep(0.02)


def lay_cable(near: Computer, far: Computer) -> None:
    """Connect two computers."""
    words = ["link", "add", "cable", "type", "veth", "peer", "name", "cable", "netns", str(far.holder.pid)]
    near.do(tool("ip"), *words)
    for computer, address in ((near, NEAR), (far, FAR)):
        computer.do(tool("ip"), "address", "add", f"{address}/30", "dev", "cable")
        computer.do(tool("ip"), "link", "set", "cable", "up")


def came(computer: Computer) -> int:
    """Return the bytes that came to a computer over its cable."""
    lines = computer.do("cat", "/proc/net/dev").splitlines()
    (line,) = (each for each in lines if each.strip().startswith("cable:"))
    return int(line.split(":")[1].split()[0])


def make_keys(folder: Path) -> Path:
    """Make the keys of host and user, and a program `ssh` that knows the host `second`; return its folder."""
    for name in ("host", "user"):
        words = [tool("ssh-keygen"), "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)]
        subprocess.run(words, check=True)
    (folder / "known_hosts").write_text(f"{FAR} {(folder / 'host.pub').read_text()}")
    (folder / "ssh_config").write_text(_SSH_CONFIG.format(far=FAR, folder=folder))
    (folder / "sshd_config").write_text(_SSHD_CONFIG.format(far=FAR, folder=folder))
    (folder / "bin").mkdir()
    program = folder / "bin" / "ssh"  # an option of ssh alone names another configuration
    program.write_text(f'#!/bin/sh\nexec {tool("ssh")} -F {folder}/ssh_config "$@"\n')
    program.chmod(0o755)
    return program.parent


def start_sshd(cleanup: Any, far: Computer, folder: Path) -> subprocess.Popen[Any]:
    """Start an ssh server at the far end of the cable; /run is one of its own there, for the folder that sshd wants.

    Raises:
        Unavailable: It does not come.
    """
    far.do("mkdir", "-p", "/run")
    far.do(tool("mount"), "-t", "tmpfs", "tmpfs", "/run")
    far.do("mkdir", "-m", "755", "/run/sshd")
    return run_sshd(cleanup, far, folder)


def run_sshd(cleanup: Any, far: Computer, folder: Path) -> subprocess.Popen[Any]:
    """Start the server on a computer that is made for it; also again, after it has ended."""
    log = folder / "sshd.log"
    log.unlink(missing_ok=True)
    process = far.start(cleanup, "TERM", [tool("sshd"), "-D", "-E", str(log), "-f", str(folder / "sshd_config")])

    def listens() -> bool:
        said = log.read_text() if log.exists() else ""
        if process.poll() is not None:
            raise Unavailable(f"sshd ended: {' '.join(said.split()) or process.returncode}")
        return "listening" in said

    wait_for(listens, "sshd")
    return process


# --- relay ------------------------------------------------------------------------------------------------------------


async def relay(listener: socket.socket, port: int) -> None:
    """Carry what comes in at a socket to a port of this computer, and back."""

    async def carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            from_port, to_port = await asyncio.open_connection("127.0.0.1", port)
        except OSError:  # nobody listens yet; a browser tries again
            writer.close()
            return
        await asyncio.gather(pump(reader, to_port), pump(from_port, writer))

    server = await asyncio.start_server(carry, sock=listener)
    await server.serve_forever()


async def pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Carry on until one side has closed."""
    try:
        while True:
            data = await reader.read(1 << 16)
            if not data:
                break
            writer.write(data)
            await writer.drain()
    except OSError:
        pass
    finally:
        writer.close()


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    asyncio.run(relay(socket.socket(fileno=int(sys.argv[1])), int(sys.argv[2])))
