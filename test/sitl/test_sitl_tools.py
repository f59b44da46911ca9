"""The tools of the flights with real autopilots: scenarios, relay, links put right."""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path

import pytest
import yaml
from fly import QUICK
from sitl_autopilots import KINDS, folder_of, ready_to_run
from sitl_relay import Relay
from sitl_scenario import ScenarioError, load

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.link.framing import read_tlog
from amaze_autonomy.simulation import parse_scenario

HERE = Path(__file__).parent
SCENARIOS = sorted((HERE / "scenarios").glob("*.yaml"))


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_every_scenario_that_ships_can_be_read_and_so_can_what_it_does_to_the_world(path):
    scenario = load(path)

    assert set(scenario.expect) == set(scenario.autopilots) <= set(KINDS)
    if scenario.world:
        parse_scenario(yaml.safe_dump(dict(scenario.world)))


def test_the_quick_ones_are_scenarios_that_ship():
    assert {name for name, _ in QUICK} <= {path.stem for path in SCENARIOS}


@pytest.mark.parametrize(
    "line, words",
    [
        ("when: [{do: cut}]", "cut has no for_s"),
        ("when: [{do: cutt, for_s: 1}]", "action 'cutt' is not known"),
        ("when: [{do: cut, for_s: 1, after: {event: lunch}}]", "event 'lunch' is not known"),
        ("faluts: []", "key 'faluts' is not known"),
        ("not_for: {px5: too new}", "autopilot 'px5' is not known"),
    ],
)
def test_a_mistake_in_a_scenario_is_one_line_with_its_file(tmp_path, line, words):
    path = tmp_path / "one.yaml"
    path.write_text(f"description: one\n{line}\nexpect: {{result: COMPLETE, states: [TAKEOFF]}}\n")

    with pytest.raises(ScenarioError) as caught:
        load(path)

    assert str(caught.value).startswith(f"{path}: {words}")


@pytest.mark.parametrize("state", ["FLYING", "takeoff", "PREFLIGHT"])
def test_a_state_that_is_none_is_refused(tmp_path, state):
    path = tmp_path / "one.yaml"
    path.write_text(f"description: one\nexpect: {{result: COMPLETE, states: [{state}]}}\n")

    with pytest.raises(ScenarioError, match=f"state '{state}' is not known"):
        load(path)


@pytest.fixture
def ends():
    made = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for each in made:
        each.bind(("127.0.0.1", 0))
        each.settimeout(2.0)
    yield made
    for each in made:
        each.close()


@pytest.fixture
def relay(tmp_path, ends):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    made = Relay({"node": (port, ends[1].getsockname()[1])}, tmp_path)
    made.start()
    yield made, ("127.0.0.1", port)
    made.stop()


def beat(number):
    return mavlink.MAVLink_heartbeat_message(2, 12, 81, number, 4, 3).pack(mavlink.MAVLink(None, 1, 1))


def test_a_relay_passes_both_ways_and_writes_down_what_it_passed(tmp_path, relay, ends):
    made, place = relay
    autopilot, node = ends

    autopilot.sendto(beat(7), place)
    there, back = node.recvfrom(1000)
    node.sendto(beat(8), back)
    answer, _ = autopilot.recvfrom(1000)
    made.stop()

    assert (there, answer) == (beat(7), beat(8))
    frames, _ = read_tlog(tmp_path / "node.tlog")
    assert [frame.raw for _, frame in frames] == [beat(7), beat(8)]


def test_what_is_cut_is_lost_both_ways_and_is_not_passed(relay, ends):
    made, place = relay
    autopilot, node = ends
    autopilot.sendto(beat(1), place)
    _, back = node.recvfrom(1000)

    made.links["node"].cut = True
    autopilot.sendto(beat(2), place)
    node.sendto(beat(3), back)
    deadline = time.monotonic() + 2.0
    while made.links["node"].lost < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    made.links["node"].cut = False
    autopilot.sendto(beat(4), place)

    assert node.recvfrom(1000)[0] == beat(4)
    assert (made.links["node"].passed, made.links["node"].lost) == (2, 2)


def test_a_link_loses_the_part_that_it_is_told_to(relay, ends):
    made, place = relay
    made.links["node"].loss = 0.2
    for number in range(500):
        ends[0].sendto(beat(number), place)
        if number % 50 == 0:
            time.sleep(0.01)
    deadline = time.monotonic() + 5.0
    while made.links["node"].passed + made.links["node"].lost < 500 and time.monotonic() < deadline:
        time.sleep(0.01)

    assert 60 < made.links["node"].lost < 140


def test_a_copy_of_px4_that_lost_its_links_gets_them_back(tmp_path, monkeypatch):
    commands = tmp_path / "sitl" / "px4" / "bin"
    commands.mkdir(parents=True)
    (commands / "px4").write_text("#!/bin/sh\n")
    (commands / "px4").chmod(0o755)
    (commands / "px4-param").write_text("px4")
    monkeypatch.setenv("AMAZE_SITL", str(tmp_path / "sitl"))

    program = ready_to_run("px4", folder_of("px4"), tmp_path / "build")

    assert os.readlink(program / "bin" / "px4-param") == "px4"
    assert ready_to_run("px4", program, tmp_path / "other") == program


def test_an_autopilot_that_is_not_there_is_not_found(tmp_path, monkeypatch):
    monkeypatch.setenv("AMAZE_SITL", str(tmp_path))

    assert [folder_of(name) for name in KINDS] == [None, None]
