"""The one command for every job, from the outside."""

from __future__ import annotations

import importlib
import math
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Optional
from xml.etree import ElementTree as ET

import pytest

from amaze_autonomy.config import load_configuration
from amaze_autonomy.simulation.ardupilot import AUTOPILOTS

ROOT = Path(__file__).parents[2]


def run(*arguments: str, folder: Path, programs: Optional[Path] = None) -> subprocess.CompletedProcess:
    command = [str(ROOT / "run"), *arguments]
    environment = {**os.environ, **({"PATH": f"{programs}:{os.environ['PATH']}"} if programs else {})}
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=600, env=environment
    )


def test_without_a_job_it_lists_them_all(tmp_path):
    result = run(folder=tmp_path)

    listed = [line.split()[0] for line in result.stdout.splitlines()[1:]]
    assert listed == [
        *("build", "demo", "demo-two-computers", "console", "replay", "test", "test-all", "test-beside"),
        *(
            "test-py38",
            "test-lowest",
            "test-python",
            "test-proof",
            "test-builds",
            "test-ros",
            "test-sitl",
            "test-long",
            "docs",
            "screens",
            "lint",
        ),
        *(
            "proof",
            "mutate",
            "soak",
            "soak-cuts",
            "live",
            "sitl",
            "sitl-mavsdk",
            "bench",
            "test-bare",
            "install",
            "bundle",
            "deb",
            "advisories",
            "clean",
        ),
    ]
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("job", ["tests", "setup", "-h"])
def test_what_is_no_job_is_refused_with_the_list(tmp_path, job):
    result = run(job, folder=tmp_path)

    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == run(folder=tmp_path).stdout


@pytest.mark.night
@pytest.mark.builds
@pytest.mark.skipif(not (ROOT / ".venv" / "made").is_file(), reason="there is no environment that ./run made")
def test_a_folder_that_was_copied_to_a_path_with_spaces_and_umlauts_works_without_a_network(tmp_path, shell):
    folder = tmp_path / "neue übergabe"
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60
    ).stdout
    for name in tracked.splitlines():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    shutil.copytree(ROOT / ".venv", folder / ".venv", symlinks=True)
    shutil.copytree(ROOT / "build" / "stamps", folder / "build" / "stamps")
    cut_off = ["unshare", "--net"] if os.geteuid() == 0 else []

    result = subprocess.run(
        [*cut_off, str(folder / "run"), "replay", "maps"], capture_output=True, text=True, check=False, timeout=600
    )

    assert result.returncode == 0, result.stderr
    assert "crazyflie_sine" in result.stdout
    first_lines = f"""#!/bin/sh\n'''exec' "{folder}/.venv/bin/python3" "$0" "$@"\n' '''\n"""
    assert (folder / ".venv" / "bin" / "amaze-replay").read_text().startswith(first_lines), "as pip does it"
    where = [
        str(folder / ".venv" / "bin" / "python3"),
        "-I",
        "-c",
        "import amaze_autonomy; print(amaze_autonomy.__file__)",
    ]
    found = subprocess.run(where, cwd="/", capture_output=True, text=True, check=True, timeout=120).stdout
    assert found.strip() == str(folder / "src" / "amaze_autonomy" / "__init__.py")
    node = "build/devel/lib/amaze_autonomy/amaze-replay maps; roslaunch --nodes amaze_autonomy autonomy.launch"
    started = shell(f"source build/devel/setup.bash; {node}", folder)
    assert "crazyflie_sine" in started, "an executable that roslaunch starts"
    assert "/mission_planner" in started.splitlines()


WRONG_PORTS = ("abc", "0", "-1", "1.5", "65535", "14540;simulation=false")


@pytest.mark.parametrize(
    "argument, words",
    [
        ("vehicle:=px5", "there is no vehicle px5: px4, ardupilot or external"),
        ("faults:=lfr", "there is no scenario lfr: name a file, or one of config/faults by its name"),
    ],
)
def test_a_demo_that_cannot_be_is_refused_before_anything_starts(tmp_path, argument, words):
    result = run("demo", argument, folder=tmp_path)

    assert (result.returncode, result.stdout, result.stderr) == (2, "", f"run: {words}\n")


