"""The command line of rsync, which never sees a shell, and what its output says."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from part_tools import modes, open_to_others

from amaze_autonomy.config.schemas.recording import Transfer
from amaze_autonomy.recording.programs import misplaced, problem_of, progress_of, transfer_command

pytestmark = pytest.mark.live

NAMES, TARGET = Path("/here/.wanted"), Path("/here")
PART = "s1_m/second"
DOCS = Path(__file__).parents[2] / "docs"
S = 1_000_000_000


def test_over_ssh_with_limits_and_without_a_shell_or_a_question():
    transfer = Transfer("rsync", "pilot@second", 2222, "/keys/my key", bandwidth_mb_s=10.0, stall_limit_ns=6 * S)
    assert transfer_command(transfer, "/rec/a b", TARGET, NAMES) == [
        "rsync", "--times", "--partial-dir=.partial", "--info=progress2", "--no-human-readable", "--timeout=6",
        "--protect-args", "--files-from=/here/.wanted", "--bwlimit=10m", "--rsh",
        "ssh -p 2222 -oBatchMode=yes -oConnectTimeout=6 -oServerAliveInterval=2 -oServerAliveCountMax=3 "
        "-oClearAllForwardings=yes -oIdentitiesOnly=yes -i '/keys/my key'",
        "--", "pilot@second:/rec/a b/", "/here/",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "name", ["my key", "o'neill's key", 'a "b" c', "k' -oProxyCommand=touch${IFS}x '", "a\\b", "''"]
)
def test_a_key_file_never_breaks_out_of_its_word(tmp_path, name):
    """rsync itself splits the words; what it starts in place of ssh writes down what it was given."""
    told, ssh = tmp_path / "told", tmp_path / "bin" / "ssh"
    ssh.parent.mkdir()
    ssh.write_text(f'#!/bin/sh\nprintf "%s\\0" "$@" >{told}\nexit 1\n')
    ssh.chmod(0o755)
    (tmp_path / "names").write_text("a\n")
    command = transfer_command(Transfer("rsync", "second", ssh_key=f"/k/{name}"), "/rec", tmp_path, tmp_path / "names")
    subprocess.run(
        command, env={"PATH": f"{ssh.parent}:{os.environ['PATH']}"}, capture_output=True, check=False, timeout=60
    )
    given = told.read_text().split("\0")
    assert given[given.index("-i") + 1 :][:2] == [f"/k/{name}", "second"]


def test_the_forced_command_of_the_documentation_lets_it_fetch_and_nobody_write_or_run_anything(tmp_path):
    if shutil.which("rsync") is None:
        pytest.skip("NOT TESTED: there is no rsync")
    (forced,) = re.findall(r'restrict,command="([^"]+)"', (DOCS / "security.md").read_text(encoding="utf-8"))
    there, here, ssh = tmp_path / "the disk" / PART, tmp_path / "here" / PART, tmp_path / "bin" / "ssh"
    for folder in (there, here, ssh.parent):
        folder.mkdir(parents=True)
    (there / "a-01.bag").write_bytes(b"a bag")
    (tmp_path / "names").write_text("a-01.bag\n")
    ssh.write_text(f"#!/bin/sh\nexec {forced}\n")  # as sshd does, whatever was asked for
    ssh.chmod(0o755)
    environment = {"PATH": f"{ssh.parent}:{os.environ['PATH']}"}
    fetch = transfer_command(Transfer("rsync", "second"), str(there), here, tmp_path / "names")
    subprocess.run(fetch, env=environment, check=True, timeout=60)
    assert (here / "a-01.bag").read_bytes() == b"a bag"
    push = ["rsync", "--protect-args", str(here / "a-01.bag"), f"second:{there}/b-01.bag"]
    other = ["ssh", "second", "touch", str(there / "b-01.bag")]
    for command in (push, other):
        asked = subprocess.run(
            command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, check=False, timeout=60
        )
        assert asked.returncode != 0
    assert [path.name for path in there.iterdir()] == ["a-01.bag"]


@pytest.mark.usefixtures("umask_of_nodes")
@pytest.mark.parametrize("umask", [0o000, 0o022], ids=oct)
def test_what_rsync_fetches_is_for_user_and_group_whoever_may_read_it_there(tmp_path, umask):
    if shutil.which("rsync") is None:
        pytest.skip("NOT TESTED: there is no rsync")
    there, here, names = tmp_path / "disk" / PART, tmp_path / "here" / PART, tmp_path / "names"
    for folder in (there, here):
        folder.mkdir(parents=True)
    (there / "a-01.bag").write_bytes(b"a bag")
    (there / "parts.json").write_bytes(b"{}")
    (here / "parts.json").write_bytes(b"of an earlier try")
    names.write_text("a-01.bag\nparts.json\n")
    open_to_others(there, umask)
    subprocess.run(transfer_command(Transfer("shared"), str(there), here, names), check=True, timeout=60)
    assert modes(here) == {".": "0750", "a-01.bag": "0640", "parts.json": "0640"}
    assert (here / "parts.json").read_bytes() == b"{}"


def test_from_a_mounted_folder():
    assert transfer_command(Transfer("shared"), "/rec/s/second", TARGET, NAMES)[-2:] == ["/rec/s/second/", "/here/"]
    assert transfer_command(Transfer("shared", mount="/mnt"), "/rec/s/second", TARGET, NAMES)[-2] == "/mnt/s/second/"
    nowhere = Transfer("shared", mount="~nobody_of_this_name/mnt")
    assert transfer_command(nowhere, "/rec/s/second", TARGET, NAMES)[-2] == "~nobody_of_this_name/mnt/s/second/"


HERE = Path("/here/s1_m/second")


@pytest.mark.parametrize("location", ["/rec/s1_m/second", "/rec of me/ü/s1_m/second", "/mnt/usb:1/s1_m/second/"])
def test_a_part_lies_in_the_folder_of_its_platform_in_that_of_the_session(location):
    assert misplaced(location, HERE) == ""


@pytest.mark.parametrize(
    "location",
    [
        "/rec/s0_m/second", "/rec/s1_m/main", "/rec/s1_m", "/etc", "/", "/second",  # another one's
        "rec/s1_m/second", "host:/s1_m/second", ":module/s1_m/second", "rsync://host/s1_m/second", "./s1_m/second",
        "-e sh/s1_m/second", "--rsh=sh/s1_m/second", "~/s1_m/second",
        "/rec/../s1_m/second", "/rec/s1_m/second/..", "/rec/s1_m/second/../../s1_m/second",
        "/rec/s1_m/second\n", "/re\0c/s1_m/second", "/rec\x1b[2J/s1_m/second",
    ],
)  # fmt: skip
def test_what_a_stranger_says_is_no_location_of_a_part_and_is_not_fetched(location):
    words = f"it is said to lie in {location!r}, which is no absolute path of a folder s1_m/second"
    assert misplaced(location, HERE) == words


def test_nothing_is_ever_removed_at_the_source():
    for by in ("rsync", "shared"):
        words = transfer_command(Transfer(by, "second"), "/rec", TARGET, NAMES)
        assert not [word for word in words if "remove" in word or "delete" in word]


def test_progress_is_the_last_percentage():
    assert progress_of("      1000  12%  1.00MB/s 0:00:01\r  2000  25%  1.0MB/s 0:00:01") == 0.25
    assert progress_of("no figures") is None


def test_a_problem_is_told_in_the_words_of_who_knows_it():
    rsync = "rsync: connection unexpectedly closed (0 bytes received so far) [Receiver]\nrsync error: unexplained error"
    assert problem_of(f"ssh: connect to host second port 22: Connection refused\n{rsync}\n", 255) == (
        "ssh: connect to host second port 22: Connection refused"
    )
    assert problem_of(f"{rsync}\n", 255) == "; ".join(rsync.split("\n"))
    assert problem_of("\n", 12) == "status 12"
