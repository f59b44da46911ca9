"""The one command for every job, from the outside."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from pathlib import Path
from typing import Optional
from xml.etree import ElementTree as ET

import pytest

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
        *("build", "demo", "demo-two-computers", "console", "replay", "test", "test-beside", "test-py38"),
        *(
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


@pytest.mark.parametrize(
    "argument, words",
    [
        ("vehicle:=px5", "vehicle:=px5 is none of px4, ardupilot, external"),
        ("flight:=no", "flight:=no is none of real, simulated"),
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
