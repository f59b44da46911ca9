"""What a node is given by the words of its command line: a parameter of that name is named and not read."""

from __future__ import annotations

import ast
import importlib
import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("rospy")

import rospy
from launched import launched

from amaze_autonomy.config import ConfigError, load_configuration
from amaze_autonomy.monitoring.restart import why_kept
from amaze_autonomy.ros import node_main
from amaze_autonomy.ros.arguments import (
    ARGUMENTS,
    NODES,
    configuration_folder,
    given,
    option,
    overrides,
    read_words,
)
from amaze_autonomy.ros.errors import StartError

ROOT = Path(__file__).parents[2]
HARMLESS = {
    *("bounds", "cns_namespace", "engine", "entities", "hover", "mission", "missions", "nice", "peers", "platform"),
    *("drivers", "exit_when_ended", "listeners", "limit_s", "mavlink", "peers_limit", "player", "processes", "rates"),
    *("real", "resume", "seed", "select_at_s", "sensors", "served", "startup_time", "unattended", "vehicle"),
    *("waypoint_reference", "optional"),
}
"""Parameters that name no path, no command and nothing of the configuration."""
PLACE = "/home/Jörg O'Neill/Käfer & Söhne"


def words_of(node):
    return [word for name in NODES[node] for word in (option(name), f"{PLACE}/{name}")]


# --- words ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("node", NODES)
def test_a_node_takes_the_words_of_its_row_with_spaces_and_umlauts(node):
    assert read_words(node, words_of(node)) == {name: f"{PLACE}/{name}" for name in NODES[node]}
    joined = [f"{option(name)}={PLACE}" for name in NODES[node]]
    assert read_words(node, [*joined, "__name:=x", "a:=b"]) == dict.fromkeys(NODES[node], PLACE)
    assert read_words(node, []) == {name: ARGUMENTS[name].default for name in NODES[node]}


@pytest.mark.parametrize(
    "words, said",
    [
        (["--folder", "/x"], "it takes no '--folder'; --help has more"),
        (["--conf", "/x"], "it takes no '--conf'; --help has more"),
        (["/x"], "it takes no '/x'; --help has more"),
        (["--config"], "--config has no value; --help has more"),
        (["_config:=/x"], "_config:=/x makes a parameter of it, which anybody may set: write --config /x"),
        (["_overrides:=a=1"], "_overrides:=a=1 makes a parameter of it, which anybody may set: write --overrides a=1"),
    ],
)
def test_a_word_that_a_node_does_not_take_is_refused(words, said):
    with pytest.raises(StartError, match=re.escape(said)):
        read_words("watchdog", words)


def test_what_is_given_is_read_of_the_command_line(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["watchdog", "--config", f"{PLACE}", "--overrides= a.b=1; c.d=2;", "__name:=w"])
    assert (given("config"), given("folder")) == (PLACE, "")
    assert configuration_folder() == Path(PLACE)
    assert overrides() == ("a.b=1", "c.d=2")
    sys.argv += ["--require-go", "True"]
    assert overrides() == ("a.b=1", "c.d=2", "autonomy.require_go=true")


def test_a_folder_in_a_home_that_nobody_has_is_a_folder_that_is_not_there(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["watchdog", "--config", "~nobody_of_this_name/config"])
    with pytest.raises(ConfigError, match="~nobody_of_this_name/config: "):
        load_configuration(configuration_folder())


# --- parameters -------------------------------------------------------------------------------------------------------


class Server:
    """A parameter server that holds whatever a stranger has put there."""

    def __init__(self, monkeypatch, name, parameters):
        self.warned = []
        monkeypatch.setattr(rospy, "get_name", lambda: f"/{name}")
        monkeypatch.setattr(rospy, "get_param", lambda key, default=None: parameters if key == f"/{name}" else default)
        monkeypatch.setattr(rospy, "logwarn", lambda text, *values: self.warned.append(text % values))


@pytest.mark.parametrize("node", NODES)
def test_a_parameter_in_the_place_of_a_word_is_ignored_and_named_once(node, monkeypatch):
    monkeypatch.setattr(sys, "argv", [node, *words_of(node)])
    server = Server(monkeypatch, node, {**dict.fromkeys(NODES[node], "/tmp/x"), "nice": 0})
    node_main.warn_of_parameters(node)
    assert [text.split("'")[0] for text in server.warned] == [
        f"The parameter /{node}/{name} is ignored (" for name in NODES[node]
    ]


