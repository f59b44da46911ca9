"""A part comes over a network that is cut and restored in mid-transfer: two hosts, a real sshd, real rsync; root only.

The hosts are network namespaces with a cable between them. Cutting it is what happens when a plug is pulled: no packet
says so, and nobody gets an error; the transfer must notice by itself, and go on where it was.
"""

import os
import shutil
import subprocess
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from bag_tools import digest
from part_tools import FACTS, modes, open_to_others

pytest.importorskip("roslib")

from amaze_autonomy.config.schemas.recording import Transfer
from amaze_autonomy.nodes.recorder.processes import RecorderJobs
from amaze_autonomy.recording import parts as parts_module
from amaze_autonomy.recording.parts import check_arrived
from amaze_autonomy.recording.storage import PARTS

pytestmark = pytest.mark.live

NAME = f"amaze{os.getpid() % 10000}"
HOST, OTHER = "10.213.7.1", "10.213.7.2"
RATE_MB_S = 8
MEGABYTES = 24
PART = "s1_m/second"
S = 1_000_000_000


def missing():
    """Return why this cannot be tested here."""
    if os.geteuid() != 0:
        return "only root can make network namespaces"
    tools = [tool for tool in ("ip", "rsync", "ssh", "ssh-keygen") if shutil.which(tool) is None]
    if shutil.which("sshd") is None and not Path("/usr/sbin/sshd").exists():
        tools.append("sshd (openssh-server)")
    if tools:
        return f"missing: {', '.join(tools)}"
    probe = f"{NAME}probe"
    done = subprocess.run(["ip", "netns", "add", probe], capture_output=True, text=True, check=False, timeout=60)
    if done.returncode:
        return f"no network namespaces here: {done.stderr.strip()}"
    # to enter one takes a root that is a mount point: a chroot is not
    done = subprocess.run(["ip", "-n", probe, "link", "show"], capture_output=True, text=True, check=False, timeout=60)
    subprocess.run(["ip", "netns", "delete", probe], check=True, timeout=60)
    return f"no network namespace can be entered here: {done.stderr.strip()}" if done.returncode else ""


def ip(*words):
    subprocess.run(["ip", *words], check=True, timeout=60)


def received():
    """Return the bytes that came over the cable."""
    return int(Path(f"/sys/class/net/{NAME}n/statistics/rx_bytes").read_text())


@contextmanager
def cable():
    """Two hosts with a cable between them: this one's end is `near`, the other host is a namespace."""
    near, far = f"{NAME}n", f"{NAME}f"
    ip("netns", "add", NAME)
    try:
        ip("link", "add", near, "type", "veth", "peer", "name", far)
        ip("link", "set", far, "netns", NAME)
        ip("addr", "add", f"{HOST}/24", "dev", near)
        ip("link", "set", near, "up")
        ip("-n", NAME, "addr", "add", f"{OTHER}/24", "dev", far)
        ip("-n", NAME, "link", "set", far, "up")
        ip("-n", NAME, "link", "set", "lo", "up")
        yield far
    finally:
        # A namespace ends some time after its last process: the cable is taken away at once.
        with suppress(subprocess.TimeoutExpired):
            subprocess.run(["ip", "link", "delete", near], check=False, capture_output=True, timeout=60)
        ip("netns", "delete", NAME)


@contextmanager
def sshd(folder):
    """A real ssh server in the namespace, with keys of its own."""
    for name in ("host", "user"):
        subprocess.run(
            ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)], check=True, timeout=60
        )
    shutil.copy(folder / "user.pub", folder / "authorized")
    (folder / "config").write_text(
        f"ListenAddress {OTHER}\nPort 2222\nHostKey {folder}/host\nAuthorizedKeysFile {folder}/authorized\n"
        f"PidFile {folder}/pid\nStrictModes no\nUsePAM no\nPermitRootLogin yes\nPasswordAuthentication no\n"
    )
    Path("/run/sshd").mkdir(exist_ok=True)
    process = subprocess.Popen(
        ["ip", "netns", "exec", NAME, "/usr/sbin/sshd", "-D", "-e", "-f", str(folder / "config")],
        stderr=(folder / "log").open("wb"),
    )
    try:
        wait_for(lambda: b"listening" in (folder / "log").read_bytes(), "sshd")
        yield
    finally:
        process.kill()
        process.wait()


def wait_for(condition, what, limit_s=20.0):
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline, f"{what() if callable(what) else what} did not come within {limit_s} s"
        time.sleep(0.02)


