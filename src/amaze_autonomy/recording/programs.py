"""The programs that record and fetch: their command lines, and what their output means. Never through a shell.

rosbag's recorder in C++ records a group of recording.yaml. Its texts are those of tools/rosbag/src/recorder.cpp; it
warns of dropped messages at most every five seconds, so each warning stands for one message or more.

rsync fetches the files of a platform's part. It checks each by a checksum of the whole before it gets its name. What a
cut network left half is in `.partial` and is gone on with. Nothing is removed at the source.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import List, Optional, Sequence

from amaze_autonomy.config.schemas.recording import Storage, TopicGroup, Transfer
from amaze_autonomy.paths import expanded
from amaze_autonomy.units import SECOND

# --- rosbag's recorder ------------------------------------------------------------------------------------------------


_CHUNK_KB = {"none": 768, "lz4": 64}  # of a compressed chunk that is open nothing is on the disk yet


def bag_name(group: str, number: int) -> str:
    """Return the name of a group's bag, without what splitting adds to it."""
    return f"{group}-{number:02d}.bag"


def log_name(group: str) -> str:
    """Return the name of the file that a group's recorders write their warnings to."""
    return f"{group}.log"


def files_of(group: str, names: Sequence[str]) -> List[str]:
    """Return those of a folder's files that a group's recorders wrote, split ones and open ones among them."""
    pattern = re.compile(rf"{re.escape(group)}-\d\d+(_\d+)?\.bag(\.active)?")
    return sorted(name for name in names if pattern.fullmatch(name))


def last_number(group: str, names: Sequence[str]) -> int:
    """Return the highest number of a group's files in a folder, also of what was made of them; 0 when there is none."""
    pattern = re.compile(rf"\.?{re.escape(group)}-(\d\d+)(_\d+)?\..+")
    found = [pattern.fullmatch(name) for name in names]
    return max((int(match[1]) for match in found if match is not None), default=0)


def child_command(
    program: Sequence[str], node: str, group: TopicGroup, topics: Sequence[str], storage: Storage, output: Path
) -> List[str]:
    """Return the command for a recorder.

    Args:
        program: of the recorder.
        node: its name.
        group: what it records.
        topics: of the group, resolved.
        storage: settings where the group has none.
        output: of the bag.
    """
    compression = storage.compression if group.compression is None else group.compression
    chunk_kb = group.chunk_kb or storage.chunk_kb or _CHUNK_KB[compression]
    buffer_mb = storage.buffer_mb if group.buffer_mb is None else group.buffer_mb
    options = [f"--buffsize={buffer_mb}", f"--chunksize={chunk_kb}", f"--min-space={storage.reserve_mb}M"]
    options += ["--tcpnodelay", f"--output-name={output}"]
    if compression == "lz4":
        options.append("--lz4")
    if storage.split_mb:
        options += ["--split", f"--size={storage.split_mb}", "--repeat-latched"]
    if group.match and group.exclude:
        options.append(f"--exclude={group.exclude}")
    wanted = [*topics] if not group.match else ["--regex", *(re.escape(each) for each in topics), *group.match]
    return [*program, *options, *wanted, f"__name:={node}"]


# --- its log ----------------------------------------------------------------------------------------------------------


_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_DROPPED = re.compile(r"buffer exceeded", re.IGNORECASE)
_FULL = re.compile(r"disabling recording|logging disabled|no space left|error writing", re.IGNORECASE)
_ERROR = re.compile(r"^\[ ?(ERROR|FATAL)\]|^terminate called|^ +what\(\):", re.IGNORECASE)
_LONGEST = 160


@dataclass(frozen=True)
class LogState:
    """What a log has said so far.

    Args:
        dropped: warnings that messages were dropped.
        full: it stopped writing because the storage is full.
        error: its last error, in its words.
    """

    dropped: int = 0
    full: bool = False
    error: str = ""


