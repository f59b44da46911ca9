"""The real autopilots in software-in-the-loop: where they are, how each is started, and what it is told then."""

from __future__ import annotations

import dataclasses
import os
import shutil
import signal
import subprocess
from pathlib import Path
from typing import IO, Dict, List, Mapping, Optional, Tuple

ROOT = Path(__file__).resolve().parents[2]

NODE, PLANNER, GROUND = 24540, 24541, 24550
"""Ports of the relay that the autopilot speaks to: for the autopilot node, the planner, the ground station."""


@dataclasses.dataclass(frozen=True)
class Kind:
    """One autopilot.

    Args:
        name: of its folder.
        program: that is in it.
        parameters: that each flight begins with.
        overrides: of the configuration, where this simulated vehicle is another one than the shipped files are for.
        holds: name, as ours, of the mode in which it flies by the sticks and holds its place.
        boot_speed: simulated seconds per second until it can be armed; 1: in real time.
    """

    name: str
    program: str
    parameters: Mapping[str, float]
    overrides: Tuple[str, ...]
    holds: str
    boot_speed: int = 1


KINDS: Mapping[str, Kind] = {
    "px4": Kind(
        "px4",
        "px4/bin/px4",
        # the transmitter is a thread of Python here: half a second of silence (PX4's default) is no lost transmitter
        {
            "COM_LOW_BAT_ACT": 3,
            "COM_RC_OVERRIDE": 1,
            "COM_RC_IN_MODE": 1,
            "COM_RC_LOSS_T": 2,
            "NAV_RCL_ACT": 2,
            "SIM_BAT_DRAIN": 1000,
        },
        ("vehicle=px4_sitl",),
        "POSCTL",
    ),
    "ardupilot": Kind(
        "ardupilot",
        "ardupilot/arducopter",
        {"WPNAV_SPEED": 100, "WPNAV_SPEED_UP": 100},
        ("vehicle=ardupilot_sitl",),
        "POSCTL",
        boot_speed=8,
    ),
}


def folder_of(name: str) -> Optional[Path]:
    """Return the folder of an autopilot: below AMAZE_SITL, else ../shared/sitl; None: it is not there."""
    given = os.environ.get("AMAZE_SITL")
    base = Path(given) if given else ROOT.parent / "shared" / "sitl"
    return base / name if (base / KINDS[name].program).is_file() else None


def ready_to_run(name: str, found: Path, build: Path) -> Path:
    """Return a folder from which the autopilot runs: the one that was found, or a copy with its links put right.

    PX4's commands are symbolic links to its program; a copy that lost them (a zip file, some shares) has text files.
    """
    if name != "px4" or os.access(found / "bin" / "px4-param", os.X_OK):
        return found
    copy = build / "sitl" / "px4"
    if not copy.exists():
        unfinished = copy.with_name(f"px4.{os.getpid()}")
        shutil.copytree(found, unfinished)
        (unfinished / "bin").chmod(0o755)
        for command in (unfinished / "bin").iterdir():
            if command.stat().st_size == len("px4") and command.read_text() == "px4":
                command.unlink()
                command.symlink_to("px4")
        unfinished.rename(copy)
    return copy


class Autopilot:
    """One running autopilot. A second start in the same folder is the same vehicle, switched on again.

    Args:
        kind: which.
        folder: where its program is.
        work: where it keeps parameters and the stored mission.
        parameters: besides those of its kind.
    """

    def __init__(self, kind: Kind, folder: Path, work: Path, parameters: Mapping[str, float]) -> None:
        self.kind = kind
        self._folder, self._work = folder, work
        self._parameters: Dict[str, float] = {**kind.parameters, **parameters}
        self._process: Optional[subprocess.Popen[bytes]] = None
        self._log: Optional[IO[bytes]] = None

    def start(self) -> None:
        """Switch it on."""
        self._work.mkdir(parents=True, exist_ok=True)
        command = [str(self._folder / "run.sh"), "--api", str(NODE), "--api2", str(PLANNER), "--gcs", str(GROUND)]
        if self.kind.boot_speed > 1:
            command += ["--speed", str(self.kind.boot_speed)]
        command += self._given()
        self._log = (self._work.parent / f"{self.kind.name}.txt").open("ab")
        self._process = subprocess.Popen(
            [*command, str(self._work)],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
            start_new_session=True,
        )

    def _given(self) -> List[str]:
        given: List[str] = []
        for name, value in self._parameters.items():
            given += ["--param", f"{name}={value:g}"]
        return given

    @property
    def runs(self) -> bool:
        """Tell whether it runs."""
        return self._process is not None and self._process.poll() is None

    @property
    def session(self) -> int:
        """The session of its processes; 0 before it was switched on."""
        return 0 if self._process is None else self._process.pid

    def kill(self) -> None:
        """Take its power away."""
        if self._process is not None:
            if self.runs:
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait(10.0)
        if self._log is not None:
            self._log.close()