def function(name: str, call: str, folder: Path, **environment: str) -> str:
    """Call a function of `run` without the job; return what it says."""
    text = (ROOT / "run").read_text(encoding="utf-8")
    body = re.search(rf"^{name}\(\) \{{.*?^\}}", text, re.MULTILINE | re.DOTALL)[0]
    lists = "\n".join(re.findall(r'^(?:messages|tools)=".*"$', text, re.MULTILINE))
    script = f"set -euo pipefail; here=$PWD\n{lists}\n{body}\n{call}"
    command = ["bash", "-c", script]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=True, timeout=60, env={**os.environ, **environment}
    )
    return done.stdout


def test_a_folder_in_the_home_is_no_folder_of_that_name(tmp_path):
    home = str(tmp_path / "of & me")
    paths = ("~/out", "~", "out", "/out", "~out", "a/~/out")
    told = [function("absolute", f"absolute '{path}'", tmp_path, HOME=home).rstrip("\n") for path in paths]
    here = str(tmp_path)
    assert told == [f"{home}/out", home, f"{here}/out", "/out", f"{here}/~out", f"{here}/a/~/out"]


def test_the_folder_of_a_demo_on_two_computers_is_in_the_home_too(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "demo"))
    monkeypatch.setenv("HOME", str(tmp_path))
    two_computers = importlib.import_module("two_computers")
    output, demo, shared = two_computers.split(["output:=~/out", "config:=~/config"])
    assert (output, demo) == (tmp_path / "out", ["config:=~/config"])
    assert shared == [f"config:={tmp_path / 'config'}"]


def test_two_demos_of_one_second_have_a_folder_each(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "demo"))
    two_computers = importlib.import_module("two_computers")
    made = [Path(function("new_folder", "new_folder flight", tmp_path).rstrip("\n")) for _ in range(3)]
    assert made == [Path("flight"), Path("flight_2"), Path("flight_3")]
    assert two_computers.new_folder(tmp_path / "flight") == tmp_path / "flight_4"
    assert two_computers.new_folder(tmp_path / "another" / "flight") == tmp_path / "another" / "flight"
    assert all((tmp_path / each).is_dir() for each in (*made, "flight_4", "another/flight"))


class Ports:
    """The ports of a demo, as long as it reads."""

    def __init__(self):
        command = [sys.executable, str(ROOT / "demo" / "ports.py")]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def taken(self):
        master, vehicle, page = map(int, self._process.stdout.readline().split())
        return {master, vehicle, vehicle + 1, page}

    def end(self):
        self._process.stdout.close()
        assert self._process.wait(timeout=60) == 0


def test_demos_that_are_started_at_once_have_no_port_in_common_though_none_is_open_yet():
    demos = [Ports() for _ in range(4)]
    ports = [demo.taken() for demo in demos]
    for demo in demos:
        demo.end()
    assert len(set.union(*ports)) == 4 * len(ports)


def test_the_ports_of_a_demo_that_has_ended_are_free_and_those_that_are_open_are_not():
    with socket.socket() as stranger:
        stranger.bind(("127.0.0.1", 0))
        stranger.listen()
        usual = stranger.getsockname()[1]
        assert first_port(usual) != usual
    assert first_port(usual) == usual
    assert first_port(usual) == usual


def first_port(usual):
    """Ask for a port as a demo does that ends at once; return which it was."""
    script = (
        "import socket, sys; from contextlib import ExitStack; from ports import free_ports\n"
        f"with ExitStack() as kept: print(free_ports(kept, {usual}, 1, socket.SOCK_STREAM, ''))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT / "demo", capture_output=True, text=True, check=True, timeout=60
    )
    return int(done.stdout)


