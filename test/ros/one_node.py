"""One node of the package as a process of a test, with a configuration of its own."""

from __future__ import annotations

import atexit
import os
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any, Callable, Dict, Sequence, Union

import roslib.packages
import rospy
from hitches import PATIENCE

from amaze_autonomy.paths import config_folder


class OneNode:
    """A process.

    Args:
        kind: executable, and name of the node.
        namespace: it is started in.
        overrides: of the configuration.
        sensors: text of sensors.yaml; empty: the one that ships.
        missions: likewise.
        parameters: private ones.
        modules: folders where it finds further modules, with colons.
    """

    def __init__(
        self,
        kind: str,
        namespace: str = "",
        overrides: Sequence[str] = (),
        sensors: str = "",
        missions: str = "",
        parameters: Dict[str, Any] = {},  # noqa: B006
        modules: str = "",
    ) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix=f"amaze_{kind}_"))
        shutil.copytree(config_folder(), self.folder, dirs_exist_ok=True)
        for name, text in (("sensors", sensors), ("missions", missions)):
            if text:
                (self.folder / f"{name}.yaml").write_text(text)
        path = f"{namespace}/{kind}"
        for name, value in parameters.items():
            rospy.set_param(f"{path}/{name}", value)
        self._log = (self.folder / "log").open("wb")
        command = [roslib.packages.find_node("amaze_autonomy", kind)[0], "--config", str(self.folder)]
        command += ["--overrides", "; ".join(overrides)]
        environment = {**os.environ, "ROS_NAMESPACE": namespace or "/"}
        if modules:
            environment["PYTHONPATH"] = f"{modules}:{environment.get('PYTHONPATH', '')}"
        self.process = subprocess.Popen(command, env=environment, stdout=self._log, stderr=self._log)
        atexit.register(self._kill)  # a test that fails before `end` leaves nothing running

    @property
    def log(self) -> str:
        return (self.folder / "log").read_text(errors="replace")

    def _kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()

    def end(self) -> int:
        """End it as roslaunch does; return its exit status."""
        self.process.send_signal(signal.SIGINT)
        try:
            return wait_for_end(self.process)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise
        finally:
            self._log.close()
            shutil.rmtree(self.folder, ignore_errors=True)


def wait_for(
    condition: Callable[[], Any], what: Union[str, Callable[[], str]], limit_s: float = 20.0, period_s: float = 0.005
) -> Any:
    """Wait for something that becomes true; return it. Words that are a function are asked when it did not come.

    The limit is that of a quiet machine: others are waited for longer.

    A condition that asks a node for something has a period of a second, as in flight: more often starves it.
    """
    deadline_s = time.monotonic() + PATIENCE * limit_s
    while True:
        found = condition()
        if found:
            return found
        if time.monotonic() >= deadline_s:
            raise AssertionError(
                f"{what if isinstance(what, str) else what()} did not come within {PATIENCE} x {limit_s} s"
            )
        time.sleep(period_s)


def wait_for_service(name: str, limit_s: float = 20.0) -> None:
    """Wait until a service is there. The limit is that of a quiet machine.

    Raises:
        rospy.ROSException: it did not come.
    """
    rospy.wait_for_service(name, PATIENCE * limit_s)


def wait_for_end(process: subprocess.Popen[Any], limit_s: float = 20.0) -> int:
    """Wait for the end of a process; return its exit status. The limit is that of a quiet machine.

    Raises:
        subprocess.TimeoutExpired: it goes on.
    """
    return process.wait(PATIENCE * limit_s)