@pytest.fixture
def hosts(tmp_path, monkeypatch):
    reason = missing()
    if reason:
        pytest.skip(f"THE TRANSFER OVER A NETWORK THAT IS CUT IS NOT TESTED: {reason}")
    known = tmp_path / "known_hosts"
    wrapper = tmp_path / "bin" / "ssh"  # the only way to another file of known hosts that is no option of a user
    wrapper.parent.mkdir()
    wrapper.write_text(f'#!/bin/sh\nexec {shutil.which("ssh")} -F none -oUserKnownHostsFile={known} "$@"\n')
    wrapper.chmod(0o755)
    monkeypatch.setenv("PATH", f"{wrapper.parent}:{os.environ['PATH']}")
    with cable() as far, sshd(tmp_path):
        key = (tmp_path / "host.pub").read_text()
        known.write_text(f"[{OTHER}]:2222 {key}")
        yield far, tmp_path


def source_of(folder, monkeypatch):
    """Return a part with one large file of random bytes, which no link compresses."""
    folder.mkdir(parents=True)
    (folder / "realsense-01.bag").write_bytes(os.urandom(MEGABYTES << 20))
    monkeypatch.setattr(parts_module, "_is_good", lambda _: True)
    entry = {"file": "realsense-01.bag", "bytes": MEGABYTES << 20, "sha256": digest(folder / "realsense-01.bag")}
    parts_module.write_json(folder / PARTS, {"parts": 1, **FACTS, "files": [entry], "logs": []})
    return folder


@pytest.mark.usefixtures("umask_of_nodes")
def test_a_transfer_over_a_network_that_is_cut_goes_on_where_it_was(hosts, monkeypatch):
    far, folder = hosts
    source, target = source_of(folder / "a disk" / PART, monkeypatch), folder / "here" / PART
    open_to_others(source, 0o000)
    transfer = Transfer("rsync", OTHER, 2222, str(folder / "user"), "", RATE_MB_S, 2 * S)
    jobs, seen, problems, cut = RecorderJobs(), [0.0], [], threading.Event()

    def fetch():
        # a machine at its limits may be silent for 2 s as a network is: fetched again, as the recorder does
        while not cut.is_set() and not (problems and problems[-1] == ""):
            problems.append(jobs.fetch(transfer, str(source), target, seen.append))
            cut.wait(0.5)

    thread = threading.Thread(target=fetch, daemon=True)
    began = time.monotonic()
    thread.start()
    wait_for(lambda: seen[-1] > 0.3, lambda: f"a third of the part ({seen[-1]:.2f}, {problems[-3:]})", 60.0)
    before = len(problems)
    ip("-n", NAME, "link", "set", far, "down")
    cut_s = time.monotonic()
    wait_for(lambda: len(problems) > before, "the notice of the cut", 30.0)
    noticed_s = time.monotonic() - cut_s
    cut.set()
    thread.join(30.0)
    assert not thread.is_alive()
    assert problems[-1].startswith("rsync: "), problems
    partial = target / ".partial" / "realsense-01.bag"
    kept = partial.stat().st_size
    assert kept > (MEGABYTES << 20) // 5
    assert not (target / "realsense-01.bag").exists()
    problem = jobs.fetch(transfer, str(source), target, seen.append)
    assert problem.startswith("rsync: ")
    assert partial.stat().st_size >= kept
    ip("-n", NAME, "link", "set", far, "up")
    again_s, before = time.monotonic(), received()
    wait_for(lambda: jobs.fetch(transfer, str(source), target, seen.append) == "", "the rest")
    rest_s, rest = time.monotonic() - again_s, received() - before
    assert rest < (MEGABYTES << 20) - kept // 2, "it began anew instead of going on"
    assert check_arrived(target)["files"][0]["sha256"] == digest(target / "realsense-01.bag")
    assert modes(target) == {".": "0750", PARTS: "0640", "realsense-01.bag": "0640"}
    assert digest(source / "realsense-01.bag") == digest(target / "realsense-01.bag")
    print(
        f"{MEGABYTES} MiB at {RATE_MB_S} MB/s: cut after {cut_s - began:.1f} s, noticed after {noticed_s:.1f} s, "
        f"{kept >> 20} MiB kept, {rest >> 20} MiB sent again or for the first time in {rest_s:.1f} s; nothing was lost"
    )


def test_a_host_that_is_not_there_is_a_problem_within_the_limit(hosts):
    far, folder = hosts
    ip("-n", NAME, "link", "set", far, "down")
    began = time.monotonic()
    transfer = Transfer("rsync", OTHER, 2222, str(folder / "user"), "", 0, 2 * S)
    problem = RecorderJobs().fetch(transfer, f"/rec/{PART}", folder / "here" / PART, lambda _: None)
    assert problem.startswith("rsync: ")
    assert time.monotonic() - began < 10.0