def test_the_warning_says_what_to_write_instead(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["watchdog"])
    server = Server(monkeypatch, "watchdog", {"overrides": ["a.driver=[touch, /tmp/x]", "b=" + "1" * 1000]})
    node_main.warn_of_parameters("watchdog")
    (text,) = server.warned
    assert text.startswith("The parameter /watchdog/overrides is ignored ('a.driver=[touch, /tmp/x]; b=111")
    assert text.endswith(
        "...'): anybody may set one. In a launch file write <node ... args=\"--overrides 'FILE.KEY=VALUE; ...'\"/>"
        ' in the place of <param name="overrides"/>.'
    )
    assert len(text) < 400


@pytest.mark.parametrize("parameters", [{}, "a text", {"config": "/here", "overrides": ""}, {"overrides": []}])
def test_a_parameter_that_says_the_same_is_no_matter(parameters, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["watchdog", "--config", "/here"])
    server = Server(monkeypatch, "watchdog", parameters)
    node_main.warn_of_parameters("watchdog")
    assert server.warned == []


def test_no_node_reads_a_parameter_that_names_a_path_a_command_or_the_configuration():
    """Each that is read is in the list above, or says itself that it is harmless there."""
    found = set()
    for path in (ROOT / "src").rglob("*.py"):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Constant) and isinstance(call.value, str) and re.fullmatch("~[a-z_]+", call.value):
                found.add(call.value[1:])
    published = {"state", "messages", "state_name", "journal", "list_missions", "select_mission", "command"}
    assert not set(ARGUMENTS) & found
    assert found - published <= HARMLESS


@pytest.mark.parametrize("node", sorted({*NODES, "node_group"} - {"simulation", "recorded_peers", "web"}))
def test_every_node_of_ours_that_a_flight_needs_is_kept_by_the_watchdog(node):
    """Those left out have names that a stranger's node may have, and no real flight needs them."""
    assert why_kept(f"/{node}", {}) == f"/{node} is a node of this stack"


def test_the_manual_of_integrators_has_the_words_of_each_node():
    manual = (ROOT / "docs" / "integrator.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| ([^|]+) \| (`--[^|]+) \|$", manual, re.MULTILINE))
    told = {row.strip("`"): set(re.findall(r"`(--[a-z-]+)`", words)) for row, words in rows.items()}
    common = told.pop("each but `recorded_peers` and `console")
    assert {node: set(map(option, names)) for node, names in NODES.items()} == {
        node: told.get(node, set()) | (common if node != "recorded_peers" else set()) for node in NODES
    }
    assert set(told) <= set(NODES)


# --- nodes ------------------------------------------------------------------------------------------------------------


MAINS = {
    "autonomy": "autonomy.node",
    "watchdog": "watchdog.node",
    "data_recorder": "recorder.node",
    "cns_peers": "cns.node",
    "simulation": "simulation.node",
}


@pytest.mark.parametrize("node", MAINS)
def test_a_node_warns_and_loads_the_configuration_of_its_words(node, monkeypatch, tmp_path, capsys):
    module = importlib.import_module(f"amaze_autonomy.nodes.{MAINS[node]}")
    given_folder, loaded = tmp_path / "given", []
    monkeypatch.setattr(sys, "argv", [node, "--config", str(given_folder), "--overrides", "x.y=1"])
    server = Server(monkeypatch, node, {"config": str(tmp_path), "overrides": "sensors.components.lrf.driver=[a]"})
    for name in ("on_shutdown", "signal_shutdown"):
        monkeypatch.setattr(rospy, name, lambda *_, **__: None)
    for name in ("begin", "take_precedence_or_say"):
        monkeypatch.setattr(node_main, name, lambda *_: None)
    monkeypatch.setattr(node_main.signal, "signal", lambda *_: None)
    monkeypatch.setattr(rospy.core, "add_preshutdown_hook", lambda _: None)

    def load(folder, overrides=()):
        loaded.append((Path(folder), tuple(overrides)))
        raise StartError("it is seen")

    for each in (node_main, module):
        monkeypatch.setattr(each, "load_configuration", load, raising=False)
    assert module.main() == 2
    assert loaded == [(given_folder, ("x.y=1",))]
    assert [text.partition(" is ignored")[0] for text in server.warned] == [
        f"The parameter /{node}/config",
        f"The parameter /{node}/overrides",
    ]
    assert capsys.readouterr().err == f"{node}: it is seen\n"