def test_the_system_packages_of_a_bundle_are_those_of_its_system(tmp_path):
    calls = (f"packages '' {suite}" for suite in ("focal", "bookworm"))
    focal, bookworm = (function("packages", call, tmp_path).split() for call in calls)
    assert {"ros-noetic-rospy", "ros-noetic-rosbag", "python3-venv"} <= set(focal)
    assert {"python3-rospy", "python3-rosbag", "python3-venv", "libstd-msgs-dev"} <= set(bookworm)
    assert not [name for name in bookworm if name.startswith("ros-noetic")]
    assert not set(focal) & {"python3-rospy", "rosbash"}


def test_a_bundle_installs_its_wheels_in_a_folder_with_spaces(tmp_path):
    folder = tmp_path / "a board, 100% ours"
    (folder / "wheels").mkdir(parents=True)
    with zipfile.ZipFile(folder / "wheels" / "ours-1.0-py3-none-any.whl", "w") as wheel:
        wheel.writestr("ours-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: ours\nVersion: 1.0\n")
        wheel.writestr("ours-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr("ours-1.0.dist-info/RECORD", "")
    text = (ROOT / "run").read_text(encoding="utf-8").split("<<'INSTALL'\n")[1].split("\nINSTALL\n")[0]
    (folder / "install").write_text(text)
    (folder / "run").write_text(f'"{sys.executable}" -m pip download -q --no-cache-dir -d fetched ours\n')
    environment = {**os.environ, "PIP_FIND_LINKS": "/elsewhere", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    command = ["bash", str(folder / "install")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert [path.name for path in (folder / "fetched").iterdir()] == ["ours-1.0-py3-none-any.whl"]


def test_a_bundle_has_what_rosbags_needs_on_an_older_python_than_the_one_that_makes_it():
    text = (ROOT / "run").read_text(encoding="utf-8")
    fetched = text.split("run_bundle()")[1].split("run_deb()")[0]
    assert 'declared dependencies; declared page; echo "typing_extensions>=4.5"' in fetched


SWITCHES = (
    *("autonomy", "console", "watchdog", "landing_detection", "state_estimation", "autopilot", "mission_planner"),
    *("data_recorder", "record", "second_recorder"),
)


@pytest.mark.parametrize(
    "argument, words",
    [
        ("vehicle:=px5", "vehicle:=px5 is none of px4, ardupilot, external"),
        ("flight:=no", "flight:=no is none of real, simulated"),
        *((f"{name}:=no", f"{name}:=no is neither true nor false") for name in SWITCHES),
        ("output:=2024", "output:=2024 is a number or true or false to roslaunch: write its whole path"),
        ("recordings:=1.10", "recordings:=1.1 is a number or true or false to roslaunch: write its whole path"),
        *(
            (f"{name}:=a/run", f"{name}:=a/run begins with neither / nor ~: write its whole path")
            for name in ("output", "runs", "recordings")
        ),
        *((f"mavlink_port:={p}", f"mavlink_port:={p} is no port with a next one: 1 to 65534") for p in WRONG_PORTS),
        ("config:=true", "config:=True is a number or true or false to roslaunch: write its whole path"),
    ],
)
def test_a_launch_that_cannot_be_is_refused_before_anything_starts(argument, words):
    substitution = pytest.importorskip("roslaunch.substitution_args", reason="needs ROS")
    checked = ET.parse(ROOT / "launch" / "autonomy.launch").getroot().findall("arg")
    values = {each.get("name"): each.get("default") for each in checked if each.get("default") is not None}
    name, _, given = argument.partition(":=")
    check = next(each.get("value") for each in checked if each.get("name") == f"_checked_{name}")

    assert substitution.resolve_args(check, {"arg": values}) == "True"
    with pytest.raises(KeyError) as caught:
        substitution.resolve_args(check, {"arg": {**values, name: given}})
    assert caught.value.args == (words,)


@pytest.mark.parametrize("name", ["output", "runs", "recordings"])
@pytest.mark.parametrize("given", ["/data/run", "~/run", "~", "~pilot/run"])
def test_a_whole_path_is_a_folder_of_a_launch(name, given):
    substitution = pytest.importorskip("roslaunch.substitution_args", reason="needs ROS")
    checked = ET.parse(ROOT / "launch" / "autonomy.launch").getroot().findall("arg")
    check = next(each.get("value") for each in checked if each.get("name") == f"_checked_{name}")
    assert substitution.resolve_args(check, {"arg": {name: given}}) == "True"


@pytest.mark.slow_rows
@pytest.mark.parametrize("words", [("platform:=1",), ("platform:=true",), ("platform:=main", "transfer:=1")])
@pytest.mark.parametrize("processes", ["separate", "forked"])
@pytest.mark.parametrize("simulation", ["true", "false"])
def test_a_name_that_is_a_number_to_roslaunch_is_a_name(words, processes, simulation):
    loaded = loaded_launch(f"processes:={processes}", f"simulation:={simulation}", "second_platform:=2", *words)
    [told] = [node.args for node in loaded.nodes if " --folder " in node.args and "data_recorder_2" not in node.name]
    assert f" --transfer '{1 if len(words) > 1 else 'shared' if simulation == 'true' else ''}'" in told


@pytest.mark.parametrize("name, check", [("cns_peers", "_checked_cns"), ("cns_served", "_checked_served")])
def test_a_number_is_none_of_the_nodes(name, check):
    substitution = pytest.importorskip("roslaunch.substitution_args", reason="needs ROS")
    checked = ET.parse(ROOT / "launch" / "autonomy.launch").getroot().findall("arg")
    values = {each.get("name"): each.get("value") for each in checked}
    with pytest.raises(KeyError, match=f"{name}:=1 has what is none of {values['_five']}"):
        substitution.resolve_args(values[check], {"arg": {name: "1", "_five": values["_five"]}})


def test_the_folder_of_a_recorder_that_is_started_alone_is_no_number_and_no_part_of_a_path():
    substitution = pytest.importorskip("roslaunch.substitution_args", reason="needs ROS")
    checked = ET.parse(ROOT / "launch" / "recorder.launch").getroot().findall("arg")
    checks = {each.get("name"): each.get("value") for each in checked}
    for name in ("config", "folder"):
        assert substitution.resolve_args(checks[f"_checked_{name}"], {"arg": {name: "/data/2024"}}) == "True"
        with pytest.raises(KeyError, match=f"{name}:=2024 is a number"):
            substitution.resolve_args(checks[f"_checked_{name}"], {"arg": {name: "2024"}})
    assert substitution.resolve_args(checks["_checked_folder"], {"arg": {"folder": ""}}) == "True"
    with pytest.raises(KeyError, match="folder:=main/today begins with neither / nor ~: write its whole path"):
        substitution.resolve_args(checks["_checked_folder"], {"arg": {"folder": "main/today"}})


def test_a_recorder_that_is_started_alone_is_told_its_platform():
    """As the collector it would have the name of that one's node, and the master would end the two in turn."""
    missing = pytest.importorskip("roslaunch.core", reason="needs ROS").RLException
    with pytest.raises(missing, match="requires the 'platform' arg to be set"):
        loaded_launch("config:=/flight/config", file="recorder.launch")
    [node] = loaded_launch("platform:=second", file="recorder.launch").nodes
    assert node.name == "data_recorder_second"


def loaded_launch(*words: str, file: str = "autonomy.launch"):
    load = pytest.importorskip("roslaunch.config", reason="needs ROS").load_config_default
    return load([(str(ROOT / "launch" / file), list(words))], None)


@pytest.mark.parametrize("words", [(), ("overrides:=autopilot.backend=mavros",), ("processes:=forked",)])
def test_in_the_simulation_no_node_is_told_to_speak_to_a_mavros(words):
    loaded = loaded_launch("simulation:=true", *words)
    told = [node.args for node in loaded.nodes if "--overrides" in node.args]
    assert len(told) >= 4
    assert all("; autopilot.backend=mavlink'" in args for args in told), "the last one counts"


def test_a_vehicle_that_is_flown_elsewhere_may_be_behind_mavros():
    for words in (("simulation:=true", "vehicle:=external"), ()):
        assert not any("backend" in node.args for node in loaded_launch(*words).nodes)


def test_of_the_second_platform_the_simulation_alone_says_that_there_need_not_be_one():
    loaded = loaded_launch("simulation:=true")
    optional = {name: loaded.params[f"/data_recorder_{name}/optional"].value for name in ("main", "second")}
    assert optional == {"main": False, "second": True}
    delays = {node.name: node.respawn_delay for node in loaded.nodes if node.name.startswith("data_recorder_")}
    assert delays == {"data_recorder_main": 1.0, "data_recorder_second": 1.0}


LIMITS = {
    "watchdog": "watchdog_heartbeat_limit_s",
    "landing_detection": "landing_detection_limit_s",
    "mission_planner": "planner_status_limit_s",
    "autopilot": "autopilot_status_limit_s",
    "data_recorder_main": "recorder_status_limit_s",
    "data_recorder_second": "recorder_status_limit_s",
}
NOT_AGAIN = {"autonomy", "simulation", "console"}


@pytest.mark.parametrize(
    "words",
    [
        ("simulation:=true", "web:=true", "router:=/dev/ttyACM0"),
        ("simulation:=true", "processes:=forked"),
        ("peers:=cns",),
        ("serve:=cns",),
    ],
    ids=lambda words: words[-1],
)
def test_a_node_that_ends_at_its_start_is_started_again_after_a_pause_that_is_shorter_than_its_limit(words):
    failsafe = load_configuration(ROOT / "config").effective["autonomy"]["failsafe"]
    nodes = loaded_launch(*words).nodes
    assert {node.name for node in nodes if not node.respawn} <= NOT_AGAIN
    for node in (node for node in nodes if node.respawn):
        limit_s = failsafe.get(LIMITS.get(node.name, ""), math.inf)
        assert 0.5 <= node.respawn_delay < limit_s, node.name


GROUP = '<launch><group ns="uav1"><include file="{}">{}</include></group></launch>'


@pytest.mark.parametrize(
    "arguments, nodes",
    [
        ({"peers": "cns"}, {"autonomy", "autopilot", "console", "cns_peers"}),
        ({"serve": "cns", "processes": "forked"}, {"node_group", "cns_server"}),
    ],
)
def test_in_a_group_every_node_that_can_be_started_and_all_its_names_are_in_its_namespace(tmp_path, arguments, nodes):
    load = pytest.importorskip("roslaunch.config", reason="needs ROS").load_config_default
    path = tmp_path / "group.launch"
    given = {**arguments, "web": "true", "router": "/dev/ttyACM0"}
    words = "".join(f'<arg name="{name}" value="{value}"/>' for name, value in given.items())
    path.write_text(GROUP.format(ROOT / "launch" / "autonomy.launch", words))

    loaded = load([str(path)], None)

    assert {node.namespace + node.name for node in loaded.nodes} == {
        f"/uav1/{name}" for name in (*nodes, "web", "mavlink_router")
    }
    assert {name for name in loaded.params if not name.startswith("/uav1/")} == {"/rosdistro", "/rosversion"}
    remapped = {name for node in loaded.nodes for names in node.remap_args for name in names}
    assert {name for name in remapped if name.startswith("/")} == set()
    assert "watchdog/action" in remapped


def test_the_launch_file_knows_every_simulated_vehicle():
    text = (ROOT / "launch" / "autonomy.launch").read_text()

    assert f"arg('vehicle') in {(*AUTOPILOTS, 'external')!r}" in text


@pytest.mark.builds
def test_a_demo_whose_simulated_world_does_not_start_ends_at_once_and_is_no_success(tmp_path):
    pytest.importorskip("rospy", reason="needs ROS")
    (tmp_path / "bad.yaml").write_text("description: a scenario with a word too much\nfalts: []\n")

    few = ("monitors:=simulated", "flight:=simulated", "record:=false", "console:=false")  # nodes
    programs = tmp_path / "programs"
    programs.mkdir()
    (programs / "sleep").write_text('#!/bin/sh\necho "$@" >>"${0%/*}/slept"\nexec /bin/sleep "$@"\n')
    (programs / "sleep").chmod(0o755)
    result = run("demo", "faults:=bad.yaml", *few, "output:=out", folder=tmp_path, programs=programs)

    assert result.returncode == 2
    assert f"simulation: {tmp_path}/bad.yaml:2: falts: is an unknown key; did you mean faults?" in result.stderr
    assert result.stderr.splitlines()[-1] == "run: it ended before a mission was begun"
    assert not (programs / "slept").exists(), "it waited for the page of a recording that there is not"


def check_laws(folder: Path, status: int = 0) -> subprocess.CompletedProcess:
    """Do what the demo does when it has ended; the laws' own command ends with a status and names what it was given."""
    programs = folder / "programs"
    programs.mkdir()
    (programs / "amaze-replay").write_text(f'#!/bin/sh\necho "$@"\nexit {status}\n')
    (programs / "amaze-replay").chmod(0o755)
    parts = "sed -n '/^say()/p; /^die()/p; /^check_laws()/,/^}/p' run"
    return subprocess.run(
        ["bash", "-euo", "pipefail", "-c", f'eval "$({parts})"; check_laws "$1"', "bash", str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"},
        timeout=60,
    )


@pytest.mark.parametrize("status", [0, 1])
def test_the_laws_are_checked_on_every_journal_of_a_demo(tmp_path, status):
    for name in ("journal.jsonl", "journal-2.jsonl", "result.json"):
        (tmp_path / name).touch()

    done = check_laws(tmp_path, status)

    assert done.stdout == f"laws {tmp_path}/journal-2.jsonl\nlaws {tmp_path}/journal.jsonl\n"
    assert done.returncode == status, done.stderr


def test_a_demo_with_a_result_and_no_journal_keeps_no_laws(tmp_path):
    (tmp_path / "result.json").touch()

    done = check_laws(tmp_path)

    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.splitlines()[-1] == f"run: the flight left no journal in {tmp_path}: its laws cannot be checked"


def test_a_demo_that_ended_before_a_mission_was_begun_has_no_laws_to_keep_and_that_is_said(tmp_path):
    done = check_laws(tmp_path)

    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr.splitlines()[-1] == "== it ended before a mission was begun: no law to check"


@pytest.mark.builds
def test_a_demo_whose_engine_does_not_start_fails_and_says_so(tmp_path):
    pytest.importorskip("rospy", reason="needs ROS")
    (tmp_path / "empty").mkdir()

    result = run("demo", "config:=empty", "output:=out", folder=tmp_path)

    assert result.returncode == 1
    assert "autonomy: " in result.stderr, "what roslaunch says is in a file; its end is shown when no mission was flown"
    assert result.stderr.splitlines()[-1] == (
        f"no {tmp_path}/out/result.json: the autonomy node ended before its mission did"
    )


@pytest.mark.builds
def test_ctrl_c_once_or_more_before_a_mission_is_selected_is_no_success(tmp_path):
    pytest.importorskip("rospy", reason="needs ROS")
    few = ("monitors:=simulated", "flight:=simulated", "record:=false", "web:=false", "output:=out")  # nodes
    demo = subprocess.Popen(
        ["env", "--default-signal=INT", str(ROOT / "run"), "demo", "mission:=", "unattended:=false", *few],
        cwd=tmp_path,
        env={**os.environ, "AMAZE_COMPUTERS": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    said = []
    for line in demo.stdout:
        said.append(line)
        if "MISSION_INPUT" in line:  # at the prompt, at the console's end, and while the result is told
            os.killpg(demo.pid, signal.SIGINT)

    assert demo.wait(timeout=60) == 2, "".join(said)
    assert said[-1] == "run: it ended before a mission was begun\n"
    assert "COMPLETE" not in "".join(said)
