"""The package in workspaces of catkin_make, catkin_tools and colcon, used from a shell that knows nothing of us.

The message packages of the CNS Flight Stack are in the same workspace: written from their fields, or, where AMAZE_CNS
names a folder that has them, they themselves.
"""

from __future__ import annotations

import os
import pty
import shutil
import socket
import sys
from pathlib import Path

import cns_definitions
import pytest

pytest.importorskip("rospy", reason="needs ROS")
pytestmark = pytest.mark.builds

ROOT = Path(__file__).parents[2]
PYTHON = f"-DPYTHON_EXECUTABLE={sys.executable}"
NOETIC = "[ ! -f /opt/ros/noetic/setup.bash ] || source /opt/ros/noetic/setup.bash"
BUILD = {
    "catkin_make": f"catkin_make {PYTHON} install",
    "catkin": f"catkin config --init --install --cmake-args {PYTHON} && catkin build --no-status --no-notify",
    "colcon": f"colcon build --cmake-args {PYTHON}",
}
EXECUTABLES = sorted(path.name for path in (ROOT / "scripts").iterdir())


@pytest.fixture(scope="module", params=[pytest.param(tool, marks=pytest.mark.xdist_group(tool)) for tool in BUILD])
def workspace(request, build_copy):
    """Build and install, then take the source away."""
    if shutil.which(request.param) is None:
        pytest.skip(f"{request.param} is not installed")
    if request.param == "catkin":  # runs cmake in a pseudo terminal: skipped where there is none
        for end in pty.openpty():
            os.close(end)
    folder = ROOT / "build" / ".workspaces" / request.param  # hidden: roslaunch looks for files in the source tree
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "src").mkdir(parents=True)
    beside(folder / "src")
    build_copy(folder / "src" / "amaze_autonomy", f"{NOETIC}; {BUILD[request.param]}", folder)
    shutil.rmtree(folder / "src")
    return folder


def beside(folder: Path) -> None:
    """Lay the packages of CNS into a workspace."""
    given = os.environ.get("AMAZE_CNS", "")
    if not given:
        cns_definitions.sources(folder)
    for package in cns_definitions.PACKAGES if given else ():
        shutil.copytree(Path(given) / package, folder / package)


def installed(workspace: Path, name: str) -> Path:
    (path,) = workspace.glob(f"install/**/lib/amaze_autonomy/{name}")
    return path


def test_every_executable_names_the_interpreter_of_the_build(workspace):
    shebangs = {name: installed(workspace, name).read_text().splitlines()[0] for name in EXECUTABLES}

    assert shebangs == dict.fromkeys(EXECUTABLES, f"#!{sys.executable}")


def test_the_install_space_needs_nothing_of_the_source_tree(workspace, shell):
    program = workspace / "where.py"
    program.write_text(
        "import amaze_autonomy, amaze_autonomy.msg, amaze_autonomy.nodes.autonomy.node\n"
        "from amaze_autonomy.paths import config_folder\n"
        "print(amaze_autonomy.__file__, amaze_autonomy.msg.__file__, config_folder(), sep='\\n')\n"
    )

    output = shell(f"source install/setup.bash && {sys.executable} {program}", workspace)

    prefix = installed(workspace, "autonomy").parents[2]
    assert output.splitlines() == [
        f"{prefix}/lib/python3/dist-packages/amaze_autonomy/__init__.py",
        f"{prefix}/lib/python3/dist-packages/amaze_autonomy/msg/__init__.py",
        f"{prefix}/share/amaze_autonomy/config",
    ]


def test_the_messages_of_cns_that_are_built_beside_it_are_those_that_its_nodes_know(workspace, shell):
    program = workspace / "cns.py"
    program.write_text(
        "from amaze_autonomy.cns.tables import SERVICES, TOPICS\n"
        "from amaze_autonomy.nodes.cns.names import cns_classes\n"
        "found = cns_classes({**TOPICS, **SERVICES}, SERVICES)\n"
        "print(*sorted({kind.__module__.split('.')[0] for kind in found.values()}))\n"
    )

    output = shell(f"source install/setup.bash && {sys.executable} {program}", workspace)

    assert output.split() == ["mission_sequencer", "std_msgs", "std_srvs", "watchdog_msgs"]


def test_the_stack_starts_from_the_install_space_whatever_python3_is_in_the_path(workspace, shell):
    (workspace / "bad").mkdir()
    for name in ("python", "python3"):
        (workspace / "bad" / name).write_text("#!/bin/sh\nexit 111\n")
        (workspace / "bad" / name).chmod(0o755)
    with socket.socket() as server:
        server.bind(("", 0))
        port = server.getsockname()[1]
    started = (
        "until rosnode list 2>/dev/null | grep -qx /simulation"
        " && rosservice list 2>/dev/null | grep -q /autonomy/select_mission; do"
        " kill -0 $! && sleep 0.3 || exit 1; done; rosnode list; kill -INT $!; wait $!"
    )

    output = shell(
        f"source install/setup.bash; export PATH={workspace}/bad:$PATH; set -m;"
        f"roslaunch -p {port} amaze_autonomy autonomy.launch simulation:=true record:=false & {started}",
        workspace,
        ROS_MASTER_URI=f"http://localhost:{port}",
        ROS_HOME=str(workspace / "ros_home"),
    )

    assert "/autonomy" in output.splitlines()
    assert "/simulation" in output.splitlines()
