"""`./run deb`, without a network: what apt is told of it, what is in it, and that it runs where it is unpacked."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from email.parser import Parser
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

pytest.importorskip("rospy", reason="needs ROS")
ROOT = Path(__file__).parents[2]
pytestmark = [
    pytest.mark.builds,
    pytest.mark.night,
    pytest.mark.xdist_group("deb"),
    pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="there is no dpkg-deb here"),
    pytest.mark.skipif(not (ROOT / ".venv" / "made").is_file(), reason="there is no environment that ./run made"),
]
PACKAGE = ET.parse(ROOT / "package.xml").getroot()
PREFIX = "/opt/amaze_autonomy"
PATIENCE_S = 1200  # on a machine that has much else to do


def said(*command, **variables) -> str:
    environment = {**os.environ, **variables}
    for name in ("PYTHONPATH", "ROS_PACKAGE_PATH", "CMAKE_PREFIX_PATH"):
        environment.pop(name, None)
    return subprocess.run(
        command, capture_output=True, text=True, check=True, timeout=PATIENCE_S, cwd="/", env=environment
    ).stdout


@pytest.fixture(scope="module")
def deb():
    cut_off = ["unshare", "--net"] if os.geteuid() == 0 else []
    command = [*cut_off, str(ROOT / "run"), "deb", "-Zgzip", "-z1"]  # the default takes a minute
    made = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert made.returncode == 0, made.stderr
    return Path(re.findall(r"^== (\S+\.deb) ", made.stderr, re.MULTILINE)[0])


@pytest.fixture(scope="module")
def unpacked(deb, tmp_path_factory):
    folder = tmp_path_factory.mktemp("unpacked")
    said("dpkg-deb", "--extract", str(deb), str(folder))
    return folder


@pytest.fixture(scope="module")
def fields(deb):
    return Parser().parsestr(said("dpkg-deb", "--field", str(deb)))


def test_apt_is_told_what_package_xml_says(deb, fields):
    person = PACKAGE.find("maintainer")

    assert fields["Package"] == "amaze-autonomy"
    assert fields["Version"].partition("+")[0] == PACKAGE.findtext("version")
    assert fields["Maintainer"] == f"{person.text} <{person.get('email')}>"
    assert fields["Architecture"] == said("dpkg", "--print-architecture").strip()
    assert deb.name == f"amaze-autonomy_{fields['Version']}_{fields['Architecture']}.deb"


def test_what_package_xml_needs_to_run_is_inside_or_comes_by_apt_and_nothing_that_only_builds(fields, unpacked):
    depends = {each.split()[0] for each in fields["Depends"].split(", ")}
    needed = {each.text for tag in ("depend", "exec_depend") for each in PACKAGE.iter(tag)}
    site = next(unpacked.glob(f".{PREFIX}/python/lib/python3*/site-packages"))
    inside = {f"python3-{path.name}" for path in site.iterdir()}

    def is_there(name):
        ways = (name, f"python3-{name.replace('_', '-')}", f"ros-noetic-{name.replace('_', '-')}")
        return name in inside or depends.intersection(ways)

    assert {name for name in needed if not is_there(name)} <= {"message_runtime"}, "that is for C++"
    assert {"python3-rosbags", "python3-pymavlink", "python3-plotly"} <= inside
    assert [name for name in depends if re.fullmatch(r"cmake|build-essential|python3-venv|.*-dev", name)] == []


def test_every_command_is_in_the_path_and_every_node_where_roslaunch_looks_for_it(unpacked):
    commands = re.findall(r'^([a-z-]+) = "[a-z_.]+:main"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    nodes = {path.name for path in (ROOT / "scripts").iterdir()}
    there = unpacked / PREFIX[1:] / "lib" / "amaze_autonomy"

    links = {path.name: os.readlink(path) for path in (unpacked / "usr" / "bin").iterdir()}
    assert links == {name: f"{PREFIX}/lib/amaze_autonomy/{name}" for name in commands}
    assert {path.name: path.read_text().splitlines()[0] for path in there.iterdir()} == dict.fromkeys(
        nodes, f"#!{PREFIX}/python/bin/python3"
    )
    for name in ("setup.bash", "share/amaze_autonomy/launch/autonomy.launch", "share/amaze_autonomy/package.xml"):
        assert (unpacked / PREFIX[1:] / name).is_file()


@pytest.fixture
def at_its_place(unpacked):
    """Run a command where the package is installed, which only that command sees."""
    if subprocess.run(["unshare", "--mount", "true"], capture_output=True, check=False, timeout=60).returncode:
        pytest.skip("mounts nothing here: only root can")

    def run(command: str) -> list[str]:
        place = f"mount --bind {unpacked}/opt /opt && {command}"
        return said("unshare", "--mount", "bash", "-ec", place, PATH="/usr/bin:/bin").splitlines()

    return run


def test_commands_run_of_what_is_packed_and_know_nothing_of_the_place_where_it_was_built(at_its_place):
    program = (
        "import amaze_autonomy.msg, amaze_autonomy.nodes.autonomy.node, amaze_autonomy.nodes.web.node\n"
        "import numpy, pymavlink, rosbags.rosbag1, rospy, sys\n"
        "from amaze_autonomy.paths import config_folder\n"
        "print(amaze_autonomy.__file__, amaze_autonomy.msg.__file__, config_folder())\n"
        "print(numpy.__file__, pymavlink.__file__, rosbags.rosbag1.__file__)\n"
        "print(rospy.__file__, *sys.path)"
    )

    ours, packed, others = at_its_place(f"{PREFIX}/python/bin/python3 -c '{program}'")

    library, config = f"{PREFIX}/lib/python3/dist-packages/amaze_autonomy", f"{PREFIX}/share/amaze_autonomy/config"
    assert ours.split() == [f"{library}/__init__.py", f"{library}/msg/__init__.py", config]
    assert [name for name in packed.split() if not name.startswith(f"{PREFIX}/python/lib/")] == []
    assert str(ROOT) not in others
    assert at_its_place(f"{PREFIX}/lib/amaze_autonomy/amaze-replay maps")[0].startswith("amaze_demo ")
    assert "mission 1: COMPLETE" in at_its_place(f"{PREFIX}/lib/amaze_autonomy/amaze-autonomy simulate")


def test_setup_bash_finds_the_package_and_leaves_the_system_its_python(at_its_place):
    shown = at_its_place(f"source {PREFIX}/setup.bash; rospack find amaze_autonomy; command -v python3")

    assert shown == [f"{PREFIX}/share/amaze_autonomy", "/usr/bin/python3"]


def test_nothing_inside_names_the_place_where_it_was_built(unpacked):
    place = str(ROOT).encode()

    naming = [path for path in unpacked.rglob("*") if path.is_file() and place in path.read_bytes()]

    assert naming == []