def read_line(state: LogState, line: str) -> LogState:
    """Return what is known after one more line."""
    line = _COLOUR.sub("", line).rstrip()
    if _DROPPED.search(line):
        return replace(state, dropped=state.dropped + 1)
    if _FULL.search(line):
        state = replace(state, full=True)
    if _FULL.search(line) or _ERROR.search(line):
        return replace(state, error=line.strip()[:_LONGEST])
    return state


# --- rsync ------------------------------------------------------------------------------------------------------------


_PARTIAL = ".partial"
_SHELL = re.compile(r"^(rsync: |rsync error: )")  # what rsync says when ssh has failed says nothing
_WORDS = 2
_PLAIN = re.compile(r"[A-Za-z0-9_@%+=:,./-]+")
_PERCENT = re.compile(r"\s(\d{1,3})%\s")


def transfer_command(transfer: Transfer, location: str, target: Path, names: Path) -> List[str]:
    """Return the command that makes `target` hold files of the folder `location` of a platform.

    Args:
        transfer: how.
        location: absolute path, as the platform names it.
        target: folder on this computer.
        names: file on this computer with the names of the files, one a line.
    """
    stall_s = max(1, round(transfer.stall_limit_ns / SECOND))
    command = ["rsync", "--times", f"--partial-dir={_PARTIAL}", "--info=progress2", "--no-human-readable"]
    command += [f"--timeout={stall_s}", "--protect-args", f"--files-from={names}"]
    if transfer.bandwidth_mb_s:
        command.append(f"--bwlimit={transfer.bandwidth_mb_s:g}m")
    if transfer.by == "rsync":
        command += ["--rsh", _ssh(transfer, stall_s)]
        return [*command, "--", f"{transfer.host}:{location}/", f"{target}/"]
    return [*command, "--", f"{mounted(transfer, location)}/", f"{target}/"]


def misplaced(location: str, target: Path) -> str:
    """Return why a part does not lie where its platform's status says; an empty text when it may.

    The status may be a stranger's. An absolute path is no option, no host and no module of rsync; that of a part ends
    as the folder that it is fetched to: with session and platform.
    """
    parts = Path(location).parts
    if location.startswith("/") and location.isprintable() and ".." not in parts and parts[-2:] == target.parts[-2:]:
        return ""
    place = f"{target.parent.name}/{target.name}"
    return f"it is said to lie in {location!r}, which is no absolute path of a folder {place}"


def mounted(transfer: Transfer, location: str) -> str:
    """Return where a platform's part lies on this computer, when the recordings of that one are mounted here."""
    if not transfer.mount:
        return location
    return str(expanded(transfer.mount) / Path(location).parent.name / Path(location).name)


def _ssh(transfer: Transfer, stall_s: int) -> str:
    """Return the words of ssh; rsync splits them at spaces, and takes quotes for quotes."""
    words = ["ssh", "-p", str(transfer.ssh_port), "-oBatchMode=yes", f"-oConnectTimeout={stall_s}"]
    words += ["-oServerAliveInterval=2", f"-oServerAliveCountMax={max(1, stall_s // 2)}", "-oClearAllForwardings=yes"]
    if transfer.ssh_key:
        words += ["-oIdentitiesOnly=yes", "-i", str(expanded(transfer.ssh_key))]
    return " ".join(map(_quoted, words))


def _quoted(word: str) -> str:
    """Return a word as rsync takes it whole: in single quotes, where each of its own is doubled (rsync(1), --rsh)."""
    return word if _PLAIN.fullmatch(word) else "'" + word.replace("'", "''") + "'"


def problem_of(said: str, status: int) -> str:
    """Return why it failed, from what rsync and ssh said: the last lines of ssh and others, else of rsync."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    others = [line for line in lines if not _SHELL.match(line)]
    return "; ".join((others or lines)[-_WORDS:]) or f"status {status}"


def progress_of(text: str) -> Optional[float]:
    """Return the last progress in a piece of rsync's output, 0..1; None when there is none."""
    found = _PERCENT.findall(text)
    return min(1.0, int(found[-1]) / 100) if found else None
