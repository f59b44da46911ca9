"""The command line of rsync that fetches files of a platform's part, and what its output says. Never through a shell.

rsync checks each file by a checksum of the whole before it gets its name. What a cut network left half is in `.partial`
and is gone on with. Nothing is removed at the source.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import List, Optional

from amaze_autonomy.config.recording_schema import Transfer

__all__ = ["mounted", "problem_of", "progress_of", "transfer_command"]

_PARTIAL = ".partial"
_SHELL = re.compile(r"^(rsync: |rsync error: )")  # what rsync says when ssh has failed says nothing
_WORDS = 2
_PERCENT = re.compile(r"\s(\d{1,3})%\s")


def transfer_command(transfer: Transfer, location: str, target: Path, names: Path) -> List[str]:
    """Return the command that makes `target` hold files of the folder `location` of a platform.

    Args:
        transfer: how.
        location: absolute path, as the platform names it.
        target: folder on this computer.
        names: file on this computer with the names of the files, one a line.
    """
    stall_s = max(1, round(transfer.stall_limit_ns / 1e9))
    command = ["rsync", "--times", f"--partial-dir={_PARTIAL}", "--info=progress2", "--no-human-readable"]
    command += [f"--timeout={stall_s}", "--protect-args", f"--files-from={names}"]
    if transfer.bandwidth_mb_s:
        command.append(f"--bwlimit={transfer.bandwidth_mb_s:g}m")
    if transfer.by == "rsync":
        command += ["--rsh", _ssh(transfer, stall_s)]
        return [*command, "--", f"{transfer.host}:{location}/", f"{target}/"]
    return [*command, "--", f"{mounted(transfer, location)}/", f"{target}/"]


def mounted(transfer: Transfer, location: str) -> str:
    """Return where a platform's part lies on this computer, when the recordings of that one are mounted here."""
    if not transfer.mount:
        return location
    return str(Path(transfer.mount).expanduser() / Path(location).parent.name / Path(location).name)


def _ssh(transfer: Transfer, stall_s: int) -> str:
    """Return the words of ssh; rsync splits them at spaces, and takes quotes for quotes."""
    words = ["ssh", "-p", str(transfer.ssh_port), "-oBatchMode=yes", f"-oConnectTimeout={stall_s}"]
    words += ["-oServerAliveInterval=2", f"-oServerAliveCountMax={max(1, stall_s // 2)}", "-oClearAllForwardings=yes"]
    if transfer.ssh_key:
        words += ["-oIdentitiesOnly=yes", "-i", str(Path(transfer.ssh_key).expanduser())]
    return " ".join(f'"{word}"' if " " in word else word for word in words)


def problem_of(said: str, status: int) -> str:
    """Return why it failed, from what rsync and ssh said: the last lines of ssh and others, else of rsync."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    others = [line for line in lines if not _SHELL.match(line)]
    return "; ".join((others or lines)[-_WORDS:]) or f"status {status}"


def progress_of(text: str) -> Optional[float]:
    """Return the last progress in a piece of rsync's output, 0..1; None when there is none."""
    found = _PERCENT.findall(text)
    return min(1.0, int(found[-1]) / 100) if found else None
