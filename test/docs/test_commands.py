"""What README.md and docs/ show to be typed: every command is one that there is, every block runs, or says why not.

A block that is not run has `<!-- not run: WHY -->` above it. The others run here from top to bottom, in an empty folder
where they find what they name: a flight's bag as `flight.bag`, a configuration as `config`, and so on (`_PROVIDED`).
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import List, NamedTuple
from xml.etree import ElementTree as ET

import pytest
from cns_folder import write_folder
from other_recordings import ulog_rows, write_ulog
from recorded import recording

from amaze_autonomy import cli
from amaze_autonomy.bags import cli as bags_cli
from amaze_autonomy.engine.events import UserCommand
from amaze_autonomy.interface import SERVICES
from amaze_autonomy.ros.arguments import NODES, read_words
from amaze_autonomy.simulation import cli as simulation_cli
from amaze_autonomy.simulation import px4_udp as vehicle_cli
from amaze_autonomy.tester import command

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "CONTRIBUTING.md", *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md"))))
OFFLINE = {
    "amaze-autonomy": (cli.main, cli._parser()),
    "amaze-bag": (bags_cli.main, bags_cli._parser()),
    "amaze-replay": (command.main, command._parser(scenarios=True)),
}
OWN_OPTIONS = {"amaze-autonomy simulate": simulation_cli._parser(), "amaze-autonomy vehicle": vehicle_cli._parser()}
OTHERS = {"git", "mavlink-routerd", "pytest", "rosbag", "sudo", "tar", "catkin_make", "/usr/bin/python3", "source"}
"""Programs that are not ours."""
PUBLISHED = ROOT / "src/amaze_autonomy/nodes/autonomy/outbox.py"
DIFFERENT = {
    "amaze-autonomy doctor": 3,  # no graph runs here
    "amaze-autonomy simulate --faults lrf": 1,  # landed early
    "amaze-replay coverage": 1,  # of one scenario
    "amaze-replay journal 2": 1,  # it flew with other limits
    "amaze-replay journal journal.jsonl --set": 4,  # nothing fails in the flight at hand, so no decision asked for it
    "amaze-replay run flight.tlog --flight 2": 2,  # the recording at hand has one flight
    "amaze-replay run flight.tlog sensors.bag": 2,  # those at hand are not of one day
    "amaze-replay shrink": 2,  # it decides as its golden says
    "amaze-replay what-if": 1,
}
"""Commands whose exit status is not 0 on what is provided here, by how they begin."""


class Block(NamedTuple):
    page: str
    line: int
    commands: List[List[str]]
    is_run: bool

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks_of(page):
    text = (ROOT / page).read_text()
    for match in re.finditer(r"(<!-- not run: [^\n]+ -->\n+)?^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        commands = [] if match.group(2) else list(commands_of(match.group(3)))
        if commands:
            yield Block(page, text[: match.start(2)].count("\n") + 1, commands, match.group(1) is None)


def commands_of(block):
    """Yield the words of each command; where some begin with `$ `, the other lines are what they print."""
    lines = block.replace("\\\n", " ").splitlines()
    prompted = [line[2:] for line in lines if line.startswith("$ ")]
    for line in prompted or lines:
        first = line.partition(" ")[0]
        if prompted or first in {*OFFLINE, *OTHERS, *THERE_IS}:
            words = shlex.split(line.partition(" | ")[0], comments=True)
            while re.fullmatch(r"[A-Z_]+=\S*", words[0]):
                del words[0]  # of the environment
            yield words


# --- there is such a command ------------------------------------------------------------------------------------------


def there_is_job(job="", *arguments):
    if not job:
        return True  # it lists them
    given = [word.partition(":=") for word in arguments if ":=" in word]
    names = [value for name, _, value in given if name == "faults" and not value.endswith(".yaml")]
    return (
        f"\nrun_{job}()" in (ROOT / "run").read_text()
        and {name for name, _, _ in given} <= launch_arguments("autonomy.launch")
        and all((ROOT / "config" / "faults" / f"{name}.yaml").is_file() for name in names)
    )


def there_is_launch_file(package, file, *arguments):
    return package == "amaze_autonomy" and {word.partition(":=")[0] for word in arguments} <= launch_arguments(file)


def launch_arguments(file):
    return {argument.get("name") for argument in ET.parse(ROOT / "launch" / file).iter("arg")}


@pytest.mark.parametrize("file", sorted(path.name for path in (ROOT / "launch").glob("*.launch")))
def test_each_argument_of_a_launch_file_is_documented_with_its_default(file):
    text = (ROOT / "docs" / "integrator.md").read_text()
    table = text.partition(f"\n`{file}`:\n\n")[2].partition("\n\n")[0].splitlines()[2:]
    arguments = ET.parse(ROOT / "launch" / file).getroot().findall("arg")
    assert table == [
        f"| `{each.get('name')}` | {documented(each.get('default'))} | {each.get('doc')} |"
        for each in arguments
        if not each.get("name").startswith("_")
    ]


def documented(default):
    if default is None:
        return "must be given"
    return f"`{default}`" if default else "empty"


def there_is_node(package, node, *words):
    if node in NODES:
        read_words(node, words[1:] if node == "mavlink_router" else words)  # else it raises
    return package == "amaze_autonomy" and (ROOT / "scripts" / node).is_file()


def there_is_service(verb, name, *_):
    offered = {"list_missions", "select_mission", "command", *(each.value for each in UserCommand)}
    peers = {*SERVICES, "mission_planner/load_waypoints"}
    return verb == "call" and name in {*(f"/autonomy/{each}" for each in offered), *(f"/{each}" for each in peers)}


def there_is_topic(verb, name):
    return verb == "echo" and f'"~{name.rpartition("/")[2]}"' in PUBLISHED.read_text()


THERE_IS = {
    "./run": there_is_job,
    "roslaunch": there_is_launch_file,
    "rosrun": there_is_node,
    "rosservice": there_is_service,
    "rostopic": there_is_topic,
}


BLOCKS = [block for page in PAGES for block in blocks_of(page)]
COMMANDS = {f"{block} {' '.join(words)}": words for block in BLOCKS for words in block.commands}


@pytest.mark.parametrize("shown", [shown for shown, (program, *_) in COMMANDS.items() if program not in OTHERS])
def test_a_command_is_one_that_there_is(shown):
    program, *arguments = COMMANDS[shown]
    if " ".join((program, *arguments[:1])) in OWN_OPTIONS:
        OWN_OPTIONS[f"{program} {arguments[0]}"].parse_args(arguments[1:])  # else it exits
    elif program in OFFLINE:
        OFFLINE[program][1].parse_args(arguments)
    else:
        assert THERE_IS[program](*arguments)


# --- it runs ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow_rows
@pytest.mark.parametrize("block", [block for block in BLOCKS if block.is_run], ids=str)
def test_a_block_runs_as_it_stands(block, tmp_path, monkeypatch, capsys):
    pytest.importorskip("plotly")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")  # nobody is there
    monkeypatch.setenv("COLUMNS", "120")
    wrong = []
    for program, *words in block.commands:
        arguments = [re.sub(r"^~|\$HOME", str(tmp_path), word) for word in words]
        for word in arguments:
            provide(word.replace(f"{tmp_path}/", ""), arguments)
        if program == "pytest":
            subprocess.run([sys.executable, "-m", program, *arguments], check=True, timeout=600)
            continue
        status = OFFLINE[program][0](arguments)
        out, err = capsys.readouterr()
        shown = " ".join((program, *arguments))
        if status != next((DIFFERENT[each] for each in DIFFERENT if shown.startswith(each)), 0):
            wrong.append(f"{shown}: {status}\n{out}{err}")
    assert not wrong, "\n".join(wrong)


def provide(name, arguments):
    """Put what a command names where it looks for it, unless it is there, or what the command is going to write."""
    outputs = ("-o", "--out", "--output", "--html")
    written = {word for option, word in zip(arguments, arguments[1:]) if option in outputs}
    if name in _PROVIDED and not Path(name).exists() and not any(each.endswith(name) for each in written):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        _PROVIDED[name](Path(name))


def flight(path):
    shutil.copyfile(ROOT / "test/scenarios/recorded/demo_flight.bag", path)


def real(path, name=None):
    shutil.copyfile(recording(name or path.name), path)


def configuration(path):
    shutil.copytree(ROOT / "config", path)


def journal(path):
    assert cli.main(["simulate", "--journal", str(path)]) == 0


def topic_map(path):
    shutil.copyfile(ROOT / "src/amaze_autonomy/replay/maps/amaze_demo.yaml", path)


def scenario(path):
    path.parent.joinpath("goldens").mkdir()
    shutil.copyfile(ROOT / "test/scenarios/lrf.scenario.yaml", path)
    shutil.copyfile(ROOT / "test/scenarios/goldens/lrf.golden.jsonl", path.parent / "goldens" / "lrf.golden.jsonl")


def scenarios(path):
    path.mkdir(parents=True)
    scenario(path / "lrf.scenario.yaml")
    flight(path / "flight.bag")
    topic_map(path / "quadrotor.yaml")


_PROVIDED = {
    **dict.fromkeys(("flight.bag", "sensors.bag", "20261121T010929-001.bag"), flight),
    **dict.fromkeys(("ardrone_indoor_flight.bag", "crazyflie_sine.bag"), real),
    "flight.tlog": lambda path: real(path, "px4_normal_mission.tlog"),
    "flight.ulg": lambda path: write_ulog(path, ulog_rows()),
    **dict.fromkeys(("my_map.yaml", "mine.yaml", "flight.yaml"), topic_map),
    **dict.fromkeys(("FOLDER", "config", "my_config", "desk", "flight/config"), configuration),
    "cns/config": write_folder,
    **dict.fromkeys(("journal.jsonl", "live/journal.jsonl", "replayed/journal.jsonl"), journal),
    "lrf.scenario.yaml": scenario,
    **dict.fromkeys(("flights", "test/scenarios"), scenarios),
}