# --- launch files -----------------------------------------------------------------------------------------------------


WHATEVER = "sensors.components.lrf.driver=['touch', \"/tmp/x\"]; autonomy.require_go=true"
CONFIGURED = {"config": f"{PLACE}/config", "overrides": WHATEVER}
RUNS = "/ros_home/amaze_autonomy/simulated"
PLAIN = dict.fromkeys(("landing_detection", "state_estimation", "autopilot", "mission_planner"), CONFIGURED)
SIMULATED = f"{CONFIGURED['overrides']}; autopilot.backend=mavlink"
RECORDER = {**CONFIGURED, "folder": f"{PLACE}/recordings/main", "transfer": "shared"}
CASES = {
    "everything": (
        "autonomy.launch",
        {
            **{name: f"{PLACE}/{name}" for name in ("output", "recordings", "faults", "received", "web_token_file")},
            "simulation": "true",
            "require_go": "false",
            "web": "true",
            "router": "/dev/ttyACM0",
        },
        {
            **PLAIN,
            "watchdog": CONFIGURED,
            "autonomy": {**CONFIGURED, "require_go": "false", "output": f"{PLACE}/output", "runs": RUNS},
            "data_recorder_main": RECORDER,
            "data_recorder_second": {**RECORDER, "folder": f"{PLACE}/recordings/second", "transfer": ""},
            "simulation": {
                **CONFIGURED,
                "faults": f"{PLACE}/faults",
                "received": f"{PLACE}/received",
                "vehicle_url": "udpin:127.0.0.1:14550",
            },
            "mavlink_router": {**CONFIGURED, "device": "/dev/ttyACM0"},
            "web": {**CONFIGURED, "address": "127.0.0.1", "port": "8080", "token_file": f"{PLACE}/web_token_file"},
        },
    ),
    "forked": (
        "autonomy.launch",
        {"processes": "forked", "recordings": f"{PLACE}/recordings", "transfer": "here"},
        {
            "autonomy": {**CONFIGURED, "require_go": "", "output": "", "runs": ""},
            "node_group": {**RECORDER, "transfer": "here"},
        },
    ),
    "cns_peers": (
        "autonomy.launch",
        {"peers": "cns", "cns_recordings": f"main={PLACE}"},
        {
            "autonomy": {**CONFIGURED, "require_go": "", "output": "", "runs": ""},
            "autopilot": CONFIGURED,
            "cns_peers": {**CONFIGURED, "recordings": f"main={PLACE}"},
        },
    ),
    "cns_server": (
        "autonomy.launch",
        {"cns_served": "watchdog"},
        {"watchdog": CONFIGURED, "autopilot": CONFIGURED, "cns_server": CONFIGURED},
    ),
    "recorder": (
        "recorder.launch",
        {"platform": "second", "folder": PLACE},
        {"data_recorder_second": {**CONFIGURED, "folder": PLACE, "transfer": ""}},
    ),
    "played": (
        "play_recording.launch",
        {"bag": f"{PLACE}.bag", "received": PLACE},
        {
            **dict.fromkeys(("watchdog", "landing_detection", "state_estimation"), CONFIGURED),
            "autonomy": {**CONFIGURED, "require_go": "", "output": "", "runs": "/ros_home/amaze_autonomy/played"},
            "recorded_peers": {"bag": f"{PLACE}.bag", "result": PLACE},
        },
    ),
}


@pytest.mark.slow_rows
@pytest.mark.parametrize("case", CASES)
def test_a_launch_file_gives_each_node_its_words_and_sets_no_such_parameter(case, monkeypatch):
    monkeypatch.setenv("ROS_HOME", "/ros_home")
    file, arguments, expected = CASES[case]
    parameters, words = launched(file, *(f"{name}:={value}" for name, value in {**CONFIGURED, **arguments}.items()))
    if arguments.get("simulation"):
        expected = {node: {**each, "overrides": SIMULATED} for node, each in expected.items()}
    assert words == expected
    assert not {name.rpartition("/")[2] for name in parameters} & set(ARGUMENTS)
