"""Faults of processes that are real nodes: killed and kept down, stopped, and let go on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from waiting import wait_for

pytest.importorskip("rospy", reason="needs ROS")

from amaze_autonomy.nodes.simulation import live_world
from amaze_autonomy.nodes.simulation import node as simulation_node
from amaze_autonomy.nodes.simulation.live_world import RealPeers
from amaze_autonomy.ros.liveness import LocalProcess
from amaze_autonomy.simulation import parse_scenario


class Node:
    """A process with a name, that somebody starts again when it ends."""

    def __init__(self) -> None:
        self.processes = []
        self.start()

    def start(self) -> None:
        self.processes.append(subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE))

    def state(self) -> str:
        """R, S: runs; T: stopped; of the last one."""
        return Path(f"/proc/{self.processes[-1].pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]


@pytest.fixture
def node(monkeypatch):
    made = Node()
    monkeypatch.setattr(live_world, "_find", lambda _: LocalProcess.of(made.processes[-1].pid))
    yield made
    for process in made.processes:
        process.kill()
        process.communicate(timeout=10)


@pytest.fixture
def peers():
    made = RealPeers({"autopilot": "autopilot"})
    yield made
    made.end()


def test_what_is_killed_stays_down_until_the_fault_ends_whoever_starts_it_again(node, peers):
    peers.look_after({"autopilot": ("killed",)})
    assert node.processes[0].wait(10.0) == -9
    node.start()
    wait_for(lambda: node.state() == "T", "the stop of what was started again")
    peers.look_after({"autopilot": ("killed",)})
    assert node.state() == "T"
    peers.look_after({})
    wait_for(lambda: node.state() in "RS", "its going on")


@pytest.mark.parametrize("kind", ["silent", "stuck"])
def test_what_is_silent_or_stuck_is_stopped_until_the_fault_ends(node, peers, kind):
    peers.look_after({"autopilot": (kind,)})
    wait_for(lambda: node.state() == "T", "the stop")
    peers.look_after({})
    wait_for(lambda: node.state() in "RS", "its going on")


def test_at_the_end_nothing_stays_stopped(node, peers):
    peers.look_after({"autopilot": ("silent",)})
    wait_for(lambda: node.state() == "T", "the stop")
    peers.end()
    wait_for(lambda: node.state() in "RS", "its going on")


def test_a_fault_that_a_real_node_cannot_be_given_is_told(node, peers, monkeypatch):
    told = []
    monkeypatch.setattr(live_world.rospy, "logwarn", lambda words, *values: told.append(words % values))
    peers.look_after({"autopilot": ("slow",)})
    wait_for(lambda: told, "the warning")
    assert (told, node.state() in "RS") == (["autopilot is a real node: its fault slow does nothing"], True)


def test_a_fault_of_what_is_a_real_node_is_said_to_do_nothing(monkeypatch):
    told = []
    monkeypatch.setattr(simulation_node.rospy, "logwarn", lambda words, *values: told.append(words % values))
    faults = [f"{{fault: {name}}}" for name in ("recording_does_not_grow", "recording_fails", "data_incomplete")]
    faults += ["{fault: tilted, tilt_deg: 20}", "{service: autopilot/land, fault: refuses}"]
    story = parse_scenario("description: one\nfaults:\n" + "".join(f"  - {fault}\n" for fault in faults))
    simulation_node._tell_without_effect(story, ("data_recorder", "autopilot"))
    recorder = "does nothing: data_recorder is a real node; start with recorder:=simulated"
    autopilot = "does nothing: autopilot is a real node; start with flight:=simulated or monitors:=simulated"
    names = ("recording_does_not_grow", "recording_fails", "data_incomplete")
    assert told == [
        *(f"the fault {name} {recorder}" for name in names),
        f"the fault autopilot/land refuses {autopilot}",
    ]
    told.clear()
    simulation_node._tell_without_effect(story, ())
    assert told == []
