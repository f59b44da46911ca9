"""The command line of rsync, which never sees a shell, and what its output says."""

import os
import subprocess
from pathlib import Path

import pytest

from amaze_autonomy.config.schemas.recording import Transfer
from amaze_autonomy.recording.programs import problem_of, progress_of, transfer_command

pytestmark = pytest.mark.live

NAMES, TARGET = Path("/here/.wanted"), Path("/here")
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
    subprocess.run(command, env={"PATH": f"{ssh.parent}:{os.environ['PATH']}"}, capture_output=True, check=False)
    given = told.read_text().split("\0")
    assert given[given.index("-i") + 1 :][:2] == [f"/k/{name}", "second"]


def test_from_a_mounted_folder():
    assert transfer_command(Transfer("shared"), "/rec/s/second", TARGET, NAMES)[-2:] == ["/rec/s/second/", "/here/"]
    assert transfer_command(Transfer("shared", mount="/mnt"), "/rec/s/second", TARGET, NAMES)[-2] == "/mnt/s/second/"


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
